//! Mathematical invariants: sums, symmetries, inverses, continuity, published values.

use core::f64::consts::{FRAC_PI_2, LN_2, PI, SQRT_2, TAU};
use proptest::{collection::vec, prelude::*};
use specula_core::{
    activation,
    antialias::LowPass,
    blend,
    camera::{Camera, CameraOf},
    color, covariance, cubemap,
    cutoffs::LOG2_ALPHA_MIN,
    double::Double,
    ggx, loss,
    pack::{self, Storage},
    prefilter::{self, Levels, PrefilterScheme},
    project::{self, Shape},
    random,
    real::Real,
    scene::{BLOCK, Layout, MEAN},
    sh,
    shade::{self, Material, ShadingRules},
    splat::Splat2d,
    split_sum,
    vector::{Mat3, Vec3},
};
use specula_tests::{
    compare::{ROUNDING_F32, ROUNDING_F64, assert_all_close, assert_close, relative_difference},
    number::{Number, take3, values_of, vector},
    strategies::{any_vector, camera, cloud, log_scales, quat, same_every_time, unit_vector},
};

/// Products of some twenty roundings of `f64`, amplified by the division by a variance.
const ROTATED_SCENE: f64 = 1e-9;
/// Difference of a picture that a camera in `f32` turns: its principal point is rounded.
const TURNED_CAMERA: f64 = 1e-6;
/// The authors' table was drawn by Monte Carlo; the noise of its texels near n·v = 0 is 2.4e-3.
const SPLIT_SUM_NOISE: f64 = 3e-3;
/// Half a unit in the last digit that is published.
const FOUR_DIGITS: f64 = 5.1e-5;

mod sums {
    use super::*;

    #[test]
    fn a_box_that_a_splat_does_not_reach_is_told_from_one_that_it_does() {
        let footprint = Splat2d::new([0.0_f32; 2], [1.0, 0.0, 1.0], 0.0);
        assert!(blend::may_overlap(&footprint, [2.0, 5.0], [-1.5, 1.5]));
        assert!(!blend::may_overlap(&footprint, [4.0, 7.0], [-1.5, 1.5]));
        assert!(!blend::may_overlap(&footprint, [-7.0, -4.0], [3.0, 6.0]));
    }

    #[test]
    fn texels_cover_the_sphere() {
        for resolution in [1, 2, 3, 4, 16, 64, 128] {
            assert_close(cubemap::solid_angles(resolution).sum::<f64>() / (4.0 * PI), 1.0, ROUNDING_F64);
        }
    }

    #[test]
    fn official_texel_weights_sum_to_what_was_published() {
        for (resolution, published) in [(16, 2.2656), (64, 2.4178), (512, 2.4613)] {
            let row = |row| (0..resolution).map(move |column| (column, row));
            let weights = (0..resolution).flat_map(row);
            let sum: f64 = weights.map(|(c, r)| prefilter::official_texel_weight(c, r, resolution)).sum();
            assert_close(sum, published, FOUR_DIGITS);
        }
    }

    proptest! {
        #![proptest_config(same_every_time())]

        #[test]
        fn blending_weights_and_final_transmittance_sum_to_one(strengths in vec(0.0..1.5_f64, 1..200)) {
            assert_close(weights_and_transmittance::<Double>(&strengths), 1.0, ROUNDING_F64);
            assert_close(weights_and_transmittance::<f32>(&strengths), 1.0, ROUNDING_F32);
        }

        #[test]
        fn a_box_that_a_splat_is_said_to_miss_has_no_pixel_of_it(
            corner in [-40.0..40.0_f32, -40.0..40.0_f32],
            root in [0.01..2.0_f32, -2.0..2.0_f32, 0.01..2.0_f32],
            opacity in 0.004..1.0_f32,
        ) {
            let footprint = Splat2d::new([0.0; 2], root, opacity.log2());
            let [dx, dy] = corner.map(|first| [first, first + 3.0]);
            let strength_at = |pixel: u8| {
                let [column, row] = [pixel % 4, pixel / 4].map(f32::from);
                blend::falloff(&footprint, corner[0] + column, corner[1] + row).log2_strength
            };
            let strongest = (0..16).map(strength_at).fold(f32::NEG_INFINITY, f32::max);
            prop_assert!(strongest < LOG2_ALPHA_MIN || blend::may_overlap(&footprint, dx, dy));
        }
        #[test]
        fn footprint_weights_sum_to_one_and_lie_inside_the_padded_map(d in any_vector(), log_resolution in 0..9_u32) {
            let resolution = 1 << log_resolution;
            let footprint = footprint_of(d, resolution);
            let weights = cubemap::bilinear_weights(footprint.right, footprint.lower).map(Double::value);
            assert_close(weights.iter().sum(), 1.0, ROUNDING_F64);
            prop_assert!(weights.iter().all(|w| *w >= 0.0), "a mean has no negative weights");
            let last = footprint.texel.0 as usize + resolution + 3;
            prop_assert!(last < cubemap::padded_len(resolution), "the lower right texel exists");
        }
    }

