//! The page of `specula view`: what is served, to whom, and what a real browser makes of it.

use crate::browser::{Browser, Page};
use crate::site::{Answer, Site, crowd, request, sent, with_descriptors};
use crate::tiny::{Tiny, specula, train, train_relightable};
use assert_cmd::cargo::cargo_bin;
use core::time::Duration;
use image::RgbImage;
use serde_json::json;
use specula_io::{
    latlong::{self, LatLong},
    model_folder::{gaussians_at, light_at},
};
use std::{
    fs,
    io::{Read, Write},
    net::TcpStream,
    path::{Path, PathBuf},
    process::Command,
    thread,
    time::Instant,
};

/// A query for a picture of a pose from which the scene is seen.
const POSE: &str = "eye=4,0,1.5&look=-4,0,-1.5&up=0,0,1&angle=40&size=48,40";

fn trained(tiny: &Tiny) -> PathBuf {
    train(tiny, "model").args(["--eval", "--quiet"]).assert().success();
    tiny.path("model")
}

/// A model with physical materials.
pub(crate) fn relightable(tiny: &Tiny) -> PathBuf {
    train_relightable(tiny, "relightable").args(["--eval", "--quiet"]).assert().success();
    tiny.path("relightable")
}

/// A picture that the program writes of a view.
fn rendered(tiny: &Tiny, model: &Path, words: &[&str], name: &str) -> RgbImage {
    let out = tiny.path("pictures");
    let mut command = specula();
    command.arg("render").arg(model).arg("-o").arg(&out).args(["--executor", "cpu", "--quiet"]).args(words);
    command.assert().success();
    image::open(out.join(name)).unwrap().to_rgb8()
}

/// A light that is bright on one side.
pub(crate) fn sky(tiny: &Tiny) -> Vec<u8> {
    let path = tiny.path("sky.hdr");
    let rgb = (0..32 * 16).flat_map(|k| if k % 32 < 8 { [8.0, 4.0, 1.0] } else { [0.02; 3] }).collect();
    latlong::write(&path, &LatLong { width: 32, height: 16, rgb }).unwrap();
    fs::read(path).unwrap()
}

#[test]
fn pictures_are_those_that_render_writes() {
    let tiny = Tiny::new();
    let model = trained(&tiny);
    let site = Site::of(&model, &["--quiet"]);
    let scene = site.get("/scene").json();
    // A model in a folder of this name has that of the folder above.
    let name = model.parent().unwrap().file_name().unwrap().to_str().unwrap();
    assert_eq!((&scene["name"], &scene["gaussians"], &scene["shaded"]), (&json!(name), &json!(200), &json!(true)));
    assert_eq!((scene["views"].as_array().unwrap().len(), &scene["views"][0]["held_out"]), (11, &json!(true)));
    for layer in ["rgb", "normal", "depth", "alpha", "specular", "roughness"] {
        let expected = rendered(&tiny, &model, &["--layers", layer], &format!("{layer}/00001.png"));
        let shown = site.get(&format!("/frame?view=1&size=32,32&layer={layer}"));
        assert!(shown.head.to_lowercase().contains("x-view: r_1"), "{}", shown.head);
        assert_eq!(shown.picture(), expected, "{layer}");
    }
    let expected = rendered(&tiny, &model, &["--layers", "rgb", "--size", "48,48"], "rgb/00001.png");
    assert_eq!(site.get("/frame?view=1&size=48,80").picture(), expected, "as large as fits");
    let jpeg = site.get(&format!("/frame?{POSE}&format=jpeg&quality=90"));
    assert!(jpeg.head.contains("image/jpeg") && jpeg.picture().dimensions() == (48, 40), "{}", jpeg.head);
}

#[test]
fn errors_are_those_of_the_nearest_view() {
    let tiny = Tiny::new();
    let model = trained(&tiny);
    let site = Site::of(&model, &["--quiet"]);
    let view = site.get("/scene").json()["views"][5].clone();
    let list = |value: &serde_json::Value| {
        let numbers = value.as_array().unwrap().iter();
        numbers.map(ToString::to_string).collect::<Vec<_>>().join(",")
    };
    let [eye, look, up] = ["eye", "look", "up"].map(|name| list(&view[name]));
    let answer = site.get(&format!("/frame?eye={eye}&look={look}&up={up}&angle=50&size=32,32&layer=error"));
    let head = answer.head.to_lowercase();
    assert!(head.contains(&format!("x-view: {}", view["name"].as_str().unwrap())), "{head}");
    let psnr: f64 = head.lines().find_map(|line| line.strip_prefix("x-psnr: ")).unwrap().parse().unwrap();
    assert!((5.0..60.0).contains(&psnr), "PSNR {psnr}");
    assert_eq!(answer.picture().dimensions(), (32, 32));

    // Held-out views are measured as `eval` does it.
    let report = specula().arg("eval").arg(&model).args(["--json", "--executor", "cpu"]).output().unwrap().stdout;
    let report: serde_json::Value = serde_json::from_slice(&report).unwrap();
    let head = site.get("/frame?view=2&size=32,32&layer=error").head.to_lowercase();
    let psnr: f64 = head.lines().find_map(|line| line.strip_prefix("x-psnr: ")).unwrap().parse().unwrap();
    assert!((psnr - report["views"][2]["PSNR"].as_f64().unwrap()).abs() < 0.006, "{psnr}: {report}");

    fs::remove_dir_all(tiny.data()).unwrap();
    let gone = site.get("/frame?view=3&size=32,32&layer=error");
    assert!(gone.status == 400 && gone.text().contains("data"), "{}", gone.text());
}

