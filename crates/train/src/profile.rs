//! Profiles: the parameters that distinguish one kind of training from another, as data.
//!
//! `official` departs from the authors' code in four points, none of which changes the rendering of
//! a checkpoint: background is blended only into colour, not into depth and normals; the coverage
//! that weights the normal loss is not quantised to 8 bits; one rasterisation replaces five; and
//! the gradient of the mip chain is its true adjoint.

use crate::fingerprint::fingerprint;
use core::fmt;
use specula_core::{
    cubemap::FACE_COUNT,
    densify::DensifyRules,
    loss::{LossWeights, NormalForm},
    normal::AxisRule,
    optimise::Schedule,
    prefilter::PrefilterScheme,
    region::Ball,
    scene::{Layout, RadianceActivation},
    shade::{ShadingForm, ShadingRules},
};
use std::sync::Arc;

/// Learning rates of all attributes over a training.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rates {
    /// Means, in units of the scene's extent.
    pub mean: Schedule,
    /// Logarithms of the scales.
    pub log_scale: Schedule,
    /// Quats.
    pub quat: Schedule,
    /// Opacity logits.
    pub opacity: Schedule,
    /// Raw diffuse colour.
    pub diffuse: Schedule,
    /// Raw tint.
    pub tint: Schedule,
    /// Raw roughness.
    pub roughness: Schedule,
    /// Normal residuals Δn₁ and Δn₂.
    pub normal_residual: [Schedule; 2],
    /// Raw albedo and raw metalness.
    pub material: Schedule,
    /// First spherical harmonic.
    pub sh_first: Schedule,
    /// Other harmonics.
    pub sh_rest: Schedule,
    /// Values of the environment.
    pub environment: Schedule,
}

impl Rates {
    /// All schedules through a function.
    #[must_use]
    pub fn map(self, change: impl Fn(Schedule) -> Schedule) -> Self {
        Self {
            mean: change(self.mean),
            log_scale: change(self.log_scale),
            quat: change(self.quat),
            opacity: change(self.opacity),
            diffuse: change(self.diffuse),
            tint: change(self.tint),
            roughness: change(self.roughness),
            normal_residual: self.normal_residual.map(&change),
            material: change(self.material),
            sh_first: change(self.sh_first),
            sh_rest: change(self.sh_rest),
            environment: change(self.environment),
        }
    }

    /// Lets constant rates decay to a share of themselves over `steps` steps, except those of
    /// opacity and harmonics.
    #[must_use]
    pub fn falling(self, share: f32, steps: u32) -> Self {
        let falling = |rate: Schedule| {
            if rate.first == rate.last { Schedule { last: share * rate.first, steps, ..rate } } else { rate }
        };
        let Self { opacity, sh_first, sh_rest, .. } = self;
        Self { opacity, sh_first, sh_rest, ..self.map(falling) }
    }
}

/// Schedule and thresholds of densification, for the full number of iterations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Densification {
    /// Iteration after which densification begins.
    pub from: u32,
    /// Iteration before which densification ends.
    pub until: u32,
    /// Iterations between densifications.
    pub every: u32,
    /// Mean gradient, in normalised device coordinates, from which a Gaussian is refined.
    pub grad_min: f32,
    /// Scale, as a share of the scene's extent, above which a Gaussian is split rather than cloned.
    pub split_share: f32,
    /// Scale, as a share of the scene's extent, above which a Gaussian is removed after the first
    /// opacity reset.
    pub prune_share: f32,
    /// Opacity below which a Gaussian is removed.
    pub opacity_min: f32,
    /// Iterations between two opacity resets; 0 for none.
    pub reset_every: u32,
    /// Largest number of Gaussians.
    pub count_max: usize,
}

/// Intervals of densification between two removals of invisible Gaussians after its end.
const INVISIBLE_EVERY: u32 = 10;

impl Densification {
    /// Thresholds by which Gaussians are refined and removed after an iteration; `None` if nothing
    /// is due. After the end of densification they only remove Gaussians that no picture shows.
    pub(crate) fn rules_at(&self, iteration: u32, iterations: u32, extent: f32) -> Option<DensifyRules> {
        if iteration > self.from && iteration < self.until && iteration.is_multiple_of(self.every) {
            let was_reset = self.reset_every > 0 && iteration > self.reset_every;
            return Some(DensifyRules {
                grad_min: self.grad_min,
                split_scale: self.split_share * extent,
                opacity_min: self.opacity_min,
                scale_max: if was_reset { self.prune_share * extent } else { f32::INFINITY },
            });
        }
        let is_due = iteration.is_multiple_of(INVISIBLE_EVERY * self.every) || iteration == iterations;
        (iteration >= self.until && is_due).then_some(DensifyRules::INVISIBLE)
    }
}

