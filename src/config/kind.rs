//! The kinds of values a setting can have: how each is read, what is said when it cannot be, how the schema
//! describes it, and its canonical form.

use std::fmt::Display;
use std::str::FromStr;

use serde_json::{Value as Json, json};
use toml::Spanned;
use toml::de::DeValue;

use super::diagnostic::Span;
use crate::role::{PerVehicle, Role};

/// What is wrong with a value, and which part of it: a clause that continues the setting's name.
pub(super) struct Fault {
    pub(super) at: Span,
    pub(super) clause: String,
}

/// A value with its place in the text.
pub(super) type Item<'d> = Spanned<DeValue<'d>>;

/// One kind of value.
pub(super) trait Kind {
    /// What it is read into.
    type Out;

    /// The value, or `None` after pushing at least one fault.
    fn read(&self, item: &Item<'_>, faults: &mut Vec<Fault>) -> Option<Self::Out>;

    /// What should have been written, as a noun phrase.
    fn expected(&self) -> String;

    /// The JSON Schema of it.
    fn schema(&self) -> Json;

    /// The canonical form: the same for every way of writing the same value.
    fn canonical(&self, value: &Self::Out) -> Json;
}

/// How a value found in a file is quoted back.
fn found(item: &Item<'_>) -> String {
    match item.get_ref() {
        DeValue::String(text) => format!("the string {text:?}"),
        DeValue::Integer(number) => format!("the integer {number}"),
        DeValue::Float(number) => format!("the number {number}"),
        DeValue::Boolean(flag) => format!("the boolean {flag}"),
        DeValue::Datetime(date) => format!("the date {date}"),
        DeValue::Array(items) => format!("an array of {}", items.len()),
        DeValue::Table(_) => "a table".to_owned(),
    }
}

fn wrong_type(kind: &impl Kind, item: &Item<'_>, faults: &mut Vec<Fault>) {
    faults.push(Fault {
        at: item.span(),
        clause: format!("must be {}, found {}", kind.expected(), found(item)),
    });
}

/// A finite number in a unit and a range.
#[derive(Debug, Clone, Copy)]
pub(super) struct Number {
    unit: &'static str,
    min: f64,
    max: f64,
    above: bool,
}

impl Number {
    /// At least `min`, at most `max`. The empty unit is a plain number.
    pub(super) const fn within(unit: &'static str, min: f64, max: f64) -> Self {
        Self { unit, min, max, above: false }
    }

    /// More than zero, at most `max`.
    pub(super) const fn positive(unit: &'static str, max: f64) -> Self {
        Self { unit, min: 0.0, max, above: true }
    }

    fn quantity(&self, value: f64) -> String {
        let number = plain(value);
        if self.unit.is_empty() { number } else { format!("{number} {}", self.unit) }
    }

    fn out_of_range(&self, value: f64) -> Option<String> {
        let value_text = self.quantity(value);
        if !value.is_finite() {
            Some(format!("is {value}, not a finite number"))
        } else if value < self.min {
            Some(format!("is {value_text}, below the minimum of {}", self.quantity(self.min)))
        } else if self.above && value <= self.min {
            Some(format!("is {value_text}, but must be more than {}", self.quantity(self.min)))
        } else if value > self.max {
            Some(format!("is {value_text}, above the maximum of {}", self.quantity(self.max)))
        } else {
            None
        }
    }
}

/// A number as people write it: exponents only where they help.
fn plain(value: f64) -> String {
    if value != 0.0 && !(1e-4..1e6).contains(&value.abs()) {
        format!("{value:e}")
    } else {
        format!("{value}")
    }
}

impl Kind for Number {
    type Out = f64;

    fn read(&self, item: &Item<'_>, faults: &mut Vec<Fault>) -> Option<f64> {
        let value = match item.get_ref() {
            DeValue::Float(float) => float.as_str().parse().ok(),
            // An integer too large for 128 bits is infinite for our purposes.
            #[allow(clippy::cast_precision_loss)]
            DeValue::Integer(integer) => Some(
                i128::from_str_radix(integer.as_str(), integer.radix())
                    .map_or(f64::INFINITY, |value| value as f64),
            ),
            _ => None,
        };
        let Some(value) = value else {
            wrong_type(self, item, faults);
            return None;
        };
        if let Some(clause) = self.out_of_range(value) {
            faults.push(Fault { at: item.span(), clause });
            return None;
        }
        Some(value)
    }

    fn expected(&self) -> String {
        let unit = if self.unit.is_empty() { String::new() } else { format!(" in {}", self.unit) };
        let from = if self.above { "more than" } else { "at least" };
        format!("a number{unit}, {from} {} and at most {}", plain(self.min), plain(self.max))
    }