#[test]
fn bad_requests_are_refused_in_a_sentence() {
    let tiny = Tiny::new();
    let site = Site::of(&trained(&tiny), &["--quiet"]);
    let cases = [
        ("/frame", "missing"),
        ("/frame?view=0&size=5000,5", "size"),
        ("/frame?view=0&size=4000,4000", "pixels"),
        ("/frame?view=99&size=32,32", "view 99"),
        ("/frame?view=0&size=32,32&layer=colour", "colour"),
        ("/frame?view=0&size=32,32&light=7", "light 7"),
        ("/frame?view=0&size=32,32&format=gif", "format"),
        ("/frame?eye=1,2,3&look=0,0,1&up=0,0,1&angle=40&size=32,32", "parallel"),
        ("/light?light=x", "light"),
    ];
    for (path, word) in cases {
        let answer = site.get(path);
        let text = answer.text();
        assert!(answer.status == 400 && text.contains(word) && text.lines().count() == 1, "{path}: {answer:?}");
    }
    assert_eq!(site.get("/point?view=0&size=32,32&at=2,0").status, 400);
    assert_eq!(site.get("/nothing").status, 404);
    assert_eq!(site.get("/training").status, 404, "nothing is trained");
    let uploads: [(&str, &[u8], &str); 5] = [
        ("/light?name=sky.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 30000 +X 60000\n", "60000 × 30000"),
        ("/light?name=sky.png", b"", ".hdr or .exr"),
        ("/light?name=sky.hdr", b"no light", "sky.hdr"),
        ("/light?name=../../sky.exr", b"no light", "sky.exr"),
        ("/light?name=sky.hdr&up=x", b"", "y or z"),
    ];
    for (path, body, word) in uploads {
        let answer = site.post(path, body);
        assert!(answer.status == 400 && answer.text().contains(word), "{path}: {}", answer.text());
    }
    // A client that sends too much may find the connection closed before it has read the reason.
    let status = site.post("/light?name=sky.hdr", &vec![0; (64 << 20) + 1]).status;
    assert!(status == 413 || status == 0, "{status}");
    assert_eq!(site.get(&format!("/frame?{POSE}")).status, 200, "it still answers");
}

#[test]
fn a_light_is_behind_the_scene_where_that_is_asked_for() {
    let tiny = Tiny::new();
    let site = Site::of(&trained(&tiny), &["--quiet"]);
    assert_eq!(site.post("/light?name=sky.hdr", &sky(&tiny)).status, 200);
    let shown = |words: &str| site.get(&format!("/frame?{POSE}&light=4{words}")).picture();
    // The edge of the picture is beside the scene.
    let corner = |picture: &RgbImage| picture.get_pixel(0, 0).0;
    let (plain, behind) = (shown(""), shown("&backdrop=env"));
    assert!(corner(&plain).iter().all(|channel| *channel > 250), "the background: {:?}", corner(&plain));
    assert!(corner(&behind).iter().any(|channel| *channel < 240), "the light: {:?}", corner(&behind));
    // The sky is bright in a quarter of its azimuths, beside that of the corner.
    let turned = ["&backdrop=env&turn=60", "&backdrop=env&turn=300"].map(|words| corner(&shown(words))[0]);
    assert!(turned.iter().any(|red| *red > 250), "it turns with the light: {turned:?}");
    assert!(turned.iter().any(|red| *red < 240), "to one side of it: {turned:?}");
    assert_eq!(shown("&backdrop=env&layer=normal"), shown("&layer=normal"), "behind colours only");
    assert_eq!(site.get(&format!("/frame?{POSE}&backdrop=x")).status, 400);
}

#[test]
fn suns_and_lamps_of_the_command_line_start_the_page() {
    let tiny = Tiny::new();
    let model = relightable(&tiny);
    fs::write(tiny.path("sky.hdr"), sky(&tiny)).unwrap();
    let file = tiny.path("evening.toml");
    fs::write(&file, "env = \"sky.hdr\"\nexposure = -1\nturn = 20\nsun = [\"30,45\"]\n").unwrap();
    let site = Site::of(&model, &["--quiet", "--lights", file.to_str().unwrap(), "--lamp", "0,0,3,2:ff8800"]);
    let scene = site.get("/scene").json();
    let setup = json!({
        "light": 1, "turn": 20.0, "stops": -1.0, "suns": "30,45,3,0.53", "lamps": "0,0,3,2,0:ff8800", "ground": false
    });
    assert_eq!((&scene["setup"], &scene["physical"]), (&setup, &json!(true)));
    assert_eq!(scene["lights"][2], json!({"id": 1, "name": "sky", "file": "sky.hdr", "up": "scene"}));
    fs::copy(tiny.path("sky.hdr"), tiny.path("noon.hdr")).unwrap();
    let both = ["--quiet", "--lights", file.to_str().unwrap(), "--env", tiny.path("noon.hdr").to_str().unwrap()]
        .map(str::to_owned);
    let scene = Site::of(&model, &both.each_ref().map(String::as_str)).get("/scene").json();
    assert_eq!(
        (&scene["setup"]["light"], &scene["lights"][2]["name"]),
        (&json!(1), &json!("noon")),
        "--env comes first"
    );
    let sunny = Site::of(&model, &["--quiet", "--sun", "30,45"]);
    assert_eq!(sunny.get("/scene").json()["setup"]["light"], json!("none"), "only suns shine, as with relight");
    let shown = |words: &str| sunny.get(&format!("/frame?{POSE}{words}"));
    assert!(shown("&light=none&suns=30,45").picture() != shown("&light=none").picture());
    let many = ["0,45"; 9].join(";");
    for (words, word) in
        [(format!("&suns={many}"), "at most 8"), ("&suns=0,NaN".into(), "suns"), ("&rays=99".into(), "rays")]
    {
        let refused = shown(&words);
        assert!(refused.status == 400 && refused.text().contains(word), "{words}: {refused:?}");
    }

    let refused = |model: &Path, words: &[&str], word: &str| {
        let output = specula().arg("view").arg(model).args(["--listen", "0"]).args(words).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(2) && said.contains(word), "{words:?}: {said}");
    };
    refused(&model, &[["--sun", "0,45"]; 9].concat(), "at most 8");
    refused(&model, &["--lights", "nowhere.toml"], "nowhere.toml");
    let plain = trained(&tiny);
    refused(&plain, &["--sun", "0,45"], "--relightable");
    let answer = Site::of(&plain, &["--quiet"]).get(&format!("/frame?{POSE}&suns=0,45"));
    assert!(answer.status == 400 && answer.text().contains("--relightable"), "{answer:?}");
}

