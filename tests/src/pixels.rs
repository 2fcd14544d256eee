//! Pixels under light that is a formula of directions and roughness, so that all of it has
//! derivatives and runs on every number.

use specula_core::{
    lamps::DirectLight,
    near_field::Reflection,
    pixel_light::{BlendedGrads, BlendedPixel, LightLookupGrads, LightLookups, PixelRays, PixelShading, ShadedPixel},
    real::Real,
    rules::{Channels, LightLayer, channel},
    shade::ShadingForm,
    vector::{Vec3, vec3},
};

/// Channels of all layers, and the transmittance.
pub const BLENDED_LEN: usize = Channels::Layers.count() + 1;
/// Numbers of the far light: radiance and irradiance.
pub const FAR_LEN: usize = 6;
/// Numbers that have a gradient.
pub const SMOOTH_LEN: usize = BLENDED_LEN + FAR_LEN;
/// Numbers of a pixel and its light: the smooth ones, reflection, light of lamps.
pub const PIXEL_LEN: usize = SMOOTH_LEN + Reflection::<f32>::LEN + DirectLight::<f32>::LEN;

/// Composition of a pixel's light.
#[derive(Clone, Copy, Debug)]
pub struct PixelCase {
    /// Form and layer.
    pub shading: PixelShading,
    /// Whether there is a light.
    pub is_lit: bool,
    /// Whether the reflected ray was traced.
    pub is_traced: bool,
    /// Whether there are lamps.
    pub is_illuminated: bool,
}

impl PixelCase {
    /// Every form with every light and every layer.
    pub fn all() -> Vec<Self> {
        let mut cases = Vec::new();
        for form in [ShadingForm::Deferred, ShadingForm::Physical] {
            for light_layer in [[LightLayer::Reflected].as_slice(), &LightLayer::OTHERS].concat() {
                let shading = PixelShading { form, light_layer, channels: Channels::Layers };
                let lamps = form == ShadingForm::Physical;
                for (is_lit, is_traced, is_illuminated) in [
                    (false, false, false),
                    (true, false, false),
                    (true, true, false),
                    (true, false, lamps),
                    (true, true, lamps),
                ] {
                    cases.push(Self { shading, is_lit, is_traced, is_illuminated });
                }
            }
        }
        cases
    }

    /// Pixel and light of [`PIXEL_LEN`] numbers.
    pub fn parts<R: Real>(&self, numbers: &[R]) -> (GivenPixel<R>, Option<GivenLight<R>>) {
        let (blended, rest) = numbers.split_at(BLENDED_LEN);
        let (far, rest) = rest.split_at(FAR_LEN);
        let (reflection, direct) = rest.split_at(Reflection::<R>::LEN);
        let fixed = |reflection: &[R]| Reflection::from_array(core::array::from_fn(|k| reflection[k]));
        let light = GivenLight {
            radiance: vec3(far[0], far[1], far[2]),
            irradiance: vec3(far[3], far[4], far[5]),
            rays: PixelRays {
                reflection: self.is_traced.then(|| fixed(reflection)),
                has_second: true,
                direct: self.is_illuminated.then(|| DirectLight::from_array(core::array::from_fn(|k| direct[k]))),
            },
            grads: [Vec3::zero(far[0]); 2],
        };
        (GivenPixel(blended.to_vec()), self.is_lit.then_some(light))
    }

    /// The pixel of [`PIXEL_LEN`] numbers under its light.
    pub fn shaded<R: Real>(&self, numbers: &[R]) -> ShadedPixel<R> {
        let (blended, light) = self.parts(numbers);
        match &light {
            Some(light) => self.shading.shaded(&blended, view_dir(numbers[0]), &light.rays, light),
            None => self.shading.unlit(&blended),
        }
    }

