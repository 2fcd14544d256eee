//! Pictures and page of the demo scene: its two trainings, layers, light, and relit views.

mod page;
mod pictures;
mod trainings;
mod turntable;

pub use page::page;
pub use pictures::{LIGHTS, Pictures};
pub use trainings::{Orbit, TrainedScene, results, table};
