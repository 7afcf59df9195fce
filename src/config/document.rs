//! A file's text, what was read from where, and the findings about it.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use serde_json::Value as Json;

use super::diagnostic::{Diagnostics, Severity, Span};

/// A file that has been read: kept for what is said about it later, and for its digest.
#[derive(Debug, Clone)]
pub(crate) struct Document {
    pub(crate) file: String,
    pub(crate) text: Arc<str>,
    /// Where each setting was read, by path (`tdma.slot_s`, `user[0].enu_m`); absent ones are absent here.
    spans: BTreeMap<String, Span>,
    /// Settings that were given but could not be used, and tables that hold one.
    failed: BTreeSet<String>,
    /// Every setting that holds a value, defaults included, with its canonical form, in reading order.
    pub(crate) settings: Vec<(String, Json)>,
    pub(crate) source: Source,
    findings: Vec<Finding>,
}

/// Where settings come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Source {
    /// From the text of a file.
    Text,
    /// From values that somebody filled in. There is no text, and all places are its start.
    Values,
    /// From nowhere: the declarations are walked through to collect the schema.
    Schema,
}

/// Something found before it is known to be worth telling.
#[derive(Debug, Clone)]
struct Finding {
    severity: Severity,
    span: Span,
    message: String,
    help: String,
    /// It is about what is missing, which a syntax error elsewhere may have caused.
    absence: bool,
}

impl Document {
    pub(crate) fn new(file: &str, text: Arc<str>, source: Source) -> Self {
        Self {
            file: file.to_owned(),
            text,
            spans: BTreeMap::new(),
            failed: BTreeSet::new(),
            settings: Vec::new(),
            source,
            findings: Vec::new(),
        }
    }

    /// Puts the findings, in the order of the text, with what its syntax is wrong about.
    pub(crate) fn finish(&mut self, syntax_errors: &[toml::de::Error]) -> Diagnostics {
        let mut all = Diagnostics::new(&self.file, Arc::clone(&self.text));
        let syntax: Vec<Finding> =
            syntax_errors.iter().map(|error| syntax_finding(error, &self.text)).collect();
        let bad_lines: BTreeSet<usize> =
            syntax.iter().map(|finding| all.line_of(finding.span.start)).collect();
        let mut findings = std::mem::take(&mut self.findings);
        // What recovery put in the place of a broken value, or lost, says nothing about the file.
        findings.retain(|found| {
            bad_lines.is_empty() || !(found.absence || bad_lines.contains(&all.line_of(found.span.start)))
        });
        findings.extend(syntax);
        findings.sort_by_key(|finding| finding.span.start);
        for Finding { severity, span, message, help, .. } in findings {
            all.push(severity, span, message, help);
        }
        all
    }

    /// The settings as the text of a file that says the same.
    pub(crate) fn to_toml(&self) -> String {
        let mut root = toml::Table::new();
        // A default that something else stands in for would be given together with it.
        let stands = |path: &str| self.settings.iter().any(|(key, _)| key == path);
        let in_place = |path: &str| match path {
            "airspace.area_enu_m" => stands("airspace.area_lat_lon"),
            "radio.reference_gain" => stands("radio.carrier_hz"),
            _ => false,
        };
        for (path, value) in self.settings.iter().filter(|(path, _)| !in_place(path)) {
            if let Ok(value) = toml::Value::try_from(value) {
                insert(&mut root, path, value);
            }
        }
        root.to_string()
    }

    pub(crate) fn place(&mut self, path: &str, span: Span) {
        self.spans.insert(path.to_owned(), span);
    }

    /// Marks a setting and the tables around it as unusable.
    pub(crate) fn fail(&mut self, path: &str) {
        let mut path = path;
        loop {
            self.failed.insert(path.to_owned());
            match path.rfind(['.', '[']) {
                Some(cut) => path = &path[..cut],
                None => return,
            }
        }
    }

