//! Files that hold anything at all: every reader of `io` ends with a result or an error, within its
//! bound of memory. `scripts/fuzz` looks for longer, with other seeds.

#[path = "readers/shapes.rs"]
mod shapes;

use proptest::{
    collection::vec,
    prelude::*,
    sample::{Index, select},
    test_runner::TestRunner,
};
use specula_accuracy::lpips::Network;
use specula_core::{
    expose::IDENTITY,
    light_network::{WEIGHT_COUNT, initial_weight},
    near_field::NearField,
    random,
    scene::{Environment, Gaussians, Layout, RadianceActivation, len_of_values},
    state::{AdamMoments, ExposureState, SceneState, Statistics, TrainingState},
};
use specula_io::{
    Input,
    budget::NETWORK as NETWORK_BUDGET,
    cameras,
    checkpoint::{self, Checkpoint, Facts},
    dataset, gaussian_ply,
    glb::{self, Attribute, Shading},
    latlong::{self, LatLong},
    light_table::LightTable,
    lint, model_folder, picture,
    pixels::Pixels,
    points_ply::{self, PointCloud},
    splat, spz,
};
use specula_tests::strategies::as_many_as_wanted;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use std::{
    alloc::System,
    fs,
    path::Path,
    sync::{Mutex, MutexGuard, PoisonError},
};
use tempfile::TempDir;

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// One test at a time, because all of them share one count of memory.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// Files that are tried by each test, unless the environment says otherwise, and the seed of noise.
const CASES: u32 = 300;
const SEED: u64 = 1;
/// Longest file of random bytes, and longest beginning of a file that is tried.
const LEN_MAX: usize = 4096;
/// Bytes that any reader may take for each byte of its file, all that it ever takes added up.
const BYTES_FOR_EACH: usize = 64;
/// Bytes that a reader of text and tables may take besides.
const BYTES_OF_TABLES: usize = 1 << 21;
/// Bytes that a reader of pictures may take besides: pixels unpacked from any file, in several
/// kinds of numbers.
const BYTES_OF_PICTURES: usize = 1 << 30;
/// Bytes that reading a network may take besides: the pictures of its check, layer by layer.
const BYTES_OF_NETWORKS: usize = 1 << 27;

/// Words where numbers stand, and numbers where counts and sizes are.
const WORDS: [&str; 10] =
    ["-1", "0", "2147483648", "4294967295", "18446744073709551616", "1e400", "NaN", "null", "\"", "[[[["];
const NUMBERS: [u32; 7] = [0, 1, u32::MAX, i32::MAX as u32, i32::MIN as u32, 0x7fc0_0000, 0x7f80_0000];

/// A reader, and a file that it reads without complaint.
struct Target {
    /// The file's place in a folder.
    file: &'static str,
    /// Makes the file, and all that belongs to it.
    make: fn(&Path),
    /// Reads the file; an error as its sentence.
    read: fn(&Path) -> Result<(), String>,
    /// Bytes that may be taken whatever the file's size.
    memory: usize,
    /// Whether a file that has lost its end is always refused.
    needs_its_end: bool,
}

/// A folder in which one file is wrong.
struct Place<'a> {
    target: &'a Target,
    folder: TempDir,
    right: Vec<u8>,
    _turn: MutexGuard<'static, ()>,
}

impl<'a> Place<'a> {
    fn new(target: &'a Target) -> Self {
        // A test that failed holds nothing that the next one needs.
        let turn = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
        let folder = tempfile::tempdir().unwrap();
        (target.make)(folder.path());
        let right = fs::read(folder.path().join(target.file)).unwrap();
        let place = Self { target, folder, right, _turn: turn };
        place.read(&place.right).expect("the file is right");
        place
    }

    /// Outcome of reading a file with other bytes, in little memory.
    fn read(&self, bytes: &[u8]) -> Result<(), String> {
        fs::write(self.folder.path().join(self.target.file), bytes).unwrap();
        let counter = Region::new(ALLOCATOR);
        let result = (self.target.read)(self.folder.path());
        let taken = counter.change().bytes_allocated;
        // Memory within a budget is allocated twice: to see whether the system grants it, and to be
        // used.
        let allowed = 2 * (self.target.memory + BYTES_FOR_EACH * (bytes.len() + self.right.len()));
        assert!(taken <= allowed, "{taken} bytes for a file of {} bytes", bytes.len());
        if let Err(sentence) = &result {
            assert!(sentence.contains(self.folder.path().to_str().unwrap()), "it does not say which file: {sentence}");
        }
        result
    }

    /// Files of the right shape in which any number may stand anywhere.
    fn survives_shapes(&self, shapes: impl Strategy<Value = Vec<u8>>) {
        let outcome = TestRunner::new(as_many_as_wanted(CASES)).run(&shapes, |bytes| {
            let _result_or_error = self.read(&bytes);
            Ok(())
        });
        assert!(outcome.is_ok(), "{}", outcome.unwrap_err());
    }

