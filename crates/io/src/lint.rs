//! Faults and oddities of files of Gaussians, each with its effect in viewers.
//!
//! Readers of this crate replace or reject some of them; [`lint`] reports the numbers as they are.

use crate::{
    Input,
    budget::PLY_HEADER_MAX,
    error::{Error, Result},
    gaussian_file::{Format, format_of},
    gaussian_ply, glb, splat, spz, within,
};
use specula_core::scene::{Gaussians, LOG_SCALE, Layout, MEAN, OPACITY, QUAT};
use std::{io::Read, path::Path};

/// Fault or oddity of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// Fault or oddity, with its count and place.
    pub found: String,
    /// Its effect, and on which viewers.
    pub effect: &'static str,
}

impl Finding {
    fn new(found: impl Into<String>, effect: &'static str) -> Self {
        Self { found: found.into(), effect }
    }
}

/// Number of Gaussians that cannot all be alike by chance.
const MANY: usize = 20;
/// Deviation of a quat's length from 1 beyond rounding.
const QUAT_TOLERANCE: f32 = 0.01;
/// Distance from the origin, relative to the smallest scales, at which the rounding of `f32` shows:
/// half of the 24 bits.
const FAR: f32 = 4096.0;
/// Difference of correlations that decides the order of harmonics.
const CLEAR: f64 = 0.15;
/// Columns of INRIA's files before the harmonics of higher degrees, and after them.
const INRIA: [&[&str]; 2] = [
    &["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"],
    &["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"],
];

/// Axes that viewers assume of a file, which no format but glTF and USD names.
pub fn assumed_axes(path: &Path) -> &'static str {
    match format_of(path) {
        _ if glb::is_gltf(path) => "y up, z to the front, as glTF says",
        Ok(Format::Spz) => "not named; viewers assume y up, z to the front",
        _ => "not named; viewers assume y down, z to the back, as in INRIA's files",
    }
}

/// Up direction that viewers assume of a file without cameras ([`assumed_axes`]).
pub fn assumed_up(path: &Path) -> [f64; 3] {
    let is_y_up = glb::is_gltf(path) || matches!(format_of(path), Ok(Format::Spz));
    [0.0, if is_y_up { 1.0 } else { -1.0 }, 0.0]
}

/// Findings on a file of Gaussians: PLY, `.spz`, `.splat` or glTF. Other files have none.
///
/// # Errors
///
/// Those of the file's reader, unless its numbers are only not finite.
pub fn lint(path: &Path) -> Result<Vec<Finding>> {
    if glb::is_gltf(path) {
        let scene = glb::read(Input::file(path))?;
        let mut findings: Vec<Finding> = scene.notes.iter().map(|note| Finding::new(note, "it is ignored")).collect();
        findings.extend(of_numbers(&scene.gaussians));
        return Ok(findings);
    }
    match format_of(path)? {
        Format::Ply => of_ply(path),
        Format::Splat => Ok(of_numbers(&splat::read(path)?.gaussians)),
        Format::Spz => {
            let mut findings = of_spz(path)?;
            findings.extend(of_numbers(&spz::read(path)?.gaussians));
            Ok(findings)
        }
    }
}

fn of_spz(path: &Path) -> Result<Vec<Finding>> {
    Ok(match spz::version(path)? {
        (4, _) => vec![Finding::new("it has version 4 of the format", "readers of versions 1 to 3 reject it")],
        (_, false) => vec![Finding::new("it is not compressed by gzip", "most readers reject it")],
        _ => Vec::new(),
    })
}

fn of_ply(path: &Path) -> Result<Vec<Finding>> {
    let header = header_of(path)?;
    let mut findings = if header.is_empty() { Vec::new() } else { of_header(&header) };
    let numbers = match gaussian_ply::numbers(path) {
        Ok(numbers) => numbers,
        // Readers refuse damaged files; findings on headers explain why.
        Err(_) if !findings.is_empty() => return Ok(findings),
        Err(error) => return Err(error),
    };
    if !numbers.is_compressed {
        findings.extend(of_columns(&header, numbers.gaussians.layout, numbers.is_relightable));
        findings.extend(of_normals(&header, numbers.has_normals));
    }
    findings.extend(of_numbers(&numbers.gaussians));
    Ok(findings)
}

/// Bytes of a header, to the end of the line `end_header`.
fn header_of(path: &Path) -> Result<Vec<u8>> {
    const END: &[u8] = b"end_header";
    let mut start = Vec::new();
    within::open(path)?.take(PLY_HEADER_MAX).read_to_end(&mut start).map_err(Error::reading(path))?;
    // Without an end there is no header.
    let Some(end) = start.windows(END.len()).position(|word| word == END) else { return Ok(Vec::new()) };
    let line = start[end..].iter().position(|byte| *byte == b'\n').unwrap_or(0);
    start.truncate(end + line);
    Ok(start)
}

