//! Pictures: rounding, masks, colour maps, montages, animations.

use image::{AnimationDecoder, ImageReader, Rgb, RgbImage, codecs};
use specula_io::{
    latlong::{self, LatLong},
    picture::{self, Panel},
    pixels::Pixels,
    planes,
};
use std::{
    fs::File,
    io::{BufReader, Write},
    path::Path,
};

fn pixels(path: &Path) -> Vec<u8> {
    ImageReader::open(path).unwrap().decode().unwrap().into_rgba8().into_raw()
}

#[test]
fn colours_are_rounded_to_nearest_and_cut_off() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let planes = [0.5, -1.0, 0.25, 7.0, 0.75, f32::NAN];
    picture::write_rgb(&path, 2, 1, &planes, None).unwrap();
    assert_eq!(pixels(&path), [128, 64, 191, 255, 0, 255, 0, 255]);
    picture::write_rgb(&path, 2, 1, &planes, Some(&[0.5, 0.0])).unwrap();
    assert_eq!(pixels(&path), [128, 64, 191, 128, 0, 255, 0, 0]);
}

#[test]
fn eight_bit_images_survive_a_round_trip() {
    let bytes: Vec<f32> = (0..=255).map(|byte| byte as f32 / 255.0).collect();
    let image = picture::rgb(256, 1, &[&bytes[..], &bytes, &bytes].concat());
    assert!(image.pixels().enumerate().all(|(i, pixel)| pixel.0 == [i as u8; 3]));
}

#[test]
fn gray_is_written_as_gray() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    picture::write_gray(&path, 2, 1, &[0.2, 1.0]).unwrap();
    assert_eq!(pixels(&path), [51, 51, 51, 255, 255, 255, 255, 255]);
}

#[test]
fn normals_are_masked_by_coverage() {
    let image = picture::normals(2, 1, &[1.0, 1.0, 0.0, 0.0, -1.0, -1.0], &[1.0, 0.5]);
    assert_eq!(image.as_raw()[..], [255, 128, 0, 128, 128, 128]);
}

#[test]
fn depths_span_the_colours_where_there_is_coverage() {
    let image = picture::depth(4, 1, &[2.0, 3.0, 99.0, 2.5], &[1.0, 0.9, 0.1, 0.0]);
    let color = |x| image.get_pixel(x, 0).0;
    assert_eq!([color(2), color(3)], [[0; 3]; 2]);
    assert_eq!(color(0), colorous::TURBO.eval_continuous(1.0).into_array());
    assert_eq!(color(1), colorous::TURBO.eval_continuous(0.0).into_array());
}

#[test]
fn depths_without_coverage_or_of_one_value_are_drawn() {
    assert!(picture::depth(2, 1, &[1.0, 2.0], &[0.0; 2]).as_raw().iter().all(|byte| *byte == 0));
    let flat = picture::depth(2, 1, &[1.0; 2], &[1.0; 2]);
    assert_eq!(flat.get_pixel(0, 0), flat.get_pixel(1, 0));
}

#[test]
fn equal_images_have_no_error_and_others_have() {
    let (a, b) = (RgbImage::from_pixel(2, 2, Rgb([10, 20, 30])), RgbImage::from_pixel(2, 2, Rgb([10, 200, 30])));
    let dark = picture::error_map(&a, &a, 0.1);
    assert!(dark.as_raw().iter().all(|byte| *byte < 5), "{dark:?}");
    assert!(picture::error_map(&a, &b, 0.1).as_raw().iter().any(|byte| *byte > 200));
}

#[test]
fn light_is_previewed_in_srgb() {
    let map = LatLong { width: 2, height: 1, rgb: vec![0.0, 0.216, 1.0, 0.002, 50.0, 1.0] };
    assert_eq!(picture::tone_map_latlong(&map).as_raw()[..], [0, 128, 255, 7, 255, 255]);
}

