//! What is wrong with a file: where, what, and the remedy.

use std::fmt;
use std::ops::Range;
use std::sync::Arc;

/// Bytes of a file's text.
pub(crate) type Span = Range<usize>;

/// Findings kept before the rest is only counted: garbage can hold half a million.
const KEPT: usize = 1000;
/// Longest piece of an offending line that is shown, in characters.
const SHOWN_CHARS: usize = 120;

/// Whether a finding makes the file unusable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Severity {
    /// The file cannot be used.
    Error,
    /// The file can be used; the operator should know.
    Warning,
}

/// One finding.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Diagnostic {
    /// Error or warning.
    pub severity: Severity,
    /// Line, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
    /// What is wrong, with the value and the limit.
    pub message: String,
    /// The remedy.
    pub help: String,
    span: Span,
}

/// All findings in one file, in the order of the text. Printed as `file:line:column: message`, the offending line
/// with a caret below it, and the remedy.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Diagnostics {
    file: String,
    text: Arc<str>,
    lines: Lines,
    list: Vec<Diagnostic>,
    errors: usize,
    omitted: usize,
}

impl std::error::Error for Diagnostics {}

impl Diagnostics {
    pub(super) fn new(file: &str, text: Arc<str>) -> Self {
        let lines = Lines::of(&text);
        Self { file: file.to_owned(), text, lines, list: Vec::new(), errors: 0, omitted: 0 }
    }

    /// An error about the file as a whole, such as one that cannot be read. Placed at line 1, column 1.
    pub(super) fn of_file(file: &str, message: String, help: &str) -> Self {
        let mut all = Self::new(file, "".into());
        all.push(Severity::Error, 0..0, message, help.to_owned());
        all
    }

    /// One error in a text that another parser refused, at its line and column (in bytes), both from 1.
    pub(crate) fn of_text(file: &str, text: &str, at: (usize, usize), message: String, help: &str) -> Self {
        let mut all = Self::new(file, text.into());
        let start = all.lines.0.get(at.0.saturating_sub(1)).copied().unwrap_or_default();
        let offset = (start + at.1.saturating_sub(1)).min(text.len());
        all.push(Severity::Error, offset..offset, message, help.to_owned());
        all
    }

    pub(super) fn push(&mut self, severity: Severity, span: Span, message: String, help: String) {
        self.errors += usize::from(severity == Severity::Error);
        if self.list.len() >= KEPT {
            self.omitted += 1;
            return;
        }
        let (line, column) = self.lines.place(&self.text, span.start);
        self.list.push(Diagnostic { severity, line, column, message, help, span });
    }

    /// The line of a byte offset, from 1.
    pub(super) fn line_of(&self, offset: usize) -> usize {
        self.lines.line_of(offset)
    }

    /// The file's name as given.
    #[must_use]
    pub fn file(&self) -> &str {
        &self.file
    }

    /// The findings, by position.
    #[must_use]
    pub fn list(&self) -> &[Diagnostic] {
        &self.list
    }

    /// Whether nothing was found.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Whether one of the findings is an error.
    #[must_use]
    pub fn has_errors(&self) -> bool {
        self.errors > 0
    }

    /// The warnings if there are no errors, else everything.
    ///
    /// # Errors
    /// All findings, when at least one is an error.
    pub fn into_result(self) -> Result<Self, Self> {
        if self.has_errors() { Err(self) } else { Ok(self) }
    }

    fn fmt_excerpt(&self, finding: &Diagnostic, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let line = self.lines.text(&self.text, finding.line);
        if line.is_empty() {
            return Ok(());
        }
        let before = finding.column - 1;
        let from = before.saturating_sub(SHOWN_CHARS / 2);
        let shown: String = line
            .chars()
            .skip(from)
            .take(SHOWN_CHARS)
            .map(|c| {
                if c == '\t' {
                    ' '
                } else if c.is_control() {
                    '\u{fffd}'
                } else {
                    c
                }
            })
            .collect();
        let marked = self.text.get(finding.span.clone()).and_then(|text| text.lines().next()).unwrap_or("");
        let room = shown.chars().count().saturating_sub(before - from).max(1);
        let carets = "^".repeat(marked.chars().count().clamp(1, room));
        writeln!(f, "{:5} | {shown}", finding.line)?;
        writeln!(f, "      | {:indent$}{carets}", "", indent = before - from)
    }
}

impl fmt::Display for Diagnostics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for finding in &self.list {
            let kind = if finding.severity == Severity::Warning { "warning: " } else { "" };
            writeln!(f, "{}:{}:{}: {kind}{}", self.file, finding.line, finding.column, finding.message)?;
            self.fmt_excerpt(finding, f)?;
            writeln!(f, "      help: {}", finding.help)?;
        }
        match self.omitted {
            0 => Ok(()),
            more => writeln!(f, "{}: and {more} more", self.file),
        }
    }
}

/// Where each line starts, in bytes.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Lines(Vec<usize>);

impl Lines {
    fn of(text: &str) -> Self {
        Self(std::iter::once(0).chain(text.match_indices('\n').map(|(newline, _)| newline + 1)).collect())
    }

    fn line_of(&self, offset: usize) -> usize {
        self.0.partition_point(|start| *start <= offset).max(1)
    }

    /// Line and column (in characters) of a byte offset, both from 1.
    fn place(&self, text: &str, offset: usize) -> (usize, usize) {
        let mut end = offset.min(text.len());
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        let line = self.line_of(end);
        (line, text[self.0[line - 1]..end].chars().count() + 1)
    }

    /// The text of a line, counted from 1, without its end.
    fn text<'t>(&self, text: &'t str, line: usize) -> &'t str {
        let from = self.0[line - 1];
        let to = self.0.get(line).copied().unwrap_or(text.len());
        text[from..to].trim_end_matches(['\r', '\n'])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_columns_are_characters_and_never_split_one() {
        let text = "a = 1\nč = \"žluť\"";
        let lines = Lines::of(text);
        for (offset, place) in
            [(0, (1, 1)), (5, (1, 6)), (6, (2, 1)), (7, (2, 1)), (9, (2, 3)), (1000, (2, 11))]
        {
            assert_eq!(lines.place(text, offset), place, "{offset}");
        }
        assert_eq!((lines.text(text, 1), Lines::of("\r\n").text("\r\n", 1)), ("a = 1", ""));
    }

    #[test]
    fn spec_an_error_is_shown_with_its_line_a_caret_and_the_remedy() {
        let mut all = Diagnostics::new("m.toml", "[tdma]\nslot_s = -1\n".into());
        all.push(Severity::Error, 16..18, "too short".to_owned(), "make it longer".to_owned());
        assert_eq!(
            all.to_string(),
            "m.toml:2:10: too short\n    2 | slot_s = -1\n      |          ^^\n      help: make it longer\n"
        );
    }
}
