//! Reflected rays: the hierarchy finds the nearest triangle, the picture is that of the plain
//! pipeline, and invariants of physics and geometry hold.

use fearless_simd::{Level, Simd, dispatch};
use glam::Vec3;
use proptest::prelude::*;
use specula_core::{
    camera::Camera,
    cubemap::FACE_COUNT,
    double::Double,
    executor::Renderer,
    near_field::{
        CULL_BACKFACES, Hit, INDEX_MAX, NEAR_ROUGHNESS_END, NEAR_ROUGHNESS_START, NODE_LEN, NearField, NearFieldError,
        NearSurface, Reflection, T_DONE, T_MISS, crossing, share_of_near, vertex_surface,
    },
    pipeline::render,
    prefilter::{LevelRange, PrefilterScheme},
    real::Real,
    rules::{Channels, LightLayer, RenderRules, channel},
    scene::{BLOCK, Environment, Gaussians, Image, Layout, RadianceActivation},
    shade::ShadingRules,
    vector::{Vec3 as Real3, vec3},
};
use specula_cpu::{CpuError, CpuExecutor, lanes::Lanes};
use specula_mesh::{
    Mesh,
    near_field::{SurfaceMeans, reflects_itself},
};
use specula_tests::{
    compare::{assert_psnr, psnr},
    near_fields::{gray, of_triangles, polished, random_near_field, rectangle},
    plain::{self, lift_environment, lift_gaussians},
    strategies::{random_cloud, random_environment, same_every_time, unit_vector},
};
use specula_train::evaluate::render_view;

/// `f32` on lanes against `f64`, as in other pictures: 1e-5 is 100 dB, a pixel whose ray hits the
/// other of two triangles brings a small picture down to 80 dB.
const SAME_FRAME: f64 = 75.0;
/// Rounding of a few dozen operations in `f32` on numbers near one.
const SAME_PLACE: f32 = 1e-4;
const RESOLUTION: usize = 16;

/// Nearest of all triangles, one after the other.
fn nearest<R: Real<Mask = bool>>(
    near_field: &NearField<Vec<f32>>,
    origin: Real3<R>,
    direction: Real3<R>,
) -> Option<Hit<R>> {
    let like = origin.x;
    let position = |vertex: usize| {
        let [x, y, z, ..] = near_field.vertex(vertex).map(|x| like.constant(x));
        vec3(x, y, z)
    };
    let mut hit: Option<Hit<R>> = None;
    for triangle in 0..near_field.triangle_count {
        let found =
            crossing(near_field.corners(triangle).map(position), origin, direction, like.constant(CULL_BACKFACES));
        let nearest = hit.map_or(like.constant(T_MISS), |hit| hit.distance);
        if found.distance.less(nearest) {
            hit = Some(Hit { distance: found.distance, triangle, weights: found.weights });
        }
    }
    hit
}

/// First hits of rays that are traced together, and whether they are blocked. A ray has an origin,
/// a direction and a reach.
#[inline(always)]
fn side_by_side<S: Simd>(
    simd: S,
    near_field: &NearField<Vec<f32>>,
    rays: &[(Real3<f32>, Real3<f32>, f32); BLOCK],
) -> ([Option<Hit<f32>>; BLOCK], [bool; BLOCK]) {
    let lanes = |of: &dyn Fn(&(Real3<f32>, Real3<f32>, f32)) -> f32| {
        Lanes::from_array(simd, core::array::from_fn(|lane| of(&rays[lane])))
    };
    let origin = vec3(lanes(&|ray| ray.0.x), lanes(&|ray| ray.0.y), lanes(&|ray| ray.0.z));
    let direction = vec3(lanes(&|ray| ray.1.x), lanes(&|ray| ray.1.y), lanes(&|ray| ray.1.z));
    let reach = lanes(&|ray| ray.2);
    let hits = near_field.first_hits(origin, direction, reach);
    let are_blocked = near_field.are_blocked(origin, direction, reach);
    let are_blocked = reach.constant(1.0).keep(are_blocked).to_array();
    let (distances, triangles) = (hits.distance.to_array(), hits.triangle.to_array());
    let weights = hits.weights.map(Lanes::to_array);
    let hit = |lane: usize| Hit {
        distance: distances[lane],
        triangle: triangles[lane] as usize,
        weights: weights.map(|weights| weights[lane]),
    };
    (
        core::array::from_fn(|lane| (distances[lane] < T_MISS).then(|| hit(lane))),
        are_blocked.map(|blocked| blocked == 1.0),
    )
}

