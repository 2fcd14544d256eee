//! Every `_vjp` of core is the derivative of its function: checked against dual numbers in `f64`.
//!
//! Dual numbers are exact on either side of a jump, so input is not kept away from limits, cuts and
//! changes of sides; only on a jump itself there is no derivative, and random input does not hit
//! one.

use proptest::{collection::vec, prelude::*};
use specula_core::{
    activation,
    antialias::{self, LowPass},
    attributes::{
        self, AttributeGrads, AttributeLosses, AttributePlanes, GaussianShading, LayerChannels, LightSample,
        LookupGrad, ShadedGaussian,
    },
    blend,
    camera::{Camera, CameraGrad, CameraOf, NEAR},
    color, covariance,
    cubemap::{self, padded_len},
    depth_normal,
    double::Double,
    dual::Dual,
    environment,
    expose::{self, Exposure},
    ggx,
    light_frame::{LightFrame, Turned},
    light_network::{self, Answers, DEGREES, HIDDEN_MAX, NUMBER_MAX, WEIGHT_COUNT, WEIGHT_MAX},
    light_view::{LightView, TexelMap},
    loss::{self, NormalForm, NormalPatch},
    near_field::Reflection,
    normal::{self, AxisRule},
    physical::{self, PixelFacing, PixelLight},
    pixel_light::{LightLookupGrads, LightLookups},
    prefilter::{self, Level, Levels, PrefilterScheme},
    project::{self, Shape},
    real::Real,
    rules::{Channels, RenderRules, channel},
    scene::{Layout, RadianceActivation},
    sh,
    shade::{self, Material, ShadingForm, ShadingRules, SurfaceGrad, Terms},
    shade_pixels::{self, Pixel, PixelSurface},
    smoothness::{self, Line},
    splat::{Splat2d, SplatGrad},
    vector::{self, Mat3, Vec3},
};
use specula_tests::{
    compare::SAME_DERIVATIVE,
    derivative::{assert_vjp, random_cotangent},
    number::{Number, numbers_of, take3, take9, vector},
    pixels::{GivenLight, PIXEL_LEN, PixelCase, SMOOTH_LEN},
    strategies::{any_vector, camera, log_scales, quat, random_environment, rotation, same_every_time, unit_vector},
};

/// Twelve numbers, row by row.
fn exposure_of<R: Number>(numbers: &[R]) -> Exposure<R> {
    [0, 4, 8].map(|row| [numbers[row], numbers[row + 1], numbers[row + 2], numbers[row + 3]])
}

/// The smooth numbers of a pixel, then the others, which are constants.
fn followed_by<R: Number>(smooth: &[R], numbers: &[f64]) -> Vec<R> {
    smooth.iter().copied().chain(numbers[SMOOTH_LEN..].iter().map(|x| R::of(*x))).collect()
}

/// Levels of a small light.
const LEVELS: [Level; 2] = [Level { roughness: 0.2, resolution: 2 }, Level { roughness: 0.7, resolution: 1 }];
/// Colours of its texels.
const LIGHT_LEN: usize = 3 * (padded_len(2) + padded_len(1));

