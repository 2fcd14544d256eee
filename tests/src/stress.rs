//! Scenes at the edges of what is valid, and what executors make of them.

pub mod results;

pub use specula_oracle::stress::{Case, LAYOUT, every_case};
