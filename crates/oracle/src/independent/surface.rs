//! Colours of Gaussians: harmonics, or the paper's shading function of a surface under a light.

use glam::{DMat3, DQuat, DVec3};
use specula_core::scene::{
    DIFFUSE, Gaussians, LOG_SCALE, MEAN, NORMAL_RESIDUAL_1, NORMAL_RESIDUAL_2, OPACITY, QUAT, ROUGHNESS, TINT,
};

use super::rays::{Gaussian, LowPass};

/// Lower bound of coverage in divisions, rounded to the model's 32 bits.
const COVERAGE_MIN: f64 = 1e-3_f32 as f64;

/// Surface of a Gaussian; all numbers after activation.
#[derive(Clone, Debug, PartialEq)]
pub enum Look {
    /// A colour for each direction, sRGB: the sum of 1, 4, 9 or 16 spherical harmonics and one
    /// half, at least zero.
    Radiance(Vec<DVec3>),
    /// A surface.
    Surface(Surface),
}

/// A surface that reflects a light; colours are linear.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// The shortest axis, of unit length.
    pub axis: DVec3,
    /// Δn₁ if the axis faces the eye, and Δn₂ if it does not.
    pub normal_residuals: [DVec3; 2],
    /// c_d.
    pub diffuse: DVec3,
    /// s.
    pub tint: DVec3,
    /// ρ, perceptual, in [0, 1].
    pub roughness: f64,
    /// Coefficients of c_r: 0, 1, 4, 9 or 16.
    pub residual: Vec<DVec3>,
}

/// Light along a direction, filtered for a perceptual roughness: L_s.
pub type Light<'a> = dyn Fn(DVec3, f64) -> DVec3 + Sync + 'a;

/// Gaussians, and their appearances.
pub fn gaussians(cloud: &Gaussians<Vec<f32>>) -> Vec<(Gaussian, Look)> {
    let wide = |k: usize, first: usize| DVec3::from_array(cloud.get::<3>(k, first).map(f64::from));
    let harmonics = |k: usize| (0..cloud.layout.sh_count()).map(|n| wide(k, cloud.layout.sh_start() + 3 * n)).collect();
    let sigmoids = |k: usize, first: usize| wide(k, first).to_array().map(sigmoid).into();
    let one = |k: usize| {
        let [w, x, y, z] = cloud.get::<4>(k, QUAT).map(f64::from);
        let rotation = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
        let scales = wide(k, LOG_SCALE).exp();
        let opacity = sigmoid(cloud.get::<1>(k, OPACITY)[0].into());
        // Σ + s² I has the same axes.
        let deviation = cloud.layout.filter_plane().map_or(0.0, |plane| f64::from(cloud.get::<1>(k, plane)[0]));
        let wider = scales.map(|scale| scale.hypot(deviation));
        let gaussian = Gaussian {
            mean: wide(k, MEAN),
            axes: rotation * DMat3::from_diagonal(wider),
            opacity: opacity * (scales / wider).element_product(),
            low_pass: LowPass {
                variance: cloud.layout.low_pass.variance().into(),
                is_compensated: cloud.layout.low_pass.is_compensated(),
            },
        };
        if !cloud.layout.is_shaded() {
            return (gaussian, Look::Radiance(harmonics(k)));
        }
        let surface = Surface {
            axis: rotation.col(shortest(scales)),
            normal_residuals: [NORMAL_RESIDUAL_1, NORMAL_RESIDUAL_2].map(|first| wide(k, first)),
            diffuse: sigmoids(k, DIFFUSE),
            tint: sigmoids(k, TINT),
            roughness: sigmoid(cloud.get::<1>(k, ROUGHNESS)[0].into()),
            residual: harmonics(k),
        };
        (gaussian, Look::Surface(surface))
    };
    (0..cloud.count).map(one).collect()
}

/// The first of several shortest axes.
fn shortest(scales: DVec3) -> usize {
    (1..3).fold(0, |least, k| if scales[k] < scales[least] { k } else { least })
}