#[test]
fn a_point_of_a_picture_is_a_place_of_the_scene() {
    let tiny = Tiny::new();
    let site = Site::of(&trained(&tiny), &["--quiet"]);
    let point = |at: &str| site.get(&format!("/point?{POSE}&at={at}")).json()["point"].clone();
    let middle: Vec<f64> = point("0.5,0.5").as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
    let distance = middle.iter().map(|x| x * x).sum::<f64>().sqrt();
    assert!(distance < 1.3 && middle[0] > 0.0, "on the near side of the ball: {middle:?}");
    assert_eq!(point("0,0"), json!(null), "beside it there is nothing");
}

#[test]
fn who_may_not_ask_is_not_answered() {
    let tiny = Tiny::new();
    let model = trained(&tiny);
    let here = Site::of(&model, &["--quiet"]);
    let page = here.get("/");
    assert!(page.status == 200 && page.head.contains("default-src 'self'"), "{}", page.head);
    for headers in [
        [("host", "evil.example")],
        [("origin", "http://evil.example")],
        [("sec-fetch-site", "same-site")],
        [("host", "[::1].evil.example")],
    ] {
        assert_eq!(here.get_as("/scene", &headers).status, 403, "{headers:?}");
    }
    let posted = request(here.port, "POST", "/light?name=a.hdr", &[("origin", "http://evil.example")], b"x");
    assert_eq!(posted.status, 403, "nothing comes in from elsewhere");

    let anywhere = Site::of(&model, &["--quiet", "--listen", "0.0.0.0:0"]);
    let (_, token) = anywhere.url.split_once("#token=").expect("a token is part of the address");
    let elsewhere = ("host", "192.168.0.2:7008");
    assert_eq!(anywhere.get_as("/", &[elsewhere]).status, 200, "the page holds nothing");
    for path in ["/scene", "/frame", "/light", "/training"] {
        assert_eq!(anywhere.get_as(path, &[elsewhere]).status, 401, "{path}");
        assert_eq!(anywhere.get_as(path, &[elsewhere, ("x-specula-token", "0000")]).status, 401, "{path}");
    }
    assert_eq!(anywhere.get_as("/scene", &[elsewhere, ("x-specula-token", token)]).status, 200);
}

#[test]
fn clients_look_at_what_they_like_and_go_when_they_like() {
    let tiny = Tiny::new();
    let model = trained(&tiny);
    let site = Site::of(&model, &["--quiet"]);
    let added = site.post("/light?name=sky.hdr", &sky(&tiny)).json();
    assert_eq!(added, json!({"id": 4, "name": "sky", "file": "sky.hdr", "up": "scene", "notes": []}));
    let paths = ["", "&light=4", "&light=4&turn=90", "&light=4&stops=2", "&layer=normal"]
        .map(|more| format!("/frame?view=0&size=32,32{more}"));
    let alone: Vec<Vec<u8>> = paths.iter().map(|path| site.get(path).body).collect();
    for (index, picture) in alone.iter().enumerate() {
        assert!(alone[..index].iter().all(|other| other != picture), "{} looks like another", paths[index]);
    }
    let expected = {
        let env = tiny.path("sky.hdr").display().to_string();
        rendered(&tiny, &model, &["--layers", "rgb", "--env", &env], "rgb/00000.png")
    };
    assert_eq!(image::load_from_memory(&alone[1]).unwrap().to_rgb8(), expected, "as `render --env` has it");

    // All at once, while others ask for much and do not wait for it.
    thread::scope(|scope| {
        for _ in 0..8 {
            drop(sent(site.port, "GET", "/frame?view=0&size=2000,2000&layer=light", &[], &[]));
        }
        for (path, expected) in paths.iter().zip(&alone) {
            let site = &site;
            scope.spawn(move || {
                for _ in 0..3 {
                    assert!(site.get(path).body == *expected, "{path} is another picture in company");
                }
            });
        }
    });
}

#[cfg(unix)]
#[test]
fn it_ends_when_it_is_asked_to() {
    let tiny = Tiny::new();
    let site = Site::of(&trained(&tiny), &["--quiet"]);
    // A connection that is kept open holds nothing up.
    let _open = TcpStream::connect(("127.0.0.1", site.port)).unwrap();
    interrupt(&site);
    let start = Instant::now();
    assert_eq!(site.ended(), Some(0));
    assert!(start.elapsed() < Duration::from_secs(5), "it took {:?}", start.elapsed());
}

#[test]
fn an_address_that_is_taken_is_said() {
    let tiny = Tiny::new();
    let model = trained(&tiny);
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let output = specula().arg("view").arg(&model).args(["--listen", &address]).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(2) && said.contains(&address) && said.lines().count() == 1, "{said}");
}

#[test]
fn what_is_no_scene_is_refused_with_what_to_open() {
    let tiny = Tiny::new();
    let model = trained(&tiny);
    let refused = |path: &Path| {
        let output = specula().arg("view").arg(path).args(["--listen", "0"]).output().unwrap();
        assert_eq!(output.status.code(), Some(2));
        String::from_utf8(output.stderr).unwrap()
    };
    let said = refused(model.parent().unwrap());
    assert!(said.contains(&format!("open {model:?}")), "{said}");
    for (name, cause) in [("scene.splat", "not finite"), ("scene.spz", "header"), ("scene.ksplat", "the .ply file")] {
        let damaged = tiny.path(name);
        fs::write(&damaged, [0xff; 64]).unwrap();
        let said = refused(&damaged);
        assert!(said.contains(name) && said.contains(cause), "{said}");
    }
}

#[test]
fn a_plain_scene_has_no_light() {
    let tiny = Tiny::new();
    let mut command = specula();
    command.arg("train").arg(tiny.data()).arg("-m").arg(tiny.path("plain"));
    command.args(["--profile", "3dgs", "--iterations", "20", "--random-points", "100", "--quiet"]).assert().success();
    let site = Site::of(&tiny.path("plain"), &["--quiet"]);
    assert_eq!(site.get("/scene").json()["layers"], json!(["rgb", "normal", "depth", "alpha", "error"]));
    assert_eq!(site.get(&format!("/frame?{POSE}")).status, 200);
    assert_eq!(site.get(&format!("/frame?{POSE}&layer=tint")).status, 400);
    assert_eq!(site.post("/light?name=sky.hdr", &sky(&tiny)).status, 400);
}

