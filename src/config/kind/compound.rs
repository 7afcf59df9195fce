//! Kinds made of several values.

use serde_json::{Value as Json, json};
use toml::de::DeValue;

use super::scalar::{Moment, Number};
use super::value::{Fault, Item, Kind, miscount, wrong_type};
use crate::config::draft::PerReceiver;
use crate::role::{PerVehicle, Role};
use crate::time::Utc;

/// A fixed number of numbers, each with its name and range.
pub(crate) struct Numbers<const N: usize>(pub(crate) [(&'static str, Number); N]);

impl<const N: usize> Kind for Numbers<N> {
    type Out = [f64; N];

    fn read(&self, item: &Item<'_>, faults: &mut Vec<Fault>) -> Option<[f64; N]> {
        let Some(items) = item.get_ref().as_array().filter(|items| items.len() == N) else {
            wrong_type(self, item, faults);
            return None;
        };
        let mut values = [0.0; N];
        let mut sound = true;
        for ((value, item), (name, kind)) in values.iter_mut().zip(items.iter()).zip(&self.0) {
            let first = faults.len();
            match kind.read(item, faults) {
                Some(number) => *value = number,
                None => sound = false,
            }
            for fault in &mut faults[first..] {
                fault.clause = format!("({name}) {}", fault.clause);
            }
        }
        sound.then_some(values)
    }

    fn fault(&self, value: &[f64; N]) -> Option<String> {
        let mut each = self.0.iter().zip(value);
        each.find_map(|((name, kind), number)| Some(format!("({name}) {}", kind.fault(number)?)))
    }

    fn expected(&self) -> String {
        let names: Vec<&str> = self.0.iter().map(|(name, _)| *name).collect();
        format!("{N} numbers [{}]", names.join(", "))
    }

    fn schema(&self) -> Json {
        let each: Vec<Json> = self.0.iter().map(|(_, kind)| kind.schema()).collect();
        json!({ "type": "array", "items": each, "additionalItems": false, "minItems": N, "maxItems": N })
    }

    fn canonical(&self, value: &[f64; N]) -> Json {
        value.iter().map(|number| json!(number + 0.0)).collect()
    }
}

/// From one moment to a later one.
pub(crate) struct Period;

impl Kind for Period {
    type Out = [Utc; 2];

    fn read(&self, item: &Item<'_>, faults: &mut Vec<Fault>) -> Option<[Utc; 2]> {
        let items: Vec<&Item<'_>> =
            item.get_ref().as_array().into_iter().flat_map(|items| items.iter()).collect();
        let [from, until] = items[..] else {
            wrong_type(self, item, faults);
            return None;
        };
        let (from, until) = (Moment.read(from, faults), Moment.read(until, faults));
        let period = [from?, until?];
        match self.fault(&period) {
            Some(clause) => faults.push(Fault { at: item.span(), clause }),
            None => return Some(period),
        }
        None
    }

    fn fault(&self, [from, until]: &[Utc; 2]) -> Option<String> {
        (from >= until).then(|| format!("ends at {until}, which is not after its beginning at {from}"))
    }

    fn expected(&self) -> String {
        "[from, until], two dates and times with their offsets, such as [2026-01-01T00:00:00Z, 2026-12-31T23:59:59Z]"
            .to_owned()
    }

    fn schema(&self) -> Json {
        let each = Moment.schema();
        json!({ "type": "array", "items": [each, each], "additionalItems": false, "minItems": 2, "maxItems": 2 })
    }

    fn canonical(&self, value: &[Utc; 2]) -> Json {
        value.iter().map(|moment| Moment.canonical(moment)).collect()
    }
}

/// A list of so many values of a kind.
pub(crate) struct List<K> {
    pub(crate) each: K,
    pub(crate) at_least: usize,
    pub(crate) at_most: usize,
}

impl<K: Kind> Kind for List<K> {
    type Out = Vec<K::Out>;

    fn read(&self, item: &Item<'_>, faults: &mut Vec<Fault>) -> Option<Vec<K::Out>> {
        let Some(items) = item.get_ref().as_array() else {
            wrong_type(self, item, faults);
            return None;
        };
        let values: Vec<Option<K::Out>> = items.iter().map(|item| self.each.read(item, faults)).collect();
        if let Some(clause) = miscount(items.len(), self.at_least, self.at_most) {
            faults.push(Fault { at: item.span(), clause });
            return None;
        }
        values.into_iter().collect()
    }

    fn fault(&self, values: &Vec<K::Out>) -> Option<String> {
        values
            .iter()
            .find_map(|value| self.each.fault(value))
            .or_else(|| miscount(values.len(), self.at_least, self.at_most))
    }

    fn expected(&self) -> String {
        format!("an array of {} to {}, each {}", self.at_least, self.at_most, self.each.expected())
    }

    fn schema(&self) -> Json {
        json!({ "type": "array", "items": self.each.schema(), "minItems": self.at_least, "maxItems": self.at_most })
    }

    fn canonical(&self, values: &Vec<K::Out>) -> Json {
        values.iter().map(|value| self.each.canonical(value)).collect()
    }
}

/// One value for each of a few named things, as one value for all, or as a table with one for each.
fn read_named<K: Kind<Out: Copy>, const N: usize>(
    kind: &K,
    names: [(&str, &str); N],
    item: &Item<'_>,
    faults: &mut Vec<Fault>,
) -> Option<[K::Out; N]> {
    let DeValue::Table(table) = item.get_ref() else {
        return kind.read(item, faults).map(|all| [all; N]);
    };
    let first = faults.len();
    let is_known = |key: &str| names.iter().any(|(name, _)| *name == key);
    for (key, _) in table.iter().filter(|(key, _)| !is_known(key.get_ref())) {
        faults.push(Fault { at: key.span(), clause: format!("has the unknown key `{}`", key.get_ref()) });
    }
    let values = names.map(|(key, title)| {
        let Some(item) = table.get(key) else {
            faults.push(Fault { at: item.span(), clause: format!("has no `{key}`") });
            return None;
        };
        let before = faults.len();
        let value = kind.read(item, faults);
        for fault in &mut faults[before..] {
            fault.clause = format!("of {title} {}", fault.clause);
        }
        value
    });
    if faults.len() > first || values.iter().any(Option::is_none) {
        return None;
    }
    let mut values = values.into_iter().flatten();
    let first = values.next()?;
    Some(std::array::from_fn(|index| if index == 0 { first } else { values.next().unwrap_or(first) }))
}

/// `names`: each with whose value it is.
fn named_schema<const N: usize>(kind: &impl Kind, names: [(&str, &str); N]) -> Json {
    let one = kind.schema();
    let described = |(name, title): &(&str, &str)| {
        let mut schema = one.clone();
        schema["description"] = json!(format!("The value of {title}."));
        ((*name).to_owned(), schema)
    };
    let properties: serde_json::Map<String, Json> = names.iter().map(described).collect();
    let names = names.map(|(name, _)| name);
    json!({ "oneOf": [one, {
        "type": "object", "additionalProperties": false, "required": names.as_slice(),
        "properties": properties,
    }] })
}

/// One value for both vehicles, or a table with one for each: `0.5` or `{ i = 0.5, j = 0.2 }`.
pub(crate) struct Each<K>(pub(crate) K);

impl<K: Kind<Out: Copy>> Kind for Each<K> {
    type Out = PerVehicle<K::Out>;

    fn read(&self, item: &Item<'_>, faults: &mut Vec<Fault>) -> Option<Self::Out> {
        read_named(&self.0, [("i", "I"), ("j", "J")], item, faults).map(|[i, j]| PerVehicle { i, j })
    }

    fn fault(&self, value: &Self::Out) -> Option<String> {
        Role::BOTH.into_iter().find_map(|role| Some(format!("of {role} {}", self.0.fault(&value[role])?)))
    }

    fn expected(&self) -> String {
        format!("{}, or one for each vehicle, {{ i = ..., j = ... }}", self.0.expected())
    }

    fn schema(&self) -> Json {
        named_schema(&self.0, [("i", "vehicle I"), ("j", "vehicle J")])
    }

    fn canonical(&self, value: &Self::Out) -> Json {
        json!({ "i": self.0.canonical(&value.i), "j": self.0.canonical(&value.j) })
    }
}

/// One number for every receiver, or a table with one for each kind: `15.0` or `{ user = 15.0, eavesdropper = 12.0 }`.
pub(crate) struct Receivers(pub(crate) Number);

impl Kind for Receivers {
    type Out = PerReceiver;

    fn read(&self, item: &Item<'_>, faults: &mut Vec<Fault>) -> Option<PerReceiver> {
        let names = [("user", "the user"), ("eavesdropper", "an eavesdropper")];
        read_named(&self.0, names, item, faults)
            .map(|[user, eavesdropper]| PerReceiver { user, eavesdropper })
    }

    fn fault(&self, value: &PerReceiver) -> Option<String> {
        let each = [("the user", value.user), ("an eavesdropper", value.eavesdropper)];
        each.iter().find_map(|(title, number)| Some(format!("of {title} {}", self.0.fault(number)?)))
    }

    fn expected(&self) -> String {
        format!(
            "{}, or one for each kind of receiver, {{ user = ..., eavesdropper = ... }}",
            self.0.expected()
        )
    }

    fn schema(&self) -> Json {
        named_schema(&self.0, [("user", "users"), ("eavesdropper", "eavesdroppers")])
    }

    fn canonical(&self, value: &PerReceiver) -> Json {
        json!({ "user": self.0.canonical(&value.user), "eavesdropper": self.0.canonical(&value.eavesdropper) })
    }
}
