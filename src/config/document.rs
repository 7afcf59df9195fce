//! A file's text, what was read from where, and the findings about it.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Read;
use std::path::Path;
use std::sync::Arc;

use serde_json::Value as Json;
use toml::de::DeTable;

use super::diagnostic::{Diagnostics, Severity, Span, line_and_column};
use super::reader::Section;

/// Largest file that is read, in bytes.
const MAX_BYTES: u64 = 1 << 20;

/// The text of a file.
///
/// # Errors
/// It is missing, not a file, unreadable, too large, or not UTF-8.
pub(super) fn read_text(path: &Path) -> Result<String, Diagnostics> {
    let name = path.display().to_string();
    let unusable = |message: String, help: &str| Err(Diagnostics::of_file(&name, message, help));
    let mut bytes = Vec::new();
    let read = std::fs::File::open(path).and_then(|file| {
        if file.metadata()?.is_dir() {
            return Err(std::io::ErrorKind::IsADirectory.into());
        }
        file.take(MAX_BYTES + 1).read_to_end(&mut bytes)
    });
    match read {
        Err(error) => {
            let (what, help) = match error.kind() {
                std::io::ErrorKind::NotFound => {
                    ("there is no such file", "check the path; examples are in config/")
                }
                std::io::ErrorKind::IsADirectory => {
                    ("this is a directory", "give the path of a file inside it")
                }
                std::io::ErrorKind::PermissionDenied => {
                    ("permission to read it is denied", "check its mode and owner")
                }
                _ => return unusable(format!("cannot be read: {error}"), "give the path of a readable file"),
            };
            unusable(format!("cannot be read: {what}"), help)
        }
        Ok(_) if bytes.len() as u64 > MAX_BYTES => unusable(
            format!("is larger than {MAX_BYTES} bytes"),
            "give a TOML file; missions are a few kilobytes",
        ),
        Ok(_) => String::from_utf8(bytes).map_err(|error| not_text(&name, &error)),
    }
}

fn not_text(name: &str, error: &std::string::FromUtf8Error) -> Diagnostics {
    let offset = error.utf8_error().valid_up_to();
    let byte = error.as_bytes().get(offset).copied().unwrap_or_default();
    let valid = String::from_utf8_lossy(&error.as_bytes()[..offset]).into_owned();
    let mut all = Diagnostics::new(name, valid.into());
    let message = format!("is not UTF-8 text: byte {byte:#04x} at offset {offset}");
    all.push(
        Severity::Error,
        offset..offset,
        message,
        "save the file as UTF-8, or give a TOML file".to_owned(),
    );
    all
}

/// A file that has been read: kept for what is said about it later, and for its digest.
#[derive(Debug, Clone)]
pub(super) struct Document {
    pub(super) file: String,
    pub(super) text: Arc<str>,
    /// Where each setting was read, by path (`tdma.slot_s`, `user[0].enu_m`); absent ones are absent here.
    spans: BTreeMap<String, Span>,
    /// Settings that were given but could not be used, and tables that hold one.
    failed: BTreeSet<String>,
    /// Every setting that holds a value, defaults included, with its canonical form, in reading order.
    pub(super) settings: Vec<(String, Json)>,
    /// The same file is read without a document, to collect the schema.
    pub(super) describing: bool,
    findings: Vec<(Severity, Span, String, String)>,
    /// Findings about what is missing, which a syntax error elsewhere may have caused.
    missing: Vec<(Span, String, String)>,
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
            missing: Vec::new(),
        }
    }

    /// Reads `text` by `describe`, then checks what it gave by `check`.
    pub(super) fn read<T>(
        file: &str,
        text: &str,
        describe: impl FnOnce(&mut Section<'_, '_>) -> T,
        check: impl FnOnce(&T, &mut Self),
    ) -> (T, Self, Diagnostics) {
        // A byte order mark is the editor's, not the operator's.
        let text: Arc<str> = text.strip_prefix('\u{feff}').unwrap_or(text).into();
        let (root, syntax_errors) = DeTable::parse_recoverable(&text);
        let mut document = Self::new(file, Arc::clone(&text), false);
        let (value, _) = Section::root(&mut document, Some(root.get_ref())).describe(describe);
        check(&value, &mut document);

        let mut all = Diagnostics::new(file, Arc::clone(&text));
        let mut bad_lines = BTreeSet::new();
        for error in &syntax_errors {
            let span = error.span().unwrap_or_default();
            bad_lines.insert(line_and_column(&text, span.start).0);
            all.push(
                Severity::Error,
                span,
                error.message().to_owned(),
                syntax_help(error.message()).to_owned(),
            );
        }
        for (severity, span, message, help) in document.findings.drain(..) {
            // What recovery put in the place of a broken value says nothing about the file.
            if !bad_lines.contains(&line_and_column(&text, span.start).0) {
                all.push(severity, span, message, help);
            }
        }
        for (span, message, help) in document.missing.drain(..).filter(|_| bad_lines.is_empty()) {
            all.push(Severity::Error, span, message, help);
        }
        all.sort();
        (value, document, all)
    }

    /// The JSON Schema of what `describe` reads.
    pub(super) fn schema<T>(describe: impl FnOnce(&mut Section<'_, '_>) -> T) -> Json {
        let mut document = Self::new("", "".into(), true);
        Section::root(&mut document, None).describe(describe).1
    }

    pub(super) fn place(&mut self, path: &str, span: Span) {
        self.spans.insert(path.to_owned(), span);
    }

    /// Marks a setting and the tables around it as unusable.
    pub(super) fn fail(&mut self, path: &str) {
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
    pub(super) fn sound(&self, paths: &[&str]) -> bool {
        paths.iter().all(|path| !self.failed.contains(*path))
    }

    /// Whether the file says something about this setting.
    pub(super) fn given(&self, path: &str) -> bool {
        self.spans.contains_key(path)
    }

    /// Where a setting is, or the nearest table around it, or the start of the file.
    pub(super) fn at(&self, path: &str) -> Span {
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

    pub(super) fn error(&mut self, span: Span, message: String, help: String) {
        self.findings.push((Severity::Error, span, message, help));
    }

    pub(super) fn warning(&mut self, span: Span, message: String, help: String) {
        self.findings.push((Severity::Warning, span, message, help));
    }

    pub(super) fn missing(&mut self, span: Span, message: String, help: String) {
        self.missing.push((span, message, help));
    }
}

fn syntax_help(message: &str) -> &'static str {
    if message.contains("duplicate key") {
        "each key and [table] may be given once; write [[name]] for one of several"
    } else if message.contains("string values must be quoted") {
        "put text in double quotes, and give a value after `=`"
    } else if message.contains("table") {
        "a table starts with [name] on a line of its own, one of several with [[name]]"
    } else {
        "the file is TOML (https://toml.io): `key = value` lines under [table] headings"
    }
}
