//! Requirements of pictures.

use crate::{
    compare::{NEAR_TRIANGLES, assert_finite, closeness, same_planes},
    near_fields::{polished, random_near_field},
    report::{Report, Subject, require, requirements, said},
    strategies::{self, as_many_as_wanted},
    stress::{LAYOUT, every_case, poisoned},
    variants::every_variant,
    view::{RESOLUTION, Storage, View},
};
use core::cell::RefCell;
use proptest::{
    prelude::Strategy,
    test_runner::{TestCaseError, TestRunner},
};
use specula_core::{
    activation::logit,
    blend::MAX_ALPHA,
    camera::Scissor,
    executor::{Feature, Renderer, Unsupported},
    lamps::Lamp,
    pipeline,
    prefilter::PrefilterScheme,
    rules::{Channels, LightLayer, RenderRules, channel},
    scene::{LOG_SCALE, Layout, MEAN, METALNESS, OPACITY, ROUGHNESS, RadianceActivation, TINT},
    shade::ShadingRules,
};
use specula_oracle::{
    scenes::{camera, random_cloud, random_environment},
    stress::Case,
};

requirements! {
    $ renderer_requirements: Renderer;
    renderer::{
        arrays_come_back_unchanged,
        buffers_of_another_length_are_refused,
        gaussians_are_projected_to_their_place_and_shape,
        splats_are_blended_front_to_back_and_ties_in_their_order,
        opaque_splats_pass_a_hundredth_of_the_light,
        plain_gaussians_have_the_pictures_of_the_reference,
        light_of_gaussians_is_filtered_and_looked_up,
        light_of_pixels_is_filtered_and_looked_up,
        light_is_looked_up_in_its_place,
        pixels_without_light_keep_their_base_and_materials_are_black,
        random_views_have_the_pictures_of_the_reference,
        extreme_scenes_have_finite_pictures_near_the_reference,
        nonfinite_gaussians_are_left_out_to_the_last_bit,
        pictures_without_gaussians_or_pixels_are_empty,
        pictures_are_the_same_bits_every_time,
        frames_outlive_later_pictures,
        near_fields_are_traced_or_refused_by_name,
        lamps_shine_or_are_refused_by_name,
        lights_of_networks_are_evaluated_or_refused_by_name,
        the_official_filter_is_computed_or_refused_by_name,
        parts_of_pictures_have_the_bits_of_the_whole,
        surfaces_hide_splats_or_are_refused_by_name,
        median_depths_halve_the_light_or_are_refused_by_name,
        changes_of_some_gaussians_are_written_or_refused_by_name,
    };
    /// Writes one `#[test]` for each requirement of a `Renderer`. The argument makes the executor,
    /// or `None` where it cannot run; after a comma `F16` tells that it stores halves.
    renderer_tests
}

/// Checks the requirements of pictures.
pub fn check_renderer<E: Renderer>(subject: &Subject<'_, E>) -> Report {
    Report::of(subject, &renderer_requirements())
}

const fn rules(shading: ShadingRules, channels: Channels) -> RenderRules {
    RenderRules::full(shading, PrefilterScheme::Exact, channels)
}

/// Compares a picture with the reference.
fn near_reference<E: Renderer>(exec: &mut E, storage: Storage, view: &View, what: &str) -> Result<(), String> {
    close(&view.picture(exec)?, &view.exact(storage), view, what, same_planes(view.pixels()))
}

fn close(actual: &[f64], expected: &[f64], view: &View, what: &str, least: f64) -> Result<(), String> {
    let found = closeness(actual, expected, view.pixels());
    println!("{what}: {found:.1} dB");
    require(found >= least, || format!("{what}: {found:.1} dB from the expected picture, needed are {least:.1}"))
}

/// Uploads numbers and downloads them to the last bit.
///
/// # Errors
///
/// The fault.
pub fn arrays_come_back_unchanged<E: Renderer>(subject: &Subject<'_, E>) -> Result<(), String> {
    let mut exec = subject.executor();
    for len in [0, 1, 17, 4096] {
        let numbers: Vec<f32> = (0..len).map(|k| (k as f32 - 3.5) * 1.1).collect();
        let array = exec.upload(&numbers).map_err(said)?;
        let mut back = vec![f32::NAN; len];
        exec.download(&array, &mut back).map_err(said)?;
        require(back == numbers, || format!("{len} numbers came back changed"))?;
    }
    Ok(())
}

