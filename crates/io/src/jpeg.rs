//! JPEGs decoded at a half or a quarter of their size, from the coefficients of their blocks.
//!
//! A block of 8 × 8 pixels is stored as cosine coefficients; the lowest 4 × 4 or 2 × 2 of them give
//! the block at a half or a quarter of the size, sharper than an area average. A picture is
//! therefore decoded at twice the requested size and averaged; the remaining difference is below an
//! 8-bit step.
//!
//! With a factor of 4 a quarter of the pixels are decoded, with 8 a sixteenth, with 2 all of them:
//! on photographs, the lowest cosines by themselves have 42 to 47 dB against the area average, with
//! a final halving by averages at least 49 dB. Masks and rotations need the whole picture.

use crate::{
    budget::{JPEG_SCANS_MAX, PICTURE},
    error::{Error, Result},
    input::Input,
};
use image::{DynamicImage, GrayImage, RgbImage, metadata::Orientation};
use jpeg_decoder::{Decoder, PixelFormat};
use std::{
    io::{self, Read},
    path::Path,
};

/// Maximum bytes per pixel during decoding: a coefficient of two bytes for each of four channels.
const BYTES: u64 = 8;
/// Edge of a block in pixels. Thinner pictures are decoded in full.
const BLOCK: u32 = 8;

/// Decodes a picture at half of `downscale`, and returns it with its full size. Returns `None` if
/// nothing would be saved, and for files for the general decoder: other formats, rotated pictures,
/// colours other than grey or YCbCr, sizes beyond the budget, broken files.
pub(crate) fn decode_smaller(path: &Path, downscale: u32) -> Option<(DynamicImage, [u32; 2])> {
    let side = downscale / 2;
    if side < 2 {
        return None;
    }
    let input = Input::file(path);
    let mut decoder = Decoder::new(input.open().ok()?);
    decoder.read_info().ok()?;
    let info = decoder.info()?;
    let size = [info.width, info.height].map(u32::from);
    let is_upright =
        decoder.exif_data().and_then(Orientation::from_exif_chunk).is_none_or(|turn| turn == Orientation::NoTransforms);
    let is_thin = size.iter().any(|size| *size < BLOCK * downscale);
    let bytes = BYTES * u64::from(size[0]) * u64::from(size[1]);
    if !is_upright || is_thin || refuse_broken_scans(input).is_err() || bytes > PICTURE.of(input.len().ok()?) {
        return None;
    }
    let smaller = size.map(|size| size.div_ceil(side));
    let [width, height] = smaller;
    let found = decoder.scale(width as u16, height as u16).ok()?;
    let pixels = decoder.decode().ok().filter(|_| smaller == [found.0, found.1].map(u32::from))?;
    let image: DynamicImage = match info.pixel_format {
        PixelFormat::RGB24 => RgbImage::from_raw(width, height, pixels)?.into(),
        PixelFormat::L8 => GrayImage::from_raw(width, height, pixels)?.into(),
        PixelFormat::L16 | PixelFormat::CMYK32 => return None,
    };
    Some((image, size))
}

/// Rejects truncated pictures, and pictures with too many scans, since each scan costs a pass over
/// all blocks for a few bytes.
///
/// # Errors
///
/// [`Error::Image`] for a file that ends before the picture, or more than [`JPEG_SCANS_MAX`] scans;
/// [`Error::Read`] for a file that cannot be read.
pub(crate) fn refuse_broken_scans(input: Input<'_>) -> Result<()> {
    let refuse = |cause: String| Err(Error::Image { path: input.path().to_owned(), cause });
    match count_scans(&mut input.open()?) {
        Ok(scans) if scans <= JPEG_SCANS_MAX => Ok(()),
        Ok(scans) => refuse(format!("it has {scans} scans, above the limit of {JPEG_SCANS_MAX}")),
        Err(cause) if cause.kind() == io::ErrorKind::UnexpectedEof => {
            refuse("the file is cut short: it ends before the picture".to_owned())
        }
        Err(cause) => Err(Error::reading(input.path())(cause)),
    }
}

