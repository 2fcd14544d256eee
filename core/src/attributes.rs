//! Attributes of a Gaussian: stored planes to material, harmonics and channels, with their
//! gradients.
//!
//! The composition of the stage `shade` and of its gradient, over any memory. An executor
//! implements two small traits: [`AttributePlanes`] reads the numbers of a Gaussian, or of several
//! side by side, and [`AttributeGrads`] takes their gradients. It calls, in this order,
//!
//! ```text
//! forward   material and surface  GaussianShading::shaded
//!           light along surface.reflection_dir, surface.facing.normal     (by the executor)
//!           terms and channels    ShadedGaussian::terms, GaussianShading::surface_channels
//! backward  shaded and terms again, then GaussianShading::terms_vjp
//!           gradient of the light that was looked up                      (by the executor)
//!           GaussianShading::surface_vjp, then shape_vjp
//! ```
//!
//! Gaussians that read no surface ([`GaussianShading::reads_surface`]) take
//! [`GaussianShading::color_channels`] and [`GaussianShading::radiance_vjp`] instead.

use crate::{
    activation::sigmoid,
    camera::{CameraGrad, CameraOf},
    covariance::{Quat, rotation},
    each,
    loss::{LossWeights, metalness, metalness_vjp, residual_vjp, sparse, sparse_vjp},
    normal::{AxisRule, axis, facing},
    physical::{metal_share, reflectances, reflectances_vjp},
    project::{Shape, project_camera_vjp, project_vjp},
    real::Real,
    rules::{Channels, RenderRules, channel},
    scene::{
        ALBEDO, AMBIENT, DIFFUSE, Gaussians, LOG_SCALE, Layout, MEAN, METALNESS, NORMAL_RESIDUAL_1, NORMAL_RESIDUAL_2,
        OPACITY, QUAT, ROUGHNESS, TINT,
    },
    sh,
    shade::{
        Material, ShadingForm, Surface, SurfaceGrad, Terms, diffuse, shade, shade_vjp, specular, surface, surface_vjp,
        view_dir, view_dir_vjp,
    },
    splat::SplatGrad,
    vector::{Vec3, vec3},
};

/// Numbers of a Gaussian, plane by plane ([`crate::scene::Layout`]).
pub trait AttributePlanes<R: Real> {
    /// Number of one plane.
    fn number(&self, plane: usize) -> R;

    /// Numbers of three neighbouring planes.
    #[inline(always)]
    fn vec3(&self, first: usize) -> Vec3<R> {
        vec3(self.number(first), self.number(first + 1), self.number(first + 2))
    }
    /// Orientation.
    #[inline(always)]
    fn quat(&self) -> Quat<R> {
        [self.number(QUAT), self.number(QUAT + 1), self.number(QUAT + 2), self.number(QUAT + 3)]
    }
    /// Mean, scales, orientation and opacity, before activation, and the filters of a layout.
    #[inline(always)]
    fn shape(&self, layout: Layout) -> Shape<R> {
        Shape {
            mean: self.vec3(MEAN),
            log_scales: self.vec3(LOG_SCALE),
            quat: self.quat(),
            opacity_logit: self.number(OPACITY),
            low_pass: layout.low_pass,
            filter: layout.filter_plane().map(|plane| self.number(plane)),
        }
    }
}

/// Destination of the gradients of a Gaussian's numbers. Each plane is written once.
pub trait AttributeGrads<R: Real> {
    /// Takes the gradient of one plane.
    fn set(&mut self, plane: usize, grad: R);

    /// Takes the gradients of three neighbouring planes.
    #[inline(always)]
    fn set3(&mut self, first: usize, grad: Vec3<R>) {
        self.set(first, grad.x);
        self.set(first + 1, grad.y);
        self.set(first + 2, grad.z);
    }
}

/// One Gaussian in host memory.
#[derive(Clone, Copy, Debug)]
pub struct StoredGaussian<'a, A> {
    /// The Gaussians.
    pub gaussians: &'a Gaussians<A>,
    /// Index of the Gaussian.
    pub index: usize,
}

impl<R: Real, A: AsRef<[R]>> AttributePlanes<R> for StoredGaussian<'_, A> {
    #[inline(always)]
    fn number(&self, plane: usize) -> R {
        self.gaussians.values.as_ref()[self.gaussians.index_of(self.index, plane)]
    }
}

