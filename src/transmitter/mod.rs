//! transmitter.
