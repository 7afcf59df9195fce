//! Kinds of one value.

use std::fmt::Display;
use std::str::FromStr;

use serde_json::{Value as Json, json};
use toml::de::DeValue;
use toml::value::Offset;

use super::value::{Fault, Item, Kind, nearest, wrong_type};
use crate::time::Utc;
use crate::units::{Dbm, Watts};

/// A finite number in a unit and a range.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Number {
    unit: &'static str,
    min: f64,
    max: f64,
    above: bool,
}

impl Number {
    /// At least `min`, at most `max`. The empty unit is a plain number.
    pub(crate) const fn within(unit: &'static str, min: f64, max: f64) -> Self {
        Self { unit, min, max, above: false }
    }

    /// More than zero, at most `max`.
    pub(crate) const fn positive(unit: &'static str, max: f64) -> Self {
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
            // Negative powers are written in dBm, and by hand often enough where W are asked for.
            let dbm = if self.unit == "W" && value < 0.0 {
                format!(" ({value} dBm would be {:.3e} W)", Watts::from(Dbm(value)).0)
            } else {
                String::new()
            };
            Some(format!("is {value_text}, below the minimum of {}{dbm}", self.quantity(self.min)))
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
        match self.fault(&value) {
            Some(clause) => faults.push(Fault { at: item.span(), clause }),
            None => return Some(value),
        }
        None
    }

    fn fault(&self, value: &f64) -> Option<String> {
        self.out_of_range(*value)
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
pub(crate) struct Integer {
    pub(crate) min: u64,
    pub(crate) max: u64,
}

/// A MAVLink system or component.
pub(crate) const ID: Integer = Integer { min: 1, max: 255 };

/// What was read as an [`Integer`] up to 255.
pub(crate) fn byte(value: u64) -> u8 {
    u8::try_from(value).unwrap_or(u8::MAX)
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

    fn fault(&self, value: &u64) -> Option<String> {
        let within = (self.min..=self.max).contains(value);
        (!within).then(|| format!("is {value}, outside {} to {}", self.min, self.max))
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
pub(crate) struct Flag;

impl Kind for Flag {
    type Out = bool;

    fn read(&self, item: &Item<'_>, faults: &mut Vec<Fault>) -> Option<bool> {
        let value = item.get_ref().as_bool();
        if value.is_none() {
            wrong_type(self, item, faults);
        }
        value
    }

    fn fault(&self, _: &Self::Out) -> Option<String> {
        None
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
pub(crate) struct Text {
    pub(crate) max_chars: usize,
}

impl Kind for Text {
    type Out = String;

    fn read(&self, item: &Item<'_>, faults: &mut Vec<Fault>) -> Option<String> {
        let Some(text) = item.get_ref().as_str() else {
            wrong_type(self, item, faults);
            return None;
        };
        let text = text.to_owned();
        match self.fault(&text) {
            Some(clause) => faults.push(Fault { at: item.span(), clause }),
            None => return Some(text),
        }
        None
    }

    fn fault(&self, text: &String) -> Option<String> {
        if text.trim().is_empty() {
            Some("is empty".to_owned())
        } else if text.chars().any(char::is_control) {
            Some(format!("holds a control character: {text:?}"))
        } else if text.chars().count() > self.max_chars {
            Some(format!("has {} characters, more than {}", text.chars().count(), self.max_chars))
        } else {
            None
        }
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
pub(crate) struct Choice<T: 'static>(pub(crate) &'static [(&'static str, T)]);

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

    fn fault(&self, value: &T) -> Option<String> {
        let known = self.0.iter().any(|(_, choice)| choice == value);
        (!known).then(|| "is none of its values".to_owned())
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
pub(crate) struct Parsed<T> {
    syntax: &'static str,
    out: std::marker::PhantomData<T>,
}

impl<T> Parsed<T> {
    /// `syntax` says what should have been written, as a noun phrase.
    pub(crate) const fn new(syntax: &'static str) -> Self {
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

    fn fault(&self, value: &T) -> Option<String> {
        let text = value.to_string();
        text.parse::<T>().err().map(|error| format!("is {text:?}: {error}"))
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

/// A point in time, by a date and time with an offset, as TOML has them.
pub(crate) struct Moment;

impl Kind for Moment {
    type Out = Utc;

    fn read(&self, item: &Item<'_>, faults: &mut Vec<Fault>) -> Option<Utc> {
        // In quotes it is text to TOML, and means the same.
        let quoted = item.get_ref().as_str().and_then(|text| text.parse().ok());
        let datetime = match item.get_ref() {
            DeValue::Datetime(datetime) => Some(*datetime),
            _ => quoted,
        };
        let Some(datetime) = datetime else {
            wrong_type(self, item, faults);
            return None;
        };
        let (Some(date), Some(time), Some(offset)) = (datetime.date, datetime.time, datetime.offset) else {
            let clause =
                format!("is {datetime}, which leaves the date, the time or the offset from UTC open");
            faults.push(Fault { at: item.span(), clause });
            return None;
        };
        let offset_min = match offset {
            Offset::Z => 0,
            Offset::Custom { minutes } => minutes,
        };
        let clock = (time.hour, time.minute, time.second.unwrap_or(0));
        let micros = time.nanosecond.unwrap_or(0) / 1000;
        let moment = Utc::from_civil((date.year, date.month, date.day), clock, micros, offset_min);
        if moment.is_none() {
            faults.push(Fault { at: item.span(), clause: format!("is {datetime}, which is before 1970") });
        }
        moment
    }

    fn fault(&self, _: &Self::Out) -> Option<String> {
        None
    }

    fn expected(&self) -> String {
        "a date and time with its offset, such as 2026-11-21T18:00:00Z".to_owned()
    }

    fn schema(&self) -> Json {
        json!({ "type": "string", "format": "date-time" })
    }

    fn canonical(&self, value: &Utc) -> Json {
        json!(value.to_string())
    }
}
