//! A stream of anything against a radio written a second time, from docs/radio.md alone, whose device obeys at once.

use mavlink::dialects::ardupilotmega::COMMAND_INT_DATA;
use proptest::prelude::*;

use super::stand::*;
use crate::transmitter::wire::VeilwingRadioResult as Is;

/// The radio as the document has it, in signed 64-bit milliseconds that do not wrap.
#[derive(Debug, Default)]
struct Oracle {
    boot: i64,
    newest: i64,
    /// Power in dBm, and when it ends.
    power: Option<(i64, i64)>,
}

/// A command in the oracle's terms.
#[derive(Debug, Clone, Copy)]
struct Given {
    dbm: f64,
    number: i64,
    boot: i64,
    names_series: bool,
    ahead: i64,
}

impl Oracle {
    /// What it says, and whether a new series is drawn.
    fn take(&mut self, given: Given, now: i64) -> (Is, bool) {
        let mut draws = false;
        if given.boot != self.boot {
            if !given.names_series {
                return (Is::VEILWING_RADIO_RESULT_OTHER_SERIES, false);
            }
            *self = Self { boot: given.boot, newest: 0, power: None };
            draws = true;
        }
        if given.number <= self.newest {
            return (Is::VEILWING_RADIO_RESULT_NOT_NEWER, draws);
        }
        self.newest = given.number;
        let is = if given.dbm == f64::NEG_INFINITY {
            self.power = None;
            Is::VEILWING_RADIO_RESULT_ACCEPTED
        } else if given.dbm.is_nan() || given.dbm > 30.0 || given.ahead > 5000 {
            Is::VEILWING_RADIO_RESULT_DENIED
        } else if given.ahead <= 19 {
            // It may be off 20 ms early: what ends within that is over.
            self.power = None;
            Is::VEILWING_RADIO_RESULT_EXPIRED
        } else if given.dbm < 0.0 {
            self.power = None;
            Is::VEILWING_RADIO_RESULT_TOO_LOW
        } else {
            self.power = Some((given.dbm.floor() as i64, now + given.ahead - 19));
            Is::VEILWING_RADIO_RESULT_ACCEPTED
        };
        (is, draws)
    }

    fn pass(&mut self, now: i64) {
        self.power = self.power.filter(|(_, until)| now < *until);
    }
}

#[derive(Debug, Clone)]
enum Step {
    Wait(u64),
    Command {
        dbm: f64,
        number: i64,
        boot: i64,
        names_series: bool,
        ahead: i64,
    },
    /// An earlier command, as it was.
    Again(usize),
}

fn step() -> impl Strategy<Value = Step> {
    let dbm = prop_oneof![
        Just(f64::NEG_INFINITY),
        Just(f64::NAN),
        Just(f64::INFINITY),
        (-8..130i32).prop_map(|quarters| f64::from(quarters) * 0.25)
    ];
    let command = (dbm, -2..4i64, 0..3i64, any::<bool>(), -50..700i64, 0..20u8).prop_map(
        |(dbm, number, boot, names_series, ahead, far)| Step::Command {
            dbm,
            number,
            boot: boot + 1,
            names_series,
            ahead: if far == 0 { 4990 + ahead / 10 } else { ahead },
        },
    );
    prop_oneof![3 => (0..300u64).prop_map(Step::Wait), 5 => command, 1 => any::<usize>().prop_map(Step::Again)]
}