/// Refuses to download or to read into a buffer that is too short or too long.
///
/// # Errors
///
/// The fault.
pub fn buffers_of_another_length_are_refused<E: Renderer>(subject: &Subject<'_, E>) -> Result<(), String> {
    let mut exec = subject.executor();
    let array = exec.upload(&[1.0; 20]).map_err(said)?;
    let view = View::new(20, Layout::radiance(0), rules(ShadingRules::PAPER, Channels::Color), 1);
    let frame = view.frame(&mut exec).map_err(said)?;
    for more in [false, true] {
        let other = |len: usize| vec![0.0; if more { len + 1 } else { len - 1 }];
        let kind = if more { "long" } else { "short" };
        let accepted = exec.download(&array, &mut other(20)).is_ok();
        require(!accepted, || format!("an array was downloaded to a buffer that is too {kind}"))?;
        let accepted = exec.read_frame(&frame, &mut other(view.len())).is_ok();
        require(!accepted, || format!("a frame was read into a buffer that is too {kind}"))?;
    }
    Ok(())
}

/// Draws single Gaussians of several low-passes, through a camera whose pixels are not square and
/// whose axis is beside the centre.
///
/// # Errors
///
/// The fault.
pub fn gaussians_are_projected_to_their_place_and_shape<E: Renderer>(subject: &Subject<'_, E>) -> Result<(), String> {
    let mut exec = subject.executor();
    let plain = Layout::radiance(0);
    let compensated = Layout { low_pass: specula_core::antialias::LowPass::Compensated, ..plain };
    for (seed, layout) in (1..).zip([plain, compensated, plain.antialiased()]) {
        let mut view = View::new(1, layout, rules(ShadingRules::PAPER, Channels::Training), seed);
        view.gaussians.set(0, MEAN, [0.3, 0.1, -0.2]);
        view.gaussians.set(0, LOG_SCALE, [-0.3, -1.4, -0.9]);
        view.camera.focal_px[1] *= 1.15;
        view.camera.principal_px[0] += 3.25;
        view.camera.principal_px[1] -= 5.5;
        near_reference(&mut exec, subject.storage(), &view, &format!("one Gaussian of {:?}", layout.low_pass))?;
    }
    Ok(())
}

/// Limits the alpha of a splat to [`MAX_ALPHA`], so that behind an opaque one 1 − 0.99 remains.
///
/// # Errors
///
/// The fault.
pub fn opaque_splats_pass_a_hundredth_of_the_light<E: Renderer>(subject: &Subject<'_, E>) -> Result<(), String> {
    /// A rounding of 1 − 0.99.
    const ROUNDING: f64 = 1e-6;
    let mut view = View::new(1, Layout::radiance(0), rules(ShadingRules::PAPER, Channels::Color), 3);
    view.gaussians.set(0, MEAN, [0.0; 3]);
    view.gaussians.set(0, LOG_SCALE, [1.0; 3]);
    view.gaussians.set(0, OPACITY, [12.0]);
    let picture = view.picture(&mut subject.executor())?;
    let passed = picture[picture.len() - view.pixels()..].iter().copied().fold(f64::INFINITY, f64::min);
    let expected = f64::from(1.0 - MAX_ALPHA);
    require((passed - expected).abs() < ROUNDING, || {
        format!("{passed} of the light passes an opaque splat, not {expected}")
    })
}

/// Blends opaque splats in front of each other, stored in any order, and many at one depth.
///
/// # Errors
///
/// The fault.
pub fn splats_are_blended_front_to_back_and_ties_in_their_order<E: Renderer>(
    subject: &Subject<'_, E>,
) -> Result<(), String> {
    let mut exec = subject.executor();
    let mut view = View::new(6, Layout::radiance(0), rules(ShadingRules::PAPER, Channels::Color), 3);
    let forward = view.camera.camera_from_world.row(2);
    for (k, depth) in [0.4, -0.4, 0.0, 0.2, -0.2, 0.3].into_iter().enumerate() {
        view.gaussians.set(k, MEAN, (depth * forward).to_array());
        view.gaussians.set(k, LOG_SCALE, [-0.5; 3]);
        view.gaussians.set(k, OPACITY, [logit(0.6)]);
    }
    near_reference(&mut exec, subject.storage(), &view, "six splats behind each other")?;
    for k in 0..6 {
        view.gaussians.set(k, MEAN, [0.0; 3]);
    }
    near_reference(&mut exec, subject.storage(), &view, "six splats at one depth")
}

