//! The demo's page: everything that was made, in one place.

use super::Table;
use crate::{failure::Failure, output};
use std::path::Path;

const STYLE: &str = "\
body { font: 16px/1.5 system-ui, sans-serif; max-width: 70rem; margin: 2rem auto; padding: 0 1rem; color: #1e1e1e; }
img { max-width: 100%; height: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
td, th { padding: .3rem 1rem; text-align: right; border-bottom: 1px solid #ddd; }
td:first-child, th:first-child { text-align: left; }
pre { background: #f4f4f4; padding: 1rem; overflow-x: auto; }";

/// Writes `index.html`, which asks for nothing from outside its folder.
pub(super) fn write(folder: &Path, table: &Table, iterations: u32) -> Result<(), Failure> {
    output::write_text(&folder.join("index.html"), &page(folder, table, iterations))
}

fn page(folder: &Path, table: &Table, iterations: u32) -> String {
    let path = escaped(&folder.display().to_string());
    let table = html_table(table);
    format!(
        "<!doctype html>
<html lang=\"en\">
<meta charset=\"utf-8\">
<meta name=\"viewport\" content=\"width=device-width\">
<title>specula: a scene that can be taken apart and relit</title>
<style>
{STYLE}
</style>
<h1>From pictures to a relightable scene</h1>
<p>56 pictures of nine spheres, 160 × 160 pixels, were fitted twice with {iterations} steps from the same random points:
with plain Gaussian splatting (3dgs), and with a shading function and a light that is fitted along (specula). All
figures are of 12 views that neither has seen; normals are wrong by so many degrees in the mean.</p>
{table}
<h2>Views that were held out</h2>
<p>Errors: black is none, pale yellow a quarter of the range or more. Normals: red, green and blue are x, y and z.</p>
<p><img src=\"comparison.png\" alt=\"Truth, plain Gaussian splatting, specula, errors and normals of four views\"></p>
<h2>The light</h2>
<p>No picture of the light was given: it is recovered from reflections. Its mean brightness is set to the true one's
here, because a factor of the light cannot be told from one of the tints.</p>
<p><img src=\"light.png\" alt=\"The recovered light beside the true one\"></p>
<h2>Other lights</h2>
<p>The same scene under lights that no training picture has seen, beside the path-traced truth.</p>
<p><img src=\"relit.png\" alt=\"The scene under a forest's and a sunset's light, beside the truth\"></p>
<h2>Around the scene</h2>
<p><img src=\"turntable.png\" alt=\"The scene, turning\"></p>
<h2>Go on from here</h2>
<pre>specula render {path}/specula --layers all
specula relight {path}/specula --env {path}/data/light/sunset.hdr --turntable 36
specula info {path}/specula
specula train {path}/data -m out/longer --eval --iterations 7000</pre>
<p>Files: <a href=\"results.json\">results.json</a>, the <a href=\"data/README.md\">data</a> and its licence, and the
models in <code>3dgs</code> and <code>specula</code>.</p>
</html>
"
    )
}

fn html_table(table: &Table) -> String {
    let row = |tag: &str, cells: &[String; 6]| {
        let cells: String = cells.iter().map(|cell| format!("<{tag}>{}</{tag}>", escaped(cell))).collect();
        format!("<tr>{cells}</tr>\n")
    };
    let (head, body) = table.cells.split_first().expect("a table has a head");
    let body: String = body.iter().map(|cells| row("td", cells)).collect();
    format!("<table>\n{}{body}</table>", row("th", head))
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
