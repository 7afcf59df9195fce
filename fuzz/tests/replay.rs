//! Every target over its seeds, its committed corpus and inputs that are generated from one seed: what was found once
//! stays mended.

// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use veilwing_fuzz::fuzzer::{Fuzzer, Outcome};
use veilwing_fuzz::{Reached, TARGETS, Target, corpus};

const SEED: u64 = 13;
/// All corpora together.
const MOST_BYTES: usize = 1 << 20;

/// Runs what is stored, then what is made of it. The names of the inputs are printed if one panics.
fn run(name: &str) {
    let target = Target::named(name).unwrap();
    let mut fuzzer = Fuzzer::new(target, SEED);
    let stored = corpus::load(&corpus::directory(target)).unwrap();
    let inputs = (target.seeds)().len() + stored.len();
    for input in (target.seeds)().into_iter().chain(stored) {
        kept(target, fuzzer.take(input));
    }
    let known = fuzzer.known().len();
    for _ in 0..target.generated {
        let input = fuzzer.next_input();
        kept(target, fuzzer.run(input));
    }
    println!(
        "{name}: {inputs} inputs reach {known} outcomes, {} generated ones {} more",
        target.generated,
        fuzzer.known().len() - known
    );
    assert!(inputs > 0 && known > 0, "{inputs} {known}");
}

fn kept(target: &Target, outcome: Outcome) {
    if let Outcome::Panicked { input, message } = outcome {
        let directory = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("found").join(target.name);
        let path = corpus::store(&directory, &input).unwrap();
        panic!("{}: an input panics, kept as {}\n{message}", target.name, path.display());
    }
}

macro_rules! targets {
    ($($test:ident: $name:literal,)*) => {
        $(#[test]
        fn $test() {
            run($name);
        })*

        #[test]
        fn spec_every_target_is_replayed() {
            assert_eq!(TARGETS.iter().map(|target| target.name).collect::<Vec<_>>(), [$($name),*]);
        }
    };
}

targets! {
    prop_frames_take_whatever_comes: "frames",
    prop_signatures_take_whatever_comes: "signing",
    prop_telemetry_logs_take_whatever_comes: "tlog",
    prop_the_autopilots_driver_takes_whatever_comes: "autopilot",
    prop_numbered_commands_take_whatever_comes: "transmitter-numbered",
    prop_leased_commands_take_whatever_comes: "transmitter-leased",
    prop_a_power_parameter_takes_whatever_comes: "transmitter-parameter",
    prop_the_service_of_a_slot_takes_whatever_comes: "slot",
    prop_slots_that_carry_each_other_on_take_whatever_comes: "slot-carried-on",
    prop_a_slot_whose_motion_is_made_anew_takes_whatever_comes: "slot-followed",
    prop_the_executive_takes_whatever_comes: "executive",
    prop_mission_files_take_whatever_comes: "mission-file",
    prop_vehicle_files_take_whatever_comes: "vehicle-file",
    prop_fault_files_take_whatever_comes: "fault-file",
    prop_airframes_take_whatever_comes: "airframe-file",
    prop_plan_documents_take_whatever_comes: "plan-document",
    prop_flight_records_take_whatever_comes: "flight-record",
    prop_flight_logs_take_whatever_comes: "flight-logs",
}

#[test]
fn spec_the_corpora_are_small_and_named_by_their_content() {
    let mut bytes = 0;
    for target in TARGETS {
        let directory = corpus::directory(target);
        for input in corpus::load(&directory).unwrap() {
            bytes += input.len();
            let path = directory.join(corpus::name_of(&input));
            assert!(path.exists(), "{}: an input is not named by its content", target.name);
        }
    }
    println!("{bytes} bytes in all corpora");
    assert!(bytes < MOST_BYTES, "{bytes}: distil them");
}

/// Reaches what its first byte says, once an input is long enough.
fn first(input: &[u8], reached: &mut Reached) {
    reached.note(format_args!("{:?}", input.first()));
}

#[test]
fn spec_a_distilled_corpus_reaches_as_much_with_the_shortest() {
    let target = Target { name: "first", what: "", words: &[], seeds: Vec::new, run: first, generated: 0 };
    let inputs = [&b"aaaa"[..], b"b", b"a", b"bb", b"c"].map(<[u8]>::to_vec).to_vec();
    assert_eq!(corpus::distilled(&target, inputs, &Reached::default()), [b"a", b"b", b"c"]);
    // What is reached anyway needs no entry.
    assert_eq!(corpus::distilled(&target, vec![b"a".to_vec()], &target.reach(b"ax")), Vec::<Vec<u8>>::new());
}