/// Renders every variant that passes a filter.
fn variants_near_reference<E: Renderer>(
    subject: &Subject<'_, E>,
    is_wanted: impl Fn(Layout, &RenderRules) -> bool,
) -> Result<(), String> {
    let mut exec = subject.executor();
    let variants = (0..).zip(every_variant());
    for (seed, (layout, rules)) in variants.filter(|(_, (layout, rules))| is_wanted(*layout, rules)) {
        let view = View::new(80, layout, rules, seed);
        let what = format!("{:?}, {:?}, {layout:?}", rules.shading.form, rules.channels);
        near_reference(&mut exec, subject.storage(), &view, &what)?;
    }
    Ok(())
}

/// Renders Gaussians without a shading function, in all layouts and channels.
///
/// # Errors
///
/// The fault.
pub fn plain_gaussians_have_the_pictures_of_the_reference<E: Renderer>(subject: &Subject<'_, E>) -> Result<(), String> {
    variants_near_reference(subject, |layout, _| !layout.is_shaded())
}

/// Shaded Gaussians of every roughness, from mirrors to chalk, for lookups in all levels.
fn every_roughness(shading: ShadingRules) -> View {
    let mut view = View::new(60, Layout::shaded(None), rules(shading, Channels::Color), 9);
    (0..60).for_each(|k| view.gaussians.set(k, ROUGHNESS, [k as f32 / 5.0 - 6.0]));
    view
}

/// Renders Gaussians that look light up.
///
/// # Errors
///
/// The fault.
pub fn light_of_gaussians_is_filtered_and_looked_up<E: Renderer>(subject: &Subject<'_, E>) -> Result<(), String> {
    variants_near_reference(subject, |layout, rules| layout.is_shaded() && rules.shading == ShadingRules::PAPER)?;
    let view = every_roughness(ShadingRules::PAPER);
    near_reference(&mut subject.executor(), subject.storage(), &view, "every roughness")
}

/// Renders pixels that look light up, of plain surfaces and of physical materials, with every layer
/// of light.
///
/// # Errors
///
/// The fault.
pub fn light_of_pixels_is_filtered_and_looked_up<E: Renderer>(subject: &Subject<'_, E>) -> Result<(), String> {
    let mut exec = subject.executor();
    variants_near_reference(subject, |layout, rules| rules.is_deferred(layout) && rules.is_lit)?;
    let view = every_roughness(ShadingRules::DEFERRED);
    near_reference(&mut exec, subject.storage(), &view, "every roughness")?;
    for (seed, light_layer) in (1..).zip(LightLayer::OTHERS) {
        let rules = RenderRules { light_layer, ..rules(ShadingRules::PHYSICAL, Channels::Layers) };
        let view = View::new(60, Layout::shaded(None).physical(), rules, seed);
        near_reference(&mut exec, subject.storage(), &view, &format!("layer {light_layer:?}"))?;
    }
    Ok(())
}

/// Looks up a light of few bright texels: by a mirror of one Gaussian that fills the picture, by a
/// surface without reflection, and by many mirrors. A hundredth of a pixel shows, and a thousandth
/// of a direction or a roughness.
///
/// # Errors
///
/// The fault.
pub fn light_is_looked_up_in_its_place<E: Renderer>(subject: &Subject<'_, E>) -> Result<(), String> {
    /// Closeness in dB: only rounding is seen, 1e-6 of a channel.
    const IN_PLACE: f64 = 110.0;
    let mut exec = subject.executor();
    let shaded = Layout::shaded(None);
    let surfaces = [
        ("mirror", ShadingRules::DEFERRED, shaded, 1),
        ("metal", ShadingRules::PHYSICAL, shaded.physical(), 1),
        ("matte surface", ShadingRules::PHYSICAL, shaded.physical(), 1),
        ("mirrors", ShadingRules::PAPER, shaded, 40),
    ];
    for (seed, (what, shading, layout, count)) in
        (0..).flat_map(|seed| surfaces.map(|surface| (seed, surface))).take(12)
    {
        let mut view = View::new(count, layout, rules(shading, Channels::Color), seed);
        let mut light = random_environment(RESOLUTION, RadianceActivation::Identity, seed);
        light.values.iter_mut().for_each(|radiance| *radiance = if *radiance > 1.75 { 8.0 } else { 0.05 });
        view.environment = Some(light);
        for gaussian in 0..count {
            let is_matte = what == "matte surface";
            if count == 1 {
                view.gaussians.set(gaussian, MEAN, [0.0; 3]);
                view.gaussians.set(gaussian, LOG_SCALE, [1.2, 1.0, 0.5]);
            }
            view.gaussians.set(gaussian, OPACITY, [12.0]);
            view.gaussians.set(gaussian, ROUGHNESS, [if is_matte { 4.0 } else { -3.0 }]);
            match layout.physical_planes() {
                Some(first) => view.gaussians.set(gaussian, first + METALNESS, [if is_matte { -6.0 } else { 6.0 }]),
                None => view.gaussians.set(gaussian, TINT, [6.0; 3]),
            }
        }
        close(&view.picture(&mut exec)?, &view.exact(subject.storage()), &view, what, IN_PLACE)?;
    }
    Ok(())
}

