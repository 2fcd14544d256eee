//! Export of Gaussians to the formats of other programs.
//!
//! Other programs have no shading function, so [`PlainGaussians`] are baked from a shaded scene
//! first. A scene is written as `.splat`, its shading baked from its own cameras:
//!
//! ```no_run
//! use specula_cpu::CpuExecutor;
//! use specula_scene::{
//!     OpenedModel,
//!     export::{BakeMethod, GaussianFormat, PlainGaussians, visible},
//! };
//! use std::path::Path;
//!
//! let model = OpenedModel::open(Path::new("out/vase"))?;
//! let cameras: Vec<_> = model.training_cameras()?.into_iter().map(|(_, camera)| camera).collect();
//! let kept = visible(&model.scene.gaussians, 0.005);
//! let format = GaussianFormat::Splat;
//! let plain = PlainGaussians::bake(
//!     CpuExecutor::new(),
//!     &model.scene,
//!     kept,
//!     &cameras,
//!     format.degree_max(),
//!     BakeMethod::Harmonics,
//!     |_, _| {},
//! )?;
//! plain.write(Path::new("vase.splat"), format, &model.scene, None, &[])?;
//! # Ok::<(), Box<dyn core::error::Error>>(())
//! ```

mod comparison;
mod materials;

pub use comparison::{PictureError, ReferencePictures};

use crate::{
    OpenedModel, RenderOptions, Scene, SceneError, Shading as Shown,
    bake::{ActivatedAttributes, Baked, bake, bake_diffuse},
    environment::radiance,
    export::materials::surface_materials,
    number::group_digits,
    plain::{opacity, subset, unfiltered},
    upright::{AxisConvention, Upright},
};
use glam::{DVec3, Vec4};
use serde_json::json;
use specula_core::{
    antialias::LowPass,
    camera::Camera,
    cull::CullReason,
    executor::ReadBack,
    scene::{Environment, Gaussians, Layout, QUAT},
    shade::ShadingRules,
};
use specula_io::{
    Result,
    gaussian_ply::{self, SurfaceMaterial},
    glb::{self, Attribute, Shading},
    latlong::{self, LatLong, UpAxis},
    origin, splat, spz,
    usd::{self, Stage},
};
use std::path::Path;

/// Format of Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GaussianFormat {
    /// PLY in INRIA's layout, with normals.
    Ply,
    /// 32 bytes for each Gaussian, of one colour.
    Splat,
    /// Niantic's compressed format.
    Spz,
    /// glTF with `KHR_gaussian_splatting`, and the attributes of shading.
    Glb,
    /// OpenUSD, text or archive, with normals and materials as primvars, and the light.
    Usd,
}

impl GaussianFormat {
    /// Format of an extension in lower case, without a dot.
    pub fn from_extension(extension: &str) -> Option<Self> {
        match extension {
            "ply" => Some(Self::Ply),
            "splat" => Some(Self::Splat),
            "spz" => Some(Self::Spz),
            "glb" => Some(Self::Glb),
            "usda" | "usdz" => Some(Self::Usd),
            _ => None,
        }
    }

    /// Highest degree of harmonics.
    pub const fn degree_max(self) -> u8 {
        match self {
            Self::Splat => 0,
            Self::Ply | Self::Spz | Self::Glb | Self::Usd => 3,
        }
    }

    /// Axes of an upright scene, as readers of the format display it.
    pub const fn axes(self) -> AxisConvention {
        match self {
            Self::Ply | Self::Splat => AxisConvention::YDown,
            Self::Spz | Self::Glb | Self::Usd => AxisConvention::YUp,
        }
    }

    /// Whether a transform of the file places the scene, instead of its numbers.
    pub const fn has_node(self) -> bool {
        matches!(self, Self::Glb | Self::Usd)
    }
}

