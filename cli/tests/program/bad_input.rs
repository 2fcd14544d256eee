//! Bad input: one sentence with the file in it, exit code 2, and nothing touched.

use crate::tiny::{Tiny, specula, train};
use assert_cmd::Command;
use specula_io::latlong::{self, LatLong};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// The command fails as it should; `words` are in its sentence.
fn refuses(mut command: Command, words: &[&str]) {
    let output = command.assert().code(2).get_output().clone();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(stderr.lines().count(), 1, "one sentence is expected: {stderr}");
    assert!(stderr.starts_with("specula: "), "{stderr}");
    for word in words {
        assert!(stderr.contains(word), "{word:?} is not in: {stderr}");
    }
    assert!(output.stdout.is_empty(), "results were printed of what failed");
}

/// Training on the data set is refused, and no model is made.
fn training_is_refused(tiny: &Tiny, words: &[&str]) {
    refuses(train(tiny, "model"), words);
    assert!(!tiny.path("model").exists(), "a folder was made for a training that did not start");
}

fn edit(path: &Path, edit: impl FnOnce(String) -> String) {
    let text = fs::read_to_string(path).unwrap();
    fs::write(path, edit(text)).unwrap();
}

#[test]
fn a_missing_folder() {
    let tiny = Tiny::new();
    let mut command = specula();
    command.arg("train").arg(tiny.path("nowhere")).arg("-m").arg(tiny.path("model"));
    refuses(command, &["nowhere", "transforms_train.json"]);
    assert!(!tiny.path("model").exists(), "a folder was made for a training that did not start");
}

#[test]
fn a_folder_without_cameras() {
    let tiny = Tiny::new();
    fs::remove_file(tiny.file("transforms_train.json")).unwrap();
    training_is_refused(&tiny, &["transforms_train.json", "data"]);
}

#[test]
fn missing_images() {
    let tiny = Tiny::new();
    fs::remove_dir_all(tiny.file("train")).unwrap();
    training_is_refused(&tiny, &["none of the images", "train/r_0\"; give their folder", "--images"]);
}

#[test]
fn broken_json() {
    let tiny = Tiny::new();
    edit(&tiny.file("transforms_train.json"), |text| text.replacen(']', "", 1));
    training_is_refused(&tiny, &["transforms_train.json", "line"]);
}

#[test]
fn a_light_or_a_picture_in_place_of_a_scene() {
    let tiny = Tiny::new();
    let light = tiny.path("light.hdr");
    fs::write(&light, "#?RADIANCE").unwrap();
    for path in [light, tiny.file("train/r_2.png")] {
        let mut command = specula();
        command.arg("info").arg(&path);
        refuses(command, &["not a scene", "--env"]);
    }
}

#[test]
fn an_image_that_is_none() {
    let tiny = Tiny::new();
    fs::write(tiny.file("train/r_2.png"), "this is no picture").unwrap();
    training_is_refused(&tiny, &["r_2.png"]);
}

#[test]
fn an_image_without_pixels() {
    let tiny = Tiny::new();
    let path = tiny.file("train/r_2.png");
    let mut bytes = fs::read(&path).unwrap();
    bytes[16..24].fill(0);
    fs::write(&path, bytes).unwrap();
    training_is_refused(&tiny, &["r_2.png"]);
}

#[test]
fn a_camera_without_focal_length() {
    let tiny = Tiny::new();
    edit(&tiny.file("transforms_train.json"), |text| text.replacen("camera_angle_x", "camera_angle", 1));
    training_is_refused(&tiny, &["focal length", "camera_angle_x", "transforms_train.json"]);
}

#[test]
fn points_that_are_cut_short() {
    let tiny = Tiny::new();
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    fs::write(tiny.file("points3d.ply"), [header.as_bytes(), &[0; 50]].concat()).unwrap();
    training_is_refused(&tiny, &["points3d.ply", "cut short", "4 of 9"]);
}

