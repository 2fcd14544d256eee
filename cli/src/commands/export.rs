//! `specula export`: a scene for other programs.

mod page;

use crate::{
    args::{BakeName, Export, FirstLights, LampOptions, MipName, Prefilter, SchemeName, Up},
    commands::prefilter,
    dataset::note_guessed_up,
    failure::Failure,
    lights::NamedLights,
    output, progress,
    scene::{self, background_of, note_oddities, refuse_options_without_light, relight},
};
use glam::{DVec3, Vec3};
use page::PageLight;
use specula_core::{
    camera::Camera,
    lamps::{Lamp, RAYS, check},
    scene::Environment,
};
use specula_cpu::CpuExecutor;
use specula_io::{
    Error,
    glb::textured,
    latlong,
    mesh::{self, TexturedMesh},
    orientation::Orientation,
    origin, usd,
};
use specula_scene::{
    OpenedModel, RenderOptions, Scene, SceneError, Shading,
    backdrop::BackgroundColor,
    environment::radiance,
    export::{
        BakeMethod, ExportFormat, GaussianFormat, PlainGaussians, ReferencePictures, is_of_model, provenance,
        read_relightable, up_comment, visible,
    },
    fusion::{self, Fused, MeshSize},
    number::group_digits,
    orbit::evenly_spaced,
    orientation,
    prefiltered::radiance_to_filter,
    text::shown,
    upright::{AxisConvention, Upright},
};
use std::{
    collections::{BTreeMap, btree_map::Entry},
    fs,
    path::{Path, PathBuf},
};

/// Largest number of cameras whose pictures are compared.
const COMPARED_MAX: usize = 12;
/// Number of cameras around a scene without any.
const SPHERE: u32 = 64;
/// Largest number of cameras whose depths are fused.
const FUSED_MAX: usize = 120;
/// Rows of a lat-long map for each texel along an edge of a face, enough to keep every texel.
const ROWS: usize = 2;
/// Largest number of triangles of a mesh with textures by default.
const TRIANGLES: usize = 50_000;
/// Rows and columns of its textures by default.
const TEXELS: u32 = 2048;
/// Degree of baked harmonics by default.
const DEGREE: u8 = 3;
/// Smallest angle in degrees between up and the direction that viewers assume that is reported.
const TILT_MIN: f64 = 10.0;