/// Steps of a training that is watched: enough to be paused on the way.
const STEPS: u32 = 400;

/// Result of a training: Gaussians and light, to the last bit.
fn learned(model: &Path) -> [Vec<u8>; 2] {
    [gaussians_at(model, STEPS), light_at(model, STEPS)].map(|path| fs::read(path).unwrap())
}

/// A training in which Gaussians come and go.
fn training(tiny: &Tiny, model: &str) -> Command {
    let mut command = Command::new(cargo_bin!("specula"));
    command.arg("train").arg(tiny.data()).arg("-m").arg(tiny.path(model));
    command.args([
        "--iterations",
        &STEPS.to_string(),
        "--random-points",
        "200",
        "--light-resolution",
        "16",
        "--executor",
        "cpu",
    ]);
    command.args(["--densification-interval", "10", "--densify-from-iter", "10", "--max-gaussians", "400"]);
    command
}

#[test]
fn a_training_that_is_watched_comes_to_the_same_bits() {
    let tiny = Tiny::new();
    assert!(training(&tiny, "alone").arg("--quiet").status().unwrap().success());

    let mut command = training(&tiny, "watched");
    command.args(["--view", "0", "--quiet"]);
    let site = Site::started(command);
    let frame = || site.get("/frame?view=0&size=32,32");
    let iteration = |answer: &Answer| -> u64 {
        let head = answer.head.to_lowercase();
        head.lines().find_map(|line| line.strip_prefix("x-iteration: ")).unwrap().parse().unwrap()
    };
    let paused = site.post("/training?do=pause", &[]).json();
    assert_eq!((&paused["paused"], &paused["iterations"]), (&json!(true), &json!(STEPS)));
    let settled = |steps: &str| {
        let before = site.post(&format!("/training?do=step&steps={steps}"), &[]).json();
        let start = Instant::now();
        loop {
            let now = site.get("/training").json();
            if now["paused"] == true || start.elapsed() > Duration::from_secs(20) {
                return (before["iteration"].as_u64().unwrap(), now["iteration"].as_u64().unwrap());
            }
            thread::sleep(Duration::from_millis(10));
        }
    };
    let (_, start) = settled("0");
    assert!(start < u64::from(STEPS) / 2, "it was paused in time");
    let mut pictures = vec![frame().body];
    for steps in [1, 7] {
        settled(&steps.to_string());
        let asked = Instant::now();
        while iteration(&frame()) < start + steps && asked.elapsed() < Duration::from_secs(20) {
            thread::sleep(Duration::from_millis(50));
        }
        pictures.push(frame().body);
    }
    assert!(pictures[0] != pictures[2], "the picture follows the training");
    let report = site.get("/training").json();
    assert!(report["curve"]["iteration"].as_array().unwrap().len() as u64 >= start + 8, "{report}");
    site.post("/training?do=go", &[]);
    assert_eq!(site.ended(), Some(0), "it comes to its end");
    assert!(learned(&tiny.path("alone")) == learned(&tiny.path("watched")), "the models differ");
}

#[cfg(unix)]
#[test]
fn a_finished_training_is_shown_until_it_is_asked_to_end() {
    let tiny = Tiny::new();
    let mut command = training(&tiny, "watched");
    command.args(["--view", "0", "--view-until", "ctrl-c", "--quiet"]);
    let site = Site::started(command);
    let start = Instant::now();
    let report = loop {
        let report = site.get("/training").json();
        if report["finished"] == true {
            break report;
        }
        assert!(start.elapsed() < Duration::from_secs(60), "{report}");
        thread::sleep(Duration::from_millis(50));
    };
    assert_eq!((&report["iteration"], &report["paused"]), (&json!(STEPS), &json!(false)));
    let model = tiny.path("watched");
    assert!(gaussians_at(&model, STEPS).is_file(), "the model is saved first");
    let expected = rendered(&tiny, &model, &["--layers", "rgb"], "rgb/00000.png");
    assert_eq!(site.get("/frame?view=0&size=32,32").picture(), expected, "what is shown is what was saved");
    interrupt(&site);
    assert_eq!(site.ended(), Some(0));
}

#[cfg(unix)]
fn interrupt(site: &Site) {
    Command::new("kill").args(["-INT", &site.id().to_string()]).status().unwrap();
}

#[cfg(unix)]
#[test]
fn a_training_that_is_watched_by_a_crowd_comes_to_the_same_bits() {
    let tiny = Tiny::new();
    assert!(training(&tiny, "alone").arg("--quiet").status().unwrap().success());

    let mut command = training(&tiny, "watched");
    command.args(["--view", "0", "--checkpoint-every", "50", "--quiet"]);
    let site = Site::started(with_descriptors(&command, 256));
    assert_eq!(site.post("/training?do=pause", &[]).status, 200);
    let _crowd = crowd(site.port, 400);
    assert_eq!(site.post("/training?do=go", &[]).status, 200, "somebody else is served");
    assert_eq!(site.ended(), Some(0), "it comes to its end");
    assert!(learned(&tiny.path("alone")) == learned(&tiny.path("watched")), "the models differ");
    assert!(tiny.path("watched/checkpoint.safetensors").is_file(), "it is saved");
}

#[cfg(unix)]
#[test]
fn idle_connections_do_not_shut_others_out() {
    let tiny = Tiny::new();
    let mut command = Command::new(cargo_bin!("specula"));
    command.arg("view").arg(trained(&tiny)).args(["--executor", "cpu", "--listen", "0", "--quiet"]);
    let site = Site::started(with_descriptors(&command, 256));
    let first = site.get(&format!("/frame?{POSE}")).body;
    let _crowd = crowd(site.port, 400);
    assert!(site.get(&format!("/frame?{POSE}")).body == first, "it still answers");
}