fn of_header(header: &[u8]) -> Vec<Finding> {
    let text = String::from_utf8_lossy(header);
    let mut findings = Vec::new();
    let has = |word: &str| text.lines().any(|line| line.split_whitespace().next() == Some(word));
    if header.contains(&b'\r') {
        findings.push(Finding::new(
            "lines of its header end in CR LF",
            "viewers that look for \"end_header\\n\", as most in JavaScript, fail or read all numbers one byte off",
        ));
    }
    if ["comment", "obj_info"].into_iter().any(has) {
        findings.push(Finding::new(
            "its header has comments",
            "loaders that expect the vertex count in the third line fail, as spz's before October 2025 and spz-js; \
             specula export --upright writes none",
        ));
    }
    if !header.is_ascii() {
        findings.push(Finding::new(
            "its header has characters beyond ASCII",
            "loaders that decode fewer bytes than characters read all numbers off",
        ));
    }
    if !text.lines().any(|line| line.trim() == "format binary_little_endian 1.0") {
        findings.push(Finding::new(
            "it is not binary with the lowest byte first",
            "most viewers of Gaussians, as INRIA's and antimatter15's, read no other encoding",
        ));
    }
    findings
}

/// Names and types of the columns of the vertices.
fn columns_of(header: &[u8]) -> Vec<(String, String)> {
    let text = String::from_utf8_lossy(header).into_owned();
    let vertex = text.lines().skip_while(|line| !line.starts_with("element vertex")).skip(1);
    let properties = vertex.take_while(|line| !line.starts_with("element"));
    let column = |line: &str| {
        let mut words = line.split_whitespace();
        let is_property = words.next() == Some("property");
        let kind = words.next()?.to_owned();
        Some((words.next_back()?.to_owned(), kind)).filter(|_| is_property)
    };
    properties.filter_map(column).collect()
}

fn of_columns(header: &[u8], layout: Layout, is_relightable: bool) -> Vec<Finding> {
    let columns = columns_of(header);
    let mut findings = Vec::new();
    let others: Vec<&str> = columns
        .iter()
        .filter(|(_, kind)| !matches!(kind.as_str(), "float" | "float32"))
        .map(|(name, _)| name.as_str())
        .collect();
    if !others.is_empty() {
        findings.push(Finding::new(
            format!("columns are not float: {}", others.join(", ")),
            "viewers that read rows of floats, as INRIA's, show noise",
        ));
    }
    let rest = columns.iter().filter(|(name, _)| name.starts_with("f_rest_")).count();
    if !layout.is_shaded() && !matches!(rest, 0 | 9 | 24 | 45) {
        findings.push(Finding::new(
            format!("it has {rest} columns f_rest, of no degree"),
            "most viewers expect 0, 9, 24 or 45 and fail",
        ));
    }
    // Layouts with further attributes are for programs that look names up.
    if layout.is_shaded() || is_relightable {
        return findings;
    }
    let expected = INRIA[0].iter().map(|name| (*name).to_owned());
    let expected = expected.chain((0..rest).map(|k| format!("f_rest_{k}")));
    let expected: Vec<String> = expected.chain(INRIA[1].iter().map(|name| (*name).to_owned())).collect();
    if !columns.iter().map(|(name, _)| name).eq(&expected) {
        findings.push(Finding::new(
            "its columns are not those of INRIA's files in their order",
            "viewers that read rows by place, as INRIA's and older ones of Unity, show noise or refuse it",
        ));
    }
    findings
}

fn of_normals(header: &[u8], has_normals: bool) -> Option<Finding> {
    const EFFECT: &str = "programs that relight, as Houdini's and Blender's add-ons, guess them; others do not mind";
    let has_columns = columns_of(header).iter().any(|(name, _)| name == "nx");
    match (has_columns, has_normals) {
        (_, true) => None,
        (true, false) => Some(Finding::new("its normals are zero", EFFECT)),
        (false, false) => Some(Finding::new("it has no normals", EFFECT)),
    }
}

