//! `specula info`: the contents of a model, a PLY file or a data set.

use crate::{
    args::Info,
    dataset,
    failure::Failure,
    output,
    scene::{self, nonfinite_reasons},
};
use serde_json::{Map, Value, json};
use specula_core::{
    activation::sigmoid,
    cubemap::FACE_COUNT,
    cull::CullStats,
    expose::expose,
    plan::{Plan, Unlit},
    rules::{Channels, RenderRules, channel},
    scene::{DIFFUSE, Environment, Gaussians, LOG_SCALE, Layout, MEAN, NORMAL_RESIDUAL_1, OPACITY, ROUGHNESS, TINT},
    vector::Vec3,
};
use specula_io::{
    Error,
    dataset::LoadOptions,
    model_folder::ModelInfo,
    points_ply::{self, PointCloud},
};
use specula_scene::{OpenedModel, Scene, dataset::Dataset, number::group_digits};
use specula_train::view::View;
use std::path::Path;

/// Prints a report of the contents.
pub(crate) fn run(args: &Info) -> Result<(), Failure> {
    let report = if specula_io::dataset::is_dataset(&args.path) {
        of_dataset(&args.path)?
    } else {
        match scene::open(&args.path, None) {
            Ok(opened) => of_scene(&args.path, &opened)?,
            Err(Failure::File(Error::MissingProperty { path, property, layout })) => {
                let points = points_ply::read(&path);
                of_points(&path, &points.map_err(|_| Error::MissingProperty { path: path.clone(), property, layout })?)
            }
            Err(failure) => return Err(failure),
        }
    };
    if args.json { output::say_json(&report.json.into()) } else { output::say(&report.text()) }
}

/// Facts as text and as JSON.
#[derive(Debug)]
struct Report {
    title: String,
    lines: Vec<(&'static str, String)>,
    json: Map<String, Value>,
}

impl Report {
    fn new(kind: &str, path: &Path) -> Self {
        let mut report = Self { title: format!("{}: {kind}", path.display()), lines: Vec::new(), json: Map::new() };
        report.json.insert("kind".into(), kind.into());
        report
    }

    fn add(&mut self, name: &'static str, words: String, value: Value) {
        self.add_as(name, &name.replace(' ', "_"), words, value);
    }

    /// Adds a fact under another key in JSON.
    fn add_as(&mut self, name: &'static str, key: &str, words: String, value: Value) {
        self.lines.push((name, words));
        self.json.insert(key.to_owned(), value);
    }

    fn text(&self) -> String {
        let lines = self.lines.iter().map(|(name, words)| format!("\n  {name:<16} {words}"));
        format!("{}{}", self.title, lines.collect::<String>())
    }
}

fn of_scene(path: &Path, opened: &OpenedModel) -> Result<Report, Failure> {
    let scene = &opened.scene;
    let layout = scene.gaussians.layout;
    let kind = if layout.is_shaded() { "shaded Gaussians" } else { "plain Gaussians" };
    let mut report = Report::new(kind, path);
    if let Some(iteration) = opened.iteration {
        report.add("iteration", iteration.to_string(), iteration.into());
    }
    if let Some(info) = &opened.info {
        report.add("training", training(info), json!(info));
    }
    add_exposures(&mut report, opened)?;
    report.add("Gaussians", group_digits(scene.gaussians.count), scene.gaussians.count.into());
    let degree = layout.sh_degree;
    report.add("harmonics", degree.map_or("none".into(), |degree| format!("of degree {degree}")), json!(degree));
    if layout.is_shaded() {
        let [shading, axis, prefilter] = scene.shading_model.words();
        let words = format!("{shading}; normals from axis: {axis}; light filtered: {prefilter}");
        report.add("shading", words, json!({"form": shading, "axis": axis, "prefilter": prefilter}));
    }
    add_ranges(&mut report, &scene.gaussians);
    add_light(&mut report, scene);
    let stats = CullStats::of(&scene.gaussians, None);
    let words = nonfinite_reasons(&stats).map_or("none".into(), |of_which| format!("{of_which}; they are not drawn"));
    report.add("not finite", words, stats.nonfinite().into());
    add_plan(&mut report, scene);
    Ok(report)
}

/// Adds the learned exposures, as the brightness in which each photograph shows a grey of 0.5.
fn add_exposures(report: &mut Report, opened: &OpenedModel) -> Result<(), Failure> {
    let Some(exposures) = opened.exposures()? else { return Ok(()) };
    let grey = Vec3::splat(0.5);
    let brightness = exposures.values().map(|own| expose(own, grey, 1.0).to_array().iter().sum::<f32>() / 3.0 / 0.5);
    if let Some(range) = Range::of(brightness) {
        let words = format!("of {} photographs, brightness {}", group_digits(exposures.len()), range.words());
        report.add("exposure", words, json!({"photographs": exposures.len(), "brightness": range.json()}));
    }
    Ok(())
}

fn training(info: &ModelInfo) -> String {
    let seconds = info.rest.get("seconds").and_then(Value::as_f64);
    let seconds = seconds.map_or(String::new(), |seconds| format!(", {seconds:.0} s"));
    let size = if info.downscale > 1 { format!(" at 1/{} of their size", info.downscale) } else { String::new() };
    format!(
        "profile {}, {} iterations, seed {}{seconds}, on {}{size}",
        info.profile, info.iterations, info.seed, info.source_path
    )
}

/// Minimum, median and maximum.
#[derive(Clone, Copy, Debug)]
struct Range([f32; 3]);

impl Range {
    fn of(numbers: impl Iterator<Item = f32>) -> Option<Self> {
        let mut sorted: Vec<f32> = numbers.collect();
        sorted.sort_by(f32::total_cmp);
        Some(Self([*sorted.first()?, sorted[sorted.len() / 2], *sorted.last()?]))
    }

