//! Error against run time: each parameter of rendering varied alone, then all together.

mod bench;
mod findings;
mod page;
mod plot;
mod records;
mod table;

pub use bench::{Options, StartProgress, measure, spread_cameras};
pub use findings::{Findings, MeasuredSetting};
pub use page::page;
pub use records::records;
pub use table::markdown;
