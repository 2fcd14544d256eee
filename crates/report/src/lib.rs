//! Measures of trained models and their reports: tables for papers, plots, pages, and the files
//! that the field's scripts read.
//!
//! | module | report |
//! |---|---|
//! | [`measure`] | list of measures, `results.json` and `per_view.json` |
//! | `lpips`, with the feature of that name | LPIPS by a network from a file |
//! | [`materials`] | albedo, roughness and metalness against ground truth |
//! | [`light`] | learned light against the true one |
//! | [`relighting`] | PSNR under other lights, with and without the best factors |
//! | [`evaluation`] | page with each view beside its ground truth and error |
//! | [`certificate`] | pictures within an error, verified one by one |
//! | [`contents`] | contents of a model or a data set |
//! | [`comparison`] | table of several runs in Markdown, CSV or LaTeX |
//! | [`tradeoff`] | error against run time, for each parameter of rendering |
//! | [`demo`] | pictures and page of the demo scene |
//! | [`made`] | page of a relit turntable |
//!
//! ```no_run
//! use specula_report::comparison::{Comparison, Format};
//!
//! let runs = Comparison::read(&["out/chair-3dgs", "out/chair"])?;
//! print!("{}", runs.to_text(Format::Markdown, &runs.differences()));
//! # Ok::<(), specula_report::Error>(())
//! ```
//!
//! Pages share one template and one style sheet (`templates/base.html`, `templates/style.css`);
//! they request nothing from outside their folder.

pub mod certificate;
pub mod comparison;
pub mod contents;
pub mod demo;
mod error;
pub mod evaluation;
mod html;
pub mod light;
#[cfg(feature = "lpips")]
pub mod lpips;
pub mod made;
pub mod materials;
pub mod measure;
pub mod relighting;
pub mod tradeoff;

pub use error::{Error, Result};

/// Version in the footer of pages.
const VERSION: &str = env!("CARGO_PKG_VERSION");

/// The example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
