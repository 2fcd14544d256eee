//! The steps of a capture. Each is skipped if its result is there.

use crate::{
    colmap::{Event, Quality, SCRIPT, Step, Tool},
    diagnosis,
    error::{Error, Result},
    frames::selected,
    groups::{self, Key},
    inputs::Input,
    masks,
    pairs::{EXHAUSTIVE, FEW, Sequence},
    process::{CommandLine, Monitor},
    record::{Attempt, Record, Request, VideoRecord, real},
    video,
};
use core::fmt;
use specula_io::{reconstruction::Reconstruction, whole_file};
use std::{
    collections::{BTreeMap, HashMap},
    fs,
    path::{Path, PathBuf},
};

/// Frames of each second of a video, and limits of their number.
const FRAMES_PER_SECOND: f64 = 3.0;
const FRAMES: [f64; 2] = [40.0, 150.0];
/// Pictures of a second attempt for each of the first.
const MORE_FRAMES: f64 = 1.5;
/// Share of pictures with a camera below which a second attempt is made.
const REGISTERED_MIN: f64 = 0.7;
/// Share of pictures with a camera below which all pairs are matched.
const REGISTERED_WELL: f64 = 0.95;
/// Smallest number of points of a model.
const POINTS_MIN: usize = 100;
/// Smallest number of pictures.
const PICTURES_MIN: usize = 3;
/// Largest number of pictures of which a second attempt matches all pairs.
const SECOND_EXHAUSTIVE: usize = 300;

/// Options of a capture.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Videos, pictures and folders of pictures.
    pub inputs: Vec<PathBuf>,
    /// Folder of the data set.
    pub output: PathBuf,
    /// Number of frames of each video; by default three a second, 40 to 150.
    pub frames: Option<usize>,
    /// Folder of masks.
    pub masks: Option<PathBuf>,
    /// Command that writes masks of the folder `{images}` to the folder `{masks}`.
    pub mask_with: Option<String>,
    /// Lens model of COLMAP.
    pub lens: String,
    /// More and finer features: slower.
    pub is_best: bool,
    /// Program of COLMAP, or a Python with pycolmap.
    pub colmap: Option<PathBuf>,
}

/// Result of a capture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Outcome {
    /// Number of pictures.
    pub pictures: usize,
    /// Number of pictures with a camera.
    pub registered: usize,
    /// Number of pictures that match others.
    pub connected: usize,
    /// Whether the masks replace other ones, or none, of an earlier call.
    pub has_other_masks: bool,
}

/// Checks inputs without reading them.
///
/// # Errors
///
/// A path that does not exist or has neither video nor pictures, or pictures that are not read.
pub fn check(inputs: &[PathBuf]) -> Result<()> {
    inputs.iter().try_for_each(|path| Input::list(path).map(drop))
}

/// Makes a data set: `images`, `masks`, `sparse/0` and `capture.json`, with intermediate files in
/// the folder `capture`. Continues where an earlier call with the same options ended; other masks
/// keep its cameras.
///
/// # Errors
///
/// Unusable input, a missing program, a folder of another capture; no cameras, with the cause; an
/// interruption.
pub fn capture(options: &Options, monitor: &dyn Monitor) -> Result<Outcome> {
    let request = Request {
        inputs: real(&options.inputs),
        frames: options.frames,
        masks: options.masks.clone(),
        mask_with: options.mask_with.clone(),
        lens: options.lens.clone(),
        is_best: options.is_best,
    };
    let record = Record::open(&options.output, &request)?;
    let inputs = options.inputs.iter().map(|path| Input::list(path)).collect::<Result<Vec<_>>>()?.concat();
    let tool = Tool::find(options.colmap.as_deref())?;
    let work = options.output.join("capture");
    let images = options.output.join("images");
    [&work, &images].into_iter().try_for_each(|folder| fs::create_dir_all(folder).map_err(Error::writing(folder)))?;
    let script = work.join("pycolmap-step.py");
    whole_file::write_bytes(&script, SCRIPT.as_bytes())?;
    tracing::info!("cameras are estimated by {tool}");
    let mut run = Run { options, monitor, tool, work, images, script, record };
    run.record.tool = run.tool.to_string();
    run.all(&inputs)
}