    fn words(self) -> String {
        let [least, median, most] = self.0;
        format!("{} … {}, median {}", number(least), number(most), number(median))
    }

    fn json(self) -> Value {
        let [least, median, most] = self.0;
        json!({"min": least, "median": median, "max": most})
    }
}

/// Number with three significant digits.
fn number(x: f32) -> String {
    let size = x.abs();
    if x == 0.0 {
        "0".into()
    } else if (0.001..10_000.0).contains(&size) {
        let decimals = (2 - size.log10().floor() as i32).clamp(0, 6) as usize;
        format!("{x:.decimals$}")
    } else {
        format!("{x:.2e}")
    }
}

fn add_ranges(report: &mut Report, gaussians: &Gaussians<Vec<f32>>) {
    let mut add = |name: &'static str, first: usize, count: usize, activate: fn(f32) -> f32| {
        let numbers = (first..first + count).flat_map(|plane| gaussians.plane(plane)).map(activate);
        if let Some(range) = Range::of(numbers) {
            report.add(name, range.words(), range.json());
        }
    };
    add("position x", MEAN, 1, |x| x);
    add("position y", MEAN + 1, 1, |y| y);
    add("position z", MEAN + 2, 1, |z| z);
    add("scale", LOG_SCALE, 3, f32::exp);
    add("opacity", OPACITY, 1, sigmoid);
    if gaussians.layout.is_shaded() {
        add("diffuse, raw", DIFFUSE, 3, |raw| raw);
        add("tint", TINT, 3, sigmoid);
        add("roughness", ROUGHNESS, 1, sigmoid);
        add("normal residual", NORMAL_RESIDUAL_1, 6, f32::abs);
    }
}

fn add_light(report: &mut Report, scene: &Scene) {
    if !scene.gaussians.layout.is_shaded() {
        return;
    }
    let Some(Environment { resolution, values, .. }) = &scene.light else {
        report.add("light", "none; name one with --env where it is needed".into(), Value::Null);
        return;
    };
    let range = Range::of(values.iter().copied()).unwrap_or(Range([0.0; 3]));
    let words = format!("six faces of {resolution} × {resolution} texels, radiance {}", range.words());
    report.add("light", words, json!({"resolution": resolution, "radiance": range.json()}));
}

/// Adds the data that rendering colours skips, and the savings.
fn add_plan(report: &mut Report, scene: &Scene) {
    let plan = scene.plan(Channels::Color);
    let layout = scene.gaussians.layout;
    let left_out = left_out(&plan, layout);
    let words = if left_out.is_empty() { "nothing".into() } else { left_out.join("; ") };
    report.add_as("skipped", "left_out", words, json!(left_out));

    let [read, read_in_full] = [plan.rules, plan.full].map(|rules| size_of::<f32>() * rules.numbers_read(layout));
    let words = format!("{read} of {read_in_full} bytes of each Gaussian");
    report.add("reads", words, json!({"bytes": read, "in_full": read_in_full}));
    let [blended, blended_in_full] = [plan.rules, plan.full].map(|rules| rules.blended(layout).count());
    let words = format!("{blended} of {blended_in_full} numbers for each pixel of a splat");
    report.add("blends", words, json!({"numbers": blended, "in_full": blended_in_full}));
    add_filtered(report, scene, &plan);
}

