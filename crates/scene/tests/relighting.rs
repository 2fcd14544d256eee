//! Relit pictures of three known solids against path-traced ones: Gaussians cover the solids'
//! surfaces, whose shapes and materials are exact, so that the errors are only those of rendering.

use core::f64::consts::PI;
use glam::{DVec3, Quat, Vec3};
use specula_core::{
    activation::logit,
    camera::Camera,
    color::srgb_from_linear,
    rules::Channels,
    scene::{
        ALBEDO, AMBIENT, Environment, Gaussians, LOG_SCALE, Layout, MEAN, METALNESS, OPACITY, QUAT, ROUGHNESS,
        len_of_values,
    },
};
use specula_cpu::CpuExecutor;
use specula_io::latlong::{self, LatLong, UpAxis};
use specula_oracle::independent::{
    paths::{Shape, Solid, Sun, Traced, World},
    rays::RayView,
};
use specula_scene::{
    ExecutorChoice, RenderOptions, Scene, SceneRenderer, Shading, ShadingModel, Surface,
    environment::radiance,
    export::{BakeMethod, GaussianFormat, PlainGaussians, read_relightable, visible},
    lamps::{SceneLamps, SunChoice, direction},
    light_fit::LightFit,
    orbit,
};
use specula_train::{
    near_field::{UnlitPicture, fused},
    view::View,
};

/// Pixels along an edge of a traced picture.
const SIZE: u32 = 64;
/// Rendered pixels along an edge of a traced one: the low-pass of a splat widens solids by half a
/// rendered pixel.
const FINER: u32 = 8;
/// Paths along an edge of a pixel.
const PATHS: usize = 32;
/// Distance between Gaussians of a surface; in a scene that a light is fitted to.
const STEP: f64 = 0.012;
const COARSE_STEP: f64 = 0.03;
/// Standard deviation of a Gaussian along the surface, in steps: the layer is opaque.
const WIDTH: f64 = 0.6;
/// Voxels along the longest edge of the fused surface.
const VOXELS: u16 = 160;
/// Views that are fused.
const VIEWS: u32 = 30;
/// Bounces after which nothing is left.
const ALL: u32 = 8;
/// Shadow rays with which light is reflected.
const RAYS: usize = 32;
const WHITE: f64 = 1.0;

/// A ball of some metalness and a block on a slab.
fn solids(metalness: f64) -> [Solid; 3] {
    let block = |center: [f64; 3], half: [f64; 3]| Shape::Block { center: center.into(), half: half.into() };
    [
        Solid {
            shape: block([0.0, 0.0, -0.05], [1.0, 1.0, 0.05]),
            albedo: DVec3::new(0.6, 0.55, 0.5),
            metalness: 0.0,
            roughness: 0.6,
        },
        Solid {
            shape: Shape::Ball { center: DVec3::new(-0.35, -0.1, 0.32), radius: 0.32 },
            albedo: DVec3::new(0.9, 0.7, 0.4),
            metalness,
            roughness: 0.3,
        },
        Solid {
            shape: block([0.4, 0.3, 0.25], [0.22, 0.22, 0.25]),
            albedo: DVec3::new(0.2, 0.4, 0.6),
            metalness: 0.0,
            roughness: 0.4,
        },
    ]
}

/// A sky that brightens to one side, and a dark ground.
fn sky(direction: DVec3) -> DVec3 {
    let high = 0.5 * (1.0 + direction.z);
    let warm = direction.dot(DVec3::new(0.6, -0.64, 0.48)).max(0.0).powi(8);
    DVec3::new(0.3, 0.4, 0.55) * high * high + DVec3::new(0.15, 0.12, 0.1) + warm * DVec3::new(2.0, 1.7, 1.2)
}

