//! Reads, checks and describes settings in one pass: each setting is declared once, with its kind, default, unit,
//! range and sentence, and from that come its value, its errors, its schema and its share of the digest.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value as Json, json};
use toml::de::{DeTable, DeValue};

use super::diagnostic::Span;
use super::document::{Document, Source};
use super::kind::{Fault, Item, Kind, miscount, nearest};

/// Most `[[tables]]` of one name. Far above any mission, and low enough that checking each against each is quick.
const MOST_TABLES: usize = 1000;

/// One table of a file while it is read.
pub(crate) struct Section<'c, 'd> {
    document: &'c mut Document,
    table: Option<&'d DeTable<'d>>,
    path: String,
    /// Keys that were asked for.
    known: Vec<&'static str>,
    properties: Map<String, Json>,
    required: Vec<&'static str>,
    rules: Vec<Json>,
}

impl<'c, 'd> Section<'c, 'd> {
    pub(crate) fn root(document: &'c mut Document, table: Option<&'d DeTable<'d>>) -> Self {
        Self::at_path(document, table, String::new())
    }

    fn at_path(document: &'c mut Document, table: Option<&'d DeTable<'d>>, path: String) -> Self {
        Self {
            document,
            table,
            path,
            known: Vec::new(),
            properties: Map::new(),
            required: Vec::new(),
            rules: Vec::new(),
        }
    }

    /// Runs `f` on this table, refuses the keys it did not ask for, and gives what it made and the table's schema.
    pub(crate) fn describe<T>(mut self, f: impl FnOnce(&mut Self) -> T) -> (T, Json) {
        let value = f(&mut self);
        self.refuse_unknown();
        let mut schema =
            json!({ "type": "object", "additionalProperties": false, "properties": self.properties });
        if !self.required.is_empty() {
            schema["required"] = json!(self.required);
        }
        if !self.rules.is_empty() {
            schema["allOf"] = json!(self.rules);
        }
        (value, schema)
    }

    /// A setting with a default: what `value` holds, unless the file says otherwise. A draft's value is checked.
    pub(crate) fn set<K: Kind>(&mut self, key: &'static str, sentence: &str, kind: K, value: &mut K::Out) {
        let default = kind.canonical(value);
        self.check(key, &kind, value);
        if let Some(given) = self.value(key, &kind, Some(&default)) {
            *value = given;
        }
        self.record(key, &kind, Some(value));
        let mut schema = kind.schema();
        schema["default"] = default;
        self.property(key, sentence, schema);
    }

    /// The same, of a setting that is newer than missions that do without it: it is part of a digest only where it is not at
    /// its default, so that theirs stay what they were.
    pub(crate) fn set_newer<K: Kind>(
        &mut self,
        key: &'static str,
        sentence: &str,
        kind: K,
        default: &K::Out,
        value: &mut K::Out,
    ) {
        self.check(key, &kind, value);
        let by_default = kind.canonical(default);
        if let Some(given) = self.value(key, &kind, Some(&by_default)) {
            *value = given;
        }
        if kind.canonical(value) != by_default {
            self.record(key, &kind, Some(value));
        }
        let mut schema = kind.schema();
        schema["default"] = by_default;
        self.property(key, sentence, schema);
    }

    /// A setting that may be left unset.
    pub(crate) fn set_optional<K: Kind>(
        &mut self,
        key: &'static str,
        sentence: &str,
        kind: K,
        value: &mut Option<K::Out>,
    ) {
        if self.document.source == Source::Values {
            if let Some(value) = value {
                self.present(key);
                self.check(key, &kind, value);
            }
        } else {
            *value = self.value(key, &kind, None);
        }
        self.record(key, &kind, value.as_ref());
        self.property(key, sentence, kind.schema());
    }

