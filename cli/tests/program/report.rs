//! `report`, and `render --max-error`, on a scene of a few pixels.

use crate::tiny::{Tiny, specula, train, train_relightable};
use serde_json::Value;
use std::fs;

fn printed(command: &mut assert_cmd::Command) -> String {
    String::from_utf8(command.assert().success().get_output().stdout.clone()).unwrap()
}

/// The arguments of a report that takes a second.
fn report(tiny: &Tiny, model: &str) -> assert_cmd::Command {
    let mut command = specula();
    command.arg("report").arg(tiny.path(model)).arg("-o").arg(tiny.path("report"));
    command.args(["--views", "2", "--size", "24", "--repeats", "2", "--no-stability", "--quiet"]);
    command
}

#[test]
fn a_report_has_a_table_a_page_and_every_number() {
    let tiny = Tiny::new();
    printed(&mut train(&tiny, "model"));
    let table = printed(&mut report(&tiny, "model"));
    assert!(table.starts_with("| at least | PSNR |") && table.contains("| default |"), "{table}");

    let lines = fs::read_to_string(tiny.path("report/report.jsonl")).unwrap();
    let records: Vec<Value> = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(
        (&records[0]["kind"], &records[0]["views"], &records[0]["gaussians"]),
        (&"scene".into(), &2.into(), &200.into())
    );
    let settings: Vec<&Value> = records.iter().filter(|record| record["kind"] == "setting").collect();
    for parameter in ["storage", "harmonics", "least alpha", "least transmittance", "extent", "light per", "channels"] {
        assert!(settings.iter().any(|setting| setting["turned"] == parameter), "{parameter} was not varied");
    }
    assert_eq!(settings.iter().filter(|setting| setting["is_usual"] == true).count(), 1);
    for setting in &settings {
        let number = |group: &str, name: &str| setting[group][name].as_f64().unwrap();
        assert!(number("error", "rms") <= number("error", "max") && number("error", "nonfinite") == 0.0, "{setting}");
        assert!(number("work", "pairs") > 0.0 && setting["milliseconds"]["picture"]["min"].as_f64().unwrap() > 0.0);
    }
    let error_of = |least: &str| {
        let of = |setting: &&&Value| setting["turned"] == "least alpha" && setting["knobs"]["least alpha"] == least;
        settings.iter().find(of).unwrap()["error"]["rms"].as_f64().unwrap()
    };
    assert!(error_of("0") < error_of("1/255") && error_of("1/255") < error_of("1/16"));

    let page = fs::read_to_string(tiny.path("report/index.html")).unwrap();
    assert!(page.matches("<svg").count() >= 8, "there is a plot for each parameter");
    assert!(!page.contains("src=") && page.matches("http").count() == page.matches("http://www.w3.org").count());
}

/// A training of two steps with another profile than the default.
fn train_with(tiny: &Tiny, profile: &str) -> assert_cmd::Command {
    let mut command = specula();
    command.arg("train").arg(tiny.path("data")).arg("-m").arg(tiny.path("model")).args(["--profile", profile]);
    command.args(["--iterations", "2", "--random-points", "200"]);
    command
}

#[test]
fn a_plain_scene_has_a_report_as_well() {
    let tiny = Tiny::new();
    printed(&mut train_with(&tiny, "3dgs"));
    assert!(printed(&mut report(&tiny, "model")).contains("| default |"));
}

