//! Composition of a pixel's light: each term that it has.

use specula_core::{
    lamps::diffuse_albedo,
    physical::{PixelLight, pixel_color, pixel_facing},
    pixel_light::{BlendedPixel, LightLookups, PixelShading, ShadedPixel},
    rules::{Channels, LightLayer, channel},
    shade::ShadingForm,
    shade_pixels::{pixel_surface, unlit_pixel_color},
    vector::Vec3,
};
use specula_tests::pixels::{GivenLight, GivenPixel, PIXEL_LEN, PixelCase, view_dir};

/// A pixel of every layer, its light, and the case.
fn seen(form: ShadingForm, light_layer: LightLayer, [is_lit, is_traced, is_illuminated]: [bool; 3]) -> Seen {
    let shading = PixelShading { form, light_layer, channels: Channels::Layers };
    let case = PixelCase { shading, is_lit, is_traced, is_illuminated };
    let numbers: Vec<f32> = (0..PIXEL_LEN).map(|k| 0.1 + 0.4 * (k as f32 * 0.7).sin().abs()).collect();
    let (pixel, light) = case.parts(&numbers);
    let (_, far) = PixelCase { is_lit: true, is_traced: true, is_illuminated: true, ..case }.parts(&numbers);
    Seen { shaded: case.shaded(&numbers), pixel, light: far.expect("it is lit"), is_lit: light.is_some() }
}

struct Seen {
    shaded: ShadedPixel<f32>,
    pixel: GivenPixel<f32>,
    /// Light with a reflection and lamps.
    light: GivenLight<f32>,
    is_lit: bool,
}

impl Seen {
    fn layers(&self) -> [Vec3<f32>; 2] {
        [self.shaded.specular, self.shaded.light]
    }
    /// Far light along the reflected direction.
    fn own(&self) -> Vec3<f32> {
        let surface = pixel_surface(&self.pixel.pixel(), view_dir(0.0));
        self.light.look_up(surface.reflection_dir, surface.roughness)
    }
    /// Far light that the surface reflects which the ray hits.
    fn second(&self) -> Vec3<f32> {
        let reflection = self.light.rays.reflection.expect("it was traced");
        self.light.look_up(reflection.direction, reflection.roughness)
    }
}

const FORMS: [ShadingForm; 2] = [ShadingForm::Deferred, ShadingForm::Physical];
const UNLIT: [bool; 3] = [false; 3];
const FAR: [bool; 3] = [true, false, false];
const TRACED: [bool; 3] = [true, true, false];
const LAMPS: [bool; 3] = [true, true, true];

#[test]
fn pixels_without_light_show_their_base_and_physical_ones_are_black() {
    let seen = FORMS.map(|form| seen(form, LightLayer::Reflected, UNLIT));
    assert!(seen.iter().all(|seen| !seen.is_lit));
    let base = seen[0].pixel.vec3(channel::COLOR);
    assert_eq!(seen[0].shaded.color, unlit_pixel_color(base, seen[0].pixel.coverage()));
    assert_eq!(seen[1].shaded.color, Vec3::splat(0.0));
    assert!(seen.iter().all(|seen| seen.layers() == [Vec3::splat(0.0); 2]), "nothing is reflected");
}

#[test]
fn layers_of_light_show_what_they_are_named() {
    for form in FORMS {
        let layer = |layer, light| {
            let seen = seen(form, layer, light);
            (seen.layers()[1], seen)
        };
        let (open, unlit) = layer(LightLayer::Visibility, UNLIT);
        let coverage = unlit.pixel.coverage();
        assert_eq!(open, Vec3::splat(coverage), "without a light nothing is occluded");
        assert_eq!(layer(LightLayer::Visibility, FAR).0, Vec3::splat(coverage));
        let reflection = unlit.light.rays.reflection.expect("it was traced");
        assert_eq!(layer(LightLayer::Visibility, TRACED).0, Vec3::splat(reflection.far * coverage));
        let (reflected, far) = layer(LightLayer::Reflected, FAR);
        assert_eq!(reflected, far.own() * coverage);
        let (reflected, traced) = layer(LightLayer::Reflected, TRACED);
        assert_eq!(reflected, reflection.light(traced.own(), traced.second()) * coverage);
        assert_eq!(layer(LightLayer::Indirect, FAR).0, Vec3::splat(0.0));
        assert_eq!(layer(LightLayer::Indirect, TRACED).0, reflection.indirect(traced.second()) * coverage);
    }
}

#[test]
fn only_physical_materials_show_irradiance() {
    assert_eq!(seen(ShadingForm::Deferred, LightLayer::Irradiance, TRACED).layers()[1], Vec3::splat(0.0));
    let [far, lamps] = [FAR, LAMPS].map(|light| seen(ShadingForm::Physical, LightLayer::Irradiance, light));
    let facing = pixel_facing(&far.pixel.pixel(), view_dir(0.0));
    let sky = far.light.look_up_irradiance(facing.normal) * far.pixel.channel(channel::AMBIENT);
    assert_eq!(far.layers()[1], sky);
    let direct = lamps.light.rays.direct.expect("lamps shine");
    assert_eq!(lamps.layers()[1], sky + direct.irradiance * lamps.pixel.coverage());
}

#[test]
fn lamps_add_to_the_light_of_physical_materials() {
    let [without, with] = [TRACED, LAMPS].map(|light| seen(ShadingForm::Physical, LightLayer::Reflected, light));
    let (pixel, coverage) = (with.pixel.pixel(), with.pixel.coverage());
    let (surface, facing) = (pixel_surface(&pixel, view_dir(0.0)), pixel_facing(&pixel, view_dir(0.0)));
    let light = PixelLight {
        specular: with.light.rays.reflection.expect("it was traced").light(with.own(), with.second()),
        irradiance: with.light.look_up_irradiance(facing.normal),
        split_sum: with.light.split_sum(facing.n_dot_v, surface.roughness),
    };
    assert_eq!(without.shaded.color, pixel_color(&surface, &light, coverage));
    let albedo = diffuse_albedo(with.pixel.vec3(channel::DIFFUSE), with.pixel.channel(channel::METALNESS), coverage);
    let direct = with.light.rays.direct.expect("lamps shine");
    assert_eq!(with.shaded.color, specula_core::lamps::pixel_color(&surface, &light, albedo, &direct, coverage));
    assert_eq!(with.layers()[0], without.layers()[0], "the specular layer is without them");
}

#[test]
fn layers_are_composed_only_if_they_were_blended() {
    let (numbers, none) = (vec![0.3_f32; PIXEL_LEN], Vec3::splat(0.0));
    for case in PixelCase::all() {
        let shading = PixelShading { channels: Channels::Surface, ..case.shading };
        let [some, all] = [PixelCase { shading, ..case }, case].map(|case| case.shaded(&numbers));
        assert_eq!((some.color, some.specular, some.light), (all.color, none, none));
    }
}
