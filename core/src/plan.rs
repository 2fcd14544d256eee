//! Rendering plan: the terms that a scene and a request need. Omitting the others changes no bit of
//! a picture.
//!
//! [`Needs`] inspects every Gaussian and texel once. [`Plan`] removes from the requested rules
//! everything that the scene does not need: zero bands of harmonics, zero normal residuals, a light
//! that is black or lost in rounding (d + s L is d for s L / d < 2⁻²⁶), and light levels that no
//! roughness uses. `Plan::full` is rendered for verification. Training omits nothing.

use crate::{
    activation::sigmoid,
    cutoffs::ALPHA_MIN,
    environment::radiance,
    prefilter::{LevelRange, Levels, level_of_roughness},
    rules::{Channels, RenderRules},
    scene::{DIFFUSE, Environment, Gaussians, Layout, NORMAL_RESIDUAL_1, OPACITY, ROUGHNESS, RadianceActivation, TINT},
    shade::ShadingForm,
};
use core::ops::Range;

/// Upper bounds of the terms of a scene's Gaussians and light. Gaussians that are too faint to be
/// drawn are ignored; NaN counts as infinite, so it is never omitted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Needs {
    /// Largest opacity · tint of any Gaussian: a bound of the effect of specular light.
    pub specular: f32,
    /// Largest tint of any Gaussian as a multiple of its diffuse colour, red, green or blue.
    pub tint_to_diffuse: f32,
    /// Smallest and largest roughness; the first exceeds the second if there are no shaded
    /// Gaussians.
    pub roughness: [f32; 2],
    /// Largest component of any normal residual.
    pub normal_residual: f32,
    /// Largest coefficient in each band of the spherical harmonics.
    pub harmonics: [f32; 4],
    /// Largest radiance of any texel of the light; zero without a light.
    pub radiance: f32,
    /// Whether every number of every Gaussian is finite.
    pub is_finite: bool,
}

/// Opacity below which Gaussians are never drawn, whatever the rounding.
const FAINT: f32 = 0.5 * ALPHA_MIN;
/// Diffuse colours below this count as black: their products with blending weights, at least 4e-7,
/// stay normal numbers.
const DIFFUSE_MIN: f32 = 1e-30;
/// Exponents below this give exp(x) = 0 in `f32`, in any math library: e^−104
/// is half of the smallest number.
const EXPONENT_OF_ZERO: f32 = -110.0;

impl Needs {
    /// Needs of a scene without Gaussians and light.
    pub const NOTHING: Self = Self {
        specular: 0.0,
        tint_to_diffuse: 0.0,
        roughness: [1.0, 0.0],
        normal_residual: 0.0,
        harmonics: [0.0; 4],
        radiance: 0.0,
        is_finite: true,
    };

    /// Needs of Gaussians without a light; reads each of them once.
    pub fn of<A: AsRef<[f32]>>(gaussians: &Gaussians<A>) -> Self {
        Self::NOTHING.with(gaussians, 0..gaussians.count)
    }

    /// These needs and those of some Gaussians, such as changed ones.
    #[must_use]
    pub fn with<A: AsRef<[f32]>>(self, gaussians: &Gaussians<A>, range: Range<usize>) -> Self {
        range.fold(self, |needs, index| needs.and(gaussians, index))
    }

    /// Needs of the same Gaussians under any of some lights.
    #[must_use]
    pub fn under<'a, A: AsRef<[f32]> + 'a>(self, lights: impl IntoIterator<Item = &'a Environment<A>>) -> Self {
        let radiance = lights.into_iter().fold(0.0, |max, light| {
            light.values.as_ref().iter().fold(max, |max, x| larger(max, radiance_bound(light.activation, *x)))
        });
        Self { radiance, ..self }
    }

    /// Highest band with a coefficient that is not zero, if any.
    pub fn sh_degree(&self) -> Option<u8> {
        (0..4_u8).rev().find(|band| self.harmonics[usize::from(*band)] != 0.0)
    }