    /// A setting that must be given. A draft holds one in any case.
    pub(crate) fn set_required<K: Kind<Out: Clone>>(
        &mut self,
        key: &'static str,
        sentence: &str,
        kind: K,
        value: &mut K::Out,
    ) {
        let expected = kind.expected();
        self.require(key, || format!("add `{key} = ...`: {expected}"));
        let mut given = (self.document.source == Source::Values).then(|| value.clone());
        self.set_optional(key, sentence, kind, &mut given);
        if let Some(given) = given {
            *value = given;
        }
    }

    /// A setting that may be left unset.
    #[cfg(feature = "desk")]
    pub(crate) fn optional<K: Kind>(&mut self, key: &'static str, sentence: &str, kind: K) -> Option<K::Out> {
        let mut value = None;
        self.set_optional(key, sentence, kind, &mut value);
        value
    }

    /// A setting that must be given.
    #[cfg(feature = "desk")]
    pub(crate) fn required<K: Kind>(&mut self, key: &'static str, sentence: &str, kind: K) -> Option<K::Out> {
        let expected = kind.expected();
        self.require(key, || format!("add `{key} = ...`: {expected}"));
        self.optional(key, sentence, kind)
    }

    /// A key that names a file: what is read from it is recorded as other settings are, by [`record_of_file`](Self::record_of_file), and
    /// the key itself is not.
    pub(crate) fn set_file<K: Kind>(&mut self, key: &'static str, sentence: &str, kind: K) -> Option<K::Out> {
        let value = self.value(key, &kind, None);
        self.property(key, sentence, kind.schema());
        value
    }

    /// Records a setting that was read from the file that the setting `file` names, by its whole path: errors about it point
    /// there. In its turn: a digest is over the settings in the order of their declarations.
    pub(crate) fn record_of_file<K: Kind>(&mut self, file: &str, path: &str, kind: &K, value: &K::Out) {
        let (span, path) = (self.document.at(file), self.path_of(path));
        self.document.place(&path, span.clone());
        if let Some(clause) = kind.fault(value) {
            self.refuse(&path, span, format!("`{path}` {clause}"), format!("give {}", kind.expected()));
        }
        self.document.settings.push((path, kind.canonical(value)));
    }

    /// A table whose settings all have defaults, unless `f` asks for more.
    pub(crate) fn table<T>(
        &mut self,
        key: &'static str,
        sentence: &str,
        f: impl FnOnce(&mut Section<'_, '_>) -> T,
    ) -> T {
        let table = self.subtable(key);
        let path = self.path_of(key);
        let (value, schema) = Section::at_path(self.document, table, path).describe(f);
        self.property(key, sentence, schema);
        value
    }

    /// A table that must be there, even if it is empty.
    pub(crate) fn required_table<T>(
        &mut self,
        key: &'static str,
        sentence: &str,
        f: impl FnOnce(&mut Section<'_, '_>) -> T,
    ) -> T {
        let path = self.path_of(key);
        self.require(key, || format!("add a [{path}] table"));
        self.table(key, sentence, f)
    }

    /// A table that means something by being there.
    pub(crate) fn set_optional_table<T: Default>(
        &mut self,
        key: &'static str,
        sentence: &str,
        value: &mut Option<T>,
        f: impl FnOnce(&mut Section<'_, '_>, &mut T),
    ) {
        let there = match self.document.source {
            Source::Values => value.is_some(),
            Source::Text | Source::Schema => self.ask(key).is_some(),
        };
        if there {
            self.present(key);
            self.table(key, sentence, |s| f(s, value.get_or_insert_default()));
        } else if self.document.source == Source::Schema {
            self.table(key, sentence, |s| f(s, &mut T::default()));
        }
    }