    fn survives_anything(&self) {
        let runner = &mut TestRunner::new(as_many_as_wanted(CASES));
        let wrong = prop_oneof![
            1 => vec(any::<u8>(), 0..LEN_MAX),
            4 => vec(edit(), 1..6).prop_map(|edits| {
                edits.iter().fold(self.right.clone(), |bytes, edit| edit.apply(bytes))
            }),
        ];
        let outcome = runner.run(&wrong, |bytes| {
            let _result_or_error = self.read(&bytes);
            Ok(())
        });
        assert!(outcome.is_ok(), "{}", outcome.unwrap_err());
    }

    fn survives_losing_its_end(&self) {
        for len in 0..self.right.trim_ascii_end().len().min(LEN_MAX) {
            let result = self.read(&self.right[..len]);
            assert!(result.is_err() || !self.target.needs_its_end, "the first {len} bytes pass for the whole");
        }
    }

    fn refuses_a_million_random_bytes(&self) {
        let bytes: Vec<u8> = (0..1_000_000_u64).map(|k| random::bits(SEED, 0, k) as u8).collect();
        assert!(self.read(&bytes).is_err(), "noise passes for a file");
    }
}

/// One thing that goes wrong with a file.
#[derive(Clone, Debug)]
enum Edit {
    Put(Index, u8),
    PutNumber(Index, u32),
    PutWord(Index, &'static str),
    Remove(Index, usize),
    Repeat(Index, usize),
    CutOff(Index),
}

fn edit() -> impl Strategy<Value = Edit> {
    let place = any::<Index>;
    prop_oneof![
        (place(), any::<u8>()).prop_map(|(place, byte)| Edit::Put(place, byte)),
        (place(), select(&NUMBERS)).prop_map(|(place, number)| Edit::PutNumber(place, number)),
        (place(), select(&WORDS)).prop_map(|(place, word)| Edit::PutWord(place, word)),
        (place(), 1..200_usize).prop_map(|(place, len)| Edit::Remove(place, len)),
        (place(), 1..200_usize).prop_map(|(place, len)| Edit::Repeat(place, len)),
        place().prop_map(Edit::CutOff),
    ]
}

impl Edit {
    fn apply(&self, mut bytes: Vec<u8>) -> Vec<u8> {
        if bytes.is_empty() {
            return bytes;
        }
        let len = bytes.len();
        match self {
            Self::Put(place, byte) => bytes[place.index(len)] = *byte,
            Self::PutNumber(place, number) => {
                let first = place.index(len);
                let end = len.min(first + 4);
                bytes[first..end].copy_from_slice(&number.to_le_bytes()[..end - first]);
            }
            Self::PutWord(place, word) => {
                let number = number_from(&bytes, place.index(len));
                bytes.splice(number, word.bytes());
            }
            Self::Remove(place, count) => {
                let first = place.index(len);
                bytes.drain(first..len.min(first + count));
            }
            Self::Repeat(place, count) => {
                let first = place.index(len);
                let again = bytes[first..len.min(first + count)].to_vec();
                bytes.splice(first..first, again);
            }
            Self::CutOff(place) => bytes.truncate(place.index(len)),
        }
        bytes
    }
}

/// Range of the next number in digits, or nothing at the end.
fn number_from(bytes: &[u8], first: usize) -> core::ops::Range<usize> {
    let is_digit = |byte: &u8| byte.is_ascii_digit();
    let start = first + bytes[first..].iter().position(is_digit).unwrap_or(bytes.len() - first);
    let len = bytes[start..].iter().take_while(|byte| is_digit(byte)).count();
    start..start + len
}

fn sentence(error: impl ToString) -> String {
    error.to_string()
}

fn numbers(stream: u64, len: usize) -> Vec<f32> {
    (0..len as u64).map(|k| (random::bits(SEED, stream, k) >> 40) as f32 / 1e7).collect()
}

fn cloud(count: usize, layout: Layout) -> Gaussians<Vec<f32>> {
    Gaussians { count, layout, values: numbers(1, len_of_values(count, layout)) }
}

fn make_gaussians(folder: &Path) {
    gaussian_ply::write(&folder.join("a.ply"), &cloud(5, Layout::shaded(Some(1))), &["a comment".into()]).unwrap();
}

fn make_points(folder: &Path) {
    let points = PointCloud { positions: vec![[1.0, 2.0, 3.0]; 40], colors: vec![[0.5; 3]; 40] };
    points_ply::write(&folder.join("a.ply"), &points).unwrap();
}

fn make_text_points(folder: &Path) {
    let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
    fs::write(folder.join("a.ply"), format!("{header}end_header\n1 2 3\n4 5 6\n7 8 9\n")).unwrap();
}

fn map() -> LatLong {
    LatLong { width: 24, height: 12, rgb: numbers(2, 3 * 24 * 12) }
}

/// One triangle in one leaf.
fn near_field() -> NearField<Vec<f32>> {
    let node = [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 1.0];
    let vertices = numbers(11, 48).into_iter().map(|number| number.min(1.0));
    NearField::of_sizes([1, 1, 3], 0.125, node.into_iter().chain([0.0, 1.0, 2.0, 0.0]).chain(vertices).collect())
}

fn make_network(folder: &Path) {
    let values = (0..WEIGHT_COUNT).map(|index| initial_weight(index, -0.5, 3)).collect();
    let light = Environment { resolution: 2, activation: RadianceActivation::Network, values };
    let gaussians = cloud(3, Layout::shaded(None));
    let info = model_folder::ModelInfo::default();
    let snapshot = model_folder::Snapshot {
        gaussians: &gaussians,
        comments: &[],
        light: Some(&light),
        other_lights: &[],
        near_field: Some(&near_field()),
        info: &info,
    };
    model_folder::save(folder, 1, &snapshot).unwrap();
    fs::remove_file(model_folder::hdr_at(folder, 1)).unwrap();
}

fn make_checkpoint(folder: &Path) {
    let layout = Layout::shaded(Some(0));
    let len = len_of_values(3, layout);
    let moments = |len: usize| AdamMoments { mean: numbers(3, len), square: numbers(4, len) };
    let light =
        Environment { resolution: 2, activation: RadianceActivation::Exponential, values: numbers(5, 6 * 2 * 2 * 3) };
    let scene = SceneState {
        gaussians: cloud(3, layout),
        moments: moments(len),
        statistics: Statistics { grad_sum: numbers(6, 3), view_count: numbers(7, 3) },
        light: Some((light, moments(72))),
    };
    let maps = vec![IDENTITY; 3];
    let exposures = ExposureState { moments: AdamMoments { mean: maps.clone(), square: maps.clone() }, maps };
    let state = TrainingState {
        scene,
        other_lights: Vec::new(),
        near_field: Some(near_field()),
        exposures: Some(exposures),
        order: vec![1, 0, 2],
        iteration: 0,
        psnr: None,
        nonfinite: 0,
    };
    let written = Checkpoint { state, facts: Facts::default() };
    checkpoint::write(folder, &written).unwrap();
}

fn make_transforms(folder: &Path) {
    let pose = "[[1,0,0,0],[0,1,0,0.5],[0,0,1,4],[0,0,0,1]]";
    let frame = |name: &str| format!("{{\"file_path\": \"./{name}\", \"transform_matrix\": {pose}}}");
    let text = format!("{{\"camera_angle_x\": 0.7, \"frames\": [{}, {}]}}", frame("a"), frame("b"));
    fs::write(folder.join("transforms_train.json"), text).unwrap();
    for name in ["a.png", "b.png"] {
        picture::write_rgb(&folder.join(name), 8, 8, &numbers(8, 192), None).unwrap();
    }
}

/// A photograph of another format among those of a data set.
fn make_photograph_as(folder: &Path, name: &str) {
    make_transforms(folder);
    fs::remove_file(folder.join("a.png")).unwrap();
    let picture = image::Rgb32FImage::from_raw(8, 8, numbers(12, 192)).unwrap();
    let picture = image::DynamicImage::from(picture);
    let is_float = name.ends_with("exr");
    if is_float { picture } else { picture.into_rgb16().into() }.save(folder.join(name)).unwrap();
}

/// Cameras of Metashape.
fn make_metashape(folder: &Path) {
    make_transforms(folder);
    fs::remove_file(folder.join("transforms_train.json")).unwrap();
    let size = "<resolution width=\"8\" height=\"8\"/>";
    let sensor = format!("<sensor id=\"0\"><calibration>{size}<f>9.5</f><k1>-0.1</k1></calibration></sensor>");
    let camera = |name: &str| {
        format!("<camera id=\"0\" label=\"{name}\"><transform>1 0 0 0 0 1 0 0.5 0 0 1 4 0 0 0 1</transform></camera>")
    };
    let cameras = format!("<cameras>{}{}</cameras>", camera("a"), camera("b"));
    let text = format!("<document><chunk><sensors>{sensor}</sensors>{cameras}</chunk></document>");
    fs::write(folder.join("cameras.xml"), text).unwrap();
}

/// One list for all views, with a lens.
fn make_list(folder: &Path) {
    make_transforms(folder);
    let text = fs::read_to_string(folder.join("transforms_train.json")).unwrap();
    let lens = "\"camera_model\": \"OPENCV\", \"fl_x\": 9.5, \"w\": 8, \"h\": 8, \"k1\": -0.1, \"p2\": 0.01,";
    fs::write(folder.join("transforms.json"), text.replacen('{', &format!("{{{lens}"), 1)).unwrap();
    fs::remove_file(folder.join("transforms_train.json")).unwrap();
}

/// Photographs whose cameras COLMAP has found, in its text format.
fn make_text_reconstruction(folder: &Path) {
    let cameras = "# two models\n1 PINHOLE 8 8 9 9 4 4\n2 FULL_OPENCV 8 8 9 9 4 4 -0.1 0.1 0 0 0.1 0.1 0.1 0.1\n";
    let images = "# two lines each\n1 1 0 0 0 0 0 4 1 a.png\n1.5 2.5 -1 3 4 1\n2 0.9 0.1 0 0 0.5 0 4 2 b.png\n\n";
    let points = "1 0.5 1.5 2.5 255 0 51 0.5 1 0 2 3\n2 0.25 1 2 0 102 255 0.5\n";
    fs::create_dir_all(folder.join("sparse/0")).unwrap();
    fs::create_dir_all(folder.join("images")).unwrap();
    for (name, text) in [("cameras", cameras), ("images", images), ("points3D", points)] {
        fs::write(folder.join(format!("sparse/0/{name}.txt")), text).unwrap();
    }
    for name in ["a.png", "b.png"] {
        picture::write_rgb(&folder.join("images").join(name), 8, 8, &numbers(8, 192), None).unwrap();
    }
}

/// The same in its binary format.
fn make_reconstruction(folder: &Path) {
    make_text_reconstruction(folder);
    let doubles = |numbers: &[f64]| numbers.iter().flat_map(|number| number.to_le_bytes()).collect::<Vec<u8>>();
    let counts = |counts: &[u64]| counts.iter().flat_map(|count| count.to_le_bytes()).collect::<Vec<u8>>();
    let words = |words: &[u32]| words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>();
    let lens = [9.0, 9.0, 4.0, 4.0, -0.1, 0.1, 0.0, 0.0, 0.1, 0.1, 0.1, 0.1];
    let camera = |id: u32, model: u32, lens: &[f64]| [words(&[id, model]), counts(&[8, 8]), doubles(lens)].concat();
    let image = |id: u32, name: &str, places: u64| {
        let pose = doubles(&[0.9, 0.1, 0.0, 0.0, 0.5, 0.0, 4.0]);
        let places = [counts(&[places]), vec![5; 24 * places as usize]].concat();
        [words(&[id]), pose, words(&[id]), name.as_bytes().to_vec(), places].concat()
    };
    let point = |id: u64, track: u64| {
        let place = [counts(&[id]), doubles(&[0.5, 1.5, 2.5]), vec![255, 0, 51]].concat();
        [place, doubles(&[0.5]), counts(&[track]), vec![1; 8 * track as usize]].concat()
    };
    for (name, one, other) in [
        ("cameras", camera(1, 1, &lens[..4]), camera(2, 6, &lens)),
        ("images", image(1, "a.png\0", 2), image(2, "b.png\0", 0)),
        ("points3D", point(1, 2), point(2, 0)),
    ] {
        fs::write(folder.join(format!("sparse/0/{name}.bin")), [counts(&[2]), one, other].concat()).unwrap();
        fs::remove_file(folder.join(format!("sparse/0/{name}.txt"))).unwrap();
    }
}

/// A photograph on its side, with EXIF data that say so.
fn make_photograph(folder: &Path) {
    make_text_reconstruction(folder);
    let cameras = "1 PINHOLE 8 12 9 9 4 6\n2 PINHOLE 8 8 9 9 4 4\n";
    fs::write(folder.join("sparse/0/cameras.txt"), cameras).unwrap();
    fs::remove_file(folder.join("images/a.png")).unwrap();
    let jpeg = jpeg(&image::RgbImage::new(12, 8));
    let exif = b"\xff\xe1\0\x22Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0";
    fs::write(folder.join("images/a.jpg"), [&jpeg[..2], exif, &jpeg[2..]].concat()).unwrap();
}

/// A photograph that is large enough for a part of it to be decoded.
fn make_large_photograph(folder: &Path) {
    make_photograph(folder);
    let cameras = "1 PINHOLE 64 48 60 60 32 24\n2 PINHOLE 8 8 9 9 4 4\n";
    fs::write(folder.join("sparse/0/cameras.txt"), cameras).unwrap();
    let shades = image::RgbImage::from_fn(64, 48, |x, y| image::Rgb([4 * x as u8, 5 * y as u8, (x * y) as u8]));
    fs::write(folder.join("images/a.jpg"), jpeg(&shades)).unwrap();
}

fn jpeg(image: &image::RgbImage) -> Vec<u8> {
    let mut jpeg = std::io::Cursor::new(Vec::new());
    image.write_to(&mut jpeg, image::ImageFormat::Jpeg).unwrap();
    jpeg.into_inner()
}

fn make_cameras(folder: &Path) {
    make_transforms(folder);
    let cameras = cameras::load_transforms(&folder.join("transforms_train.json"), [8, 8], [0.0; 3]).unwrap();
    cameras::write(&folder.join("cameras.json"), &cameras, [0.0; 3]).unwrap();
}

fn make_model(folder: &Path) {
    let info = model_folder::ModelInfo { profile: "specula".into(), ..Default::default() };
    let gaussians = cloud(3, Layout::radiance(0));
    let snapshot = model_folder::Snapshot {
        gaussians: &gaussians,
        comments: &[],
        light: None,
        other_lights: &[],
        near_field: None,
        info: &info,
    };
    model_folder::save(folder, 7, &snapshot).unwrap();
}

fn load_data(folder: &Path) -> Result<(), String> {
    load_smaller_data(folder, 1)
}

fn load_smaller_data(folder: &Path, downscale: u32) -> Result<(), String> {
    let options = dataset::LoadOptions { downscale, ..Default::default() };
    dataset::load(folder, &options, |_, _| {}).map(|_| ()).map_err(sentence)
}

const GAUSSIANS: Target = Target {
    file: "a.ply",
    make: make_gaussians,
    read: |folder| gaussian_ply::read(&folder.join("a.ply")).map(|_| ()).map_err(sentence),
    memory: BYTES_OF_TABLES,
    needs_its_end: true,
};
const POINTS: Target = Target {
    make: make_points,
    read: |folder| points_ply::read(&folder.join("a.ply")).map(|_| ()).map_err(sentence),
    ..GAUSSIANS
};
// The last digit of a number in text may be lost without notice.
const TEXT_POINTS: Target = Target { make: make_text_points, needs_its_end: false, ..POINTS };
const CHECKPOINT: Target = Target {
    file: "checkpoint.safetensors",
    make: make_checkpoint,
    read: |folder| checkpoint::read(folder).map(|_| ()).map_err(sentence),
    ..GAUSSIANS
};
const LIGHT_NETWORK: Target = Target {
    file: "light/iteration_1/network.safetensors",
    make: make_network,
    read: |folder| model_folder::open(folder).map(|_| ()).map_err(sentence),
    ..GAUSSIANS
};
const NEAR_FIELD: Target = Target { file: "light/iteration_1/near_field.safetensors", ..LIGHT_NETWORK };
const CAMERAS: Target = Target {
    file: "cameras.json",
    make: make_cameras,
    read: |folder| cameras::read(&folder.join("cameras.json")).map(|_| ()).map_err(sentence),
    ..GAUSSIANS
};
const LIGHT_TABLE: Target = Target {
    file: "lights.txt",
    make: |folder| fs::write(folder.join("lights.txt"), "a one 0\nb one 0\nc two 90 # turned\nd two 90\n").unwrap(),
    read: |folder| LightTable::read(&folder.join("lights.txt")).map(|_| ()).map_err(sentence),
    needs_its_end: false,
    ..GAUSSIANS
};
const TRANSFORMS: Target =
    Target { file: "transforms_train.json", make: make_transforms, read: load_data, ..GAUSSIANS };
const LIST: Target = Target { file: "transforms.json", make: make_list, ..TRANSFORMS };
const LINEAR_PHOTOGRAPH: Target =
    Target { file: "a.exr", make: |folder| make_photograph_as(folder, "a.exr"), memory: EXR.memory, ..TRANSFORMS };
const TIFF_PHOTOGRAPH: Target =
    Target { file: "a.tif", make: |folder| make_photograph_as(folder, "a.tif"), memory: EXR.memory, ..TRANSFORMS };
const METASHAPE: Target = Target { file: "cameras.xml", make: make_metashape, read: load_data, ..GAUSSIANS };
const COLMAP_CAMERAS: Target =
    Target { file: "sparse/0/cameras.bin", make: make_reconstruction, read: load_data, ..GAUSSIANS };
const COLMAP_IMAGES: Target = Target { file: "sparse/0/images.bin", ..COLMAP_CAMERAS };
const COLMAP_POINTS: Target = Target { file: "sparse/0/points3D.bin", ..COLMAP_CAMERAS };
// The last lines of text may be lost without notice.
const COLMAP_CAMERAS_TEXT: Target =
    Target { file: "sparse/0/cameras.txt", make: make_text_reconstruction, needs_its_end: false, ..COLMAP_CAMERAS };
const COLMAP_IMAGES_TEXT: Target = Target { file: "sparse/0/images.txt", ..COLMAP_CAMERAS_TEXT };
const COLMAP_POINTS_TEXT: Target = Target { file: "sparse/0/points3D.txt", ..COLMAP_CAMERAS_TEXT };
const MODEL: Target = Target {
    file: "specula.json",
    make: make_model,
    read: |folder| model_folder::open(folder).map(|_| ()).map_err(sentence),
    ..GAUSSIANS
};
const PNG: Target = Target {
    file: "a.png",
    make: |folder| picture::write_rgb(&folder.join("a.png"), 24, 12, &numbers(9, 3 * 24 * 12), None).unwrap(),
    read: |folder| Pixels::read(&folder.join("a.png")).map(|_| ()).map_err(sentence),
    memory: BYTES_OF_PICTURES,
    // The last chunk of a PNG only says that it is the last.
    needs_its_end: false,
};
const PHOTOGRAPH: Target = Target { file: "images/a.jpg", make: make_photograph, read: load_data, ..PNG };
const SMALLER_PHOTOGRAPH: Target =
    Target { make: make_large_photograph, read: |folder| load_smaller_data(folder, 4), ..PHOTOGRAPH };
const HDR: Target = Target {
    file: "a.hdr",
    make: |folder| latlong::write(&folder.join("a.hdr"), &map()).unwrap(),
    read: |folder| latlong::read(&folder.join("a.hdr")).map(|_| ()).map_err(sentence),
    needs_its_end: true,
    ..PNG
};
const EXR: Target = Target {
    file: "a.exr",
    make: |folder| latlong::write(&folder.join("a.exr"), &map()).unwrap(),
    read: |folder| latlong::read(&folder.join("a.exr")).map(|_| ()).map_err(sentence),
    ..HDR
};
const CUBE: Target = Target {
    make: |folder| latlong::write_cube_exr(&folder.join("a.exr"), &numbers(10, 18 * 4 * 4), 4).unwrap(),
    read: |folder| latlong::read_cube_exr(&folder.join("a.exr")).map(|_| ()).map_err(sentence),
    ..EXR
};
/// The same in tiles, as other programs may write it.
const TILED_CUBE: Target = Target {
    make: |folder| {
        let image = image::Rgb32FImage::from_raw(4, 24, numbers(10, 18 * 4 * 4)).unwrap();
        image.save(folder.join("a.exr")).unwrap();
    },
    ..CUBE
};

const GLB: Target = Target {
    file: "a.glb",
    make: |folder| {
        let gaussians = cloud(6, Layout::radiance(1));
        let roughness = Attribute { name: "ROUGHNESS".into(), width: 1, values: numbers(12, 6) };
        let light = Some((numbers(10, 18 * 4 * 4), 4));
        let shading = Shading { attributes: vec![roughness], light, ..Shading::default() };
        glb::write(&folder.join("a.glb"), &gaussians, Some(&shading), None, [0.0; 3]).unwrap();
    },
    read: |folder| glb::read(Input::file(&folder.join("a.glb"))).map(|_| ()).map_err(sentence),
    memory: BYTES_OF_PICTURES,
    needs_its_end: true,
};

/// The same as text with a buffer in it: six Gaussians, all numbers of which are zero.
const GLTF: Target = Target {
    file: "a.gltf",
    make: |folder| {
        let of = |name: &str| format!("\"KHR_gaussian_splatting:{name}\"");
        let [rotation, scale, opacity, color] = ["ROTATION", "SCALE", "OPACITY", "SH_DEGREE_0_COEF_0"].map(of);
        let accessor = |kind: &str| format!(r#"{{"bufferView":0,"componentType":5126,"count":6,"type":"{kind}"}}"#);
        let text = format!(
            r#"{{"meshes":[{{"primitives":[{{"extensions":{{"KHR_gaussian_splatting":{{}}}},"attributes":{{"POSITION":0,
            {scale}:0,{color}:0,{rotation}:1,{opacity}:2}}}}]}}],"nodes":[{{"mesh":0,"children":[1]}},{{"mesh":0,
            "matrix":[1,0,0,0,0,2,0,0,0,0,1,0,0,0,0,1]}}],"scenes":[{{"nodes":[0]}}],"accessors":[{},{},{}],
            "bufferViews":[{{"buffer":0,"byteLength":96}}],"buffers":[{{"uri":"data:;base64,{}","byteLength":96}}]}}"#,
            accessor("VEC3"),
            accessor("VEC4"),
            accessor("SCALAR"),
            "A".repeat(128),
        );
        fs::write(folder.join("a.gltf"), text).unwrap();
    },
    read: |folder| glb::read(Input::file(&folder.join("a.gltf"))).map(|_| ()).map_err(sentence),
    ..GLB
};

