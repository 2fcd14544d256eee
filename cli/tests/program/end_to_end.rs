//! The program from pictures to relit pictures, on a data set of a few pixels.

use crate::tiny::{SIZE, Tiny, specula, train, train_by_default, train_relightable};
use assert_cmd::cargo::cargo_bin;
use serde_json::Value;
use specula_io::latlong::{self, LatLong};
use std::{
    fs,
    io::{BufRead, BufReader},
    path::Path,
    process::{Command, Stdio},
};

fn json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

fn printed(command: &mut assert_cmd::Command) -> String {
    String::from_utf8(command.assert().success().get_output().stdout.clone()).unwrap()
}

/// Nine photographs of a ball on a wall, taken through a lens with distortion, as COLMAP leaves
/// them.
pub(crate) fn write_photographs(folder: &Path) {
    let sparse = folder.join("sparse/0");
    fs::create_dir_all(&sparse).unwrap();
    fs::create_dir_all(folder.join("images")).unwrap();
    let mut images = String::new();
    for k in 0..9 {
        let half_turn = 0.05 * (f64::from(k) - 4.0);
        images += &format!("{k} {} 0 {} 0 0 0 4 1 {k}.jpg\n\n", half_turn.cos(), half_turn.sin());
        let color = |x: u32, y: u32| match (x.abs_diff(SIZE / 2), y.abs_diff(SIZE / 2)) {
            (x, y) if x * x + y * y < SIZE * SIZE / 16 => image::Rgb([200, 40, 30]),
            _ => image::Rgb([120, 130, 150]),
        };
        image::RgbImage::from_fn(SIZE, SIZE, color).save(folder.join(format!("images/{k}.jpg"))).unwrap();
    }
    let points: String = (0..60).map(|k| format!("{k} {} {} 0.5 150 90 90 0.5\n", k % 8 - 4, k / 8 - 4)).collect();
    let half = SIZE / 2;
    fs::write(sparse.join("cameras.txt"), format!("1 SIMPLE_RADIAL {SIZE} {SIZE} 40 {half} {half} 0.2\n")).unwrap();
    fs::write(sparse.join("images.txt"), images).unwrap();
    fs::write(sparse.join("points3D.txt"), points).unwrap();
}

#[test]
fn photographs_are_trained_measured_and_rendered() {
    let tiny = Tiny::new();
    let (data, model) = (tiny.path("photographs"), tiny.path("model"));
    write_photographs(&data);
    let mut train = specula();
    train.arg("train").arg(&data).arg("-m").arg(&model);
    let done = train.args(["--eval", "--profile", "3dgs", "--iterations", "20", "--llffhold", "4"]).assert().success();
    let stderr = String::from_utf8(done.get_output().stderr.clone()).unwrap();
    for part in
        ["COLMAP's model", "SIMPLE_RADIAL", "6 training pictures and 3 held out", "60 points", "lens distortion"]
    {
        assert!(stderr.contains(part), "{part:?} is missing in: {stderr}");
    }
    let trained = json(&model.join("results.json"))["ours_20"]["PSNR"].as_f64().unwrap();
    let evaluated = printed(specula().arg("eval").arg(&model).arg("--json"));
    let evaluated: Value = serde_json::from_str(&evaluated).unwrap();
    assert_eq!(evaluated["views"].as_array().unwrap().len(), 3, "the views that were held out");
    assert!((evaluated["PSNR"].as_f64().unwrap() - trained).abs() < 0.01, "{evaluated}");
    printed(specula().arg("render").arg(&model));
    assert!(model.join("test/ours_20/gt/00002.png").is_file(), "true pictures lie beside rendered ones");
}

#[test]
fn objects_are_told_from_scenes_by_the_alpha_of_all_pictures() {
    const NOTE: &str = "settings are those for objects";
    let tiny = Tiny::new();
    let notes = |model: &str, options: &[&str]| {
        let mut train = specula();
        train.arg("train").arg(tiny.data()).arg("-m").arg(tiny.path(model)).args(["--iterations", "3"]).args(options);
        String::from_utf8(train.assert().success().get_output().stderr.clone()).unwrap()
    };
    assert!(notes("objects", &[]).contains(NOTE));
    assert!(!notes("plain", &["--profile", "3dgs"]).contains(NOTE), "other profiles have no such settings");
    let picture = tiny.file("train/r_0.png");
    image::open(&picture).unwrap().to_rgb8().save(&picture).unwrap();
    assert!(!notes("scene", &[]).contains(NOTE), "one picture is opaque");
}

