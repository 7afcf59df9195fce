//! A whole file, or a whole draft, through its declarations.

use serde_json::Value as Json;
use toml::de::DeTable;

use super::diagnostic::Diagnostics;
use super::document::{Document, Source};
use super::reader::Section;

/// Reads `text` by `describe`, then checks what it gave by `check`.
pub(crate) fn text<T>(
    file: &str,
    text: &str,
    describe: impl FnOnce(&mut Section<'_, '_>) -> T,
    check: impl FnOnce(&T, &mut Document),
) -> (T, Document, Diagnostics) {
    let mut document = Document::new(file, text.into(), Source::Text);
    let (root, syntax_errors) = DeTable::parse_recoverable(text);
    let (value, _) = Section::root(&mut document, Some(root.get_ref())).describe(describe);
    check(&value, &mut document);
    let findings = document.finish(&syntax_errors);
    (value, document, findings)
}

/// Takes values that somebody filled in through the same declarations and the same `check`. `name` stands for the file's
/// in messages.
pub(crate) fn values<T>(
    name: &str,
    mut values: T,
    describe: impl FnOnce(&mut Section<'_, '_>, &mut T),
    check: impl FnOnce(&T, &mut Document),
) -> (T, Document, Diagnostics) {
    let mut document = Document::new(name, "".into(), Source::Values);
    Section::root(&mut document, None).describe(|s| describe(s, &mut values));
    check(&values, &mut document);
    let findings = document.finish(&[]);
    (values, document, findings)
}

/// The JSON Schema of what `describe` reads.
pub(crate) fn schema<T>(describe: impl FnOnce(&mut Section<'_, '_>) -> T) -> Json {
    let mut document = Document::new("", "".into(), Source::Schema);
    Section::root(&mut document, None).describe(describe).1
}