proptest! {
    #![proptest_config(same_every_time())]

    /// The hierarchy only skips triangles that no ray hits: the same triangle at the same distance
    /// to the last bit, along axes as well.
    #[test]
    fn rays_hit_the_nearest_of_all_triangles(
        (count, seed) in (1..90_u64, any::<u64>()),
        origin in proptest::array::uniform3(-3.0..3.0_f32),
        direction in prop_oneof![
            4 => unit_vector().prop_map(|d| d.map(|x| x as f32)),
            1 => (0..3_usize, any::<bool>()).prop_map(|(axis, back)| {
                core::array::from_fn(|k| if k != axis { 0.0 } else if back { -1.0 } else { 1.0 })
            }),
        ],
    ) {
        let near_field = random_near_field(count, seed);
        prop_assert_eq!(near_field.check(), Ok(()));
        let (from, to) = (Real3::from(Vec3::from(origin)), Real3::from(Vec3::from(direction)));
        prop_assert_eq!(near_field.first_hit(from, to), nearest(&near_field, from, to));
        let [from, to] = [from, to].map(|v| v.map(|x| Double(f64::from(x))));
        let [ours, theirs] = [near_field.first_hit(from, to), nearest(&near_field, from, to)]
            .map(|hit| hit.map(|hit| (hit.triangle, hit.distance.0)));
        prop_assert_eq!(ours, theirs);
    }

    /// Sixteen rays side by side have the hits of each ray on its own within its reach; skipped
    /// rays hit nothing.
    #[test]
    fn rays_side_by_side_have_the_hits_of_single_rays(
        (count, seed) in (1..200_u64, any::<u64>()),
        rays in proptest::array::uniform16((
            proptest::array::uniform3(-3.0..3.0_f32),
            unit_vector(),
            prop_oneof![3 => Just(T_MISS), 2 => 0.0..4.0_f32, 1 => Just(T_DONE)],
        )),
    ) {
        let near_field = random_near_field(count, seed);
        let traced_rays = rays.map(|(origin, direction, reach)| {
            let direction = Real3::from(Vec3::from(direction.map(|x| x as f32)));
            (Real3::from(Vec3::from(origin)), direction, reach)
        });
        let (hits, are_blocked) = dispatch!(Level::new(), simd => side_by_side(simd, &near_field, &traced_rays));
        for (lane, (origin, direction, reach)) in traced_rays.into_iter().enumerate() {
            let expected = near_field.first_hit(origin, direction).filter(|hit| hit.distance < reach);
            let found = hits[lane];
            prop_assert_eq!(found.is_some(), expected.is_some());
            if let Some((found, expected)) = found.zip(expected) {
                prop_assert_eq!(found.triangle, expected.triangle);
                let least = SAME_PLACE * expected.distance.max(1.0);
                prop_assert!((found.distance - expected.distance).abs() < least);
                prop_assert!((0..2).all(|k| (found.weights[k] - expected.weights[k]).abs() < 100.0 * SAME_PLACE));
            }
            prop_assert_eq!(are_blocked[lane], near_field.is_blocked(origin, direction, reach));
        }
    }

    /// A ray hits a point inside a triangle there, at its distance and with its weights; from
    /// behind it does not.
    #[test]
    fn a_ray_hits_the_point_that_it_is_aimed_at(
        seed in any::<u64>(),
        (u, v) in (0.05..0.45_f32, 0.05..0.45_f32),
        from in unit_vector(),
        distance in 0.1..20.0_f32,
    ) {
        let near_field = random_near_field(1, seed);
        let [a, b, c] = [0, 1, 2].map(|k| Vec3::from_slice(&near_field.vertex(near_field.corners(0)[k])[..3]));
        let normal = (b - a).cross(c - a);
        let to_eye = Vec3::from(from.map(|x| x as f32));
        let cosine = to_eye.dot(normal.normalize());
        prop_assume!(cosine.abs() > 0.1 && normal.length() > 0.1);
        let target = a + u * (b - a) + v * (c - a);
        let hit = near_field.first_hit((target + distance * to_eye).into(), (-to_eye).into());
        if cosine < 0.0 {
            prop_assert_eq!(hit, None, "backs are not met");
        } else {
            let hit = hit.expect("it was aimed at");
            prop_assert!((hit.distance - distance).abs() < SAME_PLACE * distance.max(1.0));
            prop_assert!((hit.weights[0] - u).abs() < 100.0 * SAME_PLACE && (hit.weights[1] - v).abs() < 100.0 * SAME_PLACE);
        }
    }
}

