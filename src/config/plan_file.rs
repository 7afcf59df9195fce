//! A plan document as `evaluate` reads it, or what is wrong with it, with its place.

use super::diagnostic::Diagnostics;
use crate::planner::document::{EditedPlan, FORMAT};

const REMEDY: &str =
    "give a document that `veilwing plan MISSION --json` wrote; poses and powers in it may be edited";

/// Reads a plan document of at least one slot. `name` is the file's, for errors.
///
/// # Errors
/// What is wrong with the text, with its line and column.
pub fn plan_of_text(name: &str, text: &str) -> Result<EditedPlan, Diagnostics> {
    let refuse = |at, message: String| Diagnostics::of_text(name, text, at, message, REMEDY);
    let plan: EditedPlan = serde_json::from_str(text).map_err(|error| {
        let at = (error.line(), error.column());
        let told = error.to_string();
        let why = told.split(&format!(" at line {} column {}", at.0, at.1)).next().unwrap_or(&told);
        refuse(at, format!("this is no plan document: {why}"))
    })?;
    if plan.format != FORMAT {
        return Err(refuse((1, 1), format!("`format` is {:?}, not {FORMAT:?}", plan.format)));
    }
    if plan.slots.is_empty() {
        return Err(refuse((1, 1), "`slots` is empty: there is nothing to score".to_owned()));
    }
    Ok(plan)
}
