//! The formulas that kernels use, each with its parameters and results in WGSL.

pub mod blend;
pub mod blend_vjp;
pub mod densify;
pub mod expose;
pub mod gaussians_vjp;
pub mod light;
pub mod loss;
pub mod optimise;

use crate::formula::{Field, Formula, Inputs, call, field, variable};
use specula_core::{
    bin::{footprint, half_extent},
    camera::CameraOf,
    covariance::rotation,
    cubemap::{FacePoint, footprint as texel_footprint, project as project_to_cube},
    normal::{AxisRule, axis, facing},
    pixel::{Pixel, PixelSurface, pixel_color, pixel_surface},
    prefilter::{Level, level_of_roughness},
    project::{Shape, project},
    real::{Real, exp2_fraction, log2_mantissa},
    rules::{Channels, RenderRules, channel},
    scene::{DIFFUSE, LOG_SCALE, Layout, MEAN, NORMAL_RESIDUAL_1, NORMAL_RESIDUAL_2, OPACITY, QUAT, ROUGHNESS, TINT},
    sh,
    shade::{Material, ShadingForm, Surface, Terms, diffuse, shade, surface, view_dir},
    splat::Splat2d,
    vector::{Mat3, Vec3},
};

/// The variable `camera` of a shader, in the order of [`take_camera`].
fn camera_fields() -> [Field; 8] {
    [
        variable("camera.row_x", 3),
        variable("camera.row_y", 3),
        variable("camera.row_z", 3),
        variable("camera.position", 3),
        variable("camera.focal_px", 2),
        variable("camera.principal_px", 2),
        variable("camera.slope_limit", 2),
        variable("camera.near", 1),
    ]
}

fn take_camera<R: Real>(inputs: &mut Inputs<'_, R>) -> CameraOf<R> {
    CameraOf {
        camera_from_world: Mat3 { rows: [inputs.vec3(), inputs.vec3(), inputs.vec3()] },
        position: inputs.vec3(),
        focal_px: inputs.array(),
        principal_px: inputs.array(),
        slope_limit: inputs.array(),
        near: inputs.number(),
    }
}

/// The planes of one Gaussian, which the shader's function `plane` reads.
struct Planes<'a, R>(&'a [R]);

impl<R: Real> Planes<'_, R> {
    fn at(&self, plane: usize) -> R {
        self.0[plane]
    }
    fn vec3(&self, first: usize) -> Vec3<R> {
        Vec3 { x: self.at(first), y: self.at(first + 1), z: self.at(first + 2) }
    }
    fn quat(&self) -> [R; 4] {
        [self.at(QUAT), self.at(QUAT + 1), self.at(QUAT + 2), self.at(QUAT + 3)]
    }
    fn shape(&self) -> Shape<R> {
        Shape {
            mean: self.vec3(MEAN),
            log_scales: self.vec3(LOG_SCALE),
            quat: self.quat(),
            opacity_logit: self.at(OPACITY),
        }
    }
}

fn planes_field(layout: Layout) -> Field {
    call("plane", layout.plane_count())
}

/// The numbers of a vector, in a row.
fn flat<R: Real>(vector: Vec3<R>) -> [R; 3] {
    vector.to_array()
}

/// A Gaussian to its splat ([`mod@specula_core::project`], [`specula_core::bin`]), stored as compositing reads it.
#[derive(Clone, Copy, Debug)]
pub struct SplatOf {
    /// What planes there are.
    pub layout: Layout,
}

impl Formula for SplatOf {
    fn name(&self) -> String {
        "splat_of".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        let mut fields = vec![planes_field(self.layout)];
        fields.extend(camera_fields());
        fields
    }
    fn results(&self) -> Vec<Field> {
        vec![
            field("mean2d", 2),
            field("log2_opacity", 1),
            field("opacity", 1),
            field("root", 3),
            field("reach", 1),
            field("half_extent", 2),
            field("depth", 1),
            field("root_conic", 3),
        ]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let planes = Planes(inputs.slice(self.layout.plane_count()));
        let splat = project(&planes.shape(), &take_camera(inputs));
        let reach = footprint(&splat).reach;
        let Splat2d { mean2d, root, log2_opacity } = Splat2d::new(splat.mean2d, splat.root_conic, splat.opacity.log2());
        let mut numbers = mean2d.to_vec();
        numbers.extend([log2_opacity, splat.opacity]);
        numbers.extend(root);
        numbers.push(reach);
        numbers.extend(half_extent(&splat, reach));
        numbers.push(splat.depth);
        numbers.extend(splat.root_conic);
        numbers
    }
}

/// How the Gaussians of a layout are shaded.
#[derive(Clone, Copy, Debug)]
pub struct ShadingOf {
    /// What planes there are.
    pub layout: Layout,
    /// How they are shaded.
    pub rules: RenderRules,
}