/// Number of scans up to the end of the picture; files may contain more data after it.
fn count_scans(reader: &mut impl Read) -> io::Result<usize> {
    const START: u8 = 0xd8;
    const END: u8 = 0xd9;
    const SCAN: u8 = 0xda;
    const PRIVATE: u8 = 0x01;
    let mut scans = 0;
    loop {
        match next_marker(reader)? {
            END => return Ok(scans),
            START | PRIVATE => continue,
            marker => scans += usize::from(marker == SCAN),
        }
        let mut len = [0; 2];
        reader.read_exact(&mut len)?;
        let len = u64::from(u16::from_be_bytes(len)).saturating_sub(2);
        if io::copy(&mut reader.take(len), &mut io::sink())? < len {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
    }
}

/// Next marker after the data of a scan, where 0xff is followed by zero or a restart marker.
fn next_marker(reader: &mut impl Read) -> io::Result<u8> {
    const LEAD: u8 = 0xff;
    let (mut last, mut byte) = ([0], [0]);
    loop {
        reader.read_exact(&mut byte)?;
        if last[0] == LEAD && !matches!(byte[0], 0 | 0xd0..=0xd7 | LEAD) {
            return Ok(byte[0]);
        }
        last = byte;
    }
}

#[cfg(test)]
mod tests {
    use crate::{color_space::InputSpace, pixels::Pixels};
    use image::{DynamicImage, ImageEncoder, Rgb, RgbImage, codecs::jpeg::JpegEncoder, metadata::Orientation};
    use specula_core::random::uniform;
    use std::{
        fs,
        path::{Path, PathBuf},
    };

    /// PSNR of decoding at half the size against an area average: below a step of 8 bits, 48 dB,
    /// less 3 dB for the noise of the test picture.
    const CLOSE: f64 = 45.0;

    /// Gradients, an edge, fine stripes and noise.
    fn picture(width: u32, height: u32) -> RgbImage {
        RgbImage::from_fn(width, height, |x, y| {
            let noise = 12.0 * uniform(1, x.into(), y.into());
            let edge = if 3 * x > 2 * y + 90 { 60.0 } else { 0.0 };
            let stripes = 20.0 * (0.9 * x as f32 + 0.3 * y as f32).sin();
            Rgb([60.0 + edge + stripes + noise, 100.0 + edge + noise, 180.0 - 0.4 * y as f32 + noise].map(|x| x as u8))
        })
    }

    fn saved(folder: &Path, image: &DynamicImage, exif: Option<&[u8]>) -> PathBuf {
        let (path, mut bytes) = (folder.join("a.jpg"), Vec::new());
        let mut encoder = JpegEncoder::new_with_quality(&mut bytes, 92);
        exif.into_iter().for_each(|exif| encoder.set_exif_metadata(exif.to_vec()).unwrap());
        encoder.write_image(image.as_bytes(), image.width(), image.height(), image.color().into()).unwrap();
        fs::write(&path, bytes).unwrap();
        path
    }

    fn psnr(one: &Pixels, other: &Pixels) -> f64 {
        assert_eq!([one.width, one.height], [other.width, other.height]);
        let square = |(a, b): (&u8, &u8)| f64::from(a.abs_diff(*b)).powi(2);
        let mean = one.rgba.iter().zip(&other.rgba).map(square).sum::<f64>() * 4.0 / 3.0 / one.rgba.len() as f64;
        10.0 * (255.0 * 255.0 / mean).log10()
    }

    fn rounded(size: u32, downscale: u32) -> u32 {
        (f64::from(size) / f64::from(downscale)).round() as u32
    }

    #[test]
    fn decoding_at_half_size_matches_the_area_average() {
        let folder = tempfile::tempdir().unwrap();
        for (width, height) in [(256, 192), (203, 149), (130, 257)] {
            for image in
                [DynamicImage::from(picture(width, height)), DynamicImage::from(picture(width, height)).grayscale()]
            {
                let path = saved(folder.path(), &image, None);
                for downscale in [4, 8] {
                    let opened = Pixels::open(&path, InputSpace::Auto, downscale, |_| Some(true)).unwrap();
                    assert_eq!((opened.size, opened.turned), ([width, height], Orientation::NoTransforms));
                    let side = downscale / 2;
                    assert_eq!([opened.pixels.width, opened.pixels.height], [width, height].map(|x| x.div_ceil(side)));
                    let size = [width, height].map(|size| rounded(size, downscale));
                    let whole = Pixels::read(&path).unwrap().resized(size[0], size[1]);
                    let close = psnr(&opened.resized(size), &whole);
                    assert!(close > CLOSE, "{width} × {height}, {downscale} times smaller: {close} dB");
                }
            }
        }
    }

    #[test]
    fn unsupported_files_are_decoded_in_full() {
        /// Little-endian with one entry: orientation 6.
        const TURNED: &[u8] = &[0x49, 0x49, 42, 0, 8, 0, 0, 0, 1, 0, 0x12, 1, 3, 0, 1, 0, 0, 0, 6, 0, 0, 0, 0, 0, 0, 0];
        let folder = tempfile::tempdir().unwrap();
        let is_whole = |path: &Path, downscale, size: [u32; 2]| {
            let opened = Pixels::open(path, InputSpace::Auto, downscale, |_| None).unwrap();
            assert_eq!([opened.pixels.width, opened.pixels.height], size);
            opened
        };
        let path = saved(folder.path(), &picture(128, 96).into(), None);
        assert_eq!(is_whole(&path, 2, [128, 96]).pixels, is_whole(&path, 1, [128, 96]).pixels, "nothing is saved");
        is_whole(&saved(folder.path(), &picture(200, 20).into(), None), 8, [200, 20]);
        assert!(
            is_whole(&saved(folder.path(), &picture(128, 96).into(), Some(TURNED)), 8, [96, 128]).turned
                != Orientation::NoTransforms
        );
        let png = folder.path().join("a.png");
        picture(128, 96).save(&png).unwrap();
        is_whole(&png, 8, [128, 96]);
    }

    #[test]
    fn files_that_were_cut_short_are_refused_at_every_size() {
        let folder = tempfile::tempdir().unwrap();
        let path = saved(folder.path(), &picture(128, 96).into(), None);
        let bytes = fs::read(&path).unwrap();
        for len in [bytes.len() / 100, bytes.len() / 10, bytes.len() / 2, bytes.len() - 1] {
            fs::write(&path, &bytes[..len]).unwrap();
            for downscale in [1, 4, 8] {
                let refused =
                    Pixels::open(&path, InputSpace::Auto, downscale, |_| None).map(|_| ()).unwrap_err().to_string();
                assert!(refused.contains("a.jpg"), "{len} bytes, {downscale} times smaller: {refused}");
            }
        }
        let cut = Pixels::open(&path, InputSpace::Auto, 1, |_| None).map(|_| ()).unwrap_err().to_string();
        assert!(cut.contains("cut short"), "{cut}");
        // Cameras append previews and notes.
        fs::write(&path, [&bytes[..], &bytes[..bytes.len() / 2], &[0xff, 0xda, 0]].concat()).unwrap();
        assert!(
            Pixels::open(&path, InputSpace::Auto, 1, |_| None).is_ok()
                && Pixels::open(&path, InputSpace::Auto, 8, |_| None).is_ok()
        );
    }
}
