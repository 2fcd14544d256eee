//! Data sets and lists of cameras: what is read, and how what cannot be read is refused.

use core::sync::atomic::{AtomicUsize, Ordering};
use glam::{Mat3, Vec3};
use image::{Rgba, RgbaImage};
use serde_json::{Value, json};
use specula_core::camera::Camera;
use specula_io::{
    Result, cameras,
    dataset::{self, Dataset, LoadOptions},
    materials::Materials,
    points_ply::{self, PointCloud},
};
use std::{
    fs,
    path::{Path, PathBuf},
};
use tempfile::TempDir;

/// A camera at (0, 0, 4) that looks down, in OpenGL's axes.
const FROM_ABOVE: [[f64; 4]; 4] =
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 4.0], [0.0, 0.0, 0.0, 1.0]];
const ANGLE: f64 = 0.8;

fn frame(file_path: &str) -> Value {
    json!({ "file_path": file_path, "rotation": 0.1, "transform_matrix": FROM_ABOVE })
}

fn list(frames: &[Value]) -> Value {
    json!({ "camera_angle_x": ANGLE, "frames": frames })
}

fn write(folder: &TempDir, name: &str, text: impl AsRef<[u8]>) -> PathBuf {
    let path = folder.path().join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(&path, text).unwrap();
    path
}

fn write_image(folder: &TempDir, name: &str, width: u32, height: u32, color: [u8; 4]) {
    let path = folder.path().join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    let image = image::DynamicImage::from(RgbaImage::from_pixel(width, height, Rgba(color)));
    if name.ends_with("jpg") { image.to_rgb8().save(path).unwrap() } else { image.save(path).unwrap() }
}

/// Two training views and one test view, in three formats and two sizes.
fn scene() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    write(&folder, "transforms_train.json", list(&[frame("./train/r_0"), frame("train/r_1.png")]).to_string());
    write(&folder, "transforms_test.json", list(&[frame("./test/r_0")]).to_string());
    write_image(&folder, "train/r_0.png", 8, 6, [10, 20, 30, 128]);
    write_image(&folder, "train/r_1.webp", 4, 4, [1, 2, 3, 255]);
    write_image(&folder, "test/r_0.jpg", 8, 8, [90, 90, 90, 255]);
    folder
}

fn load(folder: &Path) -> Result<Dataset> {
    dataset::load(folder, &LoadOptions::default(), |_, _| {})
}

fn refusal(folder: &Path) -> String {
    load(folder).expect_err("this data set is broken").to_string()
}

/// That a sentence says all of this.
fn assert_says(sentence: &str, parts: &[&str]) {
    for part in parts {
        assert!(sentence.contains(part), "{part:?} is missing in: {sentence}");
    }
}

#[test]
fn images_are_found_with_and_without_ending_and_with_another_one() {
    let data = load(scene().path()).unwrap();
    let names: Vec<&str> = data.train.iter().map(|view| view.name.as_str()).collect();
    assert_eq!(names, ["r_0", "r_1"]);
    assert_eq!(data.train[0].image.rgba[..4], [10, 20, 30, 128]);
    assert_eq!(data.test[0].image.rgba[3], 255);
    assert!(data.notes.is_empty(), "{:?}", data.notes);
}

#[test]
fn every_camera_has_the_size_of_its_own_image() {
    let data = load(scene().path()).unwrap();
    for view in &data.train {
        let focal = 0.5 * f64::from(view.image.width) / (0.5 * ANGLE).tan();
        assert_eq!([view.camera.width, view.camera.height], [view.image.width, view.image.height]);
        assert!((f64::from(view.camera.focal_px[0]) - focal).abs() < 1e-4);
        assert_eq!(view.camera.focal_px[0], view.camera.focal_px[1]);
        assert_eq!(view.camera.principal_px, [0.5 * view.image.width as f32, 0.5 * view.image.height as f32]);
    }
}

