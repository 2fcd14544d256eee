//! Evaluation of a model on held-out views.

mod page;
mod relit;
mod results;
mod view;

pub use page::{EvaluationPage, page};
pub use relit::{Protocol, RELIT, RelitScene, lights};
pub use results::{EvaluatedLight, Evaluation, albedo_summary};
pub use view::EvaluatedView;
