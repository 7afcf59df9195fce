//! A CSV file in memory, row by row.

use csv::{Writer, WriterBuilder};

/// Rows that have been written so far.
pub struct CsvText(Writer<Vec<u8>>);

impl CsvText {
    /// A file with this header.
    pub fn new<S: AsRef<str>>(header: impl IntoIterator<Item = S>) -> Self {
        // Every row comes from code that knows its columns: their number need not be asked again.
        let mut text = Self(WriterBuilder::new().flexible(true).from_writer(Vec::new()));
        text.row(header);
        text
    }

    /// One more row.
    pub fn row<S: AsRef<str>>(&mut self, cells: impl IntoIterator<Item = S>) {
        for cell in cells {
            // Writing to memory cannot fail.
            let _ = self.0.write_field(cell.as_ref());
        }
        let _ = self.0.write_record(None::<&[u8]>);
    }

    /// The whole text.
    pub fn finish(self) -> String {
        let bytes = self.0.into_inner().unwrap_or_default();
        String::from_utf8_lossy(&bytes).into_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_cells_are_quoted_where_they_must_be() {
        let mut text = CsvText::new(["a", "b"]);
        text.row(["1,5", ""]);
        text.row(["say \"on\"", "x"]);
        assert_eq!(text.finish(), "a,b\n\"1,5\",\n\"say \"\"on\"\"\",x\n");
    }
}
