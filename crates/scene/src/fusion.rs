//! Meshes of a scene by volumetric fusion ([`specula_mesh::fusion`]), with colours at vertices or
//! with textures of its materials.

use crate::{RenderOptions, Scene, SceneError, SceneRenderer, Shading, number::group_digits};
use glam::Vec3;
use specula_core::{
    activation::{logit, sigmoid},
    camera::Camera,
    color::srgb_from_linear,
    rules::{Channels, channel},
    scene::{Gaussians, Image, OPACITY},
};
use specula_io::{
    mesh::{Mesh, TexturedMesh},
    picture::RgbImage,
};
use specula_mesh::{
    align::aligned, atlas::Atlas, fusion::Fusion, means::PointMeans, simplify::simplified, texture::Texels,
};

/// Size of a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MeshSize {
    /// Voxels along the longest edge of the volume of the Gaussians.
    pub voxels: u16,
    /// Largest number of triangles, which are aligned with the normals of views; without, all
    /// triangles of the surface, as they are.
    pub triangles: Option<usize>,
}

/// Mesh of a scene.
#[derive(Clone, Debug)]
pub struct Fused<M> {
    /// The mesh.
    pub mesh: M,
    /// Number of small components that were omitted.
    pub omitted: usize,
}

/// Fuses the views of some cameras into a mesh with colours at vertices. `progress` is given the
/// number of rendered views after each, and of all.
///
/// # Errors
///
/// Those of [`SceneRenderer::render`].
///
/// # Panics
///
/// Without Gaussians.
pub fn fuse(
    scene: &Scene,
    cameras: &[Camera],
    size: MeshSize,
    options: &RenderOptions,
    progress: impl FnMut(usize, usize),
) -> Result<Fused<Mesh>, SceneError> {
    let passes = 1 + usize::from(size.triangles.is_some() && scene.gaussians.layout.is_shaded());
    let mut views = Views { cameras, done: 0, all: passes * cameras.len(), progress };
    let shown = if size.triangles.is_some() { solid(scene) } else { scene.clone() };
    let mut renderer = SceneRenderer::new(shown, Channels::Training, options)?;
    let (Fused { mesh, omitted }, voxel) = views.surface(&mut renderer, &scene.gaussians, size.voxels)?;
    let mesh = match size.triangles {
        Some(count_max) => {
            let mut renderer = SceneRenderer::without_light(scene.clone(), Channels::Training, options)?;
            let read = scene.gaussians.layout.is_shaded().then_some(color as Read);
            views.simplified(&mut renderer, read, mesh, voxel, count_max)?
        }
        None => mesh,
    };
    let specula_mesh::Mesh { positions, normals, colors, triangles } = mesh;
    Ok(Fused { mesh: Mesh { positions, normals, colors, triangles }, omitted })
}

