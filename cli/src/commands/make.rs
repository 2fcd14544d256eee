//! `specula make`: from a video or photographs to a page with a relit turntable, by the other
//! commands.

use crate::{
    args::{CaptureOptions, LENS, Make},
    commands::capture,
    dataset,
    failure::Failure,
    interrupt, output, progress, run_words,
    scene::read_env,
};
use serde_json::Value;
use specula_capture::{Finding, Outcome, command_text};
use specula_io::{checkpoint, dataset::LoadOptions, model_folder, picture};
use specula_report::made::{Figure, Format, Made};
use specula_scene::{
    OpenedModel,
    crop::Crop,
    dataset::{Dataset, has_files},
    orientation,
    text::shown,
};
use specula_train::view::View;
use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

/// Pictures of a turntable, and their longer edge in pixels.
const TURNTABLE: &str = "48";
const EDGE: u32 = 640;
/// Iterations of a quick training, of the default, and of the best.
const ITERATIONS: [u32; 3] = [2000, 7000, 30_000];
/// Longer edge of the pictures of a quick training, about.
const QUICK_EDGE: u32 = 400;
/// JPEG quality of the photograph.
const QUALITY: u8 = 88;
/// Record of the command line that made each file.
const RECORD: &str = "made.json";
/// Folder of the results of other options.
const BEFORE: &str = "before";

