//! Light of a pixel in kernels: [`specula_core::pixel_light`] over the planes of frames and the
//! lookups of a shader.

use crate::{
    codegen::{
        formula::{Field, Inputs, call, field, procedure, variable},
        source::Source,
        trace::{Traced, TracedValue},
    },
    device::{context::Context, error::GpuError, memory::Array},
    stages::{
        camera::{camera_fields, light_frame_fields, take_camera, take_light_frame},
        frame::Frame,
        light::split_sums,
        prefilter::Light,
    },
};
use core::borrow::{Borrow, BorrowMut};
use specula_core::{
    camera::Camera,
    lamps::DirectLight,
    light_frame::{LightFrame, Turned},
    near_field::Reflection,
    pixel_light::{BlendedGrads, BlendedPixel, LightLookupGrads, LightLookups, PixelRays, PixelShading},
    real::Real,
    rules::{Channels, RenderRules, channel},
    shade::ShadingForm,
    vector::Vec3,
};

/// Channels of a pixel, then its transmittance; or their gradients.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BlendedNumbers<N> {
    channels: Channels,
    numbers: N,
}

impl<'a, R: Real> BlendedNumbers<&'a [R]> {
    /// Reads [`blended_field`] from a formula's inputs.
    pub(crate) fn take(channels: Channels, inputs: &mut Inputs<'a, R>) -> Self {
        Self { channels, numbers: inputs.slice(channels.count() + 1) }
    }
}

impl<R: Real, N: Borrow<[R]>> BlendedPixel<R> for BlendedNumbers<N> {
    fn channel(&self, channel: usize) -> R {
        let numbers = self.numbers.borrow();
        self.channels.index_of(channel).map_or(numbers[0].zero(), |index| numbers[index])
    }
    fn transmittance(&self) -> R {
        self.numbers.borrow()[self.channels.count()]
    }
}

impl<R: Real, N: BorrowMut<[R]>> BlendedGrads<R> for BlendedNumbers<N> {
    fn set(&mut self, channel: usize, grad: R) {
        if let Some(index) = self.channels.index_of(channel) {
            self.numbers.borrow_mut()[index] = grad;
        }
    }
    fn set_transmittance(&mut self, grad: R) {
        self.numbers.borrow_mut()[self.channels.count()] = grad;
    }
}

/// Channels and transmittance of a kernel's pixel as parameters.
pub(crate) fn blended_field(channels: Channels) -> [Field; 1] {
    [call("blended", channels.count() + 1)]
}

/// A plane of an array in the kernel's pixel.
fn plane(array: &str, plane: usize) -> String {
    format!("{array}[{plane}u * camera.size.x * camera.size.y + pixel]")
}

/// Planes of an array as parameters.
fn planes(array: &str, count: usize) -> impl Iterator<Item = Field> {
    (0..count).map(move |k| variable(&plane(array, k), 1))
}

/// Lookups of a shader.
struct TracedLookups {
    /// Whether they keep what their gradients need.
    has_gradient: bool,
}

impl LightLookups<Traced> for TracedLookups {
    type Lookup = TracedValue;

    fn look_up(&self, direction: Vec3<Traced>, roughness: Traced) -> TracedValue {
        let name = if self.has_gradient { "look_up" } else { "radiance" };
        TracedValue::call(name, [direction.into(), roughness.into()])
    }
    fn look_up_irradiance(&self, normal: Vec3<Traced>) -> TracedValue {
        TracedValue::call(if self.has_gradient { "look_up_irradiance" } else { "irradiance" }, [normal.into()])
    }
    fn radiance(&self, lookup: &TracedValue) -> Vec3<Traced> {
        if self.has_gradient { lookup.member("radiance").vec3() } else { lookup.vec3() }
    }
    fn split_sum(&self, n_dot_v: Traced, roughness: Traced) -> [Traced; 2] {
        TracedValue::call("split_sum", [n_dot_v.into(), roughness.into()]).components()
    }
}

impl LightLookupGrads<Traced> for TracedLookups {
    fn look_up_vjp(
        &mut self,
        lookup: &TracedValue,
        direction: Vec3<Traced>,
        roughness: Traced,
        grad: Vec3<Traced>,
    ) -> (Vec3<Traced>, Traced) {
        let arguments = [*lookup, direction.into(), roughness.into(), grad.into()];
        let [x, y, z, roughness] = TracedValue::call("look_up_vjp", arguments).components();
        (Vec3 { x, y, z }, roughness)
    }
    fn look_up_irradiance_vjp(
        &mut self,
        lookup: &TracedValue,
        normal: Vec3<Traced>,
        grad: Vec3<Traced>,
    ) -> Vec3<Traced> {
        TracedValue::call("look_up_irradiance_vjp", [*lookup, normal.into(), grad.into()]).vec3()
    }
    fn split_sum_vjp(&self, n_dot_v: Traced, roughness: Traced, grad: [Traced; 2]) -> [Traced; 2] {
        TracedValue::call("split_sum_vjp", [n_dot_v.into(), roughness.into(), grad.into()]).components()
    }
}

/// Variant of the kernels of a pixel: its shading, and the light that it has.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PixelKernel {
    pub(crate) shading: PixelShading,
    pub(crate) is_lit: bool,
    pub(crate) is_traced: bool,
    pub(crate) is_illuminated: bool,
    /// Whether the light is turned against the world.
    pub(crate) is_turned: bool,
}