#[test]
fn one_light_is_read_at_a_time() {
    let tiny = Tiny::new();
    let site = Site::of(&trained(&tiny), &["--quiet"]);
    let sky = sky(&tiny);
    let mut first = TcpStream::connect(("127.0.0.1", site.port)).unwrap();
    let head = format!("POST /light?name=sky.hdr HTTP/1.1\r\nhost: localhost\r\ncontent-length: {}\r\n\r\n", sky.len());
    first.write_all(head.as_bytes()).unwrap();
    // The first has its turn once the server asks for the body.
    let start = Instant::now();
    let refused = loop {
        let answer = site.post("/light?name=sky.hdr", &sky);
        assert!(start.elapsed() < Duration::from_secs(20), "{answer:?}");
        if answer.status != 200 {
            break answer;
        }
    };
    assert!(refused.status == 503 && refused.text().contains("another light"), "{}", refused.text());
    assert!(refused.head.to_lowercase().contains("retry-after: "), "{}", refused.head);
    first.write_all(&sky).unwrap();
    let mut answer = [0; 12];
    first.read_exact(&mut answer).unwrap();
    assert_eq!(&answer, b"HTTP/1.1 200", "the first is read");
    drop(first);
    assert_eq!(site.post("/light?name=sky.hdr", &sky).status, 200, "and then the next");
}

#[cfg(unix)]
#[test]
fn nothing_of_a_light_that_comes_at_the_end_is_left() {
    let tiny = Tiny::new();
    let mut view = Command::new(cargo_bin!("specula"));
    view.arg("view").arg(trained(&tiny)).args(["--executor", "cpu", "--listen", "0", "--quiet"]);
    let mut watched = training(&tiny, "watched");
    watched.args(["--view", "0", "--quiet"]);
    for (mut command, name) in [(view, "view"), (watched, "train")] {
        let temporary = tiny.path(name);
        fs::create_dir(&temporary).unwrap();
        command.env("TMPDIR", &temporary);
        let site = Site::started(command);
        if name == "train" {
            assert_eq!(site.post("/training?do=pause", &[]).status, 200);
        }
        let mut slow = TcpStream::connect(("127.0.0.1", site.port)).unwrap();
        slow.write_all(b"POST /light?name=sky.hdr HTTP/1.1\r\nhost: localhost\r\ncontent-length: 60\r\n\r\n#?")
            .unwrap();
        let start = Instant::now();
        while site.get("/scene").json()["reading"] != true {
            assert!(start.elapsed() < Duration::from_secs(20), "the light is not read");
        }
        if name == "train" {
            site.post("/training?do=go", &[]);
        } else {
            interrupt(&site);
        }
        assert_eq!(site.ended(), Some(0), "{name}");
        assert_eq!(fs::read_dir(&temporary).unwrap().count(), 0, "{name} leaves nothing");
    }
}

#[test]
fn the_body_of_a_stranger_is_not_read() {
    let tiny = Tiny::new();
    let site = Site::of(&trained(&tiny), &["--quiet", "--token", "abcd1234"]);
    let mut stream = TcpStream::connect(("127.0.0.1", site.port)).unwrap();
    stream
        .write_all(b"POST /light?name=sky.hdr HTTP/1.1\r\nhost: localhost\r\ncontent-length: 60000000\r\n\r\n")
        .unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    assert!(answer.starts_with("HTTP/1.1 401"), "{answer}");
}

/// Pixels along an edge of the window in which the browser shows the page.
const WINDOW: u32 = 320;
/// Whether a whole picture is shown, and nothing is on the way.
const STILL: &str = "document.getElementById('picture')?.dataset.still === 'true'";
/// Red, green, blue of all that is shown, as text.
const PIXELS: &str = "(() => {
  const canvas = document.getElementById('picture');
  const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  return JSON.stringify([canvas.width, canvas.height, Array.from(data).filter((_, k) => k % 4 < 3)]);
})()";

/// State of a page that no longer changes.
pub(crate) fn shown(page: &Page<'_>) -> RgbImage {
    page.wait(STILL);
    let text = page.eval(PIXELS);
    let (width, height, bytes) = serde_json::from_str(text.as_str().unwrap()).unwrap();
    RgbImage::from_raw(width, height, bytes).unwrap()
}

/// The share of the numbers of two pictures that differ by more than a few steps.
pub(crate) fn share_that_differs(one: &RgbImage, other: &RgbImage) -> f64 {
    assert_eq!(one.dimensions(), other.dimensions(), "the window is the same");
    let differing = one.as_raw().iter().zip(other.as_raw()).filter(|(a, b)| a.abs_diff(**b) > 4).count();
    differing as f64 / one.as_raw().len() as f64
}

fn is_same(one: &RgbImage, other: &RgbImage) -> bool {
    share_that_differs(one, other) == 0.0
}

#[test]
fn a_browser_shows_turns_and_relights_the_scene() {
    let Some(browser) = Browser::start() else {
        assert!(
            std::env::var_os("CI").is_none() || std::env::var_os("SPECULA_BROWSER").is_some(),
            "CI needs a browser: install chromium, or name one in SPECULA_BROWSER"
        );
        return eprintln!("NOT TESTED, because there is no chromium on the path, nor one that SPECULA_BROWSER names");
    };
    let tiny = Tiny::new();
    let model = trained(&tiny);
    let site = Site::of(&model, &["--quiet"]);
    let page = browser.open(&site.url, [WINDOW; 2]);
    let size = format!("{WINDOW},{WINDOW}");
    let first = shown(&page);
    let expected = rendered(&tiny, &model, &["--layers", "rgb", "--size", &size], "rgb/00000.png");
    assert!(is_same(&first, &expected), "the page shows the first view as `render` writes it");

    dragging_turns_it(&page, &first);
    dropping_a_light_changes_it(&page, &first, &sky(&tiny));
    a_light_with_odd_numbers_is_told_of(&page, &odd(&tiny));
    layers_are_chosen_by_key(&page, &tiny, &model);
    a_path_is_saved(&page);
    two_clients_do_not_disturb_each_other(&browser, &page, &site);
    a_phone_shows_it(&browser, &site);
    nothing_is_asked_for_from_outside(&page, &site);
    the_address_says_what_is_shown(&browser, &page, &first);
    a_change_while_a_picture_is_unpacked_is_waited_for(&page, &first);
    a_slow_link_ends_with_the_same(&browser, &site, &first);
    materials_are_told_of_where_there_are_none(&page);
    suns_and_lamps_are_placed_and_dragged(&browser, &tiny);
    the_token_is_needed_and_found(&browser, &model);
}

