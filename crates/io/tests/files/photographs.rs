//! Data sets of photographs: COLMAP's and nerfstudio's, small ones that are made here.

use glam::{Mat3, Quat, Vec3};
use image::{ImageBuffer, Rgb, Rgb32FImage, RgbImage, Rgba, Rgba32FImage, codecs::jpeg::JpegEncoder};
use serde_json::{Value, json};
use specula_core::color::{UNKNOWN, srgb_from_linear};
use specula_io::{
    Result,
    dataset::{self, Dataset, InputSpace, LoadOptions, MaskUse},
    points_ply::{self, PointCloud},
};
use std::{
    fs,
    path::{Path, PathBuf},
};
use tempfile::TempDir;

pub(crate) const WIDTH: u32 = 24;
pub(crate) const HEIGHT: u32 = 16;

/// A reconstruction that tests write in either format.
pub(crate) struct Scene {
    /// Number, name and parameters of the cameras' models.
    pub(crate) cameras: Vec<(i32, &'static str, Vec<f64>)>,
    /// Names of images, and the identifier of each one's camera, from 1.
    pub(crate) images: Vec<(&'static str, u32)>,
}

const QUAT: [f64; 4] = [0.9, 0.1, -0.3, 0.2];
const TRANSLATION: [f64; 3] = [0.25, -1.5, 3.0];
const POINTS: [([f64; 3], [u8; 3]); 2] = [([0.5, 1.5, -2.0], [255, 0, 51]), ([1.0 / 3.0, 0.0, 7.0], [0, 102, 255])];

impl Scene {
    pub(crate) fn pinhole() -> Self {
        let names = ["b.png", "a.png", "c.png"];
        Self {
            cameras: vec![(1, "PINHOLE", vec![20.0, 21.0, 12.5, 7.5])],
            images: names.map(|name| (name, 1)).to_vec(),
        }
    }

    pub(crate) fn write_images(&self, folder: &Path) {
        for (name, _) in &self.images {
            picture().save(made(&folder.join("images").join(name))).unwrap();
        }
    }

    pub(crate) fn write_text(&self, folder: &Path) {
        let words = |numbers: &[f64]| numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
        let mut cameras = "# Camera list\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n".to_owned();
        for (index, (_, name, params)) in self.cameras.iter().enumerate() {
            cameras += &format!("{} {name} {WIDTH} {HEIGHT} {}\n", index + 1, words(params));
        }
        let mut images = "# Image list with two lines of data per image\n".to_owned();
        for (index, (name, camera)) in self.images.iter().enumerate() {
            let places = if index == 0 { "1.5 2.5 7 3.5 4.5 -1" } else { "" };
            images += &format!("{} {} {} {camera} {name}\n{places}\n", index + 1, words(&QUAT), words(&TRANSLATION));
        }
        let mut points = "# 3D point list\n".to_owned();
        for (index, (position, color)) in POINTS.iter().enumerate() {
            let [r, g, b] = color;
            points += &format!("{} {} {r} {g} {b} 0.5 1 0 2 3\n", index + 1, words(position));
        }
        for (name, text) in [("cameras", cameras), ("images", images), ("points3D", points)] {
            fs::write(made(&folder.join(format!("sparse/0/{name}.txt"))), text).unwrap();
        }
    }

    pub(crate) fn write_binary(&self, folder: &Path) {
        let numbers = |numbers: &[f64]| numbers.iter().flat_map(|number| number.to_le_bytes()).collect::<Vec<u8>>();
        let count = |count: usize| (count as u64).to_le_bytes().to_vec();
        let mut cameras = count(self.cameras.len());
        for (index, (model, _, params)) in self.cameras.iter().enumerate() {
            cameras.extend((index as u32 + 1).to_le_bytes());
            cameras.extend(model.to_le_bytes());
            cameras.extend([u64::from(WIDTH), u64::from(HEIGHT)].map(u64::to_le_bytes).concat());
            cameras.extend(numbers(params));
        }
        let mut images = count(self.images.len());
        for (index, (name, camera)) in self.images.iter().enumerate() {
            images.extend((index as u32 + 1).to_le_bytes());
            images.extend([numbers(&QUAT), numbers(&TRANSLATION), camera.to_le_bytes().to_vec()].concat());
            images.extend([name.as_bytes(), &[0]].concat());
            let places = if index == 0 { 2 } else { 0 };
            images.extend([count(places), vec![7; 24 * places]].concat());
        }
        let mut points = count(POINTS.len());
        for (index, (position, color)) in POINTS.iter().enumerate() {
            points.extend([count(index + 1), numbers(position), color.to_vec(), numbers(&[0.5])].concat());
            points.extend([count(2), vec![3; 16]].concat());
        }
        for (name, bytes) in [("cameras", cameras), ("images", images), ("points3D", points)] {
            fs::write(made(&folder.join(format!("sparse/0/{name}.bin"))), bytes).unwrap();
        }
    }

    /// In text, with images.
    pub(crate) fn folder(&self) -> TempDir {
        let folder = tempfile::tempdir().unwrap();
        self.write_images(folder.path());
        self.write_text(folder.path());
        folder
    }
}

/// A file's place, in a folder that is made for it.
pub(crate) fn made(path: &Path) -> PathBuf {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    path.to_owned()
}

/// Smooth, and different everywhere.
pub(crate) fn picture() -> RgbImage {
    RgbImage::from_fn(WIDTH, HEIGHT, |x, y| Rgb([(8 * x) as u8, (12 * y) as u8, (4 * (x + y)) as u8]))
}

fn load(folder: &Path) -> Result<Dataset> {
    dataset::load(folder, &LoadOptions::default(), |_, _| {})
}

fn load_with(folder: &TempDir, options: LoadOptions) -> Dataset {
    dataset::load(folder.path(), &options, |_, _| {}).unwrap()
}

pub(crate) fn names(views: &[dataset::View]) -> Vec<&str> {
    views.iter().map(|view| view.name.as_str()).collect()
}

/// That a sentence says all of this.
pub(crate) fn assert_says(sentence: &str, parts: &[&str]) {
    for part in parts {
        assert!(sentence.contains(part), "{part:?} is missing in: {sentence}");
    }
}

#[test]
fn text_and_binary_of_a_reconstruction_are_the_same() {
    let all_models = Scene {
        cameras: vec![
            (0, "SIMPLE_PINHOLE", vec![20.0, 12.0, 8.0]),
            (2, "SIMPLE_RADIAL", vec![20.0, 12.0, 8.0, -0.1]),
            (3, "RADIAL", vec![20.0, 12.0, 8.0, -0.1, 0.02]),
            (4, "OPENCV", vec![20.0, 21.0, 12.0, 8.0, -0.1, 0.02, 0.001, -0.002]),
            (5, "OPENCV_FISHEYE", vec![20.0, 21.0, 12.0, 8.0, -0.1, 0.02, 0.01, -0.002]),
            (6, "FULL_OPENCV", vec![20.0, 21.0, 12.0, 8.0, -0.1, 0.02, 0.001, -0.002, 0.01, 0.02, 0.03, 0.04]),
            (7, "FOV", vec![20.0, 21.0, 12.0, 8.0, 0.7]),
            (8, "SIMPLE_RADIAL_FISHEYE", vec![20.0, 12.0, 8.0, -0.1]),
            (9, "RADIAL_FISHEYE", vec![20.0, 12.0, 8.0, -0.1, 0.02]),
            (
                10,
                "THIN_PRISM_FISHEYE",
                vec![20.0, 21.0, 12.0, 8.0, -0.1, 0.02, 0.001, -0.002, 0.01, 0.02, 0.003, 0.004],
            ),
        ],
        images: vec![
            ("a.png", 1),
            ("b.png", 2),
            ("c.png", 3),
            ("d.png", 4),
            ("e.png", 5),
            ("f.png", 6),
            ("g.png", 7),
            ("h.png", 8),
            ("i.png", 9),
            ("j.png", 10),
        ],
    };
    let [text, binary] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    all_models.write_text(text.path());
    all_models.write_binary(binary.path());
    [&text, &binary].into_iter().for_each(|folder| all_models.write_images(folder.path()));
    let [text, binary] = [load(text.path()).unwrap(), load(binary.path()).unwrap()];
    assert_eq!((&text.train, &text.test, &text.points), (&binary.train, &binary.test, &binary.points));
    assert_says(&text.report.source, &["text", "cameras: 10", "THIN_PRISM_FISHEYE"]);
    assert_says(&binary.report.source, &["binary"]);
    assert_says(&text.notes.join("\n"), &["distortion of 9 pictures"]);
}

#[test]
fn poses_and_lenses_of_colmap_are_ours() {
    let data = load(Scene::pinhole().folder().path()).unwrap();
    let camera = data.train[0].camera;
    assert_eq!((camera.focal_px, camera.principal_px), ([20.0, 21.0], [12.5, 7.5]));
    let [w, x, y, z] = QUAT.map(|number| number as f32);
    let turn = Mat3::from_quat(Quat::from_xyzw(x, y, z, w).normalize());
    let point = Vec3::new(0.3, 0.4, 0.5);
    let seen = camera.camera_from_world * (point - camera.position);
    assert!((seen - (turn * point + Vec3::new(0.25, -1.5, 3.0))).length() < 1e-5, "{seen}");
    assert_eq!(data.points.unwrap().colors, [[1.0, 0.0, 0.2], [0.0, 0.4, 1.0]]);
    assert_eq!(data.train[0].image.rgba[4..8], [8, 0, 4, 255]);
}

#[test]
fn every_eighth_by_name_is_held_out_from_the_first() {
    let images = ["10.png", "2.png", "3.png", "4.png", "5.png", "6.png", "7.png", "8.png", "9.png"];
    let folder = Scene { images: images.map(|name| (name, 1)).to_vec(), ..Scene::pinhole() }.folder();
    let data = load(folder.path()).unwrap();
    assert_eq!((names(&data.test), data.train.len()), (vec!["10", "9"], 7));
    let third = load_with(&folder, LoadOptions { test_every: 3, ..LoadOptions::default() });
    assert_eq!(names(&third.test), ["10", "4", "7"]);
    assert!(load_with(&folder, LoadOptions { test_every: 0, ..LoadOptions::default() }).test.is_empty());
    assert_eq!(load_with(&folder, LoadOptions { with_test: false, ..LoadOptions::default() }).train.len(), 9);
}

#[test]
fn a_reconstruction_may_lie_in_several_places() {
    for place in ["sparse", "", "colmap/sparse/0"] {
        let folder = Scene::pinhole().folder();
        for name in ["cameras", "images", "points3D"] {
            let to = made(&folder.path().join(place).join(format!("{name}.txt")));
            fs::rename(folder.path().join(format!("sparse/0/{name}.txt")), to).unwrap();
        }
        assert_eq!(load(folder.path()).unwrap().train.len(), 2, "in {place:?}");
    }
}

#[test]
fn the_largest_of_several_reconstructions_is_taken() {
    let folder = Scene::pinhole().folder();
    fs::rename(folder.path().join("sparse/0"), folder.path().join("sparse/1")).unwrap();
    Scene { images: vec![("a.png", 1)], ..Scene::pinhole() }.write_text(folder.path());
    let data = load(folder.path()).unwrap();
    assert_eq!(data.train.len() + data.test.len(), 3);
    assert_says(&data.notes.join("\n"), &["sparse/1\" is the largest", "sparse/0"]);
}

#[test]
fn smaller_copies_are_taken_where_there_are_any() {
    let folder = Scene::pinhole().folder();
    RgbImage::from_pixel(WIDTH / 2, HEIGHT / 2, Rgb([128; 3]))
        .save(made(&folder.path().join("images_2/a.jpg")))
        .unwrap();
    let data = load_with(&folder, LoadOptions { downscale: 2, ..LoadOptions::default() });
    assert_eq!(data.test[0].image.rgba[..4], [128, 128, 128, 255]);
    for view in data.train.iter().chain(&data.test) {
        assert_eq!([view.image.width, view.image.height, view.camera.width], [WIDTH / 2, HEIGHT / 2, WIDTH / 2]);
        assert_eq!((view.camera.focal_px, view.camera.principal_px), ([10.0, 10.5], [6.25, 3.75]));
    }
    assert_says(&data.notes.join("\n"), &["1 images are those of", "images_2", "2 are missing there"]);
}

#[test]
fn another_folder_of_images_may_be_named() {
    let folder = Scene::pinhole().folder();
    fs::rename(folder.path().join("images"), folder.path().join("photos")).unwrap();
    let refusal = load(folder.path()).unwrap_err().to_string();
    assert_says(&refusal, &["images", "b.png", "none of the images"]);
    let data = load_with(&folder, LoadOptions { images: "photos".into(), ..LoadOptions::default() });
    assert_eq!(data.train.len(), 2);
}

#[test]
fn missing_images_are_left_out_and_noted() {
    let folder = Scene::pinhole().folder();
    fs::remove_file(folder.path().join("images/b.png")).unwrap();
    let data = load(folder.path()).unwrap();
    assert_eq!((names(&data.test), names(&data.train)), (vec!["a"], vec!["c"]));
    assert_says(&data.notes.join("\n"), &["skipped 1 cameras", "\"b.png\""]);
}

#[test]
fn images_of_several_folders_keep_names_apart() {
    let folder = Scene { images: vec![("left/1.png", 1), ("right/1.png", 1)], ..Scene::pinhole() }.folder();
    let data = load(folder.path()).unwrap();
    assert_eq!((names(&data.test), names(&data.train)), (vec!["left/1"], vec!["right/1"]));
}

#[test]
fn masks_leave_pixels_out() {
    let folder = Scene::pinhole().folder();
    let half = |x: u32| if x < WIDTH / 2 { Rgb([0; 3]) } else { Rgb([255; 3]) };
    RgbImage::from_fn(WIDTH, HEIGHT, |x, _| half(x)).save(made(&folder.path().join("masks/a.png"))).unwrap();
    RgbImage::from_fn(WIDTH, HEIGHT, |x, _| half(x)).save(folder.path().join("masks/b.png.png")).unwrap();
    let data = load(folder.path()).unwrap();
    for view in [&data.test[0], &data.train[0]] {
        let row = &view.image.rgba[..4 * WIDTH as usize];
        let unknown = row.chunks(4).map(|pixel| pixel == UNKNOWN).collect::<Vec<_>>();
        assert_eq!(unknown, [[true; 12], [false; 12]].concat(), "{}", view.name);
    }
    assert_says(&data.notes.join("\n"), &["2 pictures have pixels that a mask or the lens leaves open, 33.3 %"]);
    let small = load_with(&folder, LoadOptions { downscale: 2, ..LoadOptions::default() });
    assert_eq!(small.test[0].image.rgba[4 * 5..4 * 6], UNKNOWN);
    assert_ne!(small.test[0].image.rgba[4 * 6..4 * 7], UNKNOWN);
}

#[test]
fn masks_that_hide_most_of_the_pictures_cut_the_object_out() {
    let folder = Scene::pinhole().folder();
    let quarter = |x: u32, y: u32| if x < WIDTH / 2 || y < HEIGHT / 2 { Rgb([0; 3]) } else { Rgb([255; 3]) };
    for name in ["a", "b", "c"] {
        let path = made(&folder.path().join(format!("masks/{name}.png")));
        RgbImage::from_fn(WIDTH, HEIGHT, quarter).save(path).unwrap();
    }
    let first = |masks| {
        let data = load_with(&folder, LoadOptions { masks, ..LoadOptions::default() });
        let pixel: [u8; 4] = data.train[0].image.rgba[..4].try_into().unwrap();
        let last: [u8; 4] = data.train[0].image.rgba.last_chunk().copied().unwrap();
        assert_eq!(last[3], 255, "{masks:?}: visible pixels stay");
        (pixel, data.notes.join("\n"))
    };
    let (pixel, notes) = first(MaskUse::Auto);
    assert_eq!(pixel, [0; 4]);
    assert_says(&notes, &["masks hide 75 %", "cut the object out", "--masks ignore"]);
    assert_eq!(first(MaskUse::Cut).0, [0; 4]);
    let (pixel, notes) = first(MaskUse::Ignore);
    assert_eq!(pixel, UNKNOWN);
    assert!(!notes.contains("cut the object out"), "{notes}");
    // A picture without a mask: the others cannot mean an object.
    fs::remove_file(folder.path().join("masks/c.png")).unwrap();
    assert_eq!(first(MaskUse::Auto).0, UNKNOWN);
}

#[test]
fn pictures_beside_the_reconstruction_are_found() {
    let folder = Scene::pinhole().folder();
    for name in ["a", "b", "c"] {
        let file = format!("{name}.png");
        fs::rename(folder.path().join("images").join(&file), folder.path().join(&file)).unwrap();
    }
    fs::remove_dir(folder.path().join("images")).unwrap();
    assert_eq!(names(&load(folder.path()).unwrap().train), ["b", "c"]);
}

/// A JPEG with an orientation among its EXIF data.
fn jpeg_turned(path: &Path, image: &RgbImage, orientation: u8) {
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, 100).encode_image(image).unwrap();
    // One entry: tag 0x112, one short.
    let tiff =
        [b"II*\0".as_slice(), &8_u32.to_le_bytes(), &[1, 0, 0x12, 1, 3, 0, 1, 0, 0, 0, orientation, 0, 0, 0], &[0; 4]];
    let exif = [b"Exif\0\0".as_slice(), &tiff.concat()].concat();
    let segment = [&[0xff, 0xe1], (exif.len() as u16 + 2).to_be_bytes().as_slice(), &exif].concat();
    fs::write(made(path), [&jpeg[..2], &segment, &jpeg[2..]].concat()).unwrap();
}

#[test]
fn pictures_are_turned_where_they_fit_their_camera_only_so() {
    let scene = Scene { images: vec![("a.jpg", 1), ("b.jpg", 1)], ..Scene::pinhole() };
    let folder = tempfile::tempdir().unwrap();
    scene.write_text(folder.path());
    // As COLMAP has seen it, whatever its EXIF data say; and stored on its side.
    jpeg_turned(&folder.path().join("images/a.jpg"), &picture(), 6);
    let side = image::imageops::rotate270(&picture());
    jpeg_turned(&folder.path().join("images/b.jpg"), &side, 6);
    let data = load(folder.path()).unwrap();
    for view in [&data.test[0], &data.train[0]] {
        let right = &view.image.rgba[4 * (WIDTH as usize - 1)..][..3];
        assert!(right[0] > 170 && right[1] < 20, "{}: {right:?}", view.name);
        assert_eq!([view.image.width, view.image.height], [WIDTH, HEIGHT]);
    }
    assert_says(&data.notes.join("\n"), &["rotated 1 pictures"]);
}

#[test]
fn a_picture_of_another_shape_is_refused() {
    let folder = Scene::pinhole().folder();
    RgbImage::new(HEIGHT, WIDTH).save(folder.path().join("images/c.png")).unwrap();
    assert_says(
        &load(folder.path()).unwrap_err().to_string(),
        &["c.png", "16 by 24", "24 by 16", "aspect ratios differ"],
    );
}

#[test]
fn faults_of_a_reconstruction_are_refused_by_file_and_place() {
    let refusal = |name: &str, from: &str, to: &str| {
        let folder = Scene::pinhole().folder();
        let path = folder.path().join(format!("sparse/0/{name}.txt"));
        let text = fs::read_to_string(&path).unwrap();
        assert!(text.contains(from), "{from:?} is in the file");
        fs::write(&path, text.replacen(from, to, 1)).unwrap();
        load(folder.path()).unwrap_err().to_string()
    };
    assert_says(
        &refusal("cameras", "PINHOLE", "DIVISION"),
        &["line 3", "cameras.txt", "DIVISION", "OPENCV_FISHEYE", "image_undistorter"],
    );
    assert_says(&refusal("cameras", " 7.5", ""), &["line 3", "cameras.txt", "has 3 parameters", "PINHOLE has 4"]);
    assert_says(&refusal("cameras", " 7.5", " 7.5 -0.2 0"), &["cameras.txt", "has 6 parameters", "PINHOLE has 4"]);
    assert_says(&refusal("cameras", "24 16", "24.5 16"), &["line 3", "24.5 pixels", "width"]);
    assert_says(&refusal("cameras", "21", "NaN"), &["camera 1", "cameras.txt", "not finite"]);
    assert_says(&refusal("cameras", "21", "-21"), &["camera 1", "cameras.txt", "focal length"]);
    assert_says(&refusal("cameras", "24 16", "0 16"), &["camera 1", "0 by 16"]);
    assert_says(&refusal("images", "0.9", "x"), &["line 2", "images.txt", "\"x\"", "rotation"]);
    assert_says(&refusal("images", "0.9", "NaN"), &["b.png", "images.txt", "not finite"]);
    assert_says(&refusal("images", " 1 a.png", " 5 a.png"), &["a.png", "images.txt", "the camera 5"]);
    assert_says(&refusal("images", " 1 a.png", " 1"), &["line 4", "images.txt", "no name"]);
    assert_says(&refusal("points3D", "255", "256"), &["line 2", "points3D.txt", "\"256\"", "red"]);
    let again = "1 PINHOLE 24 16 21 21 12 8\n1 PINHOLE";
    assert_says(&refusal("cameras", "1 PINHOLE", again), &["cameras.txt", "identifiers", "remove duplicates"]);
    for (missing, told) in [("cameras", "no cameras"), ("images", "no images")] {
        let folder = Scene::pinhole().folder();
        fs::remove_file(folder.path().join(format!("sparse/0/{missing}.txt"))).unwrap();
        assert_says(&load(folder.path()).unwrap_err().to_string(), &["sparse/0", told, "copy the whole folder"]);
    }
}

#[test]
fn a_byte_order_mark_before_a_list_is_skipped() {
    let folder = Scene::pinhole().folder();
    for name in ["cameras", "images", "points3D"] {
        let path = folder.path().join(format!("sparse/0/{name}.txt"));
        let text = fs::read_to_string(&path).unwrap();
        fs::write(&path, format!("\u{feff}{text}")).unwrap();
    }
    assert_eq!(load(folder.path()).unwrap().train.len(), load(Scene::pinhole().folder().path()).unwrap().train.len());
}

#[test]
fn points_that_are_not_finite_are_left_out() {
    let folder = Scene::pinhole().folder();
    let path = folder.path().join("sparse/0/points3D.txt");
    fs::write(&path, fs::read_to_string(&path).unwrap().replacen("0.5", "1e300", 1)).unwrap();
    let data = load(folder.path()).unwrap();
    assert_eq!(data.points.unwrap().positions.len(), 1);
    assert_says(&data.notes.join("\n"), &["skipped 1 points"]);
}

#[test]
fn without_points_training_starts_from_random_ones() {
    let folder = Scene::pinhole().folder();
    fs::remove_file(folder.path().join("sparse/0/points3D.txt")).unwrap();
    let data = load(folder.path()).unwrap();
    assert!(data.points.unwrap().positions.is_empty());
    assert_says(&data.notes.join("\n"), &["points3D.txt", "random"]);
}

/// In OpenGL's axes, looking down from z = 4.
pub(crate) const FROM_ABOVE: [[f64; 4]; 4] =
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 4.0], [0.0, 0.0, 0.0, 1.0]];