/// Writes the requested files.
pub(crate) fn run(args: &Export) -> Result<(), Failure> {
    let formats = args.output.iter().map(|path| format_of(path, args.mesh)).collect::<Result<Vec<_>, _>>()?;
    if let Some(twice) = (1..args.output.len()).find(|index| args.output[..*index].contains(&args.output[*index])) {
        return Err(Failure::Input(format!("{:?} is named twice with -o", args.output[twice])));
    }
    let has_textures = formats.iter().any(ExportFormat::has_textures);
    let has_mesh = has_textures || formats.contains(&ExportFormat::Mesh);
    if args.mesh && !has_mesh {
        return Err(Failure::Input(
            "--mesh writes .ply, .glb, .usda and .usdz files as meshes; name one with -o, or a .obj".to_owned(),
        ));
    }
    if args.triangles.is_some() && !has_mesh {
        return Err(Failure::Input("--triangles applies to meshes; write one with --mesh -o FILE.glb".to_owned()));
    }
    if args.texture.is_some() && !has_textures {
        return Err(Failure::Input(
            "--texture applies to .glb and .usdz meshes; write one with --mesh -o FILE.glb".to_owned(),
        ));
    }
    let has_gaussians = formats.iter().any(|format| matches!(format, ExportFormat::Gaussians(_)));
    if args.bake != BakeName::Sh && !has_gaussians {
        return Err(Failure::Input(
            "--bake applies to files of Gaussians; write one, such as with -o FILE.ply, or omit it".to_owned(),
        ));
    }
    let is_page = |format: &ExportFormat| matches!(format, ExportFormat::Page | ExportFormat::PageFolder);
    let has_page = formats.iter().any(is_page);
    let FirstLights { lamps: LampOptions { sun, lamp, lights: file }, ground } = &args.first;
    let has_lamps = !sun.is_empty() || !lamp.is_empty() || file.is_some();
    if has_lamps && !has_page && !formats.contains(&ExportFormat::TexturedMesh) {
        return Err(Failure::Input(
            "--sun, --lamp and --lights apply to pages and to .glb meshes; write one with -o FILE.html, or with --mesh -o \
             FILE.glb"
                .to_owned(),
        ));
    }
    if (*ground || args.page_exact || !args.page_env.is_empty()) && !has_page {
        return Err(Failure::Input(
            "--ground, --page-env and --page-exact apply to pages; write one with -o FILE.html".to_owned(),
        ));
    }
    refuse_options_without_light(
        args.env.as_ref().or(args.page_env.first()).map(PathBuf::as_path),
        (&args.env_options).into(),
    )?;
    let mut opened = scene::open_as(&args.model, &args.scene_options)?;
    if let Some(path) = args.output.iter().find(|path| is_of_model(path, &args.model, opened.folder.as_deref())) {
        let path = path.canonicalize().unwrap_or_else(|_| path.clone());
        return Err(Failure::Input(format!("{path:?} is a file of the model itself; use another file with -o")));
    }
    let lights = args.output.iter().zip(&formats).filter(|(_, format)| **format == ExportFormat::PrefilteredLight);
    lights
        .map(|(path, _)| prefilter::description_beside(path))
        .try_for_each(|path| prefilter::refuse_to_replace(&path))?;
    note_oddities(&opened);
    scene::refuse_light_beside(args.env.as_deref(), &args.light)?;
    let is_only_materials = formats.iter().all(ExportFormat::has_textures);
    if args.env.is_some() && opened.scene.gaussians.layout.is_physical && is_only_materials {
        return Err(Failure::Input(
            "--env has no effect on a mesh of materials, which have no light; write the light beside it, such as with \
             -o mesh.glb light.hdr, or omit --env"
                .to_owned(),
        ));
    }
    if args.env.is_none() {
        scene::settle_light(&mut opened, &args.light)?;
    }
    let lights = NamedLights::first(&args.first, &opened.scene)?;
    check(&lights.lamps(Vec3::Z), RAYS).map_err(|fault| Failure::Input(fault.to_string()))?;
    if !has_page && (lights.env.is_some() || lights.has_ground) {
        return Err(Failure::Input(
            "the environment map and the ground of --lights have no effect on a mesh; leave them out of the file, and write \
             a map beside the mesh with --env and -o light.hdr"
                .to_owned(),
        ));
    }
    if has_page || args.env.is_some() {
        scene::fuse_near_field(&mut opened, &(&args.scene_options.renderer).into())?;
    }
    let page = if has_page { Some(PageLight::new(args, opened.scene.clone(), lights.clone())?) } else { None };
    if has_page && args.env.is_none() && args.page_env.is_empty() && opened.scene.gaussians.layout.is_physical {
        tracing::info!("the page offers no other lights; --page-env sunset forest adds some to choose from");
    }
    if let Some(env) = args.env.as_ref().filter(|_| !formats.iter().all(is_page)) {
        let up = orientation::up(&opened.orientation(args.scene_options.scene_up.map(Into::into))?);
        relight(&mut opened.scene, env, (&args.env_options).into(), up)?;
        opened.is_relit = true;
    }
    if has_mesh {
        scene::note_support(&args.scene_options, &opened, "becomes part of the mesh")?;
    }
    for path in &args.output {
        output::make_folder(output::folder_of(path))?;
    }
    let up = opened.orientation(args.scene_options.scene_up.map(Into::into))?;
    let has_node = |format: &ExportFormat| match format {
        ExportFormat::Gaussians(format) => format.has_node(),
        format => format.has_textures(),
    };
    if args.upright || formats.iter().any(has_node) {
        note_guessed_up(&up);
    }
    let first = opened.cameras()?.first().map(|(_, camera)| *camera);
    let placement = args.upright.then_some((up, first));
    let background = background_of(&opened, args.background);
    let exporter = Exporter { args, background, opened, up, placement, page, lights };
    let mut baked = Baked::default();
    // Files are written independently: one may fail, the others are still written. Meshes take the
    // longest.
    let mut failures = Vec::new();
    let (mut files, meshes): (Vec<_>, Vec<_>) = args
        .output
        .iter()
        .zip(formats)
        .partition(|(_, format)| *format != ExportFormat::Mesh && !format.has_textures());
    files.extend(meshes);
    for (path, format) in files {
        match exporter.write(path, format, &mut baked) {
            Ok(()) => {}
            Err(failure @ (Failure::BrokenPipe | Failure::Interrupted(_))) => return Err(failure),
            Err(failure) => failures.push(failure),
        }
    }
    let Some(last) = failures.pop() else { return Ok(()) };
    failures.iter().for_each(|failure| tracing::error!("{failure}"));
    Err(last)
}