/// Content of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExportFormat {
    /// Gaussians.
    Gaussians(GaussianFormat),
    /// Light as a lat-long map.
    LatLong,
    /// Light, prefiltered for each roughness.
    PrefilteredLight,
    /// Mesh of triangles.
    Mesh,
    /// Mesh of triangles with textures, as glTF.
    TexturedMesh,
    /// Mesh of triangles with textures, as OpenUSD.
    MeshStage,
    /// Page for a browser, with its renderer, in one file.
    Page,
    /// Page for a browser as files in a folder.
    PageFolder,
}

impl ExportFormat {
    /// Format of an extension in lower case, without a dot; `.ply`, `.glb`, `.usda` and `.usdz`
    /// hold meshes if `is_mesh`.
    pub fn from_extension(extension: &str, is_mesh: bool) -> Option<Self> {
        match (extension, is_mesh) {
            ("obj", _) | ("ply", true) => Some(Self::Mesh),
            ("glb", true) => Some(Self::TexturedMesh),
            ("usda" | "usdz", true) => Some(Self::MeshStage),
            ("hdr" | "exr", _) => Some(Self::LatLong),
            ("ktx2", _) => Some(Self::PrefilteredLight),
            ("html", _) => Some(Self::Page),
            _ => GaussianFormat::from_extension(extension).map(Self::Gaussians),
        }
    }

    /// Whether it is a mesh with textures.
    pub fn has_textures(&self) -> bool {
        matches!(self, Self::TexturedMesh | Self::MeshStage)
    }
}

/// Sentence of a file on its origin.
pub fn provenance(content: &str) -> String {
    format!("exported by specula {}: {content}", env!("CARGO_PKG_VERSION"))
}

/// True if a file is the source of a model: the model itself, or a file in its folder.
pub fn is_of_model(file: &Path, model: &Path, folder: Option<&Path>) -> bool {
    let Ok(file) = file.canonicalize() else { return false };
    let is_within = |name: &str| {
        let path = folder.and_then(|folder| folder.join(name).canonicalize().ok());
        path.is_some_and(|path| file.starts_with(path))
    };
    let is_read = model.canonicalize().is_ok_and(|model| model == file);
    is_read || ["point_cloud", "light", "brdf_mlp", "input.ply"].into_iter().any(is_within)
}

/// Scene of a relightable file, as it is read again, with its near field and under a light.
///
/// # Errors
///
/// A file that cannot be read, or without materials ([`SceneError::NoMaterials`]); those of
/// [`OpenedModel::fuse_near_field`].
pub fn read_relightable(
    path: &Path,
    light: Option<Environment<Vec<f32>>>,
    options: &RenderOptions,
) -> core::result::Result<Scene, SceneError> {
    let mut opened = OpenedModel::open(path)?;
    opened.fuse_near_field(options, |_, _| {})?;
    if let Some(light) = light {
        opened.scene.put_under(light);
    }
    opened.scene.shaded(Shown::Physical)
}

/// Method by which a shading function becomes colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BakeMethod {
    /// Harmonics of the colours under the scene's light ([`bake`]).
    Harmonics,
    /// Only diffuse colours.
    Diffuse,
    /// Physical materials: colours are sRGB-encoded albedos, and files that can store them have
    /// metalness and roughness.
    Materials,
}

/// Gaussians without shading attributes, from a scene that may have them.
#[derive(Clone, Debug)]
pub struct PlainGaussians {
    /// Gaussians with harmonics.
    pub gaussians: Gaussians<Vec<f32>>,
    /// Unit normals, if the scene is shaded.
    pub normals: Option<Vec<[f32; 3]>>,
    /// Index of each Gaussian in the scene.
    pub kept: Vec<usize>,
    /// Physical materials, if the scene has any.
    pub materials: Option<Vec<SurfaceMaterial>>,
    /// Method by which colours were baked.
    pub method: BakeMethod,
}