    fn schema(&self) -> Json {
        let minimum = if self.above { "exclusiveMinimum" } else { "minimum" };
        let mut schema = json!({ "type": "number", minimum: self.min, "maximum": self.max });
        if !self.unit.is_empty() {
            schema["x-unit"] = json!(self.unit);
        }
        schema
    }

    fn canonical(&self, value: &f64) -> Json {
        json!(value + 0.0)
    }
}

/// A whole number in a range.
#[derive(Debug, Clone, Copy)]
pub(super) struct Integer {
    pub(super) min: u64,
    pub(super) max: u64,
}

impl Kind for Integer {
    type Out = u64;

    fn read(&self, item: &Item<'_>, faults: &mut Vec<Fault>) -> Option<u64> {
        let DeValue::Integer(integer) = item.get_ref() else {
            wrong_type(self, item, faults);
            return None;
        };
        let value = u64::from_str_radix(integer.as_str(), integer.radix()).ok();
        match value.filter(|value| (self.min..=self.max).contains(value)) {
            None => {
                let clause = format!("is {integer}, outside {} to {}", self.min, self.max);
                faults.push(Fault { at: item.span(), clause });
                None
            }
            some => some,
        }
    }

    fn expected(&self) -> String {
        format!("a whole number from {} to {}", self.min, self.max)
    }

    fn schema(&self) -> Json {
        json!({ "type": "integer", "minimum": self.min, "maximum": self.max })
    }

    fn canonical(&self, value: &u64) -> Json {
        json!(value)
    }
}

/// True or false.
pub(super) struct Flag;

impl Kind for Flag {
    type Out = bool;

    fn read(&self, item: &Item<'_>, faults: &mut Vec<Fault>) -> Option<bool> {
        let value = item.get_ref().as_bool();
        if value.is_none() {
            wrong_type(self, item, faults);
        }
        value
    }

    fn expected(&self) -> String {
        "true or false".to_owned()
    }

    fn schema(&self) -> Json {
        json!({ "type": "boolean" })
    }

    fn canonical(&self, value: &bool) -> Json {
        json!(value)
    }
}

/// Text of at least one and at most so many characters, none of them a control character.
pub(super) struct Text {
    pub(super) max_chars: usize,
}

impl Kind for Text {
    type Out = String;

    fn read(&self, item: &Item<'_>, faults: &mut Vec<Fault>) -> Option<String> {
        let Some(text) = item.get_ref().as_str() else {
            wrong_type(self, item, faults);
            return None;
        };
        let clause = if text.trim().is_empty() {
            "is empty".to_owned()
        } else if text.chars().any(char::is_control) {
            format!("holds a control character: {text:?}")
        } else if text.chars().count() > self.max_chars {
            format!("has {} characters, more than {}", text.chars().count(), self.max_chars)
        } else {
            return Some(text.to_owned());
        };
        faults.push(Fault { at: item.span(), clause });
        None
    }

    fn expected(&self) -> String {
        format!("a string of 1 to {} characters", self.max_chars)
    }

    fn schema(&self) -> Json {
        json!({ "type": "string", "minLength": 1, "maxLength": self.max_chars })
    }