#[test]
fn exposures_of_photographs_are_learned_kept_and_told() {
    let tiny = Tiny::new();
    let (data, model) = (tiny.path("photographs"), tiny.path("model"));
    write_photographs(&data);
    let train = |words: &[&str]| {
        let mut train = specula();
        train.arg("train").arg(&data).arg("-m").arg(&model).args(["--profile", "3dgs", "--iterations", "20"]);
        printed(train.args(["--eval", "--test-every", "4", "--executor", "cpu"]).args(words))
    };
    let line = train(&["--exposure"]);
    assert!(line.starts_with("PSNR ") && line.contains("PSNR fitted to the truth"), "{line}");
    let exposures = json(&model.join("exposure.json"));
    let names: Vec<&String> = exposures.as_object().unwrap().keys().collect();
    assert_eq!(names, ["1", "2", "3", "5", "6", "7"], "those that were learned from");
    let gain = |name: &str| exposures[name][0][0].as_f64().unwrap();
    assert!(names.iter().any(|name| gain(name) != 1.0), "something was learned");
    let mean = names.iter().map(|name| gain(name)).sum::<f64>() / 6.0;
    assert!((mean - 1.0).abs() < 1e-5, "and on average nothing: {mean}");

    let then = json(&model.join("results.json"))["ours_20"].clone();
    let now: Value = serde_json::from_str(&printed(specula().arg("eval").arg(&model).arg("--json"))).unwrap();
    for measure in ["PSNR", "PSNR_fitted"] {
        let [then, now] = [&then[measure], &now[measure]].map(|value| value.as_f64().unwrap());
        assert!((then - now).abs() < 0.01, "{measure} was {then} and is {now}");
    }
    let page = fs::read_to_string(model.join("test/ours_20/index.html")).unwrap();
    assert!(page.contains("PSNR fitted to the truth"), "the page says it too");
    let info: Value = serde_json::from_str(&printed(specula().arg("info").arg(&model).arg("--json"))).unwrap();
    assert_eq!(info["exposure"]["photographs"], 6);

    let config = fs::read_to_string(model.join("config.toml")).unwrap();
    assert!(config.contains("exposure = true"), "{config}");
    let line = train(&["--overwrite"]);
    assert!(!line.contains("fitted") && !model.join("exposure.json").exists(), "a training without has none: {line}");
    let asked = printed(specula().arg("eval").arg(&model).arg("--exposure"));
    assert!(asked.contains("PSNR fitted to the truth"), "it can be asked for: {asked}");
}

#[test]
fn a_scene_is_trained_measured_rendered_and_relit() {
    let tiny = Tiny::new();
    let model = tiny.path("model");
    let line = printed(train(&tiny, "model").arg("--eval"));
    assert!(line.starts_with("PSNR ") && line.contains("normal MAE") && line.lines().count() == 1, "{line}");
    for name in ["cameras.json", "cfg_args", "input.ply", "specula.json", "point_cloud/iteration_30/point_cloud.ply"] {
        assert!(model.join(name).is_file(), "{name} is missing");
    }

    let trained = json(&model.join("results.json"));
    let evaluated = printed(specula().arg("eval").arg(&model).arg("--json"));
    let evaluated: Value = serde_json::from_str(&evaluated).unwrap();
    for (measure, tolerance) in [("PSNR", 0.01), ("SSIM", 1e-4), ("MAE", 0.05)] {
        let [then, now] = [&trained["ours_30"][measure], &evaluated[measure]].map(|value| value.as_f64().unwrap());
        assert!((then - now).abs() < tolerance, "{measure} was {then} and is {now}");
    }
    assert_eq!(evaluated["views"].as_array().unwrap().len(), 3);

    printed(specula().arg("render").arg(&model).args(["--layers", "all"]));
    for layer in ["renders", "gt", "normal", "depth", "alpha", "diffuse", "specular", "residual", "roughness"]
        .into_iter()
        .chain(["light", "visibility", "indirect"])
    {
        let picture = image::open(model.join(format!("test/ours_30/{layer}/00002.png"))).unwrap();
        assert_eq!((picture.width(), picture.height()), (SIZE, SIZE), "{layer}");
    }

    let env = tiny.path("sky.hdr");
    latlong::write(&env, &LatLong { width: 16, height: 8, rgb: vec![0.5; 3 * 16 * 8] }).unwrap();
    let mut relight = specula();
    relight.arg("relight").arg(&model).arg("--env").arg(&env).arg("--truth").arg(tiny.file("test"));
    assert!(printed(&mut relight).starts_with("relighting PSNR "));
    assert!(model.join("relight/sky/ours_30/renders/00000.png").is_file(), "relit pictures are missing");

    let info: Value = serde_json::from_str(&printed(specula().arg("info").arg(&model).arg("--json"))).unwrap();
    assert_eq!((&info["Gaussians"], &info["not_finite"]), (&200.into(), &0.into()));
    assert_eq!(info["light"]["resolution"], 16);
}