/// Runs the commands whose results are missing, and writes the page.
pub(crate) fn run(args: &Make) -> Result<(), Failure> {
    let folder = |name: &str| args.output.join(name);
    let model = folder("model");
    args.env.iter().try_for_each(|map| read_env(map, args.exposure).map(drop))?;
    capture::refuse_other_contents(&args.output)?;
    let mut commands = Commands::new(&args.output);
    let (data, cameras) = match own_cameras(args)? {
        Some(data) => (data.clone(), None),
        None => {
            let data = folder("data");
            let cameras = captured(args, &data, &model, &mut commands)?;
            (data, Some(cameras))
        }
    };
    let loaded = progress::silently(|| dataset::load(&data, &LoadOptions::default()))?;
    let mut findings = capture::findings(&data, &loaded)?;
    let mut drift = findings.iter_mut().find(|finding| finding.kind == Finding::EXPOSURE);
    if let Some(drift) = &mut drift {
        drift.remedy = "the training fits the colours of each (--exposure), but materials are less certain; lock \
                        exposure and white balance next time";
    }
    let has_drift = drift.is_some();
    let mut findings: Vec<String> = findings.iter().map(capture::sentence).collect();
    findings.iter().for_each(|finding| tracing::warn!("{finding}"));

    let iterations = ITERATIONS[match (args.quick, args.capture.best) {
        (true, _) => 0,
        (_, false) => 1,
        (_, true) => 2,
    }];
    let mut options = training_options(args, &loaded);
    options.extend(has_drift.then(|| "--exposure".to_owned()));
    commands.train(&data, &model, iterations, &options)?;
    let iterations = model_folder::latest_iteration(&model)?;
    commands.run(&["eval", &text(&model)])?;
    let size = size_of(&loaded);
    // Surroundings that no mask cuts out would reflect the object as a mirror.
    let is_cut_out = capture::material_options(&loaded).is_empty();
    let crop: &[&str] = if is_cut_out { &[] } else { &["--crop", "object"] };
    if !is_cut_out && !stands_on_a_plane(&model)? {
        findings.push(
            "no plane that the object stands on was found, so what is around it was not removed: masks cut it out \
             (--masks FOLDER), or relight with --crop X,Y,Z,RADIUS"
                .to_owned(),
        );
    }
    let mut lights: Vec<String> = args.sun.iter().flat_map(|sun| ["--sun".to_owned(), sun.to_string()]).collect();
    lights.extend((args.ground || !is_cut_out).then(|| "--ground".to_owned()));
    lights.extend((args.exposure != 0.0).then(|| format!("--exposure={}", args.exposure)));
    let common: Vec<&str> = crop.iter().copied().chain(lights.iter().map(String::as_str)).collect();
    let has_ffmpeg = specula_capture::has_ffmpeg();
    let mut figures: Vec<Figure> = photograph(&loaded).into_iter().collect();
    for (light, name) in args.env.iter().zip(names(&args.env)) {
        let (place, format) = match has_ffmpeg {
            true => (folder(&format!("{name}.mp4")), Format::Mp4),
            false => (folder(&format!("{name}-turntable")), Format::Png),
        };
        let file = if has_ffmpeg { place.clone() } else { place.join("turntable.png") };
        let (light, place) = (text(light), text(&place));
        let turntable = ["--turntable", TURNTABLE, "--size", &size, "-o", &place];
        let relight = ["relight", &text(&model), "--env", &light];
        commands.write(&file, &[&relight[..], &common, &turntable].concat())?;
        let bytes = fs::read(&file).map_err(|cause| specula_io::Error::Read { path: file.clone(), cause })?;
        let sun = if args.sun.is_empty() { "" } else { " and a sun" };
        figures.push(Figure { caption: format!("under {name}{sun}"), bytes, format });
    }
    let scene = folder("scene.html");
    let maps: Vec<String> = args.env.iter().map(|map| text(map)).collect();
    let (first, others) = maps.split_first().expect("there is a light");
    let offered = (!others.is_empty()).then_some("--page-env").into_iter().chain(others.iter().map(String::as_str));
    let offered: Vec<&str> = offered.collect();
    let export = ["export", &text(&model), "--no-error", "-o", &text(&scene)];
    commands.write(&scene, &[&export[..], &common, &["--env", first], &offered].concat())?;

    let mut facts: Vec<_> = cameras.map(|cameras| ["cameras".to_owned(), cameras]).into_iter().collect();
    facts.push(["iterations".into(), iterations.to_string()]);
    facts.extend(
        psnr_of(&model, iterations)
            .map(|psnr| ["PSNR of held-out pictures".into(), format!("{psnr:.2} dB (25 is fair, 30 good)")]),
    );
    let made = Made {
        title: output::stem(&args.output),
        figures,
        scene: Some("scene.html".into()),
        facts,
        findings,
        commands: commands.lines,
    };
    let page = folder("index.html");
    output::write_text(&page, &made.html()?)?;
    output::say(&format!("Page: {}", shown(&page)))?;
    let steps = [
        (args.sun.is_empty(), "the same command with --sun 30,45 adds a sun"),
        (!is_cut_out, "with masks (--masks FOLDER) only the object is trained and shown"),
        (iterations == ITERATIONS[0], "without --quick the model becomes sharper"),
    ];
    let steps = steps.into_iter().filter(|(is_open, _)| *is_open).map(|(_, step)| step.to_owned());
    let view = command_text(["specula", "view", &text(&model)]);
    progress::note_next(steps.chain([view]));
    Ok(())
}

/// The input, if it is a data set with cameras of its own.
///
/// # Errors
///
/// Options of a capture, which have no effect on it.
fn own_cameras(args: &Make) -> Result<Option<&PathBuf>, Failure> {
    let [input] = &args.inputs[..] else { return Ok(None) };
    let has_capture = args.output.join("data/capture.json").is_file();
    if !has_files(input) || has_capture {
        return Ok(None);
    }
    let CaptureOptions { frames, masks, mask_with, lens, colmap, best: _ } = &args.capture;
    let given = [
        ("--frames", frames.is_some()),
        ("--masks", masks.is_some()),
        ("--mask-with", mask_with.is_some()),
        ("--lens", lens != LENS),
        ("--colmap", colmap.is_some()),
    ];
    match given.into_iter().find(|(_, is_given)| *is_given) {
        Some((option, _)) => Err(Failure::Input(format!(
            "{option} has no effect on {input:?}, a data set with cameras, whose masks are in its folder masks; omit it, or \
             name the folder of its pictures to estimate cameras again"
        ))),
        None => {
            tracing::info!("{} has cameras, which are kept", shown(input));
            Ok(Some(input))
        }
    }
}

