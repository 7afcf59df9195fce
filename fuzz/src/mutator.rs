//! New inputs from those that there are.

use rand::{Rng, RngExt};
use rand_chacha::ChaCha8Rng;

/// No input grows beyond this.
pub const LONGEST: usize = 1 << 16;
/// Bytes at the edges of what integers and frames mean.
const EDGES: [u8; 12] = [0, 1, 2, 0x7F, 0x80, 0xFD, 0xFE, 0xFF, b'0', b'"', b'\n', b'-'];
/// Figures that files should not hold, or only at their edges.
const FIGURES: [&str; 12] = [
    "0",
    "-0.0",
    "-1",
    "1e308",
    "-1e308",
    "1e-320",
    "nan",
    "inf",
    "-inf",
    "9223372036854775807",
    "0.1",
    "4294967296",
];

/// Makes inputs. The same generator and the same arguments make the same input.
#[derive(Debug)]
pub struct Mutator {
    words: &'static [&'static str],
}

impl Mutator {
    /// Of inputs whose language has these words.
    #[must_use]
    pub fn new(words: &'static [&'static str]) -> Self {
        Self { words }
    }

    /// `input` changed in one place or several, perhaps with a part of `other`.
    #[must_use]
    pub fn mutate(&self, input: &[u8], other: &[u8], rng: &mut ChaCha8Rng) -> Vec<u8> {
        let mut output = input.to_vec();
        for _ in 0..1 << rng.random_range(0..5) {
            self.change(&mut output, other, rng);
        }
        output.truncate(LONGEST);
        output
    }

    fn change(&self, output: &mut Vec<u8>, other: &[u8], rng: &mut ChaCha8Rng) {
        let at = rng.random_range(0..=output.len());
        match rng.random_range(0..12) {
            0 => alter(output, at, |byte| byte ^ (1 << rng.random_range(0..8))),
            1 => alter(output, at, |_| EDGES[rng.random_range(0..EDGES.len())]),
            2 => alter(output, at, |_| rng.random()),
            3 => alter(output, at, |byte| byte.wrapping_add_signed(rng.random_range(-16..=16))),
            4 => {
                let mut bytes = vec![0; short(rng)];
                rng.fill_bytes(&mut bytes);
                insert(output, at, &bytes);
            }
            5 => {
                let end = (at + short(rng)).min(output.len());
                output.drain(at..end);
            }
            6 => {
                let end = (at + 4 * short(rng)).min(output.len());
                let part = output[at..end].to_vec();
                let to = rng.random_range(0..=output.len());
                insert(output, to, &part);
            }
            7 if !other.is_empty() => {
                let from = rng.random_range(0..other.len());
                let end = (from + 8 * short(rng)).min(other.len());
                insert(output, at, &other[from..end]);
            }
            8 if !other.is_empty() => {
                output.truncate(at);
                output.extend_from_slice(&other[rng.random_range(0..other.len())..]);
            }
            9 => self.insert_word(output, at, rng),
            10 => change_figure(output, at, rng),
            _ => swap_lines(output, rng),
        }
    }

    fn insert_word(&self, output: &mut Vec<u8>, at: usize, rng: &mut ChaCha8Rng) {
        if let Some(word) = self.words.get(rng.random_range(0..self.words.len().max(1))) {
            insert(output, at, word.as_bytes());
        }
    }
}

fn short(rng: &mut ChaCha8Rng) -> usize {
    1 << rng.random_range(0..6)
}

fn insert(output: &mut Vec<u8>, at: usize, bytes: &[u8]) {
    output.splice(at..at, bytes.iter().copied());
}

fn alter(output: &mut [u8], at: usize, to: impl FnOnce(u8) -> u8) {
    if let Some(byte) = output.get_mut(at) {
        *byte = to(*byte);
    }
}

/// Puts another figure in the place of the next one.
fn change_figure(output: &mut Vec<u8>, at: usize, rng: &mut ChaCha8Rng) {
    let of_figure = |byte: &u8| byte.is_ascii_digit() || matches!(byte, b'.' | b'-');
    let Some(start) = output[at..].iter().position(of_figure).map(|found| at + found) else { return };
    let end = output[start..].iter().position(|byte| !of_figure(byte)).map_or(output.len(), |n| start + n);
    let figure = FIGURES[rng.random_range(0..FIGURES.len())];
    output.splice(start..end, figure.bytes());
}

/// Moves a line to another place.
fn swap_lines(output: &mut Vec<u8>, rng: &mut ChaCha8Rng) {
    let mut lines: Vec<Vec<u8>> = output.split_inclusive(|byte| *byte == b'\n').map(<[u8]>::to_vec).collect();
    if lines.len() > 1 {
        let (one, another) = (rng.random_range(0..lines.len()), rng.random_range(0..lines.len()));
        lines.swap(one, another);
        *output = lines.concat();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    #[test]
    fn prop_every_change_is_made_and_none_makes_too_much() {
        let mutator = Mutator::new(&["word"]);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let (mut longer, mut shorter, mut same, mut words, mut figures) = (0, 0, 0, 0, 0);
        for _ in 0..20_000 {
            let output = mutator.mutate(b"speed = 12.5\nname = \"x\"\n", b"other text", &mut rng);
            longer += u32::from(output.len() > 24);
            shorter += u32::from(output.len() < 24);
            same += u32::from(output.len() == 24);
            let text = String::from_utf8_lossy(&output);
            words += u32::from(text.contains("word"));
            figures += u32::from(text.contains("1e308"));
            assert!(output.len() <= LONGEST);
        }
        assert!([longer, shorter, same, words, figures].iter().all(|n| *n > 100));
        let long = vec![7; LONGEST];
        assert!((0..200).all(|_| mutator.mutate(&long, &long, &mut rng).len() <= LONGEST));
        // Nothing to change is no fault.
        (0..1000).for_each(|_| drop(mutator.mutate(&[], &[], &mut rng)));
    }

    #[test]
    fn spec_the_same_seed_makes_the_same_input() {
        let make = |seed| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            (0..50).map(|_| Mutator::new(&[]).mutate(b"abc", b"def", &mut rng)).collect::<Vec<_>>()
        };
        assert_eq!(make(3), make(3));
        assert_ne!(make(3), make(4));
    }
}
