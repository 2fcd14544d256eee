//! Initial Gaussians, from a point cloud or from random points.

use crate::{
    pictures::{PictureError, PictureKey, Pictures, Turn},
    profile::{GaussianStart, Profile},
    view::{View, extent_of_cameras},
};
use core::{iter, num::NonZero};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use specula_core::{
    activation::logit,
    camera::Camera,
    color::{has_alpha, is_unknown, linear_from_srgb},
    morton::Bounds,
    normal::AxisRule,
    random,
    scene::{
        ALBEDO, AMBIENT, DIFFUSE, Gaussians, LOG_SCALE, Layout, MEAN, METALNESS, NORMAL_RESIDUAL_1, NORMAL_RESIDUAL_2,
        OPACITY, QUAT, ROUGHNESS, TINT, len_of_values,
    },
    sh::Y0,
    shade::ShadingForm,
};
use std::collections::HashMap;

/// A coloured point, from which a Gaussian starts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Position in world space.
    pub position: [f32; 3],
    /// Colour in sRGB, in \[0, 1\].
    pub color: [f32; 3],
}

/// Half the edge of the cube of random points around the origin, which encloses scenes of NeRF
/// Synthetic.
const CUBE_HALF: f32 = 1.3;
/// Independent streams of random numbers.
const POINT_STREAM: u64 = 0x706f_696e;
const NORMAL_STREAM: u64 = 0x6e6f_726d;

/// Distance along an axis between the origin and the cameras' point of interest, relative to half
/// the edge of the cube, above which the cube is moved there. Objects of NeRF Synthetic are nearer.
const OFF_CENTRE: f32 = 0.5;
/// Camera extent of NeRF Synthetic ([`extent_of_cameras`]).
const CUBE_EXTENT: f32 = 4.4;
/// Camera extents that count as those of NeRF Synthetic.
const USUAL_EXTENTS: core::ops::RangeInclusive<f32> = 1.0..=20.0;

/// Empty pixels of a picture: known pixels with an alpha of zero.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Silhouette {
    /// One bit for each pixel, row by row, set unless the pixel is empty.
    bits: Vec<u8>,
}

impl Silhouette {
    /// Silhouette of a picture; `None` if no pixel is transparent, or if all are, as after a failed
    /// mask.
    pub fn of(rgba: &[u8]) -> Option<Self> {
        let is_solid = |pixel: &[u8]| pixel[3] > 0 || is_unknown(pixel);
        let byte = |pixels: &[u8]| {
            let bits = pixels.chunks_exact(4).enumerate();
            bits.fold(0, |byte, (place, pixel)| byte | u8::from(is_solid(pixel)) << place)
        };
        let shows_something = rgba.chunks_exact(4).any(is_solid);
        (shows_something && has_alpha(rgba)).then(|| Self { bits: rgba.chunks(4 * 8).map(byte).collect() })
    }

    /// Silhouette from bytes of another machine.
    pub const fn from_bytes(bits: Vec<u8>) -> Self {
        Self { bits }
    }

    /// One bit for each pixel, row by row.
    pub fn bytes(&self) -> &[u8] {
        &self.bits
    }

    /// Returns whether the picture does not show a point's position as empty.
    fn may_be_solid(&self, camera: &Camera, position: [f32; 3]) -> bool {
        let Some([x, y]) = pixel_of(camera, position) else { return true };
        let pixel = y * camera.width as usize + x;
        self.bits.get(pixel / 8).is_none_or(|byte| byte >> (pixel % 8) & 1 == 1)
    }
}

/// Silhouettes of all pictures.
pub(crate) fn silhouettes(pictures: &mut dyn Pictures, count: usize) -> Result<Vec<Option<Silhouette>>, PictureError> {
    let silhouette = |view: usize| {
        let turn = Turn { visit: 0, picture: PictureKey { view, is_halved: false } };
        let mut found = None;
        pictures.show(turn, &mut |view| found = Silhouette::of(&view.rgba))?;
        Ok(found)
    };
    (0..count).map(silhouette).collect()
}

/// Half the edge of the cube of random points: NeRF Synthetic's, scaled with the camera extent
/// where that differs much.
fn half_cube(extent: f32) -> f32 {
    if USUAL_EXTENTS.contains(&extent) { CUBE_HALF } else { CUBE_HALF * extent / CUBE_EXTENT }
}

