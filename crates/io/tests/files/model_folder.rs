//! The folder of a model: what is saved opens again, and what other programs saved opens as well.

use glam::Vec3;
use serde_json::{Value, json};
use specula_core::{
    camera::Camera,
    environment::texels,
    light_network::{WEIGHT_COUNT, initial_weight},
    near_field::NearField,
    scene::{Environment, Gaussians, Layout, RadianceActivation, len_of_values},
};
use specula_io::{
    Error, exposure, gaussian_ply,
    latlong::{self, LatLong, UpAxis},
    model_folder::{self, ModelInfo, Snapshot},
    orientation::{Orientation, UpSource},
    points_ply::PointCloud,
};
use std::{fs, path::Path};

fn gaussians(first: f32) -> Gaussians<Vec<f32>> {
    let layout = Layout::shaded(None);
    let mut gaussians = Gaussians { count: 3, layout, values: vec![0.0; len_of_values(3, layout)] };
    gaussians.set(0, 0, [first]);
    gaussians
}

fn light(activation: RadianceActivation) -> Environment<Vec<f32>> {
    let values = (0..18 * 16 * 16).map(|i| (i % 97) as f32 / 31.0).collect();
    Environment { resolution: 16, activation, values }
}

fn info() -> ModelInfo {
    let rest = json!({ "gaussian_count": 3, "note": "any" }).as_object().unwrap().clone();
    ModelInfo {
        version: "0.1.0".into(),
        profile: "paper".into(),
        iterations: 7,
        seed: u64::MAX,
        orientation: Some(Orientation {
            up: [0.0, 0.6, 0.8],
            centre: [0.1, -2.5, 1.0 / 3.0],
            distance: 3.7,
            up_source: UpSource::Mean,
            cameras: 1,
            rolled: 0,
            error_degrees: None,
        }),
        rest,
        ..ModelInfo::default()
    }
}

fn save(folder: &Path, iteration: u32, light: Option<&Environment<Vec<f32>>>) {
    save_with(folder, iteration, light, None);
}

fn save_with(
    folder: &Path,
    iteration: u32,
    light: Option<&Environment<Vec<f32>>>,
    near_field: Option<&NearField<Vec<f32>>>,
) {
    let (gaussians, info) = (gaussians(iteration as f32), info());
    let comments = ["hello".to_owned()];
    let snapshot =
        Snapshot { gaussians: &gaussians, comments: &comments, light, other_lights: &[], near_field, info: &info };
    model_folder::save(folder, iteration, &snapshot).unwrap();
}

/// One triangle in one leaf.
fn near_field() -> NearField<Vec<f32>> {
    let node = [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 1.0];
    let triangle = [0.0, 1.0, 2.0, 0.0];
    let vertices = (0..3).flat_map(|vertex| (0..16).map(move |k| (vertex * 16 + k) as f32 * 0.01));
    NearField::of_sizes([1, 1, 3], 0.125, node.into_iter().chain(triangle).chain(vertices).collect())
}

#[test]
fn a_near_field_comes_back_bit_by_bit_and_goes_with_its_model() {
    let folder = tempfile::tempdir().unwrap();
    let (light, surface) = (light(RadianceActivation::Identity), near_field());
    save_with(folder.path(), 3, Some(&light), Some(&surface));
    assert_eq!(model_folder::open(folder.path()).unwrap().near_field, Some(surface));
    // A model that takes its place leaves none behind.
    save(folder.path(), 3, Some(&light));
    assert_eq!(model_folder::open(folder.path()).unwrap().near_field, None);
    assert!(!model_folder::near_field_at(folder.path(), 3).exists());
}

