//! Light: files, what is no radiance in them, and the way from lat-long maps to cubes and back.

use core::f64::consts::PI;
use exr::{
    meta::attribute::Chromaticities,
    prelude::{
        AnyChannel, AnyChannels, Encoding, FlatSamples, Image, ImageAttributes, IntegerBounds, Layer, LayerAttributes,
        Vec2, WritableImage, f16,
    },
};
use image::{ExtendedColorType, ImageEncoder, Rgb, RgbImage, codecs::openexr::OpenExrEncoder};
use specula_core::cubemap::{solid_angles, texel_direction, texel_index};
use specula_io::{
    Input,
    latlong::{self, Cleaned, LatLong, UpAxis},
};
use std::{fs, io::Cursor, path::Path};

const AXES: [UpAxis; 2] = [UpAxis::Z, UpAxis::Y];

fn map(width: usize, height: usize, color: impl Fn(f64, f64) -> [f32; 3]) -> LatLong {
    let place = |i: usize| ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
    let rgb = (0..width * height).flat_map(|i| color(place(i).0 / width as f64, place(i).1 / height as f64));
    LatLong { width, height, rgb: rgb.collect() }
}

/// Smooth, positive, without symmetry.
fn smooth(direction: [f64; 3]) -> [f32; 3] {
    let [x, y, z] = direction;
    [1.5 + x, 1.5 + y * x, 2.0 + z + 0.5 * y].map(|value: f64| value as f32)
}

fn energy_of_map(map: &LatLong) -> f64 {
    let pixel = 2.0 * PI * PI / (map.width * map.height) as f64;
    let row = |(index, red): (usize, f32)| {
        let polar = PI * ((index / map.width) as f64 + 0.5) / map.height as f64;
        f64::from(red) * polar.sin() * pixel
    };
    map.rgb.chunks(3).map(|rgb| rgb[0]).enumerate().map(row).sum()
}

fn energy_of_cube(values: &[f32], resolution: usize) -> f64 {
    values.chunks(3).zip(solid_angles(resolution)).map(|(rgb, angle)| f64::from(rgb[0]) * angle).sum()
}

fn assert_near(a: f32, b: f32, tolerance: f32, what: &str) {
    assert!((a - b).abs() <= tolerance, "{what}: {a} and {b}");
}

#[test]
fn axes_appear_where_the_conventions_say() {
    let near = |a: [f64; 2], b: [f64; 2]| assert!((a[0] - b[0]).abs() + (a[1] - b[1]).abs() < 1e-12, "{a:?} {b:?}");
    near(UpAxis::Z.uv([1.0, 0.0, 0.0]), [0.5, 0.5]);
    near(UpAxis::Z.uv([0.0, 1.0, 0.0]), [0.25, 0.5]);
    near(UpAxis::Z.uv([0.0, 0.0, 3.0]), [0.5, 0.0]);
    near(UpAxis::Y.uv([0.0, 0.0, -1.0]), [0.5, 0.5]);
    near(UpAxis::Y.uv([2.0, 0.0, 0.0]), [0.75, 0.5]);
    near(UpAxis::Y.uv([0.0, -1.0, -1e-13]), [0.5, 1.0]);
}

#[test]
fn direction_inverts_place() {
    for up in AXES {
        for direction in [[0.6, 0.0, 0.8], [-0.48, 0.6, 0.64], [0.36, -0.48, -0.8], [-0.6, -0.64, -0.48]] {
            let back = up.direction(up.uv(direction));
            assert!((0..3).all(|k| (back[k] - direction[k]).abs() < 1e-12), "{back:?} {direction:?}");
        }
    }
}

#[test]
fn a_texel_shows_what_lies_in_its_direction() {
    const RESOLUTION: usize = 16;
    for up in AXES {
        let lat_long = map(256, 128, |u, v| smooth(up.direction([u, v])));
        let cube = latlong::to_cube(&lat_long, RESOLUTION, up);
        for texel in 0..6 * RESOLUTION * RESOLUTION {
            let (face, row, column) = (texel / 256, texel % 256 / RESOLUTION, texel % RESOLUTION);
            let expected = smooth(texel_direction(face, column, row, RESOLUTION));
            let start = 3 * texel_index(face, column, row, RESOLUTION);
            for k in 0..3 {
                assert_near(cube[start + k], expected[k], 0.01, &format!("{up:?} texel {texel} channel {k}"));
            }
        }
    }
}

