//! Contents of a model, a PLY file or a data set, as text and as JSON: counts, ranges of
//! attributes, light, and the data that rendering colours skips.

use crate::error::Result;
use serde_json::{Map, Value, json};
use specula_core::{
    activation::sigmoid,
    cubemap::FACE_COUNT,
    cull::CullStats,
    expose::expose,
    plan::{Plan, Unlit},
    rules::{Channels, RenderRules, channel},
    scene::{DIFFUSE, Gaussians, LOG_SCALE, Layout, MEAN, NORMAL_RESIDUAL_1, OPACITY, ROUGHNESS, TINT},
    vector::Vec3,
};
use specula_io::{lint::Finding, model_folder::ModelInfo, origin, points_ply::PointCloud};
use specula_scene::{
    OpenedModel, Scene,
    dataset::{Dataset, points_of},
    environment::{concentration_text, lights_of_lamps, radiance},
    light_turn::LightTurn,
    number::group_digits,
    orientation,
    text::{printable, shown},
};
use specula_train::{start::Point, view::View};
use std::path::Path;

/// Facts as text and as JSON.
#[derive(Clone, Debug)]
pub struct Contents {
    title: String,
    lines: Vec<(&'static str, String)>,
    json: Map<String, Value>,
}

impl Contents {
    fn new(kind: &str, path: &Path) -> Self {
        let mut contents = Self { title: format!("{}: {kind}", shown(path)), lines: Vec::new(), json: Map::new() };
        contents.json.insert("kind".into(), kind.into());
        contents
    }

    /// Contents of a model's folder or of a PLY file.
    ///
    /// # Errors
    ///
    /// Learned exposures that cannot be read.
    pub fn of_model(path: &Path, opened: &OpenedModel) -> Result<Self> {
        let scene = &opened.scene;
        let layout = scene.gaussians.layout;
        let kind = if layout.is_shaded() { "shaded Gaussians" } else { "plain Gaussians" };
        let mut contents = Self::new(kind, path);
        if let Some(iteration) = opened.iteration {
            contents.add("iteration", iteration.to_string(), iteration.into());
        }
        if let Some(info) = &opened.info {
            contents.add("training", training(info), json!(info));
        }
        contents.add_materials(layout);
        contents.add_light_names(opened)?;
        contents.add_exposures(opened)?;
        contents.add_origin(opened.origin);
        contents.add("Gaussians", group_digits(scene.gaussians.count), scene.gaussians.count.into());
        let degree = layout.sh_degree;
        contents.add("harmonics", degree.map_or("none".into(), |degree| format!("of degree {degree}")), json!(degree));
        if layout.is_shaded() {
            let [shading, axis, prefilter, _] = scene.shading_model.names();
            let text = format!("{shading}; normals from axis: {axis}; light filtered: {prefilter}");
            contents.add("shading", text, json!({"form": shading, "axis": axis, "prefilter": prefilter}));
        }
        contents.add_ranges(&scene.gaussians);
        contents.add_light(scene);
        contents.add_near_field(scene);
        let reasons = scene.nonfinite_reasons();
        let text = reasons.map_or("none".into(), |reasons| format!("{reasons}; they are not rendered"));
        contents.add("not finite", text, CullStats::of(&scene.gaussians, None).nonfinite().into());
        contents.add_plan(scene);
        Ok(contents)
    }

    /// Contents of a PLY file with points that have no attributes of Gaussians.
    pub fn of_points(path: &Path, points: &PointCloud) -> Self {
        let mut contents = Self::new("points without Gaussians' attributes", path);
        contents.add_points(&points_of(points));
        contents
    }

    /// Contents of a data set.
    pub fn of_dataset(path: &Path, data: &Dataset) -> Self {
        let mut contents = Self::new("data set", path);
        contents.add("cameras", data.report.source.clone(), data.report.source.as_str().into());
        contents.add_views(data);
        contents.add_origin(data.origin);
        match &data.points {
            Some(points) => contents.add_points(points),
            None => contents.add("points", "none; training starts from random points".into(), Value::Null),
        }
        let left_out = &data.report.left_out;
        let text = if left_out.is_empty() { "nothing".into() } else { left_out.join("; ") };
        contents.add("not used", text, json!(left_out));
        contents
    }