#[test]
fn measuring_without_test_views() {
    let tiny = Tiny::new();
    fs::remove_file(tiny.file("transforms_test.json")).unwrap();
    let mut command = train(&tiny, "model");
    command.args(["--eval", "--quiet"]);
    refuses(command, &["no test views", "--eval"]);
    assert!(!tiny.path("model").exists(), "a folder was made for a training that did not start");
}

#[test]
fn measuring_by_pictures_that_were_never_rendered() {
    let tiny = Tiny::new();
    fs::remove_dir_all(tiny.file("test")).unwrap();
    let output = train(&tiny, "model").arg("--eval").assert().code(2).get_output().clone();
    let said = String::from_utf8(output.stderr).unwrap();
    for words in ["there are no test views of", "test/r_0", "has no test views to measure"] {
        assert!(said.contains(words), "{words:?} is not in: {said}");
    }
}

#[test]
fn measuring_by_the_only_picture() {
    let tiny = Tiny::new();
    fs::remove_file(tiny.file("transforms_train.json")).unwrap();
    edit(&tiny.file("transforms_test.json"), |text| text.replace("test/r_1", "r").replace("test/r_2", "r"));
    fs::rename(tiny.file("transforms_test.json"), tiny.file("transforms.json")).unwrap();
    let mut command = train(&tiny, "model");
    command.args(["--eval", "--quiet"]);
    refuses(command, &["all pictures of", "are held out (1)", "omit --eval"]);
}

#[test]
fn a_data_set_in_place_of_a_models_folder() {
    let tiny = Tiny::new();
    fs::create_dir_all(tiny.path("other")).unwrap();
    fs::write(tiny.path("other/transforms.json"), "{}").unwrap();
    refuses(train(&tiny, "other"), &["is another data set", "-m"]);
    refuses(train(&tiny, "data"), &["is the data set itself", "-m"]);
    assert_eq!(fs::read_dir(tiny.path("other")).unwrap().count(), 1, "nothing is written");
}

#[test]
fn an_output_folder_that_cannot_be() {
    let tiny = Tiny::new();
    fs::write(tiny.path("file"), "mine").unwrap();
    let mut command = specula();
    command.arg("train").arg(tiny.data()).arg("-m").arg(tiny.path("file/model")).arg("--quiet");
    refuses(command, &["file/model", "folder"]);
    assert_eq!(fs::read_to_string(tiny.path("file")).unwrap(), "mine");
}

#[test]
fn impossible_settings() {
    let tiny = Tiny::new();
    for (words, expected) in [
        (&["--light-resolution", "100"][..], "power of two"),
        (&["--profile", "3dgs", "--light-per", "pixel"], "--light-per"),
        (&["--resolution", "3"], "1, 2, 4 or 8"),
        (&["--background", "pink"], "black, white"),
        (&["--lambda-normal", "NaN"], "finite"),
        (&["--lambda-metal", "0.1"], "--relightable"),
        (&["--lambda-dssim", "7"], "from 0 to 1"),
        (&["--max-gaussians", "0"], "above 0"),
        (&["--profile", "other"], "3dgs"),
    ] {
        let mut command = specula();
        command.arg("train").arg(tiny.data()).arg("-m").arg(tiny.path("model")).args(words);
        refuses(command, &[expected]);
    }
    assert!(!tiny.path("model").exists(), "a folder was made for a training that did not start");
}

#[test]
fn no_command_and_a_wrong_one() {
    refuses(specula_with(&["trian", "data"]), &["trian"]);
    refuses(specula_with(&["train"]), &["--model-path", "see specula train --help"]);
    refuses(
        specula_with(&["train", "data", "-m", "out", "--iteration", "7"]),
        &["--iterations", "see specula train --help"],
    );
    refuses(specula_with(&["--loud"]), &["see specula --help"]);
}