/// Gaussians for other programs, and the reference pictures: computed once for all files.
#[derive(Default)]
struct Baked {
    /// By degree.
    plains: BTreeMap<u8, PlainGaussians>,
    references: Option<ReferencePictures>,
    /// With the number of its views.
    textured: Option<(Fused<TexturedMesh>, usize)>,
}

fn format_of(path: &Path, is_mesh: bool) -> Result<ExportFormat, Failure> {
    let expected = ".ply, .splat, .spz, .glb, .usda or .usdz (Gaussians), .glb or .usdz with --mesh (mesh with materials), .obj \
                    (mesh), .hdr, .exr or .ktx2 (light), .html or a slash (page)";
    if path.as_os_str().to_string_lossy().ends_with(std::path::is_separator) {
        return Ok(ExportFormat::PageFolder);
    }
    if path.is_dir() {
        return Err(Failure::Input(format!(
            "{path:?} is a folder; name a file in it, or add a slash to write a page for a web server into it"
        )));
    }
    let format = ExportFormat::from_extension(&output::ending(path).unwrap_or_default(), is_mesh);
    Ok(format.ok_or_else(|| Error::Ending { path: path.to_owned(), expected })?)
}

/// Orientation of a scene, and a camera in front of it, if it has any.
type Placement = (Orientation, Option<Camera>);

/// Scene to export.
struct Exporter<'a> {
    args: &'a Export,
    opened: OpenedModel,
    background: BackgroundColor,
    up: Orientation,
    /// Orientation and first camera, if the scene is placed upright.
    placement: Option<Placement>,
    page: Option<PageLight>,
    lights: NamedLights,
}

