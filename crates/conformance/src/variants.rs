//! Every way of shading.

use specula_core::{
    antialias::LowPass,
    prefilter::PrefilterScheme,
    rules::{Channels, RenderRules},
    scene::Layout,
    shade::ShadingRules,
};

/// Layouts and rules of pictures. Those of one prefilter follow one another: executors keep the
/// weights of one.
pub fn every_variant() -> Vec<(Layout, RenderRules)> {
    let mut variants = Vec::new();
    for channels in [Channels::Color, Channels::Training, Channels::Layers] {
        for (shading, scheme) in [
            (ShadingRules::PAPER, PrefilterScheme::Exact),
            (ShadingRules::DEFERRED, PrefilterScheme::Exact),
            (ShadingRules::OFFICIAL, PrefilterScheme::Official),
        ] {
            let rules = RenderRules::full(shading, scheme, channels);
            variants.push((Layout::shaded(Some(2)), rules));
            variants.push((Layout::shaded(None), RenderRules { normal_residuals: false, ..rules }));
        }
        let rules = RenderRules::full(ShadingRules::PHYSICAL, PrefilterScheme::Exact, channels);
        variants.push((Layout::shaded(Some(1)).physical(), rules));
        variants.push((Layout::shaded(None).physical().antialiased(), RenderRules { is_lit: false, ..rules }));
        if channels != Channels::Layers {
            let rules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, channels);
            variants.push((Layout::radiance(3), rules));
            variants.push((Layout::radiance(1).antialiased(), rules));
            variants.push((Layout { low_pass: LowPass::Compensated, ..Layout::radiance(1) }, rules));
        }
    }
    let rules = RenderRules::full(ShadingRules::DEFERRED, PrefilterScheme::Exact, Channels::Training);
    variants.push((Layout::shaded(Some(1)).antialiased(), rules));
    variants.sort_by_key(|(_, rules)| rules.scheme == PrefilterScheme::Official);
    variants
}