    /// Gradient of the colour of [`PixelCase::shaded`] with respect to the first [`SMOOTH_LEN`]
    /// numbers.
    pub fn shaded_vjp<R: Real>(&self, numbers: &[R], grad: Vec3<R>) -> Vec<R> {
        let (blended, mut light) = self.parts(numbers);
        let mut grads = GivenPixel(vec![grad.x.zero(); BLENDED_LEN]);
        grads.set3(channel::COLOR, grad);
        let rays = light.map(|light| light.rays);
        self.shading.shaded_vjp(&blended, view_dir(numbers[0]), rays.as_ref().zip(light.as_mut()), &mut grads);
        let far = light.map_or([Vec3::zero(grad.x); 2], |light| light.grads);
        [grads.0, far.map(Vec3::to_array).concat()].concat()
    }
}

/// Direction to the eye.
pub fn view_dir<R: Real>(like: R) -> Vec3<R> {
    Vec3::constant(like, glam::Vec3::new(0.36, 0.48, 0.8))
}

/// Channels of all layers, and the transmittance.
#[derive(Clone, Debug)]
pub struct GivenPixel<R>(pub Vec<R>);

impl<R: Real> BlendedPixel<R> for GivenPixel<R> {
    fn channel(&self, channel: usize) -> R {
        self.0[channel]
    }
    fn transmittance(&self) -> R {
        self.0[BLENDED_LEN - 1]
    }
}

impl<R: Real> BlendedGrads<R> for GivenPixel<R> {
    fn set(&mut self, channel: usize, grad: R) {
        self.0[channel] = grad;
    }
    fn set_transmittance(&mut self, grad: R) {
        self.0[BLENDED_LEN - 1] = grad;
    }
}

/// Light that grows along an axis and with the roughness.
#[derive(Clone, Copy, Debug)]
pub struct GivenLight<R> {
    /// Radiance, but for a factor.
    pub radiance: Vec3<R>,
    /// Irradiance / π, but for a factor.
    pub irradiance: Vec3<R>,
    /// Reflection and light of lamps.
    pub rays: PixelRays<R>,
    /// Gradients of radiance and irradiance.
    pub grads: [Vec3<R>; 2],
}

/// Growth along the axis.
fn growth<R: Real>(like: R) -> Vec3<R> {
    Vec3::constant(like, glam::Vec3::new(0.3, -0.2, 0.1))
}

/// Factor of the light along a direction.
fn factor<R: Real>(direction: Vec3<R>, roughness: R) -> R {
    direction.dot(growth(roughness)) + roughness * 0.5 + 1.0
}

impl<R: Real> LightLookups<R> for GivenLight<R> {
    type Lookup = Vec3<R>;

    fn look_up(&self, direction: Vec3<R>, roughness: R) -> Vec3<R> {
        self.radiance * factor(direction, roughness)
    }
    fn look_up_irradiance(&self, normal: Vec3<R>) -> Vec3<R> {
        self.irradiance * factor(normal, normal.x.zero())
    }
    fn radiance(&self, lookup: &Vec3<R>) -> Vec3<R> {
        *lookup
    }
    fn split_sum(&self, n_dot_v: R, roughness: R) -> [R; 2] {
        [n_dot_v * roughness + 0.2, n_dot_v * 0.3 + roughness * 0.1]
    }
}

impl<R: Real> LightLookupGrads<R> for GivenLight<R> {
    fn look_up_vjp(&mut self, _: &Vec3<R>, direction: Vec3<R>, roughness: R, grad: Vec3<R>) -> (Vec3<R>, R) {
        self.grads[0] = self.grads[0] + grad * factor(direction, roughness);
        let grad_factor = grad.dot(self.radiance);
        (growth(roughness) * grad_factor, grad_factor * 0.5)
    }
    fn look_up_irradiance_vjp(&mut self, _: &Vec3<R>, normal: Vec3<R>, grad: Vec3<R>) -> Vec3<R> {
        self.grads[1] = self.grads[1] + grad * factor(normal, normal.x.zero());
        growth(normal.x) * grad.dot(self.irradiance)
    }
    fn split_sum_vjp(&self, n_dot_v: R, roughness: R, [scale, bias]: [R; 2]) -> [R; 2] {
        [scale * roughness + bias * 0.3, scale * n_dot_v + bias * 0.1]
    }
}