#[test]
fn shadow_rays_of_a_sun_are_measured_on_physical_materials() {
    let tiny = Tiny::new();
    printed(&mut train_relightable(&tiny, "model"));
    let tables = printed(&mut report(&tiny, "model"));
    let (cheapest, suns) = tables.split_once("\n\n").expect("two tables");
    assert!(cheapest.starts_with("| at least |") && suns.starts_with("| shadows |"), "{tables}");
    assert!(suns.contains("32 rays (default)") && suns.contains("no shadows"), "{suns}");
    let lines = fs::read_to_string(tiny.path("report/report.jsonl")).unwrap();
    let records = lines.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    let suns: Vec<Value> = records.filter(|record| record["kind"] == "sun").collect();
    let error = |rays: Option<u64>, is_reflected: bool| {
        let of = |sun: &&Value| sun["rays"].as_u64() == rays && sun["is_reflected"] == is_reflected;
        suns.iter().find(of).unwrap()["error"]["rms"].as_f64().unwrap()
    };
    assert_eq!(error(Some(1024), true), 0.0, "the reference itself");
    assert!(error(Some(128), true) <= error(Some(8), true), "more rays are closer: {suns:?}");
    assert!(error(None, false) > error(Some(32), true), "shadows are seen: {suns:?}");
    assert!(fs::read_to_string(tiny.path("report/index.html")).unwrap().contains("<h2>Suns</h2>"));
}

#[test]
fn the_authors_shading_has_no_exact_pictures() {
    let tiny = Tiny::new();
    printed(train_with(&tiny, "official").args(["--light-resolution", "64"]));
    let output = report(&tiny, "model").assert().code(2).get_output().clone();
    let words = String::from_utf8(output.stderr).unwrap();
    assert!(words.contains("no exact pictures") && words.lines().count() == 1, "{words}");
}

#[test]
fn pictures_within_an_error_come_with_a_certificate() {
    let tiny = Tiny::new();
    printed(&mut train(&tiny, "model"));
    let render = |error: &str| {
        let mut command = specula();
        command.arg("render").arg(tiny.path("model")).args(["--layers", "rgb", "--max-error", error, "--quiet"]);
        command.arg("-o").arg(tiny.path("pictures"));
        command
    };
    let said = printed(&mut render("0.02"));
    let certificate = said.lines().nth(1).unwrap();
    let measured: f64 = certificate.split_whitespace().nth(1).unwrap().parse().unwrap();
    assert!(certificate.starts_with("error ") && measured <= 0.02, "{certificate}");
    let verified = said.lines().nth(2).unwrap();
    assert!(verified.starts_with("verified ") && verified.contains("errors are at most 2e-2"), "{verified}");
    assert!(tiny.path("pictures/rgb/00002.png").is_file(), "pictures are missing");
    let trusted = printed(render("0.02").arg("--no-verify"));
    assert!(trusted.lines().nth(1) == Some(certificate) && trusted.contains("not verified"), "{trusted}");
    assert_eq!(said, printed(render("0.02").args(["--threads", "1"])), "the choice does not depend on threads");

    let sorted = printed(render("0.02").args(["--order", "pixel"]));
    assert!(sorted.contains("errors are at most 2e-2"), "{sorted}");

    let refused = render("1e-9").assert().code(2).get_output().clone();
    let words = String::from_utf8(refused.stderr).unwrap();
    assert!(words.contains("cannot be guaranteed") && words.contains("use --max-error "), "{words}");
    render("0").assert().code(2);
    specula().arg("render").arg(tiny.path("model")).arg("--no-verify").assert().code(2);
}

#[test]
fn a_training_ends_with_a_certificate_and_the_same_model() {
    let tiny = Tiny::new();
    printed(&mut train(&tiny, "default"));
    let said = printed(train(&tiny, "within").args(["--max-error", "0.02"]));
    assert!(said.starts_with("error "), "{said}");
    let info = fs::read_to_string(tiny.path("within/specula.json")).unwrap();
    assert!(info.contains("\"certificate\": \"error "), "{info}");
    let [default, within] = ["default", "within"].map(|model| {
        let place = format!("{model}/point_cloud");
        let saved = fs::read_dir(tiny.path(&place)).unwrap().next().unwrap().unwrap().path();
        fs::read(saved.join("point_cloud.ply")).unwrap()
    });
    assert!(default == within, "looking for a setting changes no training");

    let said = printed(train(&tiny, "too close").args(["--max-error", "1e-9"]));
    assert!(!said.contains("error "), "an error that cannot be guaranteed is only a note: {said}");
}