/// A data set of nerfstudio; `rest` is added to its list.
fn nerfstudio(rest: Value) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let names = ["images/c.png", "images/a.png", "images/b.png"];
    let frames = names.map(|name| json!({ "file_path": name, "transform_matrix": FROM_ABOVE }));
    let mut list =
        json!({ "w": WIDTH, "h": HEIGHT, "fl_x": 20.0, "fl_y": 21.0, "cx": 12.5, "cy": 7.5, "frames": frames });
    list.as_object_mut().unwrap().extend(rest.as_object().unwrap().clone());
    fs::write(folder.path().join("transforms.json"), list.to_string()).unwrap();
    names.iter().for_each(|name| picture().save(made(&folder.path().join(name))).unwrap());
    folder
}

#[test]
fn one_list_of_nerfstudio_is_split_by_name() {
    let folder = nerfstudio(json!({}));
    let data = load(folder.path()).unwrap();
    assert_eq!((names(&data.test), names(&data.train)), (vec!["a"], vec!["b", "c"]));
    let camera = data.train[0].camera;
    assert_eq!((camera.focal_px, camera.principal_px), ([20.0, 21.0], [12.5, 7.5]));
    assert_eq!((data.points, data.notes.len()), (None, 0));
}

#[test]
fn nerfstudio_names_what_is_held_out() {
    let folder = nerfstudio(json!({ "train_filenames": ["images/a.png"], "test_filenames": ["images/c.png"] }));
    let data = load(folder.path()).unwrap();
    assert_eq!((names(&data.test), names(&data.train)), (vec!["c"], vec!["a"]));
    assert_says(&data.notes.join("\n"), &["skipped 1 frames"]);
}

