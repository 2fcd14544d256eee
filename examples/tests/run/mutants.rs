//! Faults of an executor, each of which misses its requirement of `specula_conformance`.

use crate::executor::{Colors, Light, Naive, NaiveError};
use core::convert::Infallible;
use glam::Mat3;
use specula_conformance::{Subject, renderer};
use specula_core::{
    activation::{logit, sigmoid},
    blend::MAX_ALPHA,
    camera::Camera,
    executor::{Occluder, Renderer},
    lamps::Lamp,
    prefilter::{LevelRange, PrefilterScheme},
    rules::{RenderRules, channel},
    scene::{Environment, Gaussians, Image, ROUGHNESS},
    splat::Splat,
};

/// Fault of a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fault {
    /// Arrays keep half of their digits.
    RoundedArrays,
    /// Short buffers are filled.
    ShortBuffer,
    /// Opacities are off by 1e-3.
    FormulaOff,
    /// Columns and rows are exchanged.
    SwappedAxis,
    /// Centres of pixels are at whole numbers.
    HalfPixelShift,
    /// Colours that are not finite are drawn.
    NanLetThrough,
    /// Depths are not blended.
    LostDepth,
    /// Splats are drawn back to front.
    WrongOrder,
    /// Splats at one depth are drawn in the reverse order.
    WrongTies,
    /// Texels of the light are half a texel further.
    HalfTexelShift,
    /// Pixels look up a light that is too blurred.
    WrongLevel,
    /// Alphas end a thousandth before the limit.
    LowerLimit,
    /// Gaussians look up a light that is turned by a thousandth.
    TurnedLight,
    /// Roughnesses of lookups are off by a thousandth.
    RoughnessOff,
    /// Rays of pixels are a hundredth of a pixel beside their centres.
    RaysBeside,
    /// Physical materials without a light show their base colour.
    UnlitBase,
    /// Every other picture differs in its last bit, as by a race.
    Race,
    /// Lamps are accepted and ignored.
    SilentLamps,
}

/// Executor with a fault.
#[derive(Clone, Copy, Debug)]
struct Mutant {
    fault: Fault,
    pictures: u32,
}

impl Mutant {
    fn has(self, fault: Fault) -> bool {
        self.fault == fault
    }
}

impl Renderer for Mutant {
    type Array = Vec<f32>;
    type Light = Light;
    type NearField = Infallible;
    type Splats = Vec<Splat<f32>>;
    type Colors = Colors;
    type Tiles = Vec<usize>;
    type Frame = Image<Vec<f32>>;
    type Error = NaiveError;

    fn upload(&mut self, values: &[f32]) -> Result<Vec<f32>, NaiveError> {
        let mut array = Naive.upload(values)?;
        if self.has(Fault::RoundedArrays) {
            array.iter_mut().for_each(|x| *x = f32::from_bits(x.to_bits() & !0xfff));
        }
        Ok(array)
    }

    fn download(&mut self, array: &Vec<f32>, values: &mut [f32]) -> Result<(), NaiveError> {
        if self.has(Fault::ShortBuffer) && values.len() < array.len() {
            values.copy_from_slice(&array[..values.len()]);
            return Ok(());
        }
        Naive.download(array, values)
    }

    fn read_frame(&mut self, frame: &Image<Vec<f32>>, values: &mut [f32]) -> Result<(), NaiveError> {
        self.download(&frame.values, values)
    }

    fn prefilter(
        &mut self,
        environment: &Environment<Vec<f32>>,
        scheme: PrefilterScheme,
        levels: LevelRange,
    ) -> Result<Light, NaiveError> {
        let mut light = Naive.prefilter(environment, scheme, levels)?;
        if self.has(Fault::HalfTexelShift) {
            for k in 1..light.texels.len() {
                light.texels[k - 1] = (light.texels[k - 1] + light.texels[k]) * 0.5;
            }
        }
        if self.has(Fault::WrongLevel) {
            let first = light.operator.maps()[1].first;
            let level = light.texels[first..light.operator.maps()[1].end()].to_vec();
            let mean = level.iter().fold(level[0] * 0.0, |sum, texel| sum + *texel) * (1.0 / level.len() as f32);
            light.texels[first..first + level.len()].fill(mean);
        }
        Ok(light)
    }