/// Random grey points in the cube of NeRF Synthetic, scaled if the camera extent differs much and
/// centred at the origin. Points that a picture with an alpha channel shows as empty are redrawn a
/// bounded number of times.
pub fn random_points(count: usize, views: &[View], seed: u64) -> Vec<Point> {
    let silhouettes: Vec<_> = views.iter().map(|view| Silhouette::of(&view.rgba)).collect();
    let cameras: Vec<Camera> = views.iter().map(|view| view.camera).collect();
    points_within(count, [0.0; 3], &cameras, &silhouettes, seed)
}

/// [`random_points`] for cameras that look at a `centre`, and the silhouettes of their pictures.
/// The cube is around the centre if that is outside of the middle half of one around the
/// origin.
pub fn points_within(
    count: usize,
    centre: [f32; 3],
    cameras: &[Camera],
    silhouettes: &[Option<Silhouette>],
    seed: u64,
) -> Vec<Point> {
    const DRAWS_MAX: u64 = 400;
    let half = half_cube(extent_of_cameras(cameras.iter()));
    let is_off = centre.iter().any(|coordinate| coordinate.abs() > OFF_CENTRE * half);
    let centre = if is_off { centre } else { [0.0; 3] };
    let checks: Vec<_> =
        cameras.iter().zip(silhouettes).filter_map(|(camera, seen)| Some((camera, seen.as_ref()?))).collect();
    let mut points = Vec::with_capacity(count);
    let mut draw = 0;
    while points.len() < count && draw < DRAWS_MAX * count as u64 {
        let coordinate = |axis: usize| {
            let share = random::uniform(seed, POINT_STREAM, 3 * draw + axis as u64) * 2.0 - 1.0;
            centre[axis] + share * half
        };
        let position = [0, 1, 2].map(coordinate);
        if checks.iter().all(|(camera, seen)| seen.may_be_solid(camera, position)) {
            points.push(Point { position, color: [0.5; 3] });
        }
        draw += 1;
    }
    points
}

/// At most `count` points, evenly spaced in their order.
pub fn thinned(points: Vec<Point>, count: usize) -> Vec<Point> {
    if points.len() <= count {
        return points;
    }
    let all = points.len();
    (0..count).map(|k| points[(k as u128 * all as u128 / count as u128) as usize]).collect()
}

/// Pixels of a picture for drawing points behind a cloud.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PixelSample {
    /// Red, green, blue and alpha of each, in the order of the points.
    pub rgba: Vec<[u8; 4]>,
}

impl PixelSample {
    /// Sample of the picture at a `place` among `views`, for `count` points in all.
    pub fn of(place: usize, views: usize, count: usize, camera: &Camera, rgba: &[u8], seed: u64) -> Self {
        let [width, height] = [camera.width, camera.height].map(|size| size as usize);
        let pixel = |index: usize| {
            let [x, y] = place_in(camera, index, seed);
            let pixel = (y as usize).min(height - 1) * width + (x as usize).min(width - 1);
            [0, 1, 2, 3].map(|c| rgba[4 * pixel + c])
        };
        Self { rgba: (place..count).step_by(views.max(1)).map(pixel).collect() }
    }
}

/// Position in a view, in pixels, for drawing a point.
fn place_in(camera: &Camera, index: usize, seed: u64) -> [f32; 2] {
    let number = |axis: u64| random::uniform(seed, BEHIND_STREAM, 3 * index as u64 + axis);
    [number(0) * camera.width as f32, number(1) * camera.height as f32]
}

/// Points behind a cloud, where structure from motion finds few, such as on plain walls. Each lies
/// on the ray of a random opaque pixel and has its colour; its depth is one to four times the
/// median depth of the cloud in that view, uniform in 1 / depth. Views alternate. Returns fewer
/// than `count` points if pixels are not opaque. `pixels` are the samples of the cameras' pictures.
pub fn points_behind(
    points: &[Point],
    count: usize,
    cameras: &[Camera],
    pixels: &[PixelSample],
    seed: u64,
) -> Vec<Point> {
    let depths: Vec<Option<f32>> = cameras.iter().map(|camera| median_depth(points, camera)).collect();
    let draw = |index: usize| {
        let place = index % cameras.len();
        let camera = &cameras[place];
        let [x, y] = place_in(camera, index, seed);
        let rgba = pixels.get(place)?.rgba.get(index / cameras.len())?;
        let [r, g, b, a] = rgba.map(|channel| f32::from(channel) / 255.0);
        let nearness = 1.0 - random::uniform(seed, BEHIND_STREAM, 3 * index as u64 + 2) * (1.0 - BEHIND.recip());
        let ray = camera.camera_from_world.transpose() * camera.ray_in_camera(x, y);
        let position = camera.position + ray * (depths[place]? / nearness);
        (a == 1.0).then_some(Point { position: position.to_array(), color: [r, g, b] })
    };
    if cameras.is_empty() { Vec::new() } else { (0..count).filter_map(draw).collect() }
}

