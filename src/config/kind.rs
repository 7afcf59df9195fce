//! Kinds of values. A kind says four things of the settings that have it: how a value is read from TOML and what is
//! wrong with one that cannot be, whether a value made by hand would do, how the JSON Schema describes it, and its
//! canonical form, by which two ways of writing one value have one digest. `0.5` and `5e-1` are read by the same
//! [`Number`], and are the same setting.

mod compound;
mod field;
mod pattern;
mod scalar;
mod value;

pub(crate) use compound::{Each, List, Numbers, Period, Receivers};
pub(crate) use field::FieldFile;
pub(crate) use pattern::PatternRows;
pub(crate) use scalar::{Choice, Flag, ID, Integer, Moment, Number, Parsed, Text, byte};
pub(crate) use value::{Fault, Item, Kind, miscount, nearest};