/// Fuses the views of some cameras into a mesh of at most `triangles`, with textures of `texels`
/// rows and columns: base colour, roughness and metalness of a scene of physical materials, else
/// only the colours of its pictures; and normals of a shaded scene. `None` if no view shows a
/// surface.
///
/// Texels are means over the views that show them. `progress` is given the number of rendered
/// views after each, and of all.
///
/// # Errors
///
/// Those of [`SceneRenderer::render`]; [`SceneError::Texture`] for a texture that is too small.
///
/// # Panics
///
/// Without Gaussians.
pub fn fuse_textured(
    scene: &Scene,
    cameras: &[Camera],
    (voxels, triangles, texels): (u16, usize, u32),
    options: &RenderOptions,
    progress: impl FnMut(usize, usize),
) -> Result<Option<Fused<TexturedMesh>>, SceneError> {
    let layout = scene.gaussians.layout;
    let passes = 2 + usize::from(layout.is_shaded());
    let mut views = Views { cameras, done: 0, all: passes * cameras.len(), progress };
    let mut renderer = SceneRenderer::without_light(solid(scene), Channels::Training, options)?;
    let (Fused { mesh, omitted }, voxel) = views.surface(&mut renderer, &scene.gaussians, voxels)?;
    if mesh.triangles.is_empty() {
        return Ok(None);
    }
    let (mut renderer, read): (_, Read) = if layout.is_physical {
        let scene = scene.clone().shaded(Shading::Physical)?;
        (SceneRenderer::without_light(scene, Channels::Layers, options)?, material)
    } else {
        (SceneRenderer::new(scene.clone(), Channels::Training, options)?, color)
    };
    let normals = layout.is_shaded().then_some(read);
    let mesh = views.simplified(&mut renderer, normals, mesh, voxel, triangles)?;
    tracing::info!(
        "unfolding {} triangles into textures of {texels} × {texels}, which can take minutes",
        group_digits(mesh.triangles.len())
    );
    let atlas = Atlas::new(&mesh, texels)?;
    let texels = Texels::new(&atlas);
    let means = views.means(&mut renderer, read, [&texels.positions, &texels.normals], voxel)?;

    let base_color = image(&texels, &means, |numbers, _| [RED, RED + 1, RED + 2].map(|k| numbers[k]));
    let materials = |numbers: &[f32; NUMBERS], _| [1.0, numbers[ROUGHNESS], numbers[METALNESS]];
    let surface = layout.is_physical.then(|| image(&texels, &means, materials));
    let tangent = |numbers: &[f32; NUMBERS], texel| {
        (0.5 + 0.5 * texels.in_tangent_space(texel, Vec3::from_slice(&numbers[NORMAL..]))).to_array()
    };
    let normal_map = layout.is_shaded().then(|| image(&texels, &means, tangent));
    let Atlas { mesh: specula_mesh::Mesh { positions, normals, triangles, .. }, tangents, uvs, .. } = atlas;
    let mesh = TexturedMesh { positions, normals, tangents, uvs, triangles, base_color, surface, normal_map };
    Ok(Some(Fused { mesh, omitted }))
}

/// Scene whose opacities o become 1 − (1 − o)⁸, so that depths are those of its outermost
/// Gaussians: a mean over a ray lies behind the surface by what shines through it.
fn solid(scene: &Scene) -> Scene {
    const TIMES: i32 = 8;
    /// Opacity that has a logit.
    const OPAQUE: f32 = 0.9999;
    let mut solid = scene.clone();
    for index in 0..solid.gaussians.count {
        let [opacity] = solid.gaussians.get::<1>(index, OPACITY).map(sigmoid);
        if opacity < OPAQUE {
            let opacity = 1.0 - (1.0 - opacity).powi(TIMES);
            solid.gaussians.set(index, OPACITY, [logit(opacity.clamp(f32::MIN_POSITIVE, OPAQUE))]);
        }
    }
    solid
}

/// Views of a scene, each of them rendered in several passes.
struct Views<'a, P> {
    cameras: &'a [Camera],
    /// Number of rendered views, and of all.
    done: usize,
    all: usize,
    progress: P,
}