const SPZ: Target = Target {
    file: "a.spz",
    make: |folder| spz::write(&folder.join("a.spz"), &cloud(6, Layout::radiance(1))).unwrap(),
    read: |folder| model_folder::open(&folder.join("a.spz")).map(|_| ()).map_err(sentence),
    ..GLB
};

const SPLAT: Target = Target {
    file: "a.splat",
    make: |folder| splat::write(&folder.join("a.splat"), &cloud(6, Layout::radiance(0))).unwrap(),
    read: |folder| model_folder::open(&folder.join("a.splat")).map(|_| ()).map_err(sentence),
    memory: BYTES_OF_TABLES,
    // Any number of whole records is a file.
    needs_its_end: false,
};

const COMPRESSED: Target = Target {
    file: "a.ply",
    make: |folder| {
        let ranges: String = ["min_", "max_", "min_scale_", "max_scale_"]
            .iter()
            .flat_map(|range| ["x", "y", "z"].map(|axis| format!("property float {range}{axis}\n")))
            .collect();
        let packed = ["position", "rotation", "scale", "color"].map(|name| format!("property uint packed_{name}\n"));
        let (start, packed) = ("ply\nformat binary_little_endian 1.0\nelement chunk 1", packed.concat());
        let header = format!("{start}\n{ranges}element vertex 6\n{packed}end_header\n");
        let ranges = numbers(14, 12).into_iter().flat_map(f32::to_le_bytes);
        let bytes: Vec<u8> =
            header.into_bytes().into_iter().chain(ranges).chain((0..96_u8).map(|k| k.wrapping_mul(37))).collect();
        fs::write(folder.join("a.ply"), bytes).unwrap();
    },
    read: |folder| gaussian_ply::read(&folder.join("a.ply")).map(|_| ()).map_err(sentence),
    memory: BYTES_OF_TABLES,
    needs_its_end: true,
};