    /// Adds the axes that viewers assume of a file, and its faults and oddities.
    pub fn add_findings(&mut self, axes: &str, findings: &[Finding]) {
        self.add("axes", axes.to_owned(), axes.into());
        let of_each = findings.iter().map(|Finding { found, effect }| json!({"found": found, "effect": effect}));
        let text = |finding: &Finding| format!("{}: {}", finding.found, finding.effect);
        self.add_each("unusual", findings.iter().map(text), "findings", of_each.collect());
    }

    /// Adds a line of text for each fact of a kind, and all of them as JSON.
    pub fn add_each(&mut self, name: &'static str, lines: impl Iterator<Item = String>, key: &str, value: Value) {
        self.lines.extend(lines.map(|text| (name, text)));
        self.json.insert(key.into(), value);
    }

    /// Text: a title, then a line for each fact.
    pub fn text(&self) -> String {
        let lines = self.lines.iter().map(|(name, text)| format!("\n  {name:<16} {}", printable(text)));
        format!("{}{}", self.title, lines.collect::<String>())
    }

    /// JSON object with a key for each fact.
    pub fn to_json(&self) -> Value {
        self.json.clone().into()
    }

    /// Appends a remark to the text of a fact, if the fact exists.
    pub fn remark(&mut self, name: &str, remark: &str) {
        self.lines.iter_mut().filter(|(other, _)| *other == name).for_each(|(_, text)| text.push_str(remark));
    }

    /// Adds a fact as text and as JSON.
    pub fn add(&mut self, name: &'static str, text: String, value: Value) {
        self.add_as(name, &name.replace(' ', "_"), text, value);
    }

    /// Adds a fact under another key in JSON.
    fn add_as(&mut self, name: &'static str, key: &str, text: String, value: Value) {
        self.lines.push((name, text));
        self.json.insert(key.to_owned(), value);
    }

    /// Adds the origin, if it is not that of the data set's world.
    fn add_origin(&mut self, origin: [f64; 3]) {
        if !origin::is_zero(&origin) {
            let [x, y, z] = origin;
            self.add("origin", format!("{x} {y} {z}, in the world of the data set"), json!(origin));
        }
    }

    /// Adds the learned exposures, as the brightness in which each photograph shows a grey of 0.5.
    fn add_exposures(&mut self, opened: &OpenedModel) -> Result<()> {
        let Some(exposures) = opened.exposures()? else { return Ok(()) };
        let grey = Vec3::splat(0.5);
        let brightness =
            exposures.values().map(|exposure| expose(exposure, grey, 1.0).to_array().iter().sum::<f32>() / 3.0 / 0.5);
        if let Some(range) = Range::of(brightness) {
            let text = format!("of {} photographs, brightness {}", group_digits(exposures.len()), range.text());
            self.add("exposure", text, json!({"photographs": exposures.len(), "brightness": range.json()}));
        }
        Ok(())
    }

    fn add_ranges(&mut self, gaussians: &Gaussians<Vec<f32>>) {
        let mut add = |name: &'static str, first: usize, count: usize, activate: fn(f32) -> f32| {
            let numbers = (first..first + count).flat_map(|plane| gaussians.plane(plane)).map(activate);
            if let Some(range) = Range::of(numbers) {
                self.add(name, range.text(), range.json());
            }
        };
        add("position x", MEAN, 1, |x| x);
        add("position y", MEAN + 1, 1, |y| y);
        add("position z", MEAN + 2, 1, |z| z);
        add("scale", LOG_SCALE, 3, f32::exp);
        add("opacity", OPACITY, 1, sigmoid);
        if let Some(plane) = gaussians.layout.filter_plane() {
            add("filter", plane, 1, |deviation| deviation);
        }
        if gaussians.layout.is_shaded() {
            add("raw diffuse", DIFFUSE, 3, |raw| raw);
            add("tint", TINT, 3, sigmoid);
            add("roughness", ROUGHNESS, 1, sigmoid);
            add("normal residual", NORMAL_RESIDUAL_1, 6, f32::abs);
        }
    }

