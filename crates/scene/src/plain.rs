//! Subsets of Gaussians for other programs: fewer Gaussians, fewer planes, no 3D filter.

use specula_core::{
    attributes::{AttributePlanes, StoredGaussian},
    project::Shape,
    scene::{Gaussians, LOG_SCALE, Layout, OPACITY, len_of_values},
};

/// Opacity of a Gaussian under its filter in space.
pub(crate) fn opacity(gaussians: &Gaussians<Vec<f32>>, index: usize) -> f32 {
    let shape: Shape<f32> = StoredGaussian { gaussians, index }.shape(gaussians.layout);
    shape.scales_and_opacity().1
}

/// Selected Gaussians, in a layout that is a prefix of theirs.
pub(crate) fn subset(gaussians: &Gaussians<Vec<f32>>, kept: &[usize], layout: Layout) -> Gaussians<Vec<f32>> {
    let mut some = Gaussians { count: kept.len(), layout, values: vec![0.0; len_of_values(kept.len(), layout)] };
    for (target, source) in kept.iter().enumerate() {
        for plane in 0..layout.plane_count() {
            some.set(target, plane, gaussians.get::<1>(*source, plane));
        }
    }
    some
}

/// Gaussians with their 3D filters applied to scales and opacities, which is exact: a filtered
/// Gaussian is wider and fainter ([`specula_core::antialias::smoothed`]). They keep their low-pass
/// on the screen.
pub(crate) fn unfiltered(gaussians: &Gaussians<Vec<f32>>) -> Gaussians<Vec<f32>> {
    let Some(plane) = gaussians.layout.filter_plane() else { return gaussians.clone() };
    let all: Vec<usize> = (0..gaussians.count).collect();
    let mut plain = subset(gaussians, &all, Layout { is_smoothed: false, ..gaussians.layout });
    for index in all {
        let scales = gaussians.get::<3>(index, LOG_SCALE).map(|log_scale| f64::from(log_scale).exp());
        let deviation = f64::from(gaussians.get::<1>(index, plane)[0]);
        let wider = scales.map(|scale| scale.hypot(deviation));
        let share: f64 = scales.iter().zip(wider).map(|(scale, wider)| scale / wider).product();
        plain.set(index, LOG_SCALE, wider.map(|scale| scale.ln() as f32));
        plain.set(index, OPACITY, gaussians.get::<1>(index, OPACITY).map(|logit| logit_of_share(logit, share)));
    }
    plain
}

/// Logit of a share of an opacity: ln(c p / (1 − c p)) with p = 1 / (1 + e⁻ˣ), which is also exact
/// for opacities near one.
fn logit_of_share(logit: f32, share: f64) -> f32 {
    /// Largest magnitude of a logit: beyond it opacities are zero or one in any format.
    const LOGIT_MAX: f64 = 80.0;
    let odds_against = (-f64::from(logit)).exp() + (1.0 - share);
    (share / odds_against).ln().clamp(-LOGIT_MAX, LOGIT_MAX) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::activation::sigmoid;

    /// Roundings of scales and opacities in `f32`, through a logarithm and a logit.
    const ROUNDING: f32 = 1e-5;

    #[test]
    fn gaussians_without_their_filter_have_its_scales_and_opacity() {
        let layout = Layout::radiance(1).antialiased();
        let plane = layout.filter_plane().expect("a filter");
        let mut cloud = Gaussians { count: 3, layout, values: vec![0.0; len_of_values(3, layout)] };
        for (index, filter) in [0.0, 0.02, 3.0].into_iter().enumerate() {
            cloud.set(index, LOG_SCALE, [-4.0, -2.0, 0.5]);
            cloud.set(index, OPACITY, [9.0]);
            cloud.set(index, layout.sh_end() - 1, [index as f32]);
            cloud.set(index, plane, [filter]);
        }
        let plain = unfiltered(&cloud);
        assert_eq!(plain.layout.plane_count() + 1, layout.plane_count());
        for index in 0..3 {
            let shape: Shape<f32> = StoredGaussian { gaussians: &cloud, index }.shape(layout);
            let (scales, opacity) = shape.scales_and_opacity();
            for (ours, theirs) in plain.get::<3>(index, LOG_SCALE).into_iter().zip(scales.to_array()) {
                assert!((ours.exp() / theirs - 1.0).abs() < ROUNDING, "{} for {theirs}", ours.exp());
            }
            let ours = sigmoid(plain.get::<1>(index, OPACITY)[0]);
            assert!((ours / opacity - 1.0).abs() < ROUNDING, "{ours} for {opacity}");
            assert_eq!(plain.get::<1>(index, layout.sh_end() - 1), [index as f32]);
        }
    }

    #[test]
    fn opacities_stay_finite() {
        for (logit, share) in [(200.0, 1.0), (200.0, 0.5), (-200.0, 1e-300), (0.0, 0.0)] {
            assert!(logit_of_share(logit, share).is_finite(), "{logit}, {share}");
        }
    }
}