/// Estimates the cameras of the inputs; returns how many pictures have one.
fn captured(args: &Make, data: &Path, model: &Path, commands: &mut Commands) -> Result<String, Failure> {
    let line = capture_line(args, data);
    tracing::info!("{line}");
    let Outcome { registered, pictures, connected, has_other_masks } =
        capture::capture(&args.inputs, data, &args.capture)?;
    if 2 * registered < pictures {
        return Err(Failure::Input(format!(
            "only {registered} of {pictures} pictures have cameras, too few for a scene, though {connected} match others: \
             neighbouring pictures share too little; take more in between, or train on these: {}",
            command_text(["specula", "train", &text(data), "-m", &text(model)])
        )));
    }
    commands.lines.push(line);
    if has_other_masks {
        commands.set_aside("the masks are other ones")?;
    }
    Ok(format!("{registered} of {pictures} pictures"))
}

/// Command line of the capture.
fn capture_line(Make { inputs, capture, .. }: &Make, data: &Path) -> String {
    let mut words: Vec<String> = ["specula", "capture"].map(str::to_owned).into();
    words.extend(inputs.iter().map(|input| text(input)));
    words.extend(capture.masks.iter().flat_map(|masks| ["--masks".to_owned(), text(masks)]));
    words.extend(capture.mask_with.iter().flat_map(|command| ["--mask-with".to_owned(), command.clone()]));
    words.extend(capture.best.then(|| "--best".to_owned()));
    words.extend(["-o".to_owned(), text(data)]);
    command_text(words.iter().map(String::as_str))
}

/// Names of the turntables: those of the maps, with a number if one repeats.
fn names(maps: &[PathBuf]) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for map in maps {
        let stem = output::stem(map);
        let count = maps[..names.len()].iter().filter(|earlier| output::stem(earlier) == stem).count();
        names.push(if count == 0 { stem } else { format!("{stem}-{}", count + 1) });
    }
    names
}

/// The first picture of a data set, upright.
fn photograph(data: &Dataset) -> Option<Figure> {
    let view = data.test.first().or(data.train.first())?;
    let colors: Vec<u8> =
        view.rgba.as_chunks::<4>().0.iter().flat_map(|&[red, green, blue, _]| [red, green, blue]).collect();
    let picture = picture::RgbImage::from_raw(view.camera.width, view.camera.height, colors)?;
    let turns = data.orientation.as_ref().map_or(0, |found| view.camera.turns_upright(orientation::up(found)));
    let bytes = picture::to_jpeg(&picture::turned_clockwise(picture::within(&picture, EDGE), turns), QUALITY);
    Some(Figure { caption: "a photograph".into(), bytes, format: Format::Jpeg })
}

/// Whether the surface of a model has the plane that its object stands on.
fn stands_on_a_plane(model: &Path) -> Result<bool, Failure> {
    let mut opened = OpenedModel::open(model)?;
    opened.crop(Crop::Object)?;
    Ok(opened.crop == Some(Crop::Object))
}

/// Command lines that were run.
struct Commands {
    lines: Vec<String>,
    output: PathBuf,
    /// Record of the command line that made each file.
    record: PathBuf,
    made: BTreeMap<String, String>,
}

impl Commands {
    fn new(output: &Path) -> Self {
        let record = output.join(RECORD);
        let made = fs::read_to_string(&record).ok().and_then(|text| serde_json::from_str(&text).ok());
        Self { lines: Vec::new(), output: output.to_owned(), record, made: made.unwrap_or_default() }
    }