    fn add_light(&mut self, scene: &Scene) {
        if !scene.gaussians.layout.is_shaded() {
            return;
        }
        let Some(light) = &scene.light else {
            self.add("light", "none".into(), Value::Null);
            return;
        };
        let resolution = light.resolution;
        let range = Range::of(radiance(light).into_iter()).unwrap_or(Range([0.0; 3]));
        let text = format!("six faces of {resolution} × {resolution} texels, radiance {}", range.text());
        let mut facts = json!({"resolution": resolution, "radiance": range.json()});
        if light.is_network() {
            facts["weights"] = light.values.len().into();
            let weights = group_digits(light.values.len());
            return self.add("light", format!("network of {weights} weights, in {text}"), facts);
        }
        self.add("light", text, facts);
    }

    /// Adds the names of the lights of groups of pictures, if there are several, with the number
    /// of training pictures of each.
    fn add_light_names(&mut self, opened: &OpenedModel) -> Result<()> {
        let names = opened.info.as_ref().map(ModelInfo::light_names).unwrap_or_default();
        if names.is_empty() {
            return Ok(());
        }
        let cameras = opened.lit_cameras()?;
        let trained = &cameras[opened.test_views().unwrap_or_default().min(cameras.len())..];
        let count = |light: usize| trained.iter().filter(|(_, camera)| camera.light as usize == light).count();
        let text = |(light, name)| format!("{} {name:?}, of {} training pictures", light + 1, count(light));
        let lights: Vec<String> = names.iter().enumerate().map(text).collect();
        self.add("lights", lights.join("; "), json!(names));
        self.add_lamps(opened, &names);
        self.add_turns(opened, &names)
    }

    /// Adds the lights of small lamps, if others are soft.
    fn add_lamps(&mut self, opened: &OpenedModel, names: &[&str]) {
        let found = lights_of_lamps(opened.scene.light.iter().chain(&opened.scene.other_lights));
        if found.is_empty() {
            return;
        }
        let text = |(light, share): &(usize, f64)| format!("{:?} has {}", names[*light], concentration_text(*share));
        let texts: Vec<String> = found.iter().map(text).collect();
        let facts: Vec<Value> =
            found.iter().map(|(light, share)| json!({"light": names[*light], "concentration": share})).collect();
        self.add("lamps", texts.join("; "), facts.into());
    }

    /// Adds the turns of lights that are like the first one.
    fn add_turns(&mut self, opened: &OpenedModel, names: &[&str]) -> Result<()> {
        let Some(first) = &opened.scene.light else { return Ok(()) };
        let up = orientation::up(&opened.orientation(None)?);
        let (mut texts, mut facts) = (Vec::new(), Vec::new());
        for (light, name) in opened.scene.other_lights.iter().zip(&names[1..]) {
            let found = LightTurn::find(first, light, up).filter(LightTurn::is_clear);
            let Some(LightTurn { degrees, correlation, second }) = found else { continue };
            texts.push(format!(
                "{name:?} is like {:?}, with the object turned by {degrees:.1}° (correlation {correlation:.2}, next {second:.2})",
                names[0]
            ));
            facts.push(json!({"light": name, "degrees": degrees, "correlation": correlation, "second": second}));
        }
        if !texts.is_empty() {
            self.add("turned", texts.join("; "), facts.into());
        }
        Ok(())
    }

    /// Adds the surface that reflected rays may hit, if there is one.
    fn add_near_field(&mut self, scene: &Scene) {
        let Some(near_field) = &scene.near_field else { return };
        let [nodes, triangles, vertices] = near_field.sizes();
        let text = format!("{} triangles that reflected rays may hit", group_digits(triangles));
        self.add("near field", text, json!({"nodes": nodes, "triangles": triangles, "vertices": vertices}));
    }

    /// Adds what another light changes.
    fn add_materials(&mut self, layout: Layout) {
        let text = match (layout.is_physical, layout.is_shaded()) {
            (true, _) => "physical: environments, suns and lamps light them",
            (false, true) => "none: another environment changes reflections only (train with --relightable)",
            (false, false) => "none: colours contain the light",
        };
        self.add("materials", text.to_owned(), layout.is_physical.into());
    }