proptest! {
    #[test]
    fn prop_whatever_is_sent_it_is_the_radio_of_the_document(steps in prop::collection::vec(step(), 1..60), began in any::<u32>()) {
        let mut stand = Stand::with(crate::radio_host::Settings { clock_began_ms: began, ..settings() });
        let mut oracle = Oracle::default();
        let mut sent: Vec<(COMMAND_INT_DATA, f64)> = Vec::new();
        let now_of = |stand: &Stand| i64::try_from(stand.now.since_start().as_millis()).unwrap();
        for step in steps {
            stand.reports.clear();
            let (command, given) = match step {
                Step::Wait(millis) => {
                    stand.run(millis);
                    oracle.pass(now_of(&stand));
                    let power = oracle.power.map_or(OFF, |(dbm, _)| i32::try_from(dbm * 1000).unwrap());
                    prop_assert_eq!(stand.power(), power);
                    continue;
                }
                Step::Again(which) => {
                    let Some((command, dbm)) = sent.get(which % sent.len().max(1)).cloned() else { continue };
                    let given = Given {
                        dbm,
                        number: command.param2 as i64,
                        boot: command.param3 as i64,
                        names_series: command.param4 as u32 == stand.host.report(stand.now).series,
                        ahead: i64::from(command.y.cast_unsigned().wrapping_sub(stand.clock_ms()).cast_signed()),
                    };
                    (command, given)
                }
                Step::Command { dbm, number, boot, names_series, ahead } => {
                    let number = (oracle.newest + number).max(1);
                    let wrong = if names_series { 0.0 } else { 1.0 };
                    let command = COMMAND_INT_DATA { param2: number as f32, param3: boot as f32, ..stand.command(dbm as f32, i32::try_from(ahead).unwrap()) };
                    let command = COMMAND_INT_DATA { param4: command.param4 - wrong, ..command };
                    sent.push((command.clone(), dbm));
                    (command, Given { dbm, number, boot, names_series, ahead })
                }
            };
            let series = stand.host.report(stand.now).series;
            let answer = stand.give(command).unwrap();
            let (is, draws) = oracle.take(given, now_of(&stand));
            prop_assert_eq!(answer.result, is, "{:?}", given);
            prop_assert_eq!(answer.series != series, draws);
            prop_assert_eq!((i64::from(answer.boot), i64::from(answer.newest)), (oracle.boot, oracle.newest));
            let power = oracle.power.map_or(OFF, |(dbm, _)| i32::try_from(dbm * 1000).unwrap());
            // The device has obeyed by now; a refusal is answered before it has.
            prop_assert_eq!(stand.power(), power);
        }
    }

    /// Whatever the device does and whenever, what the host says to be off was told off last, and a lease's end is an off.
    #[test]
    fn prop_with_any_device_it_is_told_off_by_the_lease_s_end(
        steps in prop::collection::vec((0..5u8, 0..120u64, 0..6u8, 0..31i32), 1..80),
    ) {
        use crate::radio_host::{Fault, Order, Outcome};
        let mut stand = Stand::new();
        stand.obeys_after = None;
        let mut ends_at = 0;
        for (what, millis, how, dbm) in steps {
            match what {
                0 => { stand.off(); }
                1 => {
                    stand.on(dbm as f32, 300);
                    ends_at = stand.now.since_start().as_millis() + 300;
                }
                2 => stand.run(millis),
                _ if stand.orders.is_empty() => {}
                _ => {
                    let (_, order) = *stand.orders.last().unwrap();
                    stand.outcome(match how {
                        0 => Outcome::Failed(Fault::Refused),
                        1 => Outcome::Set { read_back: Some(f64::from(dbm)) },
                        2 => Outcome::Off,
                        _ => obeyed(order),
                    });
                }
            }
            let last = stand.orders.last().map(|(_, order)| *order);
            let told_on = matches!(last, Some(Order::Set(_)));
            prop_assert!(!(stand.host.is_off() && told_on), "said to be off, told {last:?}");
            prop_assert!(stand.now.since_start().as_millis() < ends_at || !told_on, "told {last:?} past the lease");
        }
    }
}

/// The lease goes with the fault: what was wanted before it must not come on afterwards, when nothing would end it.
#[test]
fn regress_a_power_that_waited_for_a_late_off_is_not_radiated_after_it() {
    use crate::radio_host::{Order, Outcome};
    let mut stand = Stand::new();
    stand.obeys_after = None;
    stand.on(0.0, 300);
    stand.off();
    stand.on(0.0, 300);
    for wait in [185, 115] {
        stand.run(wait);
        stand.outcome(Outcome::Off);
        let last = stand.orders.last().map(|(_, order)| *order);
        assert!(!matches!(last, Some(Order::Set(_))), "told {last:?}, with no lease");
    }
}