impl ShadingOf {
    fn sh_count(&self) -> usize {
        match (self.rules.sh_degree, self.layout.sh_degree) {
            (Some(wanted), Some(present)) => (usize::from(wanted.min(present)) + 1).pow(2),
            _ => 0,
        }
    }
    /// The channels that a Gaussian has.
    pub fn blended(&self) -> Channels {
        self.rules.blended(self.layout)
    }
    /// Whether each Gaussian looks light up, if there is any.
    pub fn looks_light_up(&self) -> bool {
        self.layout.is_shaded() && !self.rules.is_deferred(self.layout)
    }
    fn harmonics<R: Real>(&self, planes: &Planes<'_, R>, camera: &CameraOf<R>) -> Vec3<R> {
        let ray_dir = -view_dir(planes.vec3(MEAN), camera.position);
        let basis = sh::basis(ray_dir, self.sh_count());
        (0..self.sh_count())
            .fold(Vec3::zero(ray_dir.x), |sum, k| sum.add_scaled(basis[k], planes.vec3(self.layout.sh_start() + 3 * k)))
    }
    fn material<R: Real>(&self, planes: &Planes<'_, R>) -> Material<R> {
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
    /// The channels that are blended, and 1 where the numbers that they are made of are finite, else 0.
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
    fn surface<R: Real>(&self, planes: &Planes<'_, R>, camera: &CameraOf<R>) -> Surface<R> {
        surface(&self.material(planes), camera.position, self.rules.shading)
    }
    /// What a shaded Gaussian shows under its light, if there is any.
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

/// Light that a Gaussian has looked up.
struct LightOf<R> {
    specular: Vec3<R>,
    ambient: Vec3<R>,
    split_sum: [R; 2],
}

/// What of a colour is specular.
fn specular<R: Real>(form: ShadingForm, terms: &Terms<R>) -> Vec3<R> {
    let none = Vec3::zero(terms.diffuse.x);
    match form {
        ShadingForm::Paper | ShadingForm::Deferred => terms.tint.times(terms.specular_light),
        ShadingForm::Official => shade(form, &Terms { diffuse: none, residual: none, ..*terms }),
    }
}

/// The channels of all layers.
struct AllChannels<R>([R; Channels::Layers.count()]);

impl<R: Real> AllChannels<R> {
    fn new(planes: &Planes<'_, R>, camera: &CameraOf<R>) -> Self {
        let depth = camera.to_camera(planes.vec3(MEAN)).z;
        let mut channels = Self([depth.zero(); Channels::Layers.count()]);
        channels.0[channel::DEPTH] = depth;
        channels
    }
    fn put(&mut self, first: usize, vector: Vec3<R>) {
        self.0[first..first + 3].copy_from_slice(&flat(vector));
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

/// The channels of a Gaussian that looks no light up ([`mod@specula_core::shade`]): plain, unlit, or lit pixel by pixel.
#[derive(Clone, Copy, Debug)]
pub struct ColorsOf(pub ShadingOf);

impl Formula for ColorsOf {
    fn name(&self) -> String {
        "colors_of".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        let mut fields = vec![planes_field(self.0.layout)];
        fields.extend(camera_fields());
        fields
    }
    fn results(&self) -> Vec<Field> {
        vec![field("channels", self.0.blended().count()), field("is_finite", 1)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let planes = Planes(inputs.slice(self.0.layout.plane_count()));
        let camera = take_camera(inputs);
        let channels = if self.0.layout.is_shaded() {
            self.0.shaded(&planes, &camera, None)
        } else {
            self.0.plain(&planes, &camera)
        };
        self.0.with_mask(channels, &planes, &camera)
    }
}

/// The mean surface of a pixel ([`specula_core::pixel::pixel_surface`]), from what was blended into it.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceOfPixel {
    /// What was blended.
    pub blended: Channels,
}

impl SurfaceOfPixel {
    fn pixel<R: Real>(&self, numbers: &[R]) -> Pixel<R> {
        let passed = numbers[self.blended.count()];
        let at = |channel: usize| self.blended.index_of(channel).map_or(passed.zero(), |index| numbers[index]);
        let vec3 = |first: usize| Vec3 { x: at(first), y: at(first + 1), z: at(first + 2) };
        Pixel {
            base: vec3(channel::COLOR),
            normal: vec3(channel::NORMAL),
            tint: vec3(channel::TINT),
            roughness: at(channel::ROUGHNESS),
            coverage: -passed + 1.0,
        }
    }
}

impl Formula for SurfaceOfPixel {
    fn name(&self) -> String {
        "surface_of_pixel".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        let mut fields = vec![call("blended", self.blended.count() + 1), field("point", 2)];
        fields.extend(camera_fields());
        fields
    }
    fn results(&self) -> Vec<Field> {
        vec![
            field("base", 3),
            field("tint", 3),
            field("roughness", 1),
            field("reflection_dir", 3),
            field("coverage", 1),
        ]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let pixel = self.pixel(inputs.slice(self.blended.count() + 1));
        let [x, y] = inputs.array();
        let view_dir = take_camera(inputs).view_dir(x, y);
        let surface = pixel_surface(&pixel, view_dir);
        let mut numbers = Vec::new();
        numbers.extend(flat(surface.base));
        numbers.extend(flat(surface.tint));
        numbers.push(surface.roughness);
        numbers.extend(flat(surface.reflection_dir));
        numbers.push(pixel.coverage);
        numbers
    }
}

/// The colour of a pixel under its light ([`specula_core::pixel::pixel_color`]).
#[derive(Clone, Copy, Debug)]
pub struct ColorOfPixel;

impl Formula for ColorOfPixel {
    fn name(&self) -> String {
        "color_of_pixel".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        vec![field("base", 3), field("tint", 3), field("light", 3), field("coverage", 1)]
    }
    fn results(&self) -> Vec<Field> {
        vec![field("color", 3)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let (base, tint, light, coverage) = (inputs.vec3(), inputs.vec3(), inputs.vec3(), inputs.number());
        let surface = PixelSurface { base, tint, roughness: coverage.zero(), reflection_dir: Vec3::zero(coverage) };
        flat(pixel_color(&surface, light, coverage)).to_vec()
    }
}

/// Where a direction meets a map of some resolution ([`mod@specula_core::cubemap`]).
#[derive(Clone, Copy, Debug)]
pub struct TexelsAt;

impl Formula for TexelsAt {
    fn name(&self) -> String {
        "texels_at".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        vec![field("direction", 3), field("resolution", 1)]
    }
    fn results(&self) -> Vec<Field> {
        vec![field("texel", 1), field("right", 1), field("lower", 1)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let (direction, resolution) = (inputs.vec3(), inputs.number());
        let point: FacePoint<R> = project_to_cube(direction);
        let footprint = texel_footprint(&point, resolution);
        vec![footprint.texel, footprint.right, footprint.lower]
    }
}

/// Position of a roughness between the levels of a light ([`specula_core::prefilter::level_of_roughness`]).
#[derive(Clone, Debug, PartialEq)]
pub struct LevelOf {
    /// The levels.
    pub levels: Vec<Level>,
}

impl Formula for LevelOf {
    fn name(&self) -> String {
        "level_of".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        vec![field("roughness", 1)]
    }
    fn results(&self) -> Vec<Field> {
        vec![field("position", 1)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        vec![level_of_roughness(inputs.number(), &self.levels)]
    }
}

/// The polynomial of 2^x ([`specula_core::real::exp2_fraction`]).
#[derive(Clone, Copy, Debug)]
pub struct Exp2Fraction;

impl Formula for Exp2Fraction {
    fn name(&self) -> String {
        "exp2_fraction".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        vec![field("x", 1)]
    }
    fn results(&self) -> Vec<Field> {
        vec![field("power", 1)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        vec![exp2_fraction(inputs.number())]
    }
}

/// The polynomial of log₂ ([`specula_core::real::log2_mantissa`]).
#[derive(Clone, Copy, Debug)]
pub struct Log2Mantissa;

impl Formula for Log2Mantissa {
    fn name(&self) -> String {
        "log2_mantissa".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        vec![field("mantissa", 1)]
    }
    fn results(&self) -> Vec<Field> {
        vec![field("logarithm", 1)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        vec![log2_mantissa(inputs.number())]
    }
}

/// Where a Gaussian looks light up ([`specula_core::shade::surface`]).
#[derive(Clone, Copy, Debug)]
pub struct SurfaceOf(pub ShadingOf);

impl Formula for SurfaceOf {
    fn name(&self) -> String {
        "surface_of".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        ColorsOf(self.0).parameters()
    }
    fn results(&self) -> Vec<Field> {
        vec![field("reflection_dir", 3), field("normal", 3), field("roughness", 1), field("n_dot_v", 1)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let planes = Planes(inputs.slice(self.0.layout.plane_count()));
        let surface = self.0.surface(&planes, &take_camera(inputs));
        let mut numbers = Vec::new();
        numbers.extend(flat(surface.reflection_dir));
        numbers.extend(flat(surface.facing.normal));
        numbers.extend([surface.roughness, surface.n_dot_v]);
        numbers
    }
}

/// The channels of a Gaussian under the light that it has looked up ([`mod@specula_core::shade`]).
#[derive(Clone, Copy, Debug)]
pub struct LitColorsOf(pub ShadingOf);

impl Formula for LitColorsOf {
    fn name(&self) -> String {
        "lit_colors_of".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        let mut fields = ColorsOf(self.0).parameters();
        fields.extend([field("specular_light", 3), field("ambient_light", 3), field("split_sum", 2)]);
        fields
    }
    fn results(&self) -> Vec<Field> {
        ColorsOf(self.0).results()
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let planes = Planes(inputs.slice(self.0.layout.plane_count()));
        let camera = take_camera(inputs);
        let light = LightOf { specular: inputs.vec3(), ambient: inputs.vec3(), split_sum: inputs.array() };
        let channels = self.0.shaded(&planes, &camera, Some(&light));
        self.0.with_mask(channels, &planes, &camera)
    }
}