#[test]
fn nerfstudio_names_its_points() {
    let folder = nerfstudio(json!({ "ply_file_path": "sparse_pc.ply" }));
    let cloud = PointCloud { positions: vec![[1.0, 2.0, 3.0]], colors: vec![[0.0, 1.0, 0.2]] };
    points_ply::write(&folder.path().join("sparse_pc.ply"), &cloud).unwrap();
    assert_eq!(load(folder.path()).unwrap().points, Some(cloud));
}

#[test]
fn points_of_colmap_move_as_the_frames_did() {
    let transform = [[0.0, 1.0, 0.0, 10.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0]];
    let folder = nerfstudio(json!({ "applied_transform": transform }));
    Scene::pinhole().write_binary(folder.path());
    fs::create_dir(folder.path().join("colmap")).unwrap();
    fs::rename(folder.path().join("sparse"), folder.path().join("colmap/sparse")).unwrap();
    let data = load(folder.path()).unwrap();
    assert_eq!(data.points.unwrap().positions[0], [11.5, 0.5, 2.0]);
    assert_eq!(data.train[0].camera.position, Vec3::new(0.0, 0.0, 4.0));
}

#[test]
fn nerfstudio_names_masks() {
    let folder = nerfstudio(json!({}));
    let path = folder.path().join("transforms.json");
    let mut list: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    list["frames"][0]["mask_path"] = "hidden/m.png".into();
    fs::write(&path, list.to_string()).unwrap();
    RgbImage::new(WIDTH, HEIGHT).save(made(&folder.path().join("hidden/m.png"))).unwrap();
    let data = load(folder.path()).unwrap();
    let is_unknown = |view: &dataset::View| view.image.rgba.chunks(4).all(|pixel| pixel == UNKNOWN);
    assert_eq!(data.train.iter().map(is_unknown).collect::<Vec<_>>(), [false, true]);
}

