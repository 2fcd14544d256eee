//! Steps of the physical materials, in addition to those of the view-dependent colours.

use specula_core::{
    loss::LossWeights,
    optimise::AT_REST,
    rules::RenderRules,
    scene::{DIFFUSE, Layout, ROUGHNESS},
    shade::{ShadingForm, ShadingRules},
};

/// Rules of a picture of the materials, from those of the view-dependent colours.
pub(crate) fn physical_rules(rules: &RenderRules) -> RenderRules {
    let shading = ShadingRules { form: ShadingForm::Physical, ..rules.shading };
    RenderRules { shading, sh_degree: None, ..*rules }
}

/// Weights of the colour losses, times a factor, and of metalness, under a light of a mean
/// radiance: losses of the geometry belong to the other step.
pub(crate) fn physical_weights(weights: &LossWeights, factor: f32, mean_light: f32) -> LossWeights {
    LossWeights {
        absolute: weights.absolute * factor,
        squared: weights.squared * factor,
        dssim: weights.dssim * factor,
        normal_form: weights.normal_form,
        metalness: weights.metalness,
        mean_light,
        saturates: weights.saturates,
        ..LossWeights::NONE
    }
}

/// Rates of a step of the view-dependent colours: zero for planes of the materials.
pub(crate) fn view_rates(layout: Layout, rates: &[f32]) -> Vec<f32> {
    let mut rates = rates.to_vec();
    if let Some(first) = layout.physical_planes() {
        rates[first..layout.physical_end()].fill(AT_REST);
    }
    rates
}

/// Rates of a step of the materials: those of albedo and metalness. Shared planes have rate zero,
/// so the view-dependent colours are unaffected.
pub(crate) fn physical_rates(layout: Layout, rates: &[f32]) -> Vec<f32> {
    let mut resting = vec![AT_REST; rates.len()];
    if let Some(first) = layout.physical_planes() {
        resting[first..layout.physical_end()].copy_from_slice(&rates[first..layout.physical_end()]);
    }
    resting
}

/// Rates of a step that fits everything only by materials: none for view-dependent colours.
pub(crate) fn material_rates(layout: Layout, rates: &[f32]) -> Vec<f32> {
    let mut rates = rates.to_vec();
    if layout.is_physical {
        rates[DIFFUSE..ROUGHNESS].fill(AT_REST);
        rates[layout.sh_start()..layout.sh_end()].fill(AT_REST);
    }
    rates
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn materials_have_only_the_losses_of_colours_and_of_metalness() {
        let weights = LossWeights {
            absolute: 0.8,
            dssim: 0.2,
            normal: 0.1,
            smoothness: 80.0,
            coverage: 0.3,
            sparse: 0.01,
            residual: 0.01,
            metalness: 0.1,
            ..LossWeights::NONE
        };
        let expected = LossWeights { absolute: 0.4, dssim: 0.1, metalness: 0.1, mean_light: 2.0, ..LossWeights::NONE };
        assert_eq!(physical_weights(&weights, 0.5, 2.0), expected);
    }
}
