//! The demo's page: everything that was made, in one place.

use super::{
    Table,
    sheets::{Figure, Sheets},
};
use crate::{
    failure::Failure,
    output,
    page::{STYLE, escaped, html_table},
};
use std::path::Path;

/// Style of rows of pictures: as large as they are, with captions in a browser's font.
const ROWS: &str = "\
body { max-width: 78rem; }
.row { display: flex; flex-wrap: wrap; gap: .75rem; margin: .75rem 0; }
figure { margin: 0; }
figcaption { font-size: .8rem; line-height: 1.3; color: #555; max-width: 20rem; }
.limits { border-left: .25rem solid #c9a227; padding-left: 1rem; }";

/// Writes `index.html`, which asks for nothing from outside its folder.
pub(super) fn write(folder: &Path, table: &Table, iterations: u32, sheets: &Sheets) -> Result<(), Failure> {
    output::write_text(&folder.join("index.html"), &page(folder, table, iterations, sheets))
}

/// Rows of pictures with their captions.
fn html_rows(rows: &[Vec<Figure>]) -> String {
    let figure = |Figure { file, caption, size: [width, height] }: &Figure| {
        // A caption may break where the picture ends.
        format!(
            "<figure style=\"width: {width}px\"><img src=\"{file}\" width=\"{width}\" height=\"{height}\" alt=\"{caption}\">\
             <figcaption>{caption}</figcaption></figure>\n"
        )
    };
    let row =
        |row: &Vec<Figure>| format!("<div class=\"row\">\n{}</div>\n", row.iter().map(figure).collect::<String>());
    rows.iter().map(row).collect()
}

fn page(folder: &Path, table: &Table, iterations: u32, sheets: &Sheets) -> String {
    let path = escaped(&folder.display().to_string());
    let table = html_table(&table.cells);
    let [comparison, layers, lights, relit] =
        [&sheets.comparison, &sheets.layers, &sheets.lights, &sheets.relit].map(|rows| html_rows(rows));
    format!(
        "<!doctype html>
<html lang=\"en\">
<meta charset=\"utf-8\">
<meta name=\"viewport\" content=\"width=device-width\">
<title>specula: a scene that can be taken apart and relit</title>
<style>
{STYLE}
{ROWS}
</style>
<h1>From pictures to a relightable scene</h1>
<p>56 pictures of nine spheres, 160 × 160 pixels, were fitted twice with {iterations} steps from the same random points:
with plain Gaussian splatting (3dgs), and with a shading function and a light that is fitted along (specula). All
figures are of 12 held-out views; normals are wrong by so many degrees in the mean.</p>
{table}
<h2>Held-out views</h2>
<p>Errors: black is none, pale yellow a quarter of the range or more. Normals: red, green and blue are x, y and z.</p>
{comparison}
<h2>Layers</h2>
<p>What the shading function adds up: a diffuse colour that no light changes, and a reflection of the light, sharp or
blurred as the roughness says.</p>
{layers}
<h2>The light</h2>
<p>No picture of the light was given: it is recovered from reflections. Its mean brightness is set to the true one's
here, because a factor of the light cannot be told from one of the tints.</p>
{lights}
<h2>Other lights</h2>
<p>The same scene under lights that no training picture has seen, beside the path-traced truth.</p>
{relit}
<div class=\"limits\">
<p>What is not right yet:</p>
<ul>
<li>The mirror ball keeps part of its old reflection: what the fitted light did not explain was learned as its colour.</li>
<li>Matte parts do not change under another light: the diffuse colour holds the light and the shadows of the pictures, as
in the paper's model.</li>
<li>Spheres do not reflect each other: all light comes from far away.</li>
</ul>
</div>
<h2>Around the scene</h2>
<p><img src=\"turntable.png\" alt=\"The scene, turning\"></p>
<h2>Go on from here</h2>
<pre>specula view {path}/specula --env {path}/data/light/sunset.hdr
specula render {path}/specula --layers all
specula relight {path}/specula --env {path}/data/light/sunset.hdr --background env --turntable 36
specula info {path}/specula
specula train {path}/data -m out/longer --eval --iterations 7000</pre>
<p>Files: <a href=\"results.json\">results.json</a>, the <a href=\"data/README.md\">data</a> and its licence, and the
models in <code>3dgs</code> and <code>specula</code>.</p>
</html>
"
    )
}
