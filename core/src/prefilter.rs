//! Light into roughness levels (paper, eq. L_s): the levels, and the source texels of each of their
//! texels.
//!
//! A level is a linear map of the base: y_i = Σ_j A_ij x_j with Σ_j A_ij = 1. The light is kept as
//! a pyramid of means over 2×2 texels, weighted by their solid angles, and a row of A is a *cut*
//! through that pyramid: a node is used whole if the lobe hardly changes across it, and opened
//! otherwise. So the far tails of a lobe cost little.

use crate::{
    cubemap,
    double::Double,
    ggx, math,
    real::Real,
    vector::{Vec3, vec3},
};

/// Maximum number of levels of any scheme.
pub const MAX_LEVELS: usize = 10;

/// Prefilter scheme: levels, lobes and weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PrefilterScheme {
    /// Exact solid angles, lobes cut by their energy, ten levels.
    Exact,
    /// The authors' code (nvdiffrec's): its levels, its texel weights, its truncated lobe.
    Official,
}

impl PrefilterScheme {
    /// Smallest resolution of a base that can be filtered, a power of two like all others.
    pub const fn resolution_min(self) -> usize {
        match self {
            Self::Exact => RESOLUTION_MIN,
            Self::Official => 4 * RESOLUTION_MIN,
        }
    }
    /// Tests whether a base of this resolution can be filtered and looked up: a power of two from
    /// [`PrefilterScheme::resolution_min`] to [`RESOLUTION_MAX`].
    pub const fn takes(self, resolution: usize) -> bool {
        self.resolution_min() <= resolution && resolution <= RESOLUTION_MAX && resolution.is_power_of_two()
    }
}

/// Range of consecutive levels of a light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct LevelRange {
    /// The first of them.
    pub first: usize,
    /// The one after the last.
    pub end: usize,
}

impl LevelRange {
    /// Every level.
    pub const ALL: Self = Self { first: 0, end: MAX_LEVELS };
    /// No level.
    pub const NONE: Self = Self { first: 0, end: 0 };

    /// Tests whether a level is in the range.
    pub const fn contains(self, level: usize) -> bool {
        self.first <= level && level < self.end
    }
    /// This range, with one more level to either side.
    pub(crate) const fn and_neighbours(self) -> Self {
        Self { first: self.first.saturating_sub(1), end: self.end + 1 }
    }
}

/// One prefiltered copy of the light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// Perceptual roughness that it is filtered for.
    pub roughness: f32,
    /// Texels along an edge of a face.
    pub resolution: usize,
}

/// The levels of a light, sharpest first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Levels {
    levels: [Level; MAX_LEVELS],
    count: usize,
}

/// Roughness of specula's levels: each about a third more than the one before, so a linear blend of
/// two neighbours is accurate; the first lobe is within a texel of a 64² map. Chosen by measurement
/// (docs/lab/performance.md, The prefilter).
const ROUGHNESS: [f32; MAX_LEVELS] = [0.0, 0.07, 0.125, 0.17, 0.23, 0.3, 0.4, 0.55, 0.75, 1.0];
/// Coarsest resolution of a level.
const RESOLUTION_MIN: usize = 16;
/// The largest resolution of a base, up to which the index of each texel is an exact `f32`
/// ([`crate::cubemap::footprint`]).
pub const RESOLUTION_MAX: usize = 1024;
/// The official scheme's roughness of the first and of the last but one level.
const OFFICIAL_ROUGHNESS: [f32; 2] = [0.08, 0.5];

/// Roughness of the levels of a mip chain; engines find the level of a roughness by its inverse.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MipRoughness {
    /// Level / last level = ρ: glTF (`EXT_lights_image_based`), Bevy.
    Linear,
    /// Level / last level = ρ (2 − ρ): Filament.
    Filament,
}

