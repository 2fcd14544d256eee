//! Profile of a training from its arguments.

use crate::{
    args::{Densify, LightKind, LightPer, Losses, ProfileName, Reflections, Start, Train, WhitePixels},
    failure::Failure,
};
use specula_core::{
    light_network::NETWORK_RESOLUTION_MAX,
    prefilter::{self, PrefilterScheme},
    shade::ShadingForm,
};
use specula_train::profile::{self, Ablation, Profile};

/// Requested profile with the other settings of the arguments, for a run of `iterations` on
/// pictures of objects or of whole scenes. Profiles are described by the views that a run visits;
/// batches of views turn these into steps.
///
/// # Errors
/// [`Failure::Input`] for settings that the profile does not have.
pub(crate) fn profile_of(args: &Train, iterations: u32, is_object: bool) -> Result<Profile, Failure> {
    let visits = iterations.saturating_mul(args.views_per_step);
    let mut profile = profile::by_name(args.profile.name(), visits).expect("every name has a profile");
    if is_object {
        profile = profile.for_objects();
    }
    set_start(&mut profile, &args.start)?;
    let profile = with_light(profile, args.start.light, visits)?;
    let profile = with_materials(profile, args, is_object)?;
    if args.losses.lambda_metal.is_some() && profile.physical.is_none() {
        return Err(Failure::Input(
            "--lambda-metal needs materials; add --relightable, and omit --no-materials".to_owned(),
        ));
    }
    let mut profile = with_reflections(profile, args.start.reflections)?;
    if args.photographs.exposure {
        profile = profile.exposing(visits);
    }
    set(&mut profile.cool_from, args.start.cool_from);
    let mut profile = profile.for_batches(args.views_per_step);
    set_losses(&mut profile, &args.losses);
    set_densification(&mut profile, &args.densify);
    let args = &args.ablation;
    Ok(profile.without(Ablation {
        no_sparse: args.no_sparse,
        no_normal: args.no_normal,
        no_residual: args.no_residual,
        no_axis: args.no_axis,
    }))
}

fn set_start(profile: &mut Profile, args: &Start) -> Result<(), Failure> {
    set(&mut profile.coarse_until, args.coarse_until);
    // -1 stands for the degree of the profile.
    if let Some(degree) = args.sh_degree.and_then(|degree| u8::try_from(degree).ok()) {
        profile.layout.sh_degree = Some(degree);
    }
    if args.antialias {
        profile.layout = profile.layout.antialiased();
    }
    if let Some(light_per) = args.light_per {
        if profile.light.is_none() || profile.shading.form == ShadingForm::Official {
            return Err(Failure::Input(format!(
                "--profile {} supports only one way to look up the light; omit --light-per, or use --profile specula \
                 or paper",
                profile.name
            )));
        }
        profile.shading.form = match light_per {
            LightPer::Gaussian => ShadingForm::Paper,
            LightPer::Pixel => ShadingForm::Deferred,
        };
        if !profile.is_lit_per_pixel() {
            // Shading per Gaussian gives no mirror share per pixel.
            profile.weights.smoothness = 0.0;
        }
    }
    if let Some(resolution) = args.light_resolution {
        if !profile.scheme.takes(resolution) {
            return Err(Failure::Input(format!(
                "a light of resolution {resolution} cannot be filtered; set --light-resolution to a power of two from \
                 {} to {}",
                profile.scheme.resolution_min(),
                prefilter::RESOLUTION_MAX
            )));
        }
        match &mut profile.light {
            Some(light) => light.resolution = resolution,
            None => return Err(Failure::Input("--profile 3dgs has no light; omit --light-resolution".into())),
        }
    }
    Ok(())
}

