//! A picture with its camera.

use half::f16;
use specula_core::{
    camera::Camera,
    color::{Picture, UNKNOWN, has_alpha, is_unknown, linear_from_srgb, over},
};

/// Ground-truth normals of a view.
#[derive(Clone, Debug, PartialEq)]
pub struct Normals {
    /// World-space unit normals, pixel by pixel.
    pub values: Vec<[f32; 3]>,
    /// Whether a pixel has a normal.
    pub mask: Vec<bool>,
}

/// A picture in sRGB with straight alpha, and a camera of the same size. [`UNKNOWN`] pixels take
/// part neither in training nor in metrics.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Name in the data set.
    pub name: String,
    /// Camera of the picture.
    pub camera: Camera,
    /// Red, green, blue, alpha of each pixel, row by row: width · height · 4 bytes.
    pub rgba: Vec<u8>,
    /// Colours without a limit at white, red, green and blue of each pixel, to train on instead of
    /// those of `rgba` ([`Picture::unclipped`]).
    pub unclipped: Option<Vec<[f16; 3]>>,
    /// Ground-truth normals, if known.
    pub normals: Option<Normals>,
}

impl View {
    /// The picture for an executor.
    pub fn picture(&self) -> Picture<'_> {
        let [width, height] = [self.camera.width, self.camera.height].map(|size| size as usize);
        Picture { width, height, rgba: &self.rgba, unclipped: self.unclipped.as_deref() }
    }

    /// Returns whether any pixel is not opaque.
    pub fn has_alpha(&self) -> bool {
        has_alpha(&self.rgba)
    }

    /// Downscales the view by two: means over 2 × 2 pixels, weighted by alpha, without a last odd
    /// row or column. A pixel is unknown if more than two of the four are; fewer unknown ones have
    /// no weight. Normals are dropped.
    #[must_use]
    pub fn halved(&self) -> Self {
        let [width, height] = [self.camera.width as usize / 2, self.camera.height as usize / 2];
        let row_len = self.camera.width as usize;
        let corners =
            |x: usize, y: usize| [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dx, dy)| (2 * y + dy) * row_len + 2 * x + dx);
        let mean = |x: usize, y: usize| {
            let corners = corners(x, y).map(|pixel| 4 * pixel);
            let is_unknown = |start: usize| is_unknown(&self.rgba[start..start + 4]);
            let known = 4 - corners.iter().filter(|start| is_unknown(**start)).count() as u32;
            if known < 2 {
                return UNKNOWN;
            }
            // Unknown pixels have zero alpha and therefore no weight.
            let alphas = corners.map(|start| u32::from(self.rgba[start + 3]));
            let sum: u32 = alphas.iter().sum();
            let color = |c: usize| {
                let weighted: u32 =
                    corners.iter().zip(alphas).map(|(start, a)| u32::from(self.rgba[start + c]) * a).sum();
                (weighted + sum / 2).checked_div(sum).unwrap_or(0) as u8
            };
            [color(0), color(1), color(2), ((sum + known / 2) / known) as u8]
        };
        let mean_color = |colors: &[[f16; 3]], corners: [usize; 4]| {
            let alphas = corners.map(|pixel| f32::from(self.rgba[4 * pixel + 3]));
            let sum: f32 = alphas.iter().sum();
            let weighted =
                |c: usize| -> f32 { corners.iter().zip(alphas).map(|(k, a)| f32::from(colors[*k][c]) * a).sum() };
            [0, 1, 2].map(|c| f16::from_f32(if sum > 0.0 { weighted(c) / sum } else { 0.0 }))
        };
        let unclipped = self.unclipped.as_ref().map(|colors| {
            let row = |y: usize| (0..width).map(move |x| mean_color(colors, corners(x, y)));
            (0..height).flat_map(row).collect()
        });
        Self {
            name: self.name.clone(),
            camera: self.camera.resized(width as u32, height as u32),
            rgba: (0..height).flat_map(|y| (0..width).flat_map(move |x| mean(x, y))).collect(),
            unclipped,
            normals: None,
        }
    }

    /// Mask of known pixels; `None` if all are known.
    pub fn known(&self) -> Option<Vec<bool>> {
        let known: Vec<bool> = self.rgba.chunks_exact(4).map(|pixel| !is_unknown(pixel)).collect();
        known.contains(&false).then_some(known)
    }

    /// Whether no pixel is known.
    pub fn is_unknown(&self) -> bool {
        self.rgba.chunks_exact(4).all(is_unknown)
    }

    /// Linear radiance over a background, in three planes; black in unknown pixels. `None` for a
    /// picture of 8 bits.
    pub fn radiance_over(&self, background: [f32; 3]) -> Option<Vec<f32>> {
        let colors = self.unclipped.as_ref()?;
        let radiance = |c: usize, (color, pixel): (&[f16; 3], &[u8])| match is_unknown(pixel) {
            true => 0.0,
            false => linear_from_srgb(over(color[c].into(), f32::from(pixel[3]) / 255.0, background[c])),
        };
        let plane = |c: usize| colors.iter().zip(self.rgba.chunks_exact(4)).map(move |pixel| radiance(c, pixel));
        Some((0..3).flat_map(plane).collect())
    }

    /// Composites the picture over a background into three planes in \[0, 1\]; unknown pixels show
    /// the background.
    pub fn over(&self, background: [f32; 3]) -> Vec<f32> {
        let share = |byte: u8| f32::from(byte) / 255.0;
        let pixel = move |c: usize, pixel: &[u8]| over(share(pixel[c]), share(pixel[3]), background[c]);
        let plane = |c: usize| self.rgba.chunks_exact(4).map(move |rgba| pixel(c, rgba));
        (0..3).flat_map(plane).collect()
    }
}