/// Normal of a Gaussian without shading attributes, for the normal layer: its shortest axis, turned
/// to the viewer.
#[inline(always)]
pub fn shortest_axis_normal<R: Real>(shape: &Shape<R>, eye: Vec3<R>) -> Vec3<R> {
    let axis = axis(AxisRule::Shortest, &rotation(shape.quat), shape.log_scales);
    let none = Vec3::zero(shape.opacity_logit);
    facing(axis, view_dir(shape.mean, eye), [none; 2], true).normal
}

/// Spherical harmonics of a Gaussian along the ray from the eye.
#[derive(Clone, Copy, Debug)]
pub struct Harmonics<R> {
    /// Harmonics in use: 0, 1, 4, 9 or 16 for each colour.
    pub count: usize,
    /// Unit direction from the eye to the Gaussian.
    pub ray_dir: Vec3<R>,
    /// Values of the harmonics along the ray; zero beyond `count`.
    pub basis: [R; sh::MAX_COUNT],
    /// Σ basis · coefficient.
    pub sum: Vec3<R>,
}

impl<R: Real> Harmonics<R> {
    /// Sums `count` harmonics whose coefficients begin at the plane `first`.
    #[inline(always)]
    pub fn new(planes: &impl AttributePlanes<R>, first: usize, count: usize, eye: Vec3<R>) -> Self {
        let ray_dir = -view_dir(planes.vec3(MEAN), eye);
        let basis = sh::basis(ray_dir, count);
        let mut sum = Vec3::zero(ray_dir.x);
        for k in 0..count {
            sum = sum.add_scaled(basis[k], planes.vec3(first + 3 * k));
        }
        Self { count, ray_dir, basis, sum }
    }

    /// Gradient of the sum: writes that of the coefficients, and returns that of the direction to
    /// the eye.
    #[inline(always)]
    pub fn vjp(
        &self,
        planes: &impl AttributePlanes<R>,
        first: usize,
        grad: Vec3<R>,
        out: &mut impl AttributeGrads<R>,
    ) -> Vec3<R> {
        let mut grad_basis = [grad.x.zero(); sh::MAX_COUNT];
        for k in 0..self.count {
            let plane = first + 3 * k;
            out.set3(plane, grad * self.basis[k]);
            grad_basis[k] = grad.dot(planes.vec3(plane));
        }
        -sh::basis_vjp(self.ray_dir, self.count, &grad_basis)
    }
}

/// Light looked up for a Gaussian.
#[derive(Clone, Copy, Debug)]
pub struct LightSample<R> {
    /// Prefiltered radiance along the reflected direction.
    pub specular: Vec3<R>,
    /// Irradiance / π along the normal; read by
    /// [`ShadingForm::Official`] only.
    pub ambient: Vec3<R>,
    /// (F_x, F_y) of the split-sum table; read by
    /// [`ShadingForm::Official`] only.
    pub split_sum: [R; 2],
}

impl<R: Real> LightSample<R> {
    /// No light: all zeros.
    #[inline(always)]
    pub fn none(like: R) -> Self {
        Self { specular: Vec3::zero(like), ambient: Vec3::zero(like), split_sum: [like.zero(); 2] }
    }
}

/// Gradient through the lookups of a [`LightSample`].
#[derive(Clone, Copy, Debug)]
pub struct LookupGrad<R> {
    /// Gradients of the reflected direction and of the roughness; `None` without a specular lookup.
    pub specular: Option<(Vec3<R>, R)>,
    /// Gradients of the normal, and of n·v and the roughness through the split-sum table; `None`
    /// except for [`ShadingForm::Official`] under a light.
    pub ambient: Option<(Vec3<R>, [R; 2])>,
}

/// Channels of all layers, in the order of [`mod@channel`]; zero for layers that were not
/// requested.
#[derive(Clone, Copy, Debug)]
pub struct LayerChannels<R>(pub [R; Channels::Layers.count()]);

