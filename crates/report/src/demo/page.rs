//! Page of the demo.

use crate::{
    demo::pictures::{Figure, Pictures},
    error::Result,
    html::HtmlTable,
};
use askama::Template;
use specula_scene::text::shown;
use std::path::Path;

/// HTML of the page, which requests nothing from outside its folder. The first of `rows` are the
/// heads of the table of both trainings, of `iterations` steps each; `folder` is the folder of the
/// demo.
///
/// # Errors
///
/// A template that cannot be rendered.
pub fn page<const N: usize>(
    folder: &Path,
    rows: &[[String; N]],
    iterations: u32,
    pictures: &Pictures,
) -> Result<String> {
    let folder = shown(folder);
    Ok(Page { folder, iterations, trainings: HtmlTable::with_heads(rows), pictures }.render()?)
}

#[derive(Template)]
#[template(path = "demo.html")]
struct Page<'a> {
    folder: String,
    iterations: u32,
    trainings: HtmlTable,
    pictures: &'a Pictures,
}