#[test]
fn opengl_axes_become_ours() {
    let camera = load(scene().path()).unwrap().train[0].camera;
    let below_and_right = camera.camera_from_world * (Vec3::new(1.0, 2.0, 0.0) - camera.position);
    // OpenGL's +y is up in the picture, which is our −y; 4 below the camera is 4 ahead of it.
    assert!((below_and_right - Vec3::new(1.0, -2.0, 4.0)).length() < 1e-6);
}

#[test]
fn test_views_are_trained_on_unless_they_are_held_out() {
    let folder = scene();
    let options = LoadOptions { with_test: false, ..LoadOptions::default() };
    let data = dataset::load(folder.path(), &options, |_, _| {}).unwrap();
    assert_eq!((data.train.len(), data.test.len()), (3, 0));
}

#[test]
fn downscaling_takes_cameras_and_images_along() {
    let options = LoadOptions { downscale: 2, ..LoadOptions::default() };
    let data = dataset::load(scene().path(), &options, |_, _| {}).unwrap();
    let view = &data.train[0];
    assert_eq!([view.image.width, view.image.height, view.camera.width, view.camera.height], [4, 3, 4, 3]);
    assert_eq!(view.image.rgba, [10, 20, 30, 128].repeat(12));
    let full = load(scene().path()).unwrap().train[0].camera;
    assert_eq!(view.camera.focal_px[0], 0.5 * full.focal_px[0]);
}

#[test]
fn progress_counts_every_image() {
    let (calls, most) = (AtomicUsize::new(0), AtomicUsize::new(0));
    dataset::load(scene().path(), &LoadOptions::default(), |done, all| {
        calls.fetch_add(1, Ordering::Relaxed);
        most.fetch_max(done, Ordering::Relaxed);
        assert_eq!(all, 3);
    })
    .unwrap();
    assert_eq!((calls.into_inner(), most.into_inner()), (3, 3));
}

#[test]
fn normals_stand_beside_test_images() {
    let folder = scene();
    write_image(&folder, "test/r_0_normal.png", 8, 8, [255, 128, 128, 255]);
    let data = load(folder.path()).unwrap();
    let normals = data.test[0].normal.as_ref().unwrap();
    assert!(normals.mask.iter().all(|mask| *mask), "alpha is 255 everywhere");
    assert!((Vec3::from(normals.values[0]) - Vec3::X).length() < 0.01);
    assert!((Vec3::from(normals.values[0]).length() - 1.0).abs() < 1e-6);
}

#[test]
fn an_opaque_picture_has_normals_where_its_coverage_is_at_least_one_half() {
    let folder = scene();
    write_image(&folder, "test/r_0_normal.png", 8, 8, [255, 128, 128, 255]);
    let coverage = |x: u32, y: u32| image::Luma([if y < 6 { [0, 127, 128, 255][x as usize / 2] } else { 0 }]);
    image::GrayImage::from_fn(8, 8, coverage).save(folder.path().join("test/r_0_alpha.png")).unwrap();
    let view = &load(folder.path()).unwrap().test[0];
    let normals = view.normal.as_ref().unwrap();
    let expected = |pixel: usize| pixel % 8 >= 4 && pixel / 8 < 6;
    assert!((0..64).all(|pixel| normals.mask[pixel] == expected(pixel)), "{:?}", normals.mask);
    assert!((0..64).all(|pixel| (normals.values[pixel] != [0.0; 3]) == expected(pixel)));
    assert!(view.image.rgba.chunks(4).all(|pixel| pixel[3] == 255), "the picture stays as it is");
}