/// Adds the number of texels of light that are filtered.
fn add_filtered(report: &mut Report, scene: &Scene, plan: &Plan) {
    let Some(levels) = scene.levels() else { return };
    let of_rules = |rules: RenderRules| {
        let numbered = levels.as_slice().iter().enumerate();
        let kept = numbered.filter(move |(number, _)| rules.is_lit && rules.levels.contains(*number));
        kept.fold((0, 0), |(count, texels), (_, level)| (count + 1, texels + FACE_COUNT * level.resolution.pow(2)))
    };
    let [(kept, filtered), (count, in_full)] = [plan.rules, plan.full].map(of_rules);
    let words =
        format!("{} of {} texels of light, {kept} of {count} levels", group_digits(filtered), group_digits(in_full));
    report.add("filters", words, json!({"texels": filtered, "in_full": in_full, "levels": kept}));
}

/// Data that a plan skips.
fn left_out(plan: &Plan, layout: Layout) -> Vec<String> {
    const LAYERS: [(usize, &str); 5] = [
        (channel::NORMAL, "blended normals"),
        (channel::DEPTH, "depth"),
        (channel::RESIDUAL_SIZE, "size of normal residuals"),
        (channel::TINT, "blended tint"),
        (channel::ROUGHNESS, "blended roughness"),
    ];
    let Plan { rules, full, unlit } = plan;
    let mut names = Vec::new();
    if let Some(unlit) = unlit.filter(|_| layout.is_shaded()) {
        names.push(format!("light, as {}", because(unlit)));
    }
    match rules.sh_degree {
        None if full.sh_degree.is_some() => names.push("harmonics, which are zero".into()),
        Some(degree) if rules.sh_degree < full.sh_degree => names.push(format!("harmonics above degree {degree}")),
        _ => {}
    }
    if layout.is_shaded() && !rules.normal_residuals {
        names.push("normal residuals, which are zero".into());
    }
    let [lean, whole] = [rules, full].map(|rules| rules.blended(layout));
    let is_missing = |channel: usize| whole.index_of(channel).is_some() && lean.index_of(channel).is_none();
    names.extend(LAYERS.iter().filter(|(channel, _)| is_missing(*channel)).map(|(_, name)| (*name).to_owned()));
    names
}

fn because(unlit: Unlit) -> &'static str {
    match unlit {
        Unlit::NothingShaded => "no shaded Gaussian is drawn",
        Unlit::Dark => "there is none",
        Unlit::LostInRounding => "what is reflected is lost in rounding",
    }
}

fn of_points(path: &Path, points: &PointCloud) -> Report {
    let mut report = Report::new("points without Gaussians' attributes", path);
    add_points(&mut report, &points.positions);
    report
}

fn add_points(report: &mut Report, positions: &[[f32; 3]]) {
    report.add("points", group_digits(positions.len()), positions.len().into());
    for (axis, name) in ["position x", "position y", "position z"].into_iter().enumerate() {
        if let Some(range) = Range::of(positions.iter().map(|position| position[axis])) {
            report.add(name, range.words(), range.json());
        }
    }
}

fn of_dataset(path: &Path) -> Result<Report, Failure> {
    let data = dataset::load(path, &LoadOptions::default())?;
    let mut report = Report::new("data set", path);
    add_views(&mut report, &data);
    match &data.points {
        Some(points) => add_points(&mut report, &points.iter().map(|point| point.position).collect::<Vec<_>>()),
        None => report.add("points", "none; training starts from random points".into(), Value::Null),
    }
    Ok(report)
}

fn add_views(report: &mut Report, data: &Dataset) {
    let Dataset { train, test, .. } = data;
    report.add("training views", group_digits(train.len()), train.len().into());
    report.add("test views", group_digits(test.len()), test.len().into());
    let all = || train.iter().chain(test);

    let mut sizes: Vec<[u32; 2]> = all().map(|view| [view.camera.width, view.camera.height]).collect();
    sizes.sort_unstable();
    sizes.dedup();
    let words: Vec<String> = sizes.iter().take(4).map(|[width, height]| format!("{width} × {height}")).collect();
    let more = if sizes.len() > 4 { format!(" and {} other sizes", sizes.len() - 4) } else { String::new() };
    report.add("pixels", words.join(", ") + &more, json!(sizes));

    let count = |has: fn(&View) -> bool| all().filter(|view| has(view)).count();
    let transparent = count(View::has_alpha);
    let with_normals = count(|view| view.normals.is_some());
    report.add("transparent", format!("{transparent} of {} pictures", all().count()), transparent.into());
    report.add("true normals", format!("{with_normals} views"), with_normals.into());
    if let Some(range) = Range::of(all().map(|view| view.camera.focal_px[0])) {
        report.add("focal length", format!("{} pixels", range.words()), range.json());
    }
    if let Some(range) = Range::of(all().map(|view| view.camera.position.length())) {
        report.add("camera distance", format!("{} from the origin", range.words()), range.json());
    }
}