#[test]
fn smaller_copies_need_a_lens_whose_size_is_known() {
    let folder = nerfstudio(json!({ "w": null, "h": null }));
    RgbImage::new(WIDTH / 2, HEIGHT / 2).save(made(&folder.path().join("images_2/b.png"))).unwrap();
    let data = load_with(&folder, LoadOptions { downscale: 2, ..LoadOptions::default() });
    assert_eq!((names(&data.train)[0], data.train[0].camera.focal_px), ("b", [10.0, 10.5]));
    assert_says(&data.notes.join("\n"), &["not used: \"images_2\" (1 files, copies for pictures 2 times smaller)"]);
}

#[test]
fn masks_turn_with_their_pictures_and_have_the_same_shape() {
    let scene = Scene { images: vec![("b.jpg", 1)], ..Scene::pinhole() };
    let folder = tempfile::tempdir().unwrap();
    scene.write_text(folder.path());
    let side = image::imageops::rotate270(&picture());
    jpeg_turned(&folder.path().join("images/b.jpg"), &side, 6);
    let mask = image::GrayImage::from_fn(WIDTH, HEIGHT, |x, _| image::Luma([if x < 6 { 0 } else { 255 }]));
    let path = folder.path().join("masks/b.png");
    let masked = |mask: &image::GrayImage| {
        mask.save(made(&path)).unwrap();
        load_with(&folder, LoadOptions { test_every: 0, ..LoadOptions::default() }).train[0].image.clone()
    };
    let upright = masked(&mask);
    assert_eq!(upright.rgba.chunks_exact(4).filter(|pixel| *pixel == UNKNOWN).count(), 6 * HEIGHT as usize);
    assert!(masked(&image::imageops::rotate270(&mask)) == upright, "a mask as the picture is stored");
    image::GrayImage::new(WIDTH, WIDTH).save(&path).unwrap();
    assert_says(
        &load(folder.path()).unwrap_err().to_string(),
        &["masks/b.png", "24 by 24", "24 by 16", "aspect ratios"],
    );
}