#[test]
fn a_constant_stays_constant_both_ways() {
    let cube = latlong::to_cube(&map(30, 10, |_, _| [0.7; 3]), 8, UpAxis::Z);
    assert!(cube.iter().all(|value| (value - 0.7).abs() < 1e-6));
    let back = latlong::from_cube(&cube, 8, 20, 10, UpAxis::Y);
    assert!(back.rgb.iter().all(|value| (value - 0.7).abs() < 1e-6));
}

#[test]
fn a_map_survives_the_way_to_a_cube_and_back() {
    for up in AXES {
        let before = map(64, 32, |u, v| smooth(up.direction([u, v])));
        let after = latlong::from_cube(&latlong::to_cube(&before, 64, up), 64, 64, 32, up);
        for (i, (a, b)) in before.rgb.iter().zip(&after.rgb).enumerate() {
            // At a pole the mean over a pixel is nearer to the horizon than its centre.
            assert_near(*a, *b, 0.02, &format!("{up:?} number {i}"));
        }
    }
}

#[test]
fn a_sun_of_one_pixel_keeps_its_energy() {
    // From finer than the cube to coarser, near the horizon, half way up, and across the seam of
    // the map.
    for (width, resolution) in [(512, 16), (256, 32), (256, 64), (64, 32)] {
        for (column, row) in [(width / 3, width / 4), (width / 7, width / 8), (0, width / 5), (width - 1, width / 3)] {
            let mut sun = map(width, width / 2, |_, _| [0.0; 3]);
            sun.rgb[3 * (row * width + column)] = 50_000.0;
            let cube = latlong::to_cube(&sun, resolution, UpAxis::Z);
            let ratio = energy_of_cube(&cube, resolution) / energy_of_map(&sun);
            assert!((ratio - 1.0).abs() < 0.01, "{width} to {resolution}, pixel {column}, {row}: {ratio}");
        }
    }
}

#[test]
fn a_bright_texel_keeps_its_energy_on_the_way_back() {
    let mut cube = vec![0.0; 18 * 64 * 64];
    cube[3 * texel_index(2, 20, 40, 64)] = 1000.0;
    let map = latlong::from_cube(&cube, 64, 64, 32, UpAxis::Z);
    let ratio = energy_of_map(&map) / energy_of_cube(&cube, 64);
    // Away from a face's centre texels are smaller, and samples fewer for each.
    assert!((ratio - 1.0).abs() < 0.02, "{ratio}");
}

#[test]
fn one_look_up_a_texel_loses_a_small_sun() {
    let mut sun = map(512, 256, |_, _| [0.0; 3]);
    sun.rgb[3 * (100 * 512 + 171)] = 50_000.0;
    let ratio = energy_of_cube(&latlong::to_cube_bilinear(&sun, 16, UpAxis::Z), 16) / energy_of_map(&sun);
    assert!((ratio - 1.0).abs() > 0.1, "the test above could not fail: {ratio}");
}

#[test]
fn exr_is_lossless_and_hdr_nearly() {
    let folder = tempfile::tempdir().unwrap();
    let before = map(32, 16, |u, v| [u as f32 * 1e4, (v as f32).powi(8), (u * v) as f32]);
    for (name, tolerance) in [("a.exr", 0.0), ("a.hdr", 1.0 / 256.0)] {
        let path = folder.path().join(name);
        latlong::write(&path, &before).unwrap();
        let (after, cleaned) = latlong::read(&path).unwrap();
        assert_eq!((after.width, after.height, cleaned.total()), (32, 16, 0));
        for (a, b) in before.rgb.chunks(3).zip(after.rgb.chunks(3)) {
            let largest = a[0].max(a[1]).max(a[2]);
            assert!((0..3).all(|k| (a[k] - b[k]).abs() <= tolerance * largest), "{name}: {a:?} {b:?}");
        }
    }
}