    fn weights_and_transmittance<R: Number>(strengths: &[f64]) -> f64 {
        let (mut weights, mut state) = (R::of(0.0), blend::PixelState::open(R::of(0.0)));
        for &strength in strengths {
            let step = blend::step(blend::alpha(R::of(strength).log2()), state);
            weights = weights + step.weight;
            state = step.behind;
        }
        (weights + state.final_transmittance).value()
    }

    #[test]
    fn harmonics_are_orthonormal() {
        const CONSTANTS_IN_F32: f64 = 1e-6;
        const POINTS: usize = 8; // the products of two harmonics of degree 3 are of degree 6
        // Gauss and Legendre: four rings are exact up to degree 7.
        let outer = (0.861_136_311_594_052_6, 0.347_854_845_137_453_8);
        let inner = (0.339_981_043_584_856_3, 0.652_145_154_862_546_1);
        let rings = [outer, inner].into_iter().flat_map(|(z, weight)| [(z, weight), (-z, weight)]);
        let mut products = [[0.0; sh::MAX_COUNT]; sh::MAX_COUNT];
        for ((z, weight), point) in rings.flat_map(|ring| (0..POINTS).map(move |point| (ring, point))) {
            let (sine, cosine) = (TAU * point as f64 / POINTS as f64).sin_cos();
            let radius = (1.0_f64 - z * z).sqrt();
            let basis = sh::basis::<Double>(vector([radius * cosine, radius * sine, z]), sh::MAX_COUNT);
            for (i, j) in (0..sh::MAX_COUNT).flat_map(|i| (0..sh::MAX_COUNT).map(move |j| (i, j))) {
                products[i][j] += basis[i].0 * basis[j].0 * weight * TAU / POINTS as f64;
            }
        }
        for (i, row) in products.iter().enumerate() {
            let unit: Vec<f64> = (0..sh::MAX_COUNT).map(|j| if i == j { 1.0 } else { 0.0 }).collect();
            assert_all_close(row, &unit, CONSTANTS_IN_F32);
        }
    }

    #[test]
    fn the_energy_angle_holds_that_share_of_the_lobe() {
        const STEPS: usize = 20_000;
        const MIDPOINT_RULE: f64 = 1e-4;
        let energy_within = |half_angle: f64, alpha_ggx: f64| {
            let angle = |k: usize| half_angle * (k as f64 + 0.5) / STEPS as f64;
            let ring = |t: f64| ggx::distribution(t.cos(), alpha_ggx) * t.cos() * t.sin() * TAU;
            (0..STEPS).map(|k| ring(angle(k))).sum::<f64>() * half_angle / STEPS as f64
        };
        for alpha_ggx in [0.0064, 0.04, 0.1] {
            assert_close(energy_within(FRAC_PI_2, alpha_ggx), 1.0, 10.0 * MIDPOINT_RULE);
            for energy in [0.5, 0.9, 0.95] {
                let angle = ggx::energy_angle(alpha_ggx, energy);
                assert!(angle < FRAC_PI_2, "this lobe is not cut by the horizon");
                assert_close(energy_within(angle / 2.0, alpha_ggx), energy, MIDPOINT_RULE);
            }
        }
    }
}

mod symmetries {
    use super::*;