impl PlainGaussians {
    /// Gaussians with these indices in a scene, with harmonics up to `degree`. Shaded ones are
    /// baked from cameras; the harmonics of others are truncated. Filters in space become part of
    /// scales and opacities; the low-pass on the screen becomes that of plain viewers.
    ///
    /// `progress` receives the number of steps done and of all steps.
    ///
    /// # Errors
    ///
    /// Those of the executor.
    ///
    /// # Panics
    ///
    /// If materials are requested of a scene without any.
    pub fn bake<E: ReadBack>(
        exec: E,
        scene: &Scene,
        kept: Vec<usize>,
        cameras: &[Camera],
        degree: u8,
        method: BakeMethod,
        progress: impl FnMut(usize, usize),
    ) -> core::result::Result<Self, E::Error> {
        let layout = scene.gaussians.layout;
        let mut gaussians = unfiltered(&subset(&scene.gaussians, &kept, layout));
        normalise(&mut gaussians);
        if !layout.is_shaded() {
            let truncated = Layout::radiance(layout.sh_degree.unwrap_or(0).min(degree));
            let all: Vec<usize> = (0..gaussians.count).collect();
            let gaussians = subset(&gaussians, &all, truncated);
            return Ok(Self { gaussians, normals: None, kept, materials: None, method });
        }
        let shown = if method == BakeMethod::Materials { Shown::Physical } else { scene.shading_model.shading() };
        let scene = Scene { gaussians, shading_model: scene.shading_model.shaded(shown), ..scene.clone() };
        let Baked { mut gaussians, normals } = match method {
            BakeMethod::Harmonics => bake(exec, &scene, cameras, degree, progress)?,
            BakeMethod::Diffuse | BakeMethod::Materials => bake_diffuse(exec, &scene, cameras, progress)?,
        };
        let materials = layout.is_physical.then(|| {
            let shading = scene.shading_model.shaded(Shown::Physical).shading;
            surface_materials(&scene.gaussians, shading, &normals, &mut gaussians)
        });
        Ok(Self { gaussians, normals: Some(normals), kept, materials, method })
    }

    /// Gaussians in an upright world.
    fn placed(&self, upright: &Upright) -> Self {
        let normal = |normal: &[f32; 3]| upright.direction(*normal);
        let turned = |material: &SurfaceMaterial| SurfaceMaterial {
            normal: normal(&material.normal),
            back: normal(&material.back),
            ..*material
        };
        Self {
            gaussians: upright.gaussians(&self.gaussians),
            normals: self.normals.as_ref().map(|normals| normals.iter().map(normal).collect()),
            kept: self.kept.clone(),
            materials: self.materials.as_ref().map(|materials| materials.iter().map(turned).collect()),
            method: self.method,
        }
    }

    /// Writes a file, placed upright or as it is, and returns the Gaussians as a reader of the
    /// format decodes them. `scene` is the scene of the Gaussians; its shading is written to
    /// `.glb`, `comments` to `.ply`, and an origin in the comments to `.glb`.
    ///
    /// In `.glb` and USD the transform of a node places the scene upright, so that the Gaussians
    /// themselves, written or returned, stay in the scene's world.
    ///
    /// # Errors
    ///
    /// A file that cannot be written.
    pub fn write(
        &self,
        path: &Path,
        format: GaussianFormat,
        scene: &Scene,
        upright: Option<&Upright>,
        comments: &[String],
    ) -> Result<Gaussians<Vec<f32>>> {
        let placed = upright.filter(|_| !format.has_node()).map(|upright| self.placed(upright));
        let Self { gaussians, normals, materials, .. } = placed.as_ref().unwrap_or(self);
        Ok(match (format, materials) {
            (GaussianFormat::Ply, Some(materials)) if self.method == BakeMethod::Materials => {
                gaussian_ply::write_relightable(path, gaussians, materials)?;
                gaussians.clone()
            }
            (GaussianFormat::Ply, _) => {
                gaussian_ply::write_with_normals(path, gaussians, normals.as_deref(), comments)?;
                gaussians.clone()
            }
            (GaussianFormat::Splat, _) => {
                splat::write(path, gaussians)?;
                splat::stored(gaussians)
            }
            (GaussianFormat::Spz, _) => {
                spz::write(path, gaussians)?;
                spz::stored(gaussians)
            }
            (GaussianFormat::Glb, _) => {
                let transform = upright.map(Upright::node_transform);
                glb::write(path, gaussians, self.shading(scene).as_ref(), transform, origin::of_comments(comments))?;
                gaussians.clone()
            }
            (GaussianFormat::Usd, _) => {
                let light = scene.light.as_ref().filter(|_| scene.gaussians.layout.is_shaded()).map(dome);
                let placement = upright.map(Upright::node_transform);
                let stage = Stage {
                    gaussians,
                    normals: normals.as_deref(),
                    materials: materials.as_deref(),
                    light: light.as_ref(),
                    placement: placement.as_ref(),
                    up: if upright.is_some() { UpAxis::Y } else { UpAxis::Z },
                    documentation: &comments.join("; "),
                };
                usd::write(path, &stage)?;
                gaussians.clone()
            }
        })
    }