#[test]
fn pictures_videos_and_cameras_of_other_programs_are_no_data_set_yet() {
    let tiny = Tiny::new();
    let no_data = |files: &[&str], parts: &[&str]| {
        let folder = tiny.path("elsewhere");
        files.iter().for_each(|file| {
            fs::create_dir_all(folder.join(file).parent().unwrap()).unwrap();
            fs::write(folder.join(file), "").unwrap();
        });
        let mut command = specula();
        command.arg("train").arg(&folder).arg("-m").arg(tiny.path("model"));
        refuses(command, parts);
        fs::remove_dir_all(folder).unwrap();
    };
    no_data(&["images/a.jpg", "images/b.JPG"], &["2 pictures", "no cameras", "specula capture"]);
    no_data(&["a.heic"], &["1 picture in .heic", "no cameras", "mogrify", "specula capture"]);
    no_data(&["images/a.jpg", "reconstruction.json"], &["OpenSfM", "opensfm export_colmap"]);
    no_data(&["scan.psx"], &["Metashape", "Export Cameras"]);
    no_data(&["walk.MP4"], &["a video", "specula capture", "-o data"]);
    let video = tiny.path("walk.mov");
    fs::write(&video, "").unwrap();
    let mut command = specula();
    command.arg("train").arg(&video).arg("-m").arg(tiny.path("model"));
    refuses(command, &["a video", "specula capture", "-o data"]);
}

#[test]
fn a_data_set_in_place_of_a_model_and_a_video_in_place_of_a_folder() {
    let tiny = Tiny::new();
    for name in ["view", "render"] {
        let mut command = specula();
        command.arg(name).arg(tiny.data());
        refuses(command, &["is a data set", "specula train"]);
    }
    fs::create_dir_all(tiny.path("bare")).unwrap();
    fs::write(tiny.path("bare/a.jpg"), "").unwrap();
    fs::write(tiny.path("walk.mov"), "").unwrap();
    for name in ["info", "view", "render", "relight"] {
        for (scene, words) in [
            ("bare", ["1 picture,", "specula capture"]),
            ("data/train", ["part of a data set", "the folder above"]),
            ("walk.mov", ["a video", "specula capture"]),
        ] {
            let mut command = specula();
            command.arg(name).arg(tiny.path(scene));
            refuses(command, &words);
        }
    }
    for name in ["turn.mp4", "turn.WEBP"] {
        let video = |words: &[&str]| {
            let mut command = specula();
            command.arg("render").arg(tiny.path("model")).arg("-o").arg(tiny.path(name)).args(words);
            command
        };
        let mut without_ffmpeg = video(&[]);
        without_ffmpeg.env("PATH", "");
        refuses(without_ffmpeg, &["ffmpeg, which is not installed", "rgb/%05d.png", name]);
        refuses(video(&["--layers", "rgb,depth"]), &["one layer", name]);
        refuses(video(&["--exr"]), &["cannot store numbers", name]);
        assert!(!tiny.path(name).exists());
    }
    for name in ["picture.png", "song.mp3"] {
        let mut command = specula();
        command.arg("render").arg(tiny.path("model")).arg("-o").arg(tiny.path(name));
        refuses(command, &[name, "does not name a folder or a video"]);
    }
}

#[test]
fn an_address_that_is_taken() {
    let tiny = Tiny::new();
    let taken = std::net::TcpListener::bind("127.0.0.1:0").expect("a port is free");
    let address = taken.local_addr().expect("it is bound").to_string();
    train(&tiny, "model").assert().success();
    let mut command = specula();
    command.arg("view").arg(tiny.path("model")).args(["--listen", &address]);
    refuses(command, &[&address, "view --listen", "127.0.0.1:0"]);
}