#[test]
fn a_model_says_who_looked_the_light_up() {
    let tiny = Tiny::new();
    for (words, shading) in [(&[][..], "deferred"), (&["--light-per", "gaussian"], "paper")] {
        printed(train_by_default(&tiny, shading).args(words));
        assert_eq!(json(&tiny.path(shading).join("specula.json"))["shading"], shading);
    }
}

#[test]
fn a_model_keeps_what_is_above_and_turns_about_it() {
    let tiny = Tiny::new();
    let output = train(&tiny, "model").arg("--eval").output().unwrap();
    assert!(output.status.success());
    let found = &json(&tiny.path("model/specula.json"))["orientation"];
    assert_eq!((&found["up"], &found["told_by"]), (&serde_json::json!([0.0, 0.0, 1.0]), &"upright".into()));
    assert_eq!((&found["cameras"], &found["rolled"]), (&11.into(), &0.into()), "all are asked, held out or not");

    printed(train(&tiny, "said").args(["--scene-up", "-y"]));
    let said = &json(&tiny.path("said/specula.json"))["orientation"];
    assert_eq!((&said["up"], &said["told_by"]), (&serde_json::json!([0.0, -1.0, 0.0]), &"hand".into()));
    assert!(fs::read_to_string(tiny.path("said/config.toml")).unwrap().contains("scene-up = \"0,-1,0\""));

    let turn = |model: &str, out: &str, words: &[&str]| {
        let mut command = specula();
        command.arg("render").arg(tiny.path(model)).args(["--turntable", "2", "--layers", "rgb", "-o"]);
        printed(command.arg(tiny.path(out)).args(words));
        fs::read(tiny.path(out).join("rgb/00001.png")).unwrap()
    };
    let [found, said] = [turn("model", "a", &[]), turn("model", "b", &["--scene-up=0,-2,0"])];
    assert_ne!(found, said, "another direction above, another circle");
    assert_eq!(found, turn("model", "c", &["--scene-up", "z"]));
    let output = specula().arg("info").arg(tiny.data()).output().unwrap();
    assert!(String::from_utf8_lossy(&output.stderr).contains("up is +z within"), "{output:?}");
}

#[test]
fn a_plain_scene_is_trained_and_turned() {
    let tiny = Tiny::new();
    let mut command = specula();
    command.arg("train").arg("-s").arg(tiny.data()).arg("-m").arg(tiny.path("plain"));
    command.args(["--profile", "3dgs", "--iterations", "20", "--random_points", "100", "--quiet"]);
    printed(&mut command);
    let ply = tiny.path("plain/point_cloud/iteration_20/point_cloud.ply");
    let mut command = specula();
    command.arg("render").arg(&ply).args(["--turntable", "4", "--size", "20,16", "-o"]).arg(tiny.path("turn"));
    printed(&mut command);
    assert!(tiny.path("turn/turntable.png").is_file(), "no animation was made");
    assert_eq!(fs::read_dir(tiny.path("turn/rgb")).unwrap().count(), 4);
    fs::create_dir(tiny.file("depth")).unwrap();
    fs::write(tiny.file("depth/r_0.png"), "").unwrap();
    let info = printed(specula().arg("info").arg(tiny.data()));
    for line in
        ["training views   8", "held out         named by transforms_test.json", "not used         \"depth\" (1 files)"]
    {
        assert!(info.contains(line), "{line:?} is not in: {info}");
    }
}