#[test]
fn doubtful_cameras_are_told() {
    let points = PointCloud { positions: vec![[0.0, 0.0, 0.0]; 3], colors: vec![[0.5; 3]; 3] };
    let doubts = |change: &dyn Fn(&mut Value)| {
        let named = |name| json!({ "file_path": format!("images/{name}.png"), "transform_matrix": FROM_ABOVE });
        let mut frames: Vec<Value> = ["a", "b", "c", "d"].map(named).into();
        for (index, frame) in frames.iter_mut().enumerate() {
            frame["transform_matrix"][0][3] = json!(index as f64);
        }
        frames.iter_mut().for_each(change);
        let folder = nerfstudio(json!({ "ply_file_path": "points.ply", "frames": frames }));
        picture().save(folder.path().join("images/d.png")).unwrap();
        points_ply::write(&folder.path().join("points.ply"), &points).unwrap();
        load(folder.path()).unwrap().notes.join("\n")
    };
    let usual = doubts(&|_| {});
    assert!(!usual.contains("times as far") && !usual.contains("in front of"), "{usual}");
    let far = doubts(&|frame| {
        if frame["transform_matrix"][0][3] == 3.0 {
            frame["transform_matrix"][0][3] = json!(500.0);
        }
    });
    assert_says(&far, &["camera of \"d\"", "times as far"]);
    let opposite = doubts(&|frame| {
        for (row, column) in [(1, 1), (2, 2)] {
            frame["transform_matrix"][row][column] = json!(-1.0);
        }
    });
    assert_says(&opposite, &["no point is in front of any camera"]);
}

