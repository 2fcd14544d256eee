//! `specula export`: a scene for other programs.

use crate::{
    args::{BakeName, EnvOptions, Export, MipName, Prefilter, SchemeName, Up},
    commands::prefilter,
    failure::Failure,
    output, progress,
    scene::{self, background_of, note_oddities, refuse_options_without_light, relight},
};
use specula_core::{camera::Camera, metrics::psnr, rules::Channels, scene::Gaussians};
use specula_cpu::CpuExecutor;
use specula_io::{Error, latlong, mesh, orientation::Orientation};
use specula_scene::{
    OpenedModel, Scene, SceneRenderer, ShadingModel,
    backdrop::BackgroundColor,
    environment::radiance,
    export::{BakeMethod, GaussianFormat, PlainGaussians, visible},
    fusion,
    number::group_digits,
    orbit::{self, evenly_spaced},
    orientation,
    upright::{AxisConvention, Upright},
};
use specula_train::evaluate::{mean_squared_error, over_background};
use std::{
    collections::{BTreeMap, btree_map::Entry},
    fs,
    path::Path,
};

/// Largest number of cameras whose pictures are compared.
const COMPARED_MAX: usize = 12;
/// Number of cameras around a scene without any.
const SPHERE: u32 = 64;
/// Largest number of cameras whose depths are fused.
const FUSED_MAX: usize = 120;
/// Rows of a lat-long map for each texel along an edge of a face, which keep every texel.
const ROWS: usize = 2;
/// Degree of baked harmonics by default.
const DEGREE: u8 = 3;

/// Refuses to overwrite a file that the model is read from.
fn refuse_own_file(output: &Path, model: &Path, folder: Option<&Path>) -> Result<(), Failure> {
    let Ok(output) = output.canonicalize() else { return Ok(()) };
    let own = |name: &str| folder.and_then(|folder| folder.join(name).canonicalize().ok());
    let is_read = model.canonicalize().is_ok_and(|model| model == output);
    let is_of_model = ["point_cloud", "light", "brdf_mlp", "input.ply"]
        .into_iter()
        .any(|name| own(name).is_some_and(|own| output.starts_with(own)));
    if is_read || is_of_model {
        return Err(Failure::Input(format!("{output:?} is a file of the model itself; name another with -o")));
    }
    Ok(())
}

/// Writes the files that are asked for.
pub(crate) fn run(args: &Export) -> Result<(), Failure> {
    let formats = args.output.iter().map(|path| Format::of(path, args.mesh)).collect::<Result<Vec<_>, _>>()?;
    refuse_options_without_light(args.env.as_deref(), (&args.env_options).into())?;
    let mut opened = scene::open(&args.model, args.scene_options.profile)?;
    args.output.iter().try_for_each(|path| refuse_own_file(path, &args.model, opened.folder.as_deref()))?;
    note_oddities(&opened);
    if let Some(env) = &args.env {
        let up = orientation::up(&opened.orientation(args.scene_options.scene_up.map(Into::into))?);
        relight(&mut opened.scene, env, (&args.env_options).into(), up)?;
    }
    for path in &args.output {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        output::make_folder(folder.unwrap_or(Path::new(".")))?;
    }
    let stance = if args.upright { Some(stance(args, &opened)?) } else { None };
    let background = background_of(&opened, args.background);
    let exporter = Exporter { args, background, opened, stance };
    let mut plains: BTreeMap<u8, PlainGaussians> = BTreeMap::new();
    let mut references = None;
    for (path, format) in args.output.iter().zip(formats) {
        match format {
            Format::Light(light) => exporter.write_light(path, light)?,
            Format::Mesh => exporter.write_mesh(path)?,
            Format::Gaussians(format) => {
                let degree = format.degree_max().min(args.sh_degree.unwrap_or(DEGREE));
                if let Entry::Vacant(entry) = plains.entry(degree) {
                    entry.insert(exporter.plain(degree)?);
                }
                let references = match &mut references {
                    Some(references) => references,
                    none => none.insert(exporter.references()?),
                };
                exporter.write_gaussians(path, format, &plains[&degree], references)?;
            }
        }
    }
    Ok(())
}