/// Uses the small light of some colours.
fn with_light<R: Number, T>(colors: &[R], use_it: impl FnOnce(LightView<'_, R>) -> T) -> T {
    let maps: Vec<TexelMap> = TexelMap::side_by_side(LEVELS.iter().map(|level| level.resolution)).collect();
    let texels: Vec<Vec3<R>> = colors.chunks_exact(3).map(take3).collect();
    use_it(LightView { levels: &LEVELS, maps: &maps, texels: &texels })
}

/// Numbers side by side.
fn join<R: Number>(parts: &[&[R]]) -> Vec<R> {
    parts.concat()
}

proptest! {
    #![proptest_config(same_every_time())]

    /// Beyond ±10 the value no longer holds the digits of its distance from 1, which its gradient
    /// is made of.
    #[test]
    fn activations_are_derived_right(x in -10.0..10.0_f64) {
        assert_vjp(
            &[x],
            |x| vec![activation::sigmoid(x[0])],
            |x, g| vec![activation::sigmoid_vjp(activation::sigmoid(x[0]), g[0])],
            SAME_DERIVATIVE,
        );
        assert_vjp(
            &[x],
            |x| vec![activation::softplus(x[0])],
            |x, g| vec![activation::softplus_vjp(x[0], g[0])],
            SAME_DERIVATIVE,
        );
        for activation in
            [RadianceActivation::Identity, RadianceActivation::Exponential, RadianceActivation::Network]
        {
            assert_vjp(
                &[x],
                |x| vec![environment::radiance(activation, x[0])],
                |x, g| vec![environment::radiance_vjp(activation, environment::radiance(activation, x[0]), g[0])],
                SAME_DERIVATIVE,
            );
        }
    }

    #[test]
    fn srgb_is_derived_right_on_both_of_its_pieces(dark in -0.1..0.0031_f64, bright in 0.0032..30.0_f64) {
        for x in [dark, bright] {
            assert_vjp(
                &[x],
                |x| vec![color::srgb_from_linear(x[0])],
                |x, g| vec![color::srgb_from_linear_vjp(x[0], color::srgb_from_linear(x[0]), g[0])],
                SAME_DERIVATIVE,
            );
        }
    }

    #[test]
    fn rotations_are_derived_right_at_every_length_of_the_quat(quat in quat()) {
        assert_vjp(
            &quat,
            |q| numbers_of(&covariance::rotation([q[0], q[1], q[2], q[3]])),
            |q, g| covariance::rotation_vjp([q[0], q[1], q[2], q[3]], &take9(g)).to_vec(),
            SAME_DERIVATIVE,
        );
    }

    #[test]
    fn scales_are_derived_right_within_and_beyond_their_limit(logs in [-50.0..50.0_f64, -5.0..5.0, -5.0..5.0]) {
        assert_vjp(
            &logs,
            |x| covariance::scales(take3(x)).to_array().to_vec(),
            |x, g| covariance::scales_vjp(take3(x), covariance::scales(take3(x)), take3(g)).to_array().to_vec(),
            SAME_DERIVATIVE,
        );
    }

    #[test]
    fn normalisation_is_derived_right(v in any_vector()) {
        assert_vjp(
            &v,
            |v| vector::normalize_or(take3(v), vector([0.0, 0.0, 1.0])).to_array().to_vec(),
            |v, g| vector::normalize_or_vjp(take3(v), take3(g)).to_array().to_vec(),
            SAME_DERIVATIVE,
        );
    }

    #[test]
    fn face_points_are_derived_right(direction in any_vector()) {
        assert_vjp(
            &direction,
            |d| {
                let point = cubemap::project(take3(d));
                vec![point.u, point.v]
            },
            |d, g| cubemap::project_vjp(&cubemap::project(take3(d)), g[0], g[1]).to_array().to_vec(),
            SAME_DERIVATIVE,
        );
    }

    #[test]
    fn bilinear_means_are_derived_right(inputs in vec(-1.0..1.0_f64, 14)) {
        assert_vjp(&inputs, bilinear, |x, g| {
            let (right, lower) = cubemap::bilinear_vjp(texels(x), x[12], x[13], take3(g));
            join(&[&texel_grads(x[12], x[13], take3(g)), &[right, lower]])
        }, SAME_DERIVATIVE);
    }

    /// The choice of texels is locally constant, so any four will do.
    #[test]
    fn a_lookup_is_derived_right_from_direction_to_texels(
        around in vec(0.0..2.0_f64, 12),
        direction in unit_vector(),
        log_resolution in 2..8_u32,
    ) {
        let resolution = f64::from(1 << log_resolution);
        let inputs = join_f64(&around, &direction);
        assert_vjp(
            &inputs,
            |x| {
                let footprint = cubemap::footprint(&cubemap::project(take3(&x[12..])), Number::of(resolution));
                bilinear(&join(&[&x[..12], &[footprint.right, footprint.lower]]))
            },
            |x, g| {
                let point = cubemap::project(take3(&x[12..]));
                let footprint = cubemap::footprint(&point, Double(resolution));
                let (right, lower) = cubemap::bilinear_vjp(texels(x), footprint.right, footprint.lower, take3(g));
                let half = Double(0.5 * resolution);
                let grad_direction = cubemap::project_vjp(&point, right * half, lower * half);
                let grad_texels = texel_grads(footprint.right, footprint.lower, take3(g));
                join(&[&grad_texels, &grad_direction.to_array()])
            },
            SAME_DERIVATIVE,
        );
    }

    #[test]
    fn lobe_weights_are_derived_right(r in unit_vector(), l in unit_vector(), alpha_ggx in 1e-2..1.0_f64) {
        assert_vjp(
            &r,
            |r| vec![ggx::lobe_weight(take3(r), vector(l), Number::of(alpha_ggx))],
            |r, g| ggx::lobe_weight_vjp(take3(r), vector(l), Number::of(alpha_ggx), g[0]).to_array().to_vec(),
            SAME_DERIVATIVE,
        );
    }

    #[test]
    fn levels_are_derived_right(roughness in 0.0..1.0_f64, log_resolution in 6..9_u32) {
        for scheme in [PrefilterScheme::Exact, PrefilterScheme::Official] {
            let levels = Levels::new(scheme, 1 << log_resolution);
            assert_vjp(
                &[roughness],
                |x| vec![prefilter::level_of_roughness(x[0], levels.as_slice())],
                |x, g| vec![prefilter::level_of_roughness_vjp(x[0], levels.as_slice(), g[0])],
                SAME_DERIVATIVE,
            );
        }
    }

    #[test]
    fn harmonics_are_derived_right_at_every_degree(direction in any_vector()) {
        for count in [1, 4, 9, 16] {
            assert_vjp(
                &direction,
                |d| sh::basis(take3(d), count).to_vec(),
                |d, g| {
                    let grad = core::array::from_fn(|k| g[k]);
                    sh::basis_vjp(take3(d), count, &grad).to_array().to_vec()
                },
                SAME_DERIVATIVE,
            );
        }
    }

    #[test]
    fn radiance_is_derived_right_above_and_below_its_limit(sum in [-2.0..2.0_f64, -2.0..2.0, -2.0..2.0]) {
        assert_vjp(
            &sum,
            |x| sh::radiance(take3(x)).to_array().to_vec(),
            |x, g| sh::radiance_vjp(take3(x), take3(g)).to_array().to_vec(),
            SAME_DERIVATIVE,
        );
    }

    #[test]
    fn axes_are_derived_right_under_every_rule(rotation in vec(-1.0..1.0_f64, 9), scales in log_scales(-3.0..1.0)) {
        for rule in [AxisRule::Shortest, AxisRule::SortedRow, AxisRule::None] {
            assert_vjp(
                &rotation,
                |r| normal::axis(rule, &take9(r), vector(scales)).to_array().to_vec(),
                |_, g| numbers_of(&normal::axis_vjp(rule, vector(scales), take3(g))),
                SAME_DERIVATIVE,
            );
        }
    }

    #[test]
    fn facing_normals_are_derived_right_on_both_sides_with_both_signs(
        axis in unit_vector(),
        view in unit_vector(),
        residuals in vec(-0.5..0.5_f64, 6),
    ) {
        let inputs = join_f64(&axis, &residuals);
        for (view, negate) in [(view, false), (view, true), (view.map(|c| -c), false), (view.map(|c| -c), true)] {
            assert_vjp(
                &inputs,
                |x| {
                    let facing = normal::facing(take3(x), vector(view), [take3(&x[3..]), take3(&x[6..])], negate);
                    join(&[&facing.normal.to_array(), &[facing.residual_squared]])
                },
                |x, g| {
                    let facing = normal::facing(take3(x), vector(view), [take3(&x[3..]), take3(&x[6..])], negate);
                    let (axis, [first, second]) = normal::facing_vjp(&facing, negate, take3(g), g[3]);
                    join(&[&axis.to_array(), &first.to_array(), &second.to_array()])
                },
                SAME_DERIVATIVE,
            );
        }
    }

    #[test]
    fn view_directions_are_derived_right(mean in any_vector(), eye in any_vector()) {
        assert_vjp(
            &mean,
            |m| shade::view_dir(take3(m), vector(eye)).to_array().to_vec(),
            |m, g| shade::view_dir_vjp(take3(m), vector(eye), take3(g)).to_array().to_vec(),
            SAME_DERIVATIVE,
        );
    }

    #[test]
    fn reflections_are_derived_right(view in any_vector(), normal in any_vector()) {
        assert_vjp(
            &join_f64(&view, &normal),
            |x| shade::reflect(take3(x), take3(&x[3..])).to_array().to_vec(),
            |x, g| {
                let (view, normal) = shade::reflect_vjp(take3(x), take3(&x[3..]), take3(g));
                join(&[&view.to_array(), &normal.to_array()])
            },
            SAME_DERIVATIVE,
        );
    }

    #[test]
    fn surfaces_are_derived_right_under_every_rule(
        mean in any_vector(),
        quat in quat(),
        scales in log_scales(-3.0..1.0),
        rest in vec(-2.0..2.0_f64, 7),
        residuals in vec(-0.4..0.4_f64, 6),
        from in unit_vector(),
    ) {
        let eye = from.map(|c| 5.0 * c);
        let inputs = [&mean[..], &quat, &scales, &rest, &residuals].concat();
        let without_axis = ShadingRules { axis: AxisRule::None, ..ShadingRules::PAPER };
        for rules in [ShadingRules::PAPER, ShadingRules::OFFICIAL, without_axis] {
            assert_vjp(
                &inputs,
                |x| {
                    let s = shade::surface(&material(x), vector(eye), rules);
                    join(&[
                        &s.facing.normal.to_array(),
                        &s.reflection_dir.to_array(),
                        &s.view_dir.to_array(),
                        &s.diffuse.to_array(),
                        &s.tint.to_array(),
                        &[s.facing.residual_squared, s.n_dot_v, s.roughness],
                    ])
                },
                |x, g| {
                    let material = material(x);
                    let surface = shade::surface(&material, vector(eye), rules);
                    let grad = SurfaceGrad {
                        normal: take3(g),
                        reflection_dir: take3(&g[3..]),
                        view_dir: take3(&g[6..]),
                        diffuse: take3(&g[9..]),
                        tint: take3(&g[12..]),
                        residual_squared: g[15],
                        n_dot_v: g[16],
                        roughness: g[17],
                    };
                    numbers_of_material(&shade::surface_vjp(&material, vector(eye), rules, &surface, &grad))
                },
                SAME_DERIVATIVE,
            );
        }
    }

    #[test]
    fn all_shading_functions_are_derived_right(inputs in vec(0.05..1.0_f64, 17)) {
        for form in [ShadingForm::Paper, ShadingForm::Official, ShadingForm::Deferred] {
            assert_vjp(
                &inputs,
                |x| shade::shade(form, &terms(x)).to_array().to_vec(),
                |x, g| {
                    let grad = shade::shade_vjp(form, &terms(x), take3(g));
                    join(&[
                        &grad.diffuse.to_array(),
                        &grad.tint.to_array(),
                        &grad.specular_light.to_array(),
                        &grad.residual.to_array(),
                        &grad.ambient_light.to_array(),
                        &grad.split_sum,
                    ])
                },
                SAME_DERIVATIVE,
            );
        }
    }

    /// Faint pixels, too, where coverage counts as its least.
    #[test]
    fn surfaces_of_pixels_are_derived_right(
        sums in vec(0.02..1.0_f64, 7),
        normal in unit_vector(),
        coverage in prop_oneof![0.0..0.0009_f64, 0.004..1.0_f64],
        view_dir in unit_vector(),
    ) {
        let inputs = [&sums[..], &normal, &[coverage]].concat();
        assert_vjp(
            &inputs,
            |x| numbers_of_surface(&shade_pixels::pixel_surface(&blended(x), vector(view_dir))),
            |x, g| {
                let surface = shade_pixels::pixel_surface(&blended(x), vector(view_dir));
                let grad = shade_pixels::pixel_surface_vjp(&blended(x), vector(view_dir), &surface, &surface_of_pixel(g));
                let [base, tint, normal] = [grad.base, grad.tint, grad.normal].map(Vec3::to_array);
                join(&[&base, &tint, &[grad.roughness], &normal, &[grad.coverage]])
            },
            SAME_DERIVATIVE,
        );
    }

    #[test]
    fn light_of_reflections_is_derived_right(lights in vec(0.0..3.0_f64, 6), fixed in vec(0.0..1.0_f64, 11)) {
        let reflection = || Reflection::from_array(core::array::from_fn(|k| Dual::constant_from(fixed[k])));
        assert_vjp(
            &lights,
            |x| reflection().light(take3(x), take3(&x[3..])).to_array().to_vec(),
            |_, g| {
                let reflection = Reflection::from_array(core::array::from_fn(|k| Double(fixed[k])));
                reflection.light_vjp(take3(g)).map(Vec3::to_array).concat()
            },
            SAME_DERIVATIVE,
        );
    }

    #[test]
    fn colours_of_pixels_are_derived_right(inputs in vec(-0.2..1.0_f64, 14)) {
        assert_vjp(
            &inputs,
            |x| shade_pixels::pixel_color(&surface_of_pixel(x), take3(&x[10..]), x[13]).to_array().to_vec(),
            |x, g| {
                let (surface, light, coverage) =
                    shade_pixels::pixel_color_vjp(&surface_of_pixel(x), take3(&x[10..]), x[13], take3(g));
                join(&[&numbers_of_surface(&surface), &light.to_array(), &[coverage]])
            },
            SAME_DERIVATIVE,
        );
    }

    /// Every form and every light but lamps, which have no gradient.
    #[test]
    fn light_of_pixels_is_derived_right(numbers in vec(0.05..0.6_f64, PIXEL_LEN)) {
        for case in PixelCase::all().into_iter().filter(|case| !case.is_illuminated) {
            assert_vjp(
                &numbers[..SMOOTH_LEN],
                |x| case.shaded(&followed_by(x, &numbers)).color.to_array().to_vec(),
                |x, g| case.shaded_vjp(&followed_by(x, &numbers), take3(g)),
                SAME_DERIVATIVE,
            );
        }
    }

    #[test]
    fn lookups_of_turned_lights_are_derived_right(
        turn in rotation(),
        direction in unit_vector(),
        roughness in 0.0..1.0_f64,
        numbers in vec(0.05..0.6_f64, PIXEL_LEN),
    ) {
        fn frame<R: Real>(turn: glam::Mat3, like: R) -> LightFrame<R> {
            LightFrame { light_from_world: Some(Mat3::constant(like, turn)) }
        }
        /// Light of a pixel that looks along directions of the world.
        fn turned<R: Number>(turn: glam::Mat3, numbers: &[f64]) -> Turned<R, GivenLight<R>> {
            let numbers: Vec<R> = numbers.iter().map(|x| R::of(*x)).collect();
            let light = PixelCase::all().iter().find_map(|case| case.parts(&numbers).1).expect("one is lit");
            Turned { lookups: light, frame: frame(turn, numbers[0]) }
        }
        assert_vjp(
            &direction,
            |x| frame(turn, x[0]).to_light(take3(x)).to_array().to_vec(),
            |x, g| frame(turn, x[0]).to_light_vjp(take3(g)).to_array().to_vec(),
            SAME_DERIVATIVE,
        );
        assert_vjp(
            &[&direction[..], &[roughness]].concat(),
            |x| turned(turn, &numbers).look_up(take3(x), x[3]).to_array().to_vec(),
            |x, g| {
                let mut light = turned(turn, &numbers);
                let found = light.look_up(take3(x), x[3]);
                let (direction, roughness) = light.look_up_vjp(&found, take3(x), x[3], take3(g));
                join(&[&direction.to_array(), &[roughness]])
            },
            SAME_DERIVATIVE,
        );
        assert_vjp(
            &direction,
            |x| turned(turn, &numbers).look_up_irradiance(take3(x)).to_array().to_vec(),
            |x, g| {
                let mut light = turned(turn, &numbers);
                let found = light.look_up_irradiance(take3(x));
                light.look_up_irradiance_vjp(&found, take3(x), take3(g)).to_array().to_vec()
            },
            SAME_DERIVATIVE,
        );
    }

    /// Beyond the levels, too, where the roughness has no gradient.
    #[test]
    fn lookups_of_lights_are_derived_right(
        direction in unit_vector(),
        roughness in 0.0..1.0_f64,
        radiance in vec(0.1..2.0_f64, LIGHT_LEN),
    ) {
        let look = [&direction[..], &[roughness], &radiance].concat();
        assert_vjp(
            &look,
            |x| with_light(&x[4..], |light| light.radiance(take3(x), x[3]).to_array().to_vec()),
            |x, g| with_light(&x[4..], |light| {
                let mut texels = vec![Vec3::splat(Double(0.0)); light.texels.len()];
                let (direction, roughness) =
                    light.look_up_vjp(&light.look_up(take3(x), x[3]), x[3], take3(g), &mut texels);
                let texels = texels.iter().flat_map(|texel| texel.to_array());
                direction.to_array().into_iter().chain([roughness]).chain(texels).collect()
            }),
            SAME_DERIVATIVE,
        );
        assert_vjp(
            &look,
            |x| with_light(&x[4..], |light| light.irradiance(take3(x)).to_array().to_vec()),
            |x, g| with_light(&x[4..], |light| {
                let mut texels = vec![Vec3::splat(Double(0.0)); light.texels.len()];
                let (normal, _) = light.look_up_vjp(&light.look_up_irradiance(take3(x)), x[3], take3(g), &mut texels);
                let texels = texels.iter().flat_map(|texel| texel.to_array());
                normal.to_array().into_iter().chain([Double(0.0)]).chain(texels).collect()
            }),
            SAME_DERIVATIVE,
        );
    }

    #[test]
    fn reflectances_of_materials_are_derived_right(albedo in vec(0.0..1.0_f64, 3), metalness in 0.0..1.0_f64) {
        assert_vjp(
            &[&albedo[..], &[metalness]].concat(),
            |x| physical::reflectances(take3(x), x[3]).map(Vec3::to_array).concat(),
            |x, g| {
                let (albedo, metalness) = physical::reflectances_vjp(take3(x), x[3], [take3(g), take3(&g[3..])]);
                join(&[&albedo.to_array(), &[metalness]])
            },
            SAME_DERIVATIVE,
        );
    }

    /// From behind, too, where n·v is kept at its least.
    #[test]
    fn orientations_of_pixels_are_derived_right(normal in unit_vector(), size in 0.1..1.0_f64, view_dir in unit_vector()) {
        let facing_of = |x: &[Dual]| {
            let none = [Dual::of(0.5); 11];
            let facing = physical::pixel_facing(&Pixel { normal: take3(x), ..blended(&none) }, vector(view_dir));
            join(&[&facing.normal.to_array(), &[facing.n_dot_v]])
        };
        assert_vjp(
            &normal.map(|x| x * size),
            facing_of,
            |x, g| {
                let pixel = Pixel { normal: take3(x), ..blended(&[Double(0.5); 11]) };
                let grad = PixelFacing { normal: take3(g), n_dot_v: g[3] };
                physical::pixel_facing_vjp(&pixel, vector(view_dir), &grad).to_array().to_vec()
            },
            SAME_DERIVATIVE,
        );
    }

    #[test]
    fn colours_of_physical_pixels_are_derived_right(inputs in vec(0.01..1.0_f64, 19)) {
        assert_vjp(
            &inputs,
            |x| physical::pixel_color(&surface_of_pixel(x), &light_of_pixel(&x[10..]), x[18]).to_array().to_vec(),
            |x, g| {
                let (surface, light, coverage) =
                    physical::pixel_color_vjp(&surface_of_pixel(x), &light_of_pixel(&x[10..]), x[18], take3(g));
                let PixelLight { specular, irradiance, split_sum } = light;
                let lights = [&specular.to_array()[..], &irradiance.to_array(), &split_sum].concat();
                join(&[&numbers_of_surface(&surface), &lights, &[coverage]])
            },
            SAME_DERIVATIVE,
        );
    }

    #[test]
    fn exposures_are_derived_right(inputs in vec(-1.5..1.5_f64, 16)) {
        assert_vjp(
            &inputs,
            |x| expose::expose(&exposure_of(x), take3(&x[12..]), x[15]).to_array().to_vec(),
            |x, g| {
                let (own, color, coverage) =
                    expose::expose_vjp(&exposure_of(x), take3(&x[12..]), x[15], take3(g));
                join(&[own.as_flattened(), &color.to_array(), &[coverage]])
            },
            SAME_DERIVATIVE,
        );
    }

    /// Far to the side, too, where the Jacobian is taken at the limit of the slopes.
    #[test]
    fn projections_are_derived_right(
        camera in camera(),
        mean in [-2.5..2.5_f64, -2.5..2.5, -2.5..2.5],
        scales in [-4.0..0.5_f64, -4.0..0.5, -4.0..0.5],
        quat in quat(),
        opacity_logit in -3.0..3.0_f64,
        filter in prop::option::of(-4.0..0.5_f64),
        low_pass in prop_oneof![Just(LowPass::Dilated), Just(LowPass::Compensated), Just(LowPass::Mip)],
    ) {
        prop_assume!(depth_of(&camera, mean) > 2.0 * f64::from(NEAR));
        let inputs = [&mean[..], &scales, &quat, &[opacity_logit]].concat();
        assert_vjp(
            &inputs,
            |x| {
                let shape = shape(x, low_pass, filter.map(|filter| x[0].constant(filter.exp() as f32)));
                let splat = project::project(&shape, &camera.lift(x[0]));
                join(&[&splat.mean2d, &splat.root_conic, &[splat.depth, splat.opacity]])
            },
            |x, g| {
                let grad = SplatGrad {
                    mean2d: [g[0], g[1]],
                    root_conic: [g[2], g[3], g[4]],
                    depth: g[5],
                    opacity: g[6],
                };
                let shape = shape(x, low_pass, filter.map(|filter| x[0].constant(filter.exp() as f32)));
                let grad = project::project_vjp(&shape, &camera.lift(x[0]), &grad);
                join(&[&grad.mean.to_array(), &grad.log_scales.to_array(), &grad.quat, &[grad.opacity_logit]])
            },
            SAME_DERIVATIVE,
        );
    }

    /// Rotations count as nine independent numbers, and what does not belong to the pose is fixed.
    #[test]
    fn projections_are_derived_right_along_the_pose_of_the_camera(
        camera in camera(),
        mean in [-2.5..2.5_f64, -2.5..2.5, -2.5..2.5],
        scales in [-4.0..0.5_f64, -4.0..0.5, -4.0..0.5],
        quat in quat(),
        opacity_logit in -3.0..3.0_f64,
        low_pass in prop_oneof![Just(LowPass::Dilated), Just(LowPass::Compensated)],
    ) {
        prop_assume!(depth_of(&camera, mean) > 2.0 * f64::from(NEAR));
        let gaussian = [&mean[..], &scales, &quat, &[opacity_logit]].concat();
        assert_vjp(
            &pose_of(&camera),
            |x| {
                let splat = project::project(&shape(&numbers(&gaussian), low_pass, None), &posed(&camera, x));
                join(&[&splat.mean2d, &splat.root_conic, &[splat.depth, splat.opacity]])
            },
            |x, g| {
                let grad = SplatGrad {
                    mean2d: [g[0], g[1]],
                    root_conic: [g[2], g[3], g[4]],
                    depth: g[5],
                    opacity: g[6],
                };
                let shape = shape(&numbers(&gaussian), low_pass, None);
                numbers_of_pose(&project::project_camera_vjp(&shape, &posed(&camera, x), &grad))
            },
            SAME_DERIVATIVE,
        );
    }

    /// The centre of the camera follows from the matrix, whose twelve numbers are independent.
    #[test]
    fn view_matrices_are_derived_right(rotation in rotation(), translation in any_vector(), point in any_vector()) {
        let rows = [0, 1, 2].map(|row| rotation.row(row).to_array().map(f64::from));
        let inputs = [rows.as_flattened(), &translation].concat();
        let camera = Camera::look_at(glam::Vec3::Y, glam::Vec3::ZERO, glam::Vec3::Z, 0.5, 8, 8);
        // Rounding of the matrix to f32: its inverse is taken to be its transpose.
        const NEARLY_A_ROTATION: f64 = 1e-5;
        assert_vjp(
            &inputs,
            |x| {
                let (matrix, translation) = (take9(x), take3(&x[9..]));
                let [a, b, c] = matrix.rows;
                let volume = a.dot(b.cross(c));
                let inverse = Mat3::from_columns([b.cross(c), c.cross(a), a.cross(b)].map(|column| column * volume.recip()));
                let position = -inverse.transform(translation);
                let camera = CameraOf { camera_from_world: matrix, position, ..camera.lift(x[0]) };
                join(&[&camera.to_camera(vector(point)).to_array(), &position.to_array()])
            },
            |x, g| {
                let (matrix, translation) = (take9(x), take3(&x[9..]));
                let position = -matrix.transform_transposed(translation);
                let camera = CameraOf { camera_from_world: matrix, position, ..camera.lift(x[0]) };
                let [gx, gy, gz] = [g[0], g[1], g[2]];
                let from_center = vector(point) - position;
                let grad = CameraGrad {
                    camera_from_world: Mat3 { rows: [from_center * gx, from_center * gy, from_center * gz] },
                    position: take3(&g[3..]) - matrix.transform_transposed(take3(g)),
                };
                let (matrix, translation) = grad.view_matrix(&camera);
                join(&[&numbers_of(&matrix), &translation.to_array()])
            },
            NEARLY_A_ROTATION,
        );
    }

    /// A filter in space widens scales and makes opacity less.
    #[test]
    fn filters_in_space_are_derived_right(
        scales in [0.01..2.0_f64, 0.01..2.0, 0.01..2.0],
        opacity in 0.01..0.99_f64,
        filter in 0.0..2.0_f32,
    ) {
        let inputs = [&scales[..], &[opacity]].concat();
        assert_vjp(
            &inputs,
            |x| {
                let (scales, opacity) = antialias::smoothed(take3(x), x[3], x[0].constant(filter));
                join(&[&scales.to_array(), &[opacity]])
            },
            |x, g| {
                let filter = x[0].constant(filter);
                let (scales, opacity) = antialias::smoothed_vjp(take3(x), x[3], filter, take3(g), g[3]);
                join(&[&scales.to_array(), &[opacity]])
            },
            SAME_DERIVATIVE,
        );
    }

    /// Of activated scales and opacity, from what is stored.
    #[test]
    fn scales_and_opacities_are_derived_right(
        stored in vec(-3.0..1.0_f64, 8),
        filter in prop::option::of(0.0..2.0_f32),
    ) {
        assert_vjp(
            &stored,
            |x| {
                let shape = stored_shape(x, filter);
                let (scales, opacity) = shape.scales_and_opacity();
                join(&[&scales.to_array(), &[opacity]])
            },
            |x, g| {
                let (scales, opacity) = stored_shape(x, filter).scales_and_opacity_vjp(take3(g), g[3]);
                join(&[&scales.to_array(), &[x[0].zero(); 4], &[opacity]])
            },
            SAME_DERIVATIVE,
        );
    }

    /// From stored planes to splats and channels, with lookups of a light that is a formula.
    #[test]
    fn attributes_are_derived_right(
        camera in camera(),
        mean in [-2.5..2.5_f64, -2.5..2.5, -2.5..2.5],
        scales in log_scales(-3.0..0.5),
        quat in quat(),
        rest in vec(-0.4..0.4_f64, 30),
        low_pass in prop_oneof![Just(LowPass::Dilated), Just(LowPass::Mip)],
    ) {
        prop_assume!(depth_of(&camera, mean) > 2.0 * f64::from(NEAR));
        let physical = [&mean[..], &scales, &quat, &rest].concat();
        let shaded = physical[..Layout::shaded(Some(1)).plane_count()].to_vec();
        let plain = &shaded[..Layout::radiance(1).plane_count()];
        let shadings = [ShadingRules::PAPER, ShadingRules::OFFICIAL, ShadingRules::DEFERRED];
        let shadings = shadings.map(|shading| (Layout::shaded(Some(1)), shading));
        let others = [
            (Layout::radiance(1), ShadingRules::PAPER),
            (Layout::shaded(Some(1)).physical(), ShadingRules::PHYSICAL),
        ];
        for (layout, shading) in shadings.into_iter().chain(others) {
            let rules = RenderRules::full(shading, PrefilterScheme::Exact, Channels::Training);
            let layout = Layout { low_pass, ..layout };
            let shading = GaussianShading { layout, rules };
            let inputs = match (layout.is_shaded(), layout.is_physical) {
                (false, _) => plain,
                (true, false) => &shaded,
                (true, true) => &physical,
            };
            assert_vjp(
                inputs,
                |x| splat_and_channels(&shading, &camera.lift(x[0]), x),
                |x, g| splat_and_channels_vjp(&shading, &camera.lift(x[0]), x, g).0,
                SAME_DERIVATIVE,
            );
            assert_vjp(
                &pose_of(&camera),
                |x| splat_and_channels(&shading, &posed(&camera, x), &numbers(inputs)),
                |x, g| {
                    let (_, grad) = splat_and_channels_vjp(&shading, &posed(&camera, x), &numbers(inputs), g);
                    numbers_of_pose(&grad)
                },
                SAME_DERIVATIVE,
            );
        }
    }

    /// Opaque splats that are limited or end a pixel, and faint ones that are cut, are among them.
    #[test]
    fn stacks_of_splats_are_derived_right(
        stack in vec((vec(-1.5..1.5_f64, 2), 0.2..1.5_f64, -0.5..0.5_f64, 0.2..1.5_f64, 0.02..1.0_f64), 6),
        colors in vec(0.0..1.0_f64, 18),
    ) {
        let splats = stack.iter().flat_map(|(mean, xx, yx, yy, opacity)| [mean[0], mean[1], *xx, *yx, *yy, *opacity]);
        let inputs: Vec<f64> = splats.chain(colors).collect();
        assert_vjp(&inputs, blend_stack, blend_stack_vjp, SAME_DERIVATIVE);
    }

    /// The logarithm of a splat's strength in one pixel, whose moment is its offset.
    #[test]
    fn centers_of_splats_are_derived_right_in_one_pixel(
        center in vec(-1.5..1.5_f64, 2), root in (0.2..1.5_f64, -0.5..0.5_f64, 0.2..1.5_f64),
    ) {
        assert_vjp(
            &center,
            |x| vec![in_one_pixel(x, root).1.log2_strength * x[0].constant(2.0).ln()],
            |x, g| {
                let (splat, falloff) = in_one_pixel(x, root);
                blend::center_vjp(&splat, falloff.offset.map(|offset| offset * g[0])).to_vec()
            },
            SAME_DERIVATIVE,
        );
    }

    #[test]
    fn expected_depth_is_derived_right(blended in 0.1..5.0_f64, coverage in 0.1..1.0_f64) {
        assert_vjp(
            &[blended, coverage],
            |x| vec![depth_normal::expected_depth(x[0], x[1])],
            |x, g| {
                let depth = depth_normal::expected_depth(x[0], x[1]);
                let (blended, coverage) = depth_normal::expected_depth_vjp(depth, x[1], g[0]);
                vec![blended, coverage]
            },
            SAME_DERIVATIVE,
        );
    }

    #[test]
    fn normals_of_depth_are_derived_right(x in -1.0..1.0_f64, y in -1.0..1.0_f64, depths in vec(1.0..1.2_f64, 4)) {
        const STEP: f64 = 0.05;
        assert_vjp(
            &depths,
            |d| depth_normal::normal(&rays_around(x, y, STEP), &cross(d)).to_array().to_vec(),
            |d, g| {
                let grad = depth_normal::normal_vjp(&rays_around(x, y, STEP), &cross(d), take3(g));
                vec![grad.left, grad.right, grad.above, grad.below]
            },
            SAME_DERIVATIVE,
        );
    }

    #[test]
    fn losses_of_one_number_are_derived_right(x in 0.0..1.0_f64, y in 0.0..1.0_f64, logit in -30.0..30.0_f64) {
        assert_vjp(
            &[x],
            |x| vec![loss::absolute(x[0], Number::of(y)), loss::squared(x[0], Number::of(y))],
            |x, g| vec![loss::absolute_vjp(x[0], Double(y), g[0]) + loss::squared_vjp(x[0], Double(y), g[1])],
            SAME_DERIVATIVE,
        );
        assert_vjp(
            &[x],
            |x| vec![loss::sparse_coverage(x[0])],
            |x, g| vec![loss::sparse_coverage_vjp(x[0], g[0])],
            SAME_DERIVATIVE,
        );
        assert_vjp(&[logit], |x| vec![loss::sparse(x[0])], |x, g| vec![loss::sparse_vjp(x[0], g[0])], SAME_DERIVATIVE);
    }

    #[test]
    fn recorded_numbers_are_derived_right(x in 0.0..2.0_f64, white: bool, opaque: bool, y in 0.0..0.9_f64) {
        prop_assume!((x - 1.0).abs() > 1e-3);
        let (truth, alpha) = (if white { 1.0 } else { y }, if opaque { 1.0 } else { y });
        let recorded = loss::recorded(Double(x), Double(truth), Double(alpha)).0;
        assert_eq!(recorded, if white && opaque { x.min(1.0) } else { x });
        assert_vjp(
            &[x],
            |x| vec![loss::recorded(x[0], Number::of(truth), Number::of(alpha))],
            |_, g| vec![loss::recorded_vjp(Double(recorded), Double(truth), g[0])],
            SAME_DERIVATIVE,
        );
    }

    #[test]
    fn limited_values_are_derived_right(numbers in vec(-2.0..2.0_f64, 3), share_of_limit in -2.0..2.0_f64) {
        prop_assume!((share_of_limit.abs() - 1.0).abs() > 1e-3);
        let mut colors = numbers;
        colors[0] = share_of_limit * f64::from(color::COLOR_MAX);
        assert_vjp(
            &colors,
            |x| color::limited(take3(x)).to_array().to_vec(),
            |x, g| color::limited_vjp(take3(x), take3(g)).to_array().to_vec(),
            SAME_DERIVATIVE,
        );
        // Half of the square of a residual, whose gradient is constant beyond the limit.
        assert_vjp(
            &[colors[1]],
            |x| vec![x[0] * x[0] * 0.5],
            |x, g| vec![loss::residual_vjp(x[0], g[0])],
            SAME_DERIVATIVE,
        );
    }

    #[test]
    fn losses_on_attributes_are_derived_right(numbers in vec(-2.0..2.0_f64, Layout::shaded(None).plane_count())) {
        let losses = AttributeLosses { is_sparse: true, has_residual: true, metalness_plane: None };
        assert_vjp(
            &numbers,
            |x| vec![losses.loss(&PlaneRow(x), [x[0].constant(0.3), x[0].constant(0.7), x[0].zero(), x[0].zero()])],
            |x, g| {
                let mut out = PlaneRowGrads(vec![g[0].zero(); x.len()]);
                losses.loss_vjp(&PlaneRow(x), [g[0] * 0.3, g[0] * 0.7, g[0].zero(), g[0].zero()], &mut out);
                out.0
            },
            SAME_DERIVATIVE,
        );
    }

    #[test]
    fn metalness_is_derived_right(logit in -6.0..6.0_f64, suggested in 0.0..1.0_f64) {
        assert_vjp(
            &[logit],
            |x| vec![loss::metalness(x[0], Number::of(suggested))],
            |x, g| vec![loss::metalness_vjp(x[0], Double(suggested), g[0])],
            SAME_DERIVATIVE,
        );
    }

    #[test]
    fn coverage_beyond_its_margin_is_derived_right(beyond in -0.1..0.00099_f64) {
        for coverage in [beyond, 1.0 - beyond] {
            assert_vjp(
                &[coverage],
                |x| vec![loss::sparse_coverage(x[0])],
                |x, g| vec![loss::sparse_coverage_vjp(x[0], g[0])],
                SAME_DERIVATIVE,
            );
        }
    }

    #[test]
    fn structural_similarity_is_derived_right(means in [0.0..1.0_f64, 0.0..1.0], rest in [0.0..0.2_f64, 0.0..0.2, -0.1..0.1]) {
        let [x, y] = means;
        let inputs = [x, x * x + rest[0], x * y + rest[2]];
        let moments = |m: &[_]| loss::SsimMoments {
            x: m[0],
            y: Number::of(y),
            xx: m[1],
            yy: Number::of(y * y + rest[1]),
            xy: m[2],
        };
        assert_vjp(&inputs, |m| vec![loss::ssim(&moments(m))], |m, g| {
            let moments = loss::SsimMoments {
                x: m[0],
                y: Double(y),
                xx: m[1],
                yy: Double(y * y + rest[1]),
                xy: m[2],
            };
            loss::ssim_vjp(&moments, g[0]).to_vec()
        }, SAME_DERIVATIVE);
    }

    /// A pixel adds to the means of x, x² and xy of every window that sees it.
    #[test]
    fn pixels_in_windows_are_derived_right(x in 0.0..1.0_f64, y in 0.0..1.0_f64) {
        assert_vjp(
            &[x],
            |x| vec![x[0], x[0] * x[0], x[0] * Dual::of(y)],
            |x, g| vec![loss::ssim_pixel_vjp(x[0], Double(y), [g[0], g[1], g[2]])],
            SAME_DERIVATIVE,
        );
    }

    #[test]
    fn normal_losses_are_derived_right(rendered in any_vector(), geometric in any_vector()) {
        let inputs = join_f64(&rendered, &geometric);
        assert_vjp(
            &inputs,
            |x| vec![loss::normal_distance(take3(x), take3(&x[3..]))],
            |x, g| {
                let grad = loss::normal_distance_vjp(take3(x), take3(&x[3..]), g[0]);
                join(&[&grad.to_array(), &(-grad).to_array()])
            },
            SAME_DERIVATIVE,
        );
        assert_vjp(
            &inputs,
            |x| vec![loss::normal_cosine(take3(x), take3(&x[3..]))],
            |x, g| {
                let (rendered, geometric) = loss::normal_cosine_vjp(take3(x), take3(&x[3..]), g[0]);
                join(&[&rendered.to_array(), &geometric.to_array()])
            },
            SAME_DERIVATIVE,
        );
    }

    /// The authors' form holds the geometric normal fixed: its depths have no gradient.
    #[test]
    fn normal_losses_of_pixels_are_derived_right(
        rendered in any_vector(),
        depths in vec(1.0..1.2_f64, 4),
        rotation in rotation(),
        place in [-1.0..1.0_f64, -1.0..1.0_f64],
    ) {
        let inputs: Vec<f64> = rendered.iter().chain(&depths).copied().collect();
        for form in [NormalForm::Distance, NormalForm::Cosine] {
            assert_vjp(
                &inputs,
                |x| vec![loss::normal_loss(form, &Mat3::constant(x[0], rotation), &patch(place, x), x[0].zero()).0],
                |x, g| grads_of_patch(form, rotation, place, x, g[0]),
                SAME_DERIVATIVE,
            );
        }
        let numbers: Vec<Double> = inputs.iter().map(|x| Double(*x)).collect();
        let [detached, attached] = [NormalForm::CosineDetached, NormalForm::Cosine]
            .map(|form| grads_of_patch(form, rotation, place, &numbers, Double(0.7)));
        prop_assert_eq!(&detached[..3], &attached[..3]);
        prop_assert_eq!(&detached[3..], &[Double(0.0); 4]);
    }

    #[test]
    fn the_bending_of_lines_is_derived_right(
        normals in vec(unit_vector(), 3),
        eye in unit_vector(),
        weight in 0.1..1.0_f64,
    ) {
        assert_vjp(
            &normals.concat(),
            |x| vec![smoothness::bending(&line_of(x), vector(eye), Number::of(weight))],
            |x, g| {
                let slope = smoothness::bending_vjp(&line_of(x), vector(eye), Double(weight), g[0]);
                [slope, -(slope + slope), slope].iter().flat_map(|slope| slope.to_array()).collect()
            },
            SAME_DERIVATIVE,
        );
    }

    #[test]
    fn unit_normals_are_derived_right(blended in unit_vector(), coverage in 0.1..1.0_f64) {
        for is_surface in [true, false] {
            assert_vjp(
                &blended.map(|x| x * coverage),
                |x| smoothness::unit_normal(take3(x), is_surface).to_array().to_vec(),
                |x, g| smoothness::unit_normal_vjp(take3(x), is_surface, take3(g)).to_array().to_vec(),
                SAME_DERIVATIVE,
            );
        }
    }

    #[test]
    fn colours_over_a_background_are_derived_right(color in 0.0..1.0_f64, passed in 0.0..1.0_f64, behind in 0.0..1.0_f64) {
        assert_vjp(
            &[color, passed],
            |x| vec![color::composite(x[0], x[1], Number::of(behind))],
            |_, g| vec![g[0], color::composite_vjp(Double(behind), g[0], Double(0.0))],
            SAME_DERIVATIVE,
        );
    }
}

#[test]
fn vectors_without_a_direction_have_no_gradient() {
    let grad = vector::normalize_or_vjp(vector::<Double>([0.0; 3]), vector([1.0, 2.0, 3.0]));
    assert_eq!(grad, vector([0.0; 3]), "a constant fallback has no derivative");
    let grad = covariance::rotation_vjp([Double(0.0); 4], &take9(&[Double(1.0); 9]));
    assert_eq!(grad, [Double(0.0); 4], "nor has the identity");
}

/// Planes of one Gaussian, side by side.
struct PlaneRow<'a, R>(&'a [R]);