fn back_to_the_start(page: &Page<'_>) -> RgbImage {
    page.press("r");
    page.press("1");
    shown(page)
}

fn dragging_turns_it(page: &Page<'_>, first: &RgbImage) {
    let count = "Number(document.getElementById('picture').dataset.shown)";
    let before = page.eval(count).as_u64().unwrap();
    page.drag([120.0, 160.0], [180.0, 200.0]);
    let turned = shown(page);
    assert!(share_that_differs(first, &turned) > 0.02, "a drag turns the scene");
    assert!(page.eval(count).as_u64().unwrap() > before + 1, "pictures come while it is dragged");
    assert!(is_same(&back_to_the_start(page), first), "and there is a way back");
}

fn dropping_a_light_changes_it(page: &Page<'_>, first: &RgbImage, sky: &[u8]) {
    page.eval(&dropped(sky, "sky.hdr"));
    page.wait("document.getElementById('lights').value === '4'");
    let relit = shown(page);
    assert!(share_that_differs(first, &relit) > 0.02, "a light that is dropped lights the scene");
    for _ in 0..12 {
        page.press("]");
    }
    let turned = shown(page);
    assert!(share_that_differs(&relit, &turned) > 0.01, "a light can be turned");
    page.eval("(() => { const list = document.getElementById('lights'); list.value = 0; list.dispatchEvent(new Event('change')); })()");
    for _ in 0..12 {
        page.press("[");
    }
    assert!(is_same(&shown(page), first), "and there is a way back");

    page.eval(&dropped(sky, "sky.txt"));
    page.wait("document.getElementById('message').textContent.includes('.hdr or .exr')");
}

/// A light as large as no lat-long map is, with numbers that are no radiance.
fn odd(tiny: &Tiny) -> Vec<u8> {
    let path = tiny.path("odd.exr");
    let mut rgb = vec![2.0; 3 * 16 * 4];
    rgb[..4].copy_from_slice(&[f32::NAN, f32::INFINITY, -1.0, -2.0]);
    latlong::write(&path, &LatLong { width: 16, height: 4, rgb }).unwrap();
    fs::read(path).unwrap()
}

#[test]
fn what_is_odd_about_a_light_is_said_of_the_name_that_was_dropped() {
    let tiny = Tiny::new();
    let site = Site::of(&trained(&tiny), &["--quiet"]);
    let notes = site.post("/light?name=odd.exr", &odd(&tiny)).json()["notes"].clone();
    let notes: Vec<&str> = notes.as_array().unwrap().iter().map(|note| note.as_str().unwrap()).collect();
    assert_eq!(notes[0], "replaced 4 invalid numbers in \"odd.exr\": 1 NaN, 1 infinite, 2 negative");
    assert!(notes.len() == 2 && notes[1].starts_with("\"odd.exr\" has 16 × 4 pixels"), "{notes:?}");
}

fn a_light_with_odd_numbers_is_told_of(page: &Page<'_>, odd: &[u8]) {
    page.eval(&dropped(odd, "odd.exr"));
    page.wait("document.getElementById('message').textContent.includes('replaced 4 invalid numbers in \"odd.exr\"')");
    page.eval("(() => { const list = document.getElementById('lights'); list.value = 0; list.dispatchEvent(new Event('change')); })()");
}

/// A script that drops a file onto the page.
pub(crate) fn dropped(file: &[u8], name: &str) -> String {
    format!(
        "(() => {{
          const files = new DataTransfer();
          files.items.add(new File([new Uint8Array({file:?})], '{name}'));
          window.dispatchEvent(new DragEvent('drop', {{ dataTransfer: files, bubbles: true, cancelable: true }}));
        }})()"
    )
}

fn layers_are_chosen_by_key(page: &Page<'_>, tiny: &Tiny, model: &Path) {
    let size = format!("{WINDOW},{WINDOW}");
    for (key, layer) in [("2", "normal"), ("6", "specular")] {
        page.press(key);
        let expected = rendered(tiny, model, &["--layers", layer, "--size", &size], &format!("{layer}/00000.png"));
        assert!(is_same(&shown(page), &expected), "{layer}");
    }
    page.press("x");
    page.wait("document.getElementById('status').textContent.includes('PSNR')");
    page.press("?");
    page.wait("document.getElementById('help').open");
    page.eval("document.getElementById('help').close()");
    back_to_the_start(page);
}

fn a_path_is_saved(page: &Page<'_>) {
    // Files to be saved are kept in the page instead.
    page.eval(
        "(() => {
          window.saved = {};
          const address = URL.createObjectURL;
          let latest;
          URL.createObjectURL = (blob) => address((latest = blob));
          HTMLAnchorElement.prototype.click = function () {
            window.saved[this.download] = latest.arrayBuffer();
          };
        })()",
    );
    page.press("k");
    page.press("n");
    page.press("k");
    page.eval("document.getElementById('frames').value = 3; document.getElementById('frame-size').value = '24×16'");
    for (button, file) in [("save-frames", "frames.zip"), ("save-path", "path.json")] {
        page.eval(&format!("document.getElementById('{button}').click()"));
        page.wait(&format!("'{file}' in window.saved"));
    }
    let bytes = |file: &str| -> Vec<u8> {
        let list = page.eval(&format!("window.saved['{file}'].then((bytes) => Array.from(new Uint8Array(bytes)))"));
        serde_json::from_value(list).unwrap()
    };
    let zip = bytes("frames.zip");
    let names = ["00000.png", "00001.png", "00002.png"]
        .map(|name| zip.windows(name.len()).filter(|letters| *letters == name.as_bytes()).count());
    assert_eq!(names, [2; 3], "each file, and its line in the directory");
    let png = zip.windows(8).position(|eight| eight == b"\x89PNG\r\n\x1a\n").unwrap();
    assert_eq!(image::load_from_memory(&zip[png..]).unwrap().to_rgb8().dimensions(), (24, 16), "as was asked for");
    let folder = tempfile::tempdir().unwrap();
    let (zipped, cameras) = (folder.path().join("frames.zip"), folder.path().join("path.json"));
    fs::write(&zipped, &zip).unwrap();
    fs::write(&cameras, bytes("path.json")).unwrap();
    let known = specula_io::cameras::read_cameras(&cameras, [1, 1], [0.0; 3]).unwrap();
    assert_eq!((known.len(), known[0].1.width, known[0].1.height), (3, 24, 16), "as `render --cameras` reads them");
    if let Ok(status) = Command::new("python3").args(["-m", "zipfile", "-t"]).arg(&zipped).output() {
        assert!(status.status.success(), "the file is a whole ZIP: {status:?}");
    }
    page.eval("document.getElementById('clear-path').click()");
    back_to_the_start(page);
}