/// Settings of a profile for objects that alpha cuts out of all pictures, instead of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObjectSettings {
    /// Weight of the normal loss.
    pub normal: f32,
    /// Weight of the smoothness of normals.
    pub smoothness: f32,
    /// Whether true pictures saturate at white.
    pub saturates: bool,
    /// Scale, as a share of the scene's extent, above which a Gaussian is split rather than cloned.
    pub split_share: f32,
}

/// Initial light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightStart {
    /// Texels along an edge of a face.
    pub resolution: usize,
    /// Activation of its values.
    pub activation: RadianceActivation,
    /// Initial radiance.
    pub radiance: f32,
    /// Largest radiance kept after each step; infinite for none.
    pub radiance_max: f32,
}

/// Known light, which is not trained: linear radiance of the texels of a cube map. Printed as a
/// checksum.
#[derive(Clone, PartialEq)]
pub struct KnownLight(pub Arc<[f32]>);

impl fmt::Debug for KnownLight {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "KnownLight({} numbers, {:016x})", self.0.len(), fingerprint(&self.0))
    }
}

/// Initial attributes of Gaussians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GaussianStart {
    /// Opacity.
    pub opacity: f32,
    /// Specular tint.
    pub tint: f32,
    /// Roughness.
    pub roughness: f32,
    /// Share of a point's colour that becomes diffuse.
    pub diffuse_share: f32,
}

/// Light of mirrored rays of view-dependent colours. Rays of physical materials always hit the
/// scene's own surface, if there is one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reflections {
    /// Only the distant light.
    Far,
    /// Also the scene's own surface, where rays hit it.
    Near,
}

/// Schedule of the near field: when the surface for reflected rays is rebuilt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearFieldSchedule {
    /// Share of the training after which the first one is built.
    pub from: f32,
    /// Share of the training between two of them.
    pub every: f32,
    /// Voxels along the longest edge of the scene, at most the number of pixels along a picture's
    /// longest edge.
    pub voxels: u16,
}

impl NearFieldSchedule {
    /// Five times, with voxels about as wide as two pixels of a view of 400 × 400. It starts early,
    /// because a mirror that shows its neighbours is otherwise fitted as a window onto them.
    pub const DEFAULT: Self = Self { from: 0.1, every: 0.2, voxels: 160 };

    /// True if the near field is rebuilt after an iteration.
    pub fn is_due(&self, iteration: u32, iterations: u32) -> bool {
        let [from, every] = [self.from, self.every].map(|share| (share * iterations as f32).round() as u32);
        iteration >= from && iteration < iterations && (iteration - from).is_multiple_of(every.max(1))
    }
}

/// Schedule of physical materials ([`specula_core::physical`]), which are fitted in addition to the
/// view-dependent colours: every few iterations a second step renders them instead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhysicalSchedule {
    /// Share of the training after which they are fitted.
    pub from: f32,
    /// Iterations between two of their steps.
    pub every: u32,
    /// Weight of their losses relative to those of the view-dependent colours.
    pub weight: f32,
    /// Initial albedo.
    pub albedo: f32,
    /// Initial metalness.
    pub metalness: f32,
    /// Share of the training after which only they and the geometry are fitted; 1 for never.
    pub only_from: f32,
}

impl PhysicalSchedule {
    /// Every third iteration from a tenth on, starting from grey dielectrics.
    pub const DEFAULT: Self = Self { from: 0.1, every: 3, weight: 1.0, albedo: 0.5, metalness: 0.1, only_from: 1.0 };

    /// Whether an iteration takes a step of the materials.
    pub fn is_due(&self, iteration: u32, iterations: u32) -> bool {
        iteration as f32 >= self.from * iterations as f32 && iteration.is_multiple_of(self.every.max(1))
    }

    /// Whether an iteration fits no view-dependent colours.
    pub fn is_only_materials(&self, iteration: u32, iterations: u32) -> bool {
        self.only_from < 1.0 && iteration as f32 > self.only_from * iterations as f32
    }
}