    /// Whether all of these were read without an error (or are defaults), so that they can be compared.
    pub(crate) fn sound(&self, paths: &[&str]) -> bool {
        paths.iter().all(|path| !self.failed.contains(*path))
    }

    /// Whether the file says something about this setting.
    pub(crate) fn given(&self, path: &str) -> bool {
        self.spans.contains_key(path)
    }

    /// Where a setting is, or the nearest table around it, or the start of the file.
    pub(crate) fn at(&self, path: &str) -> Span {
        let mut path = path;
        loop {
            if let Some(span) = self.spans.get(path) {
                return span.clone();
            }
            match path.rfind(['.', '[']) {
                Some(cut) => path = &path[..cut],
                None => return 0..0,
            }
        }
    }

    pub(crate) fn error(&mut self, span: Span, message: String, help: String) {
        self.findings.push(Finding { severity: Severity::Error, span, message, help, absence: false });
    }

    /// Whether an error was found so far; what the text's syntax is wrong about comes later.
    pub(crate) fn has_errors(&self) -> bool {
        self.findings.iter().any(|finding| finding.severity == Severity::Error)
    }

    pub(crate) fn warning(&mut self, span: Span, message: String, help: String) {
        self.findings.push(Finding { severity: Severity::Warning, span, message, help, absence: false });
    }

    /// An error about something that is not there.
    pub(crate) fn missing(&mut self, span: Span, message: String, help: String) {
        self.findings.push(Finding { severity: Severity::Error, span, message, help, absence: true });
    }
}

fn syntax_finding(error: &toml::de::Error, text: &str) -> Finding {
    let span = error.span().unwrap_or_default();
    let rest = text.get(span.start..).and_then(|rest| rest.lines().next()).unwrap_or("").trim();
    let unquoted = error.message().starts_with("string values must be quoted");
    let (message, help) = match error.message() {
        _ if unquoted && (rest.is_empty() || rest.starts_with('#')) => {
            ("there is no value after `=`", "give a value, or remove the line to use the default")
        }
        _ if unquoted && rest.starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c)) => {
            ("this is no number", "write one number; in a list, a comma between two")
        }
        _ if unquoted => ("this is no value; text must be in quotes", "put text in double quotes"),
        "duplicate key" => {
            ("this is here twice", "give each key and [table] once; write [[name]] for one of several tables")
        }
        message if message.contains("string") => (message, "close the text with a quote, on the same line"),
        message if message.contains("table") => {
            (message, "a table starts with [name] on a line of its own, one of several with [[name]]")
        }
        message => {
            (message, "the file is TOML (https://toml.io): `key = value` lines under [table] headings")
        }
    };
    let message = match text.get(span.clone()) {
        Some(key) if error.message() == "duplicate key" => format!("duplicate key `{key}`: {message}"),
        _ => message.trim_end_matches(", expected nothing").to_owned(),
    };
    let help = help.to_owned();
    Finding { severity: Severity::Error, span, message, help, absence: false }
}

/// Puts a value where a path such as `tdma.slot_s` or `user[0].name` leads.
fn insert(table: &mut toml::Table, path: &str, value: toml::Value) {
    let Some((head, rest)) = path.split_once('.') else {
        table.insert(path.to_owned(), value);
        return;
    };
    let empty = || toml::Value::Table(toml::Table::new());
    let inner = match head.split_once('[') {
        None => Some(table.entry(head).or_insert_with(empty)),
        Some((name, _)) => {
            let list = table.entry(name).or_insert_with(|| toml::Value::Array(Vec::new()));
            let index = head[name.len()..].trim_matches(['[', ']']).parse().unwrap_or(0_usize);
            list.as_array_mut().and_then(|list| {
                list.resize_with(list.len().max(index + 1), empty);
                list.get_mut(index)
            })
        }
    };
    if let Some(inner) = inner.and_then(toml::Value::as_table_mut) {
        insert(inner, rest, value);
    }
}
