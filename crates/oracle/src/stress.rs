//! Named scenes at the limits of valid input, for which every executor must return finite results.

use crate::scenes::{camera, random_cloud, random_environment};
use glam::{Mat3, Vec3};
use specula_core::{
    camera::{Camera, NEAR, near_of},
    random,
    scene::{
        ALBEDO, AMBIENT, DIFFUSE, Environment, Gaussians, LOG_SCALE, Layout, MEAN, METALNESS, NORMAL_RESIDUAL_1,
        NORMAL_RESIDUAL_2, OPACITY, QUAT, ROUGHNESS, RadianceActivation, TINT, len_of_values,
    },
    shade::ShadingRules,
};

/// Gaussians on the host.
type Cloud = Gaussians<Vec<f32>>;

/// Scene and its ground-truth picture.
#[derive(Clone, Debug)]
pub struct Case {
    /// Name of the difficulty.
    pub name: &'static str,
    /// The Gaussians, all of [`LAYOUT`].
    pub cloud: Cloud,
    /// Views.
    pub camera: Camera,
    /// The light, if it matters.
    pub environment: Option<Environment<Vec<f32>>>,
    /// Background in sRGB.
    pub background: [f32; 3],
    /// Alpha of the ground truth.
    pub alpha: u8,
    /// True if much of the picture depends on rounding, so tests check little more than finiteness.
    pub is_on_edge: bool,
}

/// Layout of the Gaussians of every case.
pub const LAYOUT: Layout = Layout::shaded(Some(1));
/// Texels along an edge of every light's face.
pub const RESOLUTION: usize = 16;
/// Raw numbers with a sigmoid of practically zero or one.
const SATURATED: f32 = 30.0;
/// The raw number whose sigmoid is 1/255.
const FAINT: f32 = -5.537_334;

impl Case {
    /// Scene without a light, in front of a grey wall, with an opaque ground truth.
    pub fn new(name: &'static str, camera: Camera, cloud: Cloud) -> Self {
        Self { name, cloud, camera, environment: None, background: [0.2, 0.5, 0.8], alpha: u8::MAX, is_on_edge: false }
    }

    /// The same case, marked as sensitive to rounding.
    fn on_edge(self) -> Self {
        Self { is_on_edge: true, ..self }
    }

    /// The same under a light.
    #[must_use]
    pub fn lit(self, environment: Environment<Vec<f32>>) -> Self {
        Self { environment: Some(environment), ..self }
    }

    /// The same with physical materials: black, white and saturated albedos, dielectrics and
    /// metals, occluded, unoccluded and next to bright surfaces.
    #[must_use]
    pub fn with_materials(&self) -> Self {
        let layout = LAYOUT.physical();
        let count = self.cloud.count;
        let mut cloud = Cloud { count, layout, values: vec![0.0; len_of_values(count, layout)] };
        for gaussian in 0..count {
            for plane in 0..LAYOUT.plane_count() {
                cloud.set(gaussian, plane, self.cloud.get::<1>(gaussian, plane));
            }
            let raw = |k: usize| [-SATURATED, 0.0, SATURATED][gaussian / k % 3];
            let first = LAYOUT.sh_end();
            cloud.set(gaussian, first + ALBEDO, [raw(1), raw(3), raw(9)]);
            cloud.set(gaussian, first + METALNESS, [raw(2)]);
            cloud.set(gaussian, first + AMBIENT, [[0.0; 3], [1.0; 3], [4.0, 0.5, 0.0]][gaussian / 4 % 3]);
        }
        Self { cloud, ..self.clone() }
    }