impl<R: Real> LayerChannels<R> {
    /// Only the depth; the other channels are zero.
    #[inline(always)]
    fn with_depth(depth: R) -> Self {
        let mut channels = Self([depth.zero(); Channels::Layers.count()]);
        channels.0[channel::DEPTH] = depth;
        channels
    }
    #[inline(always)]
    fn set3(&mut self, first: usize, v: Vec3<R>) {
        self.0[first] = v.x;
        self.0[first + 1] = v.y;
        self.0[first + 2] = v.z;
    }
    /// Three neighbouring channels.
    #[inline(always)]
    pub fn vec3(&self, first: usize) -> Vec3<R> {
        vec3(self.0[first], self.0[first + 1], self.0[first + 2])
    }
}

/// Gradient of the attributes that shading shares with projection.
#[derive(Clone, Copy, Debug)]
pub struct PoseGrad<R> {
    /// Gradient of the mean.
    pub mean: Vec3<R>,
    /// Gradient of the quat.
    pub quat: Quat<R>,
}

impl<R: Real> PoseGrad<R> {
    /// No gradient.
    #[inline(always)]
    pub fn zero(like: R) -> Self {
        Self { mean: Vec3::zero(like), quat: [like.zero(); 4] }
    }
}

/// Writes the gradient of a Gaussian's shape: that of its splat and that of its shading.
#[inline(always)]
pub fn shape_vjp<R: Real>(
    shape: &Shape<R>,
    camera: &CameraOf<R>,
    splat: &SplatGrad<R>,
    shading: &PoseGrad<R>,
    out: &mut impl AttributeGrads<R>,
) {
    let grad = project_vjp(shape, camera, splat);
    out.set3(MEAN, grad.mean + shading.mean);
    out.set3(LOG_SCALE, grad.log_scales);
    for k in 0..4 {
        out.set(QUAT + k, grad.quat[k] + shading.quat[k]);
    }
    out.set(OPACITY, grad.opacity_logit);
}

/// Gradient of the camera's pose through one Gaussian: through its splat, and through the direction
/// to the eye, the only place of the camera that shading reads.
#[inline(always)]
pub fn camera_vjp<R: Real>(
    shape: &Shape<R>,
    camera: &CameraOf<R>,
    splat: &SplatGrad<R>,
    shading: &PoseGrad<R>,
) -> CameraGrad<R> {
    let grad = project_camera_vjp(shape, camera, splat);
    CameraGrad { position: grad.position - shading.mean, ..grad }
}

/// Shading of a cloud: layout of its planes, and rendering rules.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GaussianShading {
    /// Planes of the cloud.
    pub layout: Layout,
    /// Rendering rules.
    pub rules: RenderRules,
}

/// Gaussian before lighting.
#[derive(Clone, Copy, Debug)]
pub struct ShadedGaussian<R: Real> {
    /// Attributes before activation.
    pub material: Material<R>,
    /// Directions and activated colours.
    pub surface: Surface<R>,
    /// Residual colour.
    pub harmonics: Harmonics<R>,
    /// Ambient transfer of a physical material; its albedo and metalness replace diffuse colour and
    /// tint.
    pub ambient: Option<Vec3<R>>,
}

impl<R: Real> ShadedGaussian<R> {
    /// Terms of the shading function under the light of a lookup.
    #[inline(always)]
    pub fn terms(&self, light: &LightSample<R>) -> Terms<R> {
        let [diffuse, tint] = match self.ambient {
            Some(ambient) => {
                let [diffuse, f0] = reflectances(self.surface.diffuse, self.surface.tint.x);
                [diffuse.times(ambient), f0]
            }
            None => [self.surface.diffuse, self.surface.tint],
        };
        Terms {
            diffuse,
            tint,
            specular_light: light.specular,
            residual: self.harmonics.sum,
            ambient_light: light.ambient,
            split_sum: light.split_sum,
        }
    }
    /// Finiteness of every attribute that was read, except those of the [`Shape`].
    #[inline(always)]
    pub fn is_finite(&self) -> R::Mask {
        let is_finite = self.material.is_finite() & self.harmonics.sum.is_finite();
        match self.ambient {
            Some(ambient) => is_finite & ambient.is_finite(),
            None => is_finite,
        }
    }
}