#[test]
fn materials_stand_beside_test_images_and_lambertian_ones_have_no_roughness() {
    let folder = scene();
    assert!(load(folder.path()).unwrap().test[0].materials.is_empty());
    write_image(&folder, "test/r_0_albedo.png", 8, 8, [200, 100, 50, 255]);
    let half = |x: u32, _| Rgba(if x < 4 { [51, 255, 0, 255] } else { [77, 7, 255, 255] });
    RgbaImage::from_fn(8, 8, half).save(folder.path().join("test/r_0_material.png")).unwrap();
    for downscale in [1, 2, 8] {
        let options = LoadOptions { downscale, ..LoadOptions::default() };
        let data = dataset::load(folder.path(), &options, |_, _| {}).unwrap();
        let Materials { albedo, surface } = data.test[0].materials.clone();
        let (albedo, surface) = (albedo.unwrap(), surface.unwrap());
        assert_eq!([albedo.width, albedo.height, surface.width], [8 / downscale; 3]);
        assert!(albedo.rgba.chunks(4).all(|pixel| pixel == [200, 100, 50, 255]));
        assert_eq!(surface.rgba[..3], [51, 255, 0], "Lambertian surfaces have no share in a mean");
        assert_eq!(surface.rgba[3], if downscale == 8 { 128 } else { 255 });
        assert!(downscale == 8 || surface.rgba[4 * surface.width as usize - 1] == 0, "they have no truth");
    }
    assert!(load(folder.path()).unwrap().train.iter().all(|view| view.materials.is_empty()));
}

#[test]
fn materials_of_another_size_or_kind_are_refused_in_one_sentence() {
    let folder = scene();
    write_image(&folder, "test/r_0_material.png", 4, 8, [0; 4]);
    let said = refusal(folder.path());
    assert_says(&said, &["r_0_material.png", "has 4 by 8 pixels", "8 by 8", "remove it"]);
    write(&folder, "test/r_0_material.png", "no picture");
    assert_says(&refusal(folder.path()), &["r_0_material.png"]);
    fs::remove_file(folder.path().join("test/r_0_material.png")).unwrap();
    assert!(load(folder.path()).is_ok());
}

#[test]
fn some_missing_normals_are_noted() {
    let folder = scene();
    write(&folder, "transforms_test.json", list(&[frame("test/r_0"), frame("train/r_0")]).to_string());
    write_image(&folder, "test/r_0_normal.png", 8, 8, [255, 128, 128, 255]);
    assert_says(&load(folder.path()).unwrap().notes.join("\n"), &["1 of 2 test views"]);
}

#[test]
fn files_of_macos_are_skipped_and_noted() {
    let folder = scene();
    write(&folder, "transforms_train.json", list(&[frame("train/._r_0"), frame("train/r_0")]).to_string());
    let data = load(folder.path()).unwrap();
    assert_eq!(data.train.len(), 1);
    assert_says(&data.notes.join("\n"), &["train/._r_0", "macOS"]);
}

#[test]
fn a_missing_test_list_is_noted() {
    let folder = scene();
    fs::remove_file(folder.path().join("transforms_test.json")).unwrap();
    let data = load(folder.path()).unwrap();
    assert!(data.test.is_empty());
    assert_says(&data.notes.join("\n"), &["transforms_test.json"]);
}

#[test]
fn a_point_cloud_comes_from_the_folder_or_from_the_options() {
    let folder = scene();
    let cloud = |x| PointCloud { positions: vec![[x, 2.0, 3.0]], colors: vec![[0.0, 1.0, 0.2]] };
    points_ply::write(&folder.path().join("points3d.ply"), &cloud(1.0)).unwrap();
    points_ply::write(&folder.path().join("other.ply"), &cloud(5.0)).unwrap();
    let other = LoadOptions { points: Some(folder.path().join("other.ply")), ..LoadOptions::default() };
    assert_eq!(load(folder.path()).unwrap().points, Some(cloud(1.0)));
    assert_eq!(dataset::load(folder.path(), &other, |_, _| {}).unwrap().points, Some(cloud(5.0)));
}

#[test]
fn focal_lengths_of_a_frame_win_over_those_of_the_file() {
    let folder = scene();
    let mut own = frame("train/r_0");
    own["fl_x"] = 20.0.into();
    own["fl_y"] = 22.0.into();
    own["cx"] = 7.0.into();
    own["cy"] = 5.0.into();
    own["w"] = 16.into();
    own["h"] = 12.into();
    write(&folder, "transforms_train.json", list(&[own]).to_string());
    let camera = load(folder.path()).unwrap().train[0].camera;
    // The image is half as large as the file says.
    assert_eq!((camera.focal_px, camera.principal_px), ([10.0, 11.0], [3.5, 2.5]));
}