impl MipRoughness {
    /// Roughness of a level; the last level has 1.
    fn of_level(self, level: usize, last: usize) -> f32 {
        let share = level as f32 / last as f32;
        match self {
            Self::Linear => share,
            Self::Filament => 1.0 - math::sqrt(1.0 - share),
        }
    }
}

impl Levels {
    /// The levels of a base map of this resolution, a power of two, at least 16 (official: 64).
    pub fn new(scheme: PrefilterScheme, resolution: usize) -> Self {
        match scheme {
            PrefilterScheme::Exact => Self::exact(resolution),
            PrefilterScheme::Official => Self::official(resolution),
        }
    }

    /// Creates given levels, sharpest first. `None` unless there are two to [`MAX_LEVELS`], their
    /// roughness increases within \[0, 1\], and their resolutions are powers of two that do not
    /// increase.
    pub fn of(levels: &[Level]) -> Option<Self> {
        let is_level = |level: &Level| (0.0..=1.0).contains(&level.roughness) && level.resolution.is_power_of_two();
        let is_in_order =
            |pair: &[Level]| pair[0].roughness < pair[1].roughness && pair[0].resolution >= pair[1].resolution;
        let is_fine = (2..=MAX_LEVELS).contains(&levels.len())
            && levels.iter().all(is_level)
            && levels.windows(2).all(is_in_order);
        is_fine.then(|| {
            let mut all = [levels[0]; MAX_LEVELS];
            all[..levels.len()].copy_from_slice(levels);
            Self { levels: all, count: levels.len() }
        })
    }

    /// Creates a mip chain of `count` levels, each half as wide as the one before. `None` if
    /// [`Levels::of`] returns `None`, or if a level would have no texel.
    pub fn mips(roughness: MipRoughness, resolution: usize, count: usize) -> Option<Self> {
        let mut levels = [Level { roughness: 0.0, resolution }; MAX_LEVELS];
        let levels = levels.get_mut(..count)?;
        for (index, level) in levels.iter_mut().enumerate() {
            *level = Level { roughness: roughness.of_level(index, count - 1), resolution: resolution >> index };
        }
        Self::of(levels)
    }

    /// Texels as wide as the lobe: the resolution halves whenever α_ggx doubles, from α = 0.95 /
    /// resolution.
    fn exact(resolution: usize) -> Self {
        let resolve = |roughness: f32| {
            let mut size = resolution;
            let mut finest_alpha = 0.95 / resolution as f32;
            while roughness * roughness > finest_alpha && size > RESOLUTION_MIN {
                size /= 2;
                finest_alpha *= 2.0;
            }
            size
        };
        let levels = ROUGHNESS.map(|roughness| Level { roughness, resolution: resolve(roughness) });
        Self { levels, count: MAX_LEVELS }
    }

    fn official(resolution: usize) -> Self {
        let mut levels = [Level { roughness: 1.0, resolution: RESOLUTION_MIN }; MAX_LEVELS];
        let count = ((resolution / RESOLUTION_MIN).ilog2() as usize + 1).clamp(3, MAX_LEVELS);
        let [first, last] = OFFICIAL_ROUGHNESS;
        for (index, level) in levels.iter_mut().enumerate().take(count - 1) {
            level.roughness = first + (last - first) * index as f32 / (count - 2) as f32;
            level.resolution = (resolution >> index).max(RESOLUTION_MIN);
        }
        Self { levels, count }
    }

    /// The levels, sharpest first.
    pub fn as_slice(&self) -> &[Level] {
        &self.levels[..self.count]
    }
}

/// Position of a roughness between the levels: level i at its own roughness, linear in between,
/// constant outside.
#[inline(always)]
pub fn level_of_roughness<R: Real>(roughness: R, levels: &[Level]) -> R {
    let mut position = roughness.zero();
    for pair in levels.windows(2) {
        let step = (roughness - pair[0].roughness) / (pair[1].roughness - pair[0].roughness);
        position = position + step.clamp(0.0, 1.0);
    }
    position
}

