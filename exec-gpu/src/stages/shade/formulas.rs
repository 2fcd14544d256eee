//! Channels of a Gaussian.

use crate::{
    codegen::formula::{Field, Inputs, fields, formula},
    stages::{
        camera::{camera_fields, take_camera},
        gaussians::{Planes, planes_field},
    },
};
use specula_core::{
    camera::CameraOf,
    covariance::rotation,
    normal::{AxisRule, axis, facing},
    real::Real,
    rules::{Channels, RenderRules, channel},
    scene::{DIFFUSE, LOG_SCALE, Layout, MEAN, NORMAL_RESIDUAL_1, NORMAL_RESIDUAL_2, OPACITY, ROUGHNESS, TINT},
    sh,
    shade::{Material, ShadingForm, Surface, Terms, diffuse, shade, surface, view_dir},
    vector::Vec3,
};

/// Shading of the Gaussians of a layout.
#[derive(Clone, Copy, Debug)]
pub struct ShadingOf {
    /// Planes of the Gaussians.
    pub layout: Layout,
    /// Rendering rules.
    pub rules: RenderRules,
}

impl ShadingOf {
    pub(crate) fn sh_count(&self) -> usize {
        match (self.rules.sh_degree, self.layout.sh_degree) {
            (Some(wanted), Some(present)) => (usize::from(wanted.min(present)) + 1).pow(2),
            _ => 0,
        }
    }
    /// Channels of a Gaussian.
    pub fn blended(&self) -> Channels {
        self.rules.blended(self.layout)
    }
    /// Whether each Gaussian looks up the light, if there is one.
    pub fn looks_light_up(&self) -> bool {
        self.layout.is_shaded() && !self.rules.is_deferred(self.layout)
    }
    pub(crate) fn harmonics<R: Real>(&self, planes: &Planes<'_, R>, camera: &CameraOf<R>) -> Vec3<R> {
        let ray_dir = -view_dir(planes.vec3(MEAN), camera.position);
        let basis = sh::basis(ray_dir, self.sh_count());
        (0..self.sh_count())
            .fold(Vec3::zero(ray_dir.x), |sum, k| sum.add_scaled(basis[k], planes.vec3(self.layout.sh_start() + 3 * k)))
    }
    pub(crate) fn material<R: Real>(&self, planes: &Planes<'_, R>) -> Material<R> {
        let residual = |plane: usize| match self.rules.normal_residuals {
            true => planes.vec3(plane),
            false => Vec3::zero(planes.at(OPACITY)),
        };
        Material {
            mean: planes.vec3(MEAN),
            quat: planes.quat(),
            log_scales: planes.vec3(LOG_SCALE),
            diffuse: planes.vec3(DIFFUSE),
            tint: planes.vec3(TINT),
            roughness: planes.at(ROUGHNESS),
            normal_residuals: [residual(NORMAL_RESIDUAL_1), residual(NORMAL_RESIDUAL_2)],
        }
    }
    fn plain<R: Real>(&self, planes: &Planes<'_, R>, camera: &CameraOf<R>) -> AllChannels<R> {
        let mut channels = AllChannels::new(planes, camera);
        channels.put(channel::COLOR, sh::radiance(self.harmonics(planes, camera)));
        let axis = axis(AxisRule::Shortest, &rotation(planes.quat()), planes.vec3(LOG_SCALE));
        let none = Vec3::zero(axis.x);
        let seen = facing(axis, view_dir(planes.vec3(MEAN), camera.position), [none; 2], true);
        channels.put(channel::NORMAL, seen.normal);
        channels
    }
    /// The blended channels, then 1 if all attributes that they depend on are finite, else 0.
    fn with_mask<R: Real>(&self, channels: AllChannels<R>, planes: &Planes<'_, R>, camera: &CameraOf<R>) -> Vec<R> {
        let of_harmonics = self.harmonics(planes, camera).is_finite();
        let is_finite = if !self.layout.is_shaded() {
            of_harmonics
        } else if self.rules.is_color_alone(self.layout) {
            of_harmonics & planes.vec3(DIFFUSE).is_finite()
        } else {
            of_harmonics & self.material(planes).is_finite()
        };
        let one = planes.at(OPACITY).constant(1.0);
        let mut numbers = channels.chosen(self.blended());
        numbers.push(one.keep(is_finite));
        numbers
    }
    pub(crate) fn surface<R: Real>(&self, planes: &Planes<'_, R>, camera: &CameraOf<R>) -> Surface<R> {
        surface(&self.material(planes), camera.position, self.rules.shading)
    }
    /// Channels of a shaded Gaussian under its light, if there is one.
    fn shaded<R: Real>(
        &self,
        planes: &Planes<'_, R>,
        camera: &CameraOf<R>,
        light: Option<&LightOf<R>>,
    ) -> AllChannels<R> {
        let mut channels = AllChannels::new(planes, camera);
        let form = self.rules.shading.form;
        let residual = self.harmonics(planes, camera);
        let surface = self.surface(planes, camera);
        let unlit = Terms::unlit(diffuse(planes.vec3(DIFFUSE), self.rules.shading), residual);
        let terms = match light {
            Some(light) => Terms {
                tint: surface.tint,
                specular_light: light.specular,
                ambient_light: light.ambient,
                split_sum: light.split_sum,
                ..unlit
            },
            None => Terms { tint: surface.tint, ..unlit },
        };
        channels.put(channel::COLOR, shade(form, &terms));
        channels.put_surface(&surface);
        channels.put(channel::DIFFUSE, terms.diffuse);
        channels.put(channel::SPECULAR, specular(form, &terms));
        channels.put(channel::RESIDUAL, terms.residual);
        channels.put(channel::LIGHT, terms.specular_light);
        channels
    }
}