    proptest! {
        #![proptest_config(same_every_time())]

        #[test]
        fn a_quat_and_its_negative_give_the_same_splat_and_surface(
            camera in camera(),
            mean in [-0.8..0.8_f64, -0.8..0.8, -0.8..0.8],
            scales in log_scales(-4.0..0.0),
            quat in quat(),
            residuals in vec(-0.4..0.4_f64, 6),
        ) {
            let camera = camera.lift(Double(0.0));
            let see = |quat: [f64; 4]| {
                let splat = project::project(&shape(mean, scales, quat), &camera);
                let material = Material {
                    mean: vector(mean),
                    quat: quat.map(Double),
                    log_scales: vector(scales),
                    diffuse: vector([0.1, 0.2, 0.3]),
                    tint: vector([0.3, 0.2, 0.1]),
                    roughness: Double(0.0),
                    normal_residuals: [vector([residuals[0], residuals[1], residuals[2]]), vector([residuals[3], residuals[4], residuals[5]])],
                };
                let surface = shade::surface(&material, camera.position, ShadingRules::PAPER);
                (splat.mean2d, splat.root_conic, surface.facing.normal, surface.reflection_dir)
            };
            prop_assert_eq!(see(quat), see(quat.map(|c| -c)), "both stand for the same rotation");
        }

        #[test]
        fn turning_the_scene_and_the_camera_together_changes_no_splat(
            camera in camera(),
            turn in quat(),
            mean in [-0.8..0.8_f64, -0.8..0.8, -0.8..0.8],
            scales in [-4.0..0.0_f64, -4.0..0.0, -4.0..0.0],
            quat in quat(),
        ) {
            let camera = camera.lift(Double(0.0));
            let rotation = covariance::rotation(turn.map(Double));
            let turned_camera = CameraOf {
                camera_from_world: Mat3 { rows: camera.camera_from_world.rows.map(|row| rotation.transform(row)) },
                position: rotation.transform(camera.position),
                ..camera
            };
            let turned_mean = values_of(rotation.transform(vector(mean)));
            let straight = project::project(&shape(mean, scales, quat), &camera);
            let turned = project::project(&shape(turned_mean, scales, product_of_quats(turn, quat)), &turned_camera);
            for (actual, expected) in [
                (&turned.mean2d[..], &straight.mean2d[..]),
                (&turned.root_conic, &straight.root_conic),
                (&[turned.depth], &[straight.depth]),
            ] {
                let values = |numbers: &[Double]| numbers.iter().map(|x| x.0).collect::<Vec<_>>();
                assert_all_close(&values(actual), &values(expected), ROTATED_SCENE);
            }
        }

        #[test]
        fn a_turned_camera_shows_the_turned_picture(camera in camera(), mean in [-0.8..0.8_f64, -0.8..0.8, -0.8..0.8]) {
            let point = |camera: &Camera| {
                let projected = project::project(&shape(mean, [-2.0; 3], [1.0, 0.0, 0.0, 0.0]), &camera.lift(Double(0.0)));
                projected.mean2d.map(Double::value)
            };
            let (turned, [x, y]) = (camera.turned_clockwise(), point(&camera));
            assert_all_close(&point(&turned), &[f64::from(camera.height) - y, x], TURNED_CAMERA);
            assert_eq!([turned.width, turned.height], [camera.height, camera.width]);
            // Whichever way a camera lies, the picture shows upwards the same direction.
            let up = camera.camera_from_world.row(1) * -1.0;
            let mut lying = camera;
            for quarter in 0..4 {
                let [x, y] = point(&lying.upright(up));
                assert_all_close(&[x, y], &point(&camera), TURNED_CAMERA);
                prop_assert_eq!(lying.upright(up) == lying, quarter == 0);
                lying = lying.turned_clockwise();
            }
        }

        #[test]
        fn a_covariance_has_the_squared_scales_for_eigenvalues(quat in quat(), scales in log_scales(-2.0..1.0)) {
            let [xx, xy, xz, yy, yz, zz] = covariance::covariance(quat.map(Double), vector(scales)).map(Double::value);
            let variances = scales.map(|s| (2.0 * s).exp());
            let trace = xx + yy + zz;
            let determinant = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz);
            assert_close(trace / variances.iter().sum::<f64>(), 1.0, ROUNDING_F64);
            assert_close(determinant / variances.iter().product::<f64>(), 1.0, ROTATED_SCENE);
        }

        #[test]
        fn equal_directions_weigh_one_at_every_roughness(dir in unit_vector(), log_alpha in -18.0..0.0_f64) {
            let weight = ggx::lobe_weight(vector(dir), vector(dir), Double(log_alpha.exp()));
            assert_close(weight.0, 1.0, ROUNDING_F64);
        }

        #[test]
        fn a_reflected_direction_reflects_back(view in unit_vector(), normal in unit_vector()) {
            let reflected = shade::reflect::<Double>(vector(view), vector(normal));
            assert_all_close(&values_of(shade::reflect(reflected, vector(normal))), &view, ROUNDING_F64);
        }
    }

    fn shape(mean: [f64; 3], log_scales: [f64; 3], quat: [f64; 4]) -> Shape<Double> {
        Shape {
            mean: vector(mean),
            log_scales: vector(log_scales),
            quat: quat.map(Double),
            opacity_logit: Double(0.0),
            low_pass: LowPass::Dilated,
            filter: None,
        }
    }

    fn product_of_quats([a, b, c, d]: [f64; 4], [w, x, y, z]: [f64; 4]) -> [f64; 4] {
        [
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        ]
    }
}

mod light {
    use super::*;

    const RESOLUTION: usize = 8;

    /// Rows of the adjacency table of seamless cube maps: for each face the texel beyond its left,
    /// right, top and bottom edge, as (face, column, row), k along the edge and m the last index.
    #[derive(Clone, Copy)]
    enum At {
        First,
        Last,
        Along,
        Back,
    }
    use At::{Along, Back, First, Last};
    const NEIGHBOURS: [[(usize, At, At); 4]; 6] = [
        [(4, Last, Along), (5, First, Along), (2, Last, Back), (3, Last, Along)],
        [(5, Last, Along), (4, First, Along), (2, First, Along), (3, First, Back)],
        [(1, Along, First), (0, Back, First), (5, Back, First), (4, Along, First)],
        [(1, Back, Last), (0, Along, Last), (4, Along, Last), (5, Back, Last)],
        [(1, Last, Along), (0, First, Along), (2, Along, Last), (3, Along, First)],
        [(0, Last, Along), (1, First, Along), (2, Back, First), (3, Back, Last)],
    ];

