//! Every combination of the facts, against the rules as they are stated in words.

use super::*;

fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

const LEASE: Duration = Duration::from_millis(500);
const BOTH: [bool; 2] = [false, true];

fn now() -> Instant {
    Instant::from_start(Duration::from_secs(100))
}

/// A row of facts, and what they are in words.
struct Row {
    latches: Latches,
    facts: Facts,
    /// The window holds the present instant.
    open: bool,
    /// J: it protects somebody.
    needed: bool,
    /// Until when the permit would last.
    expires_at: Option<Instant>,
}

impl Row {
    /// The rules, one a line: what must be, and the silence where it is not.
    fn rules(&self) -> [(bool, Silence); 11] {
        let (latches, facts) = (&self.latches, &self.facts);
        let planned_w = facts.window.map_or(0.0, |window| window.power_w);
        let a_power = |w: f64| w.partial_cmp(&0.0) == Some(std::cmp::Ordering::Greater);
        let is_i = matches!(latches.role, Role::I);
        [
            (!latches.killed, Silence::Killed),
            (latches.authorised, Silence::NotAuthorised),
            (!latches.resting, Silence::Resting),
            (self.open, Silence::NoSlot),
            (facts.state_fresh, Silence::Stale),
            (facts.in_control, Silence::NotInControl),
            (facts.estimator_ok, Silence::Estimator),
            (facts.pose_ok, Silence::Pose),
            (!is_i || self.expires_at.is_some(), Silence::NoLease),
            (is_i || self.needed, Silence::NoPeer),
            (
                a_power(planned_w) && planned_w != f64::INFINITY && a_power(latches.power_limit_w),
                Silence::NoPower,
            ),
        ]
    }

    fn expected(&self) -> Result<Permit, Silence> {
        if let Some((_, silence)) = self.rules().into_iter().find(|(holds, _)| !holds) {
            return Err(silence);
        }
        let window = self.facts.window.ok_or(Silence::NoSlot)?;
        let limit_w = self.latches.power_limit_w;
        let power_w = if window.power_w < limit_w { window.power_w } else { limit_w };
        let expires_at = self.expires_at.ok_or(Silence::NoLease)?;
        Ok(Permit { power_w, slot: window.slot, expires_at })
    }
}

/// Windows by their place about the present: first instant, first instant after, whether it is open.
fn windows() -> [Option<(Instant, Instant, bool)>; 7] {
    let n = now();
    [
        None,
        Some((n + ms(1), n + ms(900), false)),
        Some((n, n + ms(900), true)),
        Some((n - ms(10), n + ms(900), true)),
        Some((n - ms(10), n + ms(40), true)),
        Some((n - ms(10), n, false)),
        Some((n - ms(10), n - ms(1), false)),
    ]
}

/// Ends of the jam lease, and those of them by which a command may say that the radio is off.
fn leases() -> [(Option<Instant>, Option<Instant>); 5] {
    let end = |left: Duration| Some(now() + left);
    [
        (None, None),
        (Some(now() - ms(1)), None),
        (end(Duration::ZERO), None),
        (end(ms(1)), end(ms(1))),
        (end(ms(300)), end(ms(300))),
    ]
}

const POWERS_W: [f64; 7] = [f64::NAN, f64::NEG_INFINITY, -1.0, 0.0, 1e-9, 0.4, f64::INFINITY];
const LIMITS_W: [f64; 5] = [f64::NAN, -1.0, 0.0, 0.3, f64::INFINITY];

fn every_row(mut visit: impl FnMut(&Row)) {
    // Every true and false of the latches and of what the vehicle says.
    for bits in 0..(1_u32 << 9) {
        let bit = |k: u32| bits >> k & 1 == 1;
        let role = if bit(0) { Role::I } else { Role::J };
        for (window, power_w) in windows().into_iter().flat_map(|w| POWERS_W.map(|p| (w, p))) {
            for (lease, limit_w) in leases().into_iter().flat_map(|l| LIMITS_W.map(|w| (l, w))) {
                for peer_on_station in BOTH {
                    let facts = Facts {
                        window: window.map(|(from, until, _)| Window { slot: 7, from, until, power_w }),
                        state_fresh: bit(4),
                        in_control: bit(5),
                        estimator_ok: bit(6),
                        pose_ok: bit(7),
                        jam_lease: lease.0,
                        peer_on_station,
                        leases_outstanding: bit(8),
                    };
                    let latches = Latches {
                        role,
                        killed: bit(1),
                        authorised: bit(2),
                        resting: bit(3),
                        power_limit_w: limit_w,
                        lease: LEASE,
                    };
                    // No permit outlasts the window, a lease's length, or what I was granted.
                    let longest =
                        window.map(|(_, until, _)| if until < now() + LEASE { until } else { now() + LEASE });
                    let expires_at = match role {
                        Role::J => longest,
                        Role::I => lease.1.zip(longest).map(|(a, b)| if a < b { a } else { b }),
                    };
                    visit(&Row {
                        latches,
                        facts,
                        open: window.is_some_and(|(_, _, open)| open),
                        needed: peer_on_station || bit(8),
                        expires_at,
                    });
                }
            }
        }
    }
}

#[test]
fn spec_every_row_of_facts_has_the_silence_or_the_permit_that_the_rules_say() {
    let (mut rows, mut permits) = (0_u32, 0_u32);
    let mut silences = std::collections::BTreeMap::<String, u32>::new();
    every_row(|row| {
        let decision = decide(&row.latches, &row.facts, now());
        assert_eq!(decision, row.expected(), "{:?} {:?}", row.latches, row.facts);
        rows += 1;
        match decision {
            Ok(_) => permits += 1,
            Err(silence) => *silences.entry(format!("{silence:?}")).or_default() += 1,
        }
    });
    println!("{rows} rows, {permits} permits, silences {silences:?}");
    assert_eq!(silences.len(), 11, "a reason is never found: {silences:?}");
    assert!(permits > 0);
}