/// Findings on any PLY file.
const LINT: Target = Target {
    read: |folder| lint::lint(&folder.join("a.ply")).map(|_| ()).map_err(sentence),
    needs_its_end: false,
    ..COMPRESSED
};

const NETWORK: Target = Target {
    file: "a.onnx",
    make: |folder| {
        fs::write(folder.join("a.onnx"), include_bytes!("../../crates/accuracy/tests/data/lpips-vgg.onnx")).unwrap();
    },
    read: |folder| {
        let path = folder.join("a.onnx");
        let read = Network::from_bytes(NETWORK_BUDGET.read(&path).map_err(sentence)?);
        read.map(|_| ()).map_err(|unfit| format!("{path:?}: {unfit}"))
    },
    memory: BYTES_OF_NETWORKS,
    needs_its_end: false,
};

// Each of the least objects takes two hundred times its text, of which there may be little.
const FACTS: Target = Target { memory: 1 << 25, ..MODEL };

/// Tests of readers with files of the right shape, by reader.
macro_rules! shapes {
    ($($name:ident: $target:expr, $shapes:expr;)*) => {$(
        mod $name {
            use super::*;

            #[test]
            fn survives_anything_of_its_shape() {
                Place::new(&$target).survives_shapes($shapes);
            }
        }
    )*};
}