/// A kind of training.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// Name on the command line.
    pub name: &'static str,
    /// Attributes of the Gaussians, and their filters.
    pub layout: Layout,
    /// Shading function.
    pub shading: ShadingRules,
    /// Prefilter.
    pub scheme: PrefilterScheme,
    /// Initial light; `None` for plain Gaussian splatting.
    pub light: Option<LightStart>,
    /// Known light; `None` for a trained light.
    pub known_light: Option<KnownLight>,
    /// Mean linear radiance of the light over all directions, if known; the light is scaled to it
    /// every few steps.
    pub light_mean: Option<[f32; 3]>,
    /// Initial attributes.
    pub start: GaussianStart,
    /// Region in which Gaussians reflect the light; `None` for everywhere. Gaussians outside have
    /// only view-dependent colours, so the light need not explain nearby background.
    pub foreground: Option<Ball>,
    /// Weights of the losses.
    pub weights: LossWeights,
    /// Settings for objects; `None` if they are those for all scenes.
    pub objects: Option<ObjectSettings>,
    /// Schedule of physical materials; `None` if Gaussians only have view-dependent colours.
    pub physical: Option<PhysicalSchedule>,
    /// Schedule of the near field; `None` if reflected rays always see the far light.
    pub near_field: Option<NearFieldSchedule>,
    /// Light of mirrored rays of view-dependent colours.
    pub reflections: Reflections,
    /// Share of the training at half resolution, where a step costs less.
    pub coarse_until: f32,
    /// Share of the training after which the normal loss begins.
    pub normal_from: f32,
    /// Final weight of the normal loss relative to its start; it falls linearly over the second
    /// half.
    pub normal_last: f32,
    /// Share of the training during which normal residuals stay zero, so that only the geometry
    /// determines the normals.
    pub normal_residuals_from: f32,
    /// Share of the training after which residual harmonics are enabled, band by band.
    pub harmonics_from: f32,
    /// Share of the training between two bands.
    pub harmonics_step: f32,
    /// Learning rates.
    pub rates: Rates,
    /// Share of the training after which all learning rates decay linearly to zero, in addition to
    /// their schedules; 1 for never. The gradient of a single view is a noisy sample of that of all
    /// views: large steps cover distance, small steps at the end average the noise out.
    pub cool_from: f32,
    /// Learning rate of exposures; `None` if exposures are not learned.
    pub exposure: Option<Schedule>,
    /// Densification.
    pub densification: Densification,
    /// Views whose gradients a step computes at the same parameters ([`Profile::for_batches`]).
    pub views_per_step: u32,
}

/// Names of all profiles.
pub const NAMES: [&str; 4] = ["specula", "paper", "official", "3dgs"];

/// Profile by name, for a number of iterations.
pub fn by_name(name: &str, iterations: u32) -> Option<Profile> {
    match name {
        "specula" => Some(specula(iterations)),
        "paper" => Some(paper(iterations)),
        "official" => Some(official(iterations)),
        "3dgs" => Some(plain(iterations)),
        _ => None,
    }
}

/// Plain Gaussian splatting (Kerbl et al. 2023) with INRIA's rates.
fn plain(iterations: u32) -> Profile {
    Profile {
        name: "3dgs",
        layout: Layout::radiance(3),
        shading: ShadingRules::PAPER,
        scheme: PrefilterScheme::Exact,
        light: None,
        known_light: None,
        light_mean: None,
        start: GaussianStart { opacity: 0.1, tint: 0.0, roughness: 0.5, diffuse_share: 1.0 },
        foreground: None,
        weights: LossWeights { absolute: 0.8, dssim: 0.2, ..LossWeights::NONE },
        objects: None,
        physical: None,
        near_field: None,
        reflections: Reflections::Far,
        coarse_until: 0.25,
        normal_from: 0.0,
        normal_last: 1.0,
        normal_residuals_from: 0.0,
        harmonics_from: 0.0,
        harmonics_step: 1000.0 / 30_000.0,
        rates: Rates {
            mean: Schedule { first: 1.6e-4, last: 1.6e-6, steps: iterations },
            log_scale: Schedule::constant(5e-3),
            quat: Schedule::constant(1e-3),
            opacity: Schedule::constant(0.05),
            diffuse: Schedule::constant(0.0),
            tint: Schedule::constant(0.0),
            roughness: Schedule::constant(0.0),
            normal_residual: [Schedule::constant(0.0); 2],
            material: Schedule::constant(0.0),
            sh_first: Schedule::constant(2.5e-3),
            sh_rest: Schedule::constant(2.5e-3 / 20.0),
            environment: Schedule::constant(0.0),
        },
        cool_from: 1.0,
        exposure: None,
        densification: densification(iterations),
        views_per_step: 1,
    }
}

/// INRIA's densification, scaled to the length of the training: it ends half way. INRIA's gradient
/// threshold is 2e-4; half resolution at the start refines less, which 1.9e-4 compensates.
fn densification(iterations: u32) -> Densification {
    Densification {
        from: 500.min(iterations / 6),
        until: iterations / 2,
        every: 100,
        grad_min: 1.9e-4,
        split_share: 0.01,
        prune_share: 0.1,
        opacity_min: 0.005,
        reset_every: 3000,
        count_max: 1_000_000,
    }
}

