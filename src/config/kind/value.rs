//! What a kind of value can do, and what kinds have in common.

use serde_json::Value as Json;
use toml::Spanned;
use toml::de::DeValue;

use crate::config::diagnostic::Span;

/// What is wrong with a value, and which part of it: a clause that continues the setting's name.
pub(crate) struct Fault {
    pub(crate) at: Span,
    pub(crate) clause: String,
}

/// A value with its place in the text.
pub(crate) type Item<'d> = Spanned<DeValue<'d>>;

/// One kind of value.
pub(crate) trait Kind {
    /// What it is read into.
    type Out;

    /// The value, or `None` after pushing at least one fault.
    fn read(&self, item: &Item<'_>, faults: &mut Vec<Fault>) -> Option<Self::Out>;

    /// What is wrong with a value that was made and not read: a clause that continues the setting's name.
    fn fault(&self, value: &Self::Out) -> Option<String>;

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

pub(super) fn wrong_type(kind: &impl Kind, item: &Item<'_>, faults: &mut Vec<Fault>) {
    faults.push(Fault {
        at: item.span(),
        clause: format!("must be {}, found {}", kind.expected(), found(item)),
    });
}

/// How much alike two words count of which one is a part of the other, `power_w` of `max_power_w`.
const PART_OF_THE_OTHER: f64 = 0.8;

/// The word most like `text`, if any is like it at all: alike from the start, or one holding the other.
pub(crate) fn nearest<'w>(text: &str, words: impl Iterator<Item = &'w str>) -> Option<&'w str> {
    let text = text.to_lowercase();
    words
        .map(|word| {
            let holds = text.len() > 2 && (word.contains(&text) || text.contains(word));
            let floor = if holds { PART_OF_THE_OTHER } else { 0.0 };
            (strsim::jaro_winkler(&text, word).max(floor), word)
        })
        .filter(|(likeness, _)| *likeness > 0.75)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, word)| word)
}

/// What is wrong with the length of a list, as a clause that continues its name.
pub(crate) fn miscount(entries: usize, at_least: usize, at_most: usize) -> Option<String> {
    if entries < at_least {
        Some(format!("has {entries} entries, fewer than the {at_least} it needs"))
    } else if entries > at_most {
        Some(format!("has {entries} entries, more than the {at_most} it may have"))
    } else {
        None
    }
}