/// Matching of an attempt, which names its files and steps.
#[derive(Clone, Copy, Debug)]
enum Matching {
    First(usize),
    /// All pairs, after those of a sequence registered too few pictures.
    AllPairs(usize),
}

impl Matching {
    fn attempt(self) -> usize {
        match self {
            Self::First(number) | Self::AllPairs(number) => number,
        }
    }
}

impl fmt::Display for Matching {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::First(number) => write!(f, "{number}"),
            Self::AllPairs(number) => write!(f, "{number}-all"),
        }
    }
}

struct Run<'a> {
    options: &'a Options,
    monitor: &'a dyn Monitor,
    tool: Tool,
    work: PathBuf,
    images: PathBuf,
    script: PathBuf,
    record: Record,
}

/// Pairs that are matched by one run of COLMAP.
const PAIRS: usize = 60;

/// Number of pairs of pictures.
const fn all_pairs(pictures: usize) -> usize {
    pictures * pictures.saturating_sub(1) / 2
}

impl Run<'_> {
    fn all(&mut self, inputs: &[Input]) -> Result<Outcome> {
        let has_other_masks = self.change_masks()?;
        if self.options.is_best && !self.record.request.is_best {
            self.forget_attempts();
            self.record.request.is_best = true;
            self.record.save()?;
        }
        let first = Quality { size: 1600, features: 4096, lens: self.options.lens.clone() };
        let best = Quality { size: 2400, features: 8192, ..first.clone() };
        let is_best = self.options.is_best;
        self.attempt(1, inputs, if is_best { &best } else { &first })?;
        if !self.is_good(1) {
            let is_masked = self.record.attempts[0].is_masked;
            let masks = if is_masked { ", outside of masks as well" } else { "" };
            let more = if is_best { "with lower thresholds" } else { "with more features and pairs" };
            tracing::warn!("{}; trying again {more}{masks}", self.summary(1));
            self.attempt(2, inputs, &best)?;
        }
        let attempts = self.record.attempts.iter().enumerate();
        let (index, attempt) = attempts.rev().max_by_key(|(_, attempt)| attempt.registered()).expect("there is one");
        let outcome = Outcome {
            pictures: attempt.pictures,
            registered: attempt.registered(),
            connected: attempt.connected as usize,
            has_other_masks,
        };
        let Some(model) = attempt.largest.clone() else {
            return Err(Error::NoCameras(diagnosis::of_failure(attempt.pictures, attempt.connected)));
        };
        let sparse = self.options.output.join("sparse/0");
        if self.record.used_attempt != Some(index + 1) || !sparse.is_dir() {
            copy_model(&model, &sparse)?;
            self.record.used_attempt = Some(index + 1);
            self.record.save()?;
        }
        Ok(outcome)
    }

    fn summary(&self, number: usize) -> String {
        let attempt = &self.record.attempts[number - 1];
        format!("{} of {} pictures have a camera", attempt.registered(), attempt.pictures)
    }

    /// Whether the largest model of an attempt has enough of the pictures.
    fn is_good(&self, number: usize) -> bool {
        let attempt = &self.record.attempts[number - 1];
        let registered = attempt.registered();
        registered > 0 && registered as f64 >= REGISTERED_MIN * attempt.pictures as f64
    }

    /// Replaces the masks of an earlier call if this one has others. Its cameras are kept, unless
    /// they depend on masks. Returns whether there were pictures to mask.
    fn change_masks(&mut self) -> Result<bool> {
        let asked = (self.options.masks.clone(), self.options.mask_with.clone());
        let request = &mut self.record.request;
        if asked == (request.masks.clone(), request.mask_with.clone()) {
            return Ok(false);
        }
        (request.masks, request.mask_with) = (None, None);
        self.record.done.retain(|step| step != "masks");
        // Other masks in the data set are those of the caller.
        let given = self.options.masks.as_deref().and_then(|masks| fs::canonicalize(masks).ok());
        if self.record.masks.take().is_some() {
            let folders = [self.work.join("masks"), self.options.output.join("masks")];
            for folder in folders.into_iter().filter(|folder| given.is_none() || fs::canonicalize(folder).ok() != given)
            {
                match fs::remove_dir_all(&folder) {
                    Err(cause) if folder.exists() => return Err(Error::writing(&folder)(cause)),
                    _ => {}
                }
            }
        }
        self.record.save()?;
        let listed = if self.record.attempts.is_empty() { Vec::new() } else { Input::list(&self.images)? };
        let names: Vec<PathBuf> = listed.into_iter().flat_map(Input::into_pictures).collect();
        let masks = if names.is_empty() { None } else { self.masks(&names)? };
        let is_within = masks.is_some_and(|masks| masks::surroundings_stand_still(&self.images, &masks, &names));
        if self.record.attempts.first().is_none_or(|attempt| attempt.is_masked != is_within) {
            self.forget_attempts();
        }
        (self.record.request.masks, self.record.request.mask_with) = asked;
        self.record.save()?;
        Ok(!names.is_empty())
    }

    /// Forgets the reconstructions, with their features and matches.
    fn forget_attempts(&mut self) {
        self.record.forget_attempts();
        for number in 1..=2 {
            let _ = fs::remove_file(self.database(number));
        }
    }

    /// Database of an attempt.
    fn database(&self, number: usize) -> PathBuf {
        self.work.join(format!("database-{number}.db"))
    }

    /// Makes a reconstruction with features of a quality.
    fn attempt(&mut self, number: usize, inputs: &[Input], quality: &Quality) -> Result<()> {
        if self.record.is_done(&format!("attempt {number}")) && self.record.attempts.len() >= number {
            return Ok(());
        }
        let names = self.pictures(number, inputs)?;
        // Surroundings tell cameras unless they stand still, as around a turntable.
        let masks = self.masks(&names)?.filter(|_| number == 1);
        let masks = masks.filter(|masks| masks::surroundings_stand_still(&self.images, masks, &names));
        if masks.is_some() {
            tracing::info!(
                "the surroundings stand still or have no texture, so cameras are estimated within the masks"
            );
        }
        let mut attempt =
            Attempt { pictures: names.len(), size: quality.size, features: quality.features, ..Attempt::default() };
        attempt.is_masked = masks.is_some();
        let first = self.record.attempts.first().filter(|first| number > 1 && first.has_features_of(&attempt)).cloned();
        let database = self.database(if first.is_some() { 1 } else { number });
        match &first {
            Some(Attempt { shared_cameras, own_cameras, .. }) => {
                (attempt.shared_cameras, attempt.own_cameras) = (*shared_cameras, *own_cameras);
            }
            None => self.features(number, &database, &names, masks.as_deref(), quality, &mut attempt)?,
        }
        let most = if number == 1 { EXHAUSTIVE } else { SECOND_EXHAUSTIVE };
        let is_sparse = number == 1 && !self.options.is_best && names.len() > FEW;
        let is_video = matches!(inputs, [Input::Video(_)]);
        let sequence = match names.len() > most {
            true if !is_sparse || !is_video => Some(Sequence::DENSE),
            _ => is_sparse.then_some(Sequence::SPARSE),
        };
        let matching = Matching::First(number);
        match first.filter(|first| (first.pairs, sequence) == (all_pairs(names.len()), None)) {
            Some(Attempt { matching, pairs, .. }) => (attempt.matching, attempt.pairs) = (matching, pairs),
            None => self.matches(matching, &database, &names, sequence, &mut attempt)?,
        }
        self.map(matching, &database, names.len(), &mut attempt)?;
        let is_well = attempt.registered() as f64 >= REGISTERED_WELL * names.len() as f64;
        if sequence == Some(Sequence::SPARSE) && names.len() <= most && !is_well {
            tracing::info!("{} of {} pictures have a camera; matching all pairs", attempt.registered(), names.len());
            let all = Matching::AllPairs(number);
            self.matches(all, &database, &names, None, &mut attempt)?;
            self.map(all, &database, names.len(), &mut attempt)?;
        }
        self.record.attempts.truncate(number - 1);
        self.record.attempts.push(attempt);
        self.record.finish(format!("attempt {number}"))
    }

    /// Pictures of all inputs, by name: those of a second attempt include more frames.
    fn pictures(&mut self, number: usize, inputs: &[Input]) -> Result<Vec<PathBuf>> {
        let mut names = Vec::new();
        let mut stems: HashMap<String, usize> = HashMap::new();
        for input in inputs {
            let stem = input.path().file_stem().unwrap_or_default().to_string_lossy().into_owned();
            let count = stems.entry(stem.clone()).and_modify(|count| *count += 1).or_insert(1);
            let below = match (inputs.len(), *count) {
                (1, _) => PathBuf::new(),
                (_, 1) => PathBuf::from(stem),
                (_, count) => PathBuf::from(format!("{stem}-{count}")),
            };
            match input {
                Input::Pictures { folder, paths } => names.extend(self.copies(folder, paths, &below)?),
                Input::Video(path) => names.extend(self.frames(number, path, &below)?),
            }
        }
        self.record.skipped.clear();
        let names = self.distinct(names)?;
        if names.len() < PICTURES_MIN {
            return Err(Error::Input(format!(
                "too few different pictures for cameras, {}; take 50 to 150 around the object, or a video of 20 to 60 seconds",
                names.len()
            )));
        }
        self.record.save()?;
        Ok(names)
    }

    /// Copies pictures that are not in the data set.
    fn copies(&self, folder: &Path, paths: &[PathBuf], below: &Path) -> Result<Vec<PathBuf>> {
        let is_in_place = fs::canonicalize(folder)
            .is_ok_and(|folder| fs::canonicalize(&self.images).is_ok_and(|images| images == folder));
        if is_in_place {
            return Ok(paths.to_vec());
        }
        for path in paths {
            let (from, to) = (folder.join(path), self.images.join(below).join(path));
            let len = |path: &Path| fs::metadata(path).map(|data| data.len()).ok();
            if len(&from) == len(&to) {
                continue;
            }
            let parent = to.parent().unwrap_or(&self.images);
            fs::create_dir_all(parent).map_err(Error::writing(parent))?;
            fs::copy(&from, &to).map_err(Error::writing(&to))?;
            self.refuse_interruption()?;
        }
        Ok(paths.iter().map(|path| below.join(path)).collect())
    }

    /// Selects and extracts frames of a video.
    fn frames(&mut self, number: usize, path: &Path, below: &Path) -> Result<Vec<PathBuf>> {
        let facts = video::Facts::of(path)?;
        let place = match self.record.videos.iter().position(|video| video.path == path) {
            Some(place) => place,
            None => {
                if facts.is_hdr {
                    tracing::warn!(
                        "{path:?} is an HDR video, whose colours look flat; record in SDR for exact colours"
                    );
                }
                let expected = facts.seconds * facts.rate / facts.step() as f64;
                self.monitor.begin("looking", (expected.ceil() as u64).max(1));
                let candidates = video::candidates(path, &facts, self.monitor);
                self.monitor.end();
                self.record.videos.push(VideoRecord {
                    path: path.into(),
                    candidates: candidates?,
                    selected: Vec::new(),
                });
                self.record.videos.len() - 1
            }
        };
        let candidates = &self.record.videos[place].candidates;
        let seconds = candidates.len() as f64 * facts.step() as f64 / facts.rate;
        let usual = (FRAMES_PER_SECOND * seconds).clamp(FRAMES[0], FRAMES[1]);
        let more = if number > 1 { MORE_FRAMES } else { 1.0 };
        let count = self.options.frames.unwrap_or((more * usual) as usize);
        let chosen: Vec<u64> = selected(candidates, count).into_iter().map(|index| candidates[index].frame).collect();
        tracing::info!("selected {} of {} candidate frames of {path:?}", chosen.len(), candidates.len());
        let to = self.images.join(below);
        fs::create_dir_all(&to).map_err(Error::writing(&to))?;
        let line = video::extract(path, &chosen, &to, &self.work.join("ffmpeg.log"), self.monitor)?;
        self.record.ran(line.text());
        let written = chosen.iter().copied().filter(|frame| to.join(video::name_of(*frame)).is_file());
        let names = written.map(|frame| below.join(video::name_of(frame))).collect();
        self.record.videos[place].selected = chosen;
        Ok(names)
    }

    /// Readable pictures, of copies only the first.
    fn distinct(&mut self, names: Vec<PathBuf>) -> Result<Vec<PathBuf>> {
        let mut seen: HashMap<(u32, usize), PathBuf> = HashMap::new();
        let mut kept = Vec::new();
        for name in names {
            let path = self.images.join(&name);
            let bytes = fs::read(&path).map_err(|cause| Error::Input(format!("{path:?} cannot be read: {cause}")))?;
            let key = (crc32fast::hash(&bytes), bytes.len());
            if let Err(error) = image::image_dimensions(&path) {
                self.record.skipped.push(format!("{name:?} cannot be read: {error}"));
            } else if let Some(first) = seen.get(&key) {
                self.record.skipped.push(format!("{name:?} is a copy of {first:?}"));
            } else {
                seen.insert(key, name.clone());
                kept.push(name);
            }
            self.refuse_interruption()?;
        }
        if let Some(first) = self.record.skipped.first() {
            tracing::warn!(
                "pictures skipped: {}, such as: {first}; capture.json lists them",
                self.record.skipped.len()
            );
        }
        Ok(kept)
    }

    /// Folder of masks, if there are any.
    fn masks(&mut self, names: &[PathBuf]) -> Result<Option<PathBuf>> {
        let given = match (&self.options.masks, &self.options.mask_with) {
            (Some(masks), _) => masks.clone(),
            (None, Some(command)) => {
                let made = self.work.join("masks");
                if !self.record.is_done("masks") {
                    fs::create_dir_all(&made).map_err(Error::writing(&made))?;
                    let line = shell(command, &self.images, &made);
                    self.record.ran(line.text());
                    line.run(&self.work.join("masks.log"), self.monitor, |_| ())?;
                    self.record.finish("masks".into())?;
                }
                made
            }
            (None, None) => return Ok(None),
        };
        let folder = self.options.output.join("masks");
        self.record.masks = Some(masks::copy(&given, &self.images, names, &folder)?);
        Ok(Some(folder))
    }

    fn features(
        &mut self,
        number: usize,
        database: &Path,
        names: &[PathBuf],
        masks: Option<&Path>,
        quality: &Quality,
        attempt: &mut Attempt,
    ) -> Result<()> {
        let keys: Vec<_> = names.iter().map(|name| (name.clone(), Key::of(&self.images, name))).collect();
        let (shared, own) = groups::of_keys(&keys);
        (attempt.shared_cameras, attempt.own_cameras) = (shared.len(), own.len());
        let lists = shared.iter().map(|list| (true, list)).chain((!own.is_empty()).then_some((false, &own)));
        let lists: Vec<(bool, Vec<PathBuf>)> = lists.map(|(is_shared, list)| (is_shared, list.clone())).collect();
        let mut failed: BTreeMap<String, u64> = BTreeMap::new();
        self.monitor.begin("features", names.len() as u64);
        let mut before = 0;
        for (index, (is_shared, list)) in lists.iter().enumerate() {
            let step_name = format!("features {number}.{}", index + 1);
            let log = self.work.join(format!("features-{number}-{}.log", index + 1));
            if !self.record.is_done(&step_name) {
                let file = self.work.join(format!("pictures-{number}-{}.txt", index + 1));
                write_lines(&file, list.iter().map(|name| slashed(name)))?;
                // Pictures of an interrupted step have the first camera.
                let has_some = fs::read_to_string(&log).is_ok_and(|text| text.contains("Features:"));
                let camera = (index == 0 && *is_shared && has_some).then_some(1);
                let images = self.images.clone();
                let step =
                    Step::Features { images: &images, masks, list: &file, is_shared: *is_shared, camera, quality };
                let monitor = self.monitor;
                let result = self.run(database, &step, &log, |event| match event {
                    Event::Processed(done) => monitor.done(before + done),
                    Event::Failed(error) => *failed.entry(error).or_default() += 1,
                    _ => {}
                });
                if result.is_err() {
                    monitor.end();
                }
                result?;
                self.record.finish(step_name)?;
            }
            before += list.len() as u64;
            self.monitor.done(before);
        }
        self.monitor.end();
        for (error, count) in failed {
            tracing::warn!("{count} pictures have no features: {error}");
        }
        Ok(())
    }

    /// Matches the pairs of a sequence, or all pairs.
    fn matches(
        &mut self,
        matching: Matching,
        database: &Path,
        names: &[PathBuf],
        sequence: Option<Sequence>,
        attempt: &mut Attempt,
    ) -> Result<()> {
        let count = names.len();
        let pairs = sequence.map(|sequence| sequence.pairs(count));
        let all = all_pairs(count);
        attempt.matching = if pairs.is_some() { "neighbours and loops" } else { "all pairs" }.into();
        attempt.pairs = pairs.as_ref().map_or(all, Vec::len);
        let step_name = format!("matches {matching}");
        if self.record.is_done(&step_name) {
            return Ok(());
        }
        let total = attempt.pairs as u64;
        let monitor = self.monitor;
        monitor.begin("matching", total);
        let result = match pairs {
            None => self.match_all(matching, database, count, total),
            Some(pairs) => self.match_pairs(matching, database, names, &pairs),
        };
        monitor.end();
        result?;
        self.record.finish(step_name)
    }

    /// Matches all pairs.
    fn match_all(&mut self, matching: Matching, database: &Path, count: usize, total: u64) -> Result<()> {
        let monitor = self.monitor;
        let step = Step::MatchAll { block: (count / 8).clamp(4, 50) };
        let log = self.work.join(format!("matches-{matching}.log"));
        self.run(database, &step, &log, |event| {
            if let Event::Block([row, rows, column, columns]) = event {
                let blocks = (rows * columns).max(1);
                monitor.done(total * ((row.max(1) - 1) * columns + column.max(1) - 1).min(blocks) / blocks);
            }
        })
    }

    /// Matches a list of pairs, in parts, since COLMAP does not tell how far it is within a list.
    fn match_pairs(
        &mut self,
        matching: Matching,
        database: &Path,
        names: &[PathBuf],
        pairs: &[[usize; 2]],
    ) -> Result<()> {
        for (index, part) in pairs.chunks(PAIRS).enumerate() {
            let number = index + 1;
            let file = self.work.join(format!("pairs-{matching}-{number}.txt"));
            let line = |pair: &[usize; 2]| pair.map(|index| slashed(&names[index])).join(" ");
            write_lines(&file, part.iter().map(line))?;
            let log = self.work.join(format!("matches-{matching}-{number}.log"));
            self.run(database, &Step::MatchPairs { pairs: &file }, &log, |_| {})?;
            self.monitor.done((index * PAIRS + part.len()) as u64);
        }
        Ok(())
    }

    fn map(&mut self, matching: Matching, database: &Path, count: usize, attempt: &mut Attempt) -> Result<()> {
        let output = self.work.join(format!("models-{matching}"));
        let step_name = format!("models {matching}");
        if !self.record.is_done(&step_name) {
            // Models of an interrupted step are incomplete.
            let _ = fs::remove_dir_all(&output);
            fs::create_dir_all(&output).map_err(Error::writing(&output))?;
            let images = self.images.clone();
            let step = Step::Map { images: &images, output: &output, is_relaxed: matching.attempt() > 1 };
            let monitor = self.monitor;
            monitor.begin("cameras", count as u64);
            let log = self.work.join(format!("models-{matching}.log"));
            let mut registered: u64 = 0;
            let result = self.run(database, &step, &log, |event| match event {
                Event::Connected(pictures) => attempt.connected = pictures,
                Event::Started => registered = 2,
                Event::Registered => {
                    registered += 1;
                    monitor.done(registered.min(count as u64));
                }
                _ => {}
            });
            monitor.end();
            match result {
                // The program fails if it finds no model.
                Err(Error::Program { message, .. }) if message.contains("create sparse model") => {}
                other => other?,
            }
            self.record.finish(step_name)?;
        }
        let folders = fs::read_dir(&output).into_iter().flatten().flatten().map(|entry| entry.path());
        let mut models: Vec<(usize, PathBuf)> = Vec::new();
        for folder in folders {
            let model = Reconstruction::of_model(&folder)?;
            // Of a camera that only turned, COLMAP keeps a few pictures without points.
            let is_usable =
                |model: &Reconstruction| model.pictures.len() >= PICTURES_MIN && model.tracks.len() >= POINTS_MIN;
            if let Some(model) = model.filter(is_usable) {
                models.push((model.pictures.len(), folder));
            }
        }
        models.sort_by(|(one, a), (other, b)| other.cmp(one).then(a.cmp(b)));
        attempt.models = models.iter().map(|(count, _)| *count).collect();
        attempt.largest = models.first().map(|(_, folder)| folder.clone());
        Ok(())
    }

    /// Runs a step of COLMAP and records its command line.
    fn run(&mut self, database: &Path, step: &Step<'_>, log: &Path, mut on_event: impl FnMut(Event)) -> Result<()> {
        let line = self.tool.command(database, &self.script, step);
        self.record.ran(line.text());
        self.record.save()?;
        line.run(log, self.monitor, |line| Event::of(line).into_iter().for_each(&mut on_event))
    }

    fn refuse_interruption(&self) -> Result<()> {
        if self.monitor.is_interrupted() { Err(Error::Interrupted) } else { Ok(()) }
    }
}