    /// `[[key]]` tables; a file's are made by `new`, which is given their index.
    pub(crate) fn set_tables<T>(
        &mut self,
        key: &'static str,
        sentence: &str,
        at_least: usize,
        values: &mut Vec<T>,
        new: impl Fn(usize) -> T,
        mut f: impl FnMut(&mut Section<'_, '_>, &mut T),
    ) {
        if self.document.source != Source::Values {
            *values = self.tables(key, sentence, at_least, |s, index| {
                let mut value = new(index);
                f(s, &mut value);
                value
            });
            return;
        }
        self.present(key);
        if let Some(clause) = miscount(values.len(), at_least, MOST_TABLES) {
            let path = self.path_of(key);
            let message = format!("the list of `{path}` {clause}");
            self.refuse(&path, 0..0, message, format!("give one of `{path}` for each"));
        }
        for (index, value) in values.iter_mut().enumerate() {
            let path = format!("{}[{index}]", self.path_of(key));
            self.document.place(&path, 0..0);
            Section::at_path(self.document, None, path).describe(|s| f(s, value));
        }
    }

    /// `[[key]]` tables, from `at_least` to [`MOST_TABLES`] of them; `f` is given each one's index.
    pub(crate) fn tables<T>(
        &mut self,
        key: &'static str,
        sentence: &str,
        at_least: usize,
        mut f: impl FnMut(&mut Section<'_, '_>, usize) -> T,
    ) -> Vec<T> {
        if self.document.source == Source::Schema {
            let (_, each) = Section::at_path(self.document, None, self.path_of(key)).describe(|s| f(s, 0));
            self.property(
                key,
                sentence,
                json!({ "type": "array", "items": each, "minItems": at_least, "maxItems": MOST_TABLES }),
            );
        }
        if at_least > 0 {
            self.required.push(key);
        }
        let Some(item) = self.ask(key) else {
            if at_least > 0 {
                let help = format!("add a [[{}]] table", self.path_of(key));
                self.missing(key, &help);
            }
            return Vec::new();
        };
        let tables = self.table_list(key, item, at_least).unwrap_or_default();
        let read = |(index, (path, table))| {
            Section::at_path(self.document, Some(table), path).describe(|s| f(s, index)).0
        };
        tables.into_iter().enumerate().map(read).collect()
    }

    /// The tables of a list with their paths, if it is a list of so many tables.
    fn table_list(
        &mut self,
        key: &str,
        list: &'d Item<'d>,
        at_least: usize,
    ) -> Option<Vec<(String, &'d DeTable<'d>)>> {
        let path = self.path_of(key);
        self.document.place(&path, list.span());
        let DeValue::Array(items) = list.get_ref() else {
            let message = format!("`{key}` must be a list of tables, found {}", article(list));
            self.refuse(&path, list.span(), message, format!("write [[{path}]], with double brackets"));
            return None;
        };
        if let Some(clause) = miscount(items.len(), at_least, MOST_TABLES) {
            let message = format!("the list of `{key}` {clause}");
            self.refuse(&path, list.span(), message, format!("write one [[{path}]] table for each"));
            return None;
        }
        let mut tables = Vec::with_capacity(items.len());
        for (index, item) in items.iter().enumerate() {
            let path = format!("{path}[{index}]");
            self.document.place(&path, item.span());
            if let DeValue::Table(table) = item.get_ref() {
                tables.push((path, table));
            } else {
                let message = format!("each `{key}` must be a table, found {}", article(item));
                self.refuse(
                    &path,
                    item.span(),
                    message,
                    format!("write [[{key}]] and its settings below it"),
                );
            }
        }
        (tables.len() == items.len()).then_some(tables)
    }