#[test]
fn a_uniform_scale_is_taken_out_of_a_pose() {
    let folder = scene();
    let mut scaled = frame("train/r_0");
    let matrix = FROM_ABOVE.map(|[a, b, c, translation]| [2.5 * a, 2.5 * b, 2.5 * c, translation]);
    scaled["transform_matrix"] = json!(matrix);
    write(&folder, "transforms_train.json", list(&[scaled]).to_string());
    let camera = load(folder.path()).unwrap().train[0].camera;
    let excess = camera.camera_from_world * camera.camera_from_world.transpose() - Mat3::IDENTITY;
    assert!(excess.to_cols_array().iter().all(|number| number.abs() < 1e-6), "{excess}");
    assert_eq!(camera.position, Vec3::new(0.0, 0.0, 4.0));
}

#[test]
fn a_missing_folder_is_refused() {
    assert_says(&refusal(Path::new("/no/such/folder")), &["/no/such/folder", "transforms_train.json"]);
}

#[test]
fn a_folder_without_cameras_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    assert_says(&refusal(folder.path()), &["no transforms_train.json", "transforms_test.json", "expected"]);
}

#[test]
fn zero_times_smaller_is_refused() {
    let options = LoadOptions { downscale: 0, ..LoadOptions::default() };
    let error = dataset::load(scene().path(), &options, |_, _| {}).unwrap_err();
    assert_says(&error.to_string(), &["downscale the images", "by 0", "1, 2, 4 or 8"]);
}

#[test]
fn broken_json_is_refused_with_line_and_column() {
    let folder = scene();
    write(&folder, "transforms_train.json", "{\n \"camera_angle_x\": 0.8,\n \"frames\": [oops]\n}");
    assert_says(&refusal(folder.path()), &["transforms_train.json", "line 3, column 13"]);
}

#[test]
fn nan_in_a_matrix_is_refused_with_its_line() {
    let folder = scene();
    let text = serde_json::to_string_pretty(&list(&[frame("train/r_0")])).unwrap().replacen("4.0", "NaN", 1);
    write(&folder, "transforms_train.json", text);
    assert_says(&refusal(folder.path()), &["transforms_train.json", "line"]);
}

#[test]
fn an_empty_list_is_refused() {
    let folder = scene();
    write(&folder, "transforms_train.json", list(&[]).to_string());
    assert_says(&refusal(folder.path()), &["no frames", "transforms_train.json"]);
}

#[test]
fn a_missing_image_is_noted_and_that_of_all_is_refused() {
    let folder = scene();
    fs::remove_file(folder.path().join("train/r_0.png")).unwrap();
    let data = load(folder.path()).unwrap();
    assert_eq!((data.train[0].name.as_str(), data.train.len(), data.test.len()), ("r_1", 1, 1));
    assert_says(&data.notes.join("\n"), &["skipped 1 cameras", "train/r_0\""]);
    fs::remove_file(folder.path().join("train/r_1.webp")).unwrap();
    assert_says(&refusal(folder.path()), &["none of the images", "train/r_0\""]);
}

#[test]
fn test_views_that_were_never_rendered_keep_no_training_from_starting() {
    let folder = scene();
    fs::remove_file(folder.path().join("test/r_0.jpg")).unwrap();
    for (frames, expected) in [(vec![frame("./test/r_0")], "such as \"test/r_0\""), (vec![], "no frames")] {
        write(&folder, "transforms_test.json", list(&frames).to_string());
        let data = load(folder.path()).unwrap();
        assert_eq!((data.train.len(), data.test.len()), (2, 0));
        assert_says(&data.notes.join("\n"), &["no test views", "transforms_test.json", expected]);
    }
}

