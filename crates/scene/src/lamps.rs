//! Lamps of a scene: suns and spheres as text, and the surface that casts their shadows.

use crate::{OpenedModel, RenderOptions, Scene, SceneError, SceneRenderer, orbit};
use core::{f32::consts::FRAC_1_PI, fmt, str::FromStr};
use glam::{DQuat, DVec3, Vec3};
use rayon::prelude::*;
use specula_core::{
    camera::Camera,
    color::linear_from_srgb,
    lamps::{Lamp, LampOf, disc_axes, horizon, seen_share, shadow_ray, shift, spiral_point, toward},
    near_field::{NearField, VERTEX_ALBEDO, VERTEX_BASE},
    region::Ball,
    rules::{Channels, RenderRules},
    scene::Gaussians,
};
use specula_io::latlong::MapOrientation;
use specula_mesh::{
    fusion::{Fusion, evenly_spaced, voxels_resolved},
    near_field::SurfaceMeans,
    surface::Surface,
};
use std::sync::Arc;

/// Default irradiance of a sun: a white surface that faces it is about white.
const SUN_STRENGTH: f32 = 3.0;
/// Diameter of the sun as seen from Earth, in degrees.
const SUN_DIAMETER: f32 = 0.53;
/// Views that are fused into a surface.
const VIEWS: u32 = 100;
/// Longest edge of a fused view, in pixels.
const EDGE_MAX: u32 = 800;
/// Voxels along the longest edge of the volume, at most the number of pixels along a view's.
pub(crate) const VOXELS: u16 = 160;

/// Minimum number of shadow rays for interreflections of lamps. Fewer are a preview.
const RAYS_OF_REFLECTED: usize = 8;
/// Shadow rays of a vertex to an area lamp.
const VERTEX_RAYS: usize = 8;
/// Number of vertices per row of pixels.
const VERTEX_ROW: usize = 1000;

/// Lamps of a scene.
#[derive(Clone, Debug)]
pub struct SceneLamps {
    /// Lamps, in world space.
    pub lamps: Vec<Lamp>,
    /// Shadow rays of a pixel to each area lamp.
    pub rays: usize,
    /// Surface that casts shadows; `None` for no shadows.
    pub occluder: Option<Arc<Surface>>,
}

/// Colour of a lamp in sRGB; as text two hexadecimal digits each for red, green and blue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LampColor(pub [u8; 3]);

impl SceneLamps {
    /// True if surfaces reflect the light of lamps onto each other.
    pub(crate) fn reflects(&self) -> bool {
        self.rays >= RAYS_OF_REFLECTED
    }
}

impl LampColor {
    /// Default colour of a lamp.
    pub const WHITE: Self = Self([255; 3]);

    fn parse(text: &str) -> Option<Self> {
        let digits = text.strip_prefix('#').unwrap_or(text);
        if digits.len() != 6 || !digits.bytes().all(|byte| byte.is_ascii_hexdigit()) {
            return None;
        }
        let channel = |k: usize| u8::from_str_radix(&digits[2 * k..2 * k + 2], 16).ok();
        Some(Self([channel(0)?, channel(1)?, channel(2)?]))
    }

    /// Linear light of this colour, for white of this strength.
    fn light(self, strength: f32) -> [f32; 3] {
        self.0.map(|byte| linear_from_srgb(f32::from(byte) / 255.0) * strength)
    }
}

/// Writes a colon and the colour; nothing for white.
impl fmt::Display for LampColor {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            [255, 255, 255] => Ok(()),
            [red, green, blue] => write!(out, ":{red:02x}{green:02x}{blue:02x}"),
        }
    }
}

/// Numbers separated by commas, and a colour after a colon.
fn numbers_and_color(text: &str) -> Option<(Vec<f32>, LampColor)> {
    let (numbers, color) = match text.split_once(':') {
        Some((numbers, color)) => (numbers, LampColor::parse(color.trim())?),
        None => (text, LampColor::WHITE),
    };
    let numbers = crate::text::numbers::<f32>(numbers)?;
    numbers.iter().all(|number| number.is_finite()).then_some((numbers, color))
}