impl<R: Number> AttributePlanes<R> for PlaneRow<'_, R> {
    fn number(&self, plane: usize) -> R {
        self.0[plane]
    }
}

/// Gradients of the planes of one Gaussian, side by side.
struct PlaneRowGrads<R>(Vec<R>);

impl<R: Number> AttributeGrads<R> for PlaneRowGrads<R> {
    fn set(&mut self, plane: usize, grad: R) {
        self.0[plane] = grad;
    }
}

/// A light that is a formula of the directions and the roughness in which it is looked up.
fn light_of<R: Number>(shaded: &ShadedGaussian<R>) -> LightSample<R> {
    let surface = &shaded.surface;
    LightSample {
        specular: surface.reflection_dir * surface.roughness,
        ambient: surface.facing.normal * R::of(2.0),
        split_sum: [surface.n_dot_v * surface.roughness, surface.n_dot_v],
    }
}

fn light_of_vjp<R: Number>(shaded: &ShadedGaussian<R>, grad: &Terms<R>) -> LookupGrad<R> {
    let surface = &shaded.surface;
    let along = grad.specular_light.dot(surface.reflection_dir);
    let [scale, bias] = grad.split_sum;
    LookupGrad {
        specular: Some((grad.specular_light * surface.roughness, along)),
        ambient: Some((grad.ambient_light * R::of(2.0), [scale * surface.roughness + bias, scale * surface.n_dot_v])),
    }
}