fn two_clients_do_not_disturb_each_other(browser: &Browser, page: &Page<'_>, site: &Site) {
    let before = shown(page);
    let other = browser.open(&site.url, [WINDOW; 2]);
    assert!(is_same(&shown(&other), &before), "both begin with the same");
    other.drag([100.0, 100.0], [160.0, 130.0]);
    let turned = shown(&other);
    assert!(!is_same(&turned, &before), "one has turned");
    assert!(is_same(&shown(page), &before), "the other has not");
    // One goes away in the middle of a drag.
    other.eval(
        "document.dispatchEvent(new Event('x')); window.dispatchEvent(new KeyboardEvent('keydown', { key: 'a' }))",
    );
    other.close();
    page.drag([120.0, 160.0], [200.0, 160.0]);
    assert!(!is_same(&shown(page), &before), "the one that stays is served as before");
    back_to_the_start(page);
}

fn a_phone_shows_it(browser: &Browser, site: &Site) {
    let page = browser.open("about:blank", [390, 844]);
    page.resize([390, 844], true);
    page.go(&site.url);
    page.wait(STILL);
    let before = shown(&page);
    assert_eq!(before.dimensions(), (390, 844), "the picture fills the screen");
    assert_eq!(page.eval("document.documentElement.scrollWidth"), 390, "nothing sticks out");
    assert_eq!(page.eval("document.getElementById('panel').hidden"), true, "the picture comes first");
    page.swipe([120.0, 400.0], [220.0, 440.0]);
    page.wait("document.getElementById('views').value === ''");
    assert!(share_that_differs(&before, &shown(&page)) > 0.01, "a finger turns it");
    page.resize([844, 390], true);
    page.eval("document.getElementById('show-panel').click()");
    page.wait("document.getElementById('picture').clientHeight === innerHeight");
    let edge = "document.getElementById('panel').getBoundingClientRect().left - document.getElementById('picture').clientWidth";
    assert!(page.eval(edge).as_f64().unwrap() >= 0.0, "on its side the panel is beside the picture");
    page.close();
}

fn nothing_is_asked_for_from_outside(page: &Page<'_>, site: &Site) {
    let names = page.eval("performance.getEntriesByType('resource').map((entry) => entry.name)");
    let names: Vec<String> = serde_json::from_value(names).unwrap();
    let own = site.url.trim_end_matches('/');
    let is_own = |name: &&String| name.starts_with(own) || name.starts_with("blob:") || name.starts_with("data:");
    assert!(!names.is_empty() && names.iter().all(|name| is_own(&name)), "{names:?}");
}

fn the_address_says_what_is_shown(browser: &Browser, page: &Page<'_>, first: &RgbImage) {
    page.drag([120.0, 160.0], [180.0, 200.0]);
    page.press("2");
    let turned = shown(page);
    page.wait("location.hash.includes('eye=') && location.hash.includes('layer=normal')");
    let copied = page.eval("location.href");
    let other = browser.open(copied.as_str().unwrap(), [WINDOW; 2]);
    assert!(is_same(&shown(&other), &turned), "whoever opens it sees the same");
    other.close();
    page.press("1");
    page.press("u");
    assert!(is_same(&shown(page), first), "a drag is taken back");
}

fn a_slow_link_ends_with_the_same(browser: &Browser, site: &Site, first: &RgbImage) {
    let page = browser.open("about:blank", [WINDOW; 2]);
    page.slow_down(150, 100_000);
    page.go(&site.url);
    page.wait(STILL);
    page.drag([120.0, 160.0], [180.0, 200.0]);
    shown(&page);
    page.press("u");
    assert!(is_same(&shown(&page), first), "at rest the picture is lossless");
    let drafts = "performance.getEntriesByType('resource').some((entry) => entry.name.includes('quality=92'))";
    assert_eq!(page.eval(drafts), true, "a compressed draft came before it");
    page.close();
}

fn a_change_while_a_picture_is_unpacked_is_waited_for(page: &Page<'_>, first: &RgbImage) {
    page.drag([120.0, 160.0], [180.0, 200.0]);
    shown(page);
    // The first picture that comes is out of date as soon as it is unpacked, and the next one takes
    // its time.
    page.eval(
        "(() => {
          const unpack = window.createImageBitmap;
          const press = new KeyboardEvent('keydown', { key: 'u', bubbles: true });
          window.createImageBitmap = async (blob) => {
            window.createImageBitmap = async (next) => {
              window.createImageBitmap = unpack;
              await new Promise((resume) => setTimeout(resume, 500));
              return unpack(next);
            };
            const picture = await unpack(blob);
            document.body.dispatchEvent(press);
            return picture;
          };
        })()",
    );
    page.press("1");
    assert!(is_same(&shown(page), first), "what is out of date does not count as shown");
}

fn materials_are_told_of_where_there_are_none(page: &Page<'_>) {
    let is_shown = |id: &str| page.eval(&format!("!document.getElementById('{id}').hidden"));
    let shown = ["no-lamps", "lamps-of-materials", "colors"].map(is_shown);
    assert_eq!(shown, [true, false, false], "a sentence takes the place of lamps");
}

/// Pixels of a window with a panel beside the picture.
const WIDE: [u32; 2] = [900, 640];