    fn neighbour(face: usize, edge: usize, k: usize, resolution: usize) -> usize {
        let (face, column, row) = NEIGHBOURS[face][edge];
        let index = |at| match at {
            First => 0,
            Last => resolution - 1,
            Along => k,
            Back => resolution - 1 - k,
        };
        cubemap::texel_index(face, index(column), index(row), resolution)
    }

    #[test]
    fn aprons_show_the_texels_across_the_edges() {
        for resolution in [1, 2, 4, RESOLUTION, 64] {
            let n = resolution as isize;
            for (face, k) in (0..6).flat_map(|face| (0..n).map(move |k| (face, k))) {
                for (edge, (column, row)) in [(-1, k), (n, k), (k, -1), (k, n)].into_iter().enumerate() {
                    let apron = cubemap::apron_sources(face, column, row, resolution);
                    let expected = neighbour(face, edge, k as usize, resolution);
                    assert_eq!(apron.count, 1, "an edge has one neighbour");
                    assert_eq!(apron.texels[0], expected, "face {face}, column {column}, row {row} of {resolution}");
                }
            }
        }
    }

    #[test]
    fn corners_of_aprons_are_the_mean_of_three_texels() {
        let n = RESOLUTION as isize;
        let inner = |k: isize| k.clamp(0, n - 1) as usize;
        for (face, (column, row)) in (0..6).flat_map(|f| [(-1, -1), (n, -1), (-1, n), (n, n)].map(|corner| (f, corner)))
        {
            let apron = cubemap::apron_sources(face, column, row, RESOLUTION);
            let sideways = neighbour(face, if column < 0 { 0 } else { 1 }, inner(row), RESOLUTION);
            let upright = neighbour(face, if row < 0 { 2 } else { 3 }, inner(column), RESOLUTION);
            let own = cubemap::texel_index(face, inner(column), inner(row), RESOLUTION);
            let mut expected = [own, sideways, upright];
            let mut texels = apron.texels;
            expected.sort_unstable();
            texels.sort_unstable();
            assert_eq!((apron.count, texels), (3, expected), "face {face}, column {column}, row {row}");
        }
    }

    #[test]
    fn texels_without_apron_show_themselves() {
        for (face, column, row) in [(0, 0, 0), (3, 5, 2), (5, 7, 7)] {
            let apron = cubemap::apron_sources(face, column, row, RESOLUTION);
            let own = cubemap::texel_index(face, column as usize, row as usize, RESOLUTION);
            assert_eq!((apron.count, apron.texels[0]), (1, own), "an inner texel is no apron");
        }
    }

    #[test]
    fn a_texels_direction_leads_back_to_it() {
        for (face, column, row) in
            (0..6).flat_map(|f| (0..RESOLUTION).flat_map(move |c| (0..RESOLUTION).map(move |r| (f, c, r))))
        {
            let (found, u, v) = cubemap::face_of(cubemap::texel_direction(face, column, row, RESOLUTION));
            let index = |u: f64| ((u + 1.0) * 0.5 * RESOLUTION as f64) as usize;
            assert_eq!((found, index(u), index(v)), (face, column, row), "the inverse");
        }
    }

    /// A padded map of random texels in [0, 1].
    fn random_map(resolution: usize) -> Vec<Vec3<Double>> {
        let texel = |index: usize| take3(&[0, 1, 2].map(|c| Double(f64::from(random::uniform(3, c, index as u64)))));
        padded(resolution, texel)
    }

    fn padded(resolution: usize, texel: impl Fn(usize) -> Vec3<Double>) -> Vec<Vec3<Double>> {
        let mut map = vec![vector([0.0; 3]); cubemap::padded_len(resolution)];
        cubemap::pad(resolution, texel, &mut map);
        map
    }

    #[test]
    fn padded_maps_have_the_sources_of_their_aprons() {
        for resolution in [1, 2, RESOLUTION] {
            let map = padded(resolution, |index| vector([index as f64; 3]));
            let n = resolution as isize;
            for (face, row, column) in
                (0..6).flat_map(|f| (-1..=n).flat_map(move |row| (-1..=n).map(move |column| (f, row, column))))
            {
                let apron = cubemap::apron_sources(face, column, row, resolution);
                let sources = apron.texels[..apron.count].iter().map(|index| *index as f64);
                let expected = sources.sum::<f64>() / apron.count as f64;
                let found = map[cubemap::padded_index(face, column, row, resolution)].x.0;
                assert_close(found, expected, ROUNDING_F32 * expected.max(1.0));
            }
        }
    }

