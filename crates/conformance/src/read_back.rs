//! Requirements of gradients under any cotangent, and of results on the host.

use crate::{
    compare::{SAME_GRADIENT, SAME_PHYSICAL_GRADIENT, SAME_SPLAT, relative_difference},
    executor::groups,
    report::{Report, Subject, require, requirements, said},
    view::{RESOLUTION, View, operator},
};
use specula_core::{
    double::Double,
    executor::{Feature, OnScreen, ReadBack},
    pipeline::{render_taped, render_vjp},
    prefilter::PrefilterScheme,
    random,
    rules::{Channels, RenderRules, channel},
    scene::Layout,
    shade::ShadingRules,
};
use specula_oracle::{self as oracle, lift, lift_environment, lift_gaussians};

requirements! {
    $ read_back_requirements: ReadBack;
    read_back::{
        gradients_under_any_cotangent_are_those_of_the_reference,
        cotangents_of_another_length_are_refused,
        cotangents_are_read_back_or_refused,
        splats_on_the_host_are_those_of_the_reference_or_refused,
    };
    /// Writes one `#[test]` for each requirement of a `ReadBack` beyond those of an `Executor`. The
    /// argument makes the executor, or `None` where it cannot run.
    read_back_tests
}

/// Checks the requirements of results on the host.
pub fn check_read_back<E: ReadBack>(subject: &Subject<'_, E>) -> Report {
    Report::of(subject, &read_back_requirements())
}

fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|x| f64::from(*x)).collect()
}

fn view(shading: ShadingRules, layout: Layout, seed: u64) -> View {
    let mut view = View::new(40, layout, RenderRules::full(shading, PrefilterScheme::Exact, Channels::Training), seed);
    (view.camera.width, view.camera.height) = (40, 33);
    view.camera.principal_px = [18.0, 17.5];
    view
}

/// Pulls random cotangents of pictures back to Gaussians and lights.
///
/// # Errors
///
/// The fault.
pub fn gradients_under_any_cotangent_are_those_of_the_reference<E: ReadBack>(
    subject: &Subject<'_, E>,
) -> Result<(), String> {
    let shaded = Layout::shaded(Some(1));
    for (seed, (shading, layout)) in (1..).zip([
        (ShadingRules::PAPER, Layout::radiance(3)),
        (ShadingRules::PAPER, shaded),
        (ShadingRules::DEFERRED, shaded),
        (ShadingRules::PHYSICAL, Layout::shaded(None).physical()),
    ]) {
        let mut exec = subject.executor();
        let view = view(shading, layout, seed);
        let lacks_light = layout.is_shaded() && !exec.has(Feature::LightGradients);
        if lacks_light || (view.rules.is_deferred(layout) && !exec.has(Feature::PixelGradients)) {
            continue;
        }
        let gaussians = exec.upload_gaussians(&view.gaussians).map_err(said)?;
        let light = view.environment.as_ref();
        let environment = light.map(|light| exec.upload(&light.values).map(|values| light.with_values(values)));
        let environment = environment.transpose().map_err(said)?;
        let tape = render_taped(&mut exec, &gaussians, environment.as_ref(), None, &view.camera, &view.rules);
        let tape = tape.map_err(said)?;
        // Normals of plain Gaussians have no gradient.
        let is_free = |plane: usize| layout.is_shaded() || !(channel::NORMAL..channel::DEPTH).contains(&plane);
        let draw =
            |k: usize| if is_free(k / view.pixels()) { 2.0 * random::uniform(seed, 5, k as u64) - 1.0 } else { 0.0 };
        let cotangent: Vec<f32> = (0..view.len()).map(draw).collect();
        let uploaded = exec.upload_frame_grad(&tape.frame, &cotangent).map_err(said)?;
        let found = render_vjp(&mut exec, &tape, &gaussians, environment.as_ref(), uploaded).map_err(said)?;

        let operator = operator(RESOLUTION);
        let lifted = light.map(lift_environment);
        let exact = oracle::render_vjp::<Double>(
            &lift_gaussians(&view.gaussians),
            lifted.as_ref().map(|light| (light, &*operator)),
            &view.camera,
            &view.rules,
            &lift(&cotangent),
        );
        let what = format!("{:?} form", shading.form);
        let tolerance = if shading == ShadingRules::PHYSICAL { SAME_PHYSICAL_GRADIENT } else { SAME_GRADIENT };
        let mut values = vec![f32::NAN; view.gaussians.values.len()];
        exec.download(&found.gaussians.values, &mut values).map_err(said)?;
        for (name, planes) in groups(layout) {
            let places = planes.flat_map(|plane| (0..view.gaussians.count).map(move |k| (k, plane)));
            let (ours, theirs): (Vec<f64>, Vec<f64>) = places
                .map(|(k, plane)| view.gaussians.index_of(k, plane))
                .map(|index| (f64::from(values[index]), exact.gaussians.values[index].0))
                .unzip();
            let difference = relative_difference(&ours, &theirs);
            println!("{what}, {name}: {difference:.1e}");
            require(difference < tolerance, || format!("{what}: gradients of {name} differ by {difference:e}"))?;
        }
        if let (Some(found), Some(exact)) = (found.environment, exact.environment) {
            let mut values = vec![f32::NAN; exact.len()];
            exec.download(&found, &mut values).map_err(said)?;
            let exact: Vec<f64> = exact.iter().map(|x| x.0).collect();
            let difference = relative_difference(&wide(&values), &exact);
            require(difference < tolerance, || format!("{what}: the light's gradient differs by {difference:e}"))?;
        }
    }
    Ok(())
}

