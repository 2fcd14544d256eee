//! Environment as the background of a view: its unfiltered radiance behind each pixel.

use crate::environment::radiance;
use specula_core::{
    camera::Camera,
    color::{composite, srgb_from_linear},
    scene::{Environment, Image},
};
use specula_io::latlong;

/// Colours of a rendered view over a light, as three planes in sRGB.
pub fn over_environment(image: &Image<Vec<f32>>, light: &Environment<Vec<f32>>, camera: &Camera) -> Vec<f32> {
    let behind = environment_colors(light, camera);
    let transmittance = image.plane(image.channels - 1);
    let plane = |c: usize| {
        let pixels = image.plane(c).iter().zip(transmittance).zip(&behind);
        pixels.map(move |((color, transmittance), behind)| composite(*color, *transmittance, behind[c]))
    };
    (0..3).flat_map(plane).collect()
}

/// Colours of a light behind each pixel of a camera, row by row: its radiance in the direction of
/// the pixel's centre, in sRGB from 0 to 1.
pub fn environment_colors(light: &Environment<Vec<f32>>, camera: &Camera) -> Vec<[f32; 3]> {
    let world_from_camera = camera.camera_from_world.transpose();
    let direction = |index: u32| {
        let [x, y] = [index % camera.width, index / camera.width].map(|pixel| pixel as f32 + 0.5);
        (world_from_camera * camera.ray_in_camera(x, y)).as_dvec3().to_array()
    };
    let directions: Vec<[f64; 3]> = (0..camera.width * camera.height).map(direction).collect();
    let seen = latlong::radiance_along(&radiance(light.activation, &light.values), light.resolution, &directions);
    seen.into_iter().map(|color| color.map(|channel| srgb_from_linear(channel).clamp(0.0, 1.0))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::{cubemap, scene::RadianceActivation};

    #[test]
    fn behind_each_pixel_is_the_light_from_its_direction() {
        const RESOLUTION: usize = 8;
        // Radiance is a linear function of the place on a face, which bilinear look-ups keep.
        let texel = |index: usize| {
            let (face, row, column) = (index / 64, index / 8 % 8, index % 8);
            let [x, y, z] = cubemap::texel_direction(face, column, row, RESOLUTION);
            let major = x.abs().max(y.abs()).max(z.abs());
            [x, y, z].map(|component| (0.5 + 0.4 * component / major) as f32)
        };
        let values: Vec<f32> = (0..6 * RESOLUTION * RESOLUTION).flat_map(texel).collect();
        let light = Environment { resolution: RESOLUTION, activation: RadianceActivation::Identity, values };
        let camera =
            Camera::look_at(glam::Vec3::new(5.0, 2.0, 1.0), glam::Vec3::new(1.0, 2.0, 1.0), glam::Vec3::Z, 0.6, 6, 4);
        let seen = environment_colors(&light, &camera);
        assert_eq!(seen.len(), 24);
        // The camera looks along -x, with +y to its right and +z above.
        let half = 0.3_f32.tan();
        for (index, color) in seen.iter().enumerate() {
            let [right, down] = [(index % 6) as f32 - 2.5, (index / 6) as f32 - 1.5].map(|pixel| pixel * half / 3.0);
            let expected = [0.1, 0.5 + 0.4 * right, 0.5 - 0.4 * down].map(srgb_from_linear);
            let is_near = color.iter().zip(expected).all(|(own, expected)| (own - expected).abs() < 1e-5);
            assert!(is_near, "{color:?} instead of {expected:?} at {index}");
        }

        // The same as logarithms, and brighter than white.
        let values = light.values.iter().map(|radiance| radiance.ln()).collect();
        let learned = Environment { activation: RadianceActivation::Exponential, values, ..light.clone() };
        let is_same = |(a, b): (&[f32; 3], &[f32; 3])| (a[1] - b[1]).abs() < 1e-5;
        assert!(environment_colors(&learned, &camera).iter().zip(&seen).all(is_same), "exponents are not radiance");
        let bright = light.with_values(light.values.iter().map(|radiance| radiance * 1000.0).collect());
        assert!(environment_colors(&bright, &camera).iter().all(|color| *color == [1.0; 3]), "white is the most");
    }
}