/// Largest ratio of the depth of a background point to the median depth of the cloud.
const BEHIND: f32 = 4.0;
const BEHIND_STREAM: u64 = 0x6265_6869;

/// Median depth of the points inside a camera's view.
fn median_depth(points: &[Point], camera: &Camera) -> Option<f32> {
    let seen = points.iter().filter(|point| pixel_of(camera, point.position).is_some());
    let depth = |point: &Point| (camera.camera_from_world * (position_vec(point.position) - camera.position)).z;
    let mut depths: Vec<f32> = seen.map(depth).collect();
    let middle = depths.len() / 2;
    (!depths.is_empty()).then(|| *depths.select_nth_unstable_by(middle, f32::total_cmp).1)
}

fn pixel_of(camera: &Camera, position: [f32; 3]) -> Option<[usize; 2]> {
    let p = camera.camera_from_world * (position_vec(position) - camera.position);
    let x = camera.focal_px[0] * p.x / p.z + camera.principal_px[0];
    let y = camera.focal_px[1] * p.y / p.z + camera.principal_px[1];
    let inside = p.z > 0.0 && x >= 0.0 && y >= 0.0 && x < camera.width as f32 && y < camera.height as f32;
    inside.then_some([x as usize, y as usize])
}

fn position_vec([x, y, z]: [f32; 3]) -> glam::Vec3 {
    glam::Vec3::new(x, y, z)
}

/// Creates Gaussians at the points, sized by the distance to their neighbours, in Morton order.
pub fn gaussians(points: &[Point], profile: &Profile, seed: u64) -> Gaussians<Vec<f32>> {
    let points = &in_space(points);
    let layout = profile.layout;
    let values = vec![0.0; len_of_values(points.len(), layout)];
    let mut gaussians = Gaussians { count: points.len(), layout, values };
    let log_scales = log_scales(points);
    for (index, point) in points.iter().enumerate() {
        gaussians.set(index, MEAN, point.position);
        gaussians.set(index, LOG_SCALE, [log_scales[index]; 3]);
        gaussians.set(index, QUAT, [1.0, 0.0, 0.0, 0.0]);
        gaussians.set(index, OPACITY, [logit(profile.start.opacity)]);
        if layout.is_shaded() {
            start_shading(&mut gaussians, index, point, profile, seed);
        } else {
            gaussians.set(index, layout.sh_start(), point.color.map(|c| (c - 0.5) / Y0));
        }
    }
    gaussians
}

/// Points in Morton order, the order of Gaussians in densification.
fn in_space(points: &[Point]) -> Vec<Point> {
    let bounds = points.iter().fold(Bounds::NOTHING, |bounds, point| bounds.with(point.position));
    let mut sorted = points.to_vec();
    sorted.sort_by_key(|point| bounds.code(point.position));
    sorted
}

fn start_shading(gaussians: &mut Gaussians<Vec<f32>>, index: usize, point: &Point, profile: &Profile, seed: u64) {
    let GaussianStart { tint, roughness, diffuse_share, .. } = profile.start;
    let diffuse = match profile.shading.form {
        ShadingForm::Paper | ShadingForm::Deferred | ShadingForm::Physical => {
            point.color.map(|c| logit(diffuse_share * linear_from_srgb(c)))
        }
        ShadingForm::Official => point.color,
    };
    gaussians.set(index, DIFFUSE, diffuse);
    gaussians.set(index, TINT, [logit(tint); 3]);
    gaussians.set(index, ROUGHNESS, [logit(roughness)]);
    if let (Some(first), Some(physical)) = (profile.layout.physical_planes(), profile.physical) {
        gaussians.set(index, first + ALBEDO, [logit(physical.albedo); 3]);
        gaussians.set(index, first + METALNESS, [logit(physical.metalness)]);
        gaussians.set(index, first + AMBIENT, [1.0; 3]);
    }
    if profile.shading.axis == AxisRule::None {
        let normal = [0, 1, 2].map(|axis| random::normal(seed, NORMAL_STREAM, 3 * index as u64 + axis));
        gaussians.set(index, NORMAL_RESIDUAL_1, normal);
        gaussians.set(index, NORMAL_RESIDUAL_2, normal);
    }
}