impl GaussianShading {
    /// Channels of a Gaussian.
    #[inline(always)]
    pub fn channels(&self) -> Channels {
        self.rules.blended(self.layout)
    }
    /// Tests whether shading reads more than the diffuse and residual colour of a Gaussian.
    #[inline(always)]
    pub fn reads_surface(&self) -> bool {
        self.layout.is_shaded() && !self.rules.is_color_alone(self.layout)
    }
    /// Tests whether Gaussians look up a light; they do not if pixels do.
    #[inline(always)]
    pub fn looks_light_up(&self) -> bool {
        self.layout.is_shaded() && !self.rules.is_deferred(self.layout)
    }
    /// First plane of the physical material, if the rules shade it.
    #[inline(always)]
    fn physical_planes(&self) -> Option<usize> {
        if self.rules.shading.form == ShadingForm::Physical { self.layout.physical_planes() } else { None }
    }
    /// Attributes before activation. A physical material has albedo and metalness instead of
    /// diffuse colour and tint. Normal residuals are zero if the rules omit them.
    #[inline(always)]
    pub fn material<R: Real>(&self, planes: &impl AttributePlanes<R>) -> Material<R> {
        let mut normal_residuals = [Vec3::zero(planes.number(OPACITY)); 2];
        if self.rules.normal_residuals {
            normal_residuals = [planes.vec3(NORMAL_RESIDUAL_1), planes.vec3(NORMAL_RESIDUAL_2)];
        }
        let [diffuse, tint] = match self.physical_planes() {
            Some(first) => [planes.vec3(first + ALBEDO), Vec3::splat(planes.number(first + METALNESS))],
            None => [planes.vec3(DIFFUSE), planes.vec3(TINT)],
        };
        Material {
            mean: planes.vec3(MEAN),
            quat: planes.quat(),
            log_scales: planes.vec3(LOG_SCALE),
            diffuse,
            tint,
            roughness: planes.number(ROUGHNESS),
            normal_residuals,
        }
    }
    /// Harmonics in use, along the ray from the eye.
    #[inline(always)]
    pub fn harmonics<R: Real>(&self, planes: &impl AttributePlanes<R>, eye: Vec3<R>) -> Harmonics<R> {
        Harmonics::new(planes, self.layout.sh_start(), self.rules.sh_count(self.layout), eye)
    }
    /// Material, surface and harmonics of a Gaussian with shading attributes.
    #[inline(always)]
    pub fn shaded<R: Real>(&self, planes: &impl AttributePlanes<R>, eye: Vec3<R>) -> ShadedGaussian<R> {
        let material = self.material(planes);
        let surface = surface(&material, eye, self.rules.shading);
        let ambient = self.physical_planes().map(|first| planes.vec3(first + AMBIENT));
        ShadedGaussian { material, surface, harmonics: self.harmonics(planes, eye), ambient }
    }

    /// Channels of a Gaussian without a surface, only harmonics, or diffuse and residual colour,
    /// and whether its attributes are finite.
    #[inline(always)]
    pub fn color_channels<R: Real>(
        &self,
        planes: &impl AttributePlanes<R>,
        camera: &CameraOf<R>,
    ) -> (LayerChannels<R>, R::Mask) {
        let shape = planes.shape(self.layout);
        let mut channels = LayerChannels::with_depth(camera.to_camera(shape.mean).z);
        let sum = self.harmonics(planes, camera.position).sum;
        if self.layout.is_shaded() {
            let raw = planes.vec3(DIFFUSE);
            let terms = Terms::unlit(diffuse(raw, self.rules.shading), sum);
            channels.set3(channel::COLOR, shade(self.rules.shading.form, &terms));
            (channels, raw.is_finite() & sum.is_finite())
        } else {
            channels.set3(channel::COLOR, sh::radiance(sum));
            channels.set3(channel::NORMAL, shortest_axis_normal(&shape, camera.position));
            (channels, sum.is_finite())
        }
    }
    /// Channels of a shaded Gaussian under its light.
    #[inline(always)]
    pub fn surface_channels<R: Real>(
        &self,
        shaded: &ShadedGaussian<R>,
        terms: &Terms<R>,
        camera: &CameraOf<R>,
    ) -> LayerChannels<R> {
        let form = self.rules.shading.form;
        let mut channels = LayerChannels::with_depth(camera.to_camera(shaded.material.mean).z);
        channels.set3(channel::COLOR, shade(form, terms));
        channels.set3(channel::NORMAL, shaded.surface.facing.normal);
        channels.0[channel::RESIDUAL_SIZE] = shaded.surface.facing.residual_squared;
        channels.set3(channel::TINT, terms.tint);
        channels.0[channel::ROUGHNESS] = shaded.surface.roughness;
        if self.channels() == Channels::Layers {
            channels.set3(channel::DIFFUSE, shaded.surface.diffuse);
            channels.set3(channel::SPECULAR, specular(form, terms));
            channels.set3(channel::RESIDUAL, terms.residual);
            if let Some(ambient) = shaded.ambient {
                channels.set3(channel::RESIDUAL, Vec3::zero(terms.tint.x));
                channels.0[channel::METALNESS] = shaded.surface.tint.x;
                channels.0[channel::AMBIENT] = ambient.sum() * (1.0 / 3.0);
            }
            channels.set3(channel::LIGHT, terms.specular_light);
        }
        channels
    }