fn with_light(profile: Profile, kind: LightKind, iterations: u32) -> Result<Profile, Failure> {
    let fault = match (kind, &profile.light) {
        (LightKind::Cube, _) => return Ok(profile),
        (LightKind::Mlp, None) => format!("--profile {} has no light; omit --light mlp", profile.name),
        (LightKind::Mlp, Some(_)) if profile.scheme == PrefilterScheme::Official => {
            format!("--profile {} can prefilter only cube maps; use --profile paper or specula", profile.name)
        }
        (LightKind::Mlp, Some(light)) if light.resolution > NETWORK_RESOLUTION_MAX => {
            format!("--light mlp supports resolutions up to {NETWORK_RESOLUTION_MAX}; reduce --light-resolution")
        }
        (LightKind::Mlp, Some(_)) => return Ok(profile.with_light_network(iterations)),
    };
    Err(Failure::Input(fault))
}

/// Profile with reflections of only the distant light or also of the scene itself.
fn with_reflections(mut profile: Profile, reflections: Option<Reflections>) -> Result<Profile, Failure> {
    match reflections {
        None | Some(Reflections::Far) => {}
        Some(Reflections::Near) if profile.is_lit_per_pixel() => profile = profile.reflecting_itself(),
        Some(Reflections::Near) => {
            return Err(Failure::Input(format!(
                "--reflections near needs light per pixel, unlike --profile {}; use --profile specula, or --light-per \
                 pixel",
                profile.name
            )));
        }
    }
    Ok(profile)
}

/// Profile that also fits physical materials, if requested: `specula` fits those of objects by
/// default.
fn with_materials(profile: Profile, args: &Train, is_object: bool) -> Result<Profile, Failure> {
    let Start { relightable, no_materials, .. } = args.start;
    let name = profile.name;
    let has_default = args.profile == ProfileName::Specula && profile.is_lit_per_pixel();
    if no_materials && !has_default {
        return Err(Failure::Input(format!(
            "--profile {name} with these settings fits no materials; omit --no-materials"
        )));
    }
    if !relightable && (no_materials || !has_default || !is_object) {
        return Ok(profile);
    }
    let profile = profile.relightable();
    if profile.physical.is_none() {
        let or = if profile.light.is_some() { ", or --light-per pixel" } else { "" };
        return Err(Failure::Input(format!(
            "--relightable needs light per pixel, unlike --profile {name}; use --profile specula{or}"
        )));
    }
    Ok(profile)
}

fn set_losses(profile: &mut Profile, args: &Losses) {
    let weights = &mut profile.weights;
    if let Some(dssim) = args.lambda_dssim {
        weights.dssim = dssim;
        weights.absolute = (1.0 - dssim).max(0.0);
    }
    set(&mut weights.absolute, args.lambda_absolute);
    set(&mut weights.squared, args.lambda_squared);
    set(&mut weights.normal, args.lambda_normal);
    set(&mut weights.smoothness, args.lambda_smooth);
    set(&mut weights.coverage, args.lambda_coverage);
    set(&mut weights.metalness, args.lambda_metal);
    set(&mut weights.saturates, args.white_pixels.map(|white| white == WhitePixels::Overexposed));
    set(profile.sparse_weight_mut(), args.lambda_sparse);
    set(profile.residual_weight_mut(), args.lambda_reg);
    set(&mut profile.normal_from, args.normal_from);
    set(&mut profile.normal_last, args.normal_last);
    set(&mut profile.normal_residuals_from, args.normal_residuals_from);
    set(&mut profile.harmonics_from, args.residual_from);
}

fn set_densification(profile: &mut Profile, args: &Densify) {
    let densification = &mut profile.densification;
    set(&mut densification.from, args.densify_from_iter);
    set(&mut densification.until, args.densify_until_iter);
    set(&mut densification.every, args.densification_interval);
    set(&mut densification.reset_every, args.opacity_reset_interval);
    set(&mut densification.grad_min, args.densify_grad_threshold);
    set(&mut densification.split_share, args.percent_dense);
    set(&mut densification.count_max, args.max_gaussians);
}

fn set<T>(slot: &mut T, given: Option<T>) {
    if let Some(value) = given {
        *slot = value;
    }
}
