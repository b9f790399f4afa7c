//! Attacks on the application by model checking: starts after any history of power cuts and damage, and interleavings
//! of requests. Each is bounded by a count of cases. `cargo tasks attack` runs them with fresh seeds as long as asked.

mod boots;
mod budget;
mod requests;