/// Bytes of a pixel of a picture: of 8 bits, or with unclipped colours.
pub const fn pixel_bytes(is_unclipped: bool) -> u64 {
    if is_unclipped { 4 + size_of::<[f16; 3]>() as u64 } else { 4 }
}

/// Extent of the cameras: 1.1 times the largest distance from their mean, INRIA's measure of a
/// scene's size.
pub fn extent_of(views: &[View]) -> f32 {
    extent_of_cameras(views.iter().map(|view| &view.camera))
}

/// [`extent_of`] for cameras; 1 for a single camera.
pub fn extent_of_cameras<'a>(cameras: impl ExactSizeIterator<Item = &'a Camera> + Clone) -> f32 {
    const MARGIN: f32 = 1.1;
    let count = cameras.len().max(1) as f32;
    let mean = cameras.clone().map(|camera| camera.position).sum::<glam::Vec3>() / count;
    let farthest = cameras.map(|camera| camera.position.distance(mean)).fold(0.0, f32::max);
    if farthest > 0.0 { MARGIN * farthest } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn view(width: u32, pixels: &[[u8; 4]]) -> View {
        let camera = Camera::look_at(Vec3::X * 4.0, Vec3::ZERO, Vec3::Z, 0.7, width, pixels.len() as u32 / width);
        View { name: "one".into(), camera, rgba: pixels.concat(), unclipped: None, normals: None }
    }

    #[test]
    fn unknown_pixels_have_no_weight_in_a_halved_view() {
        let (color, other) = ([200, 100, 50, 255], [100, 50, 0, 255]);
        let halved = view(4, &[color, UNKNOWN, UNKNOWN, UNKNOWN, UNKNOWN, other, UNKNOWN, other]).halved();
        assert_eq!(halved.rgba, [[150, 75, 25, 255], UNKNOWN].concat());
    }

    #[test]
    fn views_report_their_unknown_pixels() {
        let torn = view(2, &[[9; 4], UNKNOWN, [0; 4], [255; 4]]);
        assert_eq!(torn.known(), Some(vec![true, false, true, true]));
        assert_eq!(view(1, &[[9; 4]]).known(), None);
        assert!(!view(2, &[[255; 4], UNKNOWN]).has_alpha(), "unknown pixels are not transparent");
    }
}
