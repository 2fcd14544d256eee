//! A picture and where it was taken from.

use specula_core::{
    camera::Camera,
    color::{has_alpha, over},
};

/// True normals of a view.
#[derive(Clone, Debug, PartialEq)]
pub struct Normals {
    /// World-space unit normals, pixel by pixel.
    pub values: Vec<[f32; 3]>,
    /// Which pixels have one.
    pub mask: Vec<bool>,
}

/// A picture of 8-bit sRGB and straight alpha, and its camera, whose size is the picture's.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// What the data set calls it.
    pub name: String,
    /// From where it was taken.
    pub camera: Camera,
    /// width · height · 4 bytes, row by row.
    pub rgba: Vec<u8>,
    /// True normals, if they are known.
    pub normals: Option<Normals>,
}

impl View {
    /// Whether any pixel is not opaque.
    pub fn has_alpha(&self) -> bool {
        has_alpha(&self.rgba)
    }

    /// The view at half its size: means over 2×2 pixels, weighted by alpha; a last odd row or column is left out.
    /// Normals are not kept.
    pub fn halved(&self) -> Self {
        let [width, height] = [self.camera.width as usize / 2, self.camera.height as usize / 2];
        let row_len = self.camera.width as usize;
        let mean = |x: usize, y: usize| {
            let corners = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dx, dy)| 4 * ((2 * y + dy) * row_len + 2 * x + dx));
            let alphas = corners.map(|start| u32::from(self.rgba[start + 3]));
            let sum: u32 = alphas.iter().sum();
            let color = |c: usize| {
                let weighted: u32 =
                    corners.iter().zip(alphas).map(|(start, a)| u32::from(self.rgba[start + c]) * a).sum();
                (weighted + sum / 2).checked_div(sum).unwrap_or(0) as u8
            };
            [color(0), color(1), color(2), ((sum + 2) / 4) as u8]
        };
        Self {
            name: self.name.clone(),
            camera: self.camera.resized(width as u32, height as u32),
            rgba: (0..height).flat_map(|y| (0..width).flat_map(move |x| mean(x, y))).collect(),
            normals: None,
        }
    }

    /// The picture over a background, as three planes in \[0, 1\].
    pub fn over(&self, background: [f32; 3]) -> Vec<f32> {
        let share = |byte: u8| f32::from(byte) / 255.0;
        let pixel = move |c: usize, pixel: &[u8]| over(share(pixel[c]), share(pixel[3]), background[c]);
        let plane = |c: usize| self.rgba.chunks_exact(4).map(move |rgba| pixel(c, rgba));
        (0..3).flat_map(plane).collect()
    }
}

/// How far the cameras spread: 1.1 times the largest distance of one from their mean (INRIA's measure of a scene).
pub fn extent_of(views: &[View]) -> f32 {
    extent_of_cameras(views.iter().map(|view| &view.camera))
}

/// [`extent_of`] of cameras; 1 for a single one.
pub fn extent_of_cameras<'a>(cameras: impl ExactSizeIterator<Item = &'a Camera> + Clone) -> f32 {
    const MARGIN: f32 = 1.1;
    let count = cameras.len().max(1) as f32;
    let mean = cameras.clone().map(|camera| camera.position).sum::<glam::Vec3>() / count;
    let farthest = cameras.map(|camera| camera.position.distance(mean)).fold(0.0, f32::max);
    if farthest > 0.0 { MARGIN * farthest } else { 1.0 }
}
