//! Whatever comes over the pair link: no panic, no flood of answers, no lease or power that was not granted.

#![no_main]

#[path = "../body.rs"]
mod body;

libfuzzer_sys::fuzz_target!(|input: &[u8]| {
    let mut target = body::Target::new();
    target.take(input);
});
