//! A file's text, what was read from where, and the findings about it.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use serde_json::Value as Json;
use toml::de::DeTable;

use super::diagnostic::{Diagnostics, Severity, Span};
use super::reader::Section;

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
    /// The same file is read without a document, to collect the schema.
    pub(crate) describing: bool,
    findings: Vec<Finding>,
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
    fn new(file: &str, text: Arc<str>, describing: bool) -> Self {
        Self {
            file: file.to_owned(),
            text,
            spans: BTreeMap::new(),
            failed: BTreeSet::new(),
            settings: Vec::new(),
            describing,
            findings: Vec::new(),
        }
    }

    /// Reads `text` by `describe`, then checks what it gave by `check`.
    pub(crate) fn read<T>(
        file: &str,
        text: &str,
        describe: impl FnOnce(&mut Section<'_, '_>) -> T,
        check: impl FnOnce(&T, &mut Self),
    ) -> (T, Self, Diagnostics) {
        let text: Arc<str> = text.into();
        let (root, syntax_errors) = DeTable::parse_recoverable(&text);
        let mut document = Self::new(file, Arc::clone(&text), false);
        let (value, _) = Section::root(&mut document, Some(root.get_ref())).describe(describe);
        check(&value, &mut document);

        let mut all = Diagnostics::new(file, Arc::clone(&text));
        let syntax: Vec<Finding> = syntax_errors.iter().map(|error| syntax_finding(error, &text)).collect();
        let bad_lines: BTreeSet<usize> =
            syntax.iter().map(|finding| all.line_of(finding.span.start)).collect();
        let mut findings = std::mem::take(&mut document.findings);
        // What recovery put in the place of a broken value, or lost, says nothing about the file.
        findings.retain(|found| {
            bad_lines.is_empty() || !(found.absence || bad_lines.contains(&all.line_of(found.span.start)))
        });
        findings.extend(syntax);
        findings.sort_by_key(|finding| finding.span.start);
        for Finding { severity, span, message, help, .. } in findings {
            all.push(severity, span, message, help);
        }
        (value, document, all)
    }

    /// The JSON Schema of what `describe` reads.
    pub(crate) fn schema<T>(describe: impl FnOnce(&mut Section<'_, '_>) -> T) -> Json {
        let mut document = Self::new("", "".into(), true);
        Section::root(&mut document, None).describe(describe).1
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