#[test]
fn near_fields_that_would_not_be_traced_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let light = light(RadianceActivation::Identity);
    let refused = |surface: &NearField<Vec<f32>>| {
        save_with(folder.path(), 3, Some(&light), Some(surface));
        model_folder::open(folder.path()).unwrap_err().to_string()
    };
    let mut damaged = near_field();
    damaged.values[8] = 7.0;
    assert!(refused(&damaged).contains("triangle 0 has a vertex that does not exist"), "{}", refused(&damaged));
    let mut damaged = near_field();
    damaged.values[20] = f32::NAN;
    assert!(refused(&damaged).contains("not finite"), "{}", refused(&damaged));
    let mut damaged = near_field();
    *damaged.values.last_mut().unwrap() = 1e30;
    assert!(refused(&damaged).contains("vertex 2 has an albedo"), "{}", refused(&damaged));
    let file = model_folder::near_field_at(folder.path(), 3);
    fs::write(&file, "nothing of the kind").unwrap();
    let sentence = model_folder::open(folder.path()).unwrap_err().to_string();
    assert!(sentence.contains("near_field.safetensors") && sentence.contains("remove the file"), "{sentence}");
}

#[cfg(unix)]
#[test]
fn folders_that_are_links_are_neither_written_nor_emptied() {
    use std::os::unix::fs::symlink;
    let elsewhere = tempfile::tempdir().unwrap();
    save(elsewhere.path(), 7, None);
    let before = fs::read(model_folder::gaussians_at(elsewhere.path(), 7)).unwrap();
    let linked = gaussians(7.0);
    for name in ["point_cloud", "light", "brdf_mlp", "point_cloud/iteration_7"] {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join(name);
        fs::create_dir_all(link.parent().unwrap()).unwrap();
        symlink(elsewhere.path().join(name), &link).unwrap();
        let (gaussians, info) = (gaussians(1.0), info());
        let snapshot = Snapshot {
            gaussians: &gaussians,
            comments: &[],
            light: None,
            other_lights: &[],
            near_field: None,
            info: &info,
        };
        let refused = [model_folder::save(folder.path(), 7, &snapshot), model_folder::remove_training(folder.path())];
        for refused in refused {
            assert!(matches!(refused.unwrap_err(), Error::Link { path } if path == link), "{name}");
        }
        assert!(fs::read(model_folder::gaussians_at(elsewhere.path(), 7)).unwrap() == before, "{name}");
        // Reading may follow it.
        if name == "point_cloud" {
            assert_eq!(model_folder::open(folder.path()).unwrap().gaussians, linked);
        }
    }
}

#[cfg(unix)]
#[test]
fn files_that_are_links_or_have_other_names_are_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let thesis = folder.path().join("thesis");
    let model = folder.path().join("model");
    for is_hard in [true, false] {
        fs::create_dir(&model).unwrap();
        fs::write(&thesis, "{}").unwrap();
        for name in ["results.json", "timeline.json", "specula.json", "exposure.json"] {
            let link = |to: &Path| match is_hard {
                true => fs::hard_link(&thesis, to),
                false => std::os::unix::fs::symlink(&thesis, to),
            };
            link(&model.join(name)).unwrap();
        }
        let quality = vec![("PSNR".to_owned(), 30.0, Vec::new())];
        model_folder::add_quality(&model, "ours_7", &quality, serde_json::Map::new()).unwrap();
        model_folder::save_progress(&model, 7, 1.0, 1, &quality).unwrap();
        model_folder::save_info(&model, &info()).unwrap();
        exposure::write(&model, &["a".to_owned()], &[[[1.0; 4]; 3]]).unwrap();
        assert_eq!(fs::read_to_string(&thesis).unwrap(), "{}");
        fs::remove_dir_all(&model).unwrap();
    }
}

#[test]
fn what_is_no_file_is_told() {
    for name in ["specula.json", "light/iteration_7/near_field.safetensors", "brdf_mlp/iteration_7/brdf_mlp.hdr"] {
        let folder = tempfile::tempdir().unwrap();
        save(folder.path(), 7, None);
        let place = folder.path().join(name);
        let _ = fs::remove_file(&place);
        fs::create_dir_all(place.join("notes")).unwrap();
        let refused = model_folder::open(folder.path()).unwrap_err();
        assert!(matches!(&refused, Error::NotAFile { path } if *path == place), "{refused}");
        let _ = model_folder::remove_training(folder.path());
        assert!(name.contains('/') || place.join("notes").is_dir(), "a folder of a file's name is no one's to remove");
    }
}

