//! Loss of pictures by half precision: of all that `Storage::F16` stores in halves, and of each
//! kind of number separately, among them means and scales, which it keeps in full. Measured on the
//! torus, and on the model folders given as arguments.

#[path = "../benches/own/mod.rs"]
mod own;

use core::ops::Range;
use own::trained::Trained;
use specula_benches::{camera, environment, scene::LIGHT, torus};
use specula_core::{
    camera::Camera,
    executor::Renderer,
    metrics::psnr,
    pack::{Storage, pack2, unpack2},
    prefilter::LevelRange,
    rules::{Channels, RenderRules},
    scene::{DIFFUSE, Environment, Gaussians, LOG_SCALE, MEAN, OPACITY, QUAT},
};
use specula_cpu::{CpuExecutor, stages::prefilter::Light};
use specula_train::{
    evaluate::render_view,
    profile::{Profile, by_name},
};
use std::path::Path;

const GAUSSIANS: usize = 100_000;
const SIZE: u32 = 800;
/// Cameras of a model that are looked from.
const VIEWS: usize = 12;

fn main() {
    println!("| scene | halves | PSNR | largest difference |\n|---|---|---|---|");
    for name in ["3dgs", "paper", "specula"] {
        let profile = by_name(name, 30_000).expect("a profile of that name");
        let light = profile.light.map(|_| environment(LIGHT));
        let subject = Subject { cloud: torus(GAUSSIANS, profile.layout), profile, cameras: vec![camera(SIZE)] };
        subject.measure(&format!("torus, {name}"), light.as_ref());
    }
    for folder in std::env::args().skip(1) {
        let Trained { cloud, light, profile, mut cameras } = Trained::open(Path::new(&folder));
        cameras.truncate(VIEWS);
        Subject { cloud, profile, cameras }.measure(&folder, light.as_ref());
    }
}

struct Subject {
    cloud: Gaussians<Vec<f32>>,
    profile: Profile,
    cameras: Vec<Camera>,
}

impl Subject {
    fn measure(&self, name: &str, light: Option<&Environment<Vec<f32>>>) {
        let mut exec = CpuExecutor::new();
        let levels = |light| exec.prefilter(light, self.profile.scheme, LevelRange::ALL).expect("a power of two");
        let light = light.map(levels);
        let mut rounded_light = light.clone();
        rounded_light.iter_mut().for_each(|light| light.round(Storage::F16));
        let truth = self.pictures(&self.cloud, light.as_ref());
        let print = |kind: &str, cloud: &Gaussians<Vec<f32>>, light: Option<&Light>| {
            let (psnr, largest) = compared(&self.pictures(cloud, light), &truth);
            println!("| {name} | {kind} | {psnr:.1} dB | {largest:.5} |");
        };

        let mut stored = self.cloud.clone();
        Storage::F16.round(&mut stored);
        print("as stored", &stored, rounded_light.as_ref());
        let layout = self.cloud.layout;
        let kinds = [
            ("means", MEAN..LOG_SCALE),
            ("scales", LOG_SCALE..QUAT),
            ("quats", QUAT..OPACITY),
            ("opacities", OPACITY..DIFFUSE),
            ("surfaces", DIFFUSE..layout.sh_start()),
            ("harmonics", layout.sh_start()..layout.sh_end()),
        ];
        for (kind, planes) in kinds.into_iter().filter(|(_, planes)| !planes.is_empty()) {
            print(kind, &self.rounded(planes), light.as_ref());
        }
        if light.is_some() {
            print("light", &self.cloud, rounded_light.as_ref());
        }
    }

    /// The cloud with some of its planes rounded to halves.
    fn rounded(&self, planes: Range<usize>) -> Gaussians<Vec<f32>> {
        let mut cloud = self.cloud.clone();
        for (gaussian, plane) in
            (0..cloud.count).flat_map(|gaussian| planes.clone().map(move |plane| (gaussian, plane)))
        {
            let [number] = cloud.get(gaussian, plane);
            let [rounded, _] = unpack2(pack2(number, 0.0));
            cloud.set(gaussian, plane, [rounded]);
        }
        cloud
    }

    /// Colours of all views, before a background.
    fn pictures(&self, cloud: &Gaussians<Vec<f32>>, light: Option<&Light>) -> Vec<f32> {
        let mut exec = CpuExecutor::new();
        let rules = RenderRules::full(self.profile.shading, self.profile.scheme, Channels::Color);
        let views = self.cameras.iter().flat_map(|camera| {
            let image = render_view(&mut exec, cloud, light, camera, &rules).expect("the CPU renders");
            image.values[..3 * image.pixel_count()].to_vec()
        });
        views.collect()
    }
}

/// PSNR and the largest difference, as a screen shows both.
fn compared(one: &[f32], other: &[f32]) -> (f64, f32) {
    let differences = one.iter().zip(other).map(|(x, y)| (x.clamp(0.0, 1.0) - y.clamp(0.0, 1.0)).abs());
    let squares: f64 = differences.clone().map(|x| f64::from(x).powi(2)).sum();
    (psnr(squares / one.len() as f64), differences.fold(0.0, f32::max))
}
