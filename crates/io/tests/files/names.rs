//! Names of lists as any system writes them, and other files of a data set: used, or noted.

use crate::photographs::{FROM_ABOVE, HEIGHT, Scene, WIDTH, assert_says, made, names, picture};
use image::{GrayImage, Luma, Rgb, RgbImage};
use serde_json::{Value, json};
use specula_core::color::UNKNOWN;
use specula_io::{
    dataset::{self, Dataset, LoadOptions},
    points_ply,
};
use std::{fs, path::Path};
use tempfile::TempDir;

/// Pictures that differ, in a folder.
fn write_pictures(folder: &TempDir, paths: &[&str]) {
    for (index, path) in paths.iter().enumerate() {
        let color = Rgb([10 + 20 * index as u8, 7, 9]);
        let (path, format) = (made(&folder.path().join(path)), image::ImageFormat::Png);
        RgbImage::from_pixel(WIDTH, HEIGHT, color).save_with_format(path, format).unwrap();
    }
}

/// List of cameras, each at another height.
fn list(names: &[&str], rest: Value) -> String {
    let frames = names.iter().enumerate().map(|(index, name)| {
        let mut matrix = FROM_ABOVE;
        matrix[2][3] += index as f64;
        json!({ "file_path": name, "transform_matrix": matrix })
    });
    let frames: Vec<Value> = frames.collect();
    let mut list = json!({ "w": WIDTH, "h": HEIGHT, "fl_x": 20.0, "frames": frames });
    list.as_object_mut().unwrap().extend(rest.as_object().unwrap().clone());
    list.to_string()
}

fn data_set(file: &str, names: &[&str], stored: &[&str], rest: Value) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_pictures(&folder, stored);
    fs::write(folder.path().join(file), list(names, rest)).unwrap();
    folder
}

/// All views are for training.
fn options() -> LoadOptions {
    LoadOptions { with_test: false, test_every: 0, ..LoadOptions::default() }
}

fn try_load(folder: &TempDir, options: &LoadOptions) -> specula_io::Result<Dataset> {
    dataset::load(folder.path(), options, |_, _| {})
}

fn load(folder: &TempDir) -> Dataset {
    try_load(folder, &options()).unwrap()
}

/// First byte of each picture, by the height of its camera.
fn pictures(data: &Dataset) -> Vec<u8> {
    let mut views: Vec<_> = data.train.iter().collect();
    views.sort_by(|one, other| one.camera.position.z.total_cmp(&other.camera.position.z));
    views.iter().map(|view| view.image.rgba[0]).collect()
}

fn remark(data: &Dataset) -> String {
    data.notes.join("\n")
}

#[test]
fn names_of_any_system_find_their_pictures() {
    let stored = ["images/a/x.png", "images/b/x.png", "images/b/y.png"];
    for names in [
        [r"images\a\x.png", r"images\b\x.png", r"images\b\y.png"],
        [r".\images\a\x.png", "./images/b/x.png", "images/./a/../b//y.png"],
        ["IMAGES/A/X.PNG", "images/b/X.png", "Images/b/y.Png"],
        ["images/a/x.bmp", "images/b/x.HEIC", "images/b/y.png.png"],
        [r"C:\data\images\a\x.png", r"C:\data\images\b\x.png", r"C:\data\images\b\y.png"],
        ["/home/me/a/x.png", "/home/me/b/x.jpg", "../../b/y"],
    ] {
        for file in ["transforms.json", "transforms_train.json"] {
            let data = load(&data_set(file, &names, &stored, json!({})));
            assert_eq!(pictures(&data), [10, 30, 50], "{names:?} in {file}: {:?}", data.notes);
        }
    }
    let [composed, decomposed] = ["images/é.png", "images/e\u{301}.png"];
    let data = load(&data_set("transforms.json", &[composed], &[decomposed], json!({})));
    assert_eq!(pictures(&data), [10]);
    let data = load(&data_set("transforms.json", &["images/x.png"], &["images/x.png.png"], json!({})));
    assert_eq!(pictures(&data), [10]);
    let data = load(&data_set("transforms.json", &["/a/b/x.png"], &["images/x.png"], json!({})));
    assert_says(&remark(&data), &["\"/a/b/x.png\" is not in a folder", "using \"images/x.png\""]);
}