#[test]
fn lenses_of_nerfstudio_are_undistorted_or_refused() {
    let distorted = nerfstudio(json!({ "camera_model": "OPENCV", "k1": -0.2, "p1": 0.01 }));
    let fisheye = nerfstudio(json!({ "camera_model": "OPENCV_FISHEYE", "k1": 0.05, "k4": 0.01 }));
    let straight = load(nerfstudio(json!({ "camera_model": "OPENCV", "k1": 0.0 })).path()).unwrap();
    assert_eq!(straight.train[0].image.rgba[4..8], [8, 0, 4, 255]);
    for folder in [distorted, fisheye] {
        let data = load(folder.path()).unwrap();
        assert_says(&data.notes.join("\n"), &["distortion of 3 pictures"]);
        assert_ne!(data.train[0].image.rgba, straight.train[0].image.rgba);
    }
    let refusal = |rest: Value| load(nerfstudio(rest).path()).unwrap_err().to_string();
    assert_says(
        &refusal(json!({ "camera_model": "EQUIRECTANGULAR", "fl_x": null })),
        &["EQUIRECTANGULAR", "OPENCV_FISHEYE", "transforms.json"],
    );
    assert_says(&refusal(json!({ "k4": 0.1 })), &["k4", "OPENCV_FISHEYE", "images/"]);
}