    fn look_up(map: &[Vec3<Double>], resolution: usize, direction: [f64; 3]) -> [f64; 3] {
        let footprint = footprint_of(direction, resolution);
        let first = footprint.texel.0 as usize;
        let texels = [0, 1, resolution + 2, resolution + 3].map(|offset| map[first + offset]);
        values_of(cubemap::bilinear(texels, footprint.right, footprint.lower))
    }

    fn assert_continuous(map: &[Vec3<Double>], at: [f64; 3], step: [f64; 3]) {
        const STEP: f64 = 1e-7;
        /// Texels per unit of direction at a cube's corner, for both axes; neighbours differ by at
        /// most 1.
        const STEEPEST: f64 = 6.0 * RESOLUTION as f64;
        let side = |sign: f64| core::array::from_fn(|k| at[k] + sign * STEP * step[k]);
        let [there, here] = [1.0, -1.0].map(|sign| look_up(map, RESOLUTION, side(sign)));
        let change = there.iter().zip(here).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(change <= STEEPEST * 2.0 * STEP, "a jump of {change} at {at:?}");
    }

    proptest! {
        #![proptest_config(same_every_time())]

        #[test]
        fn lookups_are_continuous_across_every_edge_and_corner(along in -1.0..1.0_f64, step in unit_vector()) {
            let map = random_map(RESOLUTION);
            for (a, b) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
                for edge in [[along, a, b], [a, along, b], [a, b, along]] {
                    let length = (2.0 + along * along).sqrt();
                    assert_continuous(&map, edge.map(|c| c / length), step);
                }
                for c in [1.0, -1.0] {
                    assert_continuous(&map, [a, b, c].map(|x| x / 3.0_f64.sqrt()), step);
                }
            }
        }