#[test]
fn several_pictures_that_may_be_meant_are_told_and_none_is_taken() {
    let folder = data_set("transforms.json", &["images/A.png", "images/b.png"], &["images/b.png"], json!({}));
    write_pictures(&folder, &["images/a.PNG", "images/a.jpg"]);
    // A name apart from its case comes before another ending, and one camera has no other's
    // picture.
    assert_eq!(load(&folder).train.len(), 2);
    fs::rename(folder.path().join("images/a.PNG"), folder.path().join("images/a.webp")).unwrap();
    let data = load(&folder);
    assert_eq!(names(&data.train), ["b"]);
    assert_says(&remark(&data), &["1 cameras with several matching images", "\"A.png\""]);
    let moved = data_set("transforms.json", &["images/x.png", "photos/x.png"], &["images/x.png"], json!({}));
    let data = load(&moved);
    assert_eq!(pictures(&data), [10]);
    assert_says(&remark(&data), &["skipped 1 cameras that share an image with another one"]);
}

#[test]
fn test_views_do_not_get_the_pictures_of_training_views() {
    let folder = data_set("transforms_train.json", &["/data/train/r_0"], &["images/r_0.png"], json!({}));
    fs::write(folder.path().join("transforms_test.json"), list(&["/data/test/r_0"], json!({}))).unwrap();
    let data = load(&folder);
    assert_eq!(pictures(&data), [10]);
    assert_says(&remark(&data), &["skipped 1 test views that share an image with a training view: \"/data/test/r_0\""]);
}

#[test]
fn colmap_names_pictures_on_windows_and_one_of_them_twice() {
    let names = [r"cam\a.png", r"cam\b.png", r"D:\photos\cam\b.png"];
    let scene = Scene { images: names.map(|name| (name, 1)).to_vec(), ..Scene::pinhole() };
    let folder = tempfile::tempdir().unwrap();
    scene.write_text(folder.path());
    write_pictures(&folder, &["images/cam/a.png", "images/cam/b.png"]);
    let data = load(&folder);
    assert_eq!(crate::photographs::names(&data.train), ["a", "b"]);
    assert_says(&remark(&data), &["skipped 1 cameras that share an image with another one"]);
}

#[test]
fn split_lists_and_masks_and_points_may_be_named_on_windows() {
    let split = json!({ "train_filenames": [r"images\a.png", "nothing.png"], "test_filenames": [r".\images\b.png"],
        "ply_file_path": r"C:\scene\points.ply" });
    let folder =
        data_set("transforms.json", &["images/a.png", "images/b.png"], &["images/a.png", "images/b.png"], split);
    let list = folder.path().join("transforms.json");
    let named = fs::read_to_string(&list).unwrap().replace(
        r#""file_path":"images/a.png""#,
        r#""file_path":"images/a.png","mask_path":"C:\\scene\\hidden\\a.png""#,
    );
    fs::write(list, named).unwrap();
    GrayImage::new(WIDTH, HEIGHT).save(made(&folder.path().join("hidden/a.png"))).unwrap();
    write_points(&folder, "points.ply", "uchar", ["red", "green", "blue"], "0 51 255");
    let data = try_load(&folder, &LoadOptions { test_every: 3, ..LoadOptions::default() }).unwrap();
    assert_eq!((names(&data.train), names(&data.test)), (vec!["a"], vec!["b"]));
    assert!(data.train[0].image.rgba.chunks(4).all(|pixel| pixel == UNKNOWN), "its mask is black");
    assert_eq!(data.points.as_ref().unwrap().colors, [[0.0, 0.2, 1.0]]);
    let parts = [
        "1 names of train_filenames",
        "\"nothing.png\"",
        "1 of 2 pictures have no mask",
        "one of every 3 has no effect",
    ];
    assert_says(&remark(&data), &parts);
}