#[test]
fn nothing_is_removed_where_a_folder_has_the_name_of_a_file() {
    for name in ["results.json", "config.toml", "results.lock", "checkpoint.safetensors"] {
        let folder = tempfile::tempdir().unwrap();
        save(folder.path(), 7, None);
        fs::create_dir(folder.path().join(name)).unwrap();
        let refused = model_folder::remove_training(folder.path()).unwrap_err();
        assert!(matches!(&refused, Error::NotAFile { path } if path.ends_with(name)), "{refused}");
        assert!(model_folder::gaussians_at(folder.path(), 7).is_file(), "the model stays");
    }
}

#[test]
fn results_of_measurements_at_the_same_time_are_all_kept() {
    let folder = tempfile::tempdir().unwrap();
    let quality = vec![("PSNR".to_owned(), 30.0, vec![("a".to_owned(), 30.0)])];
    let add = |number: u32| {
        model_folder::add_quality(folder.path(), &format!("ours_{number}"), &quality, serde_json::Map::new()).unwrap();
        model_folder::save_progress(folder.path(), number, 1.0, 1, &quality).unwrap();
    };
    std::thread::scope(|scope| (0..8).for_each(|number| drop(scope.spawn(move || add(number)))));
    for name in ["results.json", "per_view.json", "timeline.json"] {
        assert_eq!(read_json(&folder.path().join(name)).as_object().unwrap().len(), 8, "{name}");
    }
}

fn read_json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

#[test]
fn exposures_come_back_by_names_that_may_repeat() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(exposure::read(folder.path()).unwrap(), None);
    let exposures = [0, 1, 2].map(|k| [[0.1 + k as f32, -0.3, 1e-9, 0.7]; 3]);
    let names = ["b", "a", "b"].map(str::to_owned);
    exposure::write(folder.path(), &names, &exposures).unwrap();
    let read = exposure::read(folder.path()).unwrap().unwrap();
    let expected = [("a", exposures[1]), ("b", exposures[0]), ("b (2)", exposures[2])];
    assert_eq!(read, expected.map(|(name, own)| (name.to_owned(), own)).into());
    assert_eq!(read_json(&exposure::path_in(folder.path()))["a"].as_array().unwrap().len(), 3, "rows of a matrix");

    exposure::remove(folder.path()).unwrap();
    exposure::remove(folder.path()).unwrap();
    assert_eq!(exposure::read(folder.path()).unwrap(), None, "they are gone");
    fs::write(exposure::path_in(folder.path()), "{\"a\": [[1, 2]]}").unwrap();
    let sentence = exposure::read(folder.path()).unwrap_err().to_string();
    assert!(sentence.contains("exposure.json"), "{sentence}");
}

#[test]
fn what_is_saved_opens_again() {
    let folder = tempfile::tempdir().unwrap();
    let light = light(RadianceActivation::Identity);
    save(folder.path(), 7000, Some(&light));
    let model = model_folder::open(folder.path()).unwrap();
    assert_eq!(model.gaussians, gaussians(7000.0));
    assert_eq!(model.comments, ["hello"]);
    assert_eq!(model.light, Some(light));
    assert_eq!(model.info, Some(ModelInfo { saved: vec![7000], ..info() }));
    assert_eq!(model.iteration, Some(7000));
}

#[test]
fn the_last_finished_iteration_is_opened() {
    let folder = tempfile::tempdir().unwrap();
    for iteration in [7000, 9000, 30000] {
        save(folder.path(), iteration, None);
    }
    fs::create_dir_all(folder.path().join("point_cloud/iteration_40000")).unwrap();
    fs::create_dir_all(folder.path().join("point_cloud/iteration_best")).unwrap();
    assert_eq!(model_folder::latest_iteration(folder.path()).unwrap(), 30000);
    assert_eq!(model_folder::open(folder.path()).unwrap().gaussians, gaussians(30000.0));
    assert_eq!(model_folder::open_iteration(folder.path(), 9000).unwrap().gaussians, gaussians(9000.0));
    assert_eq!(model_folder::open(folder.path()).unwrap().light, None);
}