shapes! {
    shapes_of_ply: POINTS, shapes::ply();
    shapes_of_png: PNG, shapes::png();
    shapes_of_safetensors: CHECKPOINT, shapes::safetensors();
    shapes_of_networks: LIGHT_NETWORK, shapes::safetensors();
    shapes_of_near_fields: NEAR_FIELD, shapes::safetensors();
    shapes_of_onnx: NETWORK, shapes::onnx();
    shapes_of_exr: EXR, shapes::exr();
    shapes_of_hdr: HDR, shapes::hdr();
    shapes_of_json: FACTS, shapes::json();
}

/// The tests of each reader, by its name.
macro_rules! targets {
    ($($name:ident: $target:expr;)*) => {$(
        mod $name {
            use super::*;

            #[test]
            fn survives_anything() {
                Place::new(&$target).survives_anything();
            }

            #[test]
            fn survives_losing_its_end() {
                Place::new(&$target).survives_losing_its_end();
            }

            #[test]
            fn refuses_a_million_random_bytes() {
                Place::new(&$target).refuses_a_million_random_bytes();
            }
        }
    )*};
}

targets! {
    gaussians: GAUSSIANS;
    spz_files: SPZ;
    splat_files: SPLAT;
    compressed_gaussians: COMPRESSED;
    findings: LINT;
    gltf: GLB;
    gltf_text: GLTF;
    points: POINTS;
    text_points: TEXT_POINTS;
    checkpoints: CHECKPOINT;
    networks_of_lights: LIGHT_NETWORK;
    near_fields: NEAR_FIELD;
    camera_lists: CAMERAS;
    light_tables: LIGHT_TABLE;
    transforms: TRANSFORMS;
    one_list_of_transforms: LIST;
    linear_photographs: LINEAR_PHOTOGRAPH;
    photographs_as_tiff: TIFF_PHOTOGRAPH;
    cameras_of_metashape: METASHAPE;
    colmap_cameras: COLMAP_CAMERAS;
    colmap_images: COLMAP_IMAGES;
    colmap_points: COLMAP_POINTS;
    colmap_cameras_as_text: COLMAP_CAMERAS_TEXT;
    colmap_images_as_text: COLMAP_IMAGES_TEXT;
    colmap_points_as_text: COLMAP_POINTS_TEXT;
    photographs: PHOTOGRAPH;
    photographs_made_smaller: SMALLER_PHOTOGRAPH;
    models: MODEL;
    png: PNG;
    hdr: HDR;
    exr: EXR;
    cube_exr: CUBE;
}