fn suns_and_lamps_are_placed_and_dragged(browser: &Browser, tiny: &Tiny) {
    let model = relightable(tiny);
    let site = Site::of(&model, &["--quiet"]);
    let page = browser.open(&site.url, WIDE);
    let first = shown(&page);
    let click = |id: &str| drop(page.eval(&format!("document.getElementById('{id}').click()")));
    let centre = |selector: &str| -> [f64; 2] {
        let rect = format!("document.querySelector('{selector}').getBoundingClientRect()");
        let centre = page.eval(&format!("(({{ x, y, width, height }}) => [x + width / 2, y + height / 2])({rect})"));
        serde_json::from_value(centre).unwrap()
    };
    let address = || page.eval("location.hash").as_str().unwrap().to_owned();

    click("add-sun");
    let sunny = shown(&page);
    assert!(share_that_differs(&first, &sunny) > 0.02, "a sun shines");
    page.wait("location.hash.includes('suns=')");
    let suns = address().split(['#', '&']).find(|part| part.starts_with("suns=")).unwrap().to_owned();
    let size = format!("{},{}", sunny.width(), sunny.height());
    let asked = site.get(&format!("/frame?view=0&size={size}&stops=-1&{suns}")).picture();
    let [left, above] = [sunny.width() - asked.width(), sunny.height() - asked.height()].map(|edge| edge / 2);
    let inside = image::imageops::crop_imm(&sunny, left, above, asked.width(), asked.height()).to_image();
    assert!(is_same(&inside, &asked), "at rest it has all shadow rays");
    let other = browser.open(page.eval("location.href").as_str().unwrap(), WIDE);
    assert!(is_same(&shown(&other), &sunny), "whoever opens the address sees the same");
    other.close();

    page.eval("document.getElementById('dial').scrollIntoView({ block: 'center' })");
    let from = centre("#suns-of-dial circle");
    page.drag(from, [from[0] + 40.0, from[1] - 20.0]);
    let moved = shown(&page);
    assert!(share_that_differs(&sunny, &moved) > 0.01, "the sun is dragged on its dial");
    page.wait(&format!("!location.hash.includes('{suns}')"));
    let is_preview = "performance.getEntriesByType('resource').some((entry) => entry.name.includes('rays=4'))";
    assert_eq!(page.eval(is_preview), true, "with few rays meanwhile");

    click("add-lamp");
    let lit = shown(&page);
    assert!(share_that_differs(&moved, &lit) > 0.01, "a lamp shines");
    page.wait("location.hash.includes('lamps=')");
    let before = address();
    let from = centre("#handles button");
    let to = [from[0] - 60.0, from[1] + 30.0];
    page.drag(from, to);
    assert!(share_that_differs(&lit, &shown(&page)) > 0.005, "the lamp is dragged on the picture");
    let at = centre("#handles button");
    assert!((0..2).all(|k| (at[k] - to[k]).abs() < 1.5), "its handle is under the pointer: {at:?} rather than {to:?}");
    page.wait(&format!("location.hash !== '{before}'"));

    page.eval(KEEP_DOWNLOAD);
    page.eval("(() => { const list = document.getElementById('lights'); list.value = 'none'; list.dispatchEvent(new Event('change')); })()");
    let in_darkness = shown(&page);
    click("save-lights");
    let file = tiny.path("lights.toml");
    fs::write(&file, page.eval("window.latest.text()").as_str().unwrap()).unwrap();
    page.wait("location.hash.includes('light=none')");
    let again = Site::of(&model, &["--quiet", "--lights", file.to_str().unwrap()]);
    let other = browser.open(&again.url, WIDE);
    assert!(is_same(&shown(&other), &in_darkness), "the file says the same");
    other.close();
    let mut relight = specula();
    relight.arg("relight").arg(&model).arg("--lights").arg(&file).args(["--executor", "cpu", "--quiet", "-o"]);
    relight.arg(tiny.path("relit")).assert().success();

    page.eval("(() => { const list = document.getElementById('lights'); list.value = 0; list.dispatchEvent(new Event('change')); })()");
    page.eval("document.querySelectorAll('#lamps [aria-label^=Remove]')[0].click()");
    page.eval("document.querySelectorAll('#lamps [aria-label^=Remove]')[0].click()");
    assert!(is_same(&shown(&page), &first), "without them it is as before");
    page.eval("document.querySelector('[data-shading=physical]').click()");
    let materials = shown(&page);
    assert!(!is_same(&materials, &first), "materials can be seen under the training's light");
    page.wait("location.hash.includes('shading=physical') && !location.hash.includes('suns')");
    page.eval("document.querySelector('[data-shading=view]').click()");
    assert!(is_same(&shown(&page), &first), "and view-dependent colours again");
    page.close();
    ground_is_ticked(browser, &site);
}

/// Keeps files that the page saves in `window.latest`.
const KEEP_DOWNLOAD: &str = "(() => {
  const address = URL.createObjectURL;
  URL.createObjectURL = (blob) => address((window.latest = blob));
  HTMLAnchorElement.prototype.click = () => {};
})()";

/// In a small window, where the ground of a picture costs little.
fn ground_is_ticked(browser: &Browser, site: &Site) {
    let page = browser.open(&site.url, [WINDOW; 2]);
    shown(&page);
    page.eval(KEEP_DOWNLOAD);
    let click = |id: &str| drop(page.eval(&format!("document.getElementById('{id}').click()")));
    let copied = || {
        page.eval("window.command = ''; navigator.clipboard.writeText = async (text) => { window.command = text; }");
        click("copy-command");
        page.wait("window.command !== ''");
        page.eval("window.command").as_str().unwrap().to_owned()
    };
    assert!(!copied().contains("--ground"), "there is no ground yet");
    click("ground");
    shown(&page);
    page.wait("location.hash.includes('ground=on')");
    assert!(copied().contains(" --ground"), "{}", copied());
    click("save-lights");
    page.wait("window.latest !== undefined");
    let saved = page.eval("window.latest.text()").as_str().unwrap().to_owned();
    assert!(saved.contains("ground = true"), "{saved}");
    page.close();
}

fn the_token_is_needed_and_found(browser: &Browser, model: &Path) {
    let site = Site::of(model, &["--quiet", "--token", "abcd1234"]);
    let page = browser.open(&site.url, [WINDOW; 2]);
    page.wait(STILL);
    assert_eq!(page.eval("location.href.includes('abcd1234')"), false, "a copied address does not hold it");
    page.eval("location.reload()");
    page.wait(STILL);
    let without = browser.open(site.url.split('#').next().unwrap(), [WINDOW; 2]);
    without.wait("document.getElementById('message')?.textContent.includes('token') === true");
}
