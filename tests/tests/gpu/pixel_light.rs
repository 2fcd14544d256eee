//! Composition of a pixel's light on the device against the host, under light that is a formula.

use specula_core::{real::Real, vector::vec3};
use specula_gpu::codegen::formula::{Field, Formula, Inputs, field};
use specula_tests::{
    device::executor,
    formulas::{assert_same, uniform_rows},
    pixels::{PIXEL_LEN, PixelCase, SMOOTH_LEN},
};

/// A pixel under its light.
struct ShadedPixelOf(PixelCase);

impl Formula for ShadedPixelOf {
    fn name(&self) -> String {
        "shaded_pixel_of".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        vec![field("numbers", PIXEL_LEN)]
    }
    fn results(&self) -> Vec<Field> {
        vec![field("color", 3), field("specular", 3), field("light", 3)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let shaded = self.0.shaded(inputs.slice(PIXEL_LEN));
        [shaded.color, shaded.specular, shaded.light].iter().flat_map(|v| v.to_array()).collect()
    }
}

/// Gradient of [`ShadedPixelOf`].
struct ShadedPixelVjpOf(PixelCase);

impl Formula for ShadedPixelVjpOf {
    fn name(&self) -> String {
        "shaded_pixel_vjp_of".to_owned()
    }
    fn parameters(&self) -> Vec<Field> {
        vec![field("numbers", PIXEL_LEN), field("grad", 3)]
    }
    fn results(&self) -> Vec<Field> {
        vec![field("grads", SMOOTH_LEN)]
    }
    fn evaluate<R: Real>(&self, inputs: &mut Inputs<'_, R>) -> Vec<R> {
        let numbers = inputs.slice(PIXEL_LEN);
        let [x, y, z] = inputs.array();
        self.0.shaded_vjp(numbers, vec3(x, y, z))
    }
}

#[test]
fn light_of_pixels_is_on_the_device_what_it_is_on_the_host() {
    let Some(mut gpu) = executor() else { return };
    let pixel = vec![[0.05, 0.6]; PIXEL_LEN];
    for case in PixelCase::all() {
        assert_same(&mut gpu, &ShadedPixelOf(case), &uniform_rows(1, &pixel));
        if !case.is_illuminated {
            let rows = [&pixel[..], &[[-1.0, 1.0]; 3]].concat();
            assert_same(&mut gpu, &ShadedPixelVjpOf(case), &uniform_rows(2, &rows));
        }
    }
}
