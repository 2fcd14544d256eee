//! Error against run time: each parameter of rendering varied separately, then all together.

mod bench;
mod findings;
mod lamps;
mod page;
mod plot;
mod progress;
mod records;
mod table;

pub use bench::{Options, measure, spread_cameras};
pub use findings::{Findings, MeasuredSetting};
pub use lamps::{LampSetting, LampSubject, lamp_settings};
pub use page::page;
pub use progress::StartProgress;
pub use records::records;
pub use table::markdown;
