//! Output of `compare` for runs with known files.

use crate::tiny::specula;
use serde_json::{Value, json};
use std::{fs, path::PathBuf};
use tempfile::TempDir;

/// A folder with runs that nobody trained.
struct Runs(TempDir);

/// Description of a run in `specula.json`.
struct Said {
    name: &'static str,
    scene: &'static str,
    profile: &'static str,
    /// PSNR, SSIM, FLIP and the normals' error.
    measures: Value,
    size: u32,
    background: [f32; 3],
    config: &'static str,
    iterations: u32,
    /// The folder of the data set's folder.
    data: &'static str,
    /// Views that the training held out.
    test_views: u32,
}

const SAID: Said = Said {
    name: "run",
    scene: "chair",
    profile: "specula",
    measures: Value::Null,
    size: 400,
    background: [1.0; 3],
    config: "",
    iterations: 7000,
    data: "/data",
    test_views: 2,
};

impl Runs {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn add(&self, said: &Said) -> PathBuf {
        let folder = self.0.path().join(said.name);
        let place = folder.join(format!("point_cloud/iteration_{}", said.iterations));
        fs::create_dir_all(&place).unwrap();
        let ply =
            format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\nend_header\n", 1200 + said.name.len());
        fs::write(place.join("point_cloud.ply"), ply + &" ".repeat(2_000_000)).unwrap();
        let write = |name: &str, value: Value| fs::write(folder.join(name), value.to_string()).unwrap();
        write(
            "specula.json",
            json!({
                "profile": said.profile, "shading": if said.profile == "3dgs" { "radiance" } else { "deferred" }, "iterations": said.iterations,
                "source_path": format!("{}/{}", said.data, said.scene), "train_views": 1,
                "seconds": 100.0 + said.name.len() as f64, "test_views": said.test_views, "background": said.background,
            }),
        );
        let camera = |name: &str| {
            json!({
                "id": 0, "img_name": name, "width": said.size, "height": said.size, "position": [4.0, 0.0, 0.0],
                "rotation": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], "fx": 500.0, "fy": 500.0,
            })
        };
        write("cameras.json", json!([camera("r_0"), camera("r_1"), camera("r_9")]));
        fs::write(folder.join("config.toml"), said.config).unwrap();
        if !said.measures.is_null() {
            // An earlier iteration and another setting, which do not count.
            let worse = json!({"PSNR": 10.0});
            write(
                "results.json",
                json!({method(said.iterations): said.measures, "ours_500": worse, "ours_7000_f16": worse}),
            );
            let views = json!({"PSNR": {"00000.png": 30.0, "00001.png": 31.0}});
            write("per_view.json", json!({method(said.iterations): views}));
        }
        folder
    }
}

fn method(iterations: u32) -> String {
    format!("ours_{iterations}")
}