/// Shades pixels without a light: base colours of plain surfaces, black physical materials; no
/// specular colour.
///
/// # Errors
///
/// The fault.
pub fn pixels_without_light_keep_their_base_and_materials_are_black<E: Renderer>(
    subject: &Subject<'_, E>,
) -> Result<(), String> {
    let mut exec = subject.executor();
    for shading in [ShadingRules::DEFERRED, ShadingRules::PHYSICAL] {
        let is_physical = shading == ShadingRules::PHYSICAL;
        let layout = Layout::shaded(Some(1));
        let layout = if is_physical { layout.physical() } else { layout };
        for is_lit in [true, false] {
            let rules = RenderRules { is_lit, ..rules(shading, Channels::Layers) };
            let mut view = View::new(60, layout, rules, 4);
            if is_lit {
                view.environment = None;
            }
            let what = format!("{:?} without a light", shading.form);
            near_reference(&mut exec, subject.storage(), &view, &what)?;
            let picture = view.picture(&mut exec)?;
            let plane = |channel: usize| &picture[channel * view.pixels()..(channel + 3) * view.pixels()];
            let has_color = plane(channel::COLOR).iter().any(|x| *x != 0.0);
            require(has_color != is_physical, || format!("{what}: colours are black, or not: {has_color}"))?;
            let has_specular = plane(channel::SPECULAR).iter().any(|x| *x != 0.0);
            require(!has_specular, || format!("{what} has specular colour"))?;
        }
    }
    Ok(())
}

/// Renders random clouds of random layouts in random views.
///
/// # Errors
///
/// The fault, with the smallest case that proptest finds.
pub fn random_views_have_the_pictures_of_the_reference<E: Renderer>(subject: &Subject<'_, E>) -> Result<(), String> {
    let variants: Vec<(Layout, RenderRules)> =
        every_variant().into_iter().filter(|(_, rules)| rules.scheme == PrefilterScheme::Exact).collect();
    let views = (strategies::camera(), 0..variants.len(), 1..60_usize, 0..u64::MAX);
    let views = views.prop_map(move |(camera, index, count, seed)| {
        let (layout, rules) = variants[index];
        View { camera, ..View::new(count, layout, rules, seed) }
    });
    let mut runner = TestRunner::new(as_many_as_wanted(16));
    let exec = RefCell::new(subject.executor());
    let result = runner.run(&views, |view| {
        near_reference(&mut *exec.borrow_mut(), subject.storage(), &view, "random view").map_err(TestCaseError::fail)
    });
    result.map_err(|error| error.to_string())
}

/// View of a case of [`stress`](crate::stress).
fn view_of(case: &Case, shading: ShadingRules) -> View {
    View {
        gaussians: case.cloud.clone(),
        environment: case.environment.clone(),
        near_field: None,
        lamps: Vec::new(),
        occlusion: None,
        camera: case.camera,
        rules: rules(shading, Channels::Training),
    }
}

/// Renders scenes at the limits of valid input: finite numbers, and near the reference in `f32`
/// where these do not depend on rounding.
///
/// # Errors
///
/// All faults.
pub fn extreme_scenes_have_finite_pictures_near_the_reference<E: Renderer>(
    subject: &Subject<'_, E>,
) -> Result<(), String> {
    let mut faults = Vec::new();
    let mut exec = subject.executor();
    for case in every_case() {
        for shading in case.shadings() {
            let what = format!("{} ({:?})", case.name, shading.form);
            let view = view_of(&case, *shading);
            let picture = view.picture(&mut exec)?;
            if let Err(fault) = assert_finite(&picture) {
                faults.push(format!("{what}: {fault}"));
            }
            // Halves of extreme numbers are other scenes.
            if !case.is_on_edge && subject.storage() == Storage::F32 {
                faults.extend(
                    close(&picture, &view.reference::<f32>(Storage::F32), &view, &what, same_planes(view.pixels()))
                        .err(),
                );
            }
        }
    }
    require(faults.is_empty(), || faults.join("\n"))
}