/// Learning rate of exposures.
pub fn exposure_rate(iterations: u32) -> Schedule {
    Schedule { first: 2e-2, last: 2e-3, steps: iterations }
}

/// The paper's equations and weights; parameters that it omits follow plain Gaussian splatting.
fn paper(iterations: u32) -> Profile {
    let shading_rate = Schedule::constant(2.5e-3);
    let plain = plain(iterations);
    Profile {
        name: "paper",
        layout: Layout::shaded(Some(3)),
        light: Some(LightStart {
            resolution: 64,
            activation: RadianceActivation::Identity,
            radiance: 0.5,
            radiance_max: f32::INFINITY,
        }),
        start: GaussianStart { opacity: 0.1, tint: 0.5, roughness: 0.5, diffuse_share: 0.5 },
        foreground: None,
        weights: LossWeights { squared: 1.0, normal: 0.01, sparse: 1e-3, residual: 1e-3, ..LossWeights::NONE },
        harmonics_from: 0.5,
        harmonics_step: 0.0,
        rates: Rates {
            diffuse: shading_rate,
            tint: shading_rate,
            roughness: shading_rate,
            normal_residual: [shading_rate; 2],
            environment: Schedule { first: 1.6e-2, last: 1.6e-3, steps: iterations },
            ..plain.rates
        },
        ..plain
    }
}

/// GaussianShader's released code: its shading, prefilter, losses and effective learning rates.
fn official(iterations: u32) -> Profile {
    let follows_light = Schedule { first: 1.6e-2, last: 1.6e-3, steps: iterations };
    let plain = plain(iterations);
    Profile {
        name: "official",
        layout: Layout::shaded(None),
        shading: ShadingRules::OFFICIAL,
        scheme: PrefilterScheme::Official,
        light: Some(LightStart {
            resolution: 64,
            activation: RadianceActivation::Identity,
            radiance: 0.8,
            radiance_max: 1.0,
        }),
        start: GaussianStart { opacity: 0.1, tint: 0.5, roughness: 0.645_66, diffuse_share: 1.0 },
        foreground: None,
        weights: LossWeights {
            absolute: 0.8,
            dssim: 0.2,
            normal: 0.2,
            normal_form: NormalForm::CosineDetached,
            sparse_coverage: 1e-3,
            residual_image: 1e-3,
            ..LossWeights::NONE
        },
        rates: Rates {
            mean: Schedule { first: 8e-4, last: 8e-6, steps: iterations },
            diffuse: follows_light,
            tint: follows_light,
            roughness: follows_light,
            normal_residual: [follows_light, Schedule::constant(2e-4)],
            environment: follows_light,
            ..plain.rates
        },
        ..plain
    }
}

/// specula's own profile, tuned for quality.
fn specula(iterations: u32) -> Profile {
    let paper = paper(iterations);
    Profile {
        name: "specula",
        shading: ShadingRules::DEFERRED,
        light: Some(LightStart {
            resolution: 64,
            activation: RadianceActivation::Exponential,
            radiance: 0.5,
            radiance_max: f32::INFINITY,
        }),
        start: GaussianStart { opacity: 0.1, tint: 0.15, roughness: 0.5, diffuse_share: 0.8 },
        foreground: None,
        weights: LossWeights {
            absolute: 0.8,
            dssim: 0.2,
            normal: 0.1,
            normal_form: NormalForm::Cosine,
            coverage: 0.1,
            sparse: 1e-4,
            residual: 1e-3,
            ..LossWeights::NONE
        },
        objects: Some(ObjectSettings { normal: 0.2, smoothness: 80.0, saturates: true, split_share: 0.004 }),
        normal_from: 0.05,
        normal_last: 0.1,
        harmonics_from: 0.3,
        harmonics_step: 0.05,
        rates: Rates {
            log_scale: Schedule::constant(1e-2),
            quat: Schedule::constant(4e-3),
            diffuse: Schedule::constant(1e-2),
            tint: Schedule::constant(2e-2),
            roughness: Schedule::constant(2e-2),
            normal_residual: [Schedule::constant(2e-2); 2],
            environment: Schedule::constant(2e-2),
            ..paper.rates
        },
        cool_from: 0.7,
        ..paper
    }
}

/// Terms that the paper's ablation removes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Ablation {
    /// No `L_sparse`.
    pub no_sparse: bool,
    /// No `L_normal`.
    pub no_normal: bool,
    /// No residual colour `c_r`.
    pub no_residual: bool,
    /// No shortest axis v: the normal is a free attribute.
    pub no_axis: bool,
}