#[test]
fn the_folder_of_images_may_be_named_with_every_list() {
    for file in ["transforms.json", "transforms_train.json"] {
        let stored = ["images_4/a.png", "images_4/b.png"];
        let folder = data_set(
            file,
            &["images/a.png", r"C:\x\images\b.png"],
            &stored,
            json!({ "w": 4 * WIDTH, "h": 4 * HEIGHT }),
        );
        let named = LoadOptions { images: "images_4".into(), ..options() };
        let data = try_load(&folder, &named).unwrap();
        assert_eq!((pictures(&data), data.train[0].camera.focal_px[0]), (vec![10, 30], 5.0), "{file}");
    }
    let full = json!({ "w": 4 * WIDTH, "h": 4 * HEIGHT });
    let folder = data_set("transforms.json", &["images/a.png", "images/b.png"], &["images_4/a.png"], full);
    for (downscale, focal) in [(1, 5.0), (2, 5.0), (4, 5.0), (8, 2.5)] {
        let data = try_load(&folder, &LoadOptions { downscale, ..options() }).unwrap();
        assert_eq!(data.train[0].camera.focal_px[0], focal, "{downscale} times smaller");
        assert_says(&remark(&data), &["images_4"]);
    }
    let folder = data_set("transforms_train.json", &["images/a.png"], &["images_4/a.png"], json!({}));
    assert_says(
        &try_load(&folder, &options()).unwrap_err().to_string(),
        &["none of the images", "which is in \"images_4\""],
    );
}

#[test]
fn formats_that_are_not_read_are_named() {
    let folder = data_set("transforms.json", &["images/a.heic", "images/b.png"], &["images/b.png"], json!({}));
    fs::write(folder.path().join("images/a.heic"), "").unwrap();
    assert_says(&remark(&load(&folder)), &["skipped 1 images of an unsupported format", "a.heic", "PNG or JPEG"]);
    fs::rename(folder.path().join("images/b.png"), folder.path().join("images/b.HEIF")).unwrap();
    let refusal = try_load(&folder, &options()).unwrap_err().to_string();
    assert_says(&refusal, &["a.heic", "an unsupported format", "convert"]);
    fs::write(folder.path().join("images/b.png"), b"\0\0\0\x1cftypheic\0\0\0\0").unwrap();
    assert_says(&try_load(&folder, &options()).unwrap_err().to_string(), &["b.png", "it is HEIC"]);
}

/// Masks that hide the left half.
fn write_mask(folder: &TempDir, name: &str) {
    let half = |x, _| Luma([if x < WIDTH / 2 { 0 } else { 255 }]);
    let path = made(&folder.path().join(name));
    GrayImage::from_fn(WIDTH, HEIGHT, half).save_with_format(path, image::ImageFormat::Png).unwrap();
}

fn masked(data: &Dataset) -> Vec<bool> {
    data.train.iter().map(|view| view.image.rgba[..4] == UNKNOWN).collect()
}

#[test]
fn masks_are_found_by_all_usual_names() {
    for mask in [
        "masks/x.png",
        "masks/x.jpg.png",
        "masks/x.png.png",
        "masks/x_mask.png",
        "masks/x.mask.png",
        "masks/x.jpg_mask.png",
        "masks/a/x.png",
        "masks/X.PNG",
        "mask/x.png",
        "Masks/x.png",
        "images/masks/x.png",
    ] {
        let pictures = if mask.contains("a/x") { &["a/x.png"][..] } else { &["x.png", "a/x.png"] };
        for picture in pictures {
            let scene = Scene { images: vec![(picture, 1)], ..Scene::pinhole() };
            let folder = scene.folder();
            write_mask(&folder, mask);
            assert_eq!(masked(&load(&folder)), [true], "{mask} of {picture}");
        }
    }
    let folder = data_set("transforms_train.json", &["train/x", "train/y"], &["train/x.png", "train/y.png"], json!({}));
    write_mask(&folder, "masks/train/x.png");
    assert_eq!(masked(&load(&folder)), [true, false]);
}