#[test]
fn hdr_rounds_to_nearest_and_is_stable() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.hdr");
    let before = map(64, 32, |u, v| [(u * 2.9) as f32, (v + 0.1) as f32, 1.0]);
    latlong::write(&path, &before).unwrap();
    let once = latlong::read(&path).unwrap().0;
    latlong::write(&path, &once).unwrap();
    assert_eq!(latlong::read(&path).unwrap().0, once);
    let mean = |map: &LatLong| map.rgb.iter().map(|value| f64::from(*value)).sum::<f64>();
    assert!((mean(&once) / mean(&before) - 1.0).abs() < 2e-4, "{} {}", mean(&once), mean(&before));
}

fn put_exr(path: &Path, width: u32, height: u32, rgb: &[f32]) {
    let bytes: Vec<u8> = rgb.iter().flat_map(|value| value.to_ne_bytes()).collect();
    let file = fs::File::create(path).unwrap();
    OpenExrEncoder::new(file).write_image(&bytes, width, height, ExtendedColorType::Rgb32F).unwrap();
}

#[test]
fn what_is_no_radiance_is_replaced_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    put_exr(&path, 2, 1, &[f32::NAN, f32::INFINITY, -2.0, f32::NEG_INFINITY, 3.0, 0.5]);
    let (map, cleaned) = latlong::read(&path).unwrap();
    assert_eq!(map.rgb, [0.0, 65504.0, 0.0, 0.0, 3.0, 0.5]);
    assert_eq!(cleaned, Cleaned { nan: 1, infinite: 1, negative: 2 });

    put_exr(&path, 2, 1, &[1e6, f32::INFINITY, 0.0, 0.0, 0.0, 0.0]);
    assert_eq!(latlong::read(&path).unwrap().0.rgb[1], 1e6);
}

#[test]
fn an_infinite_map_can_be_written_as_hdr() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.hdr");
    latlong::write(&path, &LatLong { width: 2, height: 1, rgb: vec![f32::INFINITY, f32::NAN, -1.0, 0.0, 1e-45, 2.0] })
        .unwrap();
    let (map, cleaned) = latlong::read(&path).unwrap();
    assert!(map.rgb[0] > 9e37 && map.rgb[1..5] == [0.0; 4] && map.rgb[5] == 2.0, "{:?}", map.rgb);
    assert_eq!(cleaned.total(), 0);
}

#[test]
fn eight_bit_images_are_decoded_from_srgb() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    RgbImage::from_pixel(2, 1, Rgb([0, 188, 255])).save(&path).unwrap();
    let map = latlong::read(&path).unwrap().0;
    assert_eq!([map.rgb[0], map.rgb[2]], [0.0, 1.0]);
    assert_near(map.rgb[1], 0.5029, 1e-4, "sRGB 188");
}

#[test]
fn the_content_of_a_file_counts_and_not_its_name() {
    let folder = tempfile::tempdir().unwrap();
    let (hdr, exr) = (folder.path().join("a.hdr"), folder.path().join("a.exr"));
    latlong::write(&hdr, &map(4, 2, |_, _| [2.0; 3])).unwrap();
    fs::rename(&hdr, &exr).unwrap();
    assert_eq!(latlong::read(&exr).unwrap().0.rgb, [2.0; 24]);
}

#[test]
fn radiance_files_of_other_tools_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.hdr");
    latlong::write(&path, &map(4, 2, |_, _| [2.0; 3])).unwrap();
    let bytes = fs::read(&path).unwrap();
    fs::write(&path, [b"#?RGBE", &bytes["#?RADIANCE".len()..]].concat()).unwrap();
    assert_eq!(latlong::read(&path).unwrap().0.rgb, [2.0; 24]);
}

#[test]
fn an_image_without_pixels_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.hdr");
    fs::write(&path, "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 0 +X 0\n").unwrap();
    let sentence = latlong::read(&path).unwrap_err().to_string();
    assert!(sentence.contains("a.hdr") && sentence.contains("no pixels"), "{sentence}");
}

#[test]
fn a_cube_survives_as_exr_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let values: Vec<f32> = (0..18 * 25).map(|i| (i as f32 - 100.0).powi(3) * 1.000_123).collect();
    latlong::write_cube_exr(&path, &values, 5).unwrap();
    assert_eq!(latlong::read_cube_exr(&path).unwrap(), (values, 5));
}