/// Leaves out Gaussians with a number that is not finite.
///
/// # Errors
///
/// All faults.
pub fn nonfinite_gaussians_are_left_out_to_the_last_bit<E: Renderer>(subject: &Subject<'_, E>) -> Result<(), String> {
    let mut faults = Vec::new();
    let mut exec = subject.executor();
    let light = random_environment(RESOLUTION, RadianceActivation::Exponential, 3);
    let case = Case::new("poison", camera(48, 32), random_cloud(0, LAYOUT, 0)).lit(light);
    let light = view_of(&case, ShadingRules::PAPER).light(&mut exec).map_err(said)?;
    for (k, (plane, number)) in crate::stress::poison().enumerate() {
        let shading = [ShadingRules::PAPER, ShadingRules::DEFERRED][k % 2];
        let [with, without] = poisoned(plane, number)
            .map(|cloud| view_of(&Case { cloud, ..case.clone() }, shading).picture_under(&mut exec, light.as_ref()));
        let (with, without) = (with?, without?);
        if let Err(fault) = assert_finite(&with) {
            faults.push(format!("plane {plane} is {number}: {fault}"));
        }
        if with != without {
            faults.push(format!("plane {plane} is {number}: the picture is another without it"));
        }
    }
    require(faults.is_empty(), || faults.join("\n"))
}

/// Renders empty scenes and pictures without pixels.
///
/// # Errors
///
/// The fault.
pub fn pictures_without_gaussians_or_pixels_are_empty<E: Renderer>(subject: &Subject<'_, E>) -> Result<(), String> {
    let mut exec = subject.executor();
    for (width, height, count) in [(48, 32, 0), (1, 1, 0), (1, 1, 60), (0, 32, 60), (48, 0, 60), (0, 0, 0)] {
        let mut view = View::new(count, LAYOUT, rules(ShadingRules::PAPER, Channels::Training), 1);
        (view.environment, view.camera.width, view.camera.height) = (None, width, height);
        let picture = view.picture(&mut exec)?;
        let what = format!("{width} × {height}, {count} Gaussians");
        assert_finite(&picture).map_err(|fault| format!("{what}: {fault}"))?;
        let passed = &picture[picture.len() - view.pixels()..];
        let is_clear = count > 0 || passed.iter().all(|passed| *passed == 1.0);
        require(is_clear, || format!("{what}: the background does not shine through"))?;
    }
    Ok(())
}

/// Renders the same bits twice, after another picture, and on another executor.
///
/// # Errors
///
/// The fault.
pub fn pictures_are_the_same_bits_every_time<E: Renderer>(subject: &Subject<'_, E>) -> Result<(), String> {
    let rules = rules(ShadingRules::DEFERRED, Channels::Training);
    let view = View::new(5000, Layout::shaded(Some(1)), rules, 11);
    let mut exec = subject.executor();
    let first = view.picture(&mut exec)?;
    require(view.picture(&mut exec)? == first, || "the second picture is another".to_owned())?;
    View::new(37, Layout::shaded(Some(1)), rules, 12).picture(&mut exec)?;
    require(view.picture(&mut exec)? == first, || "the picture depends on what was rendered before".to_owned())?;
    let another = view.picture(&mut subject.executor())?;
    require(another == first, || "another executor renders another picture".to_owned())
}

/// Reads a frame after another one was rendered.
///
/// # Errors
///
/// The fault.
pub fn frames_outlive_later_pictures<E: Renderer>(subject: &Subject<'_, E>) -> Result<(), String> {
    let rules = rules(ShadingRules::DEFERRED, Channels::Training);
    let [one, other] = [1, 2].map(|seed| View::new(60, Layout::shaded(None), rules, seed));
    let mut exec = subject.executor();
    let expected = one.picture(&mut exec)?;
    let frame = one.frame(&mut exec).map_err(said)?;
    let later = other.picture(&mut exec)?;
    require(later != expected, || "two scenes have one picture".to_owned())?;
    require(one.read(&mut exec, &frame)? == expected, || "a frame changed after it was rendered".to_owned())
}

