//! A companion in step with a simulated world, which gives out the time: what it is then, and nothing else, is not as on a
//! vehicle. Not in the onboard build.

use std::future::Future;
use std::io::{BufRead, StdinLock, stdin};
use std::net::IpAddr;
use std::pin::Pin;

use tokio::runtime::Runtime;
use tokio::sync::{Notify, watch};

use super::{Args, companion, end, recording, runtime};
use crate::cli::step::{Done, Flies, Order};
use crate::cli::{Exit, interrupt};
use crate::companion::CompanionError;
use crate::config::{Mission, Vehicle};
use crate::desk::simulation;
use crate::link::clock::{Clock, Hand};
use crate::link::{HostPort, LinkAddress};
use crate::mission::Outcome;
use crate::mission::following::Flown;

/// Flies as [`super::fly`] does, by the time that whoever started this program says.
pub(super) fn fly(args: &Args, mission: Mission, vehicle: &Vehicle) -> Result<Exit, String> {
    refuse_real(vehicle)?;
    let mut orders = stdin().lock();
    let (clock, hand) = begin(&mut orders)?;
    let (runtime, _handled) = runtime()?;
    let recording = recording(args, &mission, vehicle, &clock)?;
    let _inside = runtime.enter();
    let mut companion = match companion(args, mission, vehicle, &clock, &recording) {
        Ok(companion) => companion,
        Err(error) => return Err(recording.failed(error, &clock)),
    };
    let (sender, flown) = watch::channel(None);
    companion.flown = Some(sender);
    let asked = Notify::new();
    let stop = async {
        tokio::select! {
            () = interrupt::requested() => {}
            () = asked.notified() => {}
        }
    };
    let run = std::pin::pin!(companion.run(clock.clone(), stop));
    // Where nobody gives out time any more, nobody's time runs.
    let outcome = follow(orders, (&hand, &flown), &runtime, run, &asked);
    recording.end(&clock, outcome.map(|outcome| outcome.unwrap_or(Outcome::Interrupted))).map(end)
}

/// No vehicle but a simulated one may live by a time that is made up.
fn refuse_real(vehicle: &Vehicle) -> Result<(), String> {
    let refused = |why: &str| Err(format!("--clock-from-stdin is for simulated vehicles alone: {why}"));
    if vehicle.is_real() {
        return refused("the transmitter is real");
    }
    let links = [Some(&vehicle.autopilot.link), vehicle.transmitter.link.as_ref(), Some(&vehicle.pair_link)];
    match links.into_iter().flatten().find(|link| !is_loopback_udp(link)) {
        Some(link) => refused(&format!("{link} is not UDP within this machine")),
        None => Ok(()),
    }
}

/// Only there has a datagram arrived when it is sent.
fn is_loopback_udp(link: &LinkAddress) -> bool {
    match link {
        LinkAddress::UdpIn(HostPort { host, .. }) | LinkAddress::UdpOut(HostPort { host, .. }) => {
            host.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
        }
        _ => false,
    }
}

/// The clock that the world's first line sets.
fn begin(orders: &mut StdinLock<'_>) -> Result<(Clock, Hand), String> {
    match next(orders)? {
        Some(Order::Begin { now, utc }) => Ok(Clock::by_hand(now, utc)),
        _ => Err("stdin gives no time: --clock-from-stdin is for `veilwing sitl`, which gives it".to_owned()),
    }
}

/// Lets `run` go as far as it is told, each time, until it ends or the world does.
fn follow(
    mut orders: StdinLock<'_>,
    (hand, flown): (&Hand, &watch::Receiver<Option<(Flown, bool)>>),
    runtime: &Runtime,
    mut run: Pin<&mut impl Future<Output = Result<Outcome, CompanionError>>>,
    asked: &Notify,
) -> Result<Option<Outcome>, String> {
    while let Some(order) = next(&mut orders)? {
        match order {
            Order::Begin { .. } => return Err("the world began twice".to_owned()),
            Order::Stop => asked.notify_one(),
            Order::Go { from, to } => {
                if let Some(outcome) = runtime.block_on(hand.go(from, to, run.as_mut())) {
                    return outcome.map(Some).map_err(|error| error.to_string());
                }
                // In one piece, so that it is read in one.
                let flown = flown.borrow().as_ref().map(|(flown, alike)| Flies {
                    slot: flown.slot,
                    alike: *alike,
                    both: simulation::flown(&flown.at(to)),
                });
                let answer = format!("{}\n", Done { to, flown });
                eprint!("{answer}");
            }
        }
    }
    Ok(None)
}

/// The next order; `None`: there will be none.
fn next(orders: &mut StdinLock<'_>) -> Result<Option<Order>, String> {
    let mut line = String::new();
    match orders.read_line(&mut line) {
        Ok(0) => Ok(None),
        Ok(_) => line.trim_end().parse().map(Some).map_err(|error| format!("stdin: {error}")),
        Err(error) => Err(format!("stdin: {error}")),
    }
}
