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
    /// Share of the picture that alpha covers, from 0 to 1.
    pub coverage: f32,
    /// Mean grey level of what alpha covers, from 0 to 1.
    pub brightness: f32,
}

impl Look {
    /// Measures straight RGBA bytes, row by row.
    pub fn of_rgba(name: &str, rgba: &[u8], width: usize) -> Self {
        let height = rgba.len() / 4 / width.max(1);
        let factor = width.max(height).div_ceil(EDGE).max(1);
        let (columns, rows) = (width / factor, height / factor);
        // Grey level times coverage, and coverage.
        let mean = |x: usize, y: usize| -> [f32; 2] {
            let (mut grey, mut coverage) = (0, 0);
            for row in y * factor..(y + 1) * factor {
                let start = 4 * (row * width + x * factor);
                for pixel in rgba[start..start + 4 * factor].as_chunks::<4>().0 {
                    let [red, green, blue, alpha] = pixel.map(u64::from);
                    grey += alpha * (red + 2 * green + blue);
                    coverage += alpha;
                }
            }
            let whole = (255 * factor * factor) as f32;
            [grey as f32 / (4.0 * 255.0 * whole), coverage as f32 / whole]
        };
        let means: Vec<[f32; 2]> =
            (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y))).map(|(x, y)| mean(x, y)).collect();
        let contrast = |gap: usize| -> f32 {
            let rows = means.chunks_exact(columns.max(1));
            rows.map(|row| row.iter().zip(row.iter().skip(gap)).map(|(a, b)| (a[0] - b[0]).powi(2)).sum::<f32>()).sum()
        };
        let [grey, coverage] = [0, 1].map(|k| means.iter().map(|mean| mean[k]).sum::<f32>());
        let [fine, coarse] = [1, 2].map(contrast);
        Self {
            name: name.to_owned(),
            sharpness: if coarse > 0.0 { fine / coarse } else { 0.0 },
            coverage: coverage / means.len().max(1) as f32,
            brightness: grey / coverage.max(1.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn brightness_is_that_of_what_is_covered() {
        let pixel = |k: u8| if k.is_multiple_of(4) { [128, 128, 128, 255] } else { [250, 250, 250, 0] };
        let rgba: Vec<u8> = (0..64).flat_map(pixel).collect();
        let look = Look::of_rgba("a", &rgba, 8);
        assert!((look.brightness - 128.0 / 255.0).abs() < 1e-6 && look.coverage == 0.25, "{look:?}");
    }

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
