//! Published scenes and models, where the environment variable `SPECULA_DATA` names a folder that
//! has them.

use specula_io::{
    Result, cameras,
    dataset::{self, LoadOptions},
    gaussian_ply, latlong, model_folder, points_ply,
};
use std::{
    collections::HashMap,
    env, fs,
    path::{Path, PathBuf},
};

/// A path in the data folder, or a loud skip.
fn data(name: &str) -> Option<PathBuf> {
    let Some(folder) = env::var_os("SPECULA_DATA") else {
        eprintln!("SKIPPED: set SPECULA_DATA to the folder that has {name}");
        return None;
    };
    let path = Path::new(&folder).join(name);
    if path.exists() {
        return Some(path);
    }
    eprintln!("SKIPPED: no {}", path.display());
    None
}

#[test]
fn the_chair_of_nerf_synthetic_loads() -> Result<()> {
    let Some(folder) = data("nerf_synthetic_chair") else { return Ok(()) };
    let data = dataset::load(&folder, &LoadOptions { downscale: 2, ..LoadOptions::default() }, |_, _| {})?;
    assert_eq!((data.train.len(), data.test.len()), (100, 25));
    for view in data.train.iter().chain(&data.test) {
        assert_eq!([view.image.width, view.image.height, view.camera.width], [400; 3]);
        let centre = view.camera.camera_from_world * -view.camera.position;
        // All cameras look at the origin from four units away.
        assert!(centre.x.abs() < 0.01 && centre.y.abs() < 0.01 && (centre.z - 4.03).abs() < 0.01, "{centre}");
    }
    Ok(())
}

#[test]
fn the_spheres_load_with_normals_and_points() -> Result<()> {
    let Some(folder) = data("scenes/spheres") else { return Ok(()) };
    let points = Some(folder.join("points3d_surface.ply"));
    let data = dataset::load(&folder, &LoadOptions { points, ..LoadOptions::default() }, |_, _| {})?;
    assert_eq!((data.train.len(), data.test.len()), (100, 40));
    assert_eq!(data.points.map(|points| points.positions.len()), Some(10_000));
    for view in &data.test {
        let normals = view.normal.as_ref().expect("every test view has normals");
        let facing = normals.values.iter().zip(&normals.mask).filter(|(_, mask)| **mask);
        let forward = view.camera.camera_from_world.row(2);
        assert!(facing.clone().count() > 1000);
        // Up to the opening of the lens, what is seen faces the camera.
        assert!(facing.into_iter().all(|(normal, _)| forward.dot((*normal).into()) < 0.36));
    }
    Ok(())
}

/// The bytes of a file of COLMAP, taken from its front.
struct Bytes(Vec<u8>, usize);

impl Bytes {
    fn of(path: &Path) -> Self {
        Self(fs::read(path).expect("the file is there"), 0)
    }
    fn take<const N: usize>(&mut self) -> [u8; N] {
        self.1 += N;
        self.0[self.1 - N..self.1].try_into().expect("N bytes were taken")
    }
    fn count(&mut self) -> u64 {
        u64::from_le_bytes(self.take())
    }
    fn numbers<const N: usize>(&mut self) -> [f64; N] {
        core::array::from_fn(|_| f64::from_le_bytes(self.take()))
    }
    fn name(&mut self) -> String {
        let len = self.0[self.1..].iter().position(|byte| *byte == 0).expect("names end");
        self.1 += len + 1;
        String::from_utf8_lossy(&self.0[self.1 - len - 1..self.1 - 1]).into_owned()
    }
}

/// Points of a reconstruction by their identifiers.
fn points_of(model: &Path) -> HashMap<u64, [f64; 3]> {
    let mut bytes = Bytes::of(&model.join("points3D.bin"));
    let point = |bytes: &mut Bytes| {
        let (id, position) = (bytes.count(), bytes.numbers());
        let _color_and_error: [u8; 11] = bytes.take();
        bytes.1 += 8 * bytes.count() as usize;
        (id, position)
    };
    (0..bytes.count()).map(|_| point(&mut bytes)).collect()
}

