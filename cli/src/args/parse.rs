//! Parsers of option values. Errors are sentences that name the valid values.

use core::{
    convert::Infallible,
    net::{Ipv4Addr, SocketAddr},
};
use specula_core::{
    cutoffs::{BlendOrder, ProjectionModel, WINDOW, WINDOW_MAX},
    lamps::RAYS_MAX,
};
use specula_io::{
    budget::view_size,
    dataset::{InputSpace, MaskUse},
};
use specula_scene::{ExecutorChoice, device::InvalidExecutor, following_light::LightFollows};
use std::net::ToSocketAddrs;

pub(super) fn finite(text: &str) -> Result<f32, String> {
    let number: f32 = text.parse().map_err(|_| "use a number".to_owned())?;
    if number.is_finite() { Ok(number) } else { Err("use a finite number".into()) }
}

/// Angle in degrees, of any number of turns.
pub(super) fn degrees(text: &str) -> Result<f32, String> {
    finite(text).map_err(|error| format!("{error}, in degrees"))
}

/// Number of shadow rays.
pub(super) fn shadow_rays(text: &str) -> Result<usize, String> {
    let number = text.parse().ok().filter(|number| (1..=RAYS_MAX).contains(number));
    number.ok_or_else(|| format!("use a whole number from 1 to {RAYS_MAX}"))
}

pub(super) fn above_zero(text: &str) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| "use a number".to_owned())?;
    if number > 0.0 && number.is_finite() { Ok(number) } else { Err("use a number above zero".into()) }
}

pub(super) fn weight(text: &str) -> Result<f32, String> {
    let number = finite(text)?;
    if number >= 0.0 { Ok(number) } else { Err("use a number that is not negative".into()) }
}

pub(super) fn share(text: &str) -> Result<f32, String> {
    let number = finite(text)?;
    if (0.0..=1.0).contains(&number) { Ok(number) } else { Err("use a number from 0 to 1".into()) }
}

pub(super) fn error_bound(text: &str) -> Result<f64, String> {
    let number = above_zero(text)?;
    if number < 1.0 { Ok(number) } else { Err("use a number below 1 (white); 5/255 is 0.02".into()) }
}

pub(super) fn downscale(text: &str) -> Result<u32, String> {
    match text {
        "1" => Ok(1),
        "2" => Ok(2),
        "4" => Ok(4),
        "8" => Ok(8),
        _ => Err("use 1, 2, 4 or 8".into()),
    }
}

pub(super) fn size(text: &str) -> Result<[u32; 2], String> {
    let number = |part: &str| part.trim().parse().ok();
    let both = text.split_once([',', 'x']).and_then(|(width, height)| Some([number(width)?, number(height)?]));
    view_size(both.ok_or("use two numbers, such as 640,480")?)
}

/// Socket address: a port on loopback, or a host and a port.
pub(super) fn address(text: &str) -> Result<SocketAddr, String> {
    let here = || text.parse().map(|port: u16| SocketAddr::from((Ipv4Addr::LOCALHOST, port))).ok();
    let named = || text.to_socket_addrs().ok().and_then(|mut addresses| addresses.next());
    here().or_else(named).ok_or_else(|| "use a port, or a host and a port, such as 7008 or 0.0.0.0:7008".to_owned())
}

/// Token of letters and digits, which URLs and headers can contain.
pub(super) fn token(text: &str) -> Result<String, String> {
    const LENGTH_MIN: usize = 8;
    let is_fine = text.len() >= LENGTH_MIN && text.bytes().all(|byte| byte.is_ascii_alphanumeric());
    if is_fine { Ok(text.to_owned()) } else { Err(format!("use {LENGTH_MIN} letters and digits or more")) }
}

pub(super) fn light_follows(text: &str) -> Result<LightFollows, String> {
    LightFollows::named(text).ok_or_else(|| "expected scene, turntable or camera".into())
}

pub(super) fn masks(text: &str) -> Result<MaskUse, String> {
    MaskUse::named(text)
        .ok_or_else(|| "expected auto, ignore or cut; the masks themselves are in the data set's folder masks".into())
}

pub(super) fn input_space(text: &str) -> Result<InputSpace, String> {
    InputSpace::named(text).ok_or_else(|| "expected auto, srgb, linear or acescg".into())
}

/// Rejects what `--set` names: only words that are no setting reach this parser.
pub(super) fn unknown_setting(text: &str) -> Result<Infallible, String> {
    Err(match text.split_once('=') {
        Some((name, _)) => format!("there is no setting {name:?}; specula train --set help lists them"),
        None => "use --set NAME=VALUE; specula train --set help lists the settings".into(),
    })
}

pub(super) fn projection(text: &str) -> Result<ProjectionModel, String> {
    match text {
        "affine" => Ok(ProjectionModel::Affine),
        "tangent" => Ok(ProjectionModel::Tangent),
        "ray" => Ok(ProjectionModel::Ray),
        alpha => share(alpha).map(ProjectionModel::Within).map_err(|_| {
            "use affine, tangent, ray, or the error in alpha, from 0 to 1, that affine may have".to_owned()
        }),
    }
}