    /// Comment of a file on the origin of its Gaussians: scene and baking method.
    pub fn provenance(scene: &Scene, method: BakeMethod) -> String {
        let content = match (scene.gaussians.layout.is_shaded(), method) {
            (false, _) => "plain Gaussians",
            (true, BakeMethod::Harmonics) => "a shading function, baked into spherical harmonics",
            (true, BakeMethod::Diffuse) => "the diffuse colour of a shading function",
            (true, BakeMethod::Materials) => "the albedo of physical materials",
        };
        provenance(content)
    }

    /// Sentence on the differences between a file and the scene of its Gaussians.
    pub fn losses(&self, scene: &Scene, format: GaussianFormat, method: BakeMethod) -> String {
        let is_shaded = scene.gaussians.layout.is_shaded();
        let baked = match (is_shaded, method, self.gaussians.layout.sh_degree.unwrap_or(0)) {
            (false, ..) => String::new(),
            (true, BakeMethod::Harmonics, 0) => "light and shading are baked into a colour".to_owned(),
            (true, BakeMethod::Harmonics, degree) => {
                format!("light and shading are baked into harmonics of degree {degree}")
            }
            (true, BakeMethod::Diffuse, _) => "the light and its reflections are omitted".to_owned(),
            (true, BakeMethod::Materials, _) => {
                let only = match format {
                    GaussianFormat::Ply | GaussianFormat::Glb | GaussianFormat::Usd => "",
                    GaussianFormat::Splat | GaussianFormat::Spz => {
                        "; the format has no normals and materials: relight its .ply instead"
                    }
                };
                format!("colours are the albedo, sRGB-encoded, without a light{only}")
            }
        };
        let format_losses = match format {
            GaussianFormat::Ply => "",
            GaussianFormat::Splat => {
                "colours do not depend on the view; colours, opacities and quats are rounded to 8 bits"
            }
            GaussianFormat::Spz => "numbers are rounded to 8 bits, positions to a 65536th of the scene",
            GaussianFormat::Glb if is_shaded && scene.near_field.is_some() => {
                "and are also stored as SPECULA_shading, which reflects only distant light"
            }
            GaussianFormat::Glb if is_shaded => "and are also stored as SPECULA_shading",
            GaussianFormat::Glb => "",
            GaussianFormat::Usd if self.materials.is_some() => "materials are primvars, and the light a DomeLight",
            GaussianFormat::Usd if is_shaded => "the light is a DomeLight",
            GaussianFormat::Usd => "",
        };
        let low_pass = match scene.gaussians.layout.low_pass {
            LowPass::Dilated => String::new(),
            low_pass => format!(
                "splats below the size of a pixel are larger and brighter unless the viewer widens by {} px² and \
                 compensates opacity",
                low_pass.variance()
            ),
        };
        let omitted = match scene.gaussians.count - self.kept.len() {
            0 => String::new(),
            count => format!("{} invisible Gaussians are omitted", group_digits(count)),
        };
        let parts: Vec<&str> =
            [&baked, format_losses, &low_pass, &omitted].into_iter().filter(|part| !part.is_empty()).collect();
        if parts.is_empty() { "lossless".to_owned() } else { parts.join("; ").replace("; and are", " and are") }
    }