#[test]
fn a_header_of_two_billion_vertices_is_refused() {
    for (target, formats) in [(GAUSSIANS, 1), (POINTS, 3)] {
        let place = Place::new(&target);
        for format in &["binary_little_endian", "binary_big_endian", "ascii"][..formats] {
            let header = format!("ply\nformat {format} 1.0\nelement vertex 2147483648\nproperty float x\n");
            let rest = "property float y\nproperty float z\nend_header\n";
            assert!(place.read(format!("{header}{rest}1 2 3\n").as_bytes()).is_err(), "{format}");
        }
    }
}

#[test]
fn counts_of_a_reconstruction_that_its_files_cannot_hold_are_refused() {
    for target in [COLMAP_CAMERAS, COLMAP_IMAGES, COLMAP_POINTS] {
        let place = Place::new(&target);
        for count in [3, 1 << 32, u64::MAX / 24, u64::MAX] {
            let bytes = [&count.to_le_bytes(), &place.right[8..]].concat();
            assert!(place.read(&bytes).is_err(), "{count} records of {}", target.file);
        }
    }
}

#[test]
fn a_picture_of_four_billion_rows_is_refused() {
    let place = Place::new(&HDR);
    for size in ["-Y 4294967295 +X 4294967295", "-Y 1000000 +X 1000000", "-Y 2147483648 +X 1"] {
        let refusal = place.read(format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n{size}\n").as_bytes());
        assert!(refusal.expect_err(size).contains("a.hdr"), "{size}");
    }
}

/// A list may name images anywhere; the data set is named nevertheless.
#[test]
fn missing_images_of_a_list_are_reported_with_its_data_set() {
    let place = Place::new(&LIST);
    let list = r#"{"fl_x": 9.5, "w": 8, "h": 8, "frames": [{"file_path": "/nowhere/none",
        "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}]}"#;
    let refusal = place.read(list.as_bytes()).expect_err("there is no such image");
    assert!(refusal.contains("none"), "{refusal}");
}

/// A tile of two gigabytes in a picture of 4 × 24 pixels: a header that promises it, and a block
/// that says it is so long.
#[test]
fn a_tile_far_larger_than_its_picture_is_refused() {
    const BYTES_OF_TILE: u32 = 2_000_000_000;
    let place = Place::new(&TILED_CUBE);
    let mut bytes = place.right.clone();
    let after = |name: &[u8]| place.right.windows(name.len()).position(|window| window == name).unwrap() + name.len();
    // Behind the attribute's length stands the tile's width; the only block begins where the table
    // of blocks ends.
    let width_at = after(b"tiledesc\0") + 4;
    let table = (0..bytes.len() - 8).find(|at| bytes[*at..at + 8] == (*at as u64 + 8).to_le_bytes()).unwrap();
    // A block has the place of its tile as four numbers, then its length.
    let len_at = table + 8 + 16;
    bytes[width_at..width_at + 4].copy_from_slice(&(1_u32 << 24).to_le_bytes());
    bytes[len_at..len_at + 4].copy_from_slice(&BYTES_OF_TILE.to_le_bytes());
    let refusal = place.read(&bytes).expect_err("nothing fills such a tile");
    assert!(refusal.contains("MiB for a picture"), "{refusal}");
}

#[test]
#[should_panic(expected = "bytes for a file of")]
fn a_reader_that_takes_too_much_is_noticed() {
    let greedy = |folder: &Path| {
        let wasted = vec![1_u8; BYTES_OF_TABLES];
        assert!(folder.is_dir() && wasted[5] == 1);
        Ok(())
    };
    Place::new(&Target { read: greedy, memory: 0, ..MODEL });
}

#[test]
#[should_panic(expected = "it does not say which file")]
fn an_error_that_names_no_file_is_noticed() {
    let place = Place::new(&MODEL);
    let vague = Target { read: |_| Err("something is wrong".into()), ..MODEL };
    drop(Place { target: &vague, ..place }.read(b"{}"));
}
