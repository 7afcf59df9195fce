//! Documents for people and programs: plans and flights.

pub mod plan_document;