/// Light that a Gaussian looked up.
#[derive(Debug)]
pub(crate) struct LightOf<R> {
    pub(crate) specular: Vec3<R>,
    pub(crate) ambient: Vec3<R>,
    pub(crate) split_sum: [R; 2],
}

/// Light that a Gaussian looked up, as parameters.
pub(crate) fn light_fields() -> Vec<Field> {
    fields!(specular_light: 3, ambient_light: 3, split_sum: 2)
}

/// Reads the light that a Gaussian looked up from a formula's inputs.
pub(crate) fn take_light<R: Real>(inputs: &mut Inputs<'_, R>) -> LightOf<R> {
    LightOf { specular: inputs.vec3(), ambient: inputs.vec3(), split_sum: inputs.array() }
}

/// Specular part of a colour.
fn specular<R: Real>(form: ShadingForm, terms: &Terms<R>) -> Vec3<R> {
    let none = Vec3::zero(terms.diffuse.x);
    match form {
        ShadingForm::Paper | ShadingForm::Deferred => terms.tint.times(terms.specular_light),
        ShadingForm::Official => shade(form, &Terms { diffuse: none, residual: none, ..*terms }),
    }
}

/// Channels of all layers.
#[derive(Debug)]
pub(crate) struct AllChannels<R>(pub(crate) [R; Channels::Layers.count()]);

impl<R: Real> AllChannels<R> {
    fn new(planes: &Planes<'_, R>, camera: &CameraOf<R>) -> Self {
        let depth = camera.to_camera(planes.vec3(MEAN)).z;
        let mut channels = Self([depth.zero(); Channels::Layers.count()]);
        channels.0[channel::DEPTH] = depth;
        channels
    }
    fn put(&mut self, first: usize, vector: Vec3<R>) {
        self.0[first..first + 3].copy_from_slice(&vector.to_array());
    }
    fn put_surface(&mut self, surface: &Surface<R>) {
        self.put(channel::NORMAL, surface.facing.normal);
        self.0[channel::RESIDUAL_SIZE] = surface.facing.residual_squared;
        self.put(channel::TINT, surface.tint);
        self.0[channel::ROUGHNESS] = surface.roughness;
    }
    fn chosen(&self, blended: Channels) -> Vec<R> {
        let places = (0..self.0.len()).filter(|channel| blended.index_of(*channel).is_some());
        places.map(|channel| self.0[channel]).collect()
    }
}

/// Channels of a Gaussian that looks up no light ([`mod@specula_core::shade`]): plain, unlit, or with deferred shading.
#[derive(Clone, Copy, Debug)]
pub struct ColorsOf(pub ShadingOf);

formula!(ColorsOf, |this, inputs| colors_of(..planes_field(this.0.layout), ..camera_fields()) -> (
    channels: this.0.blended().count(), is_finite: 1
) {
    let planes = Planes(inputs.slice(this.0.layout.plane_count()));
    let camera = take_camera(inputs);
    let channels = if this.0.layout.is_shaded() {
        this.0.shaded(&planes, &camera, None)
    } else {
        this.0.plain(&planes, &camera)
    };
    this.0.with_mask(channels, &planes, &camera)
});

/// Directions and roughness with which a Gaussian looks up the light ([`specula_core::shade::surface`]).
#[derive(Clone, Copy, Debug)]
pub struct SurfaceOf(pub ShadingOf);

formula!(SurfaceOf, |this, inputs| surface_of(..ColorsOf(this.0).parameters()) -> (
    reflection_dir: 3, normal: 3, roughness: 1, n_dot_v: 1
) {
    let planes = Planes(inputs.slice(this.0.layout.plane_count()));
    let surface = this.0.surface(&planes, &take_camera(inputs));
    (surface.reflection_dir, surface.facing.normal, [surface.roughness, surface.n_dot_v])
});

/// Channels of a Gaussian under the light that it looked up ([`mod@specula_core::shade`]).
#[derive(Clone, Copy, Debug)]
pub struct LitColorsOf(pub ShadingOf);

formula!(LitColorsOf, |this, inputs| lit_colors_of(..ColorsOf(this.0).parameters(), ..light_fields()) -> (
    ..ColorsOf(this.0).results()
) {
    let planes = Planes(inputs.slice(this.0.layout.plane_count()));
    let camera = take_camera(inputs);
    let light = take_light(inputs);
    let channels = this.0.shaded(&planes, &camera, Some(&light));
    this.0.with_mask(channels, &planes, &camera)
});
