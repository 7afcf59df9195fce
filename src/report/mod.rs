//! Documents for people and programs: plans, flights and figures.

mod drawing;
pub mod figures;
pub mod flight;
pub mod plan_document;