fn map(radiance: impl Fn(DVec3) -> DVec3) -> LatLong {
    let (width, height) = (256, 128);
    let rgb = (0..width * height).flat_map(|pixel| {
        let [u, v] = [(pixel % width, width), (pixel / width, height)].map(|(k, n)| (k as f64 + 0.5) / n as f64);
        let (turn, down) = ((0.5 - u) * 2.0 * PI, v * PI);
        let (sine, cosine) = turn.sin_cos();
        let direction = DVec3::new(down.sin() * cosine, down.sin() * sine, down.cos());
        radiance(direction).as_vec3().to_array()
    });
    LatLong { width, height, rgb: rgb.collect() }
}

/// Flat Gaussians that cover the surfaces.
fn gaussians(solids: &[Solid], step: f64) -> Gaussians<Vec<f32>> {
    let points: Vec<(&Solid, DVec3, DVec3)> = solids
        .iter()
        .flat_map(|solid| solid.shape.points(step).into_iter().map(move |(point, normal)| (solid, point, normal)))
        .collect();
    let layout = Layout::shaded(None).physical();
    let count = points.len();
    let mut gaussians = Gaussians { count, layout, values: vec![0.0; len_of_values(count, layout)] };
    let first = layout.physical_planes().expect("the layout is physical");
    let wide = (WIDTH * step).ln() as f32;
    for (index, (solid, point, normal)) in points.into_iter().enumerate() {
        let turn = Quat::from_rotation_arc(Vec3::Z, normal.as_vec3());
        gaussians.set(index, MEAN, point.as_vec3().to_array());
        gaussians.set(index, LOG_SCALE, [wide, wide, wide - 4.0]);
        gaussians.set(index, QUAT, [turn.w, turn.x, turn.y, turn.z]);
        gaussians.set(index, OPACITY, [4.0]);
        gaussians.set(index, ROUGHNESS, [logit(solid.roughness as f32)]);
        gaussians.set(index, first + ALBEDO, solid.albedo.as_vec3().to_array().map(logit));
        gaussians.set(index, first + METALNESS, [logit((solid.metalness as f32).clamp(1e-4, 1.0 - 1e-4))]);
        gaussians.set(index, first + AMBIENT, [1.0; 3]);
    }
    gaussians
}

/// Scene of the solids and of their surface as views from all around show it.
fn scene(solids: &[Solid], step: f64) -> Scene {
    let gaussians = gaussians(solids, step);
    let cameras = orbit::sphere(&gaussians, VIEWS);
    let shading_model = ShadingModel::DEFERRED;
    let scene = Scene::unlit(gaussians, shading_model);
    let renderer = |shading| -> SceneRenderer {
        let scene = scene.clone().shaded(shading).unwrap();
        scene.renderer(CpuExecutor::new(), Channels::Layers).unwrap()
    };
    let (mut colors, mut materials) = (renderer(Shading::View), renderer(Shading::Physical));
    let mut render = |camera: &Camera, unlit: UnlitPicture| match unlit {
        UnlitPicture::Materials => materials.render(camera),
        UnlitPicture::Depths | UnlitPicture::Layers => colors.render(camera),
    };
    let surroundings = fused(&scene.gaussians, &cameras, VOXELS, None, &mut render).unwrap().unwrap();
    Scene { near_field: Some(Surface::shared(surroundings.near_field)), ..scene }
}

/// Views from three sides.
fn cameras(size: u32) -> [Camera; 3] {
    [[2.6, -2.0, 1.6], [-1.2, -3.0, 1.2], [0.8, 2.8, 2.4]]
        .map(|eye| Camera::look_at(eye.into(), Vec3::new(0.0, 0.0, 0.15), Vec3::Z, 0.6, size, size))
}

/// Pictures of the scene, with the means of squares of its pixels instead of them, in sRGB over
/// white.
fn rendered(scene: &Scene) -> Vec<Vec<f64>> {
    let mut renderer = scene.renderer(CpuExecutor::new(), Channels::Color).unwrap();
    let picture = |camera: &Camera| {
        let picture = renderer.picture(camera, [WHITE as f32; 3]).unwrap();
        let numbers: Vec<f64> = picture.iter().map(|byte| f64::from(*byte) / 255.0).collect();
        squares(&numbers)
    };
    cameras(SIZE * FINER).iter().map(picture).collect()
}

