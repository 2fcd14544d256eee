//! The demo's page: everything that was made, in one place.

use super::Table;
use crate::{
    failure::Failure,
    output,
    page::{STYLE, escaped, html_table},
};
use std::path::Path;

/// Writes `index.html`, which asks for nothing from outside its folder.
pub(super) fn write(folder: &Path, table: &Table, iterations: u32) -> Result<(), Failure> {
    output::write_text(&folder.join("index.html"), &page(folder, table, iterations))
}

fn page(folder: &Path, table: &Table, iterations: u32) -> String {
    let path = escaped(&folder.display().to_string());
    let table = html_table(&table.cells);
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
