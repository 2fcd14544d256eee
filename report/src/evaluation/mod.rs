//! Evaluation of a model on views that it was not fitted to.

mod page;
mod relit;
mod results;
mod view;

pub use page::{EvaluationPage, page};
pub use relit::{RelitScene, lights};
pub use results::Evaluation;
pub use view::EvaluatedView;