    /// Shading rules for the case: light per Gaussian and per pixel, if there is a light.
    pub fn shadings(&self) -> &'static [ShadingRules] {
        match self.environment {
            Some(_) => &[ShadingRules::PAPER, ShadingRules::DEFERRED],
            None => &[ShadingRules::PAPER],
        }
    }

    /// Ground truth of noise: red, green, blue and alpha of each pixel.
    pub fn picture(&self) -> Vec<u8> {
        let pixels = u64::from(self.camera.width * self.camera.height);
        let byte = |k: u64| if k % 4 == 3 { self.alpha } else { (random::bits(9, 0, k) >> 56) as u8 };
        (0..4 * pixels).map(byte).collect()
    }

    /// The same scene with other last digits: numbers of the camera, the attributes and the light
    /// change by up to the relative amount `share`. The change of results shows the effect of
    /// rounding; near a cutoff, numbers cross it. Means are unchanged, so equal depths stay equal.
    #[must_use]
    pub fn nudged(&self, share: f32, seed: u64) -> Self {
        let factor = |kind: u64, number: u64| 1.0 + share * (2.0 * random::uniform(seed, kind, number) - 1.0);
        let mut case = self.clone();
        let mut numbers = 0..;
        let mut nudge = |number: &mut f32| *number *= factor(0, numbers.next().expect("numbers do not end"));
        let mut turn = self.camera.camera_from_world.to_cols_array();
        turn.iter_mut().for_each(&mut nudge);
        case.camera.camera_from_world = Mat3::from_cols_array(&turn);
        case.camera.focal_px.iter_mut().for_each(&mut nudge);
        case.camera.principal_px.iter_mut().for_each(&mut nudge);
        for plane in LOG_SCALE..LAYOUT.plane_count() {
            // Axes of equal length remain equal.
            let kind = if (LOG_SCALE..QUAT).contains(&plane) { LOG_SCALE } else { plane };
            // The rounding of logarithms and logits is relative to at least one.
            let is_raw = !(QUAT..OPACITY).contains(&plane) && plane < LAYOUT.sh_start();
            for gaussian in 0..self.cloud.count {
                let factor = factor(kind as u64, gaussian as u64);
                let [number] = self.cloud.get(gaussian, plane);
                let moved = if is_raw && number.abs() < 1.0 { number + (factor - 1.0) } else { number * factor };
                case.cloud.set(gaussian, plane, [moved]);
            }
        }
        if let Some(environment) = &mut case.environment {
            for (number, texel) in (0..).zip(&mut environment.values) {
                *texel *= factor(LAYOUT.plane_count() as u64, number);
            }
        }
        case
    }
}

/// Scene with an error that a sample of pixels easily underestimates, and its views.
#[derive(Clone, Debug)]
pub struct StressScene {
    /// Name of the difficulty.
    pub name: &'static str,
    /// The Gaussians, all of [`LAYOUT`]; there is no light.
    pub cloud: Cloud,
    /// Views.
    pub cameras: Vec<Camera>,
    /// Background in sRGB.
    pub background: [f32; 3],
}

/// Scenes that hide the effect of cutoffs: much of the truncated part is faint, wide, thin or deep,
/// and at another position in every view. `views` views of each.
pub fn stress_scenes(views: usize) -> Vec<StressScene> {
    let scene = |name: &'static str, cloud: Cloud, camera: &dyn Fn(f32) -> Camera| {
        let cameras = (0..views).map(|k| camera((k as f32 + 0.5) / views as f32)).collect();
        StressScene { name, cloud, cameras, background: [0.2, 0.5, 0.8] }
    };
    let front = |share: f32| arc(share, Vec3::ZERO, [160, 112]);
    let large = |share: f32| arc(share, Vec3::ZERO, [288, 192]);
    let far_away = Vec3::new(1e5, -1e5, 1e5);
    vec![
        scene("haze below the least alpha beside solid splats", haze_beside_solids(), &large),
        scene("wide faint splats", wide_and_faint(), &front),
        scene("10 000 layers", stacked(), &|share| arc(share, Vec3::ZERO, [48, 40])),
        scene("needles at all angles", needles(), &front),
        scene("a world 100 000 units away", moved(&random_cloud(300, LAYOUT, 51), far_away), &|share| {
            arc(share, far_away, [96, 64])
        }),
        scene("the eye inside of a cloud", around_the_eye(), &|share| {
            let (sin, cos) = (share * core::f32::consts::TAU).sin_cos();
            let eye = 0.3 * Vec3::new(cos, sin, 0.2);
            Camera::look_at(eye, 4.0 * eye, Vec3::Z, 0.9, 96, 64)
        }),
    ]
}

