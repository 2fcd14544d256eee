//! The way back through shading and projection.

use super::{AllChannels, ColorsOf, LightOf, Planes, ShadingOf, flat, planes_field, take_camera};
use crate::{
    blend_vjp::GEOMETRY,
    formula::{Field, Formula, Inputs, call, field, variable},
};
use specula_core::{
    camera::CameraOf,
    cubemap::bilinear_vjp,
    loss::{residual_vjp, sparse_vjp},
    project::project_vjp,
    real::Real,
    rules::{Channels, channel},
    scene::{DIFFUSE, LOG_SCALE, Layout, MEAN, NORMAL_RESIDUAL_1, NORMAL_RESIDUAL_2, OPACITY, QUAT, ROUGHNESS, TINT},
    sh,
    shade::{SurfaceGrad, Terms, diffuse, shade_vjp, surface_vjp, view_dir, view_dir_vjp},
    splat::SplatGrad,
    vector::{Vec3, vec3},
};

/// The gradients of a Gaussian's splat and channels, which the shader's function `splat_grad` reads.
fn splat_grad_field(blended: Channels) -> Field {
    call("splat_grad", GEOMETRY + blended.count())
}

/// Gradients of the splat, then those of all channels; zero for what is not blended.
fn take_splat_grad<R: Real>(inputs: &mut Inputs<'_, R>, blended: Channels) -> (SplatGrad<R>, AllChannels<R>) {
    let (mean2d, root_conic, opacity) = (inputs.array(), inputs.array(), inputs.number());
    let numbers = inputs.slice(blended.count());
    let at = |channel: usize| blended.index_of(channel).map_or(opacity.zero(), |index| numbers[index]);
    let channels = AllChannels(core::array::from_fn(at));
    (SplatGrad { mean2d, root_conic, depth: channels.0[channel::DEPTH], opacity }, channels)
}

impl<R: Real> AllChannels<R> {
    fn take3(&self, first: usize) -> Vec3<R> {
        vec3(self.0[first], self.0[first + 1], self.0[first + 2])
    }
}

/// Light that a Gaussian has looked up, as parameters.
fn light_fields() -> [Field; 3] {
    [field("specular_light", 3), field("ambient_light", 3), field("split_sum", 2)]
}

fn take_light<R: Real>(inputs: &mut Inputs<'_, R>) -> LightOf<R> {
    LightOf { specular: inputs.vec3(), ambient: inputs.vec3(), split_sum: inputs.array() }
}

/// The gradients that come back through the light that a Gaussian has looked up.
struct LookupGrad<R> {
    reflection_dir: Vec3<R>,
    /// Through the levels of the light.
    roughness: R,
    /// Through the irradiance.
    normal: Vec3<R>,
    /// Of n·v and of the roughness, through the table.
    split_sum: [R; 2],
}

impl ShadingOf {
    /// What the colour of a shaded Gaussian adds up.
    fn terms<R: Real>(&self, planes: &Planes<'_, R>, camera: &CameraOf<R>, light: Option<&LightOf<R>>) -> Terms<R> {
        let color = diffuse(planes.vec3(DIFFUSE), self.rules.shading);
        let terms =
            Terms { tint: self.surface(planes, camera).tint, ..Terms::unlit(color, self.harmonics(planes, camera)) };
        match light {
            Some(LightOf { specular, ambient, split_sum }) => {
                Terms { specular_light: *specular, ambient_light: *ambient, split_sum: *split_sum, ..terms }
            }
            None => terms,
        }
    }

    /// Writes the gradients of the harmonics; returns that of the direction to the eye.
    fn harmonics_vjp<R: Real>(
        &self,
        planes: &Planes<'_, R>,
        camera: &CameraOf<R>,
        grad: Vec3<R>,
        out: &mut PlaneGrads<R>,
    ) -> Vec3<R> {
        let ray_dir = -view_dir(planes.vec3(MEAN), camera.position);
        let basis = sh::basis(ray_dir, self.sh_count());
        let mut grad_basis = [ray_dir.x.zero(); sh::MAX_COUNT];
        for k in 0..self.sh_count() {
            let plane = self.layout.sh_start() + 3 * k;
            out.put(plane, grad * basis[k]);
            grad_basis[k] = grad.dot(planes.vec3(plane));
        }
        -sh::basis_vjp(ray_dir, self.sh_count(), &grad_basis)
    }