    /// Moves what was made before to a folder of its own, and says why.
    fn set_aside(&mut self, reason: &str) -> Result<(), Failure> {
        let output = &self.output;
        let below = |file: &String| Path::new(file).strip_prefix(output).ok()?.iter().next().map(PathBuf::from);
        let made = self.made.keys().filter_map(below);
        let names: BTreeSet<PathBuf> =
            ["model", "index.html", RECORD].into_iter().map(PathBuf::from).chain(made).collect();
        let mut old = names.into_iter().filter(|name| output.join(name).exists()).peekable();
        if old.peek().is_none() {
            return Ok(());
        }
        let places =
            (1..).map(|number| output.join(if number == 1 { BEFORE.into() } else { format!("{BEFORE}-{number}") }));
        let before = places.into_iter().find(|place| !place.exists()).expect("there is a free name");
        output::make_folder(&before)?;
        for name in old {
            let to = before.join(&name);
            fs::rename(output.join(name), &to).map_err(|cause| specula_io::Error::Write { path: to, cause })?;
        }
        self.made.clear();
        tracing::info!("{reason}: the earlier model and pages are in {}", shown(&before));
        Ok(())
    }

    fn save(&self) -> Result<(), Failure> {
        output::write_json(&self.record, &serde_json::json!(self.made))
    }

    fn run(&mut self, words: &[&str]) -> Result<(), Failure> {
        if interrupt::is_requested() {
            return Err(Failure::Interrupted("interrupted; the same command continues".into()));
        }
        let line = line_of(words);
        tracing::info!("{line}");
        self.lines.push(line);
        match run_words(["specula"].iter().chain(words).map(Into::into).collect()) {
            Err(Failure::Locked(_)) => Err(Failure::Locked(
                "another make or train is writing to this folder; wait until it ends, or use another -o".into(),
            )),
            Err(Failure::Interrupted(_)) => Err(Failure::Interrupted("interrupted; the same command continues".into())),
            done => done,
        }
    }

    /// Writes a file, unless this command has written it.
    fn write(&mut self, file: &Path, words: &[&str]) -> Result<(), Failure> {
        let (name, line) = (text(file), line_of(words));
        if file.is_file() && self.made.get(&name) == Some(&line) {
            self.lines.push(line);
            return Ok(());
        }
        self.run(words)?;
        self.made.insert(name, line);
        self.save()
    }

    /// Trains, or continues a training, unless the model is there. A model of other options is set
    /// aside, but a whole one of more iterations stays.
    fn train(&mut self, data: &Path, model: &Path, iterations: u32, options: &[String]) -> Result<(), Failure> {
        let name = text(model);
        // The folder may be named in another way than before.
        let is_model = |file: &String| Path::new(file).file_name() == model.file_name();
        let trained = self.made.iter().find(|(file, _)| is_model(file)).map(|(_, line)| line.clone());
        let latest = model_folder::latest_iteration(model).unwrap_or(0);
        let (count, data) = (iterations.to_string(), text(data));
        let tail = ["--eval", "--overwrite", "--iterations", &count];
        let tail: Vec<&str> = tail.into_iter().chain(options.iter().map(String::as_str)).collect();
        match Earlier::of(trained.as_deref(), &command_text(tail.iter().copied()), latest, iterations) {
            Earlier::Continues => {}
            Earlier::IsOther => self.set_aside("the training has other options")?,
            earlier => {
                if earlier == Earlier::IsFiner {
                    tracing::info!(
                        "the model of {latest} iterations stays; for another one use another folder with -o"
                    );
                }
                self.lines.extend(trained);
                return Ok(());
            }
        }
        // Turntables and the page are those of another model.
        self.made.clear();
        if checkpoint::path_in(model).is_file() {
            self.made.extend(trained.map(|line| (name.clone(), line)));
            self.save()?;
            return self.run(&["train", "-m", &name, "--resume"]);
        }
        let words = [&["train", &data, "-m", &name][..], &tail].concat();
        self.made.insert(name.clone(), line_of(&words));
        self.save()?;
        self.run(&words)
    }
}