/// Renders views that need features, or is refused by name.
fn computed_or_refused<E: Renderer>(
    subject: &Subject<'_, E>,
    what: &str,
    views: &[View],
    check: impl Fn(&mut E, &View) -> Result<(), String>,
) -> Result<(), String> {
    for view in views {
        let mut exec = subject.executor();
        let missing: Vec<Feature> = view.features().into_iter().filter(|feature| !exec.has(*feature)).collect();
        let Some(first) = missing.first() else {
            check(&mut exec, view)?;
            continue;
        };
        let Err(error) = view.frame(&mut exec) else { return Err(format!("{what} are neither supported nor refused")) };
        let named = missing.iter().any(|feature| error.to_string().contains(feature.name()));
        let expected = Unsupported::feature(*first);
        require(named, || format!("{what} are refused as {error:?} ({error}), not as {expected:?}"))?;
    }
    Ok(())
}

/// Smooth Gaussians among triangles.
fn polished_view(layout: Layout, rules: RenderRules, seed: u64) -> View {
    let mut view = View::new(80, layout, rules, seed);
    view.gaussians = polished(view.gaussians);
    view.environment = Some(random_environment(RESOLUTION, RadianceActivation::Identity, seed));
    view.near_field = Some(random_near_field(60, seed));
    view
}

/// Traces reflected rays against near fields.
///
/// # Errors
///
/// The fault.
pub fn near_fields_are_traced_or_refused_by_name<E: Renderer>(subject: &Subject<'_, E>) -> Result<(), String> {
    let views = [Channels::Color, Channels::Training, Channels::Layers].map(|channels| {
        let rules = RenderRules { traces_near: true, ..rules(ShadingRules::DEFERRED, channels) };
        polished_view(Layout::shaded(Some(3)), rules, channels.count() as u64)
    });
    computed_or_refused(subject, "near fields", &views, |exec, view| {
        let picture = view.picture(exec)?;
        close(&picture, &view.exact(subject.storage()), view, "near field", NEAR_TRIANGLES)?;
        if view.rules.channels == Channels::Layers {
            let far = View { near_field: None, ..view.clone() }.picture(exec)?;
            require(closeness(&picture, &far, view.pixels()) < 50.0, || "rays meet nothing".to_owned())?;
        }
        Ok(())
    })
}

/// Adds the light of lamps, with and without shadows.
///
/// # Errors
///
/// The fault.
pub fn lamps_shine_or_are_refused_by_name<E: Renderer>(subject: &Subject<'_, E>) -> Result<(), String> {
    let lamps = vec![
        Lamp::Sun { direction: [0.5, -1.0, 0.8], irradiance: [2.0, 1.5, 1.0], diameter: 0.2 },
        Lamp::Sphere { position: [1.5, -1.0, 1.0], intensity: [3.0; 3], radius: 0.0 },
        Lamp::Sphere { position: [-1.0, -1.5, 1.0], intensity: [1.0, 2.0, 3.0], radius: 0.3 },
    ];
    let views = [false, true].map(|has_shadows| {
        let rules = RenderRules { illuminates: true, ..rules(ShadingRules::PHYSICAL, Channels::Layers) };
        let mut view = polished_view(Layout::shaded(Some(1)).physical(), rules, 3);
        view.lamps.clone_from(&lamps);
        if !has_shadows {
            view.near_field = None;
        }
        view
    });
    computed_or_refused(subject, "lamps", &views, |exec, view| {
        let picture = view.picture(exec)?;
        close(&picture, &view.exact(subject.storage()), view, "lamps", NEAR_TRIANGLES)?;
        let dark = View { lamps: Vec::new(), ..view.clone() }.picture(exec)?;
        require(closeness(&picture, &dark, view.pixels()) < 40.0, || "lamps do not shine".to_owned())
    })
}

/// Evaluates lights of networks.
///
/// # Errors
///
/// The fault.
pub fn lights_of_networks_are_evaluated_or_refused_by_name<E: Renderer>(
    subject: &Subject<'_, E>,
) -> Result<(), String> {
    let views = [ShadingRules::PAPER, ShadingRules::DEFERRED].map(|shading| {
        let mut view = View::new(60, Layout::shaded(None), rules(shading, Channels::Color), 5);
        view.environment = Some(random_environment(RESOLUTION, RadianceActivation::Network, 5));
        view
    });
    computed_or_refused(subject, "lights of networks", &views, |exec, view| {
        close(
            &view.picture(exec)?,
            &view.exact(subject.storage()),
            view,
            "light of a network",
            same_planes(view.pixels()),
        )
    })
}