/// Copies a model to `sparse/0`; an earlier one is replaced.
fn copy_model(from: &Path, to: &Path) -> Result<()> {
    fs::create_dir_all(to).map_err(Error::writing(to))?;
    for name in ["cameras.bin", "images.bin", "points3D.bin"] {
        let bytes = fs::read(from.join(name));
        let bytes = bytes.map_err(|cause| Error::Input(format!("{:?} cannot be read: {cause}", from.join(name))))?;
        whole_file::write_bytes(&to.join(name), &bytes)?;
    }
    Ok(())
}

fn write_lines(path: &Path, lines: impl Iterator<Item = String>) -> Result<()> {
    let text: String = lines.map(|line| line + "\n").collect();
    Ok(whole_file::write_bytes(path, text.as_bytes())?)
}

/// Name of a picture, as COLMAP writes it.
fn slashed(name: &Path) -> String {
    name.iter().map(|part| part.to_string_lossy()).collect::<Vec<_>>().join("/")
}

/// Command line of the command that makes masks. Without places for its folders they follow it.
fn shell(command: &str, images: &Path, masks: &Path) -> CommandLine {
    let folder = |path: &Path| format!("\"{}\"", path.display());
    let mut text = command.to_owned();
    if !command.contains("{images}") {
        text += " {images} {masks}";
    }
    let text = text.replace("{images}", &folder(images)).replace("{masks}", &folder(masks));
    if cfg!(windows) { CommandLine::new("cmd", &["/C", &text]) } else { CommandLine::new("sh", &["-c", &text]) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_of_masks_gets_its_folders() {
        let text = |command: &str| shell(command, Path::new("d/images"), Path::new("d/m")).arguments.pop().unwrap();
        assert_eq!(text("rembg p -om {images} {masks}"), "rembg p -om \"d/images\" \"d/m\"");
        assert_eq!(text("tool"), "tool \"d/images\" \"d/m\"");
    }

    #[test]
    fn names_have_slashes() {
        assert_eq!(slashed(&Path::new("a").join("b.jpg")), "a/b.jpg");
    }
}
