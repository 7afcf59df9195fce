//! The kind of setting that may be a range.

use serde_json::{Value as Json, json};

use crate::config::kind::{Fault, Item, Kind, Number, Numbers};

/// A number, or the lowest and the highest of a range that numbers are drawn from: `2.0` or `[0.5, 5.0]`.
pub(super) struct Extent(pub Number);

impl Kind for Extent {
    type Out = [f64; 2];

    fn read(&self, item: &Item<'_>, faults: &mut Vec<Fault>) -> Option<[f64; 2]> {
        if item.get_ref().as_array().is_none() {
            return self.0.read(item, faults).map(|number| [number; 2]);
        }
        let ends = Numbers([("lowest", self.0), ("highest", self.0)]);
        let ends = ends.read(item, faults)?;
        match inverted(ends) {
            Some(clause) => faults.push(Fault { at: item.span(), clause }),
            None => return Some(ends),
        }
        None
    }

    fn fault(&self, ends: &[f64; 2]) -> Option<String> {
        ends.iter().find_map(|end| self.0.fault(end)).or_else(|| inverted(*ends))
    }

    fn expected(&self) -> String {
        format!("{}, or a range of them, [lowest, highest]", self.0.expected())
    }

    fn schema(&self) -> Json {
        let one = self.0.schema();
        json!({ "oneOf": [one, { "type": "array", "items": one, "minItems": 2, "maxItems": 2 }] })
    }

    fn canonical(&self, [low, high]: &[f64; 2]) -> Json {
        json!([low + 0.0, high + 0.0])
    }
}

fn inverted([low, high]: [f64; 2]) -> Option<String> {
    (low > high).then(|| format!("is inverted: the lowest, {low}, is above the highest, {high}"))
}
