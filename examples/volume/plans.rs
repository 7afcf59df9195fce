//! The two static plans of a mission, by rate and by volume, and what the schedule makes of them.

use std::time::{Duration, Instant};

use veilwing::geo::Pose;
use veilwing::planner::plan::{SlotPlan, VehiclePlan};
use veilwing::planner::volume::{self, Fairness};
use veilwing::planner::{Options, plan_slot};
use veilwing::role::PerVehicle;
use veilwing::schedule::order::Order;
use veilwing::schedule::table::Timing;
use veilwing::schedule::transit::Router;
use veilwing::schedule::ways;

use crate::mission::Superframe;

/// A plan's slots, and what it took.
pub struct Planned {
    pub vehicles: Vec<PerVehicle<VehiclePlan>>,
    pub slots: Vec<SlotPlan>,
    pub slots_s: Vec<f64>,
    pub took_ms: f64,
}

fn poses(vehicles: &PerVehicle<VehiclePlan>) -> PerVehicle<Pose> {
    vehicles.map(|vehicle| vehicle.pose)
}

pub fn by_volume(mission: &Superframe, router: &Router) -> Planned {
    let begun = Instant::now();
    let found = volume::plan(&mission.problems, &mission.service, router, &Options::default()).unwrap();
    let took_ms = 1e3 * begun.elapsed().as_secs_f64();
    Planned {
        vehicles: found.slots.iter().map(|slot| slot.vehicles).collect(),
        slots: found.slots,
        slots_s: found.slots_s,
        took_ms,
    }
}

pub fn by_rate(mission: &Superframe) -> Planned {
    let begun = Instant::now();
    let slots: Vec<SlotPlan> =
        mission.problems.iter().map(|problem| plan_slot(problem, &Options::default()).unwrap()).collect();
    let took_ms = 1e3 * begun.elapsed().as_secs_f64();
    let slots_s = vec![mission.service.slot_s; slots.len()];
    Planned { vehicles: slots.iter().map(|slot| slot.vehicles).collect(), slots, slots_s, took_ms }
}

/// What the schedule's own table makes of a plan, by the plan's own rates, bit/s/Hz over the superframe: the sum, or with the
/// least-served user first the least.
pub fn stated(mission: &Superframe, router: &Router, plan: &Planned) -> f64 {
    let service = &mission.service;
    let timing = Timing {
        settle: Duration::from_secs_f64(service.settle_s),
        ..Timing::new(Duration::from_secs_f64(service.slot_s), Duration::from_secs_f64(service.guard_s), 1)
    };
    let users: Vec<_> = plan.vehicles.iter().map(poses).collect();
    let lengths: Vec<_> = plan.slots_s.iter().map(|s| Duration::from_secs_f64(*s)).collect();
    let order = if service.may_reorder { Order::Shortest } else { Order::Listed };
    let length = ways::superframe(router, &users, &lengths, &timing, order).unwrap();
    let volumes = plan.slots.iter().zip(&plan.slots_s).zip(&mission.problems);
    let volumes = volumes.map(|((slot, slot_s), problem)| {
        (slot_s - service.guard_s) * slot.secrecy_rate_bps / problem.radio.bandwidth_hz
    });
    let volume = match service.fairness {
        Fairness::Slots => volumes.sum(),
        Fairness::MaxMin => volumes.fold(f64::INFINITY, f64::min),
    };
    volume / length.as_secs_f64()
}
