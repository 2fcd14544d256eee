//! `specula export`: a scene for other programs.

use crate::{
    args::{BakeName, EnvOptions, Export, MipName, Prefilter, SchemeName, Up},
    background::Background,
    bake::{self, Baked},
    failure::Failure,
    output,
    picture_folder::refuse_options_without_light,
    prefilter, progress,
    scene::{self, Renderer, background_of, note_oddities, relight},
};
use serde_json::json;
use specula_core::{
    activation::sigmoid,
    camera::Camera,
    cull::CullReason,
    metrics::psnr,
    rules::Channels,
    scene::{Gaussians, Layout, OPACITY, len_of_values},
};
use specula_io::{
    Error, gaussian_ply,
    glb::{self, Attribute, Shading},
    latlong, mesh,
    orientation::Orientation,
    splat, spz,
};
use specula_report::number::group_digits;
use specula_scene::{
    OpenedModel, Scene, SceneRenderer, ShadingModel,
    environment::radiance,
    fusion,
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

/// Cameras from which pictures are compared, at most.
const COMPARED_MAX: usize = 12;
/// Cameras of a scene that knows none.
const SPHERE: u32 = 64;
/// Cameras whose depths are fused, at most.
const FUSED_MAX: usize = 120;
/// Rows of a lat-long map for each texel along an edge of a face, so that nothing is lost.
const ROWS: usize = 2;
/// The degree of what is baked, unless another is asked for.
const DEGREE: u8 = 3;

/// Refuses to write over a file that the model is read from.
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

/// Writes what was asked for.
pub(crate) fn run(args: &Export) -> Result<(), Failure> {
    let formats = args.output.iter().map(|path| Format::of(path, args.mesh)).collect::<Result<Vec<_>, _>>()?;
    refuse_options_without_light(args.env.as_deref(), &args.env_options)?;
    let mut opened = scene::open(&args.model, args.showing.profile)?;
    args.output.iter().try_for_each(|path| refuse_own_file(path, &args.model, opened.folder.as_deref()))?;
    note_oddities(&opened);
    if let Some(env) = &args.env {
        let up = orientation::up(&opened.orientation(args.showing.scene_up.map(Into::into))?);
        relight(&mut opened.scene, env, &args.env_options, up)?;
    }
    for path in &args.output {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        output::make_folder(folder.unwrap_or(Path::new(".")))?;
    }
    let stance = if args.upright { Some(stance(args, &opened)?) } else { None };
    let background = background_of(&opened, args.background);
    let exporter = Exporter { args, background, opened, stance };
    let mut plains: BTreeMap<u8, Plain> = BTreeMap::new();
    let mut own = None;
    for (path, format) in args.output.iter().zip(formats) {
        match format {
            Format::Light(light) => exporter.write_light(path, light)?,
            Format::Mesh => exporter.write_mesh(path)?,
            Format::Gaussians(kind) => {
                let degree = kind.degree().min(args.sh_degree.unwrap_or(DEGREE));
                if let Entry::Vacant(place) = plains.entry(degree) {
                    place.insert(exporter.plain(degree)?);
                }
                let own = match &mut own {
                    Some(own) => own,
                    none => none.insert(exporter.own_pictures()?),
                };
                exporter.write_gaussians(path, kind, &plains[&degree], own)?;
            }
        }
    }
    Ok(())
}

/// How the scene stands; its first camera is in front of it.
fn stance(args: &Export, opened: &OpenedModel) -> Result<Stance, Failure> {
    let first = opened.cameras()?.first().map(|(_, camera)| *camera);
    Ok((opened.orientation(args.showing.scene_up.map(Into::into))?, first))
}

/// What a file becomes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Gaussians(Kind),
    Light(LightKind),
    Mesh,
}

/// How Gaussians are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Ply,
    Splat,
    Spz,
    Glb,
}

/// How a light is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum LightKind {
    LatLong,
    Filtered,
}

impl Kind {
    /// The highest degree of harmonics that it holds.
    fn degree(self) -> u8 {
        match self {
            Self::Splat => 0,
            Self::Ply | Self::Spz | Self::Glb => DEGREE,
        }
    }

    /// Where its axes point, as its readers take it.
    fn axes(self) -> AxisConvention {
        match self {
            Self::Ply | Self::Splat => AxisConvention::YDown,
            Self::Spz | Self::Glb => AxisConvention::YUp,
        }
    }
}