    /// Writes the gradients of a plain Gaussian's colour.
    fn plain_vjp<R: Real>(
        &self,
        planes: &Planes<'_, R>,
        camera: &CameraOf<R>,
        grads: &AllChannels<R>,
        out: &mut PlaneGrads<R>,
    ) {
        let grad_sum = sh::radiance_vjp(self.harmonics(planes, camera), grads.take3(channel::COLOR));
        let grad_view = self.harmonics_vjp(planes, camera, grad_sum, out);
        out.put(MEAN, view_dir_vjp(planes.vec3(MEAN), camera.position, grad_view));
    }

    /// Writes the gradients of a shaded Gaussian's attributes.
    fn shaded_vjp<R: Real>(
        &self,
        planes: &Planes<'_, R>,
        camera: &CameraOf<R>,
        grads: &AllChannels<R>,
        light: Option<&(LightOf<R>, LookupGrad<R>)>,
        out: &mut PlaneGrads<R>,
    ) {
        let rules = self.rules.shading;
        let surface = self.surface(planes, camera);
        let terms = self.terms(planes, camera, light.map(|(light, _)| light));
        let grad = shade_vjp(rules.form, &terms, grads.take3(channel::COLOR));
        let zero = surface.roughness.zero();
        let mut grad_surface = SurfaceGrad {
            normal: grads.take3(channel::NORMAL),
            residual_squared: grads.0[channel::RESIDUAL_SIZE],
            reflection_dir: Vec3::splat(zero),
            view_dir: self.harmonics_vjp(planes, camera, grad.residual, out),
            n_dot_v: zero,
            diffuse: grad.diffuse,
            tint: grad.tint + grads.take3(channel::TINT),
            roughness: grads.0[channel::ROUGHNESS],
        };
        if let Some((_, lookup)) = light {
            let [n_dot_v, roughness] = lookup.split_sum;
            grad_surface = SurfaceGrad {
                reflection_dir: lookup.reflection_dir,
                roughness: grad_surface.roughness + lookup.roughness + roughness,
                normal: grad_surface.normal + lookup.normal,
                n_dot_v,
                ..grad_surface
            };
        }
        let grad = surface_vjp(&self.material(planes), camera.position, rules, &surface, &grad_surface);
        out.put(MEAN, grad.mean);
        out.0[QUAT..OPACITY].copy_from_slice(&grad.quat);
        out.put(DIFFUSE, grad.diffuse);
        out.put(TINT, grad.tint);
        out.0[ROUGHNESS] = grad.roughness;
        out.put(NORMAL_RESIDUAL_1, grad.normal_residuals[0]);
        out.put(NORMAL_RESIDUAL_2, grad.normal_residuals[1]);
    }
}

/// The gradient of every plane of a Gaussian.
struct PlaneGrads<R>(Vec<R>);

impl<R: Real> PlaneGrads<R> {
    fn put(&mut self, first: usize, vector: Vec3<R>) {
        self.0[first..first + 3].copy_from_slice(&flat(vector));
    }

    /// Adds the gradients of the splat's shape.
    fn add_projection(&mut self, planes: &Planes<'_, R>, camera: &CameraOf<R>, grad: &SplatGrad<R>) {
        let grad = project_vjp(&planes.shape(), camera, grad);
        let mut add = |first: usize, numbers: &[R]| {
            self.0[first..].iter_mut().zip(numbers).for_each(|(sum, number)| *sum = *number + *sum);
        };
        add(MEAN, &flat(grad.mean));
        add(LOG_SCALE, &flat(grad.log_scales));
        add(QUAT, &grad.quat);
        add(OPACITY, &[grad.opacity_logit]);
    }
}

/// The gradient of a Gaussian's planes ([`mod@specula_core::shade`], [`mod@specula_core::project`]) from that of its
/// splat and channels; with light, also from what came back through the light.
#[derive(Clone, Copy, Debug)]
pub struct PlanesVjp {
    /// How it is shaded.
    pub shading: ShadingOf,
    /// Whether it has looked light up.
    pub is_lit: bool,
}