/// A view from an arc of 80 degrees in front of a point.
fn arc(share: f32, place: Vec3, [width, height]: [u32; 2]) -> Camera {
    let (sin, cos) = ((share - 0.5) * 80.0_f32.to_radians()).sin_cos();
    let from = place + Vec3::new(3.2 * sin, -3.2 * cos, 0.6 * (share - 0.5));
    Camera::look_at(from, place, Vec3::Z, 0.7, width, height)
}

/// Left: haze of splats far below 1/255 with a total coverage of a few hundredths. Right: solid
/// splats, on which other cutoffs have a larger effect.
fn haze_beside_solids() -> Cloud {
    const HAZE: usize = 200;
    changed(HAZE + 250, 50, |cloud, k| {
        let (width, side) = if k < HAZE { (0.35, -0.65) } else { (0.1, 0.65) };
        cloud.set(k, MEAN, [side + draw(k, 0, -0.6, 0.6), draw(k, 1, -0.6, 0.6), draw(k, 2, -0.6, 0.6)]);
        cloud.set(k, LOG_SCALE, [0, 1, 2].map(|axis| (width * draw(k, 3 + axis, 0.6, 1.4)).ln()));
        cloud.set(k, OPACITY, [if k < HAZE { -8.0 } else { 2.0 }]);
    })
}

/// Splats as wide as the picture, with a large part beyond two standard deviations.
fn wide_and_faint() -> Cloud {
    changed(400, 52, |cloud, k| {
        cloud.set(k, LOG_SCALE, [0, 1, 2].map(|axis| draw(k, axis, 0.15, 0.5).ln()));
        cloud.set(k, OPACITY, [draw(k, 3, -4.5, -3.0)]);
    })
}

/// Thin layers behind each other in different colours.
fn stacked() -> Cloud {
    changed(10_000, 53, |cloud, k| {
        cloud.set(k, MEAN, [draw(k, 0, -0.3, 0.3), draw(k, 1, -1.0, 1.0), draw(k, 2, -0.3, 0.3)]);
        cloud.set(k, LOG_SCALE, [0.6_f32.ln(), 0.01_f32.ln(), 0.6_f32.ln()]);
        cloud.set(k, QUAT, [1.0, 0.0, 0.0, 0.0]);
        cloud.set(k, OPACITY, [draw(k, 3, -9.0, -4.0)]);
    })
}

/// Long, thin splats, many of them much narrower than a pixel.
fn needles() -> Cloud {
    changed(500, 54, |cloud, k| {
        cloud.set(k, LOG_SCALE, [draw(k, 0, 0.3, 1.5).ln(), draw(k, 1, -9.0, -4.0), draw(k, 2, -9.0, -4.0)]);
    })
}

/// A cloud through which the eye moves.
fn around_the_eye() -> Cloud {
    changed(400, 55, |cloud, k| {
        cloud.set(k, MEAN, [0, 1, 2].map(|axis| draw(k, axis, -1.5, 1.5)));
        cloud.set(k, OPACITY, [draw(k, 3, -5.0, 2.0)]);
    })
}

/// The same Gaussians elsewhere.
fn moved(cloud: &Cloud, by: Vec3) -> Cloud {
    let mut cloud = cloud.clone();
    for gaussian in 0..cloud.count {
        let mean = Vec3::from_array(cloud.get(gaussian, MEAN)) + by;
        cloud.set(gaussian, MEAN, mean.to_array());
    }
    cloud
}

/// Every case.
pub fn every_case() -> Vec<Case> {
    [shapes(), opacities(), places(), orders(), surfaces(), lights(), pictures()].concat()
}

/// The view of most cases.
fn view() -> Camera {
    camera(48, 32)
}

/// A view along +z from 4 in front of the origin: depths are z + 4, rounded in any way.
fn straight(width: u32, height: u32) -> Camera {
    Camera::look_at(Vec3::new(0.0, 0.0, -4.0), Vec3::ZERO, Vec3::NEG_Y, 0.7, width, height)
}

/// Random Gaussians, changed one by one.
fn changed(count: usize, seed: u64, mut change: impl FnMut(&mut Cloud, usize)) -> Cloud {
    let mut cloud = random_cloud(count, LAYOUT, seed);
    (0..count).for_each(|gaussian| change(&mut cloud, gaussian));
    cloud
}

fn scaled(count: usize, seed: u64, scales: [f32; 3]) -> Cloud {
    changed(count, seed, |cloud, k| cloud.set(k, LOG_SCALE, scales.map(f32::ln)))
}