fn sigmoid(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

impl Look {
    /// The surface, if it is one.
    pub fn surface(&self) -> Option<&Surface> {
        match self {
            Self::Radiance(_) => None,
            Self::Surface(surface) => Some(surface),
        }
    }

    /// Colour of a Gaussian, sRGB: γ(c_d + s ⊙ L_s + c_r) for surfaces (paper, eq. 3). `to_eye` is
    /// a unit vector.
    pub fn color(&self, to_eye: DVec3, light: &Light<'_>) -> DVec3 {
        match self {
            Self::Radiance(harmonics) => (sum_of_harmonics(harmonics, -to_eye) + 0.5).max(DVec3::ZERO),
            Self::Surface(surface) => {
                let light = light(mirrored(to_eye, surface.normal(to_eye)), surface.roughness);
                srgb(surface.base(to_eye) + surface.tint * light)
            }
        }
    }
}

impl Surface {
    /// n = v + Δn₁, or −(v + Δn₂) if the axis v faces away; of unit length.
    pub fn normal(&self, to_eye: DVec3) -> DVec3 {
        let [first, second] = self.normal_residuals;
        let sum = if self.axis.dot(to_eye) >= 0.0 { self.axis + first } else { -(self.axis + second) };
        sum.normalize()
    }

    /// c_d + c_r.
    fn base(&self, to_eye: DVec3) -> DVec3 {
        self.diffuse + sum_of_harmonics(&self.residual, -to_eye)
    }

    /// Blended channels for light per pixel: base, normal, tint, roughness.
    pub fn channels(&self, to_eye: DVec3) -> Vec<f64> {
        let vectors = [self.base(to_eye), self.normal(to_eye), self.tint];
        vectors.iter().flat_map(|v| v.to_array()).chain([self.roughness]).collect()
    }
}

/// Number of [`Surface::channels`].
pub const SURFACE_CHANNELS: usize = 10;

/// Colour of a pixel, sRGB and premultiplied, from its blended [`Surface::channels`] and its
/// transmittance: the shading function of the mean surface.
pub fn pixel_color(blended: &[f64; SURFACE_CHANNELS], transmittance: f64, to_eye: DVec3, light: &Light<'_>) -> DVec3 {
    let coverage = 1.0 - transmittance;
    let of = |first: usize| DVec3::from_slice(&blended[first..]);
    let mean = |sum: DVec3| sum / coverage.max(COVERAGE_MIN);
    let normal = of(3).try_normalize().unwrap_or(to_eye);
    let light = light(mirrored(to_eye, normal), blended[9] / coverage.max(COVERAGE_MIN));
    coverage * srgb(mean(of(0)) + mean(of(6)) * light)
}

/// Mirrored view direction: r = 2 (ω·n) n − ω.
pub fn mirrored(to_eye: DVec3, normal: DVec3) -> DVec3 {
    2.0 * to_eye.dot(normal) * normal - to_eye
}

/// IEC 61966-2-1; both pieces are extended beyond [0, 1].
fn srgb(linear: DVec3) -> DVec3 {
    let curve = |x: f64| if x > 0.003_130_8 { 1.055 * x.powf(1.0 / 2.4) - 0.055 } else { 12.92 * x };
    linear.to_array().map(curve).into()
}

/// Real spherical harmonics with the usual signs (Sloan 2008, with the Condon–Shortley phase).
pub fn sum_of_harmonics(coefficients: &[DVec3], direction: DVec3) -> DVec3 {
    let [x, y, z] = direction.to_array();
    let basis = [
        0.28209479177387814,
        -0.4886025119029199 * y,
        0.4886025119029199 * z,
        -0.4886025119029199 * x,
        1.0925484305920792 * x * y,
        -1.0925484305920792 * y * z,
        0.31539156525252005 * (2.0 * z * z - x * x - y * y),
        -1.0925484305920792 * x * z,
        0.5462742152960396 * (x * x - y * y),
        -0.5900435899266435 * y * (3.0 * x * x - y * y),
        2.890611442640554 * x * y * z,
        -0.4570457994644658 * y * (4.0 * z * z - x * x - y * y),
        0.3731763325901154 * z * (2.0 * z * z - 3.0 * x * x - 3.0 * y * y),
        -0.4570457994644658 * x * (4.0 * z * z - x * x - y * y),
        1.445305721320277 * z * (x * x - y * y),
        -0.5900435899266435 * x * (x * x - 3.0 * y * y),
    ];
    coefficients.iter().zip(basis).map(|(color, value)| *color * value).sum()
}
