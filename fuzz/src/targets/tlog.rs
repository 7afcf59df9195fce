//! Telemetry logs.

use veilwing::link::tlog::{TlogError, append_record};
use veilwing::link::{Aboard, TlogReader};
use veilwing::time::Utc;

use crate::reached::Reached;
use crate::target::Target;
use crate::wire::{frame_v1, frame_v2};

/// The reader of telemetry logs.
pub const TARGET: Target = Target {
    name: "tlog",
    what: "the bytes of a telemetry log to its reader",
    words: &[],
    seeds,
    run,
    generated: 20_000,
};

fn seeds() -> Vec<Vec<u8>> {
    let mut log = Vec::new();
    append_record(
        &mut log,
        Utc { unix_us: 1_800_000_000_000_000 },
        &frame_v2::<Aboard>((1, 1), 0, 0, &[4; 9]),
    );
    append_record(
        &mut log,
        Utc { unix_us: 1_800_000_000_000_001 },
        &frame_v1::<Aboard>((1, 1), 0, 0, &[4; 9]),
    );
    vec![log]
}

fn run(input: &[u8], reached: &mut Reached) {
    let mut again = Vec::new();
    let mut ended = false;
    let mut records = 0;
    for record in TlogReader::new(input) {
        assert!(!ended, "a record behind an error");
        match record {
            Ok((utc, frame)) => {
                append_record(&mut again, utc, frame.bytes());
                records += 1;
                let read = frame.parse::<Aboard>().map(|frame| frame.neutralised);
                reached.note(format_args!("{} {read:?}", frame.is_signed()));
            }
            Err(error) => {
                ended = true;
                let (TlogError::Truncated { offset } | TlogError::Damaged { offset }) = error else {
                    reached.sentence("unread", &error.to_string());
                    continue;
                };
                assert_eq!(offset, again.len() as u64, "where the records end that are good");
                reached.sentence("ended", &error.to_string());
            }
        }
    }
    reached.count("records", records);
    // What was read is what was there, to the byte.
    assert_eq!(again, input[..again.len()]);
    assert!(ended || again.len() == input.len());
}