/// Sun as text: `AZ,EL[,STRENGTH[,ANGLE]][:RRGGBB]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SunChoice {
    /// Azimuth about the scene's up direction in degrees, counterclockwise as seen from above; 0 is
    /// the centre of an environment map.
    pub azimuth: f32,
    /// Elevation above the horizon in degrees.
    pub elevation: f32,
    /// Irradiance of a surface that faces a white sun.
    pub strength: f32,
    /// Diameter in degrees.
    pub diameter: f32,
    /// Colour.
    pub color: LampColor,
}

/// Text that is not a [`SunChoice`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "use AZIMUTH,ELEVATION in degrees, the elevation from −90 to 90, then STRENGTH of 0 or more and the sun's diameter below 180°, such as 30,45 or \
     30,45,3,0.53, and a colour after a colon, such as 30,45,3:ffddaa"
)]
pub struct InvalidSun;

impl FromStr for SunChoice {
    type Err = InvalidSun;

    fn from_str(text: &str) -> Result<Self, InvalidSun> {
        let (numbers, color) = numbers_and_color(text).ok_or(InvalidSun)?;
        let (azimuth, elevation, strength, diameter) = match numbers[..] {
            [azimuth, elevation] => (azimuth, elevation, SUN_STRENGTH, SUN_DIAMETER),
            [azimuth, elevation, strength] => (azimuth, elevation, strength, SUN_DIAMETER),
            [azimuth, elevation, strength, diameter] => (azimuth, elevation, strength, diameter),
            _ => return Err(InvalidSun),
        };
        let is_valid = elevation.abs() <= 90.0 && strength >= 0.0 && (0.0..180.0).contains(&diameter);
        let sun = Self { azimuth, elevation, strength, diameter, color };
        if is_valid { Ok(sun) } else { Err(InvalidSun) }
    }
}

impl fmt::Display for SunChoice {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { azimuth, elevation, strength, diameter, color } = self;
        write!(out, "{azimuth},{elevation},{strength},{diameter}{color}")
    }
}

impl SunChoice {
    /// The sun in a scene with this up direction, turned about it by an angle in degrees.
    pub fn lamp(&self, up: Vec3, turn: f32) -> Lamp {
        let direction = direction(self.azimuth + turn, self.elevation, up).as_vec3().to_array();
        Lamp::Sun { direction, irradiance: self.color.light(self.strength), diameter: self.diameter.to_radians() }
    }
}

/// Unit direction of an azimuth and an elevation in degrees, in a scene with this up direction.
pub fn direction(azimuth: f32, elevation: f32, up: Vec3) -> DVec3 {
    let uv = [0.5 - f64::from(azimuth) / 360.0, 0.5 - f64::from(elevation) / 180.0];
    MapOrientation::with_up(up.as_dvec3().to_array()).direction(uv).into()
}

/// Spherical lamp as text: `X,Y,Z,STRENGTH[,RADIUS][:RRGGBB]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SphereChoice {
    /// Centre, in world space.
    pub position: [f32; 3],
    /// Radiant intensity of a white lamp: irradiance at a distance of 1.
    pub strength: f32,
    /// Radius, in units of the scene.
    pub radius: f32,
    /// Colour.
    pub color: LampColor,
}

/// Text that is not a [`SphereChoice`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "use X,Y,Z,STRENGTH and a radius, neither of them negative, such as 1,0,2,5 or 1,0,2,5,0.1, and a colour after a \
     colon, such as 1,0,2,5:ffddaa"
)]
pub struct InvalidSphere;

impl FromStr for SphereChoice {
    type Err = InvalidSphere;

    fn from_str(text: &str) -> Result<Self, InvalidSphere> {
        let (numbers, color) = numbers_and_color(text).ok_or(InvalidSphere)?;
        let (position, strength, radius) = match numbers[..] {
            [x, y, z, strength] => ([x, y, z], strength, 0.0),
            [x, y, z, strength, radius] => ([x, y, z], strength, radius),
            _ => return Err(InvalidSphere),
        };
        if strength < 0.0 || radius < 0.0 {
            return Err(InvalidSphere);
        }
        Ok(Self { position, strength, radius, color })
    }
}