#[test]
fn what_is_no_light_is_told_from_one() {
    let tiny = Tiny::new();
    train(&tiny, "model").assert().success();
    let model = tiny.path("model");
    fs::write(tiny.path("notes.txt"), "no light\n").unwrap();
    for (light, told) in [("model", "but a folder"), ("notes.txt", "format")] {
        let mut command = specula();
        command.arg("relight").arg(&model).arg("--env").arg(tiny.path(light));
        refuses(command, &["is not an environment map", told, ".hdr or .exr", "sunset"]);
    }
    let mut command = specula();
    command.arg("relight").arg(&model).arg("--lights").arg(tiny.path("notes.txt"));
    refuses(command, &["is not a file of lights: line 1: ", "docs/rendering.md"]);
}

#[test]
fn a_folder_as_an_exported_file() {
    let tiny = Tiny::new();
    train(&tiny, "model").assert().success();
    let files = tiny.path("files");
    fs::create_dir(&files).unwrap();
    let mut command = specula();
    command.arg("export").arg(tiny.path("model")).arg("-o").arg(&files);
    refuses(command, &["is a folder", "a slash"]);
    assert_eq!(fs::read_dir(&files).unwrap().count(), 0, "nothing was written");
}

#[test]
fn a_negative_number_of_an_option() {
    let tiny = Tiny::new();
    for option in ["--iterations", "--lambda-normal"] {
        let mut command = specula();
        command.arg("train").arg(tiny.data()).arg("-m").arg(tiny.path("model")).args([option, "-5"]);
        refuses(command, &["invalid value '-5'", option]);
    }
}

#[test]
fn a_part_of_a_data_set() {
    let tiny = Tiny::new();
    for part in ["train", "sparse/0"] {
        fs::create_dir_all(tiny.file(part)).unwrap();
        let mut command = specula();
        command.arg("train").arg(tiny.file(part)).arg("-m").arg(tiny.path("model"));
        refuses(command, &["part of a data set", "did you mean the folder above", "data"]);
    }
    let mut command = specula();
    command.arg("train").arg(tiny.path(".")).arg("-m").arg(tiny.path("model"));
    refuses(command, &["is not a data set", "did you mean", "data"]);
    let model = tiny.path("models/one");
    fs::create_dir_all(&model).unwrap();
    fs::write(model.join("specula.json"), "{}").unwrap();
    let mut command = specula();
    command.arg("train").arg(&model).arg("-m").arg(tiny.path("model"));
    refuses(command, &["is a model", "--resume"]);
}

fn specula_with(words: &[&str]) -> Command {
    let mut command = specula();
    command.args(words);
    command
}

/// A file of plain Gaussians: one vertex, all numbers `number`.
fn write_gaussians(path: &Path, number: f32, leave_out: &str) {
    let mut names: Vec<String> = ["x", "y", "z", "opacity"].map(str::to_owned).to_vec();
    for (prefix, count) in [("f_dc", 3), ("scale", 3), ("rot", 4)] {
        names.extend((0..count).map(|k| format!("{prefix}_{k}")));
    }
    names.retain(|name| name != leave_out);
    let mut bytes = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\n".to_vec();
    for name in &names {
        bytes.extend(format!("property float {name}\n").into_bytes());
    }
    bytes.extend(b"end_header\n");
    bytes.extend(names.iter().flat_map(|_| number.to_le_bytes()));
    fs::write(path, bytes).unwrap();
}

fn renders(scene: &Path, out: &Path) -> Command {
    let mut command = specula();
    command.arg("render").arg(scene).arg("-o").arg(out).args(["--size", "16,16", "--quiet"]);
    command
}

