//! Trainings whose light is a network, through the commands that read their models.

use crate::tiny::{Tiny, specula, train_by_default};
use serde_json::Value;
use specula_io::{
    latlong::{self, LatLong},
    model_folder::{light_at, network_at},
};
use std::{fs, path::Path};

fn printed(command: &mut assert_cmd::Command) -> String {
    String::from_utf8(command.assert().success().get_output().stdout.clone()).unwrap()
}

fn refusal(command: &mut assert_cmd::Command) -> String {
    let output = command.assert().code(2).get_output().clone();
    String::from_utf8(output.stderr).unwrap()
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

fn trained(tiny: &Tiny, name: &str, words: &[&str]) -> std::path::PathBuf {
    let mut command = train_by_default(tiny, name);
    command.args(["--light", "mlp", "--eval", "--executor", "cpu"]).args(words).assert().success();
    tiny.path(name)
}

#[test]
fn a_light_that_is_a_network_is_trained_measured_rendered_relit_and_exported() {
    let tiny = Tiny::new();
    for profile in ["specula", "paper"] {
        let model = trained(&tiny, profile, &["--profile", profile]);
        assert!(fs::read_to_string(model.join("config.toml")).unwrap().contains("light = \"mlp\""));
        assert!(network_at(&model, 30).is_file() && light_at(&model, 30).is_file());

        let measured = json(&model.join("results.json"))["ours_30"]["PSNR"].as_f64().unwrap();
        let evaluated = printed(specula().arg("eval").arg(&model).args(["--json", "--executor", "cpu"]));
        let evaluated: Value = serde_json::from_str(&evaluated).unwrap();
        assert!((evaluated["PSNR"].as_f64().unwrap() - measured).abs() < 1e-3, "{measured} dB, then {evaluated}");

        let mut render = specula();
        render.arg("render").arg(&model).args(["--executor", "cpu", "--layers", "rgb,light", "--verify-omissions"]);
        printed(&mut render);
        let picture = model.join("test/ours_30/renders/00000.png");
        let under_its_own = fs::read(&picture).unwrap();

        let info: Value = serde_json::from_str(&printed(specula().arg("info").arg(&model).arg("--json"))).unwrap();
        assert_eq!((&info["light"]["weights"], &info["light"]["resolution"]), (&6595.into(), &16.into()));

        let sky = tiny.path("sky.hdr");
        latlong::write(&sky, &LatLong { width: 8, height: 4, rgb: vec![0.7; 96] }).unwrap();
        printed(specula().arg("relight").arg(&model).arg("--env").arg(&sky).args(["--executor", "cpu"]));
        let relit = fs::read(model.join("relight/sky/ours_30/renders/00000.png")).unwrap();
        assert!(relit != under_its_own, "another light is another picture");

        let map = tiny.path(&format!("{profile}.hdr"));
        printed(specula().arg("export").arg(&model).arg("-o").arg(&map));
        assert!(latlong::read(&map).unwrap().0.rgb.iter().all(|x| x.is_finite() && *x > 0.0));
    }
}

#[test]
fn a_network_is_not_replaced_by_its_texels_unnoticed() {
    let tiny = Tiny::new();
    let model = trained(&tiny, "model", &[]);
    let exact = light_at(&model, 30);
    let other = trained(&tiny, "other", &["--seed", "7"]);
    fs::copy(light_at(&other, 30), &exact).unwrap();
    fs::remove_file(model.join("brdf_mlp/iteration_30/brdf_mlp.hdr")).unwrap();
    let sentence = refusal(specula().arg("render").arg(&model));
    assert!(sentence.contains("network.safetensors") && sentence.contains("another light"), "{sentence}");
}

#[test]
fn a_light_that_cannot_be_a_network_is_refused() {
    let tiny = Tiny::new();
    for (words, said) in [
        (&["--profile", "3dgs"][..], "has no light"),
        (&["--profile", "official", "--light-resolution", "64"], "--profile paper or specula"),
        (&["--light-resolution", "256"], "up to 128"),
    ] {
        let mut command = specula();
        command.arg("train").arg(tiny.data()).arg("-m").arg(tiny.path("model")).args(["--light", "mlp"]).args(words);
        let sentence = refusal(&mut command);
        assert!(sentence.contains(said), "{said:?} is not in: {sentence}");
        assert!(!tiny.path("model").exists(), "nothing was written");
    }
}