/// Orientation of the scene, and its first camera, which is in front of it.
fn stance(args: &Export, opened: &OpenedModel) -> Result<Stance, Failure> {
    let first = opened.cameras()?.first().map(|(_, camera)| *camera);
    Ok((opened.orientation(args.scene_options.scene_up.map(Into::into))?, first))
}

/// Content of a file, from its extension.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Gaussians(GaussianFormat),
    Light(LightFormat),
    Mesh,
}

/// Format of a light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum LightFormat {
    LatLong,
    Filtered,
}

impl Format {
    fn of(path: &Path, is_mesh: bool) -> Result<Self, Failure> {
        let extension = output::ending(path).unwrap_or_default();
        Ok(match (extension.as_str(), is_mesh) {
            ("obj", _) | ("ply", true) => Self::Mesh,
            ("hdr" | "exr", _) => Self::Light(LightFormat::LatLong),
            ("ktx2", _) => Self::Light(LightFormat::Filtered),
            (extension, _) => {
                let expected = ".ply, .splat, .spz or .glb (Gaussians), .hdr, .exr or .ktx2 (light), or .obj (mesh)";
                let unknown = || Error::Ending { path: path.to_owned(), expected };
                Self::Gaussians(GaussianFormat::from_extension(extension).ok_or_else(unknown)?)
            }
        })
    }
}

/// Pictures of the scene itself to compare with, each with its camera; none if no error is asked
/// for.
type References = Vec<(Camera, Vec<f32>)>;

/// Orientation of a scene, and a camera in front of it, if it has any.
type Stance = (Orientation, Option<Camera>);

/// Scene to export.
struct Exporter<'a> {
    args: &'a Export,
    opened: OpenedModel,
    background: BackgroundColor,
    /// Orientation, if the scene is placed upright.
    stance: Option<Stance>,
}