#[test]
fn gaussians_that_cannot_be_read() {
    let tiny = Tiny::new();
    let (scene, out) = (tiny.path("scene.ply"), tiny.path("out"));

    write_gaussians(&scene, f32::NAN, "");
    refuses(renders(&scene, &out), &["scene.ply", "NaN"]);
    write_gaussians(&scene, 0.5, "scale_1");
    refuses(renders(&scene, &out), &["scene.ply", "scale_1"]);
    write_gaussians(&scene, 0.5, "");
    let whole = fs::read(&scene).unwrap();
    fs::write(&scene, &whole[..whole.len() - 3]).unwrap();
    refuses(renders(&scene, &out), &["scene.ply", "cut short"]);
    fs::write(&scene, "nothing of the kind").unwrap();
    refuses(renders(&scene, &out), &["scene.ply", "PLY"]);
    refuses(renders(&tiny.path("nowhere"), &out), &["nowhere"]);
    refuses(renders(&tiny.data(), &out), &["data", "is a data set"]);
    assert!(!out.exists(), "a folder was made for pictures that cannot be");

    fs::write(&scene, whole).unwrap();
    renders(&scene, &out).assert().success();
    assert!(out.join("rgb/00000.png").is_file(), "a sound file is rendered");
}

#[test]
fn a_plain_scene_cannot_be_relit() {
    let tiny = Tiny::new();
    let (scene, env) = (tiny.path("scene.ply"), tiny.path("env.exr"));
    write_gaussians(&scene, 0.5, "");
    write_light(&env, 1.0);
    let mut command = specula();
    command.arg("relight").arg(&scene).arg("--env").arg(&env).arg("-o").arg(tiny.path("out"));
    refuses(command, &["plain", "specula train"]);
    let mut command = specula();
    command.arg("view").arg(&scene).arg("--env").arg(&env).args(["--listen", "0"]);
    refuses(command, &["plain", "specula train"]);
    assert!(!tiny.path("out").exists(), "a folder was made for pictures that cannot be");
}

/// Eight by four pixels of 1, the first of them `first`.
fn write_light(path: &Path, first: f32) {
    let mut rgb = vec![1.0; 3 * 8 * 4];
    rgb[0] = first;
    latlong::write(path, &LatLong { width: 8, height: 4, rgb }).unwrap();
}

fn trained(tiny: &Tiny) -> PathBuf {
    train(tiny, "model").arg("--quiet").assert().success();
    tiny.path("model")
}

#[test]
fn light_that_is_no_radiance_is_cleaned_and_counted() {
    let tiny = Tiny::new();
    let (model, env) = (trained(&tiny), tiny.path("env.exr"));
    for (number, word) in [(f32::INFINITY, "1 infinite"), (f32::NAN, "1 NaN"), (-1.0, "1 negative")] {
        write_light(&env, number);
        let mut command = specula();
        command.arg("relight").arg(&model).arg("--env").arg(&env).arg("-o").arg(tiny.path("out"));
        let output = command.assert().success().get_output().clone();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert!(stderr.contains(word) && stderr.contains("env.exr"), "{stderr}");
    }
    let collage = tiny.path("collage.png");
    image::RgbImage::from_pixel(8, 6, image::Rgb([90, 120, 200])).save(&collage).unwrap();
    let mut command = specula();
    command.arg("relight").arg(&model).arg("--env").arg(&collage).arg("-o").arg(tiny.path("out"));
    let stderr = String::from_utf8(command.assert().success().get_output().stderr.clone()).unwrap();
    assert!(stderr.contains("no radiance above 1") && stderr.contains("8 × 6 pixels"), "{stderr}");
    let mut command = specula();
    command.arg("relight").arg(&model).arg("--env").arg(tiny.path("night.hdr")).arg("-o").arg(tiny.path("night"));
    refuses(command, &["night.hdr"]);
    let mut command = specula();
    command.arg("relight").arg(&model).args(["--env", "noon"]).arg("-o").arg(tiny.path("night"));
    refuses(command, &["no light of this name", "sunset, forest, workshop"]);
    assert!(!tiny.path("night").exists(), "a folder was made for pictures that cannot be");
}

#[test]
fn pictures_of_different_sizes_are_fine() {
    let tiny = Tiny::new();
    let path = tiny.file("train/r_0.png");
    let picture = image::open(&path).unwrap();
    picture.resize_exact(20, 12, image::imageops::FilterType::Triangle).save(&path).unwrap();
    trained(&tiny);
}

