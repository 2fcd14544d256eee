//! Sharpness and brightness of a picture.

use serde::Serialize;

/// Edge of the reduced picture that is measured.
const EDGE: usize = 640;

/// Sharpness and brightness of a picture.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Look {
    /// Name of the picture.
    pub name: String,
    /// Share of the contrast over two pixels that is there over one, at 640 pixels along the longer
    /// edge: 0.25 for smooth, 0.5 for steps between pixels.
    pub sharpness: f32,
    /// Mean grey level, from 0 to 1.
    pub brightness: f32,
}

impl Look {
    /// Measures straight RGBA bytes, row by row.
    pub fn of_rgba(name: &str, rgba: &[u8], width: usize) -> Self {
        let height = rgba.len() / 4 / width.max(1);
        let factor = width.max(height).div_ceil(EDGE).max(1);
        let (columns, rows) = (width / factor, height / factor);
        let grey = |x: usize, y: usize| -> f32 {
            let mut sum = 0;
            for row in y * factor..(y + 1) * factor {
                let start = 4 * (row * width + x * factor);
                let block = &rgba[start..start + 4 * factor];
                sum +=
                    block.chunks_exact(4).map(|p| u32::from(p[0]) + 2 * u32::from(p[1]) + u32::from(p[2])).sum::<u32>();
            }
            sum as f32 / (4 * 255 * factor * factor) as f32
        };
        let grey: Vec<f32> =
            (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y))).map(|(x, y)| grey(x, y)).collect();
        let contrast = |gap: usize| -> f32 {
            let rows = grey.chunks_exact(columns.max(1));
            rows.map(|row| row.iter().zip(row.iter().skip(gap)).map(|(a, b)| (a - b).powi(2)).sum::<f32>()).sum()
        };
        let [fine, coarse] = [1, 2].map(contrast);
        Self {
            name: name.to_owned(),
            sharpness: if coarse > 0.0 { fine / coarse } else { 0.0 },
            brightness: grey.iter().sum::<f32>() / grey.len().max(1) as f32,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blur_lowers_sharpness() {
        let picture = |soft: f32| -> Vec<u8> {
            let level =
                |x: f32| 128.0 + 100.0 * ((core::f32::consts::TAU * (x + 0.5) / 40.0).sin() / soft).clamp(-1.0, 1.0);
            (0..200)
                .flat_map(|_| {
                    (0..400).flat_map(|x| {
                        let l = level(x as f32) as u8;
                        [l, l, l, 255]
                    })
                })
                .collect()
        };
        let [sharp, soft] = [0.001, 1.0].map(|soft| Look::of_rgba("a", &picture(soft), 400));
        assert!(sharp.sharpness > 0.45 && soft.sharpness < 0.35, "{sharp:?} {soft:?}");
        assert!((sharp.brightness - 0.5).abs() < 0.05, "{sharp:?}");
    }
}