/// Filters light as the authors do. The reference lacks that filter: pictures are only finite here,
/// and [`check_agreement`](crate::check_agreement) compares them.
///
/// # Errors
///
/// The fault.
pub fn the_official_filter_is_computed_or_refused_by_name<E: Renderer>(subject: &Subject<'_, E>) -> Result<(), String> {
    let rules = RenderRules::full(ShadingRules::OFFICIAL, PrefilterScheme::Official, Channels::Color);
    let view = View::new(60, Layout::shaded(None), rules, 6);
    computed_or_refused(subject, "official filters", &[view], |exec, view| {
        assert_finite(&view.picture(exec)?).map_err(|fault| format!("the official filter: {fault}"))
    })
}

/// Renders parts of pictures, from one pixel to the whole, and compares their pixels.
///
/// # Errors
///
/// The fault.
pub fn parts_of_pictures_have_the_bits_of_the_whole<E: Renderer>(subject: &Subject<'_, E>) -> Result<(), String> {
    let mut exec = subject.executor();
    let variants = [(ShadingRules::PAPER, Layout::radiance(2)), (ShadingRules::DEFERRED, Layout::shaded(Some(1)))];
    for (seed, (shading, layout)) in (1..).zip(variants) {
        let mut view = View::new(80, layout, rules(shading, Channels::Training), seed);
        let (width, height) = (view.camera.width, view.camera.height);
        let whole = view.picture(&mut exec)?;
        for [x, y, part_width, part_height] in
            [[0, 0, width, height], [33, 20, 1, 1], [10, 7, 30, 25], [48, 32, width - 48, height - 32], [5, 5, 0, 3]]
        {
            let scissor = Scissor { x, y, width: part_width, height: part_height };
            view.camera.scissor = Some(scissor);
            let part = view.picture(&mut exec)?;
            let is_inside = |index: &usize| {
                let (column, row) = (*index as u32 % width, *index as u32 / width % height);
                (x..x + part_width).contains(&column) && (y..y + part_height).contains(&row)
            };
            let other = (0..whole.len()).filter(is_inside).find(|index| whole[*index] != part[*index]);
            require(other.is_none(), || format!("{scissor:?}: number {other:?} is not that of the whole picture"))?;
        }
    }
    Ok(())
}

/// Renders splats among surfaces of another renderer: a slope through the scene, none in some
/// pixels, and one before everything in others.
///
/// # Errors
///
/// The fault.
pub fn surfaces_hide_splats_or_are_refused_by_name<E: Renderer>(subject: &Subject<'_, E>) -> Result<(), String> {
    /// Depths that are no slope, for the pixels with these remainders of their numbers.
    const OTHERS: [(usize, f32); 3] = [(0, f32::INFINITY), (1, f32::NAN), (2, 0.0)];
    const PERIOD: usize = 7;
    let variants = [
        (ShadingRules::PAPER, Layout::radiance(1), Channels::Color),
        (ShadingRules::DEFERRED, Layout::shaded(Some(1)), Channels::Training),
        (ShadingRules::PHYSICAL, Layout::shaded(None).physical(), Channels::Layers),
    ];
    let view_with = |(shading, layout, channels), seed| {
        let view = View::new(200, layout, rules(shading, channels), seed);
        let (distance, width) = (view.camera.position.length(), view.camera.width as usize);
        let depth = |pixel: usize| match OTHERS.iter().find(|(number, _)| *number == pixel % PERIOD) {
            Some((_, depth)) => *depth,
            None => distance + 2.0 * ((pixel % width) as f32 / width as f32 - 0.5),
        };
        let occlusion = Some((0..view.pixels()).map(depth).collect());
        View { occlusion, ..view }
    };
    let views: Vec<View> = (1..).zip(variants).map(|(seed, variant)| view_with(variant, seed)).collect();
    computed_or_refused(subject, "surfaces", &views, |exec, view| {
        let picture = view.picture(exec)?;
        close(&picture, &view.exact(subject.storage()), view, "surfaces", same_planes(view.pixels()))?;
        let open = View { occlusion: None, ..view.clone() }.picture(exec)?;
        require(closeness(&picture, &open, view.pixels()) < 40.0, || "surfaces hide nothing".to_owned())?;
        for (index, (number, without)) in picture.iter().zip(&open).enumerate() {
            let pixel = index % view.pixels() % PERIOD;
            let is_transmittance = index >= picture.len() - view.pixels();
            let expected = match pixel {
                0 | 1 => *without,
                2 if is_transmittance => 1.0,
                2 => 0.0,
                _ => continue,
            };
            require(*number == expected, || format!("number {index} is {number}, not {expected}"))?;
        }
        Ok(())
    })
}

