//! States told apart by their text: what `Debug` of the state machines writes leaves nothing out.

use std::fmt::{Debug, Formatter, Result};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::ops::{Deref, DerefMut};
use std::sync::{Arc, OnceLock};

/// A part of a state that most of what happens leaves as it is: shared until it is touched, and its text, which costs more to
/// write than all else costs, written once. Itself it is written as that text's hash.
#[derive(Clone)]
pub struct Kept<T>(Arc<Inner<T>>);

#[derive(Clone)]
struct Inner<T> {
    part: T,
    hash: OnceLock<u64>,
}

impl<T> Kept<T> {
    pub fn new(part: T) -> Self {
        Self(Arc::new(Inner { part, hash: OnceLock::new() }))
    }
}

impl<T> Deref for Kept<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.0.part
    }
}

impl<T: Clone> DerefMut for Kept<T> {
    fn deref_mut(&mut self) -> &mut T {
        let inner = Arc::make_mut(&mut self.0);
        inner.hash = OnceLock::new();
        &mut inner.part
    }
}

impl<T: Debug> Debug for Kept<T> {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let hash = self.0.hash.get_or_init(|| {
            let mut hasher = DefaultHasher::new();
            hash_text(&self.0.part, &mut hasher);
            hasher.finish()
        });
        write!(f, "{hash:x}")
    }
}

/// Hashes the text of a value, written as a whole: piece by piece takes longer.
pub fn hash_text(value: &impl Debug, into: &mut impl Hasher) {
    format!("{value:?}").hash(into);
}