/// Share of a training under several lights after which only materials are fitted: from the start
/// they do not find the surface (docs/lab/results.md).
const ONLY_FROM: f32 = 0.7;

/// Learning rate of a light's network: those of Ref-NeRF's networks, falling to a tenth.
const NETWORK_RATE: [f32; 2] = [2e-3, 2e-4];

impl Profile {
    /// Profile for objects that alpha cuts out of all pictures, by its [`Self::objects`]. `specula`
    /// then gives normals more weight, smooths those of mirrors, and splits smaller Gaussians:
    /// surfaces seen from all around gain in normals and in sharpness, photographs would lose, or
    /// have not been tried (docs/lab/trials.md).
    #[must_use]
    pub fn for_objects(mut self) -> Self {
        if let Some(ObjectSettings { normal, smoothness, saturates, split_share }) = self.objects.take() {
            self.weights = LossWeights { normal, smoothness, saturates, ..self.weights };
            self.densification.split_share = split_share;
        }
        self
    }

    /// Profile whose view-dependent colours reflect the scene itself; unchanged unless light is
    /// looked up pixel by pixel.
    #[must_use]
    pub fn reflecting_itself(mut self) -> Self {
        if self.is_lit_per_pixel() {
            self.near_field = Some(NearFieldSchedule::DEFAULT);
            self.reflections = Reflections::Near;
        }
        self
    }

    /// Whether light is looked up pixel by pixel.
    pub fn is_lit_per_pixel(&self) -> bool {
        self.light.is_some() && self.shading.form == ShadingForm::Deferred
    }

    /// Profile with a light network instead of a cube map ([`specula_core::light_network`]), with
    /// the same initial radiance; unchanged without a light.
    #[must_use]
    pub fn with_light_network(mut self, iterations: u32) -> Self {
        if let Some(light) = &mut self.light {
            light.activation = RadianceActivation::Network;
            let [first, last] = NETWORK_RATE;
            self.rates.environment = Schedule { first, last, steps: iterations };
        }
        self
    }

    /// Profile with a known light, which is not trained: linear radiance of a cube map of the
    /// profile's resolution. Unchanged without a light.
    ///
    /// # Panics
    ///
    /// For another number of texels.
    #[must_use]
    pub fn under(mut self, radiance: Vec<f32>) -> Self {
        if let Some(light) = &mut self.light {
            let resolution = light.resolution;
            assert_eq!(radiance.len(), 3 * FACE_COUNT * resolution * resolution, "three numbers for each texel");
            light.radiance_max = f32::INFINITY;
            self.known_light = Some(KnownLight(radiance.into()));
            self.rates.environment = Schedule::constant(0.0);
        }
        self
    }

    /// Profile with a trained light of known mean linear radiance; unchanged without a light.
    #[must_use]
    pub fn with_light_mean(mut self, mean: [f32; 3]) -> Self {
        if let Some(light) = &mut self.light {
            light.radiance = mean.iter().sum::<f32>() / 3.0;
            light.radiance_max = f32::INFINITY;
            self.light_mean = Some(mean);
        }
        self
    }

    /// Profile that also learns the exposures of photographs. Learning rates of the scene then
    /// decay from the start instead of cooling, as in the measurement (docs/lab/features.md).
    /// Select materials first.
    #[must_use]
    pub fn exposing(mut self, iterations: u32) -> Self {
        self.exposure = Some(exposure_rate(iterations));
        if self.cool_from < 1.0 {
            self.cool_from = 1.0;
            let share = (700.0 / iterations.max(1) as f32).clamp(0.1, 0.5);
            self.rates = self.rates.falling(share, iterations);
        }
        self
    }

    /// Profile that also fits physical materials, for relighting, with occlusion by the scene's own
    /// surface; unchanged unless light is looked up pixel by pixel.
    #[must_use]
    pub fn relightable(mut self) -> Self {
        if self.is_lit_per_pixel() {
            self.layout = self.layout.physical();
            self.physical = Some(PhysicalSchedule::DEFAULT);
            self.near_field = Some(NearFieldSchedule::DEFAULT);
            self.rates.material = Schedule::constant(2e-2);
        }
        self
    }

    /// Profile for pictures under several lights, which have only their materials in common: these
    /// are fitted in every iteration, and nothing else once view-dependent colours have found the
    /// surface; there are no residual harmonics. Unchanged without materials.
    #[must_use]
    pub fn under_several_lights(mut self) -> Self {
        if let Some(physical) = &mut self.physical {
            (physical.every, physical.only_from) = (1, ONLY_FROM);
            self.layout.sh_degree = None;
        }
        self
    }