/// Uniform between two bounds.
fn draw(gaussian: usize, stream: u64, low: f32, high: f32) -> f32 {
    low + (high - low) * random::uniform(17, stream, gaussian as u64)
}

fn shapes() -> Vec<Case> {
    let exponents = [-100.0, -40.0, -20.0, 0.0, 20.0, 40.0, 100.0];
    let quats = [
        [0.0; 4],
        [1e-30, 0.0, 0.0, 0.0],
        [1e-13, 2e-13, -1e-13, 1e-13],
        [2e-12, 1e-12, -1e-12, 3e-12],
        [1e30, -1e30, 2e30, 1e30],
        [3e38, 3e38, -3e38, 3e38],
        [1.0, -1e-20, 1e-20, 1e-38],
        [-0.0, 0.0, -0.0, 1.0],
    ];
    vec![
        Case::new("needles", view(), scaled(60, 1, [10.0, 1e-5, 1e-5])),
        Case::new("needles of 100 000 pixels", view(), scaled(40, 2, [1e4, 1e-2, 1e-2])),
        Case::new("pancakes", view(), scaled(60, 3, [10.0, 10.0, 1e-5])),
        Case::new("dust", view(), scaled(2000, 4, [1e-9, 1e-9, 1e-9])),
        Case::new("balls of 100 000 pixels", view(), scaled(40, 5, [1e4; 3])),
        Case::new("balls of 10 000 000 000 pixels", view(), scaled(20, 5, [1e9; 3])),
        Case::new(
            "every order of magnitude",
            view(),
            changed(343, 6, |cloud, k| {
                cloud.set(k, LOG_SCALE, [exponents[k % 7], exponents[k / 7 % 7], exponents[k / 49]]);
            }),
        ),
        Case::new(
            "quats of no length and of any",
            view(),
            changed(64, 7, |cloud, k| cloud.set(k, QUAT, quats[k % quats.len()])),
        ),
    ]
}

fn opacities() -> Vec<Case> {
    let logits = [-1e30, -100.0, FAINT - 1e-3, FAINT + 1e-3, 0.0, 16.0, 20.723, 100.0, 1e30];
    let layers = |count: usize, logit: f32, scale: f32| {
        changed(count, 8, |cloud, k| {
            cloud.set(k, MEAN, [0.0, 0.0, draw(k, 0, -1.0, 1.0)]);
            cloud.set(k, LOG_SCALE, [scale.ln(); 3]);
            cloud.set(k, OPACITY, [logit]);
        })
    };
    vec![
        Case::new(
            "opacities from nothing to all",
            view(),
            changed(90, 9, |cloud, k| cloud.set(k, OPACITY, [logits[k % logits.len()]])),
        ),
        Case::new("a wall of opaque layers", straight(32, 32), layers(5000, 20.723, 0.3)),
        Case::new("5000 layers of glass", straight(32, 32), layers(5000, -4.0, 0.3)),
        Case::new("haze above the least alpha", straight(32, 32), layers(1000, FAINT + 1e-3, 1e3)),
        Case::new("haze below the least alpha", straight(32, 32), layers(1000, FAINT - 1e-3, 1e3)),
        Case::new("haze at the least alpha", straight(32, 32), layers(1000, FAINT, 1e3)).on_edge(),
        Case::new("100 000 splats that fill the picture", straight(16, 16), layers(100_000, -3.0, 1e2)),
    ]
}