/// Means of squares of rendered pixels.
fn squares(picture: &[f64]) -> Vec<f64> {
    let (finer, count) = (FINER as usize, SIZE as usize);
    let mut means = vec![0.0; 3 * count * count];
    for (index, number) in picture.iter().enumerate() {
        let (channel, column, row) = (index % 3, index / 3 % (finer * count), index / 3 / (finer * count));
        means[3 * (row / finer * count + column / finer) + channel] += number / (finer * finer) as f64;
    }
    means
}

/// Path-traced pictures, in sRGB over white.
fn traced(world: &World<'_>, bounces: u32) -> Vec<Vec<f64>> {
    cameras(SIZE).iter().map(|camera| shown(&world.picture(&RayView::of(camera), bounces, PATHS, 1))).collect()
}

fn shown(traced: &[Traced]) -> Vec<f64> {
    let shown = |pixel: &Traced| {
        let color = pixel.radiance.map(|x| f64::from(srgb_from_linear(x as f32)).clamp(0.0, 1.0));
        color.map(|x| x * pixel.coverage + WHITE * (1.0 - pixel.coverage))
    };
    traced.iter().flat_map(shown).collect()
}

fn psnr(a: &[Vec<f64>], b: &[Vec<f64>]) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for (a, b) in a.iter().flatten().zip(b.iter().flatten()) {
        sum += (a - b) * (a - b);
        count += 1;
    }
    -10.0 * (sum / f64::from(count)).log10()
}

/// Intersection over union of the shadows on top of the slab.
fn shadow_iou(world: &World<'_>, a: &[Vec<f64>], b: &[Vec<f64>]) -> f64 {
    /// Red in sRGB below which the slab lies in shadow; in the sun it is above 0.6.
    const DARK: f64 = 0.4;
    let (mut both, mut either) = (0, 0);
    for ((camera, a), b) in cameras(SIZE).iter().zip(a).zip(b) {
        let view = RayView::of(camera);
        let is_floor =
            |pixel: usize| world.seen(&view, pixel).is_some_and(|(solid, normal)| solid == 0 && normal.z > 0.5);
        for pixel in (0..view.pixel_count()).filter(|pixel| is_floor(*pixel)) {
            let [a, b] = [a, b].map(|picture| picture[3 * pixel] < DARK);
            both += u32::from(a && b);
            either += u32::from(a || b);
        }
    }
    f64::from(both) / f64::from(either)
}

/// Gold shows the sky and the slab below it, and takes light from both.
#[test]
fn a_sky_lights_solids_as_paths_do() {
    let solids = solids(1.0);
    let mut scene = scene(&solids, STEP);
    scene.relight(&map(sky), UpAxis::Z);
    let found = rendered(&scene);
    let world = World::new(&solids, &sky, &[]);
    let [direct, once, all] = [0, 1, ALL].map(|bounces| psnr(&traced(&world, bounces), &found));
    println!("against paths without bounces {direct:.2} dB, with one {once:.2} dB, with all {all:.2} dB");
    assert!(all > 29.5, "{all} dB");
    assert!(direct < 23.0, "light between solids is missing: {direct} dB");

    // The file has no surface; its solids shadow and reflect each other all the same.
    let file = of_file(&scene);
    let read = psnr(&traced(&world, ALL), &rendered(&file));
    let open = psnr(&traced(&world, ALL), &rendered(&Scene { near_field: None, ..file }));
    println!("its file {read:.2} dB, traced only in the open {open:.2} dB");
    assert!(read > 33.0, "{read} dB");
    assert!(open < 32.0, "reflected solids are missing: {open} dB");
}