        /// The remaining error is the curvature of the map from the face to the sphere: along
        /// either axis an eighth of the second derivative, 1, times a texel's width squared. Within
        /// half a texel of an edge, the apron's texels lie along the edge v/n off the place they
        /// are taken for, and count half: √2 v / (2 + v²) / 2n, which is largest in the corners.
        #[test]
        fn a_linear_function_of_direction_is_reproduced(direction in unit_vector(), slope in unit_vector()) {
            const FINE: usize = 32;
            const CURVATURE: f64 = 1.0 / (FINE * FINE) as f64;
            const APRON: f64 = SQRT_2 / 6.0 / FINE as f64;
            let linear = |d: [f64; 3]| d[0] * slope[0] + d[1] * slope[1] + d[2] * slope[2];
            let map = padded(FINE, |texel| {
                let (face, rest) = (texel / (FINE * FINE), texel % (FINE * FINE));
                let value = linear(cubemap::texel_direction(face, rest % FINE, rest / FINE, FINE));
                vector([value, 2.0 * value, 0.0])
            });
            let [once, twice, none] = look_up(&map, FINE, direction);
            let point = cubemap::project::<Double>(vector(direction));
            let is_inside = point.u.0.abs().max(point.v.0.abs()) <= 1.0 - 1.0 / FINE as f64;
            assert_close(once, linear(direction), if is_inside { CURVATURE } else { APRON });
            assert_close(twice, 2.0 * once, ROUNDING_F64);
            assert_close(none, 0.0, 0.0);
        }
    }

    #[test]
    #[should_panic(expected = "a jump")]
    fn assert_continuous_fails_for_a_map_with_a_torn_edge() {
        let mut map = random_map(RESOLUTION);
        let face = map.len() / 6;
        map[..face].iter_mut().for_each(|texel| *texel = *texel + vector([0.01, 0.0, 0.0]));
        assert_continuous(&map, [0.7, 0.1, 0.7], [1.0, 0.0, -1.0]);
    }

    #[test]
    fn levels_grow_in_roughness_and_shrink_in_resolution() {
        for (scheme, resolution) in
            [PrefilterScheme::Exact, PrefilterScheme::Official].into_iter().flat_map(|s| [64, 128, 512].map(|n| (s, n)))
        {
            let levels = Levels::new(scheme, resolution);
            let levels = levels.as_slice();
            assert_eq!(levels[0].resolution, resolution, "the sharpest level has every texel");
            assert!(levels.windows(2).all(|pair| pair[0].roughness < pair[1].roughness), "rougher and rougher");
            assert!(levels.windows(2).all(|pair| pair[0].resolution >= pair[1].resolution), "coarser and coarser");
            for (index, level) in levels.iter().enumerate() {
                let position = prefilter::level_of_roughness(Double(f64::from(level.roughness)), levels);
                assert_close(position.0, index as f64, ROUNDING_F32);
            }
            let positions: Vec<f64> =
                (0..=1000).map(|k| prefilter::level_of_roughness(Double(f64::from(k) / 1000.0), levels).0).collect();
            assert!(positions.windows(2).all(|pair| pair[0] <= pair[1]), "the position never falls");
        }
    }

    #[test]
    fn official_levels_are_those_of_the_authors_code() {
        let known: [(usize, &[f32]); 4] = [
            (64, &[0.08, 0.5, 1.0]),
            (128, &[0.08, 0.29, 0.5, 1.0]),
            (256, &[0.08, 0.22, 0.36, 0.5, 1.0]),
            (512, &[0.08, 0.185, 0.29, 0.395, 0.5, 1.0]),
        ];
        for (resolution, roughness) in known {
            let levels = Levels::new(PrefilterScheme::Official, resolution);
            let found: Vec<f64> = levels.as_slice().iter().map(|level| f64::from(level.roughness)).collect();
            let roughness: Vec<f64> = roughness.iter().copied().map(f64::from).collect();
            assert_all_close(&found, &roughness, ROUNDING_F32);
            assert_eq!(levels.as_slice().last().map(|level| level.resolution), Some(16), "down to 16 texels");
        }
        let six = [(0.08, 0.0), (0.185, 1.0), (0.29, 2.0), (0.5, 4.0), (0.6457, 4.2913), (0.75, 4.5), (1.0, 5.0)];
        let three = [(0.05, 0.0), (0.29, 0.5), (0.75, 1.5)];
        for (resolution, (roughness, level)) in
            six.map(|case| (512, case)).into_iter().chain(three.map(|case| (64, case)))
        {
            let levels = Levels::new(PrefilterScheme::Official, resolution);
            let found = prefilter::level_of_roughness(Double(roughness), levels.as_slice());
            assert_close(found.0, level, 2.0 * FOUR_DIGITS);
        }
    }

    #[test]
    fn official_cuts_are_where_the_authors_code_has_them() {
        let known = [
            (0.08, 0.9997670),
            (0.185, 0.9932124),
            (0.22, 0.9861683),
            (0.29, 0.9550174),
            (0.36, 0.8772801),
            (0.395, 0.8058194),
            (0.5, 0.4462145),
            (1.0, 0.0157058),
        ];
        for (roughness, cosine) in known {
            assert_close(prefilter::official_cut_cosine(roughness * roughness), cosine, 1e-6);
        }
    }

    #[test]
    fn the_split_sum_is_that_of_the_published_table() {
        let known = [
            ((0.5, 0.5), [0.83503, 0.02235]),
            ((0.25, 0.75), [0.71667, 0.02796]),
            ((0.05, 0.30), [0.53921, 0.36838]),
            ((0.9, 0.1), [1.0, 1e-5]),
            ((1.0, 1.0), [0.30928, 4e-5]),
        ];
        for ((n_dot_v, roughness), expected) in known {
            let [scale, bias] = table_at(n_dot_v, roughness);
            assert_close(scale, expected[0], SPLIT_SUM_NOISE);
            assert_close(bias, expected[1], SPLIT_SUM_NOISE);
        }
    }

    /// The bilinear mean of the four texels around a point, as a table looked up with clamped edges
    /// gives it.
    fn table_at(n_dot_v: f64, roughness: f64) -> [f64; 2] {
        const SIZE: f64 = split_sum::RESOLUTION as f64;
        const SAMPLES: u32 = 1024;
        let place = |x: f64| (x * SIZE - 0.5).clamp(0.0, SIZE - 1.0);
        let centre = |k: f64| (k.min(SIZE - 1.0) + 0.5) / SIZE;
        let (x, y) = (place(n_dot_v), place(roughness));
        let (right, lower) = (x.fract(), y.fract());
        let mut mean = [0.0; 2];
        for (dx, dy, weight) in [
            (0.0, 0.0, (1.0 - right) * (1.0 - lower)),
            (1.0, 0.0, right * (1.0 - lower)),
            (0.0, 1.0, (1.0 - right) * lower),
            (1.0, 1.0, right * lower),
        ] {
            let texel = split_sum::integrate(centre(x.floor() + dx), centre(y.floor() + dy), SAMPLES);
            mean = [mean[0] + weight * texel[0], mean[1] + weight * texel[1]];
        }
        mean
    }

    #[test]
    fn no_more_light_is_reflected_than_arrives() {
        for (n_dot_v, roughness) in
            [0.05, 0.3, 0.6, 1.0].into_iter().flat_map(|v| [0.05, 0.3, 0.6, 1.0].map(|roughness| (v, roughness)))
        {
            let [scale, bias] = split_sum::integrate(n_dot_v, roughness, 1024);
            assert!(scale >= 0.0 && bias >= 0.0 && scale + bias <= 1.0 + SPLIT_SUM_NOISE, "at {n_dot_v}, {roughness}");
        }
    }
}

mod numbers {
    use super::*;