#[test]
fn a_reconstruction_of_its_own_comes_before_a_list() {
    let folder = nerfstudio(json!({}));
    Scene::pinhole().write_text(folder.path());
    assert_says(&load(folder.path()).unwrap().report.source, &["COLMAP"]);
}

/// Data set with one picture, which `write` writes to a path without an ending.
fn one_picture(write: impl FnOnce(&Path)) -> TempDir {
    let scene = Scene { images: vec![("a.jpg", 1)], ..Scene::pinhole() };
    let folder = tempfile::tempdir().unwrap();
    scene.write_text(folder.path());
    write(&made(&folder.path().join("images/a")));
    folder
}

fn load_in(folder: &Path, space: InputSpace, downscale: u32) -> Dataset {
    dataset::load(folder, &LoadOptions { space, downscale, test_every: 0, ..LoadOptions::default() }, |_, _| {})
        .unwrap()
}

/// Asserts that the first pixels have this radiance, within steps of a half.
fn assert_radiance(data: &Dataset, expected: &[[f32; 3]]) {
    let image = &data.train[0].image;
    let found = image.unclipped.as_ref().expect("the picture is linear");
    for (index, (found, expected)) in found.iter().zip(expected).enumerate() {
        for (c, (found, expected)) in found.iter().zip(expected).enumerate() {
            let encoded = srgb_from_linear(*expected);
            assert!((f32::from(*found) - encoded).abs() <= 1e-3 * encoded, "{found} instead of {encoded}");
            let byte = (255.0 * encoded).clamp(0.0, 255.0).round() as u8;
            assert!(image.rgba[4 * index + c].abs_diff(byte) <= 1, "bytes are the clipped numbers");
        }
    }
}