/// Scene of the relightable file of another, under its light.
fn of_file(scene: &Scene) -> Scene {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("solids.ply");
    let (all, around) = (visible(&scene.gaussians, 0.0), orbit::sphere(&scene.gaussians, VIEWS));
    let plain = PlainGaussians::bake(CpuExecutor::new(), scene, all, &around, 0, BakeMethod::Materials, |_, _| {});
    plain.unwrap().write(&path, GaussianFormat::Ply, scene, None, &[]).unwrap();
    read_relightable(&path, scene.light.clone(), &RenderOptions::full_precision(ExecutorChoice::Cpu)).unwrap()
}

#[test]
fn a_sun_casts_the_shadows_of_paths_and_lights_what_faces_away() {
    let solids = solids(0.0);
    let scene = scene(&solids, STEP);
    let choice: SunChoice = "30,50,3,0".parse().unwrap();
    let lit = |rays: usize| {
        let mut scene = scene.clone();
        let lamps = vec![choice.lamp(Vec3::Z, 0.0)];
        scene.add_lamps(SceneLamps { lamps, rays, occluder: scene.near_field.clone() }).unwrap();
        scene.darken();
        rendered(&scene)
    };
    let (preview, found) = (lit(1), lit(RAYS));
    // As for pictures of a light that turns.
    let mut again = scene.clone();
    let lamps = vec![choice.lamp(Vec3::Z, 0.0)];
    again.add_lamps(SceneLamps { lamps, rays: RAYS, occluder: scene.near_field.clone() }).unwrap();
    again.darken();
    let mut renderer = again.renderer(CpuExecutor::new(), Channels::Color).unwrap();
    let [camera, ..] = cameras(SIZE);
    let first = renderer.render(&camera).unwrap();
    renderer.set_scene(&again).unwrap();
    assert!(renderer.render(&camera).unwrap() == first, "light is reflected around a surface that is set again");
    let suns = [Sun { direction: direction(30.0, 50.0, Vec3::Z), irradiance: DVec3::splat(3.0) }];
    let dark = |_| DVec3::ZERO;
    let world = World::new(&solids, &dark, &suns);
    let [direct, all] = [0, ALL].map(|bounces| traced(&world, bounces));
    let iou = shadow_iou(&world, &direct, &preview);
    let [of_preview, of_all] = [psnr(&all, &preview), psnr(&all, &found)];
    println!("shadows agree to {iou:.3}; {of_all:.2} dB, as a preview {of_preview:.2} dB");
    println!("without bounces {:.2} dB", psnr(&direct, &preview));
    assert!(iou > 0.9, "{iou}");
    assert!(of_all > 28.0 && of_preview < 24.0, "{of_all} dB, {of_preview} dB");
}

/// Path-traced views from all around, with alpha.
fn photographs(world: &World<'_>, count: u32) -> Vec<View> {
    /// Pixels and paths along an edge.
    const FINE: (u32, usize) = (64, 6);
    let (size, paths) = FINE;
    let byte = |x: f64| (255.0 * x.clamp(0.0, 1.0)).round() as u8;
    let view = |index: u32| {
        let turn = 2.0 * core::f32::consts::PI * index as f32 / count as f32;
        let eye = Vec3::new(3.0 * turn.cos(), 3.0 * turn.sin(), [0.7, 1.6, 2.6][index as usize % 3]);
        let camera = Camera::look_at(eye, Vec3::new(0.0, 0.0, 0.15), Vec3::Z, 0.6, size, size);
        let pixels = world.picture(&RayView::of(&camera), ALL, paths, 1);
        let rgba = |pixel: &Traced| {
            let [red, green, blue] = pixel.radiance.map(|x| byte(srgb_from_linear(x as f32).into()));
            [red, green, blue, byte(pixel.coverage)]
        };
        View {
            name: index.to_string(),
            camera,
            rgba: pixels.iter().flat_map(rgba).collect(),
            unclipped: None,
            normals: None,
        }
    };
    (0..count).map(view).collect()
}