impl Format {
    fn of(path: &Path, is_mesh: bool) -> Result<Self, Failure> {
        Ok(match (output::ending(path).as_deref(), is_mesh) {
            (Some("obj"), _) | (Some("ply"), true) => Self::Mesh,
            (Some("ply"), false) => Self::Gaussians(Kind::Ply),
            (Some("splat"), _) => Self::Gaussians(Kind::Splat),
            (Some("spz"), _) => Self::Gaussians(Kind::Spz),
            (Some("glb"), _) => Self::Gaussians(Kind::Glb),
            (Some("hdr" | "exr"), _) => Self::Light(LightKind::LatLong),
            (Some("ktx2"), _) => Self::Light(LightKind::Filtered),
            _ => {
                let expected = ".ply, .splat, .spz or .glb (Gaussians), .hdr, .exr or .ktx2 (light), or .obj (mesh)";
                return Err(Error::Ending { path: path.to_owned(), expected }.into());
            }
        })
    }
}

/// Gaussians as other programs know them.
struct Plain {
    gaussians: Gaussians<Vec<f32>>,
    /// Of shaded ones.
    normals: Option<Vec<[f32; 3]>>,
    /// Which of the scene's they are.
    kept: Vec<usize>,
}

impl Plain {
    /// The same in an upright world.
    fn moved(&self, upright: &Upright) -> Self {
        let normal = |normal: &[f32; 3]| upright.direction(*normal);
        Self {
            gaussians: upright.gaussians(&self.gaussians),
            normals: self.normals.as_ref().map(|normals| normals.iter().map(normal).collect()),
            kept: self.kept.clone(),
        }
    }
}

/// Specula's own pictures of a scene, each as its camera shows it; none where no error is asked for.
type Pictures = Vec<(Camera, Vec<f32>)>;

/// How a scene stands, and a camera in front of it, if it has any.
type Stance = (Orientation, Option<Camera>);

/// A scene on its way out.
struct Exporter<'a> {
    args: &'a Export,
    opened: OpenedModel,
    background: Background,
    /// How the scene stands, if it is to be put upright.
    stance: Option<Stance>,
}