#[test]
fn what_is_left_out_is_said_and_not_missed() {
    let tiny = Tiny::new();
    let small_light = ["--light-resolution", "16"];
    for (profile, blended, words) in [("3dgs", 3, &[][..]), ("paper", 3, &small_light), ("specula", 10, &small_light)] {
        let model = tiny.path(profile);
        let mut command = specula();
        command.arg("train").arg(tiny.data()).arg("-m").arg(&model).args(["--profile", profile]).args(words);
        printed(command.args(["--iterations", "10", "--random-points", "100", "--quiet"]));

        let info: Value = serde_json::from_str(&printed(specula().arg("info").arg(&model).arg("--json"))).unwrap();
        assert_eq!(info["blends"]["numbers"], blended, "{profile}: {info}");
        assert_ne!(info["left_out"], serde_json::json!([]), "{profile}: {info}");
        let [read, all] = ["bytes", "in_full"].map(|key| info["reads"][key].as_u64().unwrap());
        assert!(read <= all, "{profile}: {read} of {all} bytes");
        let text = printed(specula().arg("info").arg(&model));
        assert!(text.contains("\n  skipped          ") && text.contains("numbers for each pixel of a splat"), "{text}");

        for layers in ["rgb", "normal", "all"] {
            let mut command = specula();
            command.arg("render").arg(&model).args(["--split", "all", "--quiet", "--verify-omissions"]);
            let text = printed(command.args(["--layers", layers]).arg("-o").arg(tiny.path("out")));
            assert!(text.ends_with("\nlargest difference: 0\n"), "{profile}, {layers}: {text}");
        }
    }
}

/// Largest difference of two pictures, in steps of 8 bits.
fn largest_difference(one: &Path, other: &Path) -> u8 {
    let [one, other] = [one, other].map(|path| image::open(path).unwrap().to_rgb8().into_raw());
    assert_eq!(one.len(), other.len(), "pictures have the same size");
    one.iter().zip(&other).map(|(a, b)| a.abs_diff(*b)).max().unwrap()
}

#[test]
fn a_gpu_renders_what_the_processor_renders() {
    /// Rounding moves a colour by one step of 8 bits at most; no splat of so few meets a cut.
    const ROUNDED: u8 = 1;
    let report: Value = serde_json::from_str(&printed(specula().args(["doctor", "--json"]))).unwrap();
    assert!(report["cpu"]["threads"].as_u64().unwrap() > 0);
    if report["adapters"].as_array().unwrap().is_empty() {
        assert!(std::env::var_os("CI").is_none(), "CI needs an adapter");
        eprintln!("NOT TESTED, because there is no adapter");
        return;
    }
    let tiny = Tiny::new();
    printed(&mut train(&tiny, "model"));
    for (executor, storage) in [("cpu", "f32"), ("gpu", "f32"), ("cpu", "f16"), ("gpu", "f16")] {
        let mut render = specula();
        render.arg("render").arg(tiny.path("model")).args(["--turntable", "2", "--size", "40,32"]);
        render.args(["--executor", executor, "--storage", storage, "--verify-omissions"]);
        printed(render.arg("-o").arg(tiny.path(&format!("{executor}-{storage}"))));
    }
    for (layer, storage) in ["rgb", "normal", "alpha"].iter().flat_map(|layer| [(layer, "f32"), (layer, "f16")]) {
        let of = |executor: &str| tiny.path(&format!("{executor}-{storage}")).join(layer).join("00001.png");
        let difference = largest_difference(&of("cpu"), &of("gpu"));
        assert!(difference <= ROUNDED, "{layer} in {storage} differs by {difference}");
    }
}

#[test]
fn the_number_of_threads_changes_no_byte() {
    let tiny = Tiny::new();
    let saved = |model: &str, threads: &str| {
        train(&tiny, model).args(["--quiet", "--threads", threads]).assert().success();
        ["point_cloud/iteration_30/point_cloud.ply", "light/iteration_30/environment.exr"]
            .map(|name| fs::read(tiny.path(model).join(name)).unwrap())
    };
    let once = saved("once", "1");
    assert!(once == saved("again", "1"), "two equal trainings differ");
    assert!(once == saved("two", "2"), "one and two threads differ");
}