/// Channels that have a gradient.
fn channels_with_grad(shading: &GaussianShading) -> Vec<usize> {
    let all = 0..Channels::Surface.count();
    all.filter(|k| shading.layout.is_shaded() || *k < channel::NORMAL || *k == channel::DEPTH).collect()
}

/// Centre, root of the conic and opacity of the splat, then the channels.
/// Planes of a Gaussian with the ambient transfer of a physical material, which is constant.
fn with_ambient<R: Number>(layout: Layout, x: &[R]) -> Vec<R> {
    let ambient = if layout.is_physical { &[0.6, 0.9, 1.2][..] } else { &[] };
    x.iter().copied().chain(ambient.iter().map(|x| R::of(*x))).collect()
}

fn splat_and_channels<R: Number>(shading: &GaussianShading, camera: &CameraOf<R>, x: &[R]) -> Vec<R> {
    let planes = PlaneRow(&with_ambient(shading.layout, x));
    let splat = project::project(&planes.shape(shading.layout), camera);
    let channels = if shading.layout.is_shaded() {
        let shaded = shading.shaded(&planes, camera.position);
        shading.surface_channels(&shaded, &shaded.terms(&light_of(&shaded)), camera)
    } else {
        shading.color_channels(&planes, camera).0
    };
    let channels: Vec<R> = channels_with_grad(shading).into_iter().map(|k| channels.0[k]).collect();
    join(&[&splat.mean2d, &splat.root_conic, &[splat.opacity], &channels])
}