impl Exporter<'_> {
    fn scene(&self) -> &Scene {
        &self.opened.scene
    }

    /// What puts it upright in a world with these axes, if that is asked for.
    fn upright(&self, axes: AxisConvention) -> Option<Upright> {
        self.stance.as_ref().map(|(orientation, first)| Upright::new(orientation, first.as_ref(), axes))
    }

    /// The cameras that it was fitted to, or some all around.
    fn cameras(&self) -> Result<Vec<Camera>, Failure> {
        let known = self.opened.training_cameras()?;
        if known.is_empty() {
            return Ok(orbit::sphere(&self.scene().gaussians, SPHERE));
        }
        Ok(known.into_iter().map(|(_, camera)| camera).collect())
    }

    /// What can be seen of the Gaussians, baked if they are shaded, with harmonics of this degree at most.
    fn plain(&self, degree: u8) -> Result<Plain, Failure> {
        let all = &self.scene().gaussians;
        let kept = visible(all, self.args.min_opacity);
        if kept.is_empty() {
            return Err(Failure::Input(format!(
                "{:?} has no Gaussian to write, of {} none is finite and has an opacity of {} or more; lower \
                 --min-opacity, or take an earlier iteration",
                self.args.model, all.count, self.args.min_opacity
            )));
        }
        let scene = Scene { gaussians: subset(all, &kept, all.layout), ..self.scene().clone() };
        let (gaussians, normals) = if !all.layout.is_shaded() {
            (with_degree(&scene.gaussians, degree), None)
        } else {
            let cameras = self.cameras()?;
            let Baked { gaussians, normals } = match self.args.bake {
                BakeName::Sh => bake::bake(&scene, &cameras, degree)?,
                BakeName::Diffuse => bake::diffuse(&scene, &cameras)?,
            };
            (gaussians, Some(normals))
        };
        Ok(Plain { gaussians, normals, kept })
    }

    fn write_gaussians(&self, path: &Path, kind: Kind, plain: &Plain, own: &Pictures) -> Result<(), Failure> {
        let upright = self.upright(kind.axes());
        // glTF has a word for it, so its numbers stay as they are.
        let moved = upright.filter(|_| kind != Kind::Glb);
        let elsewhere = moved.map(|upright| plain.moved(&upright));
        let Plain { gaussians, normals, kept } = elsewhere.as_ref().unwrap_or(plain);
        match kind {
            Kind::Ply => gaussian_ply::write_with_normals(path, gaussians, normals.as_deref(), &self.comments())?,
            Kind::Splat => splat::write(path, gaussians)?,
            Kind::Spz => spz::write(path, gaussians)?,
            Kind::Glb => {
                let placement = upright.map(|upright| upright.node_transform());
                glb::write(path, gaussians, self.shading(kept, normals.as_deref()).as_ref(), placement)?;
            }
        }
        let stored = match kind {
            Kind::Ply | Kind::Glb => gaussians.clone(),
            Kind::Splat => splat::stored(gaussians),
            Kind::Spz => spz::stored(gaussians),
        };
        let error = self.error(stored, own, moved)?;
        self.say(
            path,
            &format!("{} Gaussians", group_digits(gaussians.count)),
            &format!("{}{error}", self.lost(kind, plain)),
        )
    }

    /// How a PLY file came about, for who wonders later.
    fn comments(&self) -> Vec<String> {
        let what = match (self.scene().gaussians.layout.is_shaded(), self.args.bake) {
            (false, _) => "plain Gaussians",
            (true, BakeName::Sh) => "a shading function, baked into spherical harmonics",
            (true, BakeName::Diffuse) => "the diffuse colour of a shading function",
        };
        let upright = if self.stance.is_some() { ", upright: y is down" } else { "" };
        vec![format!("exported by specula {}: {what}{upright}", env!("CARGO_PKG_VERSION"))]
    }

    /// What is not in the file.
    fn lost(&self, kind: Kind, plain: &Plain) -> String {
        let is_shaded = self.scene().gaussians.layout.is_shaded();
        let baked = match (is_shaded, self.args.bake, plain.gaussians.layout.sh_degree.unwrap_or(0)) {
            (false, ..) => String::new(),
            (true, BakeName::Sh, 0) => "light and shading became a colour".to_owned(),
            (true, BakeName::Sh, degree) => format!("light and shading became harmonics of degree {degree}"),
            (true, BakeName::Diffuse, _) => "the light and its reflections are omitted".to_owned(),
        };
        let of_kind = match kind {
            Kind::Ply => "",
            Kind::Splat => "colours are the same from everywhere; they, opacities and quats are rounded to 8 bits",
            Kind::Spz => "numbers are rounded to 8 bits, places to a 65536th of the scene",
            Kind::Glb if is_shaded => "and are beside them as SPECULA_shading",
            Kind::Glb => "",
        };
        let left_out = match self.scene().gaussians.count - plain.kept.len() {
            0 => String::new(),
            count => format!("{} invisible Gaussians are omitted", group_digits(count)),
        };
        let parts: Vec<&str> = [&baked, of_kind, &left_out].into_iter().filter(|part| !part.is_empty()).collect();
        if parts.is_empty() { "nothing is lost".to_owned() } else { parts.join("; ").replace("; and are", " and are") }
    }

    /// What shading needs, for who knows it.
    fn shading(&self, kept: &[usize], normals: Option<&[[f32; 3]]>) -> Option<Shading> {
        let Scene { gaussians, light, shading_model } = self.scene();
        let normals = normals?;
        let all = || kept.iter().map(|gaussian| bake::attributes(gaussians, *gaussian, shading_model.shading));
        let mut attributes = vec![
            Attribute::of("NORMAL".into(), normals.iter().copied()),
            Attribute::of("DIFFUSE".into(), all().map(|(diffuse, ..)| diffuse)),
            Attribute::of("TINT".into(), all().map(|(_, tint, _)| tint)),
            Attribute::of("ROUGHNESS".into(), all().map(|(.., roughness)| [roughness])),
        ];
        let start = gaussians.layout.sh_start();
        attributes.extend((0..gaussians.layout.sh_count()).map(|k| {
            let residual = kept.iter().map(|gaussian| gaussians.get::<3>(*gaussian, start + 3 * k));
            Attribute::of(glb::harmonic("RESIDUAL", k), residual)
        }));
        let [form, axis, filter] = shading_model.words();
        let properties = json!({"form": form, "axis": axis, "prefilter": filter});
        let properties = properties.as_object().cloned().unwrap_or_default();
        let light = light.as_ref().map(|light| (radiance(light.activation, &light.values), light.resolution));
        Some(Shading { properties, attributes, light })
    }

    /// Pictures of the scene as it is, from its test views, or else from others.
    fn own_pictures(&self) -> Result<Pictures, Failure> {
        if self.args.no_error {
            return Ok(Vec::new());
        }
        let cameras: Vec<Camera> = self.opened.evaluation_cameras()?.into_iter().map(|(_, camera)| camera).collect();
        let cameras = evenly_spaced(&cameras, COMPARED_MAX);
        let pictures = self.pictures(self.scene().clone(), &cameras)?;
        Ok(cameras.into_iter().zip(pictures).collect())
    }

    /// Colours from some cameras, over the background.
    fn pictures(&self, scene: Scene, cameras: &[Camera]) -> Result<Vec<Vec<f32>>, Failure> {
        let mut renderer = Renderer::new(scene, Channels::Color, &self.args.showing.machine)?;
        let work = progress::work("comparing", cameras.len() as u64);
        let mut pictures = Vec::new();
        for camera in cameras {
            pictures.push(over_background(&renderer.view(camera)?, self.background.0));
            work.done(pictures.len() as u64, String::new);
        }
        work.finish();
        Ok(pictures)
    }

    /// How far pictures of what is in a file, which may have been moved, are from specula's own, in words.
    fn error(&self, stored: Gaussians<Vec<f32>>, own: &Pictures, moved: Option<Upright>) -> Result<String, Failure> {
        if own.is_empty() {
            return Ok(String::new());
        }
        let with_it = |camera: &Camera| moved.map_or(*camera, |upright| upright.camera(camera));
        let cameras: Vec<Camera> = own.iter().map(|(camera, _)| with_it(camera)).collect();
        let scene = Scene { gaussians: stored, light: None, shading_model: ShadingModel::PAPER };
        let pictures = self.pictures(scene, &cameras)?;
        let errors: Vec<f64> =
            own.iter().zip(&pictures).map(|((_, own), shown)| mean_squared_error(own, shown)).collect();
        if errors.iter().all(|error| *error == 0.0) {
            return Ok(format!("; {} pictures of it are specula's own", own.len()));
        }
        // A picture without any error counts as one that is wrong by a step of 8 bits in a pixel of a thousand.
        const LEAST: f64 = 1e-3 / (255.0 * 255.0);
        let mean = errors.iter().map(|error| psnr(error.max(LEAST))).sum::<f64>() / errors.len() as f64;
        Ok(format!("; PSNR {mean:.2} dB against specula's own pictures ({} views)", own.len()))
    }

    fn write_light(&self, path: &Path, kind: LightKind) -> Result<(), Failure> {
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
        if kind == LightKind::Filtered {
            let filter = self.filter(path);
            return match upright {
                Some(upright) => prefilter::write(&filter, &upright.light(&values(), light.resolution)),
                None => prefilter::run(&filter),
            };
        }
        let height = ROWS * light.resolution;
        let stand = upright.map_or(up.stand(), |upright| upright.map_stand(up.axis()));
        let map = latlong::from_cube(&values(), light.resolution, 2 * height, height, stand);
        latlong::write(path, &map)?;
        self.say(
            path,
            &format!("light, {} × {height}", map.width),
            &format!("resampled from a cube of {}²", light.resolution),
        )
    }

    /// What `specula prefilter` would be told.
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
        let mut renderer = SceneRenderer::new(scene, Channels::Training, &(&self.args.showing.machine).into())?;
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

    /// A file that is written: how much is in it, and what is not.
    fn say(&self, path: &Path, count: &str, lost: &str) -> Result<(), Failure> {
        let bytes = fs::metadata(path).map_err(|cause| Error::Read { path: path.to_owned(), cause })?.len();
        output::say(&format!("{}: {count}, {} bytes; {lost}", path.display(), group_digits(bytes as usize)))
    }
}