impl Exporter<'_> {
    fn scene(&self) -> &Scene {
        &self.opened.scene
    }

    /// Transform into an upright world with these axes, if that is asked for.
    fn upright(&self, axes: AxisConvention) -> Option<Upright> {
        self.stance.as_ref().map(|(orientation, first)| Upright::new(orientation, first.as_ref(), axes))
    }

    /// Cameras of the training, else some all around.
    fn cameras(&self) -> Result<Vec<Camera>, Failure> {
        let known = self.opened.training_cameras()?;
        if known.is_empty() {
            return Ok(orbit::sphere(&self.scene().gaussians, SPHERE));
        }
        Ok(known.into_iter().map(|(_, camera)| camera).collect())
    }

    /// Visible Gaussians with harmonics of this degree at most, baked if they are shaded.
    fn plain(&self, degree: u8) -> Result<PlainGaussians, Failure> {
        let all = &self.scene().gaussians;
        let kept = visible(all, self.args.min_opacity);
        if kept.is_empty() {
            return Err(Failure::Input(format!(
                "{:?} has no Gaussian to write, of {} none is finite and has an opacity of {} or more; lower \
                 --min-opacity, or take an earlier iteration",
                self.args.model, all.count, self.args.min_opacity
            )));
        }
        let is_shaded = all.layout.is_shaded();
        if is_shaded && self.scene().light.is_none() {
            tracing::warn!("the scene has no light, so nothing specular is baked; name one with --env");
        }
        let cameras = if is_shaded { self.cameras()? } else { Vec::new() };
        let method = match self.args.bake {
            BakeName::Sh => BakeMethod::Harmonics,
            BakeName::Diffuse => BakeMethod::Diffuse,
        };
        let work = progress::work("baking", 0);
        let progress = |done: usize, all: usize| {
            work.set_steps(all as u64);
            work.done(done as u64, String::new);
        };
        let plain = PlainGaussians::bake(CpuExecutor::new(), self.scene(), kept, &cameras, degree, method, progress)?;
        work.finish();
        Ok(plain)
    }

    fn write_gaussians(
        &self,
        path: &Path,
        format: GaussianFormat,
        plain: &PlainGaussians,
        references: &References,
    ) -> Result<(), Failure> {
        let upright = self.upright(format.axes());
        let stored = plain.write(path, format, self.scene(), upright.as_ref(), &self.comments())?;
        let placed = upright.filter(|_| format != GaussianFormat::Glb);
        let error = self.error(stored, references, placed)?;
        self.say(
            path,
            &format!("{} Gaussians", group_digits(plain.gaussians.count)),
            &format!("{}{error}", self.lost(format, plain)),
        )
    }

    /// Provenance of a PLY file.
    fn comments(&self) -> Vec<String> {
        let what = match (self.scene().gaussians.layout.is_shaded(), self.args.bake) {
            (false, _) => "plain Gaussians",
            (true, BakeName::Sh) => "a shading function, baked into spherical harmonics",
            (true, BakeName::Diffuse) => "the diffuse colour of a shading function",
        };
        let upright = if self.stance.is_some() { ", upright: y is down" } else { "" };
        vec![format!("exported by specula {}: {what}{upright}", env!("CARGO_PKG_VERSION"))]
    }

    /// Sentence on the differences of a file from the scene.
    fn lost(&self, format: GaussianFormat, plain: &PlainGaussians) -> String {
        let is_shaded = self.scene().gaussians.layout.is_shaded();
        let baked = match (is_shaded, self.args.bake, plain.gaussians.layout.sh_degree.unwrap_or(0)) {
            (false, ..) => String::new(),
            (true, BakeName::Sh, 0) => "light and shading became a colour".to_owned(),
            (true, BakeName::Sh, degree) => format!("light and shading became harmonics of degree {degree}"),
            (true, BakeName::Diffuse, _) => "the light and its reflections are omitted".to_owned(),
        };
        let of_format = match format {
            GaussianFormat::Ply => "",
            GaussianFormat::Splat => {
                "colours are the same from everywhere; they, opacities and quats are rounded to 8 bits"
            }
            GaussianFormat::Spz => "numbers are rounded to 8 bits, places to a 65536th of the scene",
            GaussianFormat::Glb if is_shaded => "and are beside them as SPECULA_shading",
            GaussianFormat::Glb => "",
        };
        let left_out = match self.scene().gaussians.count - plain.kept.len() {
            0 => String::new(),
            count => format!("{} invisible Gaussians are omitted", group_digits(count)),
        };
        let parts: Vec<&str> = [&baked, of_format, &left_out].into_iter().filter(|part| !part.is_empty()).collect();
        if parts.is_empty() { "nothing is lost".to_owned() } else { parts.join("; ").replace("; and are", " and are") }
    }

    /// Pictures of the scene from its test views, else from others.
    fn references(&self) -> Result<References, Failure> {
        if self.args.no_error {
            return Ok(Vec::new());
        }
        let cameras: Vec<Camera> = self.opened.evaluation_cameras()?.into_iter().map(|(_, camera)| camera).collect();
        let cameras = evenly_spaced(&cameras, COMPARED_MAX);
        let pictures = self.pictures(self.scene().clone(), &cameras)?;
        Ok(cameras.into_iter().zip(pictures).collect())
    }

    /// Colours of a scene over the background, camera by camera.
    fn pictures(&self, scene: Scene, cameras: &[Camera]) -> Result<Vec<Vec<f32>>, Failure> {
        let mut renderer = SceneRenderer::new(scene, Channels::Color, &(&self.args.scene_options.renderer).into())?;
        let work = progress::work("comparing", cameras.len() as u64);
        let mut pictures = Vec::new();
        for camera in cameras {
            pictures.push(over_background(&renderer.render(camera)?, self.background.0));
            work.done(pictures.len() as u64, String::new);
        }
        work.finish();
        Ok(pictures)
    }

    /// Sentence on the difference of the pictures of a file, whose Gaussians may be placed upright,
    /// from the scene's.
    fn error(
        &self,
        stored: Gaussians<Vec<f32>>,
        references: &References,
        placed: Option<Upright>,
    ) -> Result<String, Failure> {
        if references.is_empty() {
            return Ok(String::new());
        }
        let placed_camera = |camera: &Camera| placed.map_or(*camera, |upright| upright.camera(camera));
        let cameras: Vec<Camera> = references.iter().map(|(camera, _)| placed_camera(camera)).collect();
        let scene = Scene { gaussians: stored, light: None, shading_model: ShadingModel::PAPER };
        let pictures = self.pictures(scene, &cameras)?;
        let errors: Vec<f64> =
            references.iter().zip(&pictures).map(|((_, own), shown)| mean_squared_error(own, shown)).collect();
        if errors.iter().all(|error| *error == 0.0) {
            return Ok(format!("; {} pictures of it are specula's own", references.len()));
        }
        // A picture without any error counts as one with a wrong 8-bit step in a pixel of a
        // thousand.
        const LEAST: f64 = 1e-3 / (255.0 * 255.0);
        let mean = errors.iter().map(|error| psnr(error.max(LEAST))).sum::<f64>() / errors.len() as f64;
        Ok(format!("; PSNR {mean:.2} dB against specula's own pictures ({} views)", references.len()))
    }

    fn write_light(&self, path: &Path, format: LightFormat) -> Result<(), Failure> {
        let light = self.scene().light.as_ref().ok_or_else(|| {
            Failure::Input(format!(
                "{:?} has no light to write to {path:?}; name the folder of a model that was trained with --profile \
                 specula, or a light with --env",
                self.args.model
            ))
        })?;
        let values = || radiance(light.activation, &light.values);
        let up = self.args.up;
        let upright = self.upright(match up {
            Up::Y => AxisConvention::YUp,
            Up::Z => AxisConvention::ZUp,
        });
        if format == LightFormat::Filtered {
            let filter = self.filter(path);
            return match upright {
                Some(upright) => prefilter::write(&filter, &upright.light(&values(), light.resolution)),
                None => prefilter::run(&filter),
            };
        }
        let height = ROWS * light.resolution;
        let orientation = upright.map_or(up.axis().into(), |upright| upright.map_orientation(up.axis()));
        let map = latlong::from_cube(&values(), light.resolution, 2 * height, height, orientation);
        latlong::write(path, &map)?;
        self.say(
            path,
            &format!("light, {} × {height}", map.width),
            &format!("resampled from a cube of {}²", light.resolution),
        )
    }

    /// Arguments of `specula prefilter` for the light.
    fn filter(&self, path: &Path) -> Prefilter {
        let EnvOptions { exposure, .. } = self.args.env_options;
        let env = self.args.env.clone();
        let model = || self.opened.folder.clone().unwrap_or_else(|| self.args.model.clone());
        Prefilter {
            exposure: if env.is_some() { exposure } else { 0.0 },
            env: env.unwrap_or_else(model),
            output: path.to_owned(),
            resolution: None,
            levels: None,
            roughness: Some(MipName::Linear),
            scheme: SchemeName::Specula,
            up: self.args.up,
            previews: false,
        }
    }

    fn write_mesh(&self, path: &Path) -> Result<(), Failure> {
        let cameras = evenly_spaced(&self.cameras()?, FUSED_MAX);
        let scene = self.scene().clone();
        if scene.gaussians.count == 0 {
            return Err(Failure::Input(format!(
                "{:?} has no Gaussian to see; take an earlier iteration",
                self.args.model
            )));
        }
        let gaussians = scene.gaussians.clone();
        let mut renderer = SceneRenderer::new(scene, Channels::Training, &(&self.args.scene_options.renderer).into())?;
        let work = progress::work("fusing", cameras.len() as u64);
        let progress = |done| work.done(done as u64, String::new);
        let mesh = fusion::fuse(&mut renderer, &gaussians, &cameras, self.args.voxels, progress)?;
        work.finish();
        if mesh.triangles.is_empty() {
            return Err(Failure::Input(format!(
                "no camera sees a surface in {:?}; take more --voxels, or a model with opaque surfaces",
                self.args.model
            )));
        }
        let mesh = match self.upright(AxisConvention::YUp) {
            Some(upright) => upright.mesh(mesh),
            None => mesh,
        };
        mesh::write(path, &mesh)?;
        let count = format!(
            "{} triangles, {} vertices",
            group_digits(mesh.triangles.len()),
            group_digits(mesh.positions.len())
        );
        self.say(path, &count, &format!("colours are the mean over {} views", cameras.len()))
    }

    /// Prints a file that is written: its content, its size, its losses.
    fn say(&self, path: &Path, count: &str, lost: &str) -> Result<(), Failure> {
        let bytes = fs::metadata(path).map_err(|cause| Error::Read { path: path.to_owned(), cause })?.len();
        output::say(&format!("{}: {count}, {} bytes; {lost}", path.display(), group_digits(bytes as usize)))
    }
}