/// Positions of 2D points in each image.
fn observations_of(model: &Path) -> HashMap<String, Vec<([f64; 2], u64)>> {
    let mut bytes = Bytes::of(&model.join("images.bin"));
    let image = |bytes: &mut Bytes| {
        let _id_pose_and_camera: [u8; 64] = bytes.take();
        let name = bytes.name();
        let places = (0..bytes.count()).map(|_| (bytes.numbers(), bytes.count())).collect();
        (name.split('.').next().unwrap_or_default().to_owned(), places)
    };
    (0..bytes.count()).map(|_| image(&mut bytes)).collect()
}

#[test]
fn points_of_colmap_are_seen_where_it_says() -> Result<()> {
    for scene in ["colmap/thermos", "colmap/statue"] {
        let Some(folder) = data(scene) else { return Ok(()) };
        let loaded = dataset::load(&folder, &LoadOptions::default(), |_, _| {})?;
        let (points, seen) = (points_of(&folder.join("sparse/0")), observations_of(&folder.join("sparse/0")));
        let mut errors = Vec::new();
        for view in loaded.train.iter().chain(&loaded.test) {
            let camera = view.camera;
            for (place, point) in seen[&view.name].iter().filter_map(|(place, id)| Some((place, points.get(id)?))) {
                let p = camera.camera_from_world * (glam::DVec3::from(*point).as_vec3() - camera.position);
                let x = camera.focal_px[0] * p.x / p.z + camera.principal_px[0];
                let y = camera.focal_px[1] * p.y / p.z + camera.principal_px[1];
                errors.push((f64::from(x) - place[0]).hypot(f64::from(y) - place[1]));
            }
        }
        errors.sort_by(f64::total_cmp);
        let (median, most) = (errors[errors.len() / 2], errors[errors.len() * 99 / 100]);
        println!("{scene}: {} observations, median {median:.2} px, 99 % within {most:.2} px", errors.len());
        assert!(median < 1.0 && most < 5.0, "{scene}: median {median} px, 99 % within {most} px");
    }
    Ok(())
}

#[test]
fn cameras_of_a_scene_load_without_images() -> Result<()> {
    let Some(path) = data("scenes/spheres/transforms_test.json") else { return Ok(()) };
    let cameras = cameras::read_cameras(&path, [1, 1], [0.0; 3])?;
    assert_eq!((cameras.len(), cameras[0].1.width), (40, 400));
    Ok(())
}

#[test]
fn a_trained_model_loads_and_is_written_as_it_was() -> Result<()> {
    let Some(path) = data("splats/kacytran_iter7000_9080g_inria.ply") else { return Ok(()) };
    let file = gaussian_ply::read(&path)?;
    assert_eq!((file.gaussians.count, file.gaussians.layout.sh_degree), (9080, Some(3)));
    let folder = tempfile::tempdir().expect("a temporary folder");
    let copy = folder.path().join("copy.ply");
    gaussian_ply::write(&copy, &file.gaussians, &file.comments)?;
    assert!(fs::read(&path).expect("the model") == fs::read(&copy).expect("its copy"), "not a byte differs");
    Ok(())
}

#[test]
fn files_of_other_programs_load() -> Result<()> {
    let Some(path) = data("splats/guitar.compressed.ply") else { return Ok(()) };
    assert_eq!(gaussian_ply::read(&path)?.gaussians.count, 90_854);
    assert!(points_ply::read(&path).is_err());
    for name in ["minimal-raw.spz", "minimal-v2.spz", "minimal-v3.spz", "minimal-v4.spz", "minimal.splat"] {
        let Some(path) = data(&format!("splats/splat-transform-fixtures/{name}")) else { return Ok(()) };
        assert_eq!(model_folder::open(&path)?.gaussians.count, 4, "{name}");
    }
    Ok(())
}

#[test]
fn the_lights_load() -> Result<()> {
    for name in ["forest", "studio", "sunset", "workshop"] {
        let Some(path) = data(&format!("envs/{name}.hdr")) else { return Ok(()) };
        let (map, cleaned) = latlong::read(&path)?;
        assert_eq!((map.width, map.height, cleaned.total()), (1024, 512, 0));
    }
    Ok(())
}