#[test]
fn the_surface_of_a_hit_is_the_mean_of_its_corners() {
    let near_field = random_near_field(1, 5);
    let corners = near_field.corners(0).map(|vertex| vertex_surface(near_field.vertex(vertex)));
    let hit = |weights| near_field.surface(&Hit { distance: 1.0, triangle: 0, weights });
    for (weights, expected) in [([0.0, 0.0], corners[0]), ([1.0, 0.0], corners[1]), ([0.0, 1.0], corners[2])] {
        let found = hit(weights);
        assert_eq!((found.base, found.tint, found.roughness), (expected.base, expected.tint, expected.roughness));
    }
}

/// A wall across the reflection of a mirror: the ray is turned back where it came from.
#[test]
fn far_light_comes_from_where_the_ray_is_mirrored_a_second_time() {
    let toward = Vec3::new(0.6, 0.0, 0.8);
    let near = NearSurface { normal: (3.0 * -toward).into(), ..gray(0.25, 0.5, 0.0) };
    let reflection = Reflection::of_near(toward.into(), 0.2, &near);
    let back = Vec3::from(reflection.direction);
    assert!((back + toward).length() < 1e-6, "{back}");
    assert!((reflection.roughness - 0.2).abs() < 1e-6, "a mirror blurs nothing");
    let (own, of_near) = (Real3::splat(7.0), Real3::splat(2.0));
    assert_eq!(reflection.light(own, of_near), Real3::splat(1.25), "b + s L, and nothing from afar");
    assert_eq!(Reflection::of_far(toward.into(), 0.2).light(own, of_near), own);
    let rough = Reflection::of_near(toward.into(), 0.8, &NearSurface { roughness: 0.9, ..near });
    assert!((rough.roughness - (0.8_f32.powi(4) + 0.9_f32.powi(4)).powf(0.25).min(1.0)).abs() < 1e-6);
    assert_eq!(rough.light(own, of_near), own, "a rough surface sees more than one ray does");
    assert_eq!(Reflection::from_array(rough.to_array()).to_array(), rough.to_array());
}

/// Hits count in full for mirrors, not at all for rough surfaces, and ever less in between.
#[test]
fn single_rays_have_full_weight_only_for_mirrors() {
    let shares: Vec<f32> = (0..=100).map(|k| share_of_near(0.01 * k as f32)).collect();
    assert_eq!([shares[0], shares[25], shares[50], shares[100]], [1.0, 1.0, 0.0, 0.0]);
    assert!((share_of_near(0.5 * (NEAR_ROUGHNESS_START + NEAR_ROUGHNESS_END)) - 0.5).abs() < 1e-6);
    assert!(shares.windows(2).all(|pair| pair[1] <= pair[0]));
}

/// Rays at the limits of their numbers hit nothing or something, but end without a panic.
#[test]
fn rays_and_triangles_at_the_edge_of_numbers_are_traced() {
    let flat = [Vec3::ZERO, Vec3::X, 2.0 * Vec3::X];
    let needle = [Vec3::ZERO, Vec3::new(1e-7, 0.0, 0.0), Vec3::new(0.0, 1.0, 0.0)];
    let huge = [Vec3::new(-1e18, -1e18, 5.0), Vec3::new(1e18, -1e18, 5.0), Vec3::new(0.0, 1e18, 5.0)];
    let near_field = of_triangles(&[flat, needle, huge, [Vec3::ZERO; 3]].map(|corners| (corners, gray(1.0, 0.0, 1.0))));
    assert_eq!(near_field.check(), Ok(()));
    let numbers = [0.0, -0.0, 1.0, -1.0, 1e-30, -1e30, f32::MIN_POSITIVE, f32::MAX, f32::INFINITY, f32::NAN];
    let rays = numbers.iter().flat_map(|x| numbers.iter().map(move |y| (*x, *y)));
    let mut met = 0;
    for (x, y) in rays {
        for (origin, direction) in [(vec3(x, y, 0.0), vec3(0.0, 0.0, 1.0)), (vec3(0.1, 0.2, 9.0), vec3(x, 0.0, y))] {
            if let Some(hit) = near_field.first_hit(origin, direction) {
                met += 1;
                assert!(hit.distance > 0.0 && hit.distance < T_MISS, "{hit:?}");
                assert!(origin.x.is_finite() && direction.x.is_finite(), "{origin:?} {direction:?}");
            }
        }
    }
    assert!(met > 0, "the plane behind all others is met");
}