#[test]
fn a_reader_that_goes_away_is_no_error() {
    let tiny = Tiny::new();
    let mut child = Command::new(cargo_bin!("specula"))
        .arg("info")
        .arg(tiny.data())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    assert!(child.wait().unwrap().success(), "a closed pipe is an end, not an error");
}

#[cfg(unix)]
#[test]
fn ctrl_c_saves_what_there_is() {
    let tiny = Tiny::new();
    let mut child = Command::new(cargo_bin!("specula"))
        .arg("train")
        .arg(tiny.data())
        .arg("-m")
        .arg(tiny.path("model"))
        .args(["--iterations", "1000000", "--random-points", "200", "--light-resolution", "16"])
        .args(["--save-iterations", "1"])
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map(Result::unwrap);
    assert!(lines.any(|line| line.contains("saved iteration 1")), "training did not begin");

    Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    let last = lines.last().unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let iteration = last.split("iteration ").nth(1).unwrap().split(',').next().unwrap().to_owned();
    assert!(tiny.path(&format!("model/point_cloud/iteration_{iteration}/point_cloud.ply")).is_file(), "{last}");
}

#[test]
fn a_training_says_where_it_computes_and_what_comes_next() {
    let tiny = Tiny::new();
    let stderr = train(&tiny, "my model").args(["--executor", "cpu", "--threads", "2"]).assert().success();
    let stderr = String::from_utf8(stderr.get_output().stderr.clone()).unwrap();
    assert!(stderr.contains("training on the CPU, 2 threads\n"), "{stderr}");
    let next: Vec<&str> = stderr.lines().filter_map(|line| line.strip_prefix("specula: next: ")).collect();
    assert_eq!(next[0], format!("specula view '{}'", tiny.path("my model").display()));
    assert!(next[2].starts_with("specula relight "), "a shaded scene takes another light: {next:?}");
}

#[test]
fn the_authors_own_command_line_is_understood() {
    let tiny = Tiny::new();
    let wide = image::RgbImage::from_pixel(2000, 20, image::Rgb([90, 80, 70]));
    wide.save(tiny.file("train/r_0.png")).unwrap();
    let mut command = specula();
    command.arg("train").arg("-s").arg(tiny.data()).arg("-m").arg(tiny.path("model")).args(["-w", "-r", "-1"]);
    command.args([
        "--brdf_dim",
        "0",
        "--sh_degree",
        "-1",
        "--brdf_env",
        "16",
        "--iterations",
        "1",
        "--random-points",
        "9",
    ]);
    let stderr = String::from_utf8(command.assert().success().get_output().stderr.clone()).unwrap();
    for words in ["-r -1 is -r 2", "1000 wide", "--brdf_dim is ignored", "--sh_degree -1 is ignored"] {
        assert!(stderr.contains(words), "{words:?} is not in: {stderr}");
    }
    let config = fs::read_to_string(tiny.path("model/config.toml")).unwrap();
    assert!(config.contains("resolution = 2") && !config.contains("sh-degree"), "{config}");
    specula().arg("train").arg("-m").arg(tiny.path("model")).args(["--resume", "--iterations", "2"]).assert().success();
}

#[test]
fn the_light_is_seen_behind_the_scene() {
    let tiny = Tiny::new();
    train(&tiny, "model").arg("--eval").assert().success();
    let (model, env) = (tiny.path("model"), tiny.path("env.exr"));
    let rgb = [0.0, 0.5, 0.0].repeat(8 * 4);
    latlong::write(&env, &LatLong { width: 8, height: 4, rgb }).unwrap();
    let shown = |words: &[&str], out: &str| {
        let mut command = specula();
        command.arg(words[0]).arg(&model).args(&words[1..]).arg("-o").arg(tiny.path(out)).assert().success();
        image::open(tiny.path(out).join("rgb/00000.png")).unwrap().into_rgb8()
    };
    let path = env.to_str().unwrap();
    // The corner shows nothing else; half of white's radiance is 188 in sRGB.
    for words in [["relight", "--background", "env", "--env", path], ["render", "--background", "env", "--env", path]] {
        assert_eq!(shown(&words, "env").get_pixel(0, 0).0, [0, 188, 0], "{words:?}");
    }
    assert_eq!(shown(&["relight", "--background", "0,0,1", "--env", path], "blue").get_pixel(0, 0).0, [0, 0, 255]);
    shown(&["render", "--background", "env", "--turntable", "2", "--size", "16,16"], "turn");
    let mut command = specula();
    command
        .arg("relight")
        .arg(&model)
        .args(["--env", path, "--background", "env", "--truth"])
        .arg(tiny.path("turn/rgb"));
    assert!(
        String::from_utf8(command.assert().code(2).get_output().stderr.clone()).unwrap().contains("--background env")
    );
}