impl fmt::Display for SphereChoice {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { position: [x, y, z], strength, radius, color } = self;
        write!(out, "{x},{y},{z},{strength},{radius}{color}")
    }
}

impl SphereChoice {
    /// The lamp in the scene's world space.
    pub fn lamp(&self) -> Lamp {
        let Self { position, strength, radius, color } = *self;
        Lamp::Sphere { position, intensity: color.light(strength), radius }
    }
}

/// Suns and lamps in a scene with this up direction; suns are turned about it by an angle in
/// degrees.
pub fn lamps_of(suns: &[SunChoice], spheres: &[SphereChoice], up: Vec3, turn: f32) -> Vec<Lamp> {
    let suns = suns.iter().map(|sun| sun.lamp(up, turn));
    suns.chain(spheres.iter().map(SphereChoice::lamp)).collect()
}

/// Orientation of an environment map turned about the scene's up direction by an angle in degrees,
/// counterclockwise as seen from above, like azimuths.
pub fn turned(orientation: MapOrientation, up: Vec3, degrees: f32) -> MapOrientation {
    let turn = DQuat::from_axis_angle(up.as_dvec3().normalize(), f64::from(degrees).to_radians());
    match orientation {
        _ if degrees == 0.0 => orientation,
        MapOrientation::Axis(map) => MapOrientation::rotated(map, turn),
        MapOrientation::Rotated { map, world_from_map } => MapOrientation::rotated(map, turn * world_from_map),
    }
}

/// Shadow-casting surface of a model: its near field if it has one, else a mesh fused from the
/// depths of its training views, or of views around it. `None` if no view shows a surface.
/// `progress` receives the number of fused views and of all.
///
/// # Errors
///
/// Those of [`SceneRenderer::render`], or a `cameras.json` that cannot be read.
pub fn shadow_surface(
    opened: &OpenedModel,
    options: &RenderOptions,
    progress: impl FnMut(usize, usize),
) -> Result<Option<Arc<Surface>>, SceneError> {
    let scene = &opened.scene;
    if scene.near_field.is_some() || scene.gaussians.count == 0 {
        return Ok(scene.near_field.clone());
    }
    let cameras = opened.surrounding_cameras(VIEWS)?;
    let unlit = Scene { light: None, lamps: None, ..scene.clone() };
    let mut renderer = SceneRenderer::without_light(unlit, Channels::Training, options)?;
    fused_surface(&mut renderer, &scene.gaussians, &cameras, progress)
}

/// Surface of Gaussians on a renderer, fused from the depths of up to a hundred of these cameras,
/// evenly chosen; without cameras, of cameras around the Gaussians. `None` if no view shows a
/// surface. `progress` receives the number of fused views and of all.
///
/// # Errors
///
/// Those of [`SceneRenderer::render`].
pub fn fused_surface(
    renderer: &mut SceneRenderer,
    gaussians: &Gaussians<Vec<f32>>,
    cameras: &[Camera],
    mut progress: impl FnMut(usize, usize),
) -> Result<Option<Arc<Surface>>, SceneError> {
    if gaussians.count == 0 {
        return Ok(None);
    }
    let around = if cameras.is_empty() { orbit::sphere(gaussians, VIEWS) } else { Vec::new() };
    let cameras = evenly_spaced(if cameras.is_empty() { &around } else { cameras }, VIEWS as usize);
    let unlit = RenderRules { is_lit: false, traces_near: false, illuminates: false, ..*renderer.rules() };
    let rules = RenderRules { channels: Channels::Training, ..unlit };
    let cameras: Vec<Camera> = cameras.iter().map(|camera| camera.limited(EDGE_MAX)).collect();
    let mut fusion = Fusion::around(gaussians, voxels_resolved(VOXELS, &cameras));
    for (index, camera) in cameras.iter().enumerate() {
        fusion.add(camera, &renderer.render_lit(SceneRenderer::SCENE_LIGHT, camera, &rules)?);
        progress(index + 1, cameras.len());
    }
    Ok(SurfaceMeans::new(fusion.mesh(), fusion.voxel_size()).near_field().map(Surface::shared))
}

