//! Gradients of shading and projection.

use crate::{
    codegen::formula::{Field, Inputs, call, fields, formula, variable},
    stages::{
        blend_vjp::formulas::GEOMETRY,
        camera::{light_frame_fields, take_camera, take_light_frame},
        gaussians::{Planes, planes_field},
        shade::formulas::{ColorsOf, light_fields, take_light},
    },
};
use specula_core::{
    attributes::{
        AttributeGrads, AttributeLosses, AttributePlanes, GaussianShading, LayerChannels, LightSample, LookupGrad,
        camera_vjp, shape_vjp,
    },
    real::Real,
    rules::{Channels, channel},
    scene::Layout,
    shade::ShadingForm,
    splat::SplatGrad,
    vector::Vec3,
};

/// Gradients of a Gaussian's splat and channels, through the shader's function `splat_grad`.
fn splat_grad_field(blended: Channels) -> [Field; 1] {
    [call("splat_grad", GEOMETRY + blended.count())]
}

/// Reads the gradients of the splat, then those of all channels; zero for channels that are not
/// blended.
fn take_splat_grad<R: Real>(inputs: &mut Inputs<'_, R>, blended: Channels) -> (SplatGrad<R>, LayerChannels<R>) {
    let (mean2d, root_conic, opacity) = (inputs.array(), inputs.array(), inputs.number());
    let numbers = inputs.slice(blended.count());
    let at = |channel: usize| blended.index_of(channel).map_or(opacity.zero(), |index| numbers[index]);
    let channels = LayerChannels(core::array::from_fn(at));
    (SplatGrad { mean2d, root_conic, depth: channels.0[channel::DEPTH], opacity }, channels)
}

/// Gradients of all planes of a Gaussian.
struct PlaneGrads<R>(Vec<R>);

impl<R: Real> AttributeGrads<R> for PlaneGrads<R> {
    fn set(&mut self, plane: usize, grad: R) {
        self.0[plane] = grad;
    }
}

/// Gradients of a Gaussian's planes ([`specula_core::attributes`]) from those of its splat and
/// channels; with light, also from those of its looked-up light.
#[derive(Clone, Copy, Debug)]
pub struct PlanesVjp {
    /// Shading of the Gaussian.
    pub shading: GaussianShading,
    /// True if it looked up a light.
    pub is_lit: bool,
    /// Whether that light is turned against the world.
    pub is_turned: bool,
    /// Whether the gradient of the camera's pose is wanted, too.
    pub moves_camera: bool,
}

/// Numbers of a [`CameraGrad`](specula_core::camera::CameraGrad).
pub(crate) const CAMERA_GRADS: usize = 12;

impl PlanesVjp {
    /// Light that the Gaussian looked up, and the gradients through it.
    fn lookup_fields(&self) -> Vec<Field> {
        match self.is_lit {
            true => fields!(
                ..light_fields(), of_specular: 4, of_ambient: 3, of_split_sum: 2, ..light_frame_fields(self.is_turned)
            ),
            false => Vec::new(),
        }
    }

    /// Reads [`Self::lookup_fields`] from a formula's inputs.
    fn take_lookup<R: Real>(&self, inputs: &mut Inputs<'_, R>, like: R) -> (LightSample<R>, LookupGrad<R>) {
        if !self.is_lit {
            return (LightSample::none(like), LookupGrad { specular: None, ambient: None });
        }
        let light = take_light(inputs);
        let (specular, ambient) = ((inputs.vec3(), inputs.number()), (inputs.vec3(), inputs.array()));
        let frame = take_light_frame(inputs, self.is_turned);
        let specular = (frame.to_light_vjp(specular.0), specular.1);
        let ambient = (frame.to_light_vjp(ambient.0), ambient.1);
        let has_ambient = self.shading.rules.shading.form == ShadingForm::Official;
        (light, LookupGrad { specular: Some(specular), ambient: has_ambient.then_some(ambient) })
    }
}

formula!(PlanesVjp, |this, inputs| planes_vjp(
    ..ColorsOf(this.shading).parameters(), ..splat_grad_field(this.shading.channels()), ..this.lookup_fields()
) -> (..[
    call("store_plane_grad", this.shading.layout.plane_count()),
    call("store_camera_grad", if this.moves_camera { CAMERA_GRADS } else { 0 })
]) {
    let plane_count = this.shading.layout.plane_count();
    let planes = Planes(inputs.slice(plane_count));
    let camera = take_camera(inputs);
    let (splat, channels) = take_splat_grad(inputs, this.shading.channels());
    let mut out = PlaneGrads(vec![splat.opacity.zero(); plane_count]);
    let pose = if this.shading.layout.is_shaded() {
        let (light, lookup) = this.take_lookup(inputs, splat.opacity);
        let shaded = this.shading.shaded(&planes, camera.position);
        let grad = this.shading.terms_vjp(&shaded.terms(&light), &channels);
        this.shading.surface_vjp(&planes, camera.position, &shaded, &grad, &channels, &lookup, &mut out)
    } else {
        this.shading.radiance_vjp(&planes, camera.position, &channels, &mut out)
    };
    let shape = planes.shape(this.shading.layout);
    shape_vjp(&shape, &camera, &splat, &pose, &mut out);
    if this.moves_camera {
        out.0.extend(camera_vjp(&shape, &camera, &splat, &pose).rows().into_iter().flat_map(Vec3::to_array));
    }
    out.0
});

/// Gradient of the light that a Gaussian looked up ([`specula_core::shade::shade_vjp`]).
#[derive(Clone, Copy, Debug)]
pub struct LookupVjp(pub GaussianShading);

formula!(LookupVjp, |this, inputs| lookup_vjp(
    ..ColorsOf(this.0).parameters(), ..splat_grad_field(this.0.channels()), ..light_fields()
) -> (
    specular: 3, ambient: 3, split_sum: 2
) {
    let planes = Planes(inputs.slice(this.0.layout.plane_count()));
    let camera = take_camera(inputs);
    let (_, channels) = take_splat_grad(inputs, this.0.channels());
    let shaded = this.0.shaded(&planes, camera.position);
    let grad = this.0.terms_vjp(&shaded.terms(&take_light(inputs)), &channels);
    (grad.specular_light, grad.ambient_light, grad.split_sum)
});

/// Gradients of the losses on attributes ([`specula_core::attributes::AttributeLosses`]): of the
/// opacity, of both normal residuals and of the metalness.
#[derive(Clone, Copy, Debug)]
pub struct AttributeLossesVjp {
    /// Planes of the Gaussians.
    pub layout: Layout,
    /// Losses that have a weight.
    pub losses: AttributeLosses,
}

/// Gradients in the order in which they are set.
struct GradList<R>(Vec<R>);

impl<R: Real> AttributeGrads<R> for GradList<R> {
    fn set(&mut self, _: usize, grad: R) {
        self.0.push(grad);
    }
}

formula!(AttributeLossesVjp, |this, inputs| attribute_losses_vjp(
    ..planes_field(this.layout),
    ..["sparse", "residual", "metalness", "mean_light"].map(|factor| variable(&format!("attributes.{factor}"), 1))
) -> (..[
    call("add_to_opacity", usize::from(this.losses.is_sparse)),
    call("add_to_residuals", this.losses.residual_planes().len()),
    call("add_to_metalness", this.losses.metalness_plane.iter().count())
]) {
    let planes = Planes(inputs.slice(this.layout.plane_count()));
    let mut grads = GradList(Vec::new());
    this.losses.loss_vjp(&planes, inputs.array(), &mut grads);
    grads.0
});