#[test]
fn masks_that_cannot_be_read_are_told() {
    let with_masks = |names: &[&str]| {
        let folder = Scene::pinhole().folder();
        names.iter().for_each(|name| fs::write(made(&folder.path().join("masks").join(name)), "x").unwrap());
        folder
    };
    let folder = with_masks(&["a.npy", "b.npy"]);
    assert_says(&remark(&load(&folder)), &["masks\" has no readable mask", "PNG"]);
    let folder = with_masks(&["a.heic"]);
    assert_says(&remark(&load(&folder)), &["masks\" has no readable mask"]);
    write_mask(&folder, "masks/b.png");
    assert_says(
        &remark(&load(&folder)),
        &["1 of 2 masks", "unsupported formats", "a.heic", "2 of 3 pictures have no mask"],
    );
    #[cfg(unix)]
    for name in ["masks", "masks/a.png"] {
        let folder = Scene::pinhole().folder();
        std::os::unix::fs::symlink("gone", made(&folder.path().join(name))).unwrap();
        assert_says(&remark(&load(&folder)), &["not used", name, "cannot be opened"]);
    }
}

#[test]
fn a_picture_is_not_its_own_mask() {
    let scene = Scene { images: vec![("masks/x.png", 1)], ..Scene::pinhole() };
    assert_eq!(load(&scene.folder()).report.masks, 0);
}

#[test]
fn masks_and_pictures_without_each_other_are_told() {
    let scene = Scene { images: ["a/x.png", "b/x.png", "b/y.png"].map(|name| (name, 1)).to_vec(), ..Scene::pinhole() };
    let folder = scene.folder();
    ["x.png", "y.png", "frame_1.png"].iter().for_each(|name| write_mask(&folder, &format!("masks/{name}")));
    let data = load(&folder);
    assert_eq!(masked(&data), [false, false, true]);
    let parts = ["2 of 3 masks in", "\"frame_1.png\", \"x.png\"", "2 of 3 pictures have no mask"];
    assert_says(&remark(&data), &parts);
    assert_eq!(data.report.masks, 1);
    let images = folder.path().join("images");
    fs::copy(images.join("b/y.png"), images.join("z.png")).unwrap();
    write_mask(&folder, "masks/z.png");
    assert_says(&remark(&load(&folder)), &["2 of 4 masks in", "\"frame_1.png\", \"x.png\""]);
    fs::remove_file(images.join("z.png")).unwrap();
    fs::remove_file(folder.path().join("masks/z.png")).unwrap();
    fs::remove_file(folder.path().join("masks/y.png")).unwrap();
    assert_says(&remark(&load(&folder)), &["2 of 2 masks", "match no picture"]);
    let list = json!({ "frames": [
        { "file_path": "x.png", "mask_path": "m/x.png", "transform_matrix": FROM_ABOVE },
    ]});
    let folder = data_set("transforms.json", &[], &["x.png"], list);
    assert_says(&remark(&load(&folder)), &["skipped 1 masks in the list", "m/x.png"]);
}

fn write_points(folder: &TempDir, name: &str, kind: &str, colors: [&str; 3], numbers: &str) {
    let [r, g, b] = colors.map(|color| format!("property {kind} {color}\n"));
    let axes = ["x", "y", "z"].map(|axis| format!("property float {axis}\n")).concat();
    let text = format!("ply\nformat ascii 1.0\nelement vertex 1\n{axes}{r}{g}{b}end_header\n1 2 3 {numbers}\n");
    fs::write(made(&folder.path().join(name)), text).unwrap();
}

#[test]
fn colours_of_points_have_any_usual_name_and_range() {
    let folder = tempfile::tempdir().unwrap();
    let color = |kind: &str, names: [&str; 3], numbers: &str| {
        write_points(&folder, "p.ply", kind, names, numbers);
        points_ply::read(&folder.path().join("p.ply")).unwrap().colors[0]
    };
    let expected = [0.0, 0.2, 1.0];
    assert_eq!(color("uchar", ["red", "green", "blue"], "0 51 255"), expected);
    assert_eq!(color("uchar", ["r", "g", "b"], "0 51 255"), expected);
    assert_eq!(color("uchar", ["diffuse_red", "diffuse_green", "diffuse_blue"], "0 51 255"), expected);
    assert_eq!(color("float", ["Red", "Green", "Blue"], "0 51 255"), expected);
    assert_eq!(color("float", ["red", "green", "blue"], "0 0.2 1"), expected);
    assert_eq!(color("ushort", ["red", "green", "blue"], "0 13107 65535"), expected);
    assert_eq!(color("ushort", ["red", "green", "blue"], "0 51 255"), expected);
    assert_eq!(color("int", ["red", "green", "blue"], "0 51 255"), expected);
    let mean = color("float", ["f_dc_0", "f_dc_1", "f_dc_2"], "-9 0 1.7724539");
    assert!((glam::Vec3::from(mean) - glam::Vec3::new(0.0, 0.5, 1.0)).length() < 1e-6, "{mean:?}");
}