/// Self-shadowed share of the part of a surface within a ball that faces the direction `to_sun`;
/// `None` if no part does. Vertices are sampled.
pub fn share_in_shadow(surface: &Surface, to_sun: Vec3, ball: &Ball) -> Option<f64> {
    const SAMPLES: usize = 4096;
    let facing = (0..surface.vertex_count).filter_map(|vertex| {
        let numbers = surface.vertex(vertex);
        let [position, normal] = [0, 3].map(|first| Vec3::from_slice(&numbers[first..]));
        let normal = normal.normalize_or_zero();
        let is_lit = ball.contains(position.into()) && normal.dot(to_sun) > 0.0;
        is_lit.then(|| position + surface.offset * normal)
    });
    let facing: Vec<Vec3> = facing.collect();
    let sampled: Vec<Vec3> = facing.iter().copied().step_by(facing.len().div_ceil(SAMPLES).max(1)).collect();
    let hidden =
        sampled.par_iter().filter(|start| surface.first_hit((**start).into(), to_sun.into()).is_some()).count();
    (!sampled.is_empty()).then(|| hidden as f64 / sampled.len() as f64)
}

/// Adds the light of lamps to the base colours of a reflected surface, if its vertices have a
/// diffuse albedo.
pub(crate) fn shine_on(near_field: &mut NearField<Vec<f32>>, lamps: &SceneLamps) {
    let light = radiances(near_field, lamps);
    for (numbers, added) in near_field.vertices_mut().iter_mut().zip(light) {
        (0..3).for_each(|k| numbers[VERTEX_BASE + k] += added[k]);
    }
}

/// Irradiance / π at the vertices of a surface by lamp light after one or two diffuse
/// interreflections, three numbers each; `None` if there is no such light, without computing the
/// visibility.
pub(crate) fn reflected_by(surface: &Surface, lamps: &SceneLamps) -> Vec<f32> {
    let direct = radiances(surface, lamps);
    if direct.iter().all(|light| *light == Vec3::ZERO) {
        return Vec::new();
    }
    let sight = surface.sight();
    let once = sight.irradiance(&direct);
    let albedo = |vertex: usize| Vec3::from_slice(&surface.vertex(vertex)[VERTEX_ALBEDO..]);
    let added = direct.iter().zip(once).enumerate().map(|(vertex, (light, again))| light + albedo(vertex) * again);
    sight.irradiance(&added.collect::<Vec<_>>()).into_iter().flat_map(|light| light.to_array()).collect()
}