#[test]
fn the_newest_training_is_opened_and_not_the_longest() {
    let folder = tempfile::tempdir().unwrap();
    let iteration = || model_folder::open(folder.path()).unwrap().iteration;
    save(folder.path(), 40, None);
    save(folder.path(), 30, None);
    assert_eq!(iteration(), Some(30), "30 was saved after 40");
    model_folder::save_info(folder.path(), &info()).unwrap();
    assert_eq!(iteration(), Some(30), "settings that are written again list the same iterations");
    save(folder.path(), 40, None);
    assert_eq!(iteration(), Some(40), "an iteration that is saved again is the newest");
    fs::remove_file(model_folder::gaussians_at(folder.path(), 40)).unwrap();
    assert_eq!(iteration(), Some(30), "one that is not there is passed over");
}

#[test]
fn settings_are_not_those_of_an_iteration_that_their_training_did_not_save() {
    let folder = tempfile::tempdir().unwrap();
    save(folder.path(), 40, None);
    fs::remove_file(folder.path().join("specula.json")).unwrap();
    save(folder.path(), 30, None);
    let of = |iteration| model_folder::open_iteration(folder.path(), iteration).unwrap().info.map(|info| info.seed);
    assert_eq!([of(30), of(40)], [Some(u64::MAX), None]);
}

#[test]
fn a_training_is_removed_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let holds = || model_folder::holds_training(folder.path());
    assert!(!holds());
    save(folder.path(), 40, Some(&light(RadianceActivation::Identity)));
    model_folder::save_quality(folder.path(), "ours_40", &Vec::new()).unwrap();
    let [pictures, relit] = ["test/ours_40/renders/00000.png", "relight/forest/ours_40/rgb/00000.png"];
    let mine = ["notes.txt", "test/notes.txt", "relight/forest/mine.png", "point_cloud/mine.ply", "test/ours/a.png"];
    for name in [pictures, relit].iter().chain(&mine) {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, "picture").unwrap();
    }
    assert!(holds());
    model_folder::remove_training(folder.path()).unwrap();
    assert!(!holds());
    let is_there = |name: &&str| folder.path().join(name).exists();
    assert_eq!(
        mine.iter().filter(|name| !is_there(name)).collect::<Vec<_>>(),
        Vec::<&&str>::new(),
        "they are the user's"
    );
    let ours = ["specula.json", "results.json", "light/iteration_40", pictures, relit];
    assert_eq!(ours.iter().filter(|name| is_there(name)).collect::<Vec<_>>(), Vec::<&&str>::new(), "they are removed");
    model_folder::remove_training(folder.path()).unwrap();
}

#[test]
fn a_light_of_logarithms_is_saved_as_radiance() {
    let folder = tempfile::tempdir().unwrap();
    let logarithms = light(RadianceActivation::Exponential);
    save(folder.path(), 1, Some(&logarithms));
    let opened = model_folder::open(folder.path()).unwrap().light.unwrap();
    assert_eq!(opened.activation, RadianceActivation::Identity);
    assert!(opened.values.iter().zip(&logarithms.values).all(|(radiance, logarithm)| *radiance == logarithm.exp()));
}

#[test]
fn the_authors_tools_find_their_light() {
    let folder = tempfile::tempdir().unwrap();
    save(folder.path(), 30, Some(&light(RadianceActivation::Identity)));
    let map = latlong::read(&folder.path().join("brdf_mlp/iteration_30/brdf_mlp.hdr")).unwrap().0;
    assert_eq!((map.width, map.height), (1024, 512));
}

#[test]
fn a_model_of_the_authors_opens() {
    let folder = tempfile::tempdir().unwrap();
    gaussian_ply::write(&model_folder::gaussians_at(folder.path(), 30000), &gaussians(1.0), &[]).unwrap();
    // Upper half bright: +y, which is face 2.
    let rgb = (0..1024 * 512).flat_map(|pixel| if pixel < 1024 * 256 { [4.0; 3] } else { [0.5; 3] }).collect();
    latlong::write(&model_folder::hdr_at(folder.path(), 30000), &LatLong { width: 1024, height: 512, rgb }).unwrap();

    let model = model_folder::open(folder.path()).unwrap();
    let light = model.light.unwrap();
    assert_eq!((model.info, light.resolution), (None, 512));
    let face = 3 * 512 * 512;
    assert!(light.values[2 * face..3 * face].iter().all(|value| *value == 4.0), "face +y looks up");
    assert!(light.values[3 * face..4 * face].iter().all(|value| *value == 0.5), "face -y looks down");
}