impl PixelKernel {
    /// Variant for a frame of a camera under a light by rules.
    pub(crate) fn new(frame: &Frame, light: Option<&Light>, camera: &Camera, rules: &RenderRules) -> Self {
        let shading = PixelShading::new(rules, Channels::of_count(frame.channels));
        let is_lit = light.is_some();
        let is_illuminated = is_lit && frame.direct.is_some() && shading.form == ShadingForm::Physical;
        let is_turned = is_lit && camera.light_from_world.is_some();
        Self { shading, is_lit, is_traced: is_lit && frame.reflections.is_some(), is_illuminated, is_turned }
    }
    /// Whether the split-sum table is looked up.
    pub(crate) fn reads_split_sum(&self) -> bool {
        self.is_lit && self.shading.form == ShadingForm::Physical
    }
    /// Arrays of the light of pixels, in the order of [`PixelKernel::bindings`].
    ///
    /// # Errors
    ///
    /// See [`Context::allocate`].
    pub(crate) fn arrays<'a>(
        &self,
        context: &mut Context,
        frame: &'a Frame,
        light: Option<&'a Light>,
    ) -> Result<impl Iterator<Item = &'a Array>, GpuError> {
        let split_sum =
            light.filter(|_| self.reads_split_sum()).map(|light| light.source.split_sum(context)).transpose()?;
        let reflections = frame.reflections.as_ref().filter(|_| self.is_traced);
        let direct = frame.direct.as_ref().filter(|_| self.is_illuminated);
        Ok(reflections.into_iter().chain(split_sum).chain(direct))
    }
    /// Declares the reflections, the split-sum table and the light of lamps, as far as there are
    /// any, from this binding on.
    pub(crate) fn bindings(&self, source: Source, first: usize) -> Source {
        let array = |binding: usize, name: &str| {
            format!("@group(0) @binding({binding}) var<storage, read> {name}: array<f32>;\n")
        };
        let second = first + usize::from(self.is_traced);
        let source = if self.is_traced { source.with(&array(first, "reflections")) } else { source };
        let source = if self.reads_split_sum() { split_sums(source, second) } else { source };
        if self.is_illuminated { source.with(&array(second + 1, "direct")) } else { source }
    }
    /// Channels, place on the picture, camera and rays of a pixel, as parameters.
    fn parameters(&self) -> Vec<Field> {
        let rays = [
            ("reflections", self.is_traced, Reflection::<f32>::LEN),
            ("direct", self.is_illuminated, DirectLight::<f32>::LEN),
        ];
        let rays = rays.into_iter().filter(|ray| ray.1).flat_map(|(array, _, count)| planes(array, count));
        let pixel = blended_field(self.shading.channels).into_iter().chain([field("point", 2)]);
        pixel.chain(camera_fields()).chain(rays).chain(light_frame_fields(self.is_turned)).collect()
    }
    /// Reads [`PixelKernel::parameters`]: the pixel, its direction to the eye, its rays, the frame
    /// of its light.
    fn take<'a>(
        &self,
        inputs: &mut Inputs<'a, Traced>,
    ) -> (BlendedNumbers<&'a [Traced]>, Vec3<Traced>, PixelRays<Traced>, LightFrame<Traced>) {
        let blended = BlendedNumbers::take(self.shading.channels, inputs);
        let [x, y] = inputs.array();
        let view_dir = take_camera(inputs).view_dir(x, y);
        let reflection = self.is_traced.then(|| Reflection::from_array(inputs.array()));
        let direct = self.is_illuminated.then(|| DirectLight::from_array(inputs.array()));
        let frame = take_light_frame(inputs, self.is_turned);
        (blended, view_dir, PixelRays { reflection, has_second: true, direct }, frame)
    }
    /// `shade_pixel`, which stores the colour of a pixel, and its layers if all were requested.
    pub(crate) fn forward(&self) -> String {
        procedure("shade_pixel", &self.parameters(), |inputs| {
            let (blended, view_dir, rays, frame) = self.take(inputs);
            let shaded = if self.is_lit {
                let lookups = TracedLookups { has_gradient: false };
                self.shading.shaded(&blended, view_dir, &rays, &Turned { lookups, frame })
            } else {
                self.shading.unlit(&blended)
            };
            let layers = [("frame", channel::SPECULAR, shaded.specular), ("frame", channel::LIGHT, shaded.light)];
            let layers = layers.into_iter().filter(|_| self.shading.channels == Channels::Layers);
            let stores = [("shaded", channel::COLOR, shaded.color)].into_iter().chain(layers);
            stores.flat_map(|(array, first, v)| (first..).map(|k| plane(array, k)).zip(v.to_array())).collect()
        })
    }
    /// `shade_pixel_vjp`, which converts the gradient of a pixel's colour to those of its channels,
    /// and adds to that of the light.
    pub(crate) fn backward(&self) -> String {
        let mut parameters = self.parameters();
        let count = self.shading.channels.count() + 1;
        parameters.extend(planes("grads", count));
        procedure("shade_pixel_vjp", &parameters, |inputs| {
            let (blended, view_dir, rays, frame) = self.take(inputs);
            let before = inputs.slice(count);
            let mut grads = BlendedNumbers { channels: self.shading.channels, numbers: before.to_vec() };
            let mut lookups = self.is_lit.then_some(Turned { lookups: TracedLookups { has_gradient: true }, frame });
            let light = lookups.as_mut().map(|lookups| (&rays, lookups));
            self.shading.shaded_vjp(&blended, view_dir, light, &mut grads);
            let changed = grads.numbers.into_iter().enumerate().filter(|(k, grad)| *grad != before[*k]);
            changed.map(|(k, grad)| (plane("grads", k), grad)).collect()
        })
    }
}