    /// Attributes, light and names of the shading function; none for a scene without one.
    fn shading(&self, scene: &Scene) -> Option<Shading> {
        let Scene { gaussians, light, shading_model, .. } = scene;
        let normals = self.normals.as_ref()?;
        // Materials are written in addition to the view-dependent attributes, whichever the scene
        // shows.
        let view_dependent = shading_model.shaded(Shown::View).shading;
        let all = || self.kept.iter().map(|index| ActivatedAttributes::of(gaussians, *index, view_dependent));
        let mut attributes = vec![
            Attribute::of("NORMAL".into(), normals.iter().copied()),
            Attribute::of("DIFFUSE".into(), all().map(|activated| activated.diffuse)),
            Attribute::of("TINT".into(), all().map(|activated| activated.tint)),
            Attribute::of("ROUGHNESS".into(), all().map(|activated| [activated.roughness])),
        ];
        if gaussians.layout.is_physical {
            // Albedo and metalness replace diffuse colour and tint.
            let all =
                || self.kept.iter().map(|index| ActivatedAttributes::of(gaussians, *index, ShadingRules::PHYSICAL));
            attributes.push(Attribute::of("ALBEDO".into(), all().map(|activated| activated.diffuse)));
            attributes.push(Attribute::of("METALLIC".into(), all().map(|activated| [activated.tint[0]])));
        }
        let start = gaussians.layout.sh_start();
        attributes.extend((0..gaussians.layout.sh_count()).map(|k| {
            let residual = self.kept.iter().map(|index| gaussians.get::<3>(*index, start + 3 * k));
            Attribute::of(glb::harmonic("RESIDUAL", k), residual)
        }));
        let [form, axis, filter, _] = shading_model.names();
        let shown = shading_model.shading().name();
        let properties = json!({"form": form, "shown": shown, "axis": axis, "prefilter": filter});
        let properties = properties.as_object().cloned().unwrap_or_default();
        let light = light.as_ref().map(|light| (radiance(light), light.resolution));
        Some(Shading { properties, attributes, light })
    }
}

/// Lat-long map of a light for a dome of USD.
fn dome(light: &Environment<Vec<f32>>) -> LatLong {
    /// Rows for each texel along an edge of a face, enough to keep every texel.
    const ROWS: usize = 2;
    let height = ROWS * light.resolution;
    latlong::from_cube(&radiance(light), light.resolution, 2 * height, height, usd::dome_orientation())
}

/// Normalises quats, except for roundings: some viewers stretch the splats of others.
fn normalise(gaussians: &mut Gaussians<Vec<f32>>) {
    const ROUNDING: f32 = 1e-3;
    for index in 0..gaussians.count {
        let quat = Vec4::from(gaussians.get::<4>(index, QUAT));
        if let Some(unit) = quat.try_normalize().filter(|_| (quat.length() - 1.0).abs() > ROUNDING) {
            gaussians.set(index, QUAT, unit.to_array());
        }
    }
}

/// Start of the comment that names the up direction of a file.
const UP_COMMENT: &str = "up ";

/// Comment of a PLY file that names its up direction.
pub fn up_comment(up: [f64; 3]) -> String {
    let [x, y, z] = up;
    format!("{UP_COMMENT}{x:.6} {y:.6} {z:.6}")
}

/// Up direction that the comments of a PLY file name.
pub(crate) fn up_of_comments(comments: &[String]) -> Option<[f64; 3]> {
    let mut vectors = origin::vectors_in(comments, UP_COMMENT);
    vectors.find_map(|up| Some(DVec3::from(up).try_normalize()?.to_array()))
}

/// End of the comment of upright files by earlier versions.
pub(crate) const UPRIGHT_COMMENT: &str = ", upright: y is down";

/// Indices of the Gaussians that are finite and have this opacity, from 0 to 1, or more.
pub fn visible(gaussians: &Gaussians<Vec<f32>>, min_opacity: f32) -> Vec<usize> {
    let is_finite = |index: usize| !CullReason::of(gaussians, index, None).is_nonfinite();
    (0..gaussians.count).filter(|index| opacity(gaussians, *index) >= min_opacity && is_finite(*index)).collect()
}