#[test]
fn an_executor_that_there_is_not() {
    let tiny = Tiny::new();
    let model = trained(&tiny);
    let mut command = renders(&model, &tiny.path("out"));
    // Mesa reports a folder that does not exist.
    command.args(["--executor", "gpu:abacus"]).env("XDG_RUNTIME_DIR", tiny.path("."));
    refuses(command, &["abacus", "adapter", "--executor cpu"]);
    // Before anything is read.
    let mut command = specula();
    command.arg("train").arg(tiny.path("nowhere")).arg("-m").arg(tiny.path("other"));
    command.args(["--executor", "gpu:abacus"]).env("XDG_RUNTIME_DIR", tiny.path("."));
    refuses(command, &["abacus", "--executor cpu"]);
    let mut command = renders(&model, &tiny.path("out"));
    command.args(["--executor", "cuda"]);
    refuses(command, &["--executor", "auto, cpu, gpu"]);
}

#[test]
fn cameras_of_pictures_that_cannot_be() {
    let tiny = Tiny::new();
    let (scene, list, out) = (tiny.path("scene.ply"), tiny.path("list.json"), tiny.path("out"));
    write_gaussians(&scene, 0.5, "");
    let entry = |width: u64, height: u64| {
        format!(
            "[{{\"id\": 0, \"img_name\": \"wide\", \"width\": {width}, \"height\": {height}, \"position\": [0, 0, 4], \
             \"rotation\": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], \"fy\": 9, \"fx\": 9}}]"
        )
    };
    let frame = |width: u64, height: u64| {
        format!(
            "{{\"w\": {width}, \"h\": {height}, \"fl_x\": 9, \"frames\": [{{\"file_path\": \"wide\", \
             \"transform_matrix\": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]}}]}}"
        )
    };
    for [width, height] in [[1_000_000_000, 1_000_000_000], [100_000, 100_000], [65_536, 65_536], [0, 8]] {
        for text in [entry(width, height), frame(width, height)] {
            fs::write(&list, text).unwrap();
            let mut command = renders(&scene, &out);
            command.arg("--cameras").arg(&list);
            refuses(command, &["list.json", "wide", &format!("{width} by {height} pixels")]);
        }
        let mut command = specula();
        command.arg("render").arg(&scene).arg("-o").arg(&out).arg("--size").arg(format!("{width},{height}"));
        refuses(command, &["--size", &format!("{width} by {height} pixels")]);
    }
    assert!(!out.exists(), "a folder was made for pictures that cannot be");
}

/// An image beside a list says how large its view is, where the list does not.
#[test]
fn a_camera_of_an_image_that_is_larger_than_any() {
    let tiny = Tiny::new();
    let (scene, out) = (tiny.path("scene.ply"), tiny.path("out"));
    write_gaussians(&scene, 0.5, "");
    let image = tiny.file("test/r_0.png");
    let mut bytes = fs::read(&image).unwrap();
    bytes[16..24].copy_from_slice(&[0, 1, 0x86, 0xa0, 0, 1, 0x86, 0xa0]);
    fs::write(&image, with_right_sums(&bytes)).unwrap();
    let mut command = renders(&scene, &out);
    command.arg("--cameras").arg(tiny.file("transforms_test.json"));
    refuses(command, &["transforms_test.json", "100000 by 100000 pixels"]);
}

/// A PNG whose header was changed, with the sum that belongs to it.
fn with_right_sums(bytes: &[u8]) -> Vec<u8> {
    let mut sum = crc32fast::Hasher::new();
    sum.update(&bytes[12..29]);
    [&bytes[..29], &sum.finalize().to_be_bytes(), &bytes[33..]].concat()
}

