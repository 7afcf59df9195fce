//! Every rule of docs/radio.md, what the device can do wrong, and a stream of anything against an oracle.

mod device;
mod line;
mod oracle;
mod rules;
mod scales;
mod stand;