#[test]
fn points_of_a_data_set_are_found_by_any_usual_name() {
    for place in ["points3D.ply", "points3d.ply", "sparse/0/points3D.ply"] {
        let colmap = Scene::pinhole().folder();
        fs::remove_file(colmap.path().join("sparse/0/points3D.txt")).unwrap();
        let blender = data_set("transforms_train.json", &["a"], &["a.png"], json!({}));
        let nerfstudio = data_set("transforms.json", &["a"], &["a.png"], json!({}));
        for folder in [colmap, blender, nerfstudio] {
            write_points(&folder, place, "float", ["u", "v", "w"], "1 1 1");
            let data = load(&folder);
            assert_eq!(data.points.as_ref().unwrap().positions, [[1.0, 2.0, 3.0]], "{place}");
            assert_says(&remark(&data), &["no known colours", "grey"]);
            assert_eq!(data.report.left_out, [""; 0], "{place}");
        }
    }
    let rest = json!({ "ply_file_path": "cloud.ply" });
    for with_test in [false, true] {
        let folder = data_set("transforms_train.json", &["a"], &["a.png"], rest.clone());
        write_points(&folder, "cloud.ply", "uchar", ["red", "green", "blue"], "0 51 255");
        if with_test {
            fs::write(folder.path().join("transforms_test.json"), list(&["a"], json!({}))).unwrap();
        }
        assert_eq!(load(&folder).points.unwrap().positions.len(), 1);
    }
}

#[test]
fn images_txt_is_read_without_its_lines_of_points() {
    let numbered =
        Scene { images: ["a b.png", "0002.png", "c.png"].map(|name| (name, 1)).to_vec(), ..Scene::pinhole() };
    let folder = numbered.folder();
    let path = folder.path().join("sparse/0/images.txt");
    let text = fs::read_to_string(&path).unwrap().replace("0002.png", "0002");
    let is_of_image = |line: &&str| line.starts_with('#') || line.split(' ').count() > 9;
    let bare: Vec<&str> = text.lines().filter(is_of_image).collect();
    assert_eq!(bare.len(), 4);
    fs::write(&path, bare.join("\n")).unwrap();
    assert_eq!(names(&load(&folder).train), ["0002", "a b", "c"]);
    // Whole numbers in a line of points are no image.
    fs::write(&path, text.replace("1.5 2.5 7 3.5 4.5 -1", "10 20 5 30 40 6 50 60 7 70 80 8")).unwrap();
    assert_eq!(load(&folder).train.len(), 3);
}

#[test]
fn cameras_without_pictures_may_be_of_any_model_and_sizes_have_decimals() {
    let known = Scene::pinhole();
    let scene = Scene {
        cameras: [known.cameras.clone(), vec![(13, "DIVISION", vec![20.0, 21.0, 12.0, 8.0, 0.1])]].concat(),
        ..known
    };
    for is_text in [true, false] {
        let folder = tempfile::tempdir().unwrap();
        let write = if is_text { Scene::write_text } else { Scene::write_binary };
        write(&scene, folder.path());
        scene.write_images(folder.path());
        let path = folder.path().join("sparse/0/cameras.txt");
        if is_text {
            fs::write(&path, fs::read_to_string(&path).unwrap().replace("24 16", "24.0 16.0")).unwrap();
        }
        assert_eq!(load(&folder).train.len(), 3);
    }
    let used = Scene { images: vec![("a.png", 2)], ..scene };
    let folder = tempfile::tempdir().unwrap();
    used.write_binary(folder.path());
    assert_says(&try_load(&folder, &options()).unwrap_err().to_string(), &["camera 2 of 2", "cameras.bin", "DIVISION"]);
}