    /// Gradient of the terms of [`GaussianShading::surface_channels`] through the colour; the
    /// gradient of its light is that of the [`LightSample`].
    #[inline(always)]
    pub fn terms_vjp<R: Real>(&self, terms: &Terms<R>, channels: &LayerChannels<R>) -> Terms<R> {
        shade_vjp(self.rules.shading.form, terms, channels.vec3(channel::COLOR))
    }
    /// Gradient of [`GaussianShading::color_channels`] without shading attributes: writes that of
    /// the coefficients. Normals of such Gaussians have none.
    #[inline(always)]
    pub fn radiance_vjp<R: Real>(
        &self,
        planes: &impl AttributePlanes<R>,
        eye: Vec3<R>,
        channels: &LayerChannels<R>,
        out: &mut impl AttributeGrads<R>,
    ) -> PoseGrad<R> {
        let harmonics = self.harmonics(planes, eye);
        let grad_sum = sh::radiance_vjp(harmonics.sum, channels.vec3(channel::COLOR));
        let grad_view = harmonics.vjp(planes, self.layout.sh_start(), grad_sum, out);
        let mean = view_dir_vjp(planes.vec3(MEAN), eye, grad_view);
        PoseGrad { mean, ..PoseGrad::zero(grad_view.x) }
    }
    /// Gradient of [`GaussianShading::shaded`] from those of its terms, channels and lookups:
    /// writes those of the shading attributes.
    #[inline(always)]
    pub fn surface_vjp<R: Real>(
        &self,
        planes: &impl AttributePlanes<R>,
        eye: Vec3<R>,
        shaded: &ShadedGaussian<R>,
        terms: &Terms<R>,
        channels: &LayerChannels<R>,
        lookup: &LookupGrad<R>,
        out: &mut impl AttributeGrads<R>,
    ) -> PoseGrad<R> {
        let zero = shaded.surface.roughness.zero();
        let grad_tint = terms.tint + channels.vec3(channel::TINT);
        let [grad_diffuse, grad_tint] = match shaded.ambient {
            Some(ambient) => {
                let grad_reflectances = [terms.diffuse.times(ambient), grad_tint];
                let (albedo, metalness) =
                    reflectances_vjp(shaded.surface.diffuse, shaded.surface.tint.x, grad_reflectances);
                [albedo, vec3(metalness, zero, zero)]
            }
            None => [terms.diffuse, grad_tint],
        };
        let mut grad = SurfaceGrad {
            normal: channels.vec3(channel::NORMAL),
            residual_squared: channels.0[channel::RESIDUAL_SIZE],
            reflection_dir: Vec3::splat(zero),
            view_dir: shaded.harmonics.vjp(planes, self.layout.sh_start(), terms.residual, out),
            n_dot_v: zero,
            diffuse: grad_diffuse,
            tint: grad_tint,
            roughness: channels.0[channel::ROUGHNESS],
        };
        if let Some((reflection_dir, roughness)) = lookup.specular {
            grad.reflection_dir = reflection_dir;
            grad.roughness = grad.roughness + roughness;
        }
        if let Some((normal, [n_dot_v, roughness])) = lookup.ambient {
            grad.normal = grad.normal + normal;
            grad.n_dot_v = n_dot_v;
            grad.roughness = grad.roughness + roughness;
        }
        let grad = surface_vjp(&shaded.material, eye, self.rules.shading, &shaded.surface, &grad);
        match self.physical_planes() {
            Some(first) => {
                out.set3(first + ALBEDO, grad.diffuse);
                out.set(first + METALNESS, grad.tint.x);
            }
            None => {
                out.set3(DIFFUSE, grad.diffuse);
                out.set3(TINT, grad.tint);
            }
        }
        out.set(ROUGHNESS, grad.roughness);
        out.set3(NORMAL_RESIDUAL_1, grad.normal_residuals[0]);
        out.set3(NORMAL_RESIDUAL_2, grad.normal_residuals[1]);
        PoseGrad { mean: grad.mean, quat: grad.quat }
    }
}