    /// Of these groups of keys at most one may be given, and exactly one if it is `needed`.
    pub(crate) fn alternatives(&mut self, groups: &[&[&'static str]], needed: bool) {
        let mut choices: Vec<Json> = groups.iter().map(|keys| json!({ "required": keys })).collect();
        if !needed {
            choices.push(json!({ "not": { "anyOf": choices.clone() } }));
        }
        self.rules.push(json!({ "oneOf": choices }));

        let given: Vec<&[&str]> =
            groups.iter().copied().filter(|keys| keys.iter().any(|key| self.given(key))).collect();
        let all: Vec<String> = groups.iter().map(|keys| quoted(keys)).collect();
        match given.as_slice() {
            [] if needed => {
                let path = self.path.clone();
                let span = self.document.at(&path);
                self.document.fail(&path);
                let message = format!("{} has neither {}", self.title(), all.join(" nor "));
                self.document.missing(span, message, format!("give {}", all.join(", or ")));
            }
            [] => {}
            [keys] => self.need_all(keys),
            [first, second, ..] => self.refuse_second(first, second),
        }
    }

    /// These two keys may not both be given.
    pub(crate) fn excludes(&mut self, second: &'static str, first: &'static str) {
        self.rules.push(json!({ "not": { "required": [first, second] } }));
        if self.given(first) && self.given(second) {
            self.refuse_second(&[first], &[second]);
        }
    }

    fn refuse_second(&mut self, first: &[&str], second: &[&str]) {
        let key = second.iter().copied().find(|key| self.given(key)).unwrap_or_default();
        let message = format!("{} is given together with {}", quoted(second), quoted(first));
        let span = self.document.at(&self.path_of(key));
        let path = self.path.clone();
        self.refuse(
            &path,
            span,
            message,
            format!("keep only one of {} and {}", quoted(first), quoted(second)),
        );
    }

    fn need_all(&mut self, keys: &[&str]) {
        let (there, absent): (Vec<&str>, Vec<&str>) = keys.iter().partition(|key| self.given(key));
        if let ([first, ..], [_, ..]) = (there.as_slice(), absent.as_slice()) {
            let span = self.document.at(&self.path_of(first));
            let path = self.path.clone();
            self.document.fail(&path);
            let message = format!("{} is given without {}", quoted(&there), quoted(&absent));
            self.document.missing(span, message, format!("{} belong together", quoted(keys)));
        }
    }

    /// Whether the file, or the draft, says something of `key`.
    pub(crate) fn given(&self, key: &str) -> bool {
        self.item(key).is_some()
            || (self.document.source == Source::Values && self.document.given(&self.path_of(key)))
    }

    /// Notes that a draft says something of `key`.
    pub(crate) fn present(&mut self, key: &str) {
        if self.document.source == Source::Values {
            let path = self.path_of(key);
            self.document.place(&path, 0..0);
        }
    }

    /// Where relative paths in the file begin: the file's own directory.
    pub(crate) fn directory(&self) -> PathBuf {
        Path::new(&self.document.file).parent().map(Path::to_path_buf).unwrap_or_default()
    }

    /// Whether nothing of this table has been refused so far.
    pub(crate) fn is_sound(&self) -> bool {
        self.document.sound(&[&self.path])
    }

    /// An error about something that this table lacks, at one of its keys or, without one, at the table.
    pub(crate) fn lacks(&mut self, key: &str, message: &str, help: &str) {
        let path = if key.is_empty() { self.path.clone() } else { self.path_of(key) };
        let span = self.document.at(&path);
        self.document.missing(span, message.to_owned(), help.to_owned());
    }

    /// Notes that a file must have `key`, and refuses one that has not.
    fn require(&mut self, key: &'static str, help: impl FnOnce() -> String) {
        self.required.push(key);
        if self.item(key).is_none() && self.document.source != Source::Values {
            self.missing(key, &help());
        }
    }

    /// Checks a draft's value.
    fn check<K: Kind>(&mut self, key: &str, kind: &K, value: &K::Out) {
        if self.document.source != Source::Values {
            return;
        }
        if let Some(clause) = kind.fault(value) {
            let path = self.path_of(key);
            self.refuse(&path, 0..0, format!("`{path}` {clause}"), format!("give {}", kind.expected()));
        }
    }

    /// Notes that `key` exists, and gives what the file says of it.
    fn ask(&mut self, key: &'static str) -> Option<&'d Item<'d>> {
        if !self.known.contains(&key) {
            self.known.push(key);
        }
        self.item(key)
    }

    fn item(&self, key: &str) -> Option<&'d Item<'d>> {
        self.table.and_then(|table| table.get(key))
    }

    fn path_of(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) }
    }

