//! Parts of a campaign, for batch systems: which flights are a part's.

use std::str::FromStr;

use crate::desk::campaign::part_file_name;

/// Part `index`, from 1, of `of`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Shard {
    pub index: u64,
    pub of: u64,
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || "give I/K, the I-th of K parts, such as 1/3".to_owned();
        let (index, of) = text.split_once('/').ok_or_else(wrong)?;
        let (index, of) = (index.parse().map_err(|_| wrong())?, of.parse().map_err(|_| wrong())?);
        if index < 1 || index > of {
            return Err(format!("{index} is not from 1 to {of}: parts are counted from 1"));
        }
        Ok(Self { index, of })
    }
}

impl Shard {
    /// The numbers of the part's flights of `runs`: every K-th, so that parts are alike.
    pub fn runs(self, runs: u64) -> Vec<u64> {
        (0..runs).filter(|run| run % self.of == self.index - 1).collect()
    }

    /// As on the command line.
    pub fn name(self) -> String {
        format!("{}/{}", self.index, self.of)
    }

    /// The name of the part's document.
    pub fn file_name(self) -> String {
        part_file_name(self.index, self.of)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_parts_cover_every_flight_once() {
        for of in 1..=7u64 {
            let parts = (1..=of).map(|index| format!("{index}/{of}").parse::<Shard>().unwrap());
            let mut all: Vec<u64> = parts.flat_map(|part| part.runs(20)).collect();
            all.sort_unstable();
            assert_eq!(all, (0..20).collect::<Vec<_>>());
        }
    }

    #[test]
    fn spec_bad_parts_are_refused() {
        for text in ["0/3", "4/3", "1", "a/b", "1/0", "-1/3", "1/3/5"] {
            assert!(text.parse::<Shard>().is_err(), "{text}");
        }
    }
}