fn places() -> Vec<Case> {
    let eye = view().position;
    let around_the_eye = |count: usize, reach: f32| {
        changed(count, 10, |cloud, k| {
            let place = [0, 1, 2].map(|axis| eye[axis] + draw(k, axis as u64, -reach, reach));
            cloud.set(k, MEAN, place);
            cloud.set(k, LOG_SCALE, [draw(k, 3, -4.6, 2.3), draw(k, 4, -4.6, 2.3), draw(k, 5, -4.6, 2.3)]);
        })
    };
    let moved = |name: &'static str, offset: f32| {
        let mut camera = view();
        camera.position += Vec3::splat(offset);
        let cloud = changed(60, 11, |cloud, k| {
            let mean = cloud.get::<3>(k, MEAN).map(|x| x + offset);
            cloud.set(k, MEAN, mean);
        });
        Case::new(name, camera, cloud)
    };
    let sized = |name: &'static str, size: f32| {
        let mut camera = view();
        camera.position *= size;
        camera.near = near_of(size);
        let cloud = changed(60, 12, |cloud, k| {
            let (mean, scales) = (cloud.get::<3>(k, MEAN), cloud.get::<3>(k, LOG_SCALE));
            cloud.set(k, MEAN, mean.map(|x| x * size));
            cloud.set(k, LOG_SCALE, scales.map(|x| x + size.ln()));
        });
        Case::new(name, camera, cloud)
    };
    // A GPU may divide by the last as by infinity.
    let depths = [-1e30, -1.0, -0.0, 0.0, 1e-45, 1e-30, 0.1, 0.999 * NEAR, 1.001 * NEAR, 1.0, 1e10, 1e30, 3e38];
    vec![
        Case::new("the eye inside of Gaussians", view(), around_the_eye(60, 0.5)),
        Case::new("Gaussians through the plane of the eye", view(), around_the_eye(200, 1.0)),
        Case::new("Gaussians in the eye itself", view(), around_the_eye(20, 0.0)),
        Case::new(
            "depths of every size and sign",
            straight(48, 32),
            changed(96, 13, |cloud, k| {
                let depth = depths[k % depths.len()];
                cloud.set(k, MEAN, [0.1 * depth, -0.1 * depth, depth - 4.0]);
            }),
        ),
        Case::new(
            "far beside the picture",
            view(),
            changed(100, 14, |cloud, k| {
                let mean = cloud.get::<3>(k, MEAN).map(|x| 1e3 * x);
                cloud.set(k, MEAN, mean);
                cloud.set(k, LOG_SCALE, [5.0, draw(k, 0, -3.0, 5.0), 0.0]);
            }),
        ),
        Case::new(
            "nowhere",
            view(),
            changed(60, 15, |cloud, k| {
                let wrong = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 3e38, -3e38];
                cloud.set(k, MEAN + k % DIFFUSE, [wrong[k / DIFFUSE % wrong.len()]]);
            }),
        ),
        moved("a world that is far away", 1e6),
        sized("a world of a millionth", 1e-6),
        sized("a world of a million", 1e6),
    ]
}

fn orders() -> Vec<Case> {
    let grid = |depth: fn(usize) -> f32| {
        changed(400, 16, |cloud, k| {
            cloud.set(k, MEAN, [draw(k, 0, -0.8, 0.8), draw(k, 1, -0.6, 0.6), depth(k)]);
        })
    };
    vec![
        Case::new("all at one depth", straight(48, 32), grid(|_| 0.25)),
        Case::new(
            "depths one last place apart",
            straight(48, 32),
            grid(|k| -3.5 + (k % 3) as f32 * f32::EPSILON / 4.0),
        ),
    ]
}