#[test]
fn a_rotation_of_three_decimals_is_made_orthogonal() {
    let folder = scene();
    const EXACT: [[f32; 3]; 3] = [
        [-0.743_505_5, -0.366_350_1, -0.559_452_5],
        [-0.619_521_2, 0.062_362_4, 0.782_498_8],
        [-0.251_779_7, 0.928_384_9, -0.273_328_5],
    ];
    let rows = EXACT.map(|row| row.map(|number| (f64::from(number) * 1000.0).round() / 1000.0));
    let mut coarse = frame("train/r_0");
    coarse["transform_matrix"] = rows.map(|[x, y, z]| [x, y, z, 1.0]).to_vec().into();
    write(&folder, "transforms_train.json", list(&[coarse]).to_string());
    let data = load(folder.path()).unwrap();
    assert_says(&data.notes.join("\n"), &["1 rotations", "few decimals"]);
    let found = data.train[0].camera.camera_from_world;
    let excess = found * found.transpose() - Mat3::IDENTITY;
    assert!(excess.to_cols_array().iter().all(|number| number.abs() < 1e-6), "{excess}");
    // World-from-camera, y and z reversed.
    let expected = Mat3::from_cols_array_2d(&EXACT).transpose() * Mat3::from_diagonal(Vec3::new(1.0, -1.0, -1.0));
    let error = found.transpose() - expected;
    assert!(error.to_cols_array().iter().all(|number| number.abs() < 1e-3), "{error}");
}

#[test]
fn an_image_without_pixels_or_with_half_of_its_bytes_is_refused() {
    let folder = scene();
    let path = folder.path().join("train/r_0.png");
    let whole = fs::read(&path).unwrap();
    fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    assert_says(&refusal(folder.path()), &["cannot decode", "r_0.png"]);
    fs::write(&path, "").unwrap();
    assert_says(&refusal(folder.path()), &["cannot decode", "r_0.png"]);
}

#[test]
fn impossible_lenses_are_refused() {
    let folder = scene();
    let put_lens = |lens: Value| {
        let mut file = json!({ "frames": [frame("train/r_0")] });
        file.as_object_mut().unwrap().extend(lens.as_object().unwrap().clone());
        write(&folder, "transforms_train.json", file.to_string());
        refusal(folder.path())
    };
    assert_says(&put_lens(json!({})), &["train/r_0", "no focal length", "camera_angle_x"]);
    assert_says(&put_lens(json!({ "camera_angle_x": 4.0 })), &["train/r_0", "impossible focal length"]);
    assert_says(&put_lens(json!({ "fl_x": -1.0 })), &["train/r_0", "impossible focal length"]);
}

#[test]
fn impossible_poses_are_refused() {
    let folder = scene();
    let put_pose = |matrix: Value| {
        let mut broken = frame("train/r_0");
        broken["transform_matrix"] = matrix;
        write(&folder, "transforms_train.json", list(&[frame("train/r_1"), broken]).to_string());
        refusal(folder.path())
    };
    let with = |row: usize, column: usize, number: f64| {
        let mut matrix = FROM_ABOVE;
        matrix[row][column] = number;
        json!(matrix)
    };
    assert_says(&put_pose(with(1, 1, 1e300)), &["train/r_0", "not finite in row 2"]);
    assert_says(&put_pose(with(0, 0, 1.01)), &["train/r_0", "stretches or skews"]);
    assert_says(&put_pose(with(0, 1, 0.01)), &["train/r_0", "stretches or skews"]);
    assert_says(&put_pose(with(0, 0, -1.0)), &["train/r_0", "mirrors"]);
    assert_says(&put_pose(json!(vec![[0.0; 4]; 4])), &["train/r_0", "stretches or skews"]);
    assert_says(&put_pose(json!([[1.0, 0.0, 0.0, 0.0]])), &["train/r_0", "1 rows"]);
}

#[test]
fn of_several_faults_the_first_is_reported() {
    let folder = scene();
    for name in ["train/r_0.png", "train/r_1.webp", "test/r_0.jpg"] {
        write(&folder, name, "no image");
    }
    for _ in 0..10 {
        assert_says(&refusal(folder.path()), &["r_0.png"]);
    }
}

fn some_camera() -> Camera {
    Camera::look_at(Vec3::new(1.0, -3.0, 2.0), Vec3::ZERO, Vec3::Z, 0.7, 320, 200)
}