/// Radiance that leaves the diffuse layers of a surface's vertices under lamps.
fn radiances(near_field: &NearField<Vec<f32>>, lamps: &SceneLamps) -> Vec<Vec3> {
    let SceneLamps { lamps, occluder, .. } = lamps;
    let lamps: Vec<([f32; LampOf::<f32>::LEN], usize)> =
        lamps.iter().map(|lamp| (lamp.numbers(), if lamp.is_wide() { VERTEX_RAYS } else { 1 })).collect();
    let spiral: Vec<[f32; 4]> = (0..VERTEX_RAYS).map(|k| spiral_point(k, VERTEX_RAYS)).collect();
    let vertices = 0..near_field.vertex_count;
    let radiance = |index: usize| {
        let numbers = near_field.vertex(index);
        let albedo = Vec3::from_slice(&numbers[VERTEX_ALBEDO..]);
        if albedo == Vec3::ZERO {
            return Vec3::ZERO;
        }
        let [position, normal] = [0, 3].map(|first| Vec3::from_slice(&numbers[first..]));
        let normal = normal.normalize_or_zero();
        let from = position + near_field.offset * normal;
        // Vertices are evaluated like pixels.
        let [column, row] = [index % VERTEX_ROW, index / VERTEX_ROW].map(|k| k as f32);
        let mut irradiance = Vec3::ZERO;
        for (lamp, (of_lamp, rays)) in lamps.iter().enumerate() {
            let seen = toward(&LampOf::from_array(*of_lamp), position.into(), normal.into());
            let light = Vec3::from(seen.irradiance) * horizon(normal.dot(Vec3::from(seen.direction)), seen.sine);
            let (axes, shift) = (disc_axes(seen.direction), shift(column, row, lamp as f32));
            let (mut all, mut arriving) = (0.0, 0.0);
            for point in &spiral[..*rays] {
                let ray = shadow_ray(normal.into(), &seen, axes, &shift, *point);
                let is_blocked = |occluder: &Arc<Surface>| {
                    ray.weight > 0.0 && occluder.is_blocked(from.into(), ray.direction, seen.reach)
                };
                all += ray.weight;
                arriving += if occluder.as_ref().is_some_and(is_blocked) { 0.0 } else { ray.weight };
            }
            irradiance += light * seen_share(all, arriving);
        }
        albedo * irradiance * FRAC_1_PI
    };
    vertices.into_par_iter().map(radiance).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_mesh::Mesh;

    /// Rounding of a direction from degrees.
    const SAME: f32 = 1e-6;

    #[test]
    fn azimuths_of_suns_match_environment_maps() {
        let sun = |text: &str, up: Vec3, turn: f32| match text.parse::<SunChoice>().unwrap().lamp(up, turn) {
            Lamp::Sun { direction, .. } => Vec3::from(direction),
            Lamp::Sphere { .. } => unreachable!("a sun was named"),
        };
        let is_near = |a: Vec3, b: Vec3| a.distance(b) < SAME;
        assert!(is_near(sun("0,0", Vec3::Z, 0.0), Vec3::X), "the centre of a map");
        assert!(is_near(sun("90,0", Vec3::Z, 0.0), Vec3::Y), "counterclockwise from above");
        assert!(is_near(sun("30,0", Vec3::Z, 60.0), Vec3::Y), "and so it turns");
        assert!(is_near(sun("123,90", Vec3::Y, 0.0), Vec3::Y), "the zenith");
        let up = Vec3::new(1.0, -2.0, 0.5).normalize();
        let [east, north] = ["10,30", "100,30"].map(|text| sun(text, up, 0.0));
        assert!((east.dot(up) - 0.5).abs() < SAME && (north.dot(up) - 0.5).abs() < SAME, "the elevation is about up");
        assert!(east.cross(north).dot(up) > 0.0, "counterclockwise about any up");
    }

    #[test]
    fn environments_turn_with_suns() {
        let up = Vec3::new(0.2, 1.0, -0.4).normalize();
        for up in [Vec3::Z, Vec3::Y, up] {
            let straight = MapOrientation::with_up(up.as_dvec3().to_array());
            let center = DVec3::from(turned(straight, up, 70.0).direction([0.5; 2]));
            assert!(center.distance(direction(70.0, 0.0, up)) < f64::from(SAME), "{up}");
            assert_eq!(turned(straight, up, 0.0), straight);
        }
    }

    /// Corners of a horizontal square.
    fn square(half: f32, height: f32) -> [[f32; 3]; 4] {
        [[-half, -half, height], [half, -half, height], [half, half, height], [-half, half, height]]
    }

    /// Floor below a roof that covers it, or without the roof.
    #[test]
    fn a_roof_shadows_the_floor_below_it() {
        let shadowed = |triangles: Vec<[u32; 3]>, radius: f32| {
            let positions = [square(1.0, 0.0), square(2.0, 1.5)].concat();
            let mesh = Mesh {
                normals: vec![[0.0, 0.0, 1.0]; positions.len()],
                colors: vec![[0.0; 3]; positions.len()],
                triangles,
                positions,
            };
            let surface: Surface = SurfaceMeans::new(mesh, 1e-3).near_field().expect("there are triangles").into();
            share_in_shadow(&surface, Vec3::Z, &Ball { center: [0.0; 3], radius })
        };
        let (floor, roof) = ([[0, 1, 2], [0, 2, 3]], [[4, 6, 5], [4, 7, 6]]);
        // The corners of the floor are √2 from its centre, those of the roof √10.25.
        assert_eq!(shadowed([floor, roof].concat(), 2.0), Some(1.0));
        assert_eq!(shadowed(floor.to_vec(), 2.0), Some(0.0));
        assert_eq!(shadowed([floor, roof].concat(), 4.0), Some(0.5), "the roof itself is lit");
        assert_eq!(shadowed(floor.to_vec(), 1.0), None, "no corner is that near");
    }

    /// Two horizontal squares under a sun, one above the other: the upper one is lit and shades the
    /// middle of the larger one below.
    #[test]
    fn reflected_surfaces_are_lit_by_lamps() {
        let positions = [square(1.0, 1.0), square(0.5, 0.0), square(3.0, 0.0)].concat();
        let mesh = Mesh {
            normals: vec![[0.0, 0.0, 1.0]; positions.len()],
            colors: vec![[0.0; 3]; positions.len()],
            // Rays see the roof from below.
            triangles: vec![[0, 2, 1], [0, 3, 2]],
            positions,
        };
        let mut near_field = SurfaceMeans::new(mesh, 1e-3).near_field().expect("there are triangles");
        let albedo = [0.2, 0.4, 0.8];
        near_field.vertices_mut().iter_mut().for_each(|numbers| {
            numbers[VERTEX_BASE..VERTEX_BASE + 3].fill(0.125);
            numbers[VERTEX_ALBEDO..].copy_from_slice(&albedo);
        });
        let occluder = Some(Surface::shared(near_field.clone()));
        let sun = Lamp::Sun { direction: [0.0, 0.0, 1.0], irradiance: [3.0; 3], diameter: 0.01 };
        shine_on(&mut near_field, &SceneLamps { lamps: vec![sun], rays: 4, occluder });
        for vertex in 0..12 {
            let is_shaded = (4..8).contains(&vertex);
            let numbers = near_field.vertex(vertex);
            for (found, albedo) in numbers[VERTEX_BASE..].iter().zip(albedo) {
                let expected = 0.125 + if is_shaded { 0.0 } else { albedo * 3.0 * FRAC_1_PI };
                assert!((found - expected).abs() < 1e-5, "vertex {vertex}: {found} rather than {expected}");
            }
        }
    }

    #[test]
    fn lamps_are_read_as_people_write_them() {
        let sun: SunChoice = "30, 45, 2:ff0080".parse().unwrap();
        assert_eq!((sun.azimuth, sun.elevation, sun.diameter), (30.0, 45.0, SUN_DIAMETER));
        let [red, green, blue] = sun.color.light(sun.strength);
        assert_eq!([red, green], [2.0, 0.0]);
        assert!((blue - 2.0 * 0.215_861).abs() < 1e-4, "the colour is in sRGB: {sun:?}");
        assert_eq!(sun.to_string().parse(), Ok(sun));
        assert_eq!("-30,45".parse::<SunChoice>().unwrap().strength, SUN_STRENGTH);
        assert_eq!("0,10,1,3".parse::<SunChoice>().unwrap().diameter, 3.0);
        let lamp: SphereChoice = "1,-2,3,4,0.5:#ffffff".parse().unwrap();
        let white = Lamp::Sphere { position: [1.0, -2.0, 3.0], intensity: [4.0; 3], radius: 0.5 };
        assert_eq!((lamp.lamp(), lamp.to_string().as_str()), (white, "1,-2,3,4,0.5"));
        for wrong in ["", "1", "0,91", "0,45,-1", "0,45,1,180", "0,45,1,1,1", "0,45:red", "0,45:fffff", "NaN,0"] {
            assert!(wrong.parse::<SunChoice>().is_err(), "{wrong:?} passed for a sun");
        }
        for wrong in ["", "1,2,3", "1,2,3,-4", "1,2,3,4,-1", "1,2,3,4,5,6", "inf,0,0,1", "1,2,3,4:éé"] {
            assert!(wrong.parse::<SphereChoice>().is_err(), "{wrong:?} passed for a lamp");
        }
    }
}