fn surfaces() -> Vec<Case> {
    let raw = [-1e30, -100.0, -SATURATED, -9.21, 0.0, SATURATED, 100.0, 1e30];
    let grazing = |k: usize, first: i32| 10_f32.powi(first - (k % 4) as i32) * if k % 8 < 4 { 1.0 } else { -1.0 };
    let lit = |name: &'static str, cloud: Cloud| {
        Case::new(name, view(), cloud).lit(random_environment(RESOLUTION, RadianceActivation::Exponential, 1))
    };
    vec![
        lit("every roughness", changed(64, 20, |cloud, k| cloud.set(k, ROUGHNESS, [raw[k % 8]]))),
        lit(
            "every colour and tint",
            changed(64, 21, |cloud, k| {
                cloud.set(k, DIFFUSE, [raw[k % 8], raw[k / 8], raw[7 - k % 8]]);
                cloud.set(k, TINT, [raw[k / 8], raw[7 - k / 8], raw[k % 8]]);
            }),
        ),
        lit(
            "harmonics of every size",
            changed(60, 22, |cloud, k| {
                let size = 10_f32.powi(k as i32 % 6 - 1);
                for plane in LAYOUT.sh_start()..LAYOUT.plane_count() {
                    cloud.set(k, plane, [size * draw(k, plane as u64, -1.0, 1.0)]);
                }
            }),
        ),
        lit("normals almost edge on", changed(64, 23, |cloud, k| seen_at(cloud, k, grazing(k, -1)))),
        lit("normals edge on", changed(64, 23, |cloud, k| seen_at(cloud, k, grazing(k, -6)))).on_edge(),
        lit(
            "normals that a residual takes away",
            changed(64, 24, |cloud, k| {
                // The shortest axis is z, as is the quat's: v + Δn₁ = 0 and v + Δn₂ = 0, or nearly.
                cloud.set(k, QUAT, [1.0, 0.0, 0.0, 0.0]);
                cloud.set(k, LOG_SCALE, [-1.0, -1.1, -2.0]);
                let nearly = [0.0, 1e-20, 1e-10, 1e-5][k % 4];
                cloud.set(k, NORMAL_RESIDUAL_1, [nearly, 0.0, -1.0]);
                cloud.set(k, NORMAL_RESIDUAL_2, [nearly, 0.0, -1.0]);
            }),
        )
        .on_edge(),
        lit(
            "axes of equal length",
            changed(64, 25, |cloud, k| {
                let apart = [0.0, 1e-6, -1e-6, 1e-3][k % 4];
                let mut scales = [-1.5; 3];
                scales[k / 4 % 3] += apart;
                cloud.set(k, LOG_SCALE, scales);
            }),
        ),
    ]
}

/// Turns a Gaussian so that its shortest axis, x, and the direction to the eye have this cosine.
fn seen_at(cloud: &mut Cloud, gaussian: usize, cosine: f32) {
    let view_dir = (view().position - Vec3::from_array(cloud.get(gaussian, MEAN))).normalize();
    let across = view_dir.any_orthonormal_vector();
    let axis = (view_dir * cosine + across * (1.0 - cosine * cosine).sqrt()).normalize();
    let turn = glam::Quat::from_rotation_arc(Vec3::X, axis);
    cloud.set(gaussian, QUAT, [turn.w, turn.x, turn.y, turn.z]);
    cloud.set(gaussian, LOG_SCALE, [-3.0, -1.5, -1.4]);
}

fn lights() -> Vec<Case> {
    let under = |name: &'static str, activation: RadianceActivation, texel: fn(usize) -> f32| {
        let mut light = random_environment(RESOLUTION, activation, 2);
        light.values.iter_mut().enumerate().for_each(|(k, value)| *value = texel(k));
        Case::new(name, view(), random_cloud(60, LAYOUT, 30)).lit(light)
    };
    vec![
        under("a light of the largest half floats", RadianceActivation::Identity, |k| [65504.0, 1e-8, 0.5][k % 3]),
        under("a sun", RadianceActivation::Identity, |k| if k == 1000 { 1e4 } else { 0.1 }),
        under("no light at all", RadianceActivation::Identity, |_| 0.0),
        under("logarithms of light of every size", RadianceActivation::Exponential, |k| {
            [-200.0, -87.0, 0.0, 11.0][k % 4]
        }),
    ]
}

fn pictures() -> Vec<Case> {
    let mut masked = Case::new("a picture that is masked out", view(), random_cloud(60, LAYOUT, 40));
    masked.alpha = 0;
    let mut wide = view();
    wide.focal_px = [2.0, 2.0];
    let mut narrow = view();
    narrow.focal_px = [1e5, 1e5];
    let mut beside = view();
    beside.principal_px = [-1e4, 1e4];
    let away = Camera::look_at(view().position, 2.0 * view().position, Vec3::Z, 0.7, 48, 32);
    let some = || random_cloud(60, LAYOUT, 41);
    vec![
        masked,
        Case::new("no Gaussians", view(), random_cloud(0, LAYOUT, 0)),
        Case::new("one Gaussian", view(), random_cloud(1, LAYOUT, 42)),
        Case::new("a picture of one pixel", camera(1, 1), some()),
        Case::new("a picture of one row", camera(70, 1), some()),
        Case::new("everything behind the eye", away, some()),
        Case::new("a view of 170 degrees", wide, some()),
        Case::new("a view through a telescope", narrow, some()),
        Case::new("a view far from the axis", beside, some()),
    ]
}