/// Gradients of the planes, and of the camera's pose.
fn splat_and_channels_vjp<R: Number>(
    shading: &GaussianShading,
    camera: &CameraOf<R>,
    x: &[R],
    g: &[R],
) -> (Vec<R>, CameraGrad<R>) {
    let planes = PlaneRow(&with_ambient(shading.layout, x));
    let mut channels = LayerChannels([R::of(0.0); Channels::Layers.count()]);
    for (k, grad) in channels_with_grad(shading).into_iter().zip(&g[6..]) {
        channels.0[k] = *grad;
    }
    let mut out = PlaneRowGrads(vec![R::of(0.0); x.len()]);
    let pose = if shading.layout.is_shaded() {
        let shaded = shading.shaded(&planes, camera.position);
        let grad = shading.terms_vjp(&shaded.terms(&light_of(&shaded)), &channels);
        let lookup = light_of_vjp(&shaded, &grad);
        shading.surface_vjp(&planes, camera.position, &shaded, &grad, &channels, &lookup, &mut out)
    } else {
        shading.radiance_vjp(&planes, camera.position, &channels, &mut out)
    };
    let depth = channels.0[channel::DEPTH];
    let splat = SplatGrad { mean2d: [g[0], g[1]], root_conic: [g[2], g[3], g[4]], depth, opacity: g[5] };
    let shape = planes.shape(shading.layout);
    attributes::shape_vjp(&shape, camera, &splat, &pose, &mut out);
    (out.0, attributes::camera_vjp(&shape, camera, &splat, &pose))
}