#[test]
fn a_montage_holds_all_of_its_images() {
    let panel = |color| Panel::new(RgbImage::from_pixel(100, 50, Rgb(color)), "ours ±2 π");
    let sheet = picture::montage(&[vec![panel([200, 0, 0]), panel([0, 200, 0])], vec![panel([0, 0, 200])]]);
    for color in [[200, 0, 0], [0, 200, 0], [0, 0, 200]] {
        assert_eq!(sheet.pixels().filter(|pixel| pixel.0 == color).count(), 5000);
    }
    assert!(sheet.pixels().any(|pixel| pixel.0 == [30; 3]), "no letter was drawn");
}

#[test]
fn without_captions_no_room_is_left_for_them() {
    let image = RgbImage::from_pixel(10, 5, Rgb([1, 2, 3]));
    assert_eq!(picture::side_by_side(&[image.clone(), image]).dimensions(), (24, 5));
}

#[test]
fn a_long_caption_on_a_small_image_is_cut() {
    let sheet = picture::montage(&[vec![Panel::new(RgbImage::new(20, 5), "far too long for this")]]);
    assert_eq!(sheet.width(), 20);
}

#[test]
fn animations_play_every_frame() {
    let folder = tempfile::tempdir().unwrap();
    let frames: Vec<RgbImage> = (0..5).map(|i| RgbImage::from_pixel(16, 8, Rgb([50 * i, 100, 7]))).collect();
    let (apng, gif) = (folder.path().join("a.png"), folder.path().join("a.gif"));
    picture::write_animation(&apng, &frames, 40).unwrap();
    picture::write_animation(&gif, &frames, 40).unwrap();

    let open = |path| BufReader::new(File::open(path).unwrap());
    let decoder = codecs::png::PngDecoder::new(open(&apng)).unwrap();
    let exact = decoder.apng().unwrap().into_frames().collect_frames().unwrap();
    assert_eq!(exact.len(), 5);
    assert_eq!(exact[3].buffer().get_pixel(0, 0).0, [150, 100, 7, 255]);
    assert_eq!(exact[3].delay().numer_denom_ms(), (40, 1));
    let decoder = codecs::gif::GifDecoder::new(open(&gif)).unwrap();
    assert_eq!(decoder.into_frames().collect_frames().unwrap().len(), 5);

    let sentence = picture::write_animation(&folder.path().join("a.mp4"), &frames, 40).unwrap_err().to_string();
    assert!(sentence.contains("a.mp4") && sentence.contains(".gif"), "{sentence}");
}

#[test]
fn an_animation_of_transparent_frames_is_transparent() {
    let folder = tempfile::tempdir().unwrap();
    let frames = [40_u8, 200].map(|alpha| image::RgbaImage::from_pixel(4, 4, image::Rgba([250, 100, 7, alpha])));
    let apng = folder.path().join("a.png");
    picture::write_animation(&apng, &frames, 40).unwrap();
    let decoder = codecs::png::PngDecoder::new(BufReader::new(File::open(&apng).unwrap())).unwrap();
    let read = decoder.apng().unwrap().into_frames().collect_frames().unwrap();
    let alphas: Vec<u8> = read.iter().map(|frame| frame.buffer().get_pixel(1, 1).0[3]).collect();
    assert_eq!(alphas, [40, 200]);
}

#[test]
fn numbers_are_read_back_to_the_bit_by_the_name_of_their_channel() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("depth.exr");
    let depths = vec![0.1, 3.5e9, f32::INFINITY, -0.0, 1e-30, 2.0];
    let shares: Vec<f32> = (0..6).map(|k| k as f32 / 5.0).collect();
    planes::write_exr(&path, 3, 2, vec![("Z", depths.clone()), ("A", shares.clone())]).unwrap();
    let read = exr::prelude::read_first_flat_layer_from_file(&path).unwrap().layer_data;
    assert_eq!([read.size.width(), read.size.height()], [3, 2]);
    let channel = |name: &str| -> Vec<f32> {
        let found = read.channel_data.list.iter().find(|channel| channel.name.eq(name)).expect("the channel is named");
        found.sample_data.values_as_f32().collect()
    };
    assert_eq!([channel("Z"), channel("A")], [depths, shares]);

    let nowhere = folder.path().join("a file").join("depth.exr");
    std::fs::write(folder.path().join("a file"), "").unwrap();
    let sentence = planes::write_exr(&nowhere, 1, 1, vec![("Z", vec![1.0])]).unwrap_err().to_string();
    assert!(sentence.contains("depth.exr"), "{sentence}");
}