#[test]
fn damaged_near_fields_are_refused() {
    let whole = random_near_field(40, 3);
    let damaged = |change: &dyn Fn(&mut NearField<Vec<f32>>)| {
        let mut damaged = whole.clone();
        change(&mut damaged);
        damaged.check()
    };
    assert_eq!(damaged(&|_| {}), Ok(()));
    assert_eq!(damaged(&|field| field.vertex_count = 0), Err(NearFieldError::Size));
    assert_eq!(damaged(&|field| field.node_count = INDEX_MAX), Err(NearFieldError::Size));
    assert!(matches!(damaged(&|field| field.triangle_count -= 1), Err(NearFieldError::Length { .. })));
    for number in [f32::NAN, f32::INFINITY] {
        assert_eq!(
            damaged(&|field| *field.values.last_mut().expect("numbers") = number),
            Err(NearFieldError::NotFinite)
        );
        assert_eq!(damaged(&|field| field.offset = number), Err(NearFieldError::NotFinite));
    }
    assert_eq!(damaged(&|field| field.offset = -0.1), Err(NearFieldError::NotFinite));
    // The root leads to itself, to a missing node, or to a number that is not whole.
    for next in [0.0, -1.0, 0.5, 1e6] {
        assert_eq!(damaged(&|field| field.values[3] = next), Err(NearFieldError::Node { index: 0 }), "{next}");
    }
    let leaf = (0..whole.node_count).find(|node| whole.values[NODE_LEN * node + 7] > 0.0).expect("there are leaves");
    assert_eq!(
        damaged(&|field| field.values[NODE_LEN * leaf + 7] = 1e6),
        Err(NearFieldError::Node { index: leaf }),
        "more triangles than there are"
    );
    assert_eq!(
        damaged(&|field| field.values[NODE_LEN * leaf + 3] += 1.0),
        Err(NearFieldError::Node { index: leaf }),
        "triangles of another leaf"
    );
    let first = whole.triangles_start();
    for vertex in [whole.vertex_count as f32, -1.0, 0.25] {
        assert_eq!(damaged(&|field| field.values[first + 2] = vertex), Err(NearFieldError::Triangle { index: 0 }));
    }
    let cut = NearField { triangle_count: whole.triangle_count + 1, ..whole.with_values(whole.values.as_slice()) };
    let refused = CpuExecutor::new().upload_near_field(&cut).expect_err("it is cut short");
    assert!(matches!(refused, CpuError::NearField(NearFieldError::Length { .. })), "{refused}");
}

/// Every ray would be tested against every box and triangle, in pictures of a million rays.
#[test]
fn near_fields_whose_boxes_overlap_are_refused() {
    let mut field = random_near_field(4000, 3);
    assert_eq!(field.check(), Ok(()));
    let nodes = &mut field.values[..NODE_LEN * field.node_count];
    for node in nodes.as_chunks_mut::<NODE_LEN>().0 {
        [node[0], node[1], node[2]] = [-1e3; 3];
        [node[4], node[5], node[6]] = [1e3; 3];
    }
    let refused = field.check().expect_err("all boxes are alike");
    assert!(matches!(refused, NearFieldError::Overlap { cost } if cost > 5000), "{refused}");
}

/// Scene of random Gaussians under a random light.
struct Subject {
    gaussians: Gaussians<Vec<f32>>,
    light: Environment<Vec<f32>>,
    camera: Camera,
}

impl Subject {
    fn new(seed: u64) -> Self {
        let eye = Vec3::new(2.0, -3.0, 1.5);
        Self {
            gaussians: polished(random_cloud(80, Layout::shaded(Some(3)), seed)),
            light: random_environment(RESOLUTION, RadianceActivation::Identity, seed),
            camera: Camera::look_at(eye, Vec3::new(0.2, 0.0, 0.1), Vec3::Z, 0.7, 70, 45),
        }
    }

    fn rules(traces_near: bool, channels: Channels) -> RenderRules {
        RenderRules { traces_near, ..RenderRules::full(ShadingRules::DEFERRED, PrefilterScheme::Exact, channels) }
    }

