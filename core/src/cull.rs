//! Reasons why Gaussians are culled from a picture, and their counts.
//!
//! Robust forms keep valid Gaussians finite: the determinant of a splat's covariance by Cauchy and
//! Binet; the falloff through a triangular root of the conic, so no exponent is positive; lobe
//! weights from sums and differences of directions. A Gaussian with a value that is not finite is
//! not drawn: `project` puts it behind the eye, and `shade` rejects colours. Shaders test bits,
//! since compilers may assume that all numbers are finite.

use crate::{
    attributes::{AttributePlanes, Harmonics, StoredGaussian},
    bin::{footprint, half_extent, touches_picture},
    camera::Camera,
    cutoffs::ALPHA_MIN,
    project::{Shape, project},
    scene::{
        DIFFUSE, Gaussians, LOG_SCALE, MEAN, NORMAL_RESIDUAL_1, NORMAL_RESIDUAL_2, OPACITY, QUAT, ROUGHNESS, TINT,
    },
};

/// Reason why a Gaussian is culled: the first that applies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CullReason {
    /// It is drawn.
    Drawn,
    /// A number of its mean is not finite.
    NonfiniteMean,
    /// A logarithm of a scale is not finite.
    NonfiniteScale,
    /// A number of its quat is not finite.
    NonfiniteQuat,
    /// Its opacity is not finite before the sigmoid.
    NonfiniteOpacity,
    /// Its diffuse colour or its tint is not finite before the sigmoid.
    NonfiniteColor,
    /// Its roughness is not finite before the sigmoid.
    NonfiniteRoughness,
    /// A number of its normal residuals is not finite.
    NonfiniteResidual,
    /// A coefficient of its harmonics is not finite.
    NonfiniteHarmonics,
    /// A number of its physical material is not finite.
    NonfiniteMaterial,
    /// The deviation of its filter in space is not finite.
    NonfiniteFilter,
    /// Its opacity is below the least alpha.
    Faint,
    /// It is behind the eye, or nearer than [`Camera::near`].
    Near,
    /// A value of its projection, or the sum of its harmonics, is too large for an `f32`.
    TooLarge,
    /// The box around it misses the picture.
    Outside,
}

impl CullReason {
    /// All of them, in the order of their numbers.
    pub const ALL: [Self; 15] = [
        Self::Drawn,
        Self::NonfiniteMean,
        Self::NonfiniteScale,
        Self::NonfiniteQuat,
        Self::NonfiniteOpacity,
        Self::NonfiniteColor,
        Self::NonfiniteRoughness,
        Self::NonfiniteResidual,
        Self::NonfiniteHarmonics,
        Self::NonfiniteMaterial,
        Self::NonfiniteFilter,
        Self::Faint,
        Self::Near,
        Self::TooLarge,
        Self::Outside,
    ];

    /// Whether a number of the Gaussian is not finite.
    pub const fn is_nonfinite(self) -> bool {
        Self::NonfiniteMean as usize <= self as usize && self as usize <= Self::NonfiniteFilter as usize
    }

    /// Short name of the reason, or of the attribute that is not finite.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Drawn => "drawn",
            Self::NonfiniteMean => "mean",
            Self::NonfiniteScale => "scale",
            Self::NonfiniteQuat => "quat",
            Self::NonfiniteOpacity => "opacity",
            Self::NonfiniteColor => "colour",
            Self::NonfiniteRoughness => "roughness",
            Self::NonfiniteResidual => "normal residual",
            Self::NonfiniteHarmonics => "harmonics",
            Self::NonfiniteMaterial => "physical material",
            Self::NonfiniteFilter => "filter",
            Self::Faint => "too faint",
            Self::Near => "behind the eye or too near",
            Self::TooLarge => "too large for a number",
            Self::Outside => "outside of the picture",
        }
    }

    /// Reason for a Gaussian in pictures that read all its attributes. Without a camera, only its
    /// attributes are tested.
    pub fn of<A: AsRef<[f32]>>(gaussians: &Gaussians<A>, gaussian: usize, camera: Option<&Camera>) -> Self {
        nonfinite(gaussians, gaussian)
            .unwrap_or_else(|| camera.map_or(Self::Drawn, |camera| in_view(gaussians, gaussian, camera)))
    }
}

