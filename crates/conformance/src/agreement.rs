//! Agreement of two renderers.

use crate::{
    compare::{closeness, same_planes},
    report::{Subject, require, said},
    variants::every_variant,
    view::View,
};
use specula_core::{
    executor::Renderer,
    prefilter::PrefilterScheme,
    rules::{Channels, RenderRules},
    scene::Layout,
    shade::ShadingRules,
};

/// Checks that two renderers agree: every variant with features that both have, and numbers of
/// Gaussians around the sizes of blocks and workgroups.
///
/// # Errors
///
/// All faults.
pub fn check_agreement<A: Renderer, B: Renderer>(a: &Subject<'_, A>, b: &Subject<'_, B>) -> Result<(), String> {
    let (mut first, mut second) = (a.executor(), b.executor());
    let variants = (0..).zip(every_variant()).map(|(seed, (layout, rules))| View::new(80, layout, rules, seed));
    let rules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, Channels::Color);
    let counts = [0, 1, 15, 2047, 2049, 20_000].map(|count| View::new(count, Layout::radiance(0), rules, 5));
    let mut faults = Vec::new();
    for view in variants.chain(counts) {
        if !view.features().into_iter().all(|feature| first.has(feature) && second.has(feature)) {
            continue;
        }
        let what =
            format!("{:?} {:?}, {} Gaussians", view.rules.shading.form, view.rules.channels, view.gaussians.count);
        let pictures = view.picture(&mut first).and_then(|one| Ok((one, view.picture(&mut second)?)));
        let (one, other) = pictures.map_err(|fault| format!("{what}: {}", said(fault)))?;
        let found = closeness(&one, &other, view.pixels());
        println!("{what}: {found:.1} dB");
        let least = same_planes(view.pixels());
        if !(found >= least) {
            faults.push(format!("{what}: {found:.1} dB apart, needed are {least:.1}"));
        }
    }
    require(faults.is_empty(), || faults.join("\n"))
}