    /// Whether view-dependent colours are not fitted to the end.
    pub fn is_of_materials(&self) -> bool {
        self.physical.is_some_and(|physical| physical.only_from < 1.0)
    }

    /// Expected time of an iteration in microseconds (only ratios are meaningful), for pictures of
    /// `pixels` pixels and `count` Gaussians. Fitted to trainings of 25 000 to 480 000 pixels and
    /// 10 000 to 70 000 Gaussians on two cores.
    pub fn step_cost(&self, iteration: u32, iterations: u32, pixels: usize, count: f64) -> f64 {
        const STEP: f64 = 5000.0;
        const GAUSSIAN: f64 = 0.16;
        const PIXEL: f64 = 0.13;
        const MATERIALS: f64 = 1.0;
        let is_coarse = iteration as f32 <= self.coarse_until * iterations as f32;
        let pixels = if is_coarse { pixels / 4 } else { pixels };
        let cost = STEP + GAUSSIAN * count + PIXEL * pixels as f64;
        let is_beside = |physical: PhysicalSchedule| {
            physical.is_due(iteration, iterations) && !physical.is_only_materials(iteration, iterations)
        };
        let has_materials = self.physical.is_some_and(is_beside);
        if has_materials { cost * (1.0 + MATERIALS) } else { cost }
    }

    /// Share of the growth of the number of Gaussians before an iteration: from 0 before the first
    /// refinement to 1 after the last one. Growth slows down; with fewer than 20 refinements the
    /// last share is less than 1.
    pub fn share_of_growth(&self, iteration: u32, iterations: u32) -> f64 {
        const REFINEMENTS: f64 = 20.0;
        let Densification { from, until, every, .. } = self.densification;
        let span = f64::from(until.min(iterations).saturating_sub(from));
        let refined = (f64::from(iteration.saturating_sub(from)) / span.max(1.0)).min(1.0);
        (span / f64::from(every.max(1)) / REFINEMENTS).min(1.0) * refined * (2.0 - refined)
    }

    /// The same profile for a training that ends at step `to` and has taken `from` steps: rates
    /// fall from their current values to their last ones, and no Gaussians are added.
    #[must_use]
    pub(crate) fn ending_at(&self, from: u32, to: u32) -> Self {
        let densification = Densification { until: self.densification.until.min(from), ..self.densification };
        let ending = |schedule: Schedule| schedule.ending_at(from, to);
        Self { rates: self.rates.map(ending), exposure: self.exposure.map(ending), densification, ..self.clone() }
    }

    /// Learning rates of a step that begins at a progress in \[0, 1).
    pub fn rates_at(&self, done: f32) -> Rates {
        let held = [Schedule::constant(0.0); 2];
        let normal_residual = if done < self.normal_residuals_from { held } else { self.rates.normal_residual };
        let lr_decay_factor = self.lr_decay_factor(done);
        let cooled = |schedule: Schedule| Schedule {
            first: lr_decay_factor * schedule.first,
            last: lr_decay_factor * schedule.last,
            ..schedule
        };
        Rates { normal_residual, ..self.rates }.map(cooled)
    }

    /// Decay factor of the learning rates at a progress in \[0, 1\].
    fn lr_decay_factor(&self, done: f32) -> f32 {
        if done <= self.cool_from { 1.0 } else { ((1.0 - done) / (1.0 - self.cool_from)).max(0.0) }
    }

    /// Loss weights at a progress in \[0, 1\]. The losses of normals begin after surfaces have
    /// formed; that of the depth falls at the end, when colours locate surfaces to the pixel.
    /// Metalness belongs to the steps of the materials.
    pub fn weights_at(&self, done: f32) -> LossWeights {
        let fallen = (2.0 * done - 1.0).clamp(0.0, 1.0);
        let share = if done < self.normal_from { 0.0 } else { 1.0 - fallen * (1.0 - self.normal_last) };
        let smoothness = if share > 0.0 { self.weights.smoothness } else { 0.0 };
        LossWeights { normal: share * self.weights.normal, smoothness, metalness: 0.0, ..self.weights }
    }

    /// Weight of the sparsity loss, in the form of this profile: of rendered coverage (official) or
    /// of opacities.
    pub fn sparse_weight_mut(&mut self) -> &mut f32 {
        in_use(&mut self.weights.sparse_coverage, &mut self.weights.sparse)
    }

    /// Weight of the normal residuals' magnitude, in the form of this profile: of the rendered
    /// residuals (official) or of the attributes.
    pub fn residual_weight_mut(&mut self) -> &mut f32 {
        in_use(&mut self.weights.residual_image, &mut self.weights.residual)
    }