#[test]
fn a_ply_file_in_its_place_brings_its_light() {
    let folder = tempfile::tempdir().unwrap();
    save(folder.path(), 5, Some(&light(RadianceActivation::Identity)));
    let path = model_folder::gaussians_at(folder.path(), 5);
    let model = model_folder::open(&path).unwrap();
    assert!(model.light.is_some() && model.info.is_some() && model.iteration == Some(5));

    let alone = folder.path().join("alone.ply");
    fs::copy(path, &alone).unwrap();
    let model = model_folder::open(&alone).unwrap();
    assert!(model.light.is_none() && model.info.is_none() && model.iteration.is_none());
}

#[test]
fn inputs_are_saved_as_other_tools_save_them() {
    let folder = tempfile::tempdir().unwrap();
    let camera = Camera::look_at(Vec3::new(4.0, 0.0, 0.0), Vec3::ZERO, Vec3::Z, 0.7, 10, 10);
    let named = |name: &str| (name.to_owned(), camera);
    let points = PointCloud { positions: vec![[0.0; 3]], colors: vec![[0.0; 3]] };
    let settings =
        [("sh_degree", json!(-1)), ("source_path", json!("/it's/\\here")), ("eval", json!(true)), ("x", json!(null))];
    model_folder::save_inputs(folder.path(), &[named("train_0")], &[named("test_0")], &points, [0.0; 3], &settings)
        .unwrap();

    let cfg_args = fs::read_to_string(folder.path().join("cfg_args")).unwrap();
    assert_eq!(cfg_args, r"Namespace(sh_degree=-1, source_path='/it\'s/\\here', eval=True, x=None)");
    let cameras = read_json(&folder.path().join("cameras.json"));
    assert_eq!((&cameras[0]["img_name"], &cameras[1]["img_name"]), (&json!("test_0"), &json!("train_0")));
    assert!(folder.path().join("input.ply").is_file());
}

#[test]
fn quality_of_other_iterations_stays() {
    let folder = tempfile::tempdir().unwrap();
    let quality = |psnr| vec![("PSNR".to_owned(), psnr, vec![("00000.png".to_owned(), psnr)])];
    model_folder::save_quality(folder.path(), &model_folder::method_of(7000), &quality(30.5)).unwrap();
    model_folder::save_quality(folder.path(), &model_folder::method_of(30000), &quality(33.25)).unwrap();
    let expected = json!({ "ours_7000": { "PSNR": 30.5 }, "ours_30000": { "PSNR": 33.25 } });
    assert_eq!(read_json(&folder.path().join("results.json")), expected);
    let per_view = read_json(&folder.path().join("per_view.json"));
    assert_eq!(per_view["ours_30000"], json!({ "PSNR": { "00000.png": 33.25 } }));
}

#[test]
fn other_measures_of_the_same_views_stay() {
    let folder = tempfile::tempdir().unwrap();
    let of = |measure: &str, view: &str| vec![(measure.to_owned(), 0.5, vec![(view.to_owned(), 0.5)])];
    let both = |view: &str| [of("PSNR", view), of("LPIPS", view)].concat();
    let add = |quality| model_folder::add_quality(folder.path(), "ours_7", &quality, serde_json::Map::new()).unwrap();
    let measures = || {
        let measured = |name: &str| {
            let said = read_json(&folder.path().join(name));
            said["ours_7"].as_object().unwrap().keys().cloned().collect::<Vec<_>>()
        };
        assert_eq!(measured("results.json"), measured("per_view.json"));
        measured("results.json")
    };
    add(both("00000.png"));
    add(of("PSNR", "00000.png"));
    assert_eq!(measures(), ["LPIPS", "PSNR"], "what was measured with more effort stays");
    add(of("PSNR", "00001.png"));
    assert_eq!(measures(), ["PSNR"], "what was measured of other views does not");
    add(both("00001.png"));
    add(vec![("PSNR".to_owned(), 0.4, vec![("00001.png".to_owned(), 0.4)])]);
    assert_eq!(measures(), ["PSNR"], "nor of other pictures");
}