    fn canonical(&self, value: &String) -> Json {
        json!(value)
    }
}

/// One of a few words.
pub(super) struct Choice<T: 'static>(pub(super) &'static [(&'static str, T)]);

impl<T: Copy + PartialEq> Choice<T> {
    fn words(&self) -> impl Iterator<Item = &'static str> {
        self.0.iter().map(|(word, _)| *word)
    }
}

impl<T: Copy + PartialEq> Kind for Choice<T> {
    type Out = T;

    fn read(&self, item: &Item<'_>, faults: &mut Vec<Fault>) -> Option<T> {
        let Some(text) = item.get_ref().as_str() else {
            wrong_type(self, item, faults);
            return None;
        };
        if let Some((_, value)) = self.0.iter().find(|(word, _)| *word == text) {
            return Some(*value);
        }
        let nearest =
            nearest(text, self.words()).map_or(String::new(), |word| format!(" (did you mean {word:?}?)"));
        faults.push(Fault {
            at: item.span(),
            clause: format!("is {text:?}, which is none of its values{nearest}"),
        });
        None
    }

    fn expected(&self) -> String {
        let words: Vec<String> = self.words().map(|word| format!("{word:?}")).collect();
        format!("one of {}", words.join(", "))
    }

    fn schema(&self) -> Json {
        json!({ "type": "string", "enum": self.words().collect::<Vec<_>>() })
    }

    fn canonical(&self, value: &T) -> Json {
        json!(self.0.iter().find(|(_, choice)| choice == value).map(|(word, _)| *word))
    }
}

/// A string with a syntax of its own.
pub(super) struct Parsed<T> {
    syntax: &'static str,
    out: std::marker::PhantomData<T>,
}

impl<T> Parsed<T> {
    /// `syntax` says what should have been written, as a noun phrase.
    pub(super) const fn new(syntax: &'static str) -> Self {
        Self { syntax, out: std::marker::PhantomData }
    }
}

impl<T: FromStr<Err: Display> + Display> Kind for Parsed<T> {
    type Out = T;

    fn read(&self, item: &Item<'_>, faults: &mut Vec<Fault>) -> Option<T> {
        let Some(text) = item.get_ref().as_str() else {
            wrong_type(self, item, faults);
            return None;
        };
        text.parse()
            .map_err(|error| faults.push(Fault { at: item.span(), clause: format!("is {text:?}: {error}") }))
            .ok()
    }

    fn expected(&self) -> String {
        self.syntax.to_owned()
    }

    fn schema(&self) -> Json {
        json!({ "type": "string" })
    }

    fn canonical(&self, value: &T) -> Json {
        json!(value.to_string())
    }
}

/// A fixed number of numbers, each with its name and range.
pub(super) struct Numbers<const N: usize>(pub(super) [(&'static str, Number); N]);

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

    fn expected(&self) -> String {
        let names: Vec<&str> = self.0.iter().map(|(name, _)| *name).collect();
        format!("{N} numbers [{}]", names.join(", "))
    }

    fn schema(&self) -> Json {
        let each: Vec<Json> = self.0.iter().map(|(_, kind)| kind.schema()).collect();
        json!({ "type": "array", "prefixItems": each, "items": false, "minItems": N, "maxItems": N })
    }

    fn canonical(&self, value: &[f64; N]) -> Json {
        value.iter().map(|number| json!(number + 0.0)).collect()
    }
}

/// A list of so many values of a kind.
pub(super) struct List<K> {
    pub(super) each: K,
    pub(super) at_least: usize,
    pub(super) at_most: usize,
}

impl<K: Kind> Kind for List<K> {
    type Out = Vec<K::Out>;

    fn read(&self, item: &Item<'_>, faults: &mut Vec<Fault>) -> Option<Vec<K::Out>> {
        let Some(items) = item.get_ref().as_array() else {
            wrong_type(self, item, faults);
            return None;
        };
        let values: Vec<Option<K::Out>> = items.iter().map(|item| self.each.read(item, faults)).collect();
        if !(self.at_least..=self.at_most).contains(&items.len()) {
            let clause =
                format!("has {} entries, outside {} to {}", items.len(), self.at_least, self.at_most);
            faults.push(Fault { at: item.span(), clause });
            return None;
        }
        values.into_iter().collect()
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

/// One value for both vehicles, or a table with one for each: `0.5` or `{ i = 0.5, j = 0.2 }`.
pub(super) struct Each<K>(pub(super) K);

impl<K: Kind<Out: Copy>> Kind for Each<K> {
    type Out = PerVehicle<K::Out>;

    fn read(&self, item: &Item<'_>, faults: &mut Vec<Fault>) -> Option<Self::Out> {
        let DeValue::Table(table) = item.get_ref() else {
            return self.0.read(item, faults).map(|both| PerVehicle { i: both, j: both });
        };
        for (key, _) in table.iter().filter(|(key, _)| !matches!(key.get_ref().as_ref(), "i" | "j")) {
            faults.push(Fault { at: key.span(), clause: format!("has the unknown key `{}`", key.get_ref()) });
        }
        let first = faults.len();
        let values = PerVehicle::from_fn(|role| {
            let key = if role == Role::I { "i" } else { "j" };
            let Some(item) = table.get(key) else {
                faults.push(Fault { at: item.span(), clause: format!("has no `{key}`") });
                return None;
            };
            let before = faults.len();
            let value = self.0.read(item, faults);
            for fault in &mut faults[before..] {
                fault.clause = format!("of {role} {}", fault.clause);
            }
            value
        });
        if faults.len() > first {
            return None;
        }
        Some(PerVehicle { i: values.i?, j: values.j? })
    }

    fn expected(&self) -> String {
        format!("{}, or one for each vehicle, {{ i = ..., j = ... }}", self.0.expected())
    }

    fn schema(&self) -> Json {
        let one = self.0.schema();
        json!({ "oneOf": [one, {
            "type": "object", "additionalProperties": false, "required": ["i", "j"],
            "properties": { "i": one, "j": one },
        }] })
    }

    fn canonical(&self, value: &Self::Out) -> Json {
        json!({ "i": self.0.canonical(&value.i), "j": self.0.canonical(&value.j) })
    }
}

/// The word most like `text`, if any is like it at all.
pub(super) fn nearest<'w>(text: &str, words: impl Iterator<Item = &'w str>) -> Option<&'w str> {
    let text = text.to_lowercase();
    words
        .map(|word| (strsim::jaro_winkler(&text, word), word))
        .filter(|(likeness, _)| *likeness > 0.75)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, word)| word)
}