impl Exporter<'_> {
    fn write(&self, path: &Path, format: ExportFormat, baked: &mut Baked) -> Result<(), Failure> {
        let format = match format {
            ExportFormat::LatLong => return self.write_map(path),
            ExportFormat::PrefilteredLight => return self.write_prefiltered(path),
            ExportFormat::Mesh => return self.write_mesh(path),
            ExportFormat::TexturedMesh | ExportFormat::MeshStage => {
                let textured = match &mut baked.textured {
                    Some(textured) => textured,
                    none => none.insert(self.fuse_textured()?),
                };
                return self.write_textured_mesh(path, format, textured);
            }
            ExportFormat::Page => return self.write_page(path, false),
            ExportFormat::PageFolder => return self.write_page(path, true),
            ExportFormat::Gaussians(format) => format,
        };
        let degree = format.degree_max().min(self.args.sh_degree.unwrap_or(DEGREE));
        if let Entry::Vacant(entry) = baked.plains.entry(degree) {
            entry.insert(self.plain(degree)?);
        }
        // An albedo has no picture to compare with; materials are lit by the scene's light.
        let is_lit = format == GaussianFormat::Ply && self.scene().light.is_some();
        let has_pictures = self.args.bake != BakeName::Materials || is_lit;
        let is_compared = has_pictures && !self.args.no_error;
        if baked.references.is_none() && is_compared {
            baked.references = Some(self.references()?);
        }
        let references = baked.references.as_ref().filter(|_| is_compared);
        self.write_gaussians(path, format, &baked.plains[&degree], references)
    }

    fn scene(&self) -> &Scene {
        &self.opened.scene
    }

    fn options(&self) -> RenderOptions {
        (&self.args.scene_options.renderer).into()
    }

    fn method(&self) -> BakeMethod {
        match self.args.bake {
            BakeName::Sh => BakeMethod::Harmonics,
            BakeName::Diffuse => BakeMethod::Diffuse,
            BakeName::Materials => BakeMethod::Materials,
        }
    }

    /// Transform into an upright world with these axes, if requested.
    fn upright(&self, axes: AxisConvention) -> Option<Upright> {
        self.placement.as_ref().map(|(orientation, first)| Upright::new(orientation, first.as_ref(), axes))
    }

    /// Angle in degrees between the scene's up direction and the one that viewers assume.
    fn tilt(&self, axes: AxisConvention) -> f64 {
        let assumed = if axes == AxisConvention::YUp { DVec3::Y } else { DVec3::NEG_Y };
        DVec3::from(self.up.up).angle_between(assumed).to_degrees()
    }

    /// Transform of a file of another program into the axes of another format: viewers assume y
    /// down in some, and up in others.
    fn exchanged(&self, axes: AxisConvention) -> Option<Upright> {
        let own = match self.up.up {
            [0.0, 1.0, 0.0] => AxisConvention::YUp,
            [0.0, -1.0, 0.0] => AxisConvention::YDown,
            _ => return None,
        };
        (self.opened.folder.is_none() && own != axes && axes != AxisConvention::ZUp).then(Upright::half_turn)
    }

    /// Transform of the node of a file: upright as requested, else only turned to its up axis.
    fn node(&self, axes: AxisConvention) -> Upright {
        self.upright(axes).unwrap_or_else(|| Upright::turned(&self.up, axes))
    }

    /// Visible Gaussians with harmonics up to this degree, baked if they are shaded.
    fn plain(&self, degree: u8) -> Result<PlainGaussians, Failure> {
        let all = &self.scene().gaussians;
        let kept = visible(all, self.args.min_opacity);
        if kept.is_empty() {
            return Err(Failure::Input(format!(
                "{:?} has no Gaussian to write: of {}, none is finite with an opacity of {} or more; lower \
                 --min-opacity, or use an earlier iteration",
                self.args.model, all.count, self.args.min_opacity
            )));
        }
        let is_shaded = all.layout.is_shaded();
        if self.args.bake == BakeName::Materials && !all.layout.is_physical {
            return Err(Failure::Input(format!(
                "{}; train on its photographs with --relightable",
                SceneError::NoMaterials
            )));
        }
        if is_shaded && self.args.bake == BakeName::Sh && self.scene().light.is_none() {
            tracing::warn!("the scene has no light, so nothing specular is baked; add one with --env");
        }
        let cameras = if is_shaded { self.opened.surrounding_cameras(SPHERE)? } else { Vec::new() };
        let work = progress::work("baking", 0);
        let progress = |done, all| work.done_of(done, all);
        let (exec, method) = (CpuExecutor::new(), self.method());
        let plain = PlainGaussians::bake(exec, self.scene(), kept, &cameras, degree, method, progress)?;
        work.finish();
        Ok(plain)
    }

    fn write_gaussians(
        &self,
        path: &Path,
        format: GaussianFormat,
        plain: &PlainGaussians,
        references: Option<&ReferencePictures>,
    ) -> Result<(), Failure> {
        let exchanged = || self.exchanged(format.axes());
        let placed = self.upright(format.axes()).or_else(exchanged).filter(|_| !format.has_node());
        let placement = if format.has_node() { Some(self.node(format.axes())) } else { placed };
        // Some loaders reject comments. Upright files need none: viewers assume their axes.
        let provenance = placed.is_none().then(|| PlainGaussians::provenance(self.scene(), self.method()));
        let up = provenance.is_some().then(|| up_comment(self.up.up));
        let comments: Vec<String> = provenance.into_iter().chain(self.origin()).chain(up).collect();
        let stored = plain.write(path, format, self.scene(), placement.as_ref(), &comments)?;
        let mut losses = plain.losses(self.scene(), format, self.method());
        if self.placement.is_none() && placed.is_some() {
            let up = if format.axes() == AxisConvention::YUp { '+' } else { '-' };
            losses = format!("{losses}; turned to {up}y up, as viewers of the format assume");
        }
        let tilt = if placement.is_some() { 0.0 } else { self.tilt(format.axes()) };
        if tilt > TILT_MIN {
            losses = format!("{losses}; tilted by {tilt:.0}° in viewers of the format (--upright corrects it)");
        }
        if let Some(references) = references {
            let work = progress::work("comparing", references.count() as u64);
            let progress = |done| work.done(done as u64, String::new);
            let error = if self.args.bake == BakeName::Materials {
                let scene = read_relightable(path, self.light_in(placed.as_ref()), &self.options())?;
                references.compare_scene(scene, placed.as_ref(), progress)?
            } else {
                references.compare(stored, placed.as_ref(), progress)?
            };
            work.finish();
            losses = format!("{losses}; {error}");
        }
        losses += self.without_lamps();
        self.say(path, &format!("{} Gaussians", group_digits(plain.gaussians.count)), &losses)
    }

    /// Pictures of the scene, with the colours that are baked.
    fn references(&self) -> Result<ReferencePictures, Failure> {
        let scene = self.scene().clone();
        self.references_of(if self.args.bake == BakeName::Materials { scene.shaded(Shading::Physical)? } else { scene })
    }

    /// Pictures of a scene from the model's test views, else from others.
    fn references_of(&self, scene: Scene) -> Result<ReferencePictures, Failure> {
        let cameras: Vec<Camera> = self.opened.evaluation_cameras()?.into_iter().map(|(_, camera)| camera).collect();
        let cameras = evenly_spaced(&cameras, COMPARED_MAX);
        let work = progress::work("comparing", cameras.len() as u64);
        let progress = |done| work.done(done as u64, String::new);
        let references = ReferencePictures::render(scene, cameras, self.background.0, self.options(), progress)?;
        work.finish();
        Ok(references)
    }

    fn light(&self, path: &Path) -> Result<&Environment<Vec<f32>>, Failure> {
        self.scene().light.as_ref().ok_or_else(|| {
            Failure::Input(format!(
                "{:?} has no light to write to {path:?}; use the folder of a model trained with --profile specula, or \
                 add a light with --env",
                self.args.model
            ))
        })
    }

    /// Light of the scene, in an upright world if the scene is placed there.
    fn light_in(&self, placed: Option<&Upright>) -> Option<Environment<Vec<f32>>> {
        let light = self.scene().light.as_ref()?;
        Some(placed.map_or_else(|| light.clone(), |upright| upright.light(&radiance(light), light.resolution)))
    }

    /// Transform into an upright world with the up axis of lights, if requested.
    fn upright_light(&self) -> Option<Upright> {
        self.upright(match self.args.up {
            Up::Y => AxisConvention::YUp,
            Up::Z => AxisConvention::ZUp,
        })
    }

    fn write_map(&self, path: &Path) -> Result<(), Failure> {
        let (light, up) = (self.light(path)?, self.args.up.axis());
        let height = ROWS * light.resolution;
        let orientation = self.upright_light().map_or(up.into(), |upright| upright.map_orientation(up));
        let values = radiance(light);
        let map = latlong::from_cube(&values, light.resolution, 2 * height, height, orientation);
        latlong::write(path, &map)?;
        self.say(
            path,
            &format!("light, {} × {height}", map.width),
            &format!("resampled from a cube of {}²", light.resolution),
        )
    }

    fn write_prefiltered(&self, path: &Path) -> Result<(), Failure> {
        let (light, args) = (self.light(path)?, self.prefilter(path));
        match self.upright_light() {
            Some(upright) => {
                let values = radiance_to_filter(light);
                prefilter::write(&args, &upright.light(&values, light.resolution))
            }
            None => prefilter::run(&args),
        }
    }

    /// Arguments of `specula prefilter` for the light.
    fn prefilter(&self, path: &Path) -> Prefilter {
        let env = self.args.env.clone();
        let model = || self.opened.folder.clone().unwrap_or_else(|| self.args.model.clone());
        Prefilter {
            exposure: if env.is_some() { self.args.env_options.exposure } else { 0.0 },
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
        let cameras = self.fused_cameras()?;
        let work = progress::work("fusing", 0);
        let progress = |done, all| work.done_of(done, all);
        let size = MeshSize { voxels: self.args.voxels, triangles: self.args.triangles };
        let fused = fusion::fuse(self.scene(), &cameras, size, &self.options(), progress);
        work.finish();
        let Fused { mesh, omitted } = fused?;
        if mesh.triangles.is_empty() {
            return Err(self.no_surface());
        }
        let mesh = match self.upright(AxisConvention::YUp) {
            Some(upright) => upright.mesh(mesh),
            None => mesh,
        };
        mesh::write(path, &mesh, self.origin().as_slice())?;
        let count = [mesh.triangles.len(), mesh.positions.len()];
        self.say_mesh(path, count, omitted, &format!("colours are the mean over {} views", cameras.len()))
    }

    /// Suns and lamps that files start with, if they can have any.
    fn lamps(&self) -> Vec<Lamp> {
        self.lights.lamps(orientation::up(&self.up))
    }

    /// Words on a file without the suns and lamps that others have.
    fn without_lamps(&self) -> &'static str {
        if self.lamps().is_empty() { "" } else { "; suns and lamps are only in pages and .glb meshes" }
    }

    fn texels(&self) -> u32 {
        self.args.texture.unwrap_or(TEXELS)
    }

    /// Mesh with textures, and the number of its views.
    fn fuse_textured(&self) -> Result<(Fused<TexturedMesh>, usize), Failure> {
        let cameras = self.fused_cameras()?;
        let work = progress::work("fusing", 0);
        let progress = |done, all| work.done_of(done, all);
        let size = (self.args.voxels, self.args.triangles.unwrap_or(TRIANGLES), self.texels());
        let fused = fusion::fuse_textured(self.scene(), &cameras, size, &self.options(), progress);
        work.finish();
        Ok((fused?.ok_or_else(|| self.no_surface())?, cameras.len()))
    }

    fn write_textured_mesh(
        &self,
        path: &Path,
        format: ExportFormat,
        (Fused { mesh, omitted }, views): &(Fused<TexturedMesh>, usize),
    ) -> Result<(), Failure> {
        let texels = self.texels();
        let placement = self.node(AxisConvention::YUp).node_transform();
        let mut left_out = "";
        if format == ExportFormat::MeshStage {
            let documentation = [Some(provenance("a mesh")), self.origin()].into_iter().flatten().collect::<Vec<_>>();
            usd::write_mesh(path, mesh, &placement, &documentation.join("; "))?;
            left_out = self.without_lamps();
        } else {
            let origin = if self.placement.is_some() { [0.0; 3] } else { self.opened.origin };
            textured::write(path, mesh, &self.lamps(), Some(placement), origin)?;
        }
        let content = match mesh.surface {
            Some(_) => "base colour, roughness and metalness are means",
            None => {
                "without physical materials (train --relightable) the base colour contains the light: it is the mean"
            }
        };
        let content = format!("textures of {texels} × {texels}; {content} over {views} views{left_out}");
        self.say_mesh(path, [mesh.triangles.len(), mesh.positions.len()], *omitted, &content)
    }

    /// Cameras whose depths are fused.
    fn fused_cameras(&self) -> Result<Vec<Camera>, Failure> {
        if self.scene().gaussians.count == 0 {
            return Err(Failure::Input(format!(
                "{:?} has no visible Gaussian; use an earlier iteration",
                self.args.model
            )));
        }
        Ok(evenly_spaced(&self.opened.surrounding_cameras(SPHERE)?, FUSED_MAX))
    }

    fn no_surface(&self) -> Failure {
        Failure::Input(format!(
            "no camera sees a surface in {:?}; increase --voxels, or use a model with opaque surfaces",
            self.args.model
        ))
    }

    /// Prints a written mesh of some triangles and vertices.
    fn say_mesh(&self, path: &Path, count: [usize; 2], omitted: usize, losses: &str) -> Result<(), Failure> {
        let [triangles, vertices] = count.map(group_digits);
        let omitted = match omitted {
            0 => String::new(),
            1 => "; a small component is omitted".to_owned(),
            count => format!("; {} small components are omitted", group_digits(count)),
        };
        self.say(path, &format!("{triangles} triangles, {vertices} vertices"), &format!("{losses}{omitted}"))
    }

    /// Comment that names the origin of positions; `None` in an upright world.
    fn origin(&self) -> Option<String> {
        origin::comment(self.opened.origin).filter(|_| self.placement.is_none())
    }

    /// Prints a written file: content, size, losses.
    fn say(&self, path: &Path, count: &str, losses: &str) -> Result<(), Failure> {
        let bytes = fs::metadata(path).map_err(|cause| Error::Read { path: path.to_owned(), cause })?.len();
        let origin = self.origin().map(|origin| format!("; positions are relative to the {origin}"));
        let (bytes, origin) = (group_digits(bytes as usize), origin.unwrap_or_default());
        output::say(&format!("{}: {count}, {bytes} bytes; {losses}{origin}", shown(path)))
    }
}
