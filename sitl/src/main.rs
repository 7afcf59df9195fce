//! `veilwing-sitl`: one software vehicle alone.
fn main() {}