#[test]
fn a_file_with_holes_that_is_longer_than_any_scene() {
    let tiny = Tiny::new();
    let scene = tiny.path("scene.ply");
    write_gaussians(&scene, 0.5, "");
    edit_bytes(&scene, b"vertex 1\n", b"vertex 900000000\n");
    fs::File::options().write(true).open(&scene).unwrap().set_len(60 << 30).unwrap();
    refuses(renders(&scene, &tiny.path("out")), &["scene.ply", "900000000 vertices", "61440 MiB", "8192 MiB"]);
    let mut command = specula();
    command.arg("train").arg(tiny.data()).arg("-m").arg(tiny.path("model")).arg("--points").arg(&scene);
    refuses(command, &["scene.ply", "8192 MiB"]);
}

/// Puts other bytes in the place of some.
fn edit_bytes(path: &Path, from: &[u8], to: &[u8]) {
    let bytes = fs::read(path).unwrap();
    let start = bytes.windows(from.len()).position(|window| window == from).unwrap();
    fs::write(path, [&bytes[..start], to, &bytes[start + from.len()..]].concat()).unwrap();
}

#[test]
fn elements_of_nothing_are_passed_by() {
    let tiny = Tiny::new();
    let scene = tiny.path("scene.ply");
    write_gaussians(&scene, 0.5, "");
    edit_bytes(&scene, b"element vertex", b"element junk 1000000000\nelement vertex");
    renders(&scene, &tiny.path("out")).assert().success();
}

#[test]
fn networks_that_would_be_read_for_ever() {
    let tiny = Tiny::new();
    let model = trained(&tiny);
    let file = tiny.path("network.onnx");
    for bytes in [&[0xff; 64][..], &[0x3a, 0x7f, 0x0a], &[&[0x32][..], &[0xff; 9], &[1]].concat()] {
        fs::write(&file, bytes).unwrap();
        let mut command = specula();
        command.arg("eval").arg(&model).arg("--lpips").arg(&file).arg("--quiet");
        refuses(command, &["network.onnx", "not an ONNX model", "lpips-onnx.py"]);
    }
}

/// A graph of two inputs, one output and these nodes.
fn network_of(nodes: &[Vec<u8>]) -> Vec<u8> {
    let values = [(0x5a, "one"), (0x5a, "other"), (0x62, "distance")].map(|(tag, name)| field(tag, &text(0x0a, name)));
    let graph = [nodes.concat(), values.concat()].concat();
    [&[0x08, 8][..], &field(0x42, &[0x10, 17]), &field(0x3a, &graph)].concat()
}

/// A field of ONNX with a length: its tag, its length, what is in it.
fn field(tag: u8, inside: &[u8]) -> Vec<u8> {
    let len = inside.len();
    let len = if len < 0x80 { vec![len as u8] } else { vec![len as u8 | 0x80, (len >> 7) as u8] };
    [&[tag][..], &len, inside].concat()
}

fn text(tag: u8, text: &str) -> Vec<u8> {
    field(tag, text.as_bytes())
}

/// Numbers by the billion that nothing in the file holds.
#[test]
fn networks_that_ask_for_more_memory_than_there_is() {
    let tiny = Tiny::new();
    let model = trained(&tiny);
    let file = tiny.path("network.onnx");
    for exponent in [33, 40] {
        // The shape as a constant, then what fills it.
        let number = (1_u64 << exponent).to_le_bytes();
        let tensor = [&[0x08, 1, 0x10, 7][..], &field(0x4a, &number)].concat();
        let value = [text(0x0a, "value"), field(0x2a, &tensor), vec![0xa0, 0x01, 4]].concat();
        let constant = [text(0x12, "shape"), text(0x22, "Constant"), field(0x2a, &value)].concat();
        let fill = [text(0x0a, "shape"), text(0x12, "distance"), text(0x22, "ConstantOfShape")].concat();
        fs::write(&file, network_of(&[field(0x0a, &constant), field(0x0a, &fill)])).unwrap();
        let mut command = specula();
        command.arg("eval").arg(&model).arg("--lpips").arg(&file).arg("--quiet");
        refuses(command, &["network.onnx", "is not a usable LPIPS network"]);
    }
}