/// Order of splats: mean, window, window:N or pixel.
pub(super) fn order(text: &str) -> Result<BlendOrder, String> {
    let window = |count: &str| {
        let count = count.parse().ok().filter(|count| (1..=WINDOW_MAX).contains(count))?;
        Some(BlendOrder::Window(count))
    };
    match text {
        "mean" => Ok(BlendOrder::Mean),
        "window" => Ok(BlendOrder::Window(WINDOW)),
        "pixel" => Ok(BlendOrder::Pixel),
        other => other
            .strip_prefix("window:")
            .and_then(window)
            .ok_or_else(|| format!("use mean, pixel, window, or window:N with an N from 1 to {WINDOW_MAX}")),
    }
}

pub(super) fn executor(text: &str) -> Result<ExecutorChoice, String> {
    text.parse().map_err(|error: InvalidExecutor| format!("{error}; `specula doctor` lists the names"))
}

pub(super) fn cube_resolution(text: &str) -> Result<usize, String> {
    const LARGEST: usize = 2048;
    let is_fine = |size: &usize| (16..=LARGEST).contains(size) && size.is_power_of_two();
    text.parse().ok().filter(is_fine).ok_or_else(|| format!("use a power of two from 16 to {LARGEST}"))
}

/// [`count`] above 0.
pub(super) fn whole_above_zero(text: &str) -> Result<usize, String> {
    match count(text)? {
        0 => Err("use a number above 0".into()),
        number => Ok(number),
    }
}

/// Number of triangles, enough for a few solids.
pub(super) fn triangles(text: &str) -> Result<usize, String> {
    const LEAST: usize = 100;
    match count(text)? {
        ..LEAST => Err(format!("use {LEAST} triangles or more")),
        number => Ok(number),
    }
}

/// Rows and columns of a texture, which engines support.
pub(super) fn texture_size(text: &str) -> Result<u32, String> {
    let sizes = 64..=8192;
    text.parse()
        .ok()
        .filter(|size| sizes.contains(size))
        .ok_or_else(|| format!("use a whole number from {} to {}", sizes.start(), sizes.end()))
}

/// Whole number as 30000, 30_000, 30k, 1.5M or 3e4.
pub(super) fn count<N: TryFrom<u64>>(text: &str) -> Result<N, String> {
    const WRONG: &str = "use a whole number, such as 30000, 30_000, 30k or 3e4";
    let digits = text.replace('_', "");
    let (digits, factor) = match digits.strip_suffix(['k', 'K', 'm', 'M']) {
        Some(digits) => (digits.to_owned(), if text.ends_with(['k', 'K']) { 1e3 } else { 1e6 }),
        None => (digits, 1.0),
    };
    let exact = digits.parse().ok().filter(|_| factor == 1.0);
    let scaled = || {
        // Largest power of two up to which f64 represents every whole number.
        const LARGEST: f64 = (1_u64 << 53) as f64;
        let is_plain = digits.starts_with(|letter: char| letter.is_ascii_digit() || letter == '.');
        let number = digits.parse::<f64>().ok().filter(|_| is_plain)? * factor;
        ((0.0..LARGEST).contains(&number) && number.fract() == 0.0).then_some(number as u64)
    };
    let number = exact.or_else(scaled).ok_or_else(|| WRONG.to_owned())?;
    N::try_from(number).map_err(|_| format!("{number} is too large"))
}

/// Whole number of at least 1.
pub(super) fn positive<N: TryFrom<u64> + Default + PartialEq>(text: &str) -> Result<N, String> {
    count(text).and_then(|number| if number == N::default() { Err("use 1 or more".into()) } else { Ok(number) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_order_is_that_of_means_of_pixels_or_of_a_window() {
        assert_eq!(order("mean"), Ok(BlendOrder::Mean));
        assert_eq!(order("pixel"), Ok(BlendOrder::Pixel));
        assert_eq!(order("window"), Ok(BlendOrder::Window(WINDOW)));
        assert_eq!(order("window:8"), Ok(BlendOrder::Window(8)));
        for text in ["", "Mean", "window:", "window:0", "window:65", "window:-1", "window8", "pixel:3"] {
            assert!(order(text).is_err_and(|words| words.contains("window:N")), "{text:?} passed for an order");
        }
    }

    #[test]
    fn counts_are_read_as_people_write_them() {
        for (text, number) in [
            ("30000", 30_000),
            ("30_000", 30_000),
            ("7k", 7000),
            ("7K", 7000),
            ("1.5k", 1500),
            ("1e4", 10_000),
            ("3E4", 30_000),
            ("2M", 2_000_000),
            ("0", 0),
            ("4294967295", u32::MAX),
        ] {
            assert_eq!(count::<u32>(text), Ok(number), "{text}");
        }
        for text in
            ["", "k", "-1", "+-1", "1.5", "7q", "1e-3", "NaN", "inf", "nan_k", "4294967296", "1e300", "7 k", "kk"]
        {
            assert!(count::<u32>(text).is_err(), "{text:?} passed for a count");
        }
        assert!(count::<u32>("7q").is_err_and(|words| words.contains("30k")));
        assert_eq!(positive::<u32>("0"), Err("use 1 or more".to_owned()));
        assert_eq!(positive::<u32>("1k"), Ok(1000));
    }
}
