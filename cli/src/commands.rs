//! Commands: from arguments to calls of the libraries, and a report of the results.

pub(crate) mod capture;
pub(crate) mod compare;
pub(crate) mod demo;
pub(crate) mod doctor;
pub(crate) mod eval;
pub(crate) mod export;
pub(crate) mod fit_light;
pub(crate) mod info;
pub(crate) mod make;
pub(crate) mod prefilter;
pub(crate) mod relight;
pub(crate) mod render;
pub(crate) mod report;
pub(crate) mod train;
pub(crate) mod view;