#[test]
fn what_cannot_be_light_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    latlong::write(&path, &map(4, 2, |_, _| [1.0; 3])).unwrap();
    let sentence = latlong::read_cube_exr(&path).unwrap_err().to_string();
    assert!(sentence.contains("a.exr") && sentence.contains("4 by 2") && sentence.contains("six"), "{sentence}");

    fs::write(&path, "neither").unwrap();
    let sentence = latlong::read(&path).unwrap_err().to_string();
    assert!(sentence.contains("cannot decode") && sentence.contains("a.exr"), "{sentence}");

    let sentence = latlong::read(&folder.path().join("no.hdr")).unwrap_err().to_string();
    assert!(sentence.contains("cannot read") && sentence.contains("no.hdr"), "{sentence}");

    let sentence = latlong::write(&folder.path().join("a.tiff"), &map(4, 2, |_, _| [1.0; 3])).unwrap_err().to_string();
    assert!(sentence.contains("a.tiff") && sentence.contains(".hdr or .exr"), "{sentence}");
}

#[test]
fn a_turned_light_has_above_what_it_had_above() {
    let resolution = 4;
    let values: Vec<f32> =
        (0..96).flat_map(|k| smooth(texel_direction(k / 16, k % 4, k / 4 % 4, resolution))).collect();
    let turned = latlong::y_up_from_z_up(&values, resolution);
    for (k, texel) in turned.chunks_exact(3).enumerate() {
        let [x, y, z] = texel_direction(k / 16, k % 4, k / 4 % 4, resolution);
        for (found, expected) in texel.iter().zip(smooth([x, -z, y])) {
            assert_near(*found, expected, 1e-6, "what came from (x, −z, y) comes from (x, y, z)");
        }
    }
}

#[test]
fn a_light_turned_about_an_axis_comes_from_turned_directions() {
    const RESOLUTION: usize = 32;
    let direction = |k: usize| {
        let size = RESOLUTION * RESOLUTION;
        texel_direction(k / size, k % RESOLUTION, k / RESOLUTION % RESOLUTION, RESOLUTION)
    };
    let values: Vec<f32> = (0..6 * RESOLUTION * RESOLUTION).flat_map(|k| smooth(direction(k))).collect();
    assert_eq!(latlong::rotated(&values, RESOLUTION, [0.0, 0.0, 1.0], 0.0), values, "no turn changes no bit");
    let quarter = latlong::rotated(&values, RESOLUTION, [0.0, 0.0, 1.0], core::f64::consts::FRAC_PI_2);
    for (k, texel) in quarter.chunks_exact(3).enumerate() {
        // Counterclockwise, seen from above: x goes to y.
        let [x, y, z] = direction(k);
        for (found, expected) in texel.iter().zip(smooth([y, -x, z])) {
            assert_near(*found, expected, 1e-2, "what came from (y, −x, z) comes from (x, y, z)");
        }
    }
}

/// Bytes of an OpenEXR file of 2 by 1 pixels with channels of these names and kinds, whose numbers
/// are 1, 2, 3 … from channel to channel, and 8 in the second pixel.
fn exr_of(layers: &[(&str, &[&str])], samples: fn(Vec<f32>) -> FlatSamples) -> Vec<u8> {
    let mut number = 0.0;
    let layer = |(part, names): &(&str, &[&str])| {
        let channels = names.iter().map(|name| {
            number += 1.0;
            AnyChannel::new(*name, samples(vec![number, 8.0]))
        });
        let channels = AnyChannels::sort(channels.collect());
        Layer::new((2, 1), LayerAttributes::named(*part), Encoding::SMALL_LOSSLESS, channels)
    };
    let layers: Vec<_> = layers.iter().map(layer).collect();
    let mut bytes = Cursor::new(Vec::new());
    Image::from_layers(ImageAttributes::new(IntegerBounds::from_dimensions((2, 1))), layers)
        .write()
        .to_buffered(&mut bytes)
        .unwrap();
    bytes.into_inner()
}

