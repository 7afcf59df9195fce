//! The `veilwing` command.

fn main() {}