/// Gradient of [`level_of_roughness`]; zero outside the levels.
#[inline(always)]
pub fn level_of_roughness_vjp<R: Real>(roughness: R, levels: &[Level], grad: R) -> R {
    let mut slope = roughness.zero();
    for pair in levels.windows(2) {
        let inside = roughness.constant(pair[0].roughness).less_or_equal(roughness)
            & roughness.less(roughness.constant(pair[1].roughness));
        slope = slope + slope.constant(pair[1].roughness - pair[0].roughness).recip().keep(inside);
    }
    grad * slope
}

/// Largest width of a pyramid node that is used whole, as a share of the lobe's scale at its
/// distance. Narrow lobes have many rows and cover little of each node, so a coarse cut is enough;
/// wide lobes have few rows and a fine cut.
const OPENING: [f64; 2] = [1.4, 0.5];
/// Lobes with a larger α count as wide.
const WIDE_ALPHA: f64 = 0.05;
/// Largest node of wide lobes, in radians.
const NODE_WIDTH_MAX: f64 = 0.2;
/// Share of a lobe inside its cut. The rest changes the mean by a thousandth, but would be half of
/// a narrow lobe's weights.
pub const ENERGY_KEPT: f64 = 0.995;

/// Lobe around a direction: its nodes in the light's pyramid, and their weights.
#[derive(Clone, Copy, Debug)]
pub struct Lobe {
    reflection_dir: Vec3<Double>,
    alpha_ggx: f64,
    /// Distance from the axis, on the unit sphere, to where the lobe is cut.
    cut: f64,
}

impl Lobe {
    /// The lobe of a roughness whose square is `alpha_ggx`, in (0, 1], around a unit vector; cut at
    /// [`ENERGY_KEPT`].
    pub fn new(reflection_dir: Vec3<Double>, alpha_ggx: f64) -> Self {
        let angle = ggx::energy_angle(alpha_ggx, ENERGY_KEPT);
        // 2 sin(θ/2), from the cosine
        let cut = math::sqrt64(2.0 - 2.0 * math::cos64(angle));
        Self { reflection_dir, alpha_ggx, cut }
    }

    /// True if any part of a node of this resolution, with its centre at `node_dir`, is inside the
    /// cut.
    pub fn sees(&self, node_dir: Vec3<Double>, resolution: usize) -> bool {
        // Half the diagonal of a node is √2 / resolution at most.
        self.distance(node_dir) <= self.cut + core::f64::consts::SQRT_2 / resolution as f64
    }

    /// True if the lobe changes so much across a node that it must be opened.
    ///
    /// K falls off on the scale of θ + 2α at the angle θ; the node is opened if its width, π / 2
    /// over its resolution, exceeds a share of that.
    pub fn must_open(&self, node_dir: Vec3<Double>, resolution: usize) -> bool {
        let width = core::f64::consts::FRAC_PI_2 / resolution as f64;
        let is_wide = self.alpha_ggx > WIDE_ALPHA;
        let scale = (self.distance(node_dir) - width).max(0.0) + 2.0 * self.alpha_ggx;
        is_wide && width > NODE_WIDTH_MAX || width > OPENING[usize::from(is_wide)] * scale
    }

    /// ∫ K cos θ over a node, before normalisation: K cos θ at the centres of its quarters, times
    /// their solid angles.
    pub fn weight(&self, quarters: &[(Vec3<Double>, f64); 4]) -> f64 {
        quarters.iter().fold(0.0, |sum, (light_dir, solid_angle)| {
            let weight = ggx::lobe_weight(self.reflection_dir, *light_dir, Double(self.alpha_ggx));
            sum + (weight * ggx::cosine(self.reflection_dir, *light_dir)).0 * solid_angle
        })
    }

    fn distance(&self, node_dir: Vec3<Double>) -> f64 {
        math::sqrt64((node_dir - self.reflection_dir).length_squared().0)
    }
}