#[test]
fn openexr_keeps_radiance_above_white() {
    let folder = one_picture(|path| {
        let pixel = |x: u32, y: u32| match (x, y) {
            (0, 0) => Rgba([12.5, 0.5, 0.0, 1.0]),
            (1, 0) => Rgba([2.0, 0.25, 0.05, 0.5]),
            (2, 0) => Rgba([1.0, f32::NAN, 1.0, 1.0]),
            (3, 0) => Rgba([-1.0, f32::INFINITY, 0.2, 1.0]),
            _ => Rgba([0.1, 0.2, 0.3, 1.0]),
        };
        Rgba32FImage::from_fn(WIDTH, HEIGHT, pixel).save(path.with_extension("exr")).unwrap();
    });
    let data = load_in(folder.path(), InputSpace::Auto, 1);
    // Colours of OpenEXR are multiplied by alpha; a half ends at 65504.
    let expected = [[12.5, 0.5, 0.0], [4.0, 0.5, 0.1], [0.0; 3], [0.0, 65504.0, 0.2], [0.1, 0.2, 0.3]];
    let image = &data.train[0].image;
    assert_eq!(image.rgba[8..12], UNKNOWN, "what is no number is unknown");
    assert_eq!((image.rgba[3], image.rgba[7]), (255, 128));
    let mut known = data.clone();
    known.train[0].image.rgba[8..12].copy_from_slice(&[0, 0, 0, 255]);
    assert_radiance(&known, &expected);
    assert!(data.notes.iter().any(|note| note.contains("1 pictures are linear")), "{:?}", data.notes);
}

#[test]
fn linear_pictures_of_integers_are_read_as_declared() {
    let deep = ImageBuffer::<Rgb<u16>, _>::from_fn(WIDTH, HEIGHT, |x, _| Rgb([x as u16 * 2000, 65535, 300]));
    let radiance: Vec<[f32; 3]> = (0..WIDTH).map(|x| [x as f32 * 2000.0 / 65535.0, 1.0, 300.0 / 65535.0]).collect();
    for ending in ["png", "tif", "TIFF"] {
        let folder = one_picture(|path| deep.save(path.with_extension(ending)).unwrap());
        assert_radiance(&load_in(folder.path(), InputSpace::Linear, 1), &radiance);
        let plain = load_in(folder.path(), InputSpace::Auto, 1);
        assert_eq!(plain.train[0].image.unclipped, None, "without a word of it, numbers are sRGB");
        assert_eq!(plain.train[0].image.rgba[4..8], [8, 255, 1, 255]);
    }
    let folder = one_picture(|path| {
        let mut encoder = png::Encoder::new(fs::File::create(path.with_extension("png")).unwrap(), WIDTH, HEIGHT);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Sixteen);
        encoder.set_source_gamma(png::ScaledFloat::new(1.0));
        let bytes: Vec<u8> = deep.as_raw().iter().flat_map(|number| number.to_be_bytes()).collect();
        encoder.write_header().unwrap().write_image_data(&bytes).unwrap();
    });
    assert_radiance(&load_in(folder.path(), InputSpace::Auto, 1), &radiance);
}

#[test]
fn acescg_is_converted_and_averages_stay_above_white() {
    let folder = one_picture(|path| {
        let pixel = |x: u32, _| Rgb([if x.is_multiple_of(2) { 8.0 } else { 0.5 }; 3]);
        Rgb32FImage::from_fn(WIDTH, HEIGHT, pixel).save(path.with_extension("exr")).unwrap();
    });
    assert_radiance(&load_in(folder.path(), InputSpace::AcesCg, 1), &[[8.0; 3], [0.5; 3]]);
    let halved = load_in(folder.path(), InputSpace::Auto, 2);
    let image = &halved.train[0].image;
    let expected = (srgb_from_linear(8.0_f32) + srgb_from_linear(0.5_f32)) / 2.0;
    let found = f32::from(image.unclipped.as_ref().unwrap()[3][1]);
    assert!((found - expected).abs() < 2e-3, "{found} instead of {expected}");
    assert_eq!(image.rgba[..3], [255; 3]);
}