    fn picture(&self, near_field: Option<&NearField<Vec<f32>>>, rules: &RenderRules) -> Image<Vec<f32>> {
        let mut exec = CpuExecutor::new();
        let mut light = exec.prefilter(&self.light, rules.scheme, LevelRange::ALL).expect("16 is a power of two");
        if let Some(near_field) = near_field {
            let uploaded = exec.upload_near_field(&near_field.with_values(&near_field.values)).expect("it is whole");
            light = exec.surround(light, &uploaded).expect("the CPU traces");
        }
        render_view(&mut exec, &self.gaussians, Some(&light), &self.camera, rules).expect("the CPU renders")
    }
}

fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|x| f64::from(*x)).collect()
}

#[test]
fn a_frame_with_a_near_field_is_that_of_the_plain_pipeline_in_every_layer() {
    for (seed, light_layer) in (1..).zip([LightLayer::Reflected, LightLayer::Indirect, LightLayer::Visibility]) {
        let subject = Subject::new(seed);
        let near_field = random_near_field(60, seed);
        let rules = RenderRules { light_layer, ..Subject::rules(true, Channels::Layers) };
        let ours = wide(&subject.picture(Some(&near_field), &rules).values);

        let operator = plain::Operator::new(RESOLUTION);
        let light = plain::prefilter::<Double>(&lift_environment(&subject.light), &operator);
        let gaussians = lift_gaussians(&subject.gaussians);
        let exact = |light: plain::Light<Double>| {
            let frame = plain::render(&gaussians, Some(&light), &subject.camera, &rules);
            frame.values.iter().map(|x| x.0).collect::<Vec<f64>>()
        };
        let without = exact(light.clone());
        let exact = exact(light.around(near_field));
        println!("seed {seed}: {:.1} dB; without {:.1} dB", psnr(&ours, &exact), psnr(&ours, &without));
        assert_psnr(&ours, &exact, SAME_FRAME);
        assert!(psnr(&ours, &without) < 50.0, "rays meet something");
    }
}

/// Reflections differ in colour, specular layer and light; all else of a picture stays.
#[test]
fn a_near_field_changes_only_light() {
    let subject = Subject::new(2);
    let rules = Subject::rules(true, Channels::Layers);
    let [with, without] = [Some(&random_near_field(60, 2)), None].map(|near_field| subject.picture(near_field, &rules));
    for plane in 0..with.channels {
        let is_of_light =
            matches!(plane, 0..channel::NORMAL | channel::SPECULAR..channel::RESIDUAL | channel::LIGHT..24);
        assert_eq!(with.plane(plane) != without.plane(plane), is_of_light, "plane {plane}");
    }
}

/// Light along the reflection is that of other surfaces there, plus the share of the far light that
/// they do not occlude.
#[test]
fn reflected_light_is_that_of_surfaces_and_of_the_far_light_between_them() {
    let subject = Subject::new(2);
    let near_field = random_near_field(60, 2);
    let layer = |near_field: Option<&NearField<Vec<f32>>>, light_layer| {
        let rules = RenderRules { light_layer, ..Subject::rules(near_field.is_some(), Channels::Layers) };
        subject.picture(near_field, &rules)
    };
    let [light, indirect, visibility] = [LightLayer::Reflected, LightLayer::Indirect, LightLayer::Visibility]
        .map(|light_layer| layer(Some(&near_field), light_layer));
    let far = layer(None, LightLayer::Reflected);
    let transmittance = light.plane(light.channels - 1);
    let mut met = 0;
    for plane in channel::LIGHT..channel::LIGHT + 3 {
        for (pixel, transmittance) in transmittance.iter().enumerate().filter(|(_, t)| **t < 0.9) {
            let [light, indirect, visible, far] =
                [&light, &indirect, &visibility, &far].map(|image| image.plane(plane)[pixel]);
            let share = visible / (1.0 - transmittance);
            assert!((light - (indirect + share * far)).abs() < SAME_PLACE * light.max(1.0), "pixel {pixel}");
            met += usize::from(share < 0.5);
        }
    }
    assert!(met > 0, "rays meet something");
    let open = layer(None, LightLayer::Visibility);
    assert!(open.plane(channel::LIGHT).iter().zip(transmittance).all(|(open, t)| (open - (1.0 - t)).abs() < 1e-6));
    assert!(layer(None, LightLayer::Indirect).plane(channel::LIGHT).iter().all(|light| *light == 0.0));
}