    fn add_lamps(
        &mut self,
        light: Light,
        lamps: &[Lamp],
        rays: usize,
        occluder: Option<Occluder<'_, Infallible>>,
    ) -> Result<Light, NaiveError> {
        if self.has(Fault::SilentLamps) { Ok(light) } else { Naive.add_lamps(light, lamps, rays, occluder) }
    }

    fn project(&mut self, gaussians: &Gaussians<Vec<f32>>, camera: &Camera) -> Result<Self::Splats, NaiveError> {
        let mut splats = Naive.project(gaussians, camera)?;
        for splat in &mut splats {
            if self.has(Fault::FormulaOff) {
                splat.opacity *= 1.001;
            }
            if self.has(Fault::SwappedAxis) {
                splat.mean2d.swap(0, 1);
            }
            if self.has(Fault::HalfPixelShift) {
                splat.mean2d = splat.mean2d.map(|x| x + 0.5);
            }
            if self.has(Fault::LowerLimit) {
                splat.opacity = splat.opacity.min(MAX_ALPHA / 1.001);
            }
        }
        Ok(splats)
    }

    fn shade(
        &mut self,
        gaussians: &Gaussians<Vec<f32>>,
        camera: &Camera,
        splats: &mut Self::Splats,
        light: Option<&Light>,
        rules: &RenderRules,
    ) -> Result<Colors, NaiveError> {
        let before = splats.clone();
        let (mut gaussians, mut camera) = (gaussians.clone(), *camera);
        if self.has(Fault::TurnedLight) {
            camera.light_from_world = Some(Mat3::from_rotation_z(1e-3));
        }
        if self.has(Fault::RoughnessOff) && gaussians.layout.is_shaded() {
            for gaussian in 0..gaussians.count {
                let [stored] = gaussians.get(gaussian, ROUGHNESS);
                gaussians.set(gaussian, ROUGHNESS, [logit(sigmoid(stored) + 1e-3)]);
            }
        }
        let mut colors = Naive.shade(&gaussians, &camera, splats, light, rules)?;
        if self.has(Fault::NanLetThrough) {
            *splats = before;
        }
        if self.has(Fault::LostDepth) {
            let depth = colors.channels.index_of(channel::DEPTH);
            depth.into_iter().for_each(|depth| colors.values.iter_mut().for_each(|values| values[depth] = 0.0));
        }
        Ok(colors)
    }

    fn bin(&mut self, splats: &Self::Splats, camera: &Camera) -> Result<Vec<usize>, NaiveError> {
        let mut order = Naive.bin(splats, camera)?;
        match self.fault {
            Fault::WrongOrder => order.reverse(),
            Fault::WrongTies => {
                order.reverse();
                order.sort_by(|a, b| splats[*a].depth.total_cmp(&splats[*b].depth));
            }
            _ => {}
        }
        Ok(order)
    }

    fn blend(
        &mut self,
        splats: &Self::Splats,
        colors: &Colors,
        tiles: &Vec<usize>,
        camera: &Camera,
    ) -> Result<Self::Frame, NaiveError> {
        let mut frame = Naive.blend(splats, colors, tiles, camera)?;
        self.pictures += 1;
        if self.has(Fault::Race) && self.pictures.is_multiple_of(2) {
            frame.values.iter_mut().for_each(|x| *x = x.next_up());
        }
        Ok(frame)
    }

    fn shade_pixels(
        &mut self,
        surface: Self::Frame,
        light: Option<&Light>,
        camera: &Camera,
        rules: &RenderRules,
    ) -> Result<Self::Frame, NaiveError> {
        if self.has(Fault::UnlitBase) && light.is_none() {
            return Ok(surface);
        }
        let mut camera = *camera;
        if self.has(Fault::RaysBeside) {
            camera.principal_px[0] += 0.01;
        }
        Naive.shade_pixels(surface, light, &camera, rules)
    }
}