/// Standard output and standard error.
fn compared(folders: &[PathBuf], words: &[&str]) -> (String, String) {
    let output = specula().arg("compare").args(folders).args(words).assert().success().get_output().clone();
    (String::from_utf8(output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap())
}

#[test]
fn runs_of_one_scene_are_rows_and_the_best_is_bold() {
    let runs = Runs::new();
    let measures = json!({"PSNR": 35.96, "SSIM": 0.9871, "FLIP": 0.03, "MAE": 12.0});
    let plain = runs.add(&Said { name: "plain", profile: "3dgs", measures, ..SAID });
    let measures = json!({"PSNR": 35.86, "SSIM": 0.98712, "FLIP": 0.02, "MAE": 4.5});
    let ours = runs.add(&Said { name: "ours", measures, ..SAID });
    let (table, said) = compared(&[plain.clone(), ours.clone()], &[]);
    let expected = "\
| chair | PSNR dB ↑ | SSIM ↑ | FLIP ↓ | normal MAE ° ↓ | Gaussians | training s | size MB |
| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |
| 3dgs | **35.96** | **0.9871** | 0.0300 | 12.00 | 1 205 | 105 | 2.0 |
| specula | 35.86 | **0.9871** | **0.0200** | **4.50** | 1 204 | 104 | 2.0 |
";
    assert_eq!(table, expected);
    assert_eq!(said, "", "nothing is missing and nothing speaks against it");

    let file = runs.0.path().join("table.tex");
    compared(&[plain, ours], &["-o", file.to_str().unwrap()]);
    let expected = r"% \usepackage{booktabs}
\begin{tabular}{lrrrrrrr}
\toprule
chair & PSNR dB $\uparrow$ & SSIM $\uparrow$ & FLIP $\downarrow$ & normal MAE $^\circ$ $\downarrow$ & Gaussians & training s & size MB \\
\midrule
3dgs & \textbf{35.96} & \textbf{0.9871} & 0.0300 & 12.00 & 1\,205 & 105 & 2.0 \\
specula & 35.86 & \textbf{0.9871} & \textbf{0.0200} & \textbf{4.50} & 1\,204 & 104 & 2.0 \\
\bottomrule
\end{tabular}
";
    assert_eq!(fs::read_to_string(file).unwrap(), expected);
}

#[test]
fn several_scenes_are_columns_with_their_mean() {
    let runs = Runs::new();
    let add = |name, scene, profile, psnr: f64| {
        // Only one run of each scene has the SSIM.
        let measures = if profile == "3dgs" { json!({"PSNR": psnr, "SSIM": 0.5}) } else { json!({"PSNR": psnr}) };
        runs.add(&Said { name, scene, profile, measures, ..SAID })
    };
    let folders = [
        add("a", "chair", "3dgs", 30.0),
        add("b", "drums, loud", "3dgs", 20.0),
        add("c", "chair", "specula", 29.0),
        add("d", "drums, loud", "specula", 24.0),
        add("e", "chair", "paper", 33.5),
    ];
    let (table, _) = compared(&folders, &[]);
    let expected = "\
PSNR dB ↑

| method | chair | drums, loud | mean |
| --- | ---: | ---: | ---: |
| 3dgs | 30.00 | 20.00 | 25.00 |
| specula | 29.00 | **24.00** | **26.50** |
| paper | **33.50** | – | – |

Gaussians

";
    assert!(table.starts_with(expected), "{table}");
    let (csv, _) = compared(&folders, &["--format", "csv"]);
    let expected = "\
quantity,method,chair,\"drums, loud\",mean
PSNR dB,3dgs,30,20,25
PSNR dB,specula,29,24,26.5
PSNR dB,paper,33.5,,
SSIM,3dgs,0.5,0.5,0.5
";
    assert!(csv.starts_with(expected), "{csv}");
    let (latex, _) = compared(&folders, &["--format", "latex"]);
    assert!(latex.contains("\\multicolumn{4}{l}{PSNR dB $\\uparrow$} \\\\\n3dgs & 30.00"), "{latex}");
    assert!(latex.contains("paper & \\textbf{33.50} & -- & -- \\\\\n\\midrule\n"), "{latex}");
}

#[test]
fn rows_are_called_by_what_differs() {
    let runs = Runs::new();
    let add = |name, config| runs.add(&Said { name, config, measures: json!({"PSNR": 30.0}), ..SAID });
    let folders = [
        add("whole", "seed = 0\nno-sparse = false\niterations = 7000\nexecutor = \"cpu\""),
        add("less", "seed = 0\nno-sparse = true\niterations = 7000\nexecutor = \"gpu\"\nlambda-normal = 0.1"),
    ];
    let (table, _) = compared(&folders, &[]);
    assert!(
        table.contains("\n| specula | ") && table.contains("\n| specula, lambda-normal 0.1, no-sparse | "),
        "{table}"
    );
    let same = [add("one", ""), add("two", "")];
    let (table, _) = compared(&same, &[]);
    assert!(table.contains(&format!("\n| {} | ", same[1].display())), "where nothing else tells, folders do: {table}");
}

#[test]
fn what_is_missing_is_told_with_its_command() {
    let runs = Runs::new();
    let ours = runs.add(&Said { name: "ours", measures: json!({"PSNR": 30.0, "LPIPS": 0.1, "MAE": 5.0}), ..SAID });
    let plain = runs.add(&Said { name: "plain", profile: "3dgs", measures: json!({"PSNR": 31.0}), ..SAID });
    let drums = runs.add(&Said { name: "drums", scene: "drums", measures: json!({"PSNR": 31.0}), ..SAID });
    let (table, said) = compared(&[ours, plain.clone()], &[]);
    assert!(table.contains("\n| 3dgs | **31.00** | – | – |"), "{table}");
    let plain_words = plain.display();
    assert!(said.contains(&format!("{plain_words} has no LPIPS; run specula eval {plain_words} --lpips")), "{said}");
    assert!(said.contains(&format!("{plain_words} has no normal MAE; run specula eval {plain_words}\n")), "{said}");
    let (_, said) = compared(&[runs.0.path().join("ours"), drums], &[]);
    assert!(!said.contains("normal MAE"), "of another scene no normals may be known: {said}");

    let measures = json!({"PSNR": 31.0, "relit_PSNR": 20.0, "relit_PSNR_scaled": 21.0});
    let relit = runs.add(&Said { name: "relit", profile: "official", measures, ..SAID });
    let (_, said) = compared(&[runs.0.path().join("ours"), runs.0.path().join("plain"), relit], &[]);
    assert_eq!(said.matches("has no relit PSNR").count(), 1, "what is not shaded cannot be relit: {said}");

    let untried = runs.add(&Said { name: "untried", ..SAID });
    let refused = specula().arg("compare").arg(&untried).assert().code(2).get_output().clone();
    let words = String::from_utf8(refused.stderr).unwrap();
    assert!(words.contains("specula eval ") && words.lines().count() == 1, "{words}");
    let refused = specula().arg("compare").arg(runs.0.path()).assert().code(2).get_output().clone();
    assert!(String::from_utf8(refused.stderr).unwrap().contains("contains some: specula compare "));
}

#[test]
fn materials_light_and_all_protocols_of_relighting_have_columns() {
    let runs = Runs::new();
    let measures = json!({
        "PSNR": 30.0, "albedo_PSNR": 20.0, "roughness_error": 0.1, "metalness_error": 0.2, "relit_PSNR": 21.0,
        "relit_PSNR_scaled": 22.0, "relit_PSNR_albedo_scaled": 23.0, "relit_PSNR_view_scaled": 24.0,
        "light_correlation": 0.8126, "light_scale": 1.5,
    });
    let config = "relightable = true\n";
    let ours = runs.add(&Said { name: "ours", measures, config, ..SAID });
    let other = runs.add(&Said { name: "other", profile: "paper", measures: json!({"PSNR": 31.0}), config, ..SAID });
    let plain = runs.add(&Said { name: "plain", profile: "3dgs", measures: json!({"PSNR": 31.0}), ..SAID });
    let (table, said) = compared(&[ours, other, plain], &[]);
    let heads = [
        "PSNR dB ↑",
        "albedo PSNR dB ↑",
        "roughness error ↓",
        "metalness error ↓",
        "relit PSNR dB ↑",
        "relit PSNR, scaled dB ↑",
        "relit PSNR, albedo scaled dB ↑",
        "relit PSNR, views scaled dB ↑",
        "light correlation ↑",
        "light scale",
        "Gaussians",
    ];
    assert!(table.contains(&heads.join(" | ")), "{table}");
    let row = "| 30.00 | 20.00 | 0.100 | 0.200 | 21.00 | 22.00 | 23.00 | 24.00 | 0.813 | 1.500 |";
    assert!(table.contains(row), "{table}");
    for (measure, count) in [("albedo PSNR", 1), ("light correlation", 1), ("roughness error", 0), ("light scale", 0)] {
        assert_eq!(said.matches(&format!("has no {measure}")).count(), count, "{measure}: {said}");
    }
}

#[test]
fn runs_that_were_measured_otherwise_are_not_held_against_one_another() {
    let runs = Runs::new();
    let measures = || json!({"PSNR": 30.0});
    let one = runs.add(&Said { name: "one", measures: measures(), ..SAID });
    for (other, words) in [
        (Said { name: "large", size: 800, ..SAID }, ["on views of 400 × 400 pixels", "800 × 800"]),
        (Said { name: "black", background: [0.0; 3], ..SAID }, ["over 1,1,1", "over 0,0,0"]),
    ] {
        let other = runs.add(&Said { profile: "3dgs", measures: json!({"PSNR": 31.0}), ..other });
        let (table, said) = compared(&[one.clone(), other], &[]);
        for text in [&table, &said] {
            assert!(text.contains("not comparable: ") && words.iter().all(|word| text.contains(word)), "{text}");
        }
        assert!(!table.contains("**"), "{table}");
    }
    let fewer = runs.add(&Said { name: "fewer", profile: "3dgs", measures: measures(), ..SAID });
    fs::write(fewer.join("per_view.json"), json!({"ours_7000": {"PSNR": {"00000.png": 30.0}}}).to_string()).unwrap();
    assert!(compared(&[one, fewer], &[]).0.contains("on 2 views, but "));
}

#[test]
fn unequal_trainings_say_so_and_none_is_bold() {
    let runs = Runs::new();
    let one = runs.add(&Said { name: "one", iterations: 2000, measures: json!({"PSNR": 30.0}), ..SAID });
    let measures = json!({"PSNR": 28.0});
    let short = runs.add(&Said { name: "short", profile: "3dgs", iterations: 1000, measures, ..SAID });
    let (table, said) = compared(&[one.clone(), short.clone()], &[]);
    let expected = "\
| chair | PSNR dB ↑ | iterations | Gaussians | training s | size MB |
| --- | ---: | ---: | ---: | ---: | ---: |
| specula | 30.00 | 2 000 | 1 203 | 103 | 2.0 |
| 3dgs | 28.00 | 1 000 | 1 205 | 105 | 2.0 |
";
    assert!(table.starts_with(expected), "{table}");
    let words = format!(
        "not comparable: {} was trained for 2000 iterations, but {} for 1000 iterations",
        one.display(),
        short.display()
    );
    assert!(table.contains(&words) && said.contains(&words), "{table}{said}");
    let (csv, said) = compared(&[one.clone(), short.clone()], &["--format", "csv"]);
    assert!(csv.contains("chair,PSNR dB,iterations,") && csv.contains("specula,30,2000,"), "{csv}");
    assert!(said.contains(&words), "{said}");
    let (latex, _) = compared(&[one.clone(), short], &["--format", "latex"]);
    assert!(latex.contains(&words) && !latex.contains("textbf"), "{latex}");

    let measures = json!({"PSNR": 31.0});
    let other = runs.add(&Said { name: "other", profile: "3dgs", iterations: 2000, data: "/old", measures, ..SAID });
    let (table, _) = compared(&[one, other], &[]);
    assert!(table.contains("trained on /data/chair, but ") && table.contains("on /old/chair"), "{table}");
    assert!(!table.contains("**") && !table.contains("iterations"), "{table}");
}

#[test]
fn figures_of_views_that_were_trained_on_say_so_and_none_is_bold() {
    let runs = Runs::new();
    let run = |name, profile, psnr: f64, test_views| {
        runs.add(&Said { name, profile, measures: json!({"PSNR": psnr}), test_views, ..SAID })
    };
    let seen = [run("one", "specula", 30.0, 0), run("two", "3dgs", 31.0, 0)];
    let (table, said) = compared(&seen, &[]);
    for folder in &seen {
        let words = format!("{} was trained without --eval", folder.display());
        assert!(table.contains(&words) && said.contains(&words), "{table}{said}");
    }
    assert!(!table.contains("**") && !table.contains("not comparable"), "{table}");

    let held_out = run("three", "3dgs", 29.0, 2);
    let (table, said) = compared(&[seen[0].clone(), held_out], &[]);
    assert_eq!(said.matches("without --eval").count(), 1, "{said}");
    assert!(!table.contains("**"), "{table}");
}