/// Losses on the attributes of a Gaussian, not on images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AttributeLosses {
    /// Whether the sparsity of the opacity ([`sparse`]) has a weight.
    pub is_sparse: bool,
    /// Whether there are normal residuals, and their squares have a weight.
    pub has_residual: bool,
    /// Plane of the metalness, if there is one and its distance from the share of metal that the
    /// view-dependent colours suggest ([`metal_share`]) has a weight.
    pub metalness_plane: Option<usize>,
}

impl AttributeLosses {
    /// Losses that have a weight.
    pub fn new(weights: &LossWeights, layout: Layout) -> Self {
        let metalness_plane = layout.physical_planes().map(|first| first + METALNESS);
        Self {
            is_sparse: weights.sparse != 0.0,
            has_residual: weights.residual != 0.0 && layout.is_shaded(),
            metalness_plane: metalness_plane.filter(|_| weights.metalness != 0.0),
        }
    }
    /// Whether any loss has a weight.
    pub const fn is_any(self) -> bool {
        self.is_sparse || self.has_residual || self.metalness_plane.is_some()
    }
    /// Factors of [`Self::loss`] for one Gaussian of `count`, as losses are means over the
    /// Gaussians: of sparsity, half of the squared residuals, and metalness. The last number is the
    /// mean radiance of the light.
    pub fn factors(weights: &LossWeights, count: usize) -> [f32; 4] {
        let share = 1.0 / count as f32;
        [weights.sparse * share, 2.0 * weights.residual * share, weights.metalness * share, weights.mean_light]
    }
    /// Planes of both normal residuals, if they have a loss.
    pub const fn residual_planes(self) -> core::ops::Range<usize> {
        if self.has_residual { NORMAL_RESIDUAL_1..NORMAL_RESIDUAL_2 + 3 } else { 0..0 }
    }
    /// Share of metal that the view-dependent colours suggest.
    #[inline(always)]
    fn suggested<R: Real>(planes: &impl AttributePlanes<R>, factors: [R; 4]) -> R {
        metal_share(each!(planes.vec3(TINT), x => sigmoid(x)), each!(planes.vec3(DIFFUSE), x => sigmoid(x)), factors[3])
    }
    /// Loss of one Gaussian: [`sparse`] of its opacity, half of the squares of its normal
    /// residuals, and [`metalness`], each times its factor.
    #[inline(always)]
    pub fn loss<R: Real>(self, planes: &impl AttributePlanes<R>, factors: [R; 4]) -> R {
        let mut total = factors[0].zero();
        if self.is_sparse {
            total = total + sparse(planes.number(OPACITY)) * factors[0];
        }
        for plane in self.residual_planes() {
            let number = planes.number(plane);
            total = total + number * number * 0.5 * factors[1];
        }
        if let Some(plane) = self.metalness_plane {
            total = total + metalness(planes.number(plane), Self::suggested(planes, factors)) * factors[2];
        }
        total
    }
    /// Gradients of [`Self::loss`] ([`sparse_vjp`], [`residual_vjp`], [`metalness_vjp`]), plane by
    /// plane; the suggested share of metal is held fixed.
    #[inline(always)]
    pub fn loss_vjp<R: Real>(
        self,
        planes: &impl AttributePlanes<R>,
        factors: [R; 4],
        out: &mut impl AttributeGrads<R>,
    ) {
        if self.is_sparse {
            out.set(OPACITY, sparse_vjp(planes.number(OPACITY), factors[0]));
        }
        for plane in self.residual_planes() {
            out.set(plane, residual_vjp(planes.number(plane), factors[1]));
        }
        if let Some(plane) = self.metalness_plane {
            let suggested = Self::suggested(planes, factors);
            out.set(plane, metalness_vjp(planes.number(plane), suggested, factors[2]));
        }
    }
}