/// Rotation of a camera by rows, then its centre.
fn pose_of(camera: &Camera) -> Vec<f64> {
    let lifted = camera.lift(Double(0.0));
    let numbers = join(&[&numbers_of(&lifted.camera_from_world), &lifted.position.to_array()]);
    numbers.into_iter().map(Double::value).collect()
}

/// The same camera in another pose.
fn posed<R: Number>(camera: &Camera, x: &[R]) -> CameraOf<R> {
    CameraOf { camera_from_world: take9(x), position: take3(&x[9..]), ..camera.lift(x[0]) }
}

fn numbers_of_pose<R: Number>(grad: &CameraGrad<R>) -> Vec<R> {
    join(&[&numbers_of(&grad.camera_from_world), &grad.position.to_array()])
}

fn numbers<R: Number>(values: &[f64]) -> Vec<R> {
    values.iter().map(|x| R::of(*x)).collect()
}

#[test]
fn layers_of_a_network_are_derived_right() {
    const IN: usize = 5;
    let numbers = |count: usize, stream: u64| random_cotangent(count, stream);
    let weights = numbers((IN + 1) * 3, 1);
    let inputs = numbers(IN, 2);
    assert_vjp(
        &inputs,
        |x| light_network::dense::<_, 3>(&weights.iter().map(|w| Dual::of(*w)).collect::<Vec<_>>(), x).to_vec(),
        |_, g| {
            let weights: Vec<Double> = weights.iter().map(|w| Double(*w)).collect();
            let grads: [Double; IN] = light_network::dense_vjp(&weights, &[g[0], g[1], g[2]]);
            grads.to_vec()
        },
        SAME_DERIVATIVE,
    );
    assert_vjp(
        &weights,
        |w| light_network::dense::<_, 3>(w, &inputs.iter().map(|x| Dual::of(*x)).collect::<Vec<_>>()).to_vec(),
        |w, g| {
            let inputs: Vec<Double> = inputs.iter().map(|x| Double(*x)).collect();
            let mut out = vec![Double(0.0); w.len()];
            light_network::dense_weights_vjp(&inputs, &[g[0], g[1], g[2]], &mut out);
            out
        },
        SAME_DERIVATIVE,
    );
}