/// Findings on numbers, whatever their file.
fn of_numbers(gaussians: &Gaussians<Vec<f32>>) -> Vec<Finding> {
    let count = gaussians.count;
    let all = || 0..count;
    let number = |index: usize, plane: usize| gaussians.get::<1>(index, plane)[0];
    let scales = |index: usize| gaussians.get::<3>(index, LOG_SCALE);
    let mut findings = Vec::new();
    let mut add = |found: Vec<usize>, what: &str, effect: &'static str| {
        if let Some(first) = found.first() {
            let text = format!("{} of {count} Gaussians {what}, the first is number {first}", found.len());
            findings.push(Finding::new(text, effect));
        }
    };
    let planes = || 0..gaussians.layout.plane_count();
    let has_meaning = |plane: usize| plane == OPACITY || (LOG_SCALE..LOG_SCALE + 3).contains(&plane);
    let is_bad = |index: usize, plane: usize| {
        let number = number(index, plane);
        number.is_nan()
            || (number.is_infinite() && !has_meaning(plane))
            || (plane != OPACITY && number == f32::INFINITY)
    };
    add(
        all().filter(|index| planes().any(|plane| is_bad(*index, plane))).collect(),
        "have numbers that are not finite",
        "specula refuses the file; on GPUs such splats are black or vanish, and sorting may break",
    );
    add(
        all().filter(|index| scales(*index).contains(&f32::NEG_INFINITY)).collect(),
        "have scales of 0 (−∞)",
        "viewers draw them flat or not at all; compressors with a range for each chunk, as SuperSplat's, lose the chunk",
    );
    add(
        all().filter(|index| number(*index, OPACITY).is_infinite()).collect(),
        "have infinite logits of opacity",
        "viewers show them opaque or not at all; averages in editors become NaN",
    );
    let length = |index: usize| gaussians.get::<4>(index, QUAT).iter().map(|q| q * q).sum::<f32>().sqrt();
    add(
        all().filter(|index| length(*index) == 0.0).collect(),
        "have the rotation 0 0 0 0",
        "viewers divide by its length, and show nothing or NaN",
    );
    add(
        all().filter(|index| length(*index) > 0.0 && (length(*index) - 1.0).abs() > QUAT_TOLERANCE).collect(),
        "have quaternions that are not normalised",
        "INRIA's viewer, SuperSplat and specula normalise them; viewers that do not stretch the splats",
    );
    let is_share = |index: usize| (0.0..=1.0).contains(&number(index, OPACITY));
    if count >= MANY && all().all(is_share) {
        findings.push(Finding::new(
            "all opacities are from 0 to 1, probably not logits",
            "viewers apply the sigmoid, so that all splats are half transparent: a haze",
        ));
    }
    if count >= MANY && all().all(|index| scales(index).iter().all(|scale| *scale >= 0.0)) {
        findings.push(Finding::new(
            "all scales are above 0, probably lengths and not logarithms",
            "viewers exponentiate them: splats of meters fill the picture and may stall the GPU",
        ));
    }
    if let Some(extent) = far(gaussians) {
        findings.push(Finding::new(
            format!("positions are up to {extent:.0} from the origin"),
            "their rounding in 32 bits is wider than the splats, which jump; viewers with half floats show grids",
        ));
    }
    findings.extend(of_harmonics(gaussians));
    findings
}

/// Largest distance from the origin along an axis, if its rounding shows.
fn far(gaussians: &Gaussians<Vec<f32>>) -> Option<f32> {
    let positions = (MEAN..MEAN + 3).flat_map(|plane| gaussians.plane(plane));
    let extent = positions.filter(|x| x.is_finite()).fold(0.0_f32, |most, x| most.max(x.abs()));
    let mut scales: Vec<f32> = gaussians.plane(LOG_SCALE).filter(|scale| scale.is_finite()).collect();
    scales.sort_by(f32::total_cmp);
    let median = scales.get(scales.len() / 2)?.exp();
    (extent > FAR * FAR * median).then_some(extent)
}

/// Tests the order of harmonics above degree 0: the colours of a coefficient are alike, since most
/// changes with the view are of brightness.
fn of_harmonics(gaussians: &Gaussians<Vec<f32>>) -> Option<Finding> {
    let layout = gaussians.layout;
    let rest = layout.sh_count().checked_sub(1).filter(|rest| *rest > 0 && !layout.is_shaded())?;
    let plane = |coefficient: usize, color: usize| layout.sh_start() + 3 * (coefficient + 1) + color;
    // Place in INRIA's order: colour by colour.
    let of_place = |place: usize| plane(place % rest, place / rest);
    let as_read = (0..rest).map(|k| correlation(gaussians, plane(k, 0), plane(k, 1)));
    let interleaved = (0..rest).map(|k| correlation(gaussians, of_place(3 * k), of_place(3 * k + 1)));
    let mean = |sum: f64| sum / rest as f64;
    let [as_read, interleaved] = [mean(as_read.sum()), mean(interleaved.sum())];
    (gaussians.count >= MANY && interleaved > as_read + CLEAR).then(|| {
        Finding::new(
            "its harmonics seem to be in the order red, green, blue of each coefficient",
            "viewers read INRIA's order, colour by colour: hues shift with the view; f_rest must be transposed",
        )
    })
}

/// Correlation of two planes without their means subtracted; 0 for a plane of zeros.
fn correlation(gaussians: &Gaussians<Vec<f32>>, a: usize, b: usize) -> f64 {
    let sum = |a: usize, b: usize| -> f64 {
        gaussians.plane(a).zip(gaussians.plane(b)).map(|(a, b)| f64::from(a) * f64::from(b)).sum()
    };
    let lengths = (sum(a, a) * sum(b, b)).sqrt();
    if lengths > 0.0 { sum(a, b) / lengths } else { 0.0 }
}