#[test]
fn what_is_no_model_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |path: &Path, parts: &[&str]| {
        let sentence = model_folder::open(path).unwrap_err().to_string();
        assert!(parts.iter().all(|part| sentence.contains(part)), "{sentence}");
    };
    refused(folder.path(), &["no point_cloud/iteration_N/point_cloud.ply", "folder of a training"]);
    refused(&folder.path().join("no.ply"), &["cannot read", "no.ply"]);

    save(folder.path(), 5, None);
    let sentence = model_folder::open_iteration(folder.path(), 6).unwrap_err().to_string();
    assert!(sentence.contains("iteration_6"), "{sentence}");

    fs::write(folder.path().join("specula.json"), "{\n\"seed\": \"one\"}").unwrap();
    refused(folder.path(), &["specula.json", "line 2", "string"]);
}

#[test]
fn the_orientation_of_earlier_versions_is_read() {
    let folder = tempfile::tempdir().unwrap();
    model_folder::save_info(folder.path(), &info()).unwrap();
    let path = folder.path().join("specula.json");
    let text = fs::read_to_string(&path).unwrap();
    assert!(text.contains("\"orientation\""), "{text}");
    fs::write(&path, text.replace("\"orientation\"", "\"bearings\"")).unwrap();
    let read = model_folder::read_info(folder.path()).unwrap().expect("it is there");
    assert!(read.orientation.is_some() && read == info(), "{read:?}");
}

#[test]
fn settings_of_later_versions_are_kept() {
    let info: ModelInfo = serde_json::from_str(r#"{ "profile": "x", "from_the_future": [1, 2] }"#).unwrap();
    assert_eq!(info.rest["from_the_future"], json!([1, 2]));
    let text = serde_json::to_string(&info).unwrap();
    assert_eq!(serde_json::from_str::<ModelInfo>(&text).unwrap(), info);
}

#[test]
fn the_hdr_of_a_saved_light_leads_back_to_it() {
    let folder = tempfile::tempdir().unwrap();
    // Bright towards +x only: a turned or mirrored map would put it elsewhere.
    let mut values = vec![0.1; 18 * 64 * 64];
    values[..3 * 64 * 64].fill(2.0);
    save(folder.path(), 1, Some(&Environment { resolution: 64, activation: RadianceActivation::Identity, values }));
    let map = latlong::read(&model_folder::hdr_at(folder.path(), 1)).unwrap().0;
    let back = latlong::to_cube(&map, 64, UpAxis::Y);
    let mean = |face: usize| back[face * 12288..(face + 1) * 12288].iter().sum::<f32>() / 12288.0;
    assert!((mean(0) - 2.0).abs() < 0.05, "{}", mean(0));
    assert!((1..6).all(|face| mean(face) < 0.15));
}

/// A network that differs from direction to direction.
fn network() -> Environment<Vec<f32>> {
    let weight = |index| initial_weight(index, -0.5, 3) + 0.001 * (index % 7) as f32;
    let values = (0..WEIGHT_COUNT).map(weight).collect();
    Environment { resolution: 16, activation: RadianceActivation::Network, values }
}

#[test]
fn lights_of_groups_come_back_and_former_ones_do_not() {
    let folder = tempfile::tempdir().unwrap();
    let gaussians = gaussians(3.0);
    let lights = [network(), texels_of(0.5), texels_of(2.0)];
    let save = |count: usize| {
        let mut info = info();
        info.set_light_names(&["a", "b", "c"][..count].iter().map(|name| (*name).to_owned()).collect::<Vec<_>>());
        let (light, other_lights) = (Some(&lights[0]), &lights[1..count]);
        let snapshot =
            Snapshot { gaussians: &gaussians, comments: &[], light, other_lights, near_field: None, info: &info };
        model_folder::save(folder.path(), 3, &snapshot).unwrap();
        model_folder::open(folder.path()).unwrap().other_lights
    };
    assert!(save(3) == lights[1..]);
    assert!(save(2) == lights[1..2] && !model_folder::numbered_light_at(folder.path(), 3, 2).exists());
    assert!(save(1).is_empty());
}

/// A light of one radiance at the resolution of [`network`].
fn texels_of(radiance: f32) -> Environment<Vec<f32>> {
    let resolution = network().resolution;
    let values = vec![radiance; 18 * resolution * resolution];
    Environment { resolution, activation: RadianceActivation::Identity, values }
}

#[test]
fn a_light_that_is_a_network_comes_back_bit_by_bit_beside_its_texels() {
    let folder = tempfile::tempdir().unwrap();
    let light = network();
    save(folder.path(), 3, Some(&light));
    let opened = model_folder::open(folder.path()).unwrap();
    assert_eq!((opened.light.as_ref(), opened.is_relit), (Some(&light), false));

    // Programs that do not know the network see its texels.
    fs::remove_file(model_folder::network_at(folder.path(), 3)).unwrap();
    let shown = model_folder::open(folder.path()).unwrap().light.unwrap();
    assert_eq!(shown.activation, RadianceActivation::Identity);
    assert_eq!(shown.values, texels(&light).flatten().collect::<Vec<f32>>());

    // A light that takes its place leaves no network behind.
    save(folder.path(), 3, Some(&light));
    save(folder.path(), 3, Some(&shown));
    assert!(!model_folder::network_at(folder.path(), 3).exists());
    assert_eq!(model_folder::open(folder.path()).unwrap().light, Some(shown));
}

#[test]
fn a_network_that_is_broken_or_not_that_of_the_light_beside_it_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = model_folder::network_at(folder.path(), 3);
    let refused = || match model_folder::open(folder.path()) {
        Err(error) => error.to_string(),
        Ok(_) => panic!("it was read"),
    };
    let mut other = network();
    other.values[WEIGHT_COUNT - 1] += 0.1;
    save(folder.path(), 3, Some(&other));
    let another = fs::read(&file).unwrap();
    save(folder.path(), 3, Some(&network()));
    let bytes = fs::read(&file).unwrap();
    fs::write(&file, another).unwrap();
    assert!(refused().contains("another light"), "{}", refused());

    let mut broken = bytes.clone();
    let end = broken.len();
    broken[end - 4..].copy_from_slice(&f32::NAN.to_le_bytes());
    fs::write(&file, broken).unwrap();
    assert!(refused().contains("1 weights of the light network are NaN"), "{}", refused());

    fs::write(&file, &bytes[..end - 1]).unwrap();
    assert!(refused().contains("network.safetensors"), "{}", refused());
    let text = String::from_utf8_lossy(&bytes).into_owned();
    assert!(text.contains("layer1.weight") && text.contains("layer3.bias"), "names of layers");
    let at = bytes.windows(10).position(|word| word == b"resolution").unwrap() + 13;
    let mut odd = bytes;
    odd[at] = b'9';
    fs::write(&file, odd).unwrap();
    assert!(refused().contains("another light"), "{}", refused());
}