/// A texel of the light's pyramid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Node {
    /// The face it lies on.
    pub face: usize,
    /// Its column.
    pub column: usize,
    /// Its row.
    pub row: usize,
    /// Resolution of its pyramid level.
    pub resolution: usize,
}

impl Node {
    /// The four nodes that it is the mean of.
    pub fn children(&self) -> [Self; 4] {
        [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(right, lower)| Self {
            face: self.face,
            column: 2 * self.column + right,
            row: 2 * self.row + lower,
            resolution: 2 * self.resolution,
        })
    }

    /// Solid angle, in steradians.
    pub fn solid_angle(&self) -> f64 {
        cubemap::texel_solid_angle(self.column, self.row, self.resolution)
    }

    /// Unit direction of the centre.
    pub fn direction(&self) -> Vec3<Double> {
        let [x, y, z] = cubemap::texel_direction(self.face, self.column, self.row, self.resolution).map(Double);
        vec3(x, y, z)
    }
}

/// The official scheme's weight of a texel, meant as its solid angle: a product of two arcs, half a
/// texel off.
pub fn official_texel_weight(column: usize, row: usize, resolution: usize) -> f64 {
    let half = resolution as f64 / 2.0;
    let arc = |k: usize| {
        let distance = math::sqrt64((k as f64 - half) * (k as f64 - half));
        math::atan64((distance + 1.0) / half) - math::atan64(distance / half)
    };
    arc(column) * arc(row)
}

/// The official scheme's cut: cosine of the first of 10⁶ angles, uniform in [0, π/2], at which the
/// running sum of D(cos θ), without its sine, reaches 99 % of the whole. It is then applied to the
/// angle of the light.
pub fn official_cut_cosine(alpha_ggx: f64) -> f64 {
    const STEPS: u32 = 1_000_000;
    const KEPT: f64 = 0.99;
    let angle = |k: u32| core::f64::consts::FRAC_PI_2 * f64::from(k) / f64::from(STEPS - 1);
    let density = |k: u32| ggx::distribution(math::cos64(angle(k)), alpha_ggx);
    let total: f64 = (0..STEPS).map(density).sum();
    let mut sum = 0.0;
    for k in 0..STEPS {
        sum += density(k);
        if sum >= KEPT * total {
            return math::cos64(angle(k));
        }
    }
    0.0
}

/// The official scheme's weight of light from a texel in a lobe: cos θ · D(θ/2) · weight / 4, zero
/// outside the cut. `texel_weight` is the texel's [`official_texel_weight`].
pub fn official_lobe_weight(
    reflection_dir: Vec3<Double>,
    texel_dir: Vec3<Double>,
    texel_weight: f64,
    alpha_ggx: f64,
    cut_cosine: f64,
) -> f64 {
    let cosine = texel_dir.dot(reflection_dir).0;
    if cosine < cut_cosine {
        return 0.0;
    }
    let cos_half = math::sqrt64(((1.0 + cosine) * 0.5).clamp(0.0, 1.0));
    cosine.max(0.0) * ggx::distribution(cos_half, alpha_ggx) * texel_weight / 4.0
}

/// Weight of a texel in the cosine-weighted mean of the light around a normal, irradiance / π: cos
/// θ Ω / π.
pub fn irradiance_weight(normal: Vec3<Double>, texel_dir: Vec3<Double>, solid_angle: f64) -> f64 {
    texel_dir.dot(normal).0.max(0.0) * solid_angle / core::f64::consts::PI
}

/// The official scheme's [`irradiance_weight`]: its own texel weight, a cosine cut at 0.999, and no
/// normalisation.
pub fn official_irradiance_weight(normal: Vec3<Double>, texel_dir: Vec3<Double>, texel_weight: f64) -> f64 {
    texel_dir.dot(normal).0.clamp(0.0, 0.999) * texel_weight / core::f64::consts::PI
}

/// Resolution of the irradiance map of the official scheme.
pub const IRRADIANCE_RESOLUTION: usize = 16;
