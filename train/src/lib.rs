//! The optimisation loop: profiles, schedules, densification, evaluation. It knows no executor by name.

pub mod evaluate;
pub mod profile;
pub mod start;
pub mod trainer;
pub mod view;