#[test]
fn bounds_of_a_network_are_derived_right() {
    let (weight, hidden) = (f64::from(WEIGHT_MAX), f64::from(HIDDEN_MAX));
    for x in [-2.0 * weight, -0.7, 0.4, 2.0 * weight] {
        assert_vjp(
            &[x],
            |x| vec![light_network::bounded(x[0], WEIGHT_MAX)],
            |x, g| vec![light_network::bounded_vjp(x[0], WEIGHT_MAX, g[0])],
            SAME_DERIVATIVE,
        );
    }
    for x in [-3.0, 0.4, 0.5 * hidden, 2.0 * hidden] {
        assert_vjp(
            &[x],
            |x| vec![light_network::rectify(x[0])],
            |x, g| vec![light_network::rectify_vjp(light_network::rectify(x[0]), g[0])],
            SAME_DERIVATIVE,
        );
    }
}

#[test]
fn the_network_is_derived_right() {
    let light = random_environment(16, RadianceActivation::Network, 3);
    let weights: Vec<f64> = light.values.iter().map(|weight| f64::from(*weight)).collect();
    for direction in [[0.6, -0.48, 0.64], [0.0, 0.28, -0.96]].map(vector) {
        let encoding = light_network::encode(direction, &[Double(0.9); DEGREES.len()]);
        let numbers = encoding.map(|x| x.0);
        assert_vjp(
            &weights,
            |w| light_network::evaluate(w, &core::array::from_fn(|k| Dual::of(numbers[k]))).numbers().to_vec(),
            |w, g| {
                let mut out = vec![Double(0.0); WEIGHT_COUNT];
                let answers = light_network::evaluate(w, &encoding);
                light_network::evaluate_vjp(w, &encoding, &answers, [g[0], g[1], g[2]], &mut out);
                out
            },
            SAME_DERIVATIVE,
        );
    }
    let far = Answers { hidden: [[0.0_f32; 64]; 2], sums: [1e9_f32, -1e9, 1.0] };
    assert_eq!(far.numbers(), [NUMBER_MAX, -NUMBER_MAX, 1.0]);
}

/// Finds a `_vjp` that no test checks. Methods are called on a value.
#[test]
fn every_vjp_of_core_is_held_against_dual_numbers() {
    let here = concat!(include_str!("derivatives.rs"), include_str!("tape.rs"));
    let sources = concat!(env!("CARGO_MANIFEST_DIR"), "/../core/src");
    let mut found = 0;
    for entry in std::fs::read_dir(sources).expect("core lies beside this crate") {
        let path = entry.expect("a readable folder").path();
        let module = path.file_stem().and_then(|stem| stem.to_str()).expect("a file name").to_owned();
        for line in std::fs::read_to_string(&path).expect("readable source").lines() {
            let Some(rest) = line.trim_start().strip_prefix("pub fn ") else { continue };
            let name = rest.split(['<', '(']).next().unwrap_or_default();
            if name.ends_with("_vjp") {
                found += 1;
                let is_method = line.starts_with(' ');
                let call = if is_method { format!(".{name}(") } else { format!("{module}::{name}(") };
                assert!(here.contains(&call), "nothing here calls {module}::{name}");
            }
        }
    }
    assert!(found > 25, "only {found} were found: has core moved?");
}

fn line_of<R: Number>(x: &[R]) -> Line<R> {
    Line { before: take3(x), at: take3(&x[3..]), after: take3(&x[6..]) }
}

fn join_f64(a: &[f64], b: &[f64]) -> Vec<f64> {
    [a, b].concat()
}

fn depth_of(camera: &Camera, mean: [f64; 3]) -> f64 {
    camera.lift(Double(0.0)).to_camera(vector(mean)).z.0
}

/// Log scales, quat, opacity.
fn stored_shape<R: Number>(x: &[R], filter: Option<f32>) -> Shape<R> {
    let numbers = join(&[&[x[0].zero(); 3], x]);
    shape(&numbers, LowPass::Dilated, filter.map(|filter| x[0].constant(filter)))
}