/// Gaussians that are finite and at least so opaque.
fn visible(gaussians: &Gaussians<Vec<f32>>, min_opacity: f32) -> Vec<usize> {
    let is_finite = |gaussian: usize| !CullReason::of(gaussians, gaussian, None).is_nonfinite();
    let is_seen = |gaussian: usize| sigmoid(gaussians.get::<1>(gaussian, OPACITY)[0]) >= min_opacity;
    (0..gaussians.count).filter(|gaussian| is_seen(*gaussian) && is_finite(*gaussian)).collect()
}

/// Some Gaussians, with the first planes of a layout that begins alike.
fn subset(gaussians: &Gaussians<Vec<f32>>, kept: &[usize], layout: Layout) -> Gaussians<Vec<f32>> {
    let mut some = Gaussians { count: kept.len(), layout, values: vec![0.0; len_of_values(kept.len(), layout)] };
    for (place, gaussian) in kept.iter().enumerate() {
        for plane in 0..layout.plane_count() {
            some.set(place, plane, gaussians.get::<1>(*gaussian, plane));
        }
    }
    some
}

/// Plain Gaussians without the harmonics above a degree.
fn with_degree(gaussians: &Gaussians<Vec<f32>>, degree: u8) -> Gaussians<Vec<f32>> {
    let layout = Layout { sh_degree: gaussians.layout.sh_degree.min(Some(degree)), ..gaussians.layout };
    let all: Vec<usize> = (0..gaussians.count).collect();
    subset(gaussians, &all, layout)
}