#[test]
fn colours_of_openexr_are_found_by_the_names_of_channels() {
    let float: fn(Vec<f32>) -> FlatSamples = FlatSamples::F32;
    let half: fn(Vec<f32>) -> FlatSamples = |n| FlatSamples::F16(n.into_iter().map(f16::from_f32).collect());
    let whole: fn(Vec<f32>) -> FlatSamples = |n| FlatSamples::U32(n.into_iter().map(|x| x as u32).collect());
    let blender: &[&str] = &["V.Depth.Z", "V.Combined.R", "V.Combined.G", "V.Combined.B", "V.Combined.A", "V.Mist.Z"];
    for (layers, samples, expected, is_noted) in [
        (&[("", &["R", "G", "B"][..])][..], float, [1.0, 2.0, 3.0], false),
        (&[("", &["r", "g", "b", "a"])], half, [1.0, 2.0, 3.0], false),
        (&[("", &["red", "Green", "BLUE"])], whole, [1.0, 2.0, 3.0], false),
        (&[("", &["Y"])], float, [1.0; 3], false),
        (&[("", &["y", "A"])], half, [1.0; 3], false),
        (&[("", blender)], half, [2.0, 3.0, 4.0], false),
        (
            &[("", &["Diffuse.R", "Diffuse.G", "Diffuse.B", "V.Combined.R", "V.Combined.G", "V.Combined.B"])],
            float,
            [4.0, 5.0, 6.0],
            true,
        ),
        (&[("", &["Mask.Y", "Sky.R", "Sky.G", "Sky.B"])], float, [2.0, 3.0, 4.0], true),
        (&[("depth", &["Z"]), ("rgba", &["R", "G", "B"])], float, [2.0, 3.0, 4.0], false),
        (&[("one", &["R", "G", "B"]), ("two", &["R", "G", "B"])], half, [1.0, 2.0, 3.0], true),
    ] {
        let bytes = exr_of(layers, samples);
        let input = Input::memory("a.exr", &bytes);
        let (map, _) = latlong::read_from(input).unwrap();
        assert_eq!((latlong::size(input).unwrap(), &map.rgb[3..]), ([2, 1], &[8.0; 3][..]), "{layers:?}");
        assert_eq!(map.rgb[..3], expected, "{layers:?}");
        assert_eq!(!latlong::notes(input).unwrap().is_empty(), is_noted, "{layers:?}");
    }
    for (names, words) in [(&["Z"][..], "the channels Z"), (&["X", "Y", "Z"], "X, Y, Z"), (&["R", "G"], "G, R")] {
        let sentence =
            latlong::read_from(Input::memory("a.exr", &exr_of(&[("", names)], float))).unwrap_err().to_string();
        assert!(sentence.contains(words), "{sentence}");
    }
}

#[test]
fn other_primaries_of_openexr_are_converted() {
    let channels = AnyChannels::sort(
        ["R", "G", "B"].map(|name| AnyChannel::new(name, FlatSamples::F32(vec![1.0]))).into_iter().collect(),
    );
    let layer = Layer::new((1, 1), LayerAttributes::default(), Encoding::SMALL_LOSSLESS, channels);
    let mut image = Image::from_layer(layer);
    let xy = |x, y| Vec2(x, y);
    // White is white; a colour beyond Rec. 709 has negative red, which no light has.
    let rec_709 = [xy(0.64, 0.33), xy(0.3, 0.6), xy(0.15, 0.06), xy(0.3127, 0.329)];
    let acescg = [xy(0.713, 0.293), xy(0.165, 0.83), xy(0.128, 0.044), xy(0.321_68, 0.337_67)];
    for ([red, green, blue, white], color, expected) in [
        (rec_709, [2.0, 0.5, 0.25], [2.0, 0.5, 0.25]),
        (acescg, [3.0; 3], [3.0; 3]),
        (acescg, [0.25, 1.0, 0.5], [0.0, 1.102_97, 0.441_516]),
    ] {
        image.attributes.chromaticities = Some(Chromaticities { red, green, blue, white });
        image
            .layer_data
            .channel_data
            .list
            .iter_mut()
            .zip([color[2], color[1], color[0]])
            .for_each(|(channel, number)| channel.sample_data = FlatSamples::F32(vec![number]));
        let mut bytes = Cursor::new(Vec::new());
        image.write().to_buffered(&mut bytes).unwrap();
        let bytes = bytes.into_inner();
        let input = Input::memory("a.exr", &bytes);
        let found = latlong::read_from(input).unwrap().0.rgb;
        assert!(found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-4), "{found:?}");
        assert!(latlong::notes(input).unwrap().is_empty());
    }
}