/// Channels that were not requested, and rules that do not trace, change no bit.
#[test]
fn channels_do_not_change_reflections_and_rules_turn_them_off() {
    let subject = Subject::new(3);
    let near_field = random_near_field(60, 3);
    let colors = |near_field, traces, channels| {
        let image = subject.picture(near_field, &Subject::rules(traces, channels));
        (0..3).flat_map(|c| image.plane(c).to_vec()).collect::<Vec<f32>>()
    };
    let traced = colors(Some(&near_field), true, Channels::Color);
    assert_eq!(traced, colors(Some(&near_field), true, Channels::Layers));
    let untraced = colors(Some(&near_field), false, Channels::Color);
    assert_eq!(untraced, colors(None, false, Channels::Color));
    assert_ne!(traced, untraced);
}

/// In a room that shines like the light outside, a reflection is the same wherever it ends.
#[test]
fn a_furnace_looks_the_same_with_and_without_walls() {
    const RADIANCE: f32 = 0.7;
    let mut subject = Subject::new(4);
    subject.light.values = vec![RADIANCE; 3 * FACE_COUNT * RESOLUTION * RESOLUTION];
    // The share that a wall does not reflect shines by itself.
    for tint in [0.0, 0.4] {
        let walls = rectangle(
            Vec3::new(-4.0, 4.0, -4.0),
            Vec3::new(8.0, 0.0, 0.0),
            Vec3::new(0.0, 0.0, 8.0),
            gray((1.0 - tint) * RADIANCE, tint, 0.5),
        );
        let behind = rectangle(
            Vec3::new(4.0, -6.0, -4.0),
            Vec3::new(-8.0, 0.0, 0.0),
            Vec3::new(0.0, 0.0, 8.0),
            gray((1.0 - tint) * RADIANCE, tint, 0.2),
        );
        let room = of_triangles(&[walls, behind].concat());
        let rules = Subject::rules(true, Channels::Color);
        let [with, without] = [Some(&room), None].map(|room| subject.picture(room, &rules));
        let worst = with.values.iter().zip(&without.values).fold(0.0_f32, |max, (a, b)| max.max((a - b).abs()));
        println!("tint {tint}: {worst:.1e}");
        assert!(worst < SAME_PLACE, "tint {tint}: {worst}");
        let dark =
            of_triangles(&rectangle(Vec3::new(-4.0, 4.0, -4.0), 8.0 * Vec3::X, 8.0 * Vec3::Z, gray(0.0, 0.0, 0.5)));
        let dark = subject.picture(Some(&dark), &rules);
        assert!(dark.values.iter().zip(&without.values).any(|(a, b)| (a - b).abs() > 0.05), "the walls are met");
    }
}

#[test]
fn pictures_do_not_depend_on_threads() {
    let subject = Subject::new(5);
    let near_field = random_near_field(60, 5);
    let rules = Subject::rules(true, Channels::Layers);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("there are threads");
        pool.install(|| subject.picture(Some(&near_field), &rules))
    };
    let one = on(1);
    assert!(one.values.iter().zip(&on(3).values).all(|(a, b)| a.to_bits() == b.to_bits()));
}

#[test]
fn a_frame_without_depths_stays_as_it_is() {
    let subject = Subject::new(6);
    let mut exec = CpuExecutor::new();
    let rules = Subject::rules(false, Channels::Color);
    let light = exec.prefilter(&subject.light, rules.scheme, LevelRange::ALL).expect("16 is a power of two");
    let near_field = random_near_field(60, 6);
    let uploaded = exec.upload_near_field(&near_field.with_values(&near_field.values)).expect("it is whole");
    let around = exec.surround(light.clone(), &uploaded).expect("the CPU traces");
    let traced = RenderRules { traces_near: true, ..rules };
    assert_eq!(rules.blended(subject.gaussians.layout), Channels::Lit, "no depths");
    assert_eq!(traced.blended(subject.gaussians.layout), Channels::Surface, "depths where rays start");
    let mut frames = [&light, &around].map(|light| {
        let mut splats = exec.project(&subject.gaussians, &subject.camera).expect("the CPU projects");
        let colors =
            exec.shade(&subject.gaussians, &subject.camera, &mut splats, Some(light), &rules).expect("it shades");
        let tiles = exec.bin(&splats, &subject.camera).expect("the CPU bins");
        let surface = exec.blend(&splats, &colors, &tiles, &subject.camera).expect("the CPU blends");
        exec.trace(surface, light, &subject.camera).expect("the CPU traces")
    });
    assert!(frames[0] == frames[1]);
    frames.reverse();
    let [with, _] = frames;
    let shaded = exec.shade_pixels(with, Some(&around), &subject.camera, &rules).expect("the CPU shades");
    let plain = render(&mut exec, &subject.gaussians, Some(&light), &subject.camera, &rules).expect("the CPU renders");
    assert!(shaded == plain);
}