/// Logarithm of the root mean squared distance to the three nearest neighbours. Coincident points,
/// or a single one, count as 3e-4 apart, or as that share of a cloud smaller than one unit.
fn log_scales(points: &[Point]) -> Vec<f32> {
    const NEIGHBOURS: usize = 3;
    const SQUARE_MIN: f32 = 1e-7;
    let size = size_of(points);
    let square_min = SQUARE_MIN * if size > 0.0 { size.min(1.0).powi(2) } else { 1.0 };
    let square_min = square_min.max(f32::MIN_POSITIVE);
    // A search among equal points would visit all of them, so the tree has each position once.
    let (places, place_of) = distinct(points);
    let mut counts = vec![0_usize; places.len()];
    place_of.iter().for_each(|place| counts[*place] += 1);
    let tree: ImmutableKdTree<f32, 3> =
        ImmutableKdTree::new_from_slice(&places).expect("fewer than 2^32 finite points");
    let wanted = NonZero::new(NEIGHBOURS + 1).expect("four is not zero");
    let log_scale = |place: usize| {
        let found = tree.query(&places[place]).nearest_n::<SquaredEuclidean<f32>>(wanted).execute();
        let equal = iter::repeat_n(0.0, counts[place] - 1);
        let others = found.iter().filter(|neighbour| neighbour.item as usize != place);
        let others = others.flat_map(|neighbour| iter::repeat_n(neighbour.distance, counts[neighbour.item as usize]));
        let nearest: Vec<f32> = equal.chain(others).take(NEIGHBOURS).collect();
        let mean_square = nearest.iter().sum::<f32>() / nearest.len().max(1) as f32;
        0.5 * mean_square.clamp(square_min, f32::MAX).ln()
    };
    let log_scales: Vec<f32> = (0..places.len()).map(log_scale).collect();
    place_of.into_iter().map(|place| log_scales[place]).collect()
}

/// Distinct positions of points, and the index of every point's position.
fn distinct(points: &[Point]) -> (Vec<[f32; 3]>, Vec<usize>) {
    let mut places = Vec::new();
    let mut known = HashMap::new();
    let place_of = points.iter().map(|point| {
        // Adding zero makes zeros positive.
        let bits = point.position.map(|coordinate| (coordinate + 0.0).to_bits());
        *known.entry(bits).or_insert_with(|| {
            places.push(point.position);
            places.len() - 1
        })
    });
    let place_of = place_of.collect();
    (places, place_of)
}

/// Longest edge of the points' bounding box.
fn size_of(points: &[Point]) -> f32 {
    let edge = |axis: usize| {
        let along = points.iter().map(|point| point.position[axis]);
        along.clone().fold(f32::MIN, f32::max) - along.fold(f32::MAX, f32::min)
    };
    [0, 1, 2].map(edge).into_iter().fold(0.0, f32::max)
}

