//! Depths, colours and coverage of a rendered view, pixel by pixel.

use glam::Vec3;
use specula_core::{
    camera::Camera,
    cutoffs::ALPHA_MIN,
    rules::{Channels, channel},
    scene::Image,
};

/// Coverage from which a pixel shows a surface.
pub(crate) const COVERAGE_SURFACE: f32 = 0.5;
/// Coverage below which a pixel shows free space.
pub(crate) const COVERAGE_FREE: f32 = 0.05;
/// Pixels along an edge of a tile.
const TILE: usize = 8;
/// Tiles up to which a box is tested.
const TILES_MAX: usize = 64;

/// Depth, colour and coverage of each pixel of a camera.
#[derive(Clone, Debug)]
pub(crate) struct View {
    camera: Camera,
    pub(crate) depths: Vec<f32>,
    pub(crate) colors: Vec<[f32; 3]>,
    pub(crate) coverage: Vec<f32>,
    /// Least and largest reach of the pixels of each tile: the depth of their surface, infinite in
    /// free space, and −∞ where a pixel shows neither.
    tiles: Vec<[f32; 2]>,
}

/// Content of a box in a view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Shown {
    /// Nothing: the box is outside of the picture, or hidden.
    Nothing,
    /// Only free space.
    Free,
    /// Anything.
    Any,
}

impl View {
    pub(crate) fn new(camera: &Camera, image: &Image<Vec<f32>>) -> Self {
        let coverage: Vec<f32> = image.plane(image.channels - 1).iter().map(|passed| 1.0 - passed).collect();
        let channels = Channels::with_count(image.channels - 1);
        let depth = channels.and_then(|channels| channels.index_of(channel::DEPTH)).expect("the renderer has depths");
        let normalised = |sum: f32, pixel: usize| sum / coverage[pixel].max(ALPHA_MIN);
        let pixels = || 0..image.pixel_count();
        let depths: Vec<f32> = pixels().map(|pixel| normalised(image.plane(depth)[pixel], pixel)).collect();
        let across = image.width.div_ceil(TILE);
        let mut tiles = vec![[f32::INFINITY, f32::NEG_INFINITY]; across * image.height.div_ceil(TILE)];
        for pixel in pixels() {
            let [least, largest] = &mut tiles[pixel / image.width / TILE * across + pixel % image.width / TILE];
            let reach = match coverage[pixel] {
                coverage if coverage < COVERAGE_FREE => f32::INFINITY,
                coverage if coverage >= COVERAGE_SURFACE && !depths[pixel].is_nan() => depths[pixel],
                _ => f32::NEG_INFINITY,
            };
            (*least, *largest) = (least.min(reach), largest.max(reach));
        }
        Self {
            camera: *camera,
            depths,
            colors: pixels().map(|pixel| image.rgb(pixel).map(|sum| normalised(sum, pixel).clamp(0.0, 1.0))).collect(),
            coverage,
            tiles,
        }
    }

    /// Content of a box in the view by its corners, if surfaces are seen up to `behind` them.
    /// Certain up to rounding of the points between the corners.
    pub(crate) fn shown(&self, corners: [Vec3; 8], behind: f32) -> Shown {
        /// Bounds of rounding, in pixels, as a share of `behind`, and of a depth.
        const PIXEL: f32 = 1.0;
        const SHARE: f32 = 0.01;
        const DEPTH: f32 = 1e-5;
        let Camera { near, width, height, .. } = self.camera;
        let in_camera = corners.map(|corner| self.in_camera(corner));
        let nearest = in_camera.iter().fold(f32::INFINITY, |least, point| least.min(point.z));
        let farthest = in_camera.iter().fold(f32::NEG_INFINITY, |most, point| most.max(point.z));
        if farthest < near - DEPTH * near.abs() || width == 0 || height == 0 {
            return Shown::Nothing;
        }
        if !(nearest > near + DEPTH * near.abs() && farthest.is_finite()) {
            return Shown::Any;
        }
        let on_screen = in_camera.map(|point| self.on_screen(point));
        let bounds = |axis: usize, edge: u32| {
            let first = on_screen.iter().fold(f32::INFINITY, |least, point| least.min(point[axis])) - PIXEL;
            let last = on_screen.iter().fold(f32::NEG_INFINITY, |most, point| most.max(point[axis])) + PIXEL;
            let is_outside = last < 0.0 || first >= edge as f32;
            let is_inside = first >= 0.0 && last < edge as f32;
            // Conversions saturate.
            let tiles = [first, last.min(edge as f32 - 1.0)].map(|pixel| pixel as usize / TILE);
            (tiles, is_outside, is_inside)
        };
        let ([columns, rows], edges) = ([bounds(0, width), bounds(1, height)], [width, height]);
        if columns.1 || rows.1 {
            return Shown::Nothing;
        }
        let ([left, right], [top, bottom]) = (columns.0, rows.0);
        if (right + 1 - left) * (bottom + 1 - top) > TILES_MAX {
            return Shown::Any;
        }
        let across = (edges[0] as usize).div_ceil(TILE);
        let (mut least, mut largest) = (f32::INFINITY, f32::NEG_INFINITY);
        for row in top..=bottom {
            for [low, high] in &self.tiles[row * across + left..=row * across + right] {
                (least, largest) = (least.min(*low), largest.max(*high));
            }
        }
        if largest < nearest - behind * (1.0 + SHARE) - DEPTH * nearest {
            return Shown::Nothing;
        }
        let is_free = least == f32::INFINITY && columns.2 && rows.2;
        if is_free { Shown::Free } else { Shown::Any }
    }

    fn in_camera(&self, point: Vec3) -> Vec3 {
        self.camera.camera_from_world * (point - self.camera.position)
    }

    /// Position on the screen of a point in front of the camera, in pixels.
    fn on_screen(&self, in_camera: Vec3) -> [f32; 2] {
        let Camera { focal_px, principal_px, .. } = self.camera;
        [0, 1].map(|axis| focal_px[axis] * in_camera[axis] / in_camera.z + principal_px[axis])
    }

    /// Depth of a point and index of its pixel; `None` for a point outside of the picture.
    pub(crate) fn pixel(&self, point: Vec3) -> Option<(f32, usize)> {
        let Camera { near, width, height, .. } = self.camera;
        let in_camera = self.in_camera(point);
        if !(in_camera.z > near) {
            return None;
        }
        let [x, y] = self.on_screen(in_camera);
        let is_inside = x >= 0.0 && y >= 0.0 && x < width as f32 && y < height as f32;
        is_inside.then(|| (in_camera.z, y as usize * width as usize + x as usize))
    }
}