/// mean, log scales, quat, opacity.
fn shape<R: Number>(x: &[R], low_pass: LowPass, filter: Option<R>) -> Shape<R> {
    let quat = [x[6], x[7], x[8], x[9]];
    Shape { mean: take3(x), log_scales: take3(&x[3..]), quat, opacity_logit: x[10], low_pass, filter }
}

/// mean, quat, log scales, diffuse, tint, roughness, residuals.
fn material<R: Number>(x: &[R]) -> Material<R> {
    Material {
        mean: take3(x),
        quat: [x[3], x[4], x[5], x[6]],
        log_scales: take3(&x[7..]),
        diffuse: take3(&x[10..]),
        tint: take3(&x[13..]),
        roughness: x[16],
        normal_residuals: [take3(&x[17..]), take3(&x[20..])],
    }
}

fn numbers_of_material<R: Number>(m: &Material<R>) -> Vec<R> {
    let [first, second] = m.normal_residuals;
    join(&[
        &m.mean.to_array(),
        &m.quat,
        &m.log_scales.to_array(),
        &m.diffuse.to_array(),
        &m.tint.to_array(),
        &[m.roughness],
        &first.to_array(),
        &second.to_array(),
    ])
}

fn terms<R: Number>(x: &[R]) -> Terms<R> {
    Terms {
        diffuse: take3(x),
        tint: take3(&x[3..]),
        specular_light: take3(&x[6..]),
        residual: take3(&x[9..]),
        ambient_light: take3(&x[12..]),
        split_sum: [x[15], x[16]],
    }
}

fn texels<R: Number>(x: &[R]) -> [Vec3<R>; 4] {
    [take3(x), take3(&x[3..]), take3(&x[6..]), take3(&x[9..])]
}

/// Four texels, right, lower.
fn bilinear<R: Number>(x: &[R]) -> Vec<R> {
    cubemap::bilinear(texels(x), x[12], x[13]).to_array().to_vec()
}

fn texel_grads<R: Number>(right: R, lower: R, grad: Vec3<R>) -> Vec<R> {
    cubemap::bilinear_weights(right, lower).iter().flat_map(|&weight| (grad * weight).to_array()).collect()
}

fn cross<R: Number>(depths: &[R]) -> depth_normal::Cross<R> {
    depth_normal::Cross { left: depths[0], right: depths[1], above: depths[2], below: depths[3] }
}

/// A pixel's normal and its neighbours' depths, from seven numbers.
fn patch<R: Number>([x, y]: [f64; 2], numbers: &[R]) -> NormalPatch<R> {
    const STEP: f64 = 0.05;
    NormalPatch {
        rays: rays_around(x, y, STEP),
        depths: cross(&numbers[3..]),
        rendered: take3(numbers),
        coverage: R::of(0.8),
    }
}

fn grads_of_patch<R: Number>(form: NormalForm, rotation: glam::Mat3, place: [f64; 2], x: &[R], grad: R) -> Vec<R> {
    let (_, rendered, depths) = loss::normal_loss(form, &Mat3::constant(grad, rotation), &patch(place, x), grad);
    join(&[&rendered.to_array(), &[depths.left, depths.right, depths.above, depths.below]])
}

fn rays_around<R: Number>(x: f64, y: f64, step: f64) -> depth_normal::Cross<Vec3<R>> {
    let ray = |x: f64, y: f64| vector([x, y, 1.0]);
    depth_normal::Cross {
        left: ray(x - step, y),
        right: ray(x + step, y),
        above: ray(x, y - step),
        below: ray(x, y + step),
    }
}

const STACK: usize = 6;
/// Pixel centres that a stack is seen from.
const PIXELS: [[f32; 2]; 4] = [[0.0, 0.0], [1.0, 0.5], [-1.0, 0.5], [0.5, -2.0]];

/// Splat `k` of a stack: centre, root of the conic, opacity; its colour follows after all splats.
fn stack_entry<R: Number>(x: &[R], k: usize) -> ([R; 2], Splat2d<R>, R, Vec3<R>) {
    let s = &x[6 * k..];
    let mean2d = [s[0], s[1]];
    (mean2d, Splat2d::new(mean2d, [s[2], s[3], s[4]], s[5].log2()), s[5], take3(&x[6 * STACK + 3 * k..]))
}

/// Colour and final transmittance of every pixel.
fn blend_stack<R: Number>(x: &[R]) -> Vec<R> {
    let pixel = |[px, py]: [f32; 2]| {
        let (mut color, mut state) = (Vec3::zero(x[0]), blend::PixelState::open(x[0]));
        for k in 0..STACK {
            let (mean2d, footprint, _, splat_color) = stack_entry(x, k);
            let falloff = blend::falloff(&footprint, -mean2d[0] + px, -mean2d[1] + py);
            let step = blend::step(blend::alpha(falloff.log2_strength), state);
            color = color.add_scaled(step.weight, splat_color);
            state = step.behind;
        }
        join(&[&color.to_array(), &[state.final_transmittance]])
    };
    PIXELS.iter().flat_map(|&p| pixel(p)).collect()
}

/// A splat of opacity 1 around a centre, and its falloff in a pixel.
fn in_one_pixel<R: Number>(x: &[R], (xx, yx, yy): (f64, f64, f64)) -> (Splat2d<R>, blend::Falloff<R>) {
    let splat = Splat2d::new([x[0], x[1]], [xx, yx, yy].map(R::of), R::of(0.0));
    let [px, py] = PIXELS[0];
    (splat, blend::falloff(&splat, -x[0] + px, -x[1] + py))
}

/// Base, tint, roughness, normal and coverage of a pixel.
fn blended<R: Number>(x: &[R]) -> Pixel<R> {
    Pixel { base: take3(x), tint: take3(&x[3..]), roughness: x[6], normal: take3(&x[7..]), coverage: x[10] }
}

fn surface_of_pixel<R: Number>(x: &[R]) -> PixelSurface<R> {
    PixelSurface { base: take3(x), tint: take3(&x[3..]), roughness: x[6], reflection_dir: take3(&x[7..]) }
}

/// Specular light, irradiance and split sum.
fn light_of_pixel<R: Number>(x: &[R]) -> PixelLight<R> {
    PixelLight { specular: take3(x), irradiance: take3(&x[3..]), split_sum: [x[6], x[7]] }
}

fn numbers_of_surface<R: Number>(surface: &PixelSurface<R>) -> Vec<R> {
    let [base, tint, reflection] = [surface.base, surface.tint, surface.reflection_dir].map(Vec3::to_array);
    join(&[&base, &tint, &[surface.roughness], &reflection])
}

fn blend_stack_vjp<R: Number>(x: &[R], grad: &[R]) -> Vec<R> {
    let zero = x[0].zero();
    let mut moments = [blend::OffsetMoments::zero(zero); STACK];
    let mut grad_colors = [Vec3::zero(zero); STACK];
    let image = blend_stack(x);
    for (p, &[px, py]) in PIXELS.iter().enumerate() {
        let (grad_color, grad_transmittance) = (take3(&grad[4 * p..]), grad[4 * p + 3]);
        let total = grad_color.dot(take3(&image[4 * p..])) + image[4 * p + 3] * grad_transmittance;
        let mut replay = blend::Replay { transmittance: zero.constant(1.0), remaining: total };
        for k in 0..STACK {
            let (mean2d, footprint, _, color) = stack_entry(x, k);
            let falloff = blend::falloff(&footprint, -mean2d[0] + px, -mean2d[1] + py);
            let step = blend::step_vjp(falloff.log2_strength, replay, color.dot(grad_color));
            grad_colors[k] = grad_colors[k].add_scaled(step.weight, grad_color);
            moments[k] = moments[k].with(step.log_strength, falloff.offset);
            replay = step.behind;
        }
    }
    let splat_grad = |k: usize| {
        let (_, footprint, opacity, _) = stack_entry(x, k);
        let grad = blend::moments_vjp(&footprint, opacity, &moments[k]);
        join(&[&grad.mean2d, &grad.root_conic, &[grad.opacity]])
    };
    let splats: Vec<R> = (0..STACK).flat_map(splat_grad).collect();
    let colors: Vec<R> = grad_colors.iter().flat_map(|c| c.to_array()).collect();
    join(&[&splats, &colors])
}