    /// The levels of a light that lookups of this roughness touch, apart from roundings.
    pub fn levels(&self, levels: &Levels) -> LevelRange {
        let [smoothest, roughest] = self.roughness;
        if smoothest > roughest {
            return LevelRange::NONE;
        }
        let last_pair = levels.as_slice().len() - 2;
        let pair = |roughness: f32| (level_of_roughness(roughness, levels.as_slice()) as usize).min(last_pair);
        LevelRange { first: pair(smoothest), end: pair(roughest) + 2 }
    }

    fn and<A: AsRef<[f32]>>(mut self, gaussians: &Gaussians<A>, index: usize) -> Self {
        let [opacity] = gaussians.get::<1>(index, OPACITY).map(sigmoid);
        if opacity < FAINT {
            return self;
        }
        let planes = 0..gaussians.layout.plane_count();
        self.is_finite &= planes.into_iter().all(|plane| gaussians.get::<1>(index, plane)[0].is_finite());
        if gaussians.layout.is_shaded() {
            self = self.and_surface(gaussians, index, opacity);
        }
        for k in 0..gaussians.layout.sh_count() {
            let band = crate::math::sqrt(k as f32) as usize;
            let coefficients = gaussians.get::<3>(index, gaussians.layout.sh_start() + 3 * k);
            self.harmonics[band] = larger(self.harmonics[band], largest(&coefficients));
        }
        self
    }

    fn and_surface<A: AsRef<[f32]>>(mut self, gaussians: &Gaussians<A>, index: usize, opacity: f32) -> Self {
        let diffuse = gaussians.get::<3>(index, DIFFUSE).map(sigmoid);
        let tint = gaussians.get::<3>(index, TINT).map(sigmoid);
        self.specular = larger(self.specular, opacity * largest(&tint));
        for (tint, diffuse) in tint.into_iter().zip(diffuse) {
            let ratio = if diffuse > DIFFUSE_MIN { tint / diffuse } else { f32::INFINITY };
            self.tint_to_diffuse = larger(self.tint_to_diffuse, ratio);
        }
        let [roughness] = gaussians.get::<1>(index, ROUGHNESS).map(sigmoid);
        // NaN may be looked up at any roughness.
        let [least, most] = if roughness.is_nan() { [0.0, 1.0] } else { [roughness; 2] };
        self.roughness = [self.roughness[0].min(least), self.roughness[1].max(most)];
        let residuals = gaussians.get::<6>(index, NORMAL_RESIDUAL_1);
        self.normal_residual = larger(self.normal_residual, largest(&residuals));
        self
    }
}

/// Upper bound of a number's radiance on any executor: zero only if it is zero on all of them.
fn radiance_bound(activation: RadianceActivation, number: f32) -> f32 {
    match activation {
        RadianceActivation::Exponential if number < EXPONENT_OF_ZERO => 0.0,
        RadianceActivation::Exponential => radiance(activation, number).max(f32::MIN_POSITIVE),
        RadianceActivation::Identity => number,
        // A weight does not bound the radiance of any level.
        RadianceActivation::Network => f32::INFINITY,
    }
}

/// The larger of `max` and |x|; infinite if `x` is not a number.
fn larger(max: f32, x: f32) -> f32 {
    if x.is_nan() { f32::INFINITY } else { max.max(x.abs()) }
}

fn largest(numbers: &[f32]) -> f32 {
    numbers.iter().fold(0.0, |max, x| larger(max, *x))
}

/// Reason why a picture needs no light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Unlit {
    /// No shaded Gaussian is drawn.
    NothingShaded,
    /// There is no light, or it is black.
    Dark,
    /// Reflected light does not change the last bit of any colour.
    LostInRounding,
}

/// Reduced and full rendering rules of a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// Rules with unused terms removed.
    pub rules: RenderRules,
    /// Rules with all terms: the same picture, bit by bit.
    pub full: RenderRules,
    /// Reason why no light is looked up, if none is.
    pub unlit: Option<Unlit>,
}

/// Light below this share of the diffuse colour is lost in the addition: half a unit in the last
/// place is at least 2⁻²⁵ of a number, and half of that is reserved for the rounding of sums and of
/// the light.
const LOST_IN_ROUNDING: f32 = 1.490_116_1e-8; // 2^-26