/// Training that is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Earlier {
    /// It is the one that is asked for, and has ended.
    IsWhole,
    /// It has more iterations.
    IsFiner,
    /// It has other options, and is set aside.
    IsOther,
    /// It has not ended, or not begun.
    Continues,
}

impl Earlier {
    /// Training that was run by the command line `trained`, if that is known, as far as `latest`;
    /// `asked` is the end of the line that is asked for.
    fn of(trained: Option<&str>, asked: &str, latest: u32, iterations: u32) -> Self {
        match trained.is_some_and(|line| !line.ends_with(asked)) {
            true if latest > iterations => Self::IsFiner,
            true => Self::IsOther,
            false if latest >= iterations => Self::IsWhole,
            false => Self::Continues,
        }
    }
}

/// Options of the training.
fn training_options(args: &Make, data: &Dataset) -> Vec<String> {
    let distance = |factor: u32| (f64::from(data.width_max()) / f64::from(factor * QUICK_EDGE)).ln().abs();
    let factors = [1, 2, 4, 8].into_iter();
    let quick = factors.min_by(|one, other| distance(*one).total_cmp(&distance(*other))).expect("there are factors");
    let resolution = match (args.quick, args.capture.best) {
        (true, _) => quick.to_string(),
        (_, true) => "-1".into(),
        _ => "auto".into(),
    };
    let materials = capture::material_options(data);
    let surroundings = if materials.is_empty() { &[][..] } else { &["--background-points", "5000"] };
    let resolution = ["-r", &resolution];
    [&resolution[..], materials, surroundings].concat().into_iter().map(str::to_owned).collect()
}

/// Size of the turntable's pictures: the shape of an upright picture of the data set, with even
/// edges.
fn size_of(data: &Dataset) -> String {
    let found = data.orientation.as_ref();
    let upright = |view: &View| found.map_or(view.camera, |found| view.camera.upright(orientation::up(found)));
    let [width, height] = data.train.first().map(upright).map_or([4, 3], |camera| [camera.width, camera.height]);
    let longer = width.max(height).max(1);
    let edge = |edge: u32| (u64::from(edge) * u64::from(EDGE.min(longer)) / u64::from(longer)).max(2) as u32 & !1;
    format!("{},{}", edge(width), edge(height))
}

/// PSNR of a model, as its results have it.
fn psnr_of(model: &Path, iterations: u32) -> Option<f64> {
    let results: Value = serde_json::from_str(&fs::read_to_string(model.join("results.json")).ok()?).ok()?;
    results[model_folder::method_of(iterations)]["PSNR"].as_f64()
}

fn line_of(words: &[&str]) -> String {
    command_text(["specula"].iter().chain(words).copied())
}

fn text(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_training_of_other_options_is_not_taken_for_the_one_that_is_asked_for() {
        let line = |tail: &str| format!("specula train data -m out/vase/model {tail}");
        let [quick, full] = ["--iterations 2000 -r 2", "--iterations 7000 -r auto"];
        let earlier = |trained: Option<&str>, asked: &str, latest: u32| {
            let iterations = if asked == quick { 2000 } else { 7000 };
            Earlier::of(trained.map(line).as_deref(), asked, latest, iterations)
        };
        assert_eq!(earlier(None, quick, 0), Earlier::Continues);
        assert_eq!(earlier(Some(quick), quick, 0), Earlier::Continues);
        assert_eq!(earlier(Some(quick), quick, 2000), Earlier::IsWhole);
        assert_eq!(earlier(Some(quick), full, 2000), Earlier::IsOther);
        assert_eq!(earlier(Some(full), quick, 0), Earlier::IsOther, "interrupted");
        assert_eq!(earlier(Some(full), quick, 7000), Earlier::IsFiner);
        assert_eq!(earlier(None, quick, 7000), Earlier::IsWhole, "of an earlier version");
    }
}