#[test]
fn cameras_json_survives_a_round_trip() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cameras.json");
    let off_centre = Camera { principal_px: [100.0, 90.0], ..some_camera() };
    let written = [("a".to_owned(), some_camera()), ("b".to_owned(), off_centre)];
    cameras::write(&path, &written, [0.0; 3]).unwrap();
    assert_eq!(cameras::read_cameras(&path, [1, 1], [0.0; 3]).unwrap(), written);
}

#[test]
fn cameras_json_has_the_keys_of_other_tools() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cameras.json");
    cameras::write(&path, &[("a".to_owned(), some_camera())], [0.0; 3]).unwrap();
    let entry = serde_json::from_slice::<Value>(&fs::read(path).unwrap()).unwrap()[0].clone();
    let keys: Vec<&str> = entry.as_object().unwrap().keys().map(String::as_str).collect();
    assert_eq!(keys, ["fx", "fy", "height", "id", "img_name", "position", "rotation", "width"]);
    // The last column of camera-to-world is where the camera looks.
    let forward = (Vec3::ZERO - some_camera().position).normalize();
    let column: Vec<f64> = (0..3).map(|row| entry["rotation"][row][2].as_f64().unwrap()).collect();
    assert!((Vec3::new(column[0] as f32, column[1] as f32, column[2] as f32) - forward).length() < 1e-6);
}

#[test]
fn transforms_to_render_along_need_no_images() {
    let folder = tempfile::tempdir().unwrap();
    let mut file = list(&[frame("a"), frame("b")]);
    let path = write(&folder, "path.json", file.to_string());
    let cameras = cameras::read_cameras(&path, [64, 48], [0.0; 3]).unwrap();
    assert_eq!((cameras[1].0.as_str(), cameras[1].1.width, cameras[1].1.height), ("b", 64, 48));

    write_image(&folder, "a.png", 20, 10, [0; 4]);
    assert_eq!(cameras::load_transforms(&path, [64, 48], [0.0; 3]).unwrap()[0].1.width, 20);

    file["w"] = 32.into();
    file["h"] = 24.into();
    write(&folder, "path.json", file.to_string());
    assert_eq!(cameras::load_transforms(&path, [64, 48], [0.0; 3]).unwrap()[0].1.width, 32);
}

#[test]
fn impossible_cameras_json_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cameras.json");
    let refused = |camera| {
        cameras::write(&path, &[("view_7".to_owned(), camera)], [0.0; 3]).unwrap();
        cameras::read_cameras(&path, [1, 1], [0.0; 3]).unwrap_err().to_string()
    };
    let camera = some_camera();
    assert_says(&refused(Camera { width: 0, ..camera }), &["cameras.json", "view_7", "0 by 200 pixels"]);
    assert_says(&refused(Camera { focal_px: [0.0, 1.0], ..camera }), &["view_7", "focal length"]);
    assert_says(&refused(Camera { camera_from_world: Mat3::IDENTITY * 2.0, ..camera }), &["view_7", "stretches"]);
    fs::write(&path, "[]").unwrap();
    assert_says(&cameras::read_cameras(&path, [1, 1], [0.0; 3]).unwrap_err().to_string(), &["no frames"]);
}

#[test]
fn one_view_is_read_as_among_all() {
    let folder = scene();
    for with_test in [false, true] {
        let options = LoadOptions { downscale: 2, with_test, ..LoadOptions::default() };
        let all = dataset::load(folder.path(), &options, |_, _| {}).unwrap();
        let one = |is_held_out, index| dataset::load_one(folder.path(), &options, is_held_out, index).unwrap();
        for (index, view) in all.train.iter().enumerate() {
            assert_eq!(one(false, index).as_ref(), Some(view), "view {index} to fit");
        }
        for (index, view) in all.test.iter().enumerate() {
            assert_eq!(one(true, index).as_ref(), Some(view), "view {index} that is held out");
        }
        assert_eq!(one(true, 1), None, "there are no more");
    }
}