#[test]
fn objects_get_materials_unless_these_are_left_out() {
    let tiny = Tiny::new();
    let has_materials = |name: &str, words: &[&str]| {
        let mut command = specula();
        command.arg("train").arg(tiny.data()).arg("-m").arg(tiny.path(name)).args(words);
        command.args(["--iterations", "20", "--random-points", "100", "--light-resolution", "16", "--executor", "cpu"]);
        let done = command.assert().success();
        let told = String::from_utf8_lossy(&done.get_output().stderr).into_owned();
        let sun = specula().arg("relight").arg(tiny.path(name)).args(["--sun", "30,45"]).output().unwrap();
        assert_eq!(told.contains("--sun 30,45 --ground"), sun.status.success(), "{told}");
        (sun.status.success(), told.contains("--no-materials"))
    };
    assert_eq!(has_materials("default", &[]), (true, true));
    assert_eq!(has_materials("asked", &["--relightable"]), (true, false));
    assert_eq!(has_materials("without", &["--no-materials"]), (false, false));
    assert_eq!(has_materials("paper", &["--light-per", "gaussian"]), (false, false));

    let mut command = specula();
    command.arg("train").arg(tiny.data()).arg("-m").arg(tiny.path("none")).args([
        "--profile",
        "paper",
        "--no-materials",
    ]);
    let refused = command.assert().code(2);
    let told = String::from_utf8_lossy(&refused.get_output().stderr).into_owned();
    assert!(told.contains("omit --no-materials"), "{told}");
}

#[test]
fn ground_of_a_scene_over_black_is_white_and_the_program_contains_lights() {
    let tiny = Tiny::new();
    train_relightable(&tiny, "model").args(["--quiet", "--background", "black"]).assert().success();
    let corner = |words: &[&str], out: &str| {
        let mut command = specula();
        command.arg("relight").arg(tiny.path("model")).args(words).arg("-o").arg(tiny.path(out)).assert().success();
        image::open(tiny.path(out).join("rgb/00000.png")).unwrap().into_rgb8().get_pixel(0, 0).0
    };
    let views = ["--env", "sunset", "--turntable", "1", "--size", "16,16"];
    assert_eq!(corner(&views, "open"), [0; 3]);
    let [red, green, blue] = corner(&[&views[..], &["--ground"]].concat(), "ground");
    assert!(red.min(green).min(blue) > 100, "the ground is {red}, {green}, {blue}");
}

#[test]
fn a_video_shows_a_turntable_where_ffmpeg_is_installed() {
    if !Command::new("ffmpeg").arg("-version").output().is_ok_and(|output| output.status.success()) {
        eprintln!("NOT TESTED, because there is no ffmpeg");
        return;
    }
    let tiny = Tiny::new();
    train(&tiny, "vase").arg("--quiet").assert().success();
    for (name, start) in [("turn.mp4", &b"ftyp"[..]), ("turn.webp", b"WEBP"), ("turn.gif", b"GIF8")] {
        let video = tiny.path(&format!("videos/{name}"));
        let mut render = specula();
        render.arg("render").arg(tiny.path("vase")).args(["--turntable", "3", "--size", "33,31", "-o"]).arg(&video);
        assert_eq!(printed(&mut render).trim(), video.to_str().unwrap());
        let bytes = fs::read(&video).unwrap();
        assert!(bytes.windows(4).take(16).any(|part| part == start), "{name} is none");
    }
    let left = fs::read_dir(tiny.path("videos")).unwrap().count();
    assert_eq!(left, 3, "pictures are removed");
}
