//! Blocks of samples that are handled together.

/// Samples handled together: one arithmetic instruction a lane, whatever the machine's vector width.
pub const LANES: usize = 8;

/// One value per sample of a block.
pub type Lane = [f64; LANES];
