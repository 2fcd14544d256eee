//! Gradients of shading and projection.

use crate::{
    codegen::formula::{Field, Inputs, call, fields, formula, variable},
    stages::{
        blend_vjp::formulas::GEOMETRY,
        camera::take_camera,
        gaussians::{Planes, planes_field},
        shade::formulas::{AllChannels, ColorsOf, LightOf, ShadingOf, light_fields, take_light},
    },
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

/// Gradients of a Gaussian's splat and channels, as the shader's function `splat_grad` reads them.
fn splat_grad_field(blended: Channels) -> [Field; 1] {
    [call("splat_grad", GEOMETRY + blended.count())]
}

/// Reads the gradients of the splat, then those of all channels; zero for channels that are not blended.
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

/// Gradients through the light that a Gaussian looked up.
struct LookupGrad<R> {
    reflection_dir: Vec3<R>,
    /// Through the levels of the light.
    roughness: R,
    /// Through the irradiance.
    normal: Vec3<R>,
    /// Gradients of n·v and of the roughness, through the split-sum table.
    split_sum: [R; 2],
}

impl ShadingOf {
    /// Terms of a shaded Gaussian's colour.
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

/// Gradients of all planes of a Gaussian.
struct PlaneGrads<R>(Vec<R>);

impl<R: Real> PlaneGrads<R> {
    fn put(&mut self, first: usize, vector: Vec3<R>) {
        self.0[first..first + 3].copy_from_slice(&vector.to_array());
    }

    /// Adds the gradients of the splat's shape.
    fn add_projection(&mut self, planes: &Planes<'_, R>, camera: &CameraOf<R>, grad: &SplatGrad<R>) {
        let grad = project_vjp(&planes.shape(), camera, grad);
        let mut add = |first: usize, numbers: &[R]| {
            self.0[first..].iter_mut().zip(numbers).for_each(|(sum, number)| *sum = *number + *sum);
        };
        add(MEAN, &grad.mean.to_array());
        add(LOG_SCALE, &grad.log_scales.to_array());
        add(QUAT, &grad.quat);
        add(OPACITY, &[grad.opacity_logit]);
    }
}

/// Gradients of a Gaussian's planes ([`mod@specula_core::shade`], [`mod@specula_core::project`]) from those of its splat
/// and channels; with light, also from those of the light that it looked up.
#[derive(Clone, Copy, Debug)]
pub struct PlanesVjp {
    /// Shading of the Gaussian.
    pub shading: ShadingOf,
    /// Whether it looked up a light.
    pub is_lit: bool,
}

impl PlanesVjp {
    /// Light that the Gaussian looked up, and the gradients through it.
    fn lookup_fields(&self) -> Vec<Field> {
        match self.is_lit {
            true => fields!(..light_fields(), of_specular: 4, of_ambient: 3, of_split_sum: 2),
            false => Vec::new(),
        }
    }
}

formula!(PlanesVjp, |this, inputs| planes_vjp(
    ..ColorsOf(this.shading).parameters(), ..splat_grad_field(this.shading.blended()), ..this.lookup_fields()
) -> (..[call("put", this.shading.layout.plane_count())]) {
    let plane_count = this.shading.layout.plane_count();
    let planes = Planes(inputs.slice(plane_count));
    let camera = take_camera(inputs);
    let (splat, channels) = take_splat_grad(inputs, this.shading.blended());
    let light = this.is_lit.then(|| {
        let light = take_light(inputs);
        let (reflection_dir, roughness) = (inputs.vec3(), inputs.number());
        (light, LookupGrad { reflection_dir, roughness, normal: inputs.vec3(), split_sum: inputs.array() })
    });
    let mut out = PlaneGrads(vec![splat.opacity.zero(); plane_count]);
    if this.shading.layout.is_shaded() {
        this.shading.shaded_vjp(&planes, &camera, &channels, light.as_ref(), &mut out);
    } else {
        this.shading.plain_vjp(&planes, &camera, &channels, &mut out);
    }
    out.add_projection(&planes, &camera, &splat);
    out.0
});

/// Gradient of the light that a Gaussian looked up ([`specula_core::shade::shade_vjp`]).
#[derive(Clone, Copy, Debug)]
pub struct LookupVjp(pub ShadingOf);

formula!(LookupVjp, |this, inputs| lookup_vjp(
    ..ColorsOf(this.0).parameters(), ..splat_grad_field(this.0.blended()), ..light_fields()
) -> (
    specular: 3, ambient: 3, split_sum: 2
) {
    let planes = Planes(inputs.slice(this.0.layout.plane_count()));
    let camera = take_camera(inputs);
    let (_, channels) = take_splat_grad(inputs, this.0.blended());
    let terms = this.0.terms(&planes, &camera, Some(&take_light(inputs)));
    let grad = shade_vjp(this.0.rules.shading.form, &terms, channels.take3(channel::COLOR));
    (grad.specular_light, grad.ambient_light, grad.split_sum)
});

/// Gradient of the position between four neighbouring entries of the split-sum table
/// ([`specula_core::cubemap::bilinear_vjp`]).
#[derive(Clone, Copy, Debug)]
pub struct SplitSumVjp;

formula!(SplitSumVjp, |_, inputs| split_sum_slopes(
    upper_left: 2, upper_right: 2, lower_left: 2, lower_right: 2, share: 2, grad: 2
) -> (grad_place: 2) {
    let mut pair = || {
        let [x, y] = inputs.array();
        vec3(x, y, x.zero())
    };
    let texels = [pair(), pair(), pair(), pair()];
    let (share, grad) = (pair(), pair());
    let (right, lower) = bilinear_vjp(texels, share.x, share.y, grad);
    [right, lower]
});

/// Gradients of the losses on attributes, not on images: of the opacity and of both normal residuals.
#[derive(Clone, Copy, Debug)]
pub struct AttributeLosses {
    /// Planes of the Gaussians.
    pub layout: Layout,
    /// Whether the sparsity of opacities has a weight.
    pub is_sparse: bool,
    /// Whether there are normal residuals, and their size has a weight.
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

formula!(AttributeLosses, |this, inputs| attribute_losses_vjp(
    ..planes_field(this.layout), ..[variable("attributes.sparse", 1), variable("attributes.residual", 1)]
) -> (..[
    call("add_to_opacity", usize::from(this.is_sparse)), call("add_to_residuals", this.residual_planes().len())
]) {
    let planes = Planes(inputs.slice(this.layout.plane_count()));
    let [sparse, residual] = inputs.array();
    let of_opacity = this.is_sparse.then(|| sparse_vjp(planes.at(OPACITY), sparse));
    let of_residual = |plane: usize| residual_vjp(planes.at(plane), residual);
    of_opacity.into_iter().chain(this.residual_planes().map(of_residual)).collect::<Vec<R>>()
});