    proptest! {
        #![proptest_config(same_every_time())]

        #[test]
        fn encoding_and_decoding_srgb_gives_the_colour_back(srgb in 0.0..1.0_f32) {
            let linear = color::linear_from_srgb(srgb);
            assert_close(f64::from(color::srgb_from_linear(linear)), f64::from(srgb), ROUNDING_F32);
        }

        #[test]
        fn halves_that_are_packed_come_out_again(a in any::<u16>(), b in any::<u16>()) {
            let word = u32::from(a) | u32::from(b) << 16;
            let [low, high] = pack::unpack2(word);
            prop_assume!(!low.is_nan() && !high.is_nan());
            prop_assert_eq!(pack::pack2(low, high), word, "every half is an f32");
        }

        #[test]
        fn packing_rounds_by_half_a_unit_of_eleven_bits(a in -6e4..6e4_f32, exponent in -30..0_i32) {
            let value = a * (exponent as f32).exp2();
            let [back, _] = pack::unpack2(pack::pack2(value, 0.0));
            prop_assert!((value - back).abs() <= value.abs() / 2048.0 + 3e-8, "{value} became {back}");
        }

        #[test]
        fn gaussians_that_are_packed_come_out_rounded(cloud in cloud(1..40, Layout::shaded(Some(1)))) {
            let mut cloud = cloud;
            let mut words = vec![0; cloud.count.next_multiple_of(BLOCK) * Storage::F16.words(cloud.layout)];
            pack::pack(&cloud, &mut words);
            let mut back = cloud.with_values(vec![0.0; cloud.values.len()]);
            pack::unpack(&words, cloud.layout, &mut back.values);
            prop_assert_eq!(back.get::<6>(0, MEAN), cloud.get::<6>(0, MEAN), "means and scales are kept in full");
            Storage::F16.round(&mut cloud);
            prop_assert!(back == cloud, "every other number is the nearest half");
        }

        #[test]
        fn logarithms_and_powers_of_f32_keep_their_digits(exponent in -126.0..127.0_f32, x in 1e-37..1e37_f32, near_one in 0.9..1.1_f32) {
            const THREE_ROUNDINGS: f64 = 3e-7;
            let exact = f64::from(exponent).exp2();
            assert_close(f64::from(Real::exp2(exponent)) / exact, 1.0, THREE_ROUNDINGS);
            for x in [x, x.recip(), near_one] {
                let exact = f64::from(x).log2();
                assert_close(f64::from(Real::log2(x)), exact, THREE_ROUNDINGS * exact.abs());
            }
        }

        #[test]
        fn exponentials_of_f64_are_exact(x in -80.0..80.0_f64) {
            assert_close(Real::exp(Double(x)).0 / x.exp(), 1.0, ROUNDING_F64);
            assert_close(Real::ln(Double(x.exp())).0, x, ROUNDING_F64 * 100.0);
            assert_close(Real::exp2(Double(x)).0 / (x * LN_2).exp(), 1.0, ROUNDING_F64);
        }

        #[test]
        fn sparse_losses_are_finite_for_every_logit(logit in -1e4..1e4_f32) {
            prop_assert!(loss::sparse(logit).is_finite(), "the loss at {logit}");
            prop_assert!(loss::sparse_vjp(logit, 1.0).is_finite(), "its gradient at {logit}");
            assert_close(f64::from(loss::sparse(logit)), -f64::from(logit.abs()), 1.4 + 1e-6 * f64::from(logit.abs()));
        }

        #[test]
        fn the_sigmoid_lies_between_zero_and_one_at_every_number(x in -1e30..1e30_f32, small in -100.0..100.0_f32) {
            for x in [x, small, f32::MAX, f32::MIN] {
                let value = activation::sigmoid(x);
                prop_assert!((0.0..=1.0).contains(&value), "sigmoid({x}) is {value}");
                prop_assert!(activation::sigmoid_vjp(value, 1.0).is_finite(), "its gradient at {x}");
                prop_assert!(activation::softplus(x) >= 0.0, "softplus({x})");
            }
            let exact = 1.0 / (1.0 + (-f64::from(small)).exp());
            assert_close(f64::from(activation::sigmoid(small)), exact, ROUNDING_F32);
        }

        #[test]
        fn logits_are_the_inverse_of_the_sigmoid(p in 0.001..0.999_f32) {
            assert_close(f64::from(activation::sigmoid(activation::logit(p))), f64::from(p), ROUNDING_F32);
        }

        #[test]
        fn quats_of_any_length_are_rotations(quat in quat(), log_scale in -60.0..60.0_f64) {
            let scaled = quat.map(|c| (c * log_scale.exp()) as f32);
            let rotation = covariance::rotation(scaled);
            for (i, j) in [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)] {
                let product = f64::from(rotation.rows[i].dot(rotation.rows[j]));
                assert_close(product, if i == j { 1.0 } else { 0.0 }, ROUNDING_F32);
            }
        }
    }

    #[test]
    fn random_numbers_are_uniform() {
        const DRAWS: u64 = 1 << 20;
        const BINS: usize = 64;
        /// Chi-square of 63 degrees of freedom is above 115 once in 10⁴ streams.
        const CHI_SQUARE_MAX: f64 = 115.0;
        for stream in 0..4 {
            let mut bins = [0.0; BINS];
            let mut lagged = 0.0;
            for index in 0..DRAWS {
                let x = random::uniform(11, stream, index);
                assert!((0.0..1.0).contains(&x), "{x} is in [0, 1)");
                bins[(x * BINS as f32) as usize] += 1.0;
                let next = random::uniform(11, stream + 1, index);
                lagged += (f64::from(x) - 0.5) * (f64::from(next) - 0.5);
            }
            let expected = DRAWS as f64 / BINS as f64;
            let chi_square: f64 = bins.iter().map(|count: &f64| (count - expected).powi(2) / expected).sum();
            assert!(chi_square < CHI_SQUARE_MAX, "chi-square {chi_square} of stream {stream}");
            // The mean of products has a standard deviation of 1/12 / √DRAWS; five of them.
            assert_close(lagged / DRAWS as f64, 0.0, 5.0 / 12.0 / (DRAWS as f64).sqrt());
        }
    }

    #[test]
    fn normal_random_numbers_have_mean_zero_and_variance_one() {
        const DRAWS: u64 = 1 << 18;
        let draws: Vec<f64> = (0..DRAWS).map(|index| f64::from(random::normal(5, 2, index))).collect();
        let moment = |power: i32| draws.iter().map(|x| x.powi(power)).sum::<f64>() / DRAWS as f64;
        let deviations = 5.0 / (DRAWS as f64).sqrt();
        assert_close(moment(1), 0.0, deviations);
        assert_close(moment(2), 1.0, deviations * 2.0_f64.sqrt());
        assert_close(moment(4), 3.0, deviations * 96.0_f64.sqrt());
    }

    /// The determinant of the conic, `(W_xx W_yy)²`, of needles up to 10⁵ px long, `f32` against
    /// `f64`. A needle that points to the eye is short on the screen, and its length there is as
    /// uncertain as its direction: errors are those of a needle seen from the side. Half of them
    /// are due to the exponentials: e^x of an `f32` is off by
    /// |x| / 10⁷, and the determinant holds the square of two of them.
    #[test]
    fn needles_keep_the_digits_of_their_determinant() {
        let mut errors: Vec<f64> = (0..20_000).map(needle_error).collect();
        errors.sort_unstable_by(f64::total_cmp);
        let (median, worst) = (errors[errors.len() / 2], errors[errors.len() - 1]);
        println!("relative error of the determinant: median {median:e}, worst {worst:e}");
        assert!(median <= 5e-7, "half of the needles are off by {median:e}");
        assert!(worst <= 3e-6, "the worst needle is off by {worst:e}");
    }

    /// Relative error of a random needle's determinant, times the sine of the angle that it is seen
    /// at.
    fn needle_error(seed: u64) -> f64 {
        let draw = |index: u64, low: f32, high: f32| low + (high - low) * random::uniform(seed, 1, index);
        let eye = glam::Vec3::new(0.0, 0.0, -4.0);
        let camera = Camera::look_at(eye, glam::Vec3::ZERO, glam::Vec3::NEG_Y, 0.8, 800, 800);
        let longest = (1e5 * 4.0 / camera.focal_px[0]).ln();
        let normal = |index| random::normal(seed, 2, index);
        let mean = [1, 2, 3].map(|index| draw(index, -1.0, 1.0));
        let log_scales = [draw(0, 0.0, longest), draw(4, -6.0, -4.0), draw(5, -6.0, -4.0)];
        let quat = [normal(0), normal(1), normal(2), normal(3)];

        let numbers = [&mean[..], &log_scales, &quat].concat();
        let exact = determinant_of(&numbers.iter().map(|&x| Double::from(x)).collect::<Vec<_>>(), &camera);
        let rounded = determinant_of(&numbers, &camera);
        let along = covariance::rotation(quat.map(Double::from)).column(0);
        let ray = shade::view_dir(vector(mean.map(f64::from)), vector(eye.to_array().map(f64::from)));
        let sine = along.cross(ray).length_squared().0.sqrt();
        relative_difference(&[rounded], &[exact]) * sine
    }

    /// mean, log scales, quat.
    fn determinant_of<R: Number>(n: &[R], camera: &Camera) -> f64 {
        let shape = Shape {
            mean: take3(n),
            log_scales: take3(&n[3..]),
            quat: [n[6], n[7], n[8], n[9]],
            opacity_logit: n[0].zero(),
            low_pass: LowPass::Dilated,
            filter: None,
        };
        let [xx, _, yy] = project::project(&shape, &camera.lift(n[0])).root_conic.map(R::value);
        (xx * yy).powi(2)
    }
}

fn footprint_of(direction: [f64; 3], resolution: usize) -> cubemap::TexelFootprint<Double> {
    cubemap::footprint(&cubemap::project(vector(direction)), Double(resolution as f64))
}