#[test]
fn a_light_that_was_replaced_is_taken_and_one_that_was_not_stays_exact() {
    let folder = tempfile::tempdir().unwrap();
    let light = light(RadianceActivation::Identity);
    save(folder.path(), 7, Some(&light));
    let kept = model_folder::open(folder.path()).unwrap();
    assert_eq!((kept.light.as_ref(), kept.is_relit), (Some(&light), false), "nobody touched it");

    let hdr = folder.path().join("brdf_mlp/iteration_7/brdf_mlp.hdr");
    let (mut map, _) = latlong::read(&hdr).unwrap();
    map.rgb.iter_mut().for_each(|radiance| *radiance *= 1.1);
    latlong::write(&hdr, &map).unwrap();
    let relit = model_folder::open(folder.path()).unwrap();
    assert!(relit.is_relit, "it is a tenth brighter");
    let mean = |values: &[f32]| values.iter().sum::<f32>() / values.len() as f32;
    let ratio = mean(&relit.light.unwrap().values) / mean(&light.values);
    // A mean over texels of two resolutions, of light that differs from texel to texel.
    assert!((ratio - 1.1).abs() < 0.05, "{ratio}");

    let small = LatLong { width: 8, height: 4, rgb: vec![1.0; 96] };
    latlong::write(&hdr, &small).unwrap();
    assert!(model_folder::open(folder.path()).unwrap().is_relit, "a map of another size is another one");
}