impl<P: FnMut(usize, usize)> Views<'_, P> {
    /// Renders every view once.
    fn each(
        &mut self,
        renderer: &mut SceneRenderer,
        mut see: impl FnMut(&Camera, &Image<Vec<f32>>),
    ) -> Result<(), SceneError> {
        for camera in self.cameras {
            see(camera, &renderer.render(camera)?);
            self.done += 1;
            (self.progress)(self.done, self.all);
        }
        Ok(())
    }

    /// Surface, and the size of its voxels.
    fn surface(
        &mut self,
        renderer: &mut SceneRenderer,
        gaussians: &Gaussians<Vec<f32>>,
        voxels: u16,
    ) -> Result<(Fused<specula_mesh::Mesh>, f32), SceneError> {
        let mut fusion = Fusion::around(gaussians, voxels);
        self.each(renderer, |camera, image| fusion.add(camera, image))?;
        let (mesh, omitted) = fusion.mesh_and_omitted();
        Ok((Fused { mesh, omitted }, fusion.voxel_size()))
    }

    /// Mesh aligned with the normals of the views, or its own if the scene has none, of at most
    /// `count_max` triangles.
    fn simplified(
        &mut self,
        renderer: &mut SceneRenderer,
        read: Option<Read>,
        mesh: specula_mesh::Mesh,
        voxel: f32,
        count_max: usize,
    ) -> Result<specula_mesh::Mesh, SceneError> {
        let normals = match read {
            Some(read) => {
                let means = self.means(renderer, read, [&mesh.positions, &mesh.normals], voxel)?;
                let normal = |numbers: [f32; NUMBERS]| [NORMAL, NORMAL + 1, NORMAL + 2].map(|k| numbers[k]);
                means.into_iter().map(|mean| mean.map_or([0.0; 3], normal)).collect()
            }
            None => vec![[0.0; 3]; mesh.positions.len()],
        };
        let [from, to] = [mesh.triangles.len(), count_max].map(group_digits);
        tracing::info!("simplifying {from} triangles to {to}, which can take minutes");
        Ok(simplified(aligned(&mesh, &normals), count_max).with_own_normals())
    }

    /// Means over the views of numbers of points, given by positions and normals.
    fn means(
        &mut self,
        renderer: &mut SceneRenderer,
        read: Read,
        [positions, normals]: [&[[f32; 3]]; 2],
        voxel: f32,
    ) -> Result<Vec<Option<[f32; NUMBERS]>>, SceneError> {
        let mut means = PointMeans::new(positions, normals, voxel);
        self.each(renderer, |camera, image| means.add(camera, image, read))?;
        Ok(means.means())
    }
}

/// Reads the numbers of a covered pixel: image, pixel, coverage.
type Read = fn(&Image<Vec<f32>>, usize, f32) -> [f32; NUMBERS];

/// Numbers of a point: base colour, sRGB-encoded, normal, roughness and metalness.
const NUMBERS: usize = 8;
const RED: usize = 0;
const NORMAL: usize = 3;
const ROUGHNESS: usize = 6;
const METALNESS: usize = 7;

/// Colour in a picture, and normal.
fn color(image: &Image<Vec<f32>>, pixel: usize, coverage: f32) -> [f32; NUMBERS] {
    let at = |plane: usize| image.plane(plane)[pixel] / coverage;
    let [red, green, blue] = [0, 1, 2].map(|k| at(channel::COLOR + k));
    let [x, y, z] = [0, 1, 2].map(|k| at(channel::NORMAL + k));
    [red, green, blue, x, y, z, 1.0, 0.0]
}

/// Physical material and normal.
fn material(image: &Image<Vec<f32>>, pixel: usize, coverage: f32) -> [f32; NUMBERS] {
    let at = |plane: usize| image.plane(plane)[pixel] / coverage;
    let [red, green, blue] = [0, 1, 2].map(|k| srgb_from_linear(at(channel::DIFFUSE + k)));
    let [x, y, z] = [0, 1, 2].map(|k| at(channel::NORMAL + k));
    [red, green, blue, x, y, z, at(channel::ROUGHNESS), at(channel::METALNESS)]
}

/// Texture with a colour, from 0 to 1, of the means of each texel.
fn image(
    texels: &Texels,
    means: &[Option<[f32; NUMBERS]>],
    color: impl Fn(&[f32; NUMBERS], usize) -> [f32; 3],
) -> RgbImage {
    let colors = means.iter().enumerate().map(|(texel, mean)| mean.as_ref().map(|numbers| color(numbers, texel)));
    let filled = texels.filled(&colors.collect::<Vec<_>>());
    let byte = |x: f32| (255.0 * x).round().clamp(0.0, 255.0) as u8;
    let bytes = filled.into_iter().flatten().map(byte).collect();
    let size = texels.size as u32;
    RgbImage::from_raw(size, size, bytes).expect("three bytes for each texel")
}