/// Learning rate of every plane of a layout at an iteration.
pub(crate) fn rates_by_plane(layout: Layout, rates: &crate::profile::Rates, extent: f32, step: u32) -> Vec<f32> {
    let mut by_plane = vec![0.0; layout.plane_count()];
    let mut fill = |first: usize, count: usize, rate: f32| by_plane[first..first + count].fill(rate);
    fill(MEAN, 3, rates.mean.at(step) * extent);
    fill(LOG_SCALE, 3, rates.log_scale.at(step));
    fill(QUAT, 4, rates.quat.at(step));
    fill(OPACITY, 1, rates.opacity.at(step));
    if layout.is_shaded() {
        fill(DIFFUSE, 3, rates.diffuse.at(step));
        fill(TINT, 3, rates.tint.at(step));
        fill(ROUGHNESS, 1, rates.roughness.at(step));
        fill(NORMAL_RESIDUAL_1, 3, rates.normal_residual[0].at(step));
        fill(NORMAL_RESIDUAL_2, 3, rates.normal_residual[1].at(step));
    }
    if let Some(first) = layout.physical_planes() {
        fill(first + ALBEDO, 3, rates.material.at(step));
        fill(first + METALNESS, 1, rates.material.at(step));
    }
    if layout.sh_count() > 0 {
        fill(layout.sh_start(), 3, rates.sh_first.at(step));
        fill(layout.sh_start() + 3, 3 * (layout.sh_count() - 1), rates.sh_rest.at(step));
    }
    by_plane
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use specula_core::color::UNKNOWN;

    #[test]
    fn an_empty_picture_carves_nothing() {
        const CLEAR: [u8; 4] = [9, 9, 9, 0];
        const SOLID: [u8; 4] = [9, 9, 9, 255];
        assert_eq!(Silhouette::of([CLEAR; 64].as_flattened()), None, "nothing is shown");
        assert_eq!(Silhouette::of([SOLID; 64].as_flattened()), None, "nothing is transparent");
        let mut one = [CLEAR; 64];
        one[9] = SOLID;
        assert_eq!(Silhouette::of(one.as_flattened()).expect("a silhouette").bytes(), [0, 2, 0, 0, 0, 0, 0, 0]);
    }

    #[test]
    fn scales_of_few_or_equal_points_are_finite() {
        let at = |x: f32| Point { position: [x, 0.0, 0.0], color: [0.5; 3] };
        let apart = |scale: f32| move |log_scale: &f32| (log_scale.exp() / scale - 1.0).abs() < 1e-5;
        assert!(log_scales(&[at(7.0)]).iter().all(apart(1e-7_f32.sqrt())), "one point");
        assert!(log_scales(&[at(7.0); 9]).iter().all(apart(1e-7_f32.sqrt())), "equal points");
        assert!(
            log_scales(&[at(0.0), at(-0.0), at(2.0)])[..2].iter().all(apart(2.0_f32.sqrt())),
            "0 and 4 in the mean"
        );
        let equal = [at(0.0), at(0.0), at(0.0), at(3.0), at(5.0)];
        assert!(log_scales(&equal)[..3].iter().all(apart(3.0_f32.sqrt())), "0, 0 and 9 in the mean");
        assert!(log_scales(&equal)[3..4].iter().all(apart((22.0 / 3.0_f32).sqrt())), "4, 9 and 9 in the mean");
        for size in [1e-30, 1e30] {
            assert!(log_scales(&[at(0.0), at(size)]).iter().all(|scale| scale.is_finite()), "{size}");
        }
    }

    #[test]
    fn scales_of_very_many_equal_points_are_found_at_once() {
        let points: Vec<Point> = (0..200_000).map(|_| Point { position: [0.1; 3], color: [0.5; 3] }).collect();
        assert!(log_scales(&points).iter().all(|scale| scale.is_finite()));
    }

    #[test]
    fn random_points_are_where_cameras_look() {
        let mean_of = |centre: [f32; 3]| {
            let eye = Vec3::from(centre) + Vec3::new(4.0, 0.0, 1.0);
            let ring = [eye, eye - Vec3::X * 8.0];
            let cameras = ring.map(|eye| Camera::look_at(eye, centre.into(), Vec3::Z, 0.7, 40, 30));
            let points = points_within(500, centre, &cameras, &[None, None], 3);
            points.iter().map(|point| Vec3::from(point.position)).sum::<Vec3>() / 500.0
        };
        for centre in [[0.0; 3], [3.0, 0.0, -3.0], [0.0, 40.0, 0.0]] {
            assert!(mean_of(centre).distance(centre.into()) < 0.15, "{centre:?}: {}", mean_of(centre));
        }
        assert_eq!(mean_of([0.1, 0.0, 0.0]), mean_of([0.0; 3]), "near the origin the cube is around it");
    }

    #[test]
    fn points_are_thinned_evenly() {
        let points = |count: usize| -> Vec<Point> {
            (0..count).map(|k| Point { position: [k as f32, 0.0, 0.0], color: [0.5; 3] }).collect()
        };
        let kept =
            |count: usize| -> Vec<f32> { thinned(points(10), count).iter().map(|point| point.position[0]).collect() };
        assert_eq!(kept(4), [0.0, 2.0, 5.0, 7.0]);
        assert_eq!(kept(10).len(), 10);
        assert_eq!(kept(11).len(), 10, "there are no more");
    }

    #[test]
    fn background_points_lie_in_their_picture_behind_the_cloud() {
        let camera = Camera::look_at(Vec3::X * 5.0, Vec3::ZERO, Vec3::Z, 0.7, 40, 30);
        let half = |pixel: u32| if pixel % 40 < 20 { UNKNOWN } else { [255, 0, 51, 255] };
        let rgba: Vec<u8> = (0..40 * 30).flat_map(half).collect();
        let behind = |seen: &[Point], count: usize| {
            let pixels = PixelSample::of(0, 1, count, &camera, &rgba, 3);
            points_behind(seen, count, &[camera], &[pixels], 3)
        };
        let seen = [-0.5, 0.0, 0.5].map(|x| Point { position: [x, 0.0, 0.0], color: [0.5; 3] });
        let points = behind(&seen, 200);
        assert!((60..140).contains(&points.len()), "{} points where half is known", points.len());
        for Point { position, color } in points {
            let [x, _] = pixel_of(&camera, position).expect("it is in the picture");
            let depth = 5.0 - position[0];
            assert!(x >= 19 && (4.999..20.01).contains(&depth), "at {x}, {depth} away");
            assert_eq!(color, [1.0, 0.0, 0.2]);
        }
        assert!(behind(&[], 9).is_empty(), "nothing is known of how far anything is");
    }
}