#[test]
fn pictures_are_packed_in_memory_exactly_or_nearly() {
    let image = RgbImage::from_fn(40, 24, |x, y| Rgb([6 * x as u8, 10 * y as u8, 99]));
    let exactly = image::load_from_memory(&picture::to_png(&image)).unwrap().to_rgb8();
    assert!(exactly == image, "PNG loses nothing");
    let [well, badly] = [95, 20].map(|quality| picture::to_jpeg(&image, quality));
    assert!(badly.len() < well.len(), "less quality takes less room");
    let nearly = image::load_from_memory(&well).unwrap().to_rgb8();
    assert!(nearly.iter().zip(image.iter()).all(|(a, b)| a.abs_diff(*b) < 12), "JPEG loses little");
}

/// A PNG of which there is only the header.
fn put_header(path: &Path, width: u32, height: u32, color: png::ColorType, depth: png::BitDepth) {
    let mut encoder = png::Encoder::new(File::create(path).unwrap(), width, height);
    encoder.set_color(color);
    encoder.set_depth(depth);
    encoder.write_header().unwrap().write_chunk(png::chunk::IDAT, &[]).unwrap();
}

#[test]
fn what_a_picture_becomes_counts_and_not_what_it_is() {
    use png::{BitDepth::*, ColorType::*};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    // Bytes of a pixel: 10 of a grey one that becomes a photograph, 24 of one that becomes light.
    for (width, height, color, depth, is_granted) in [
        (20_000, 20_000, Grayscale, Eight, false),
        (20_000, 20_000, Grayscale, One, false),
        (9000, 9000, Grayscale, Eight, true),
        (9000, 9000, Rgba, Sixteen, false),
        (6000, 6000, Rgba, Sixteen, true),
    ] {
        put_header(&path, width, height, color, depth);
        let refusals = [Pixels::read(&path).map(drop), latlong::read(&path).map(drop)];
        let sentence = refusals[0].as_ref().unwrap_err().to_string();
        assert_eq!(!sentence.contains("the limit of 896 MiB"), is_granted, "{sentence}");
        let sentence = refusals[1].as_ref().unwrap_err().to_string();
        assert_eq!(sentence.contains("the limit of 896 MiB"), width > 6000, "{sentence}");
        assert!(sentence.contains("a.png"), "{sentence}");
    }
}

/// A progressive JPEG without anything but scans.
#[test]
fn a_jpeg_of_many_scans_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.jpg");
    let frame = [0xff, 0xc2, 0, 11, 8, 31, 64, 31, 64, 1, 1, 0x11, 0];
    let scan = [0xff, 0xda, 0, 8, 1, 1, 0, 1, 63, 0];
    for (scans, is_refused) in [(100, false), (101, true)] {
        std::fs::write(&path, [&[0xff, 0xd8][..], &frame, &scan.repeat(scans), &[0xff, 0xd9]].concat()).unwrap();
        let sentence = Pixels::read(&path).map(drop).unwrap_err().to_string();
        assert_eq!(sentence.contains("it has 101 scans"), is_refused, "{sentence}");
    }
}

/// A profile of colours that unpacks to far more than its picture is not unpacked; the picture is
/// read.
#[test]
fn profiles_are_not_unpacked_without_end() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    picture::write_gray(&path, 2, 1, &[0.2, 1.0]).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let mut packed = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    (0..128).for_each(|_| packed.write_all(&vec![0; 1 << 20]).unwrap());
    let inside = [b"iCCPn\0\0", &packed.finish().unwrap()[..]].concat();
    let mut sum = flate2::Crc::new();
    sum.update(&inside);
    let len = (inside.len() - 4) as u32;
    let chunk = [&len.to_be_bytes()[..], &inside, &sum.sum().to_be_bytes()].concat();
    // Behind the header of a PNG, which has 33 bytes.
    std::fs::write(&path, [&bytes[..33], &chunk, &bytes[33..]].concat()).unwrap();
    assert_eq!(Pixels::read(&path).unwrap().rgba, [51, 51, 51, 255, 255, 255, 255, 255]);
}