    /// Removes the terms of an ablation from the profile.
    #[must_use]
    pub fn without(mut self, ablation: Ablation) -> Self {
        if ablation.no_sparse {
            self.weights.sparse = 0.0;
            self.weights.sparse_coverage = 0.0;
        }
        if ablation.no_normal {
            self.weights.normal = 0.0;
            self.weights.smoothness = 0.0;
        }
        if ablation.no_residual && self.layout.is_shaded() {
            self.layout.sh_degree = None;
        }
        if ablation.no_axis {
            self.shading.axis = AxisRule::None;
            self.weights.residual = 0.0;
            self.weights.residual_image = 0.0;
        }
        self
    }
}

/// Weight of the rendered form of a loss if it is nonzero, else that of the form on attributes.
fn in_use<'a>(rendered: &'a mut f32, attributes: &'a mut f32) -> &'a mut f32 {
    if *rendered > 0.0 { rendered } else { attributes }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_known_light_is_not_trained_and_prints_as_a_checksum() {
        let texels = 3 * FACE_COUNT * 64 * 64;
        let profile = |radiance: f32| by_name("specula", 1000).unwrap().under(vec![radiance; texels]);
        assert_eq!(profile(0.5).rates.environment, Schedule::constant(0.0));
        let [one, same, other] = [0.5, 0.5, 0.25].map(|radiance| format!("{:?}", profile(radiance)));
        assert!(one == same && one != other && one.len() < 10_000, "{} characters", one.len());
        let plain = by_name("3dgs", 1000).unwrap();
        assert_eq!(plain.clone().under(Vec::new()), plain, "there is no light");
    }

    #[test]
    fn a_known_light_may_be_brighter_than_a_trained_one() {
        let official = by_name("official", 1000).unwrap();
        let radiance_max = |profile: &Profile| profile.light.expect("a light").radiance_max;
        assert_eq!(radiance_max(&official), 1.0);
        let known = official.clone().under(vec![5.0; 3 * FACE_COUNT * 64 * 64]);
        assert_eq!(radiance_max(&known), f32::INFINITY);
        assert_eq!(radiance_max(&official.with_light_mean([5.0; 3])), f32::INFINITY);
    }

    #[test]
    fn a_profile_selects_the_form_of_a_loss() {
        for name in NAMES {
            let mut profile = by_name(name, 1000).expect("a profile");
            *profile.sparse_weight_mut() = 0.5;
            *profile.residual_weight_mut() = 0.25;
            let LossWeights { sparse, sparse_coverage, residual, residual_image, .. } = profile.weights;
            let is_rendered = name == "official";
            let [rendered, attributes] = [(sparse_coverage, residual_image), (sparse, residual)];
            assert_eq!(if is_rendered { rendered } else { attributes }, (0.5, 0.25), "{name}");
            assert_eq!(if is_rendered { attributes } else { rendered }, (0.0, 0.0), "{name}");
        }
    }

    #[test]
    fn invisible_gaussians_are_removed_now_and_then_once_densification_has_ended() {
        let plan = by_name("specula", 7000).expect("a profile").densification;
        let rules = |iteration| plan.rules_at(iteration, 7000, 2.0);
        let removals: Vec<u32> = (1..=7000).filter(|k| rules(*k) == Some(DensifyRules::INVISIBLE)).collect();
        assert_eq!(removals, [4000, 5000, 6000, 7000]);
        assert!(rules(3500).is_none() && rules(3400).is_some_and(|rules| rules.grad_min == plan.grad_min));
        let last = |iterations| plan.rules_at(iterations, iterations, 2.0);
        assert_eq!(last(6999), Some(DensifyRules::INVISIBLE));
        assert_eq!(last(1234), None);
    }

    #[test]
    fn the_loss_on_normals_begins_late_and_ends_low() {
        let profile = Profile { normal_from: 0.1, normal_last: 0.25, ..by_name("specula", 1000).expect("a profile") };
        let share = |done: f32| profile.weights_at(done).normal / profile.weights.normal;
        assert_eq!([0.0, 0.09, 0.1, 0.5, 0.75, 1.0].map(share), [0.0, 0.0, 1.0, 1.0, 0.625, 0.25]);
        assert_eq!(profile.weights_at(0.0).coverage, profile.weights.coverage);
    }

    #[test]
    fn only_the_default_profile_has_settings_for_objects() {
        for profile in NAMES.map(|name| by_name(name, 1000).expect("a profile")) {
            let objects = profile.clone().for_objects();
            assert_eq!(objects != profile, profile.name == "specula", "{}", profile.name);
            assert!(objects.densification.split_share <= profile.densification.split_share);
            assert!(objects.weights.normal >= profile.weights.normal);
            assert_eq!(objects.weights.smoothness > 0.0, profile.name == "specula");
            assert_eq!(objects.weights.saturates, profile.name == "specula");
        }
    }

    #[test]
    fn normal_residuals_are_held_for_a_share_of_the_training() {
        let profile =
            Profile { normal_residuals_from: 0.3, cool_from: 1.0, ..by_name("specula", 1000).expect("a profile") };
        let rate = |done: f32| profile.rates_at(done).normal_residual.map(|schedule| schedule.at(1) > 0.0);
        assert_eq!([0.0, 0.29, 0.3, 1.0].map(rate), [[false; 2], [false; 2], [true; 2], [true; 2]]);
        assert_eq!(profile.rates_at(0.1).tint, profile.rates.tint);
        let free = by_name("specula", 1000).expect("a profile");
        assert_eq!(free.rates_at(0.0), free.rates);
    }

    #[test]
    fn rates_decay_from_the_start_if_exposures_are_learned() {
        let profile = by_name("specula", 7000).expect("a profile").relightable();
        let exposing = profile.clone().exposing(7000);
        assert!(exposing.exposure.is_some() && exposing.cool_from == 1.0);
        for (falling, constant) in
            [(exposing.rates.tint, profile.rates.tint), (exposing.rates.material, profile.rates.material)]
        {
            assert_eq!((falling.first, falling.last), (constant.first, 0.1 * constant.first));
        }
        assert_eq!((exposing.rates.mean, exposing.rates.opacity), (profile.rates.mean, profile.rates.opacity));
        let plain = by_name("3dgs", 7000).expect("a profile");
        assert_eq!(plain.clone().exposing(7000).rates, plain.rates);
    }

    #[test]
    fn learning_rates_fall_to_zero_at_the_end() {
        let profile = Profile { cool_from: 0.5, ..by_name("specula", 1000).expect("a profile") };
        let share = |done: f32| profile.rates_at(done).tint.at(0) / profile.rates.tint.at(0);
        assert_eq!([0.0, 0.5, 0.75, 1.0].map(share), [1.0, 1.0, 0.5, 0.0]);
        assert_eq!(profile.rates_at(1.0).mean.at(1000), 0.0);
        let warm = Profile { cool_from: 1.0, ..profile };
        assert_eq!(warm.rates_at(1.0), warm.rates);
    }

    #[test]
    fn surfaces_are_built_from_a_tenth_on_and_not_after_the_last_step() {
        let due = |iterations: u32| {
            (0..=iterations).filter(|step| NearFieldSchedule::DEFAULT.is_due(*step, iterations)).collect::<Vec<_>>()
        };
        assert_eq!(due(7000), [700, 2100, 3500, 4900, 6300]);
        assert_eq!(due(30), [3, 9, 15, 21, 27]);
    }

    #[test]
    fn only_materials_reflect_the_scene_by_default() {
        let profile = || by_name("specula", 1000).expect("a profile");
        let relightable = profile().relightable();
        assert!(relightable.near_field.is_some() && relightable.reflections == Reflections::Far);
        assert_eq!(profile().reflecting_itself().relightable().reflections, Reflections::Near);
        let per_gaussian = by_name("paper", 1000).expect("a profile");
        assert_eq!(per_gaussian.clone().reflecting_itself().relightable(), per_gaussian);
    }

    #[test]
    fn only_materials_are_fitted_at_the_end_under_several_lights() {
        let one = by_name("specula", 1000).expect("a profile").relightable();
        let several = one.clone().under_several_lights();
        assert!(!one.is_of_materials() && several.is_of_materials() && several.layout.sh_degree.is_none());
        let is_only_materials =
            |profile: &Profile, step| profile.physical.expect("materials").is_only_materials(step, 1000);
        assert_eq!([1, 700, 701, 1000].map(|step| is_only_materials(&several, step)), [false, false, true, true]);
        assert!((0..=1000).all(|step| !is_only_materials(&one, step)));
        assert!(several.step_cost(900, 1000, 40_000, 1e4) < one.step_cost(900, 1000, 40_000, 1e4), "one step of two");
        let plain = by_name("3dgs", 1000).expect("a profile");
        assert_eq!(plain.clone().under_several_lights(), plain);
    }

    #[test]
    fn every_name_has_its_profile() {
        for name in NAMES {
            assert_eq!(by_name(name, 7000).map(|profile| profile.name), Some(name));
        }
        assert!(by_name("another", 7000).is_none());
    }
}