/// Number of Gaussians of each [`CullReason`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CullStats {
    counts: [usize; CullReason::ALL.len()],
}

impl CullStats {
    /// Reads every Gaussian once; without a camera, tests only its attributes.
    pub fn of<A: AsRef<[f32]>>(gaussians: &Gaussians<A>, camera: Option<&Camera>) -> Self {
        let mut counts = [0; CullReason::ALL.len()];
        (0..gaussians.count).for_each(|gaussian| counts[CullReason::of(gaussians, gaussian, camera) as usize] += 1);
        Self { counts }
    }
    /// Gaussians culled for this reason, or drawn.
    pub const fn count(&self, reason: CullReason) -> usize {
        self.counts[reason as usize]
    }
    /// Gaussians with a number that is not finite.
    pub fn nonfinite(&self) -> usize {
        CullReason::ALL.into_iter().filter(|reason| reason.is_nonfinite()).map(|reason| self.count(reason)).sum()
    }
}

/// Planes of an attribute, first and past the last, with the reason if they are not finite.
const GEOMETRY: [(usize, usize, CullReason); 4] = [
    (MEAN, LOG_SCALE, CullReason::NonfiniteMean),
    (LOG_SCALE, QUAT, CullReason::NonfiniteScale),
    (QUAT, OPACITY, CullReason::NonfiniteQuat),
    (OPACITY, OPACITY + 1, CullReason::NonfiniteOpacity),
];
const MATERIAL: [(usize, usize, CullReason); 3] = [
    (DIFFUSE, TINT + 3, CullReason::NonfiniteColor),
    (ROUGHNESS, ROUGHNESS + 1, CullReason::NonfiniteRoughness),
    (NORMAL_RESIDUAL_1, NORMAL_RESIDUAL_2 + 3, CullReason::NonfiniteResidual),
];

fn nonfinite<A: AsRef<[f32]>>(gaussians: &Gaussians<A>, gaussian: usize) -> Option<CullReason> {
    let layout = gaussians.layout;
    let material = if layout.is_shaded() { &MATERIAL[..] } else { &[] };
    let optional = [
        (layout.sh_start(), layout.sh_end(), CullReason::NonfiniteHarmonics),
        (layout.sh_end(), layout.physical_end(), CullReason::NonfiniteMaterial),
        (layout.physical_end(), layout.plane_count(), CullReason::NonfiniteFilter),
    ];
    let is_finite = |plane: usize| gaussians.get::<1>(gaussian, plane)[0].is_finite();
    let mut attributes = GEOMETRY.iter().chain(material).chain(&optional);
    attributes.find(|(first, end, _)| !(*first..*end).all(is_finite)).map(|(_, _, reason)| *reason)
}

fn in_view<A: AsRef<[f32]>>(gaussians: &Gaussians<A>, gaussian: usize, camera: &Camera) -> CullReason {
    let planes = StoredGaussian { gaussians, index: gaussian };
    let shape: Shape<f32> = planes.shape(gaussians.layout);
    let lifted = camera.lift(0.0_f32);
    let splat = project(&shape, &lifted);
    let reach = footprint(&splat).reach;
    let layout = gaussians.layout;
    let harmonics = || Harmonics::new(&planes, layout.sh_start(), layout.sh_count(), lifted.position);
    if splat.opacity <= ALPHA_MIN {
        CullReason::Faint
    } else if splat.depth < 0.0 && lifted.to_camera(shape.mean).is_finite() {
        CullReason::Near
    } else if reach < 0.0 || !harmonics().sum.is_finite() {
        CullReason::TooLarge
    } else if !touches_picture(splat.mean2d, half_extent(&splat, reach), camera.size_px()) {
        CullReason::Outside
    } else {
        CullReason::Drawn
    }
}