#[test]
fn entries_of_a_list_that_are_not_used_are_told() {
    let rest = json!({ "camera_model": "opencv", "aabb_scale": 16, "latlong": false, "k5": 0.0 });
    let folder = data_set("transforms.json", &["a.png"], &["a.png"], rest);
    let path = folder.path().join("transforms.json");
    let text =
        fs::read_to_string(&path).unwrap().replace("\"file_path\"", "\"depth_file_path\":\"d.png\",\"file_path\"");
    fs::write(&path, text).unwrap();
    assert_says(&remark(&load(&folder)), &["unused entries", "depth_file_path, latlong"]);
    let rational = json!({ "camera_model": "full_opencv", "k1": 0.1, "k4": 0.1, "k5": 0.01, "k6": 0.01 });
    let data = load(&data_set("transforms.json", &["a.png"], &["a.png"], rational));
    assert_says(&remark(&data), &["distortion of 1 pictures"]);
    let odd = data_set("transforms.json", &["a.png"], &["a.png"], json!({ "k5": 0.1 }));
    assert_says(&try_load(&odd, &options()).unwrap_err().to_string(), &["k5", "FULL_OPENCV"]);
}

#[test]
fn a_workspace_of_colmap_holds_its_data_set_below() {
    let workspace = tempfile::tempdir().unwrap();
    let dense = workspace.path().join("dense/0");
    Scene::pinhole().write_text(&dense);
    Scene::pinhole().write_images(&dense);
    Scene::pinhole().write_text(workspace.path());
    assert!(dataset::is_dataset(workspace.path()));
    let data = load(&workspace);
    assert_eq!(data.train.len(), 3);
    assert_says(&remark(&data), &["the data set is that in", "dense/0"]);
}

/// Whatever may lie in a data set that is none of its own.
fn strew(folder: &Path) {
    for name in [
        "depth/a.png",
        "images_2/a.png",
        "clip.mp4",
        "cloud.ply",
        "README.md",
        ".cache/a.png",
        "out/specula.json",
        "out/point_cloud/a.png",
        "masks/other.png",
    ] {
        fs::write(made(&folder.join(name)), "").unwrap();
    }
}

#[test]
fn every_reader_tells_what_it_does_not_use() {
    let scene = || Scene { images: vec![("a.png", 1), ("b.png", 1)], ..Scene::pinhole() };
    let colmap = |is_text: bool| {
        let folder = tempfile::tempdir().unwrap();
        let write = if is_text { Scene::write_text } else { Scene::write_binary };
        write(&scene(), folder.path());
        scene().write_images(folder.path());
        folder
    };
    let named = ["images/a.png", "images/b.png"];
    for (folder, cameras) in [
        (colmap(true), "text; cameras: 1, PINHOLE"),
        (colmap(false), "binary; cameras: 1, PINHOLE"),
        (data_set("transforms.json", &named, &named, json!({})), "transforms.json\" (PINHOLE)"),
        (data_set("transforms_train.json", &named, &named, json!({ "k1": 0.1 })), "transforms_train.json\" (OPENCV)"),
    ] {
        assert_eq!(load(&folder).report.left_out, [""; 0], "{cameras}");
        strew(folder.path());
        picture().save(folder.path().join("images/c.png")).unwrap();
        fs::write(folder.path().join("images/d.heic"), "").unwrap();
        let data = load(&folder);
        let [of_images, others @ ..] = &data.report.left_out[..] else { panic!("{:?}", data.report) };
        assert_says(of_images, &["2 pictures", "images\" without a camera"]);
        let copies = "\"images_2\" (1 files, copies for pictures 2 times smaller)";
        assert_eq!(others, ["\"clip.mp4\"", "\"cloud.ply\"", "\"depth\" (1 files)", copies], "{cameras}");
        assert_says(&data.report.source, &[cameras]);
        assert_says(&remark(&data), &["not used: 2 pictures", "1 of 1 masks", "other.png"]);
    }
}