impl Formula for PlanesVjp {
    fn name(&self) -> String {
        "planes_vjp".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        let mut fields = ColorsOf(self.shading).parameters();
        fields.push(splat_grad_field(self.shading.blended()));
        if self.is_lit {
            fields.extend(light_fields());
            fields.extend([field("of_specular", 4), field("of_ambient", 3), field("of_split_sum", 2)]);
        }
        fields
    }
    fn results(&self) -> Vec<Field> {
        vec![call("put", self.shading.layout.plane_count())]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let plane_count = self.shading.layout.plane_count();
        let planes = Planes(inputs.slice(plane_count));
        let camera = take_camera(inputs);
        let (splat, channels) = take_splat_grad(inputs, self.shading.blended());
        let light = self.is_lit.then(|| {
            let light = take_light(inputs);
            let (reflection_dir, roughness) = (inputs.vec3(), inputs.number());
            (light, LookupGrad { reflection_dir, roughness, normal: inputs.vec3(), split_sum: inputs.array() })
        });
        let mut out = PlaneGrads(vec![splat.opacity.zero(); plane_count]);
        if self.shading.layout.is_shaded() {
            self.shading.shaded_vjp(&planes, &camera, &channels, light.as_ref(), &mut out);
        } else {
            self.shading.plain_vjp(&planes, &camera, &channels, &mut out);
        }
        out.add_projection(&planes, &camera, &splat);
        out.0
    }
}

/// The gradient of the light that a Gaussian has looked up ([`specula_core::shade::shade_vjp`]).
#[derive(Clone, Copy, Debug)]
pub struct LookupVjp(pub ShadingOf);

impl Formula for LookupVjp {
    fn name(&self) -> String {
        "lookup_vjp".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        let mut fields = ColorsOf(self.0).parameters();
        fields.push(splat_grad_field(self.0.blended()));
        fields.extend(light_fields());
        fields
    }
    fn results(&self) -> Vec<Field> {
        vec![field("specular", 3), field("ambient", 3), field("split_sum", 2)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let planes = Planes(inputs.slice(self.0.layout.plane_count()));
        let camera = take_camera(inputs);
        let (_, channels) = take_splat_grad(inputs, self.0.blended());
        let terms = self.0.terms(&planes, &camera, Some(&take_light(inputs)));
        let grad = shade_vjp(self.0.rules.shading.form, &terms, channels.take3(channel::COLOR));
        let mut numbers = flat(grad.specular_light).to_vec();
        numbers.extend(flat(grad.ambient_light));
        numbers.extend(grad.split_sum);
        numbers
    }
}

/// How four neighbouring entries of the split-sum table pull at the place between them
/// ([`specula_core::cubemap::bilinear_vjp`]).
#[derive(Clone, Copy, Debug)]
pub struct SplitSumVjp;

impl Formula for SplitSumVjp {
    fn name(&self) -> String {
        "split_sum_slopes".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        let mut fields = ["upper_left", "upper_right", "lower_left", "lower_right"].map(|name| field(name, 2)).to_vec();
        fields.extend([field("share", 2), field("grad", 2)]);
        fields
    }
    fn results(&self) -> Vec<Field> {
        vec![field("grad_place", 2)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let mut pair = || {
            let [x, y] = inputs.array();
            vec3(x, y, x.zero())
        };
        let texels = [pair(), pair(), pair(), pair()];
        let (share, grad) = (pair(), pair());
        let (right, lower) = bilinear_vjp(texels, share.x, share.y, grad);
        vec![right, lower]
    }
}

/// The gradients of the losses that look at attributes, not at pictures: of the opacity and of both normal residuals.
#[derive(Clone, Copy, Debug)]
pub struct AttributeLosses {
    /// What planes there are.
    pub layout: Layout,
    /// Whether opacities are to be sparse.
    pub is_sparse: bool,
    /// Whether there are normal residuals, and they are to be small.
    pub has_residual: bool,
}

impl AttributeLosses {
    fn residual_planes(&self) -> core::ops::Range<usize> {
        match self.has_residual {
            true => NORMAL_RESIDUAL_1..NORMAL_RESIDUAL_2 + 3,
            false => 0..0,
        }
    }
}

impl Formula for AttributeLosses {
    fn name(&self) -> String {
        "attribute_losses_vjp".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        vec![planes_field(self.layout), variable("attributes.sparse", 1), variable("attributes.residual", 1)]
    }
    fn results(&self) -> Vec<Field> {
        let opacity = call("add_to_opacity", usize::from(self.is_sparse));
        vec![opacity, call("add_to_residuals", self.residual_planes().len())]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let planes = Planes(inputs.slice(self.layout.plane_count()));
        let [sparse, residual] = inputs.array();
        let of_opacity = self.is_sparse.then(|| sparse_vjp(planes.at(OPACITY), sparse));
        let of_residual = |plane: usize| residual_vjp(planes.at(plane), residual);
        of_opacity.into_iter().chain(self.residual_planes().map(of_residual)).collect()
    }
}