    /// Adds the data that rendering colours skips, and the savings.
    fn add_plan(&mut self, scene: &Scene) {
        let plan = scene.plan(Channels::Color);
        let layout = scene.gaussians.layout;
        let left_out = left_out(&plan, layout);
        let text = if left_out.is_empty() { "nothing".into() } else { left_out.join("; ") };
        self.add_as("skipped", "left_out", text, json!(left_out));

        let [read, read_in_full] = [plan.rules, plan.full].map(|rules| size_of::<f32>() * rules.numbers_read(layout));
        let text = format!("{read} of {read_in_full} bytes of each Gaussian");
        self.add("reads", text, json!({"bytes": read, "in_full": read_in_full}));
        let [blended, blended_in_full] = [plan.rules, plan.full].map(|rules| rules.blended(layout).count());
        let text = format!("{blended} of {blended_in_full} numbers for each pixel of a splat");
        self.add("blends", text, json!({"numbers": blended, "in_full": blended_in_full}));
        self.add_filtered(scene, &plan);
    }

    /// Adds the number of texels of light that are filtered.
    fn add_filtered(&mut self, scene: &Scene, plan: &Plan) {
        let Some(levels) = scene.levels() else { return };
        let levels_and_texels = |rules: RenderRules| {
            let numbered = levels.as_slice().iter().enumerate();
            let kept = numbered.filter(move |(number, _)| rules.is_lit && rules.levels.contains(*number));
            kept.fold((0, 0), |(count, texels), (_, level)| (count + 1, texels + FACE_COUNT * level.resolution.pow(2)))
        };
        let [(kept, filtered), (count, in_full)] = [plan.rules, plan.full].map(levels_and_texels);
        let text = format!(
            "{} of {} texels of light, {kept} of {count} levels",
            group_digits(filtered),
            group_digits(in_full)
        );
        self.add("filters", text, json!({"texels": filtered, "in_full": in_full, "levels": kept}));
    }

    fn add_points(&mut self, points: &[Point]) {
        self.add("points", group_digits(points.len()), points.len().into());
        for (axis, name) in ["position x", "position y", "position z"].into_iter().enumerate() {
            if let Some(range) = Range::of(points.iter().map(|point| point.position[axis])) {
                self.add(name, range.text(), range.json());
            }
        }
    }

    fn add_views(&mut self, data: &Dataset) {
        let Dataset { train, test, report, .. } = data;
        self.add("training views", group_digits(train.len()), train.len().into());
        self.add("test views", group_digits(test.len()), test.len().into());
        self.add("held out", report.held_out.clone(), report.held_out.as_str().into());
        let all = || train.iter().chain(test);

        let mut sizes: Vec<[u32; 2]> = all().map(|view| [view.camera.width, view.camera.height]).collect();
        sizes.sort_unstable();
        sizes.dedup();
        let text: Vec<String> = sizes.iter().take(4).map(|[width, height]| format!("{width} × {height}")).collect();
        let more = if sizes.len() > 4 { format!(" and {} other sizes", sizes.len() - 4) } else { String::new() };
        self.add("pixels", text.join(", ") + &more, json!(sizes));

        let count = |has: fn(&View) -> bool| all().filter(|view| has(view)).count();
        let transparent = count(View::has_alpha);
        let with_normals = count(|view| view.normals.is_some());
        self.add("transparent", format!("{transparent} of {} pictures", all().count()), transparent.into());
        self.add("masks", format!("{} of {} pictures", report.masks, all().count()), report.masks.into());
        self.add("true normals", format!("{with_normals} views"), with_normals.into());
        if let Some(range) = Range::of(all().map(|view| view.camera.focal_px[0])) {
            self.add("focal length", format!("{} pixels", range.text()), range.json());
        }
        if let Some(range) = Range::of(all().map(|view| view.camera.position.length())) {
            self.add("camera distance", format!("{} from the origin", range.text()), range.json());
        }
    }
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

    fn text(self) -> String {
        let [min, median, max] = self.0;
        format!("{} … {}, median {}", number(min), number(max), number(median))
    }

    fn json(self) -> Value {
        let [min, median, max] = self.0;
        json!({"min": min, "median": median, "max": max})
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
        names.push(format!("light, as {}", unlit_reason(unlit)));
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

fn unlit_reason(unlit: Unlit) -> &'static str {
    match unlit {
        Unlit::NothingShaded => "no shaded Gaussian is rendered",
        Unlit::Dark => "there is none",
        Unlit::LostInRounding => "the reflection is lost in rounding",
    }
}