impl Plan {
    /// Plans the rendering of a scene with this layout by the requested rules `asked`, with its
    /// light filtered into `levels`.
    ///
    /// Levels that no roughness of the scene uses are omitted, except one more on either side: the
    /// roughness of a pixel is a mean, which rounding may move across the border of a level.
    /// Nothing is omitted if a number of a Gaussian is not finite: its attribute must be read to
    /// cull it.
    pub fn new(layout: Layout, needs: &Needs, levels: Option<&Levels>, asked: &RenderRules) -> Self {
        if !needs.is_finite {
            return Self { rules: *asked, full: in_full(asked), unlit: None };
        }
        // Physical materials have no residual colours.
        let has_residual = asked.shading.form != ShadingForm::Physical;
        let sh_degree = needs.sh_degree().min(asked.sh_degree).filter(|_| has_residual);
        let unlit = unlit(layout, needs, &RenderRules { sh_degree, ..*asked });
        let rules = RenderRules {
            sh_degree,
            normal_residuals: asked.normal_residuals && needs.normal_residual != 0.0,
            is_lit: asked.is_lit && unlit.is_none(),
            levels: levels.map_or(asked.levels, |levels| read_levels(needs, levels, asked.shading.form)),
            ..*asked
        };
        Self { rules, full: in_full(asked), unlit }
    }

    /// Adapts the plan to reflected rays against a near field, or to none. A mirror that reflects a
    /// rougher surface looks light up at the combined roughness, up to the last level
    /// ([`crate::near_field`]).
    #[must_use]
    pub fn tracing(mut self, traces_near: bool) -> Self {
        self.rules.traces_near = traces_near;
        self.full.traces_near = traces_near;
        if traces_near && self.rules.levels != LevelRange::NONE {
            self.rules.levels.end = LevelRange::ALL.end;
        }
        self
    }

    /// Adapts the plan to lamps, or to none. Lamps light a scene even if its own light is black.
    #[must_use]
    pub fn illuminated(mut self, illuminates: bool) -> Self {
        self.rules.illuminates = illuminates;
        self.full.illuminates = illuminates;
        if illuminates && self.full.is_lit {
            self.rules.is_lit = true;
            self.unlit = None;
        }
        self
    }
}

/// Levels that pixels look up; for physical materials also the last, the irradiance.
fn read_levels(needs: &Needs, levels: &Levels, form: ShadingForm) -> LevelRange {
    let read = needs.levels(levels).and_neighbours();
    if form == ShadingForm::Physical { LevelRange { end: LevelRange::ALL.end, ..read } } else { read }
}

/// Rules that blend at least the channels of training.
fn in_full(asked: &RenderRules) -> RenderRules {
    let channels = match asked.channels {
        Channels::Color => Channels::Training,
        channels => channels,
    };
    RenderRules { channels, ..*asked }
}

fn unlit(layout: Layout, needs: &Needs, rules: &RenderRules) -> Option<Unlit> {
    let is_physical = rules.shading.form == ShadingForm::Physical;
    if !layout.is_shaded() || (needs.specular == 0.0 && !is_physical) {
        Some(Unlit::NothingShaded)
    } else if needs.radiance == 0.0 {
        Some(Unlit::Dark)
    } else {
        is_lost_in_rounding(needs, rules).then_some(Unlit::LostInRounding)
    }
}

/// Tests whether d + s L is d to the last bit for every diffuse colour d, tint s and light L. It
/// returns false for the authors' form, which also reflects without a tint; for light per pixel
/// with residuals, which may cancel the diffuse colour; and for layers, which show the light.
fn is_lost_in_rounding(needs: &Needs, rules: &RenderRules) -> bool {
    let is_added_to_diffuse = match rules.shading.form {
        ShadingForm::Paper => true,
        ShadingForm::Deferred => rules.sh_degree.is_none(),
        ShadingForm::Official | ShadingForm::Physical => false,
    };
    is_added_to_diffuse
        && rules.channels != Channels::Layers
        && needs.tint_to_diffuse * needs.radiance < LOST_IN_ROUNDING
}