/// Correlation of two lights over the directions above the horizon.
fn correlation(light: &Environment<Vec<f32>>, truth: impl Fn(DVec3) -> DVec3) -> f64 {
    let grid = (0..40).flat_map(|up| (0..160).map(move |around| (up, around)));
    let directions: Vec<[f64; 3]> = grid
        .map(|(up, around)| {
            let (z, turn) = ((f64::from(up) + 0.5) / 40.0, 2.0 * PI * f64::from(around) / 160.0);
            let flat = (1.0 - z * z).sqrt();
            [flat * turn.cos(), flat * turn.sin(), z]
        })
        .collect();
    let found = latlong::radiance_along(&radiance(light), light.resolution, &directions);
    let sum = |found: &[f32; 3]| found.iter().map(|number| f64::from(*number)).sum::<f64>();
    let truth = directions.iter().map(|direction| truth(DVec3::from(*direction)).element_sum());
    let pairs: Vec<[f64; 2]> = found.iter().map(sum).zip(truth).map(|(found, truth)| [found, truth]).collect();
    let means = [0, 1].map(|k| pairs.iter().map(|pair| pair[k]).sum::<f64>() / pairs.len() as f64);
    let moment = |a: usize, b: usize| pairs.iter().map(|pair| (pair[a] - means[a]) * (pair[b] - means[b])).sum::<f64>();
    moment(0, 1) / (moment(0, 0) * moment(1, 1)).sqrt()
}

/// Gold mirrors the sky; slab and block see the rest of it.
#[test]
fn the_light_of_path_traced_pictures_is_found() {
    const PICTURES: u32 = 9;
    const STEPS: u32 = 120;
    let solids = solids(1.0);
    let mut scene = scene(&solids, COARSE_STEP);
    let all = photographs(&World::new(&solids, &sky, &[]), PICTURES);
    let (fitted, others): (Vec<_>, Vec<_>) = all.into_iter().enumerate().partition(|(index, _)| index % 4 > 0);
    let [fitted, others] = [fitted, others].map(|part| part.into_iter().map(|(_, view)| view).collect::<Vec<View>>());
    let fit =
        LightFit { pictures: &fitted, background: [WHITE as f32; 3], iterations: STEPS, executor: ExecutorChoice::Cpu };
    let mut steps = Vec::new();
    let found = scene.fit_light(&fit, |step, _| {
        steps.push(step);
        true
    });
    let found = found.unwrap().expect("nothing stops it");
    assert_eq!(steps, (1..=STEPS).collect::<Vec<_>>());
    let stopped = scene.fit_light(&fit, |step, _| step < 3).unwrap();
    assert_eq!(stopped, None, "the caller stops it");

    let alike = correlation(&found, sky);
    let map_of_found = latlong::from_cube(&radiance(&found), found.resolution, 256, 128, UpAxis::Z);
    let truth: Vec<Vec<f64>> = others.iter().map(|view| numbers(&bytes_over_white(view))).collect();
    let [with_found, with_true] = [map_of_found, map(sky)].map(|map| {
        scene.relight(&map, UpAxis::Z);
        let mut renderer = scene.renderer(CpuExecutor::new(), Channels::Color).unwrap();
        let picture = |view: &View| numbers(&renderer.picture(&view.camera, [WHITE as f32; 3]).unwrap());
        psnr(&truth, &others.iter().map(picture).collect::<Vec<_>>())
    });
    println!("correlation {alike:.3}; {with_found:.2} dB under the found light, {with_true:.2} dB under the true one");
    assert!(alike > 0.85, "{alike}");
    assert!(with_found > with_true - 1.0, "{with_found} dB, {with_true} dB");
}

/// Bytes as numbers in \[0, 1\].
fn numbers(bytes: &[u8]) -> Vec<f64> {
    bytes.iter().map(|byte| f64::from(*byte) / 255.0).collect()
}

/// Picture of a view over white, in rows of pixels.
fn bytes_over_white(view: &View) -> Vec<u8> {
    let over = |color: u8, alpha: u8| 255 - ((255 - u32::from(color)) * u32::from(alpha) / 255) as u8;
    view.rgba.as_chunks::<4>().0.iter().flat_map(|&[r, g, b, a]| [r, g, b].map(|color| over(color, a))).collect()
}