/// Checks a requirement that a fault must miss, and one that it does not touch.
#[track_caller]
fn assert_misses(fault: Fault, missed: &str, met: &str) {
    let make = || Mutant { fault, pictures: 0 };
    let subject = Subject::new(&make);
    let check = |name: &str| {
        let all = renderer::renderer_requirements::<Mutant>();
        let (_, check) = all.into_iter().find(|(own, _)| *own == name).expect("a requirement of that name");
        check(&subject)
    };
    let result = check(missed);
    println!("{fault:?}: {result:?}");
    assert!(result.is_err(), "{fault:?} meets {missed}");
    assert_eq!(check(met), Ok(()), "{fault:?} misses {met}");
}

const ARRAYS: &str = "arrays_come_back_unchanged";
const BUFFERS: &str = "buffers_of_another_length_are_refused";
const PROJECTION: &str = "gaussians_are_projected_to_their_place_and_shape";
const ORDER: &str = "splats_are_blended_front_to_back_and_ties_in_their_order";
const PLAIN: &str = "plain_gaussians_have_the_pictures_of_the_reference";
const LIGHT_OF_GAUSSIANS: &str = "light_of_gaussians_is_filtered_and_looked_up";
const LIGHT_OF_PIXELS: &str = "light_of_pixels_is_filtered_and_looked_up";
const PLACE: &str = "light_is_looked_up_in_its_place";
const LIMIT: &str = "opaque_splats_pass_a_hundredth_of_the_light";
const UNLIT: &str = "pixels_without_light_keep_their_base_and_materials_are_black";
const NONFINITE: &str = "nonfinite_gaussians_are_left_out_to_the_last_bit";
const SAME_BITS: &str = "pictures_are_the_same_bits_every_time";
const LAMPS: &str = "lamps_shine_or_are_refused_by_name";

#[test]
fn numbers_that_lose_digits_are_found() {
    assert_misses(Fault::RoundedArrays, ARRAYS, BUFFERS);
}

#[test]
fn a_short_buffer_that_is_filled_is_found() {
    assert_misses(Fault::ShortBuffer, BUFFERS, ARRAYS);
}

#[test]
fn an_opacity_that_is_off_by_a_thousandth_is_found() {
    assert_misses(Fault::FormulaOff, PLAIN, SAME_BITS);
}

#[test]
fn swapped_axes_are_found() {
    assert_misses(Fault::SwappedAxis, PROJECTION, SAME_BITS);
}

#[test]
fn a_shift_by_half_a_pixel_is_found() {
    assert_misses(Fault::HalfPixelShift, PROJECTION, SAME_BITS);
}

#[test]
fn numbers_that_are_not_finite_and_drawn_are_found() {
    assert_misses(Fault::NanLetThrough, NONFINITE, PLAIN);
}

#[test]
fn lost_depths_are_found() {
    assert_misses(Fault::LostDepth, PLAIN, ORDER);
}

#[test]
fn a_reversed_order_is_found() {
    assert_misses(Fault::WrongOrder, ORDER, PROJECTION);
}

#[test]
fn reversed_ties_are_found() {
    assert_misses(Fault::WrongTies, ORDER, PROJECTION);
}

#[test]
fn a_shift_by_half_a_texel_is_found() {
    assert_misses(Fault::HalfTexelShift, LIGHT_OF_GAUSSIANS, PLAIN);
}

#[test]
fn a_level_that_is_too_blurred_is_found() {
    assert_misses(Fault::WrongLevel, LIGHT_OF_PIXELS, PLAIN);
}

#[test]
fn a_lower_limit_of_alpha_is_found() {
    assert_misses(Fault::LowerLimit, LIMIT, PLAIN);
}

#[test]
fn lookups_beside_their_place_are_found() {
    assert_misses(Fault::TurnedLight, PLACE, PLAIN);
    assert_misses(Fault::RoughnessOff, PLACE, PLAIN);
    assert_misses(Fault::RaysBeside, PLACE, PLAIN);
}

#[test]
fn materials_that_shine_without_light_are_found() {
    assert_misses(Fault::UnlitBase, UNLIT, LIGHT_OF_PIXELS);
}

#[test]
fn a_race_is_found() {
    assert_misses(Fault::Race, SAME_BITS, PLAIN);
}

#[test]
fn lamps_that_are_ignored_are_found() {
    assert_misses(Fault::SilentLamps, LAMPS, LIGHT_OF_PIXELS);
}