/// Refuses cotangents of another length than their frame's.
///
/// # Errors
///
/// The fault.
pub fn cotangents_of_another_length_are_refused<E: ReadBack>(subject: &Subject<'_, E>) -> Result<(), String> {
    let mut exec = subject.executor();
    let view = view(ShadingRules::PAPER, Layout::radiance(0), 2);
    let frame = view.frame(&mut exec).map_err(said)?;
    for len in [view.len() - 1, view.len() + 1] {
        let accepted = exec.upload_frame_grad(&frame, &vec![0.0; len]).is_ok();
        require(!accepted, || format!("{len} numbers are no cotangent of {}", view.len()))?;
    }
    Ok(())
}

/// Reads the gradient of a picture.
///
/// # Errors
///
/// The fault.
pub fn cotangents_are_read_back_or_refused<E: ReadBack>(subject: &Subject<'_, E>) -> Result<(), String> {
    let mut exec = subject.executor();
    let view = view(ShadingRules::PAPER, Layout::radiance(0), 4);
    let frame = view.frame(&mut exec).map_err(said)?;
    let cotangent: Vec<f32> = (0..view.len()).map(|k| 2.0 * random::uniform(4, 6, k as u64) - 1.0).collect();
    let grad = exec.upload_frame_grad(&frame, &cotangent).map_err(said)?;
    let mut planes = vec![f32::NAN; view.len()];
    if let Err(error) = exec.read_frame_grad(&frame, &grad, &mut planes) {
        let is_named = error.to_string().contains("gradients of pictures");
        return require(is_named, || format!("gradients of pictures are refused as {error}"));
    }
    let mut picture = vec![f32::NAN; view.len()];
    exec.read_frame(&frame, &mut picture).map_err(said)?;
    let transmittance = &picture[view.len() - view.pixels()..];
    for (k, (found, expected)) in planes.iter().zip(&cotangent).enumerate() {
        let is_empty = transmittance[k % view.pixels()] == 1.0;
        let is_same = found == expected || (is_empty && *found == 0.0);
        require(is_same, || format!("number {k} of a gradient is {found} instead of {expected}"))?;
    }
    let len = planes.len();
    let accepted = exec.read_frame_grad(&frame, &grad, &mut planes[..len - 1]).is_ok();
    require(!accepted, || format!("{} numbers do not hold a gradient of {len}", len - 1))
}

/// Reads Gaussians on the screen.
///
/// # Errors
///
/// The fault.
pub fn splats_on_the_host_are_those_of_the_reference_or_refused<E: ReadBack>(
    subject: &Subject<'_, E>,
) -> Result<(), String> {
    let mut exec = subject.executor();
    let view = view(ShadingRules::PAPER, Layout::radiance(0), 3);
    let gaussians = exec.upload_gaussians(&view.gaussians).map_err(said)?;
    let splats = exec.project(&gaussians, &view.camera).map_err(said)?;
    let mut screens = vec![OnScreen::default(); view.gaussians.count];
    if let Err(error) = exec.read_splats(&splats, &mut screens) {
        let is_named = error.to_string().contains("positions and extents of splats");
        return require(is_named, || format!("splats on the host are refused as {error}"));
    }
    let exact = oracle::project::<Double>(&lift_gaussians(&view.gaussians), &view.camera);
    let numbers = |screen: &OnScreen| [screen.mean2d[0], screen.mean2d[1], screen.depth, screen.opacity].map(f64::from);
    let ours: Vec<f64> = screens.iter().flat_map(numbers).collect();
    let theirs = exact.iter().flat_map(|splat| [splat.mean2d[0], splat.mean2d[1], splat.depth, splat.opacity]);
    let difference = relative_difference(&ours, &theirs.map(|x| x.0).collect::<Vec<f64>>());
    require(difference < SAME_SPLAT, || format!("splats on the host differ by {difference:e}"))
}