/// Sphere of 12 × 24 patches around a centre.
fn sphere(center: Vec3, radius: f32) -> Mesh {
    const RINGS: u32 = 24;
    const AROUND: u32 = 48;
    let mut mesh = Mesh::default();
    for (ring, segment) in (0..=RINGS).flat_map(|ring| (0..AROUND).map(move |segment| (ring, segment))) {
        let polar = core::f32::consts::PI * ring as f32 / RINGS as f32;
        let around = core::f32::consts::TAU * segment as f32 / AROUND as f32;
        let normal = Vec3::new(polar.sin() * around.cos(), polar.sin() * around.sin(), polar.cos());
        mesh.positions.push((center + radius * normal).to_array());
        mesh.normals.push(normal.to_array());
        mesh.colors.push([0.5; 3]);
    }
    for (ring, segment) in (0..RINGS).flat_map(|ring| (0..AROUND).map(move |segment| (ring, segment))) {
        let at = |ring: u32, segment: u32| ring * AROUND + segment % AROUND;
        let [a, b, c, d] = [at(ring, segment), at(ring + 1, segment), at(ring + 1, segment + 1), at(ring, segment + 1)];
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
    mesh
}

fn joined(mut one: Mesh, other: Mesh) -> Mesh {
    let first = one.positions.len() as u32;
    one.positions.extend(other.positions);
    one.normals.extend(other.normals);
    one.colors.extend(other.colors);
    one.triangles.extend(other.triangles.into_iter().map(|triangle| triangle.map(|vertex| vertex + first)));
    one
}

/// Near field of a mesh whose vertices all have a tint of one half and a roughness of a tenth.
fn tinted(mesh: Mesh) -> NearField<Vec<f32>> {
    let mut near_field = SurfaceMeans::new(mesh, 0.05).near_field().expect("there are triangles");
    assert_eq!(near_field.check(), Ok(()), "it can be traced");
    let first = near_field.vertices_start();
    near_field.values[first..]
        .chunks_exact_mut(16)
        .for_each(|vertex| vertex[9..13].copy_from_slice(&[0.5, 0.5, 0.5, 0.1]));
    near_field
}

/// A single sphere does not see itself; two that nearly touch see each other.
#[test]
fn convex_scenes_do_not_reflect_themselves() {
    let eyes: Vec<Vec3> =
        (0..20).map(|k| 8.0 * Vec3::new((k as f32).cos(), (k as f32).sin(), 0.3).normalize()).collect();
    let one = tinted(sphere(Vec3::ZERO, 1.0));
    assert!(!reflects_itself(&one, &eyes));
    let two = tinted(joined(sphere(Vec3::ZERO, 1.0), sphere(Vec3::new(2.1, 0.0, 0.0), 1.0)));
    assert!(reflects_itself(&two, &eyes));
    assert!(!reflects_itself(&two, &[]), "nobody sees it");
    let mut rough = two;
    let first = rough.vertices_start();
    rough.values[first..].chunks_exact_mut(16).for_each(|vertex| vertex[12] = 0.8);
    assert!(!reflects_itself(&rough, &eyes), "a single ray says nothing of rough surfaces");
    // Without tint there is nothing to reflect.
    let dull = SurfaceMeans::new(joined(sphere(Vec3::ZERO, 1.0), sphere(Vec3::new(2.1, 0.0, 0.0), 1.0)), 0.05);
    let dull = dull.near_field().expect("there are triangles");
    let start = dull.vertices_start();
    let mut dull = dull;
    dull.values[start..].chunks_exact_mut(16).for_each(|vertex| vertex[9..12].fill(0.0));
    assert!(!reflects_itself(&dull, &eyes));
    assert!(SurfaceMeans::new(Mesh::default(), 0.05).near_field().is_none(), "there is no surface");
}