/// Finds the splat of each pixel behind which half of the light passes: surfaces at its depth leave
/// more than half, and surfaces just behind it half or less. Executors without occlusions only
/// have to refuse.
///
/// # Errors
///
/// The fault.
pub fn median_depths_halve_the_light_or_are_refused_by_name<E: Renderer>(
    subject: &Subject<'_, E>,
) -> Result<(), String> {
    let view = View::new(200, Layout::radiance(1), rules(ShadingRules::PAPER, Channels::Color), 5);
    let mut exec = subject.executor();
    let gaussians = exec.upload_gaussians(&view.gaussians).map_err(said)?;
    let array = match pipeline::median_depths(&mut exec, &gaussians, &view.camera, &view.rules) {
        Ok(array) => array,
        Err(error) => {
            let is_refused =
                !exec.has(Feature::MedianDepths) && error.to_string().contains(Feature::MedianDepths.name());
            return require(is_refused, || format!("median depths fail as {error}"));
        }
    };
    let mut medians = vec![f32::NAN; view.pixels()];
    exec.download(&array, &mut medians).map_err(said)?;
    if !exec.has(Feature::Occlusions) {
        return Ok(());
    }
    let mut passed = |surfaces: Vec<f32>| {
        let picture = View { occlusion: Some(surfaces), ..view.clone() }.picture(&mut exec)?;
        Ok::<_, String>(picture[picture.len() - view.pixels()..].to_vec())
    };
    let all = passed(vec![f32::INFINITY; view.pixels()])?;
    let in_front = passed(medians.clone())?;
    let behind = passed(medians.iter().map(|depth| depth.next_up()).collect())?;
    let mut seen = 0;
    for (pixel, median) in medians.iter().enumerate() {
        if *median == f32::INFINITY {
            require(all[pixel] > 0.5, || format!("no splat of pixel {pixel} has the median depth"))?;
            continue;
        }
        let around = [in_front[pixel], behind[pixel]];
        require(around[0] > 0.5 && around[1] <= 0.5, || {
            format!("of the light in pixel {pixel} pass {around:?} in front of and behind the depth {median}")
        })?;
        seen += 1;
    }
    require(seen > view.pixels() / 10, || format!("only {seen} pixels have a median depth"))
}

/// Replaces some of the Gaussians, and refuses those that do not fit.
///
/// # Errors
///
/// The fault.
pub fn changes_of_some_gaussians_are_written_or_refused_by_name<E: Renderer>(
    subject: &Subject<'_, E>,
) -> Result<(), String> {
    let layout = Layout::shaded(Some(1));
    let [mut before, after] =
        [1, 2].map(|seed| View::new(100, layout, rules(ShadingRules::PAPER, Channels::Color), seed));
    let mut exec = subject.executor();
    let mut uploaded = exec.upload_gaussians(&before.gaussians).map_err(said)?;
    let changed = 20..41;
    if let Err(error) = exec.write_gaussians(&mut uploaded, &after.gaussians, changed.clone()) {
        let expected = Unsupported::feature(Feature::PartialWrites);
        let is_refused = !exec.has(Feature::PartialWrites) && error.to_string().contains(Feature::PartialWrites.name());
        return require(is_refused, || format!("changes fail as {error}, not as {expected:?}"));
    }
    let light = before.light(&mut exec).map_err(said)?;
    let frame = pipeline::render(&mut exec, &uploaded, light.as_ref(), &before.camera, &before.rules).map_err(said)?;
    let written = before.read(&mut exec, &frame)?;
    // Whole blocks.
    let values = after.gaussians.changed_values(&before.gaussians, changed).map_err(said)?;
    before.gaussians.values[values.clone()].copy_from_slice(&after.gaussians.values[values]);
    require(written == before.picture(&mut exec)?, || "the changed Gaussians are not those of an upload".to_owned())?;
    let shorter = random_cloud(99, layout, 3);
    let other = random_cloud(100, Layout::shaded(None), 3);
    for (wrong, range) in [(&after.gaussians, 90..101), (&shorter, 0..3), (&other, 0..3)] {
        let accepted = exec.write_gaussians(&mut uploaded, wrong, range.clone()).is_ok();
        require(!accepted, || format!("{} Gaussians of {:?} were written to {range:?}", wrong.count, wrong.layout))?;
    }
    Ok(())
}