/// Bytes of a `.hdr` of scan lines of RGBE.
fn hdr_of(head: &str, size: &str, pixels: &[[u8; 4]]) -> Vec<u8> {
    [format!("#?RADIANCE\n{head}\n\n{size}\n").as_bytes(), pixels.as_flattened()].concat()
}

#[test]
fn radiance_of_every_orientation_is_upright() {
    // Red counts columns from the left, green rows from the top, in a picture of 3 by 2.
    let pixel = |x: usize, y: usize| [10 * x as u8, 10 * y as u8, 7, 136];
    for size in ["-Y 2 +X 3", "-Y 2 -X 3", "+Y 2 +X 3", "+Y 2 -X 3", "+X 3 -Y 2", "-X 3 -Y 2", "+X 3 +Y 2", "-X 3 +Y 2"]
    {
        let axes: Vec<&str> = size.split(' ').collect();
        let along = |axis: &str, count: usize| -> Vec<usize> {
            let is_back = ["+Y", "-X"].contains(&axis);
            if is_back { (0..count).rev().collect() } else { (0..count).collect() }
        };
        let (lines, row) = (along(axes[0], axes[1].parse().unwrap()), along(axes[2], axes[3].parse().unwrap()));
        let pixels = lines.iter().flat_map(|line| row.iter().map(move |place| (*line, *place)));
        let stored: Vec<[u8; 4]> = pixels
            .map(|(line, place)| if size.contains("X 3 ") { pixel(line, place) } else { pixel(place, line) })
            .collect();
        let bytes = hdr_of("FORMAT=32-bit_rle_rgbe", size, &stored);
        let input = Input::memory("a.hdr", &bytes);
        let (map, _) = latlong::read_from(input).unwrap();
        assert_eq!((map.width, map.height, latlong::size(input).unwrap()), (3, 2, [3, 2]), "{size}");
        for (k, rgb) in map.rgb.chunks(3).enumerate() {
            assert_eq!(rgb, [10.0 * (k % 3) as f32, 10.0 * (k / 3) as f32, 7.0], "{size}, pixel {k}");
        }
    }
    for size in ["", "-Y 2", "-Y 2 +Y 3", "-Y two +X 3", "2 3 4 5"] {
        let sentence = latlong::read_from(Input::memory("a.hdr", &hdr_of("", size, &[]))).unwrap_err().to_string();
        assert!(sentence.contains("a.hdr") && sentence.contains("-Y 512 +X 1024"), "{sentence}");
    }
}

#[test]
fn radiance_in_xyz_becomes_red_green_and_blue() {
    // White, and Radiance's red (x 0.64, y 0.33).
    let bytes = hdr_of("FORMAT=32-bit_rle_xyze", "-Y 1 +X 2", &[[200, 200, 200, 136], [192, 99, 9, 136]]);
    let (map, _) = latlong::read_from(Input::memory("a.hdr", &bytes)).unwrap();
    map.rgb[..3].iter().for_each(|channel| assert_near(*channel, 200.0, 1e-3, "white"));
    assert!(map.rgb[3] > 300.0 && map.rgb[4..].iter().all(|channel| *channel < 1e-3), "{:?}", map.rgb);
    let other = hdr_of("FORMAT=32-bit_rle_luv", "-Y 1 +X 1", &[[1; 4]]);
    let sentence = latlong::read_from(Input::memory("a.hdr", &other)).unwrap_err().to_string();
    assert!(sentence.contains("32-bit_rle_luv"), "{sentence}");
}

#[test]
fn factors_of_a_radiance_header_are_noted() {
    for (head, is_noted) in [
        ("EXPOSURE=1.0000000000000\nPRIMARIES=0.64 0.33 0.29 0.6 0.15 0.06 0.3333 0.3333\nSOFTWARE=x", false),
        ("EXPOSURE=2.5", true),
        ("COLORCORR=1 1 0.9", true),
        ("PRIMARIES=0.713 0.293 0.165 0.83 0.128 0.044 0.3217 0.3377", true),
    ] {
        let bytes = hdr_of(head, "-Y 1 +X 1", &[[1; 4]]);
        let notes = latlong::notes(Input::memory("a.hdr", &bytes)).unwrap();
        assert_eq!(!notes.is_empty(), is_noted, "{notes:?}");
    }
}