    fn title(&self) -> String {
        match self.path.strip_suffix(']').and_then(|path| path.rsplit_once('[')) {
            Some((list, index)) => {
                format!("[[{list}]] number {}", index.parse().map_or(1, |index: usize| index + 1))
            }
            None if self.path.is_empty() => "the file".to_owned(),
            None => format!("[{}]", self.path),
        }
    }

    fn value<K: Kind>(&mut self, key: &'static str, kind: &K, default: Option<&Json>) -> Option<K::Out> {
        let item = self.ask(key)?;
        let path = self.path_of(key);
        self.document.place(&path, item.span());
        let mut faults = Vec::new();
        let value = kind.read(item, &mut faults);
        for Fault { at, clause } in faults {
            let default =
                default.map_or(String::new(), |value| format!("; the default is {}", as_toml(value)));
            self.refuse(&path, at, format!("`{key}` {clause}"), format!("give {}{default}", kind.expected()));
        }
        value
    }

    fn record<K: Kind>(&mut self, key: &str, kind: &K, value: Option<&K::Out>) {
        if let Some(value) = value {
            self.document.settings.push((self.path_of(key), kind.canonical(value)));
        }
    }

    fn property(&mut self, key: &str, sentence: &str, mut schema: Json) {
        schema["description"] = json!(sentence);
        self.properties.insert(key.to_owned(), schema);
    }

    fn refuse(&mut self, path: &str, span: Span, message: String, help: String) {
        self.document.fail(path);
        self.document.error(span, message, help);
    }

    fn missing(&mut self, key: &str, help: &str) {
        let path = self.path_of(key);
        let span = self.document.at(&self.path);
        self.document.fail(&path);
        self.document.missing(span, format!("{} has no `{key}`", self.title()), help.to_owned());
    }

    fn subtable(&mut self, key: &'static str) -> Option<&'d DeTable<'d>> {
        let item = self.ask(key)?;
        let path = self.path_of(key);
        self.document.place(&path, item.span());
        let table = item.get_ref().as_table();
        if table.is_none() {
            let message = format!("`{key}` must be one table, found {}", article(item));
            self.refuse(&path, item.span(), message, format!("write [{path}], with single brackets, once"));
        }
        table
    }

    fn refuse_unknown(&mut self) {
        let Some(table) = self.table else { return };
        let known = || self.known.iter().copied();
        let mut unknown = Vec::new();
        for (key, _) in table.iter().filter(|(key, _)| !self.known.contains(&key.get_ref().as_ref())) {
            let meant = nearest(key.get_ref(), known())
                .map_or_else(String::new, |word| format!("did you mean `{word}`? "));
            let help = format!("{meant}its keys are {}", known().collect::<Vec<_>>().join(", "));
            unknown.push((key.span(), format!("unknown key `{}` in {}", key.get_ref(), self.title()), help));
        }
        for (span, message, help) in unknown {
            self.document.error(span, message, help);
        }
    }
}

fn article(item: &Item<'_>) -> String {
    match item.get_ref().type_str() {
        kind @ ("integer" | "array") => format!("an {kind}"),
        kind => format!("a {kind}"),
    }
}

fn quoted(keys: &[&str]) -> String {
    keys.iter().map(|key| format!("`{key}`")).collect::<Vec<_>>().join(", ")
}

/// A value as it would be written in the file.
fn as_toml(value: &Json) -> String {
    if let Some(number) = value.as_f64().filter(|number| *number != 0.0 && number.abs() < 1e-4) {
        return format!("{number:e}");
    }
    toml::Value::try_from(value).map_or_else(|_| value.to_string(), |value| value.to_string())
}
