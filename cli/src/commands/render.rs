//! `specula render`: pictures of a scene, layer by layer.

use crate::{
    args::{Look, MachineOptions, Render},
    camera_set::CameraSet,
    certified,
    commands::relight::write_light,
    dataset,
    failure::Failure,
    output,
    picture_folder::{PictureFolder, differences, light_differences, refuse_options_without_light},
    progress,
    scene::{self, background_of, note_oddities, relight},
};
use rayon::prelude::*;
use specula_core::{camera::Camera, rules::Channels, scene::Image, shade::ShadingForm};
use specula_io::{
    latlong::{LatLong, MapOrientation},
    model_folder::ModelInfo,
    picture::{self, RgbImage},
};
use specula_report::{certificate::CertifiedScene, measure::picture_name};
use specula_scene::{
    ExecutorChoice, Layer, OpenedModel, RenderOptions, Scene, SceneRenderer,
    backdrop::{Backdrop, BackgroundChoice},
    dataset::options_of,
    orientation, overlap,
};
use specula_train::{evaluate::largest_difference, view::View};
use std::path::Path;

/// Each frame of an animation, in milliseconds.
const FRAME_MS: u16 = 60;

/// Renders what was asked for.
pub(crate) fn run(args: &Render) -> Result<(), Failure> {
    refuse_contradictions(args)?;
    let mut opened = scene::open(&args.scene, args.look.scene_options.profile)?;
    let set = CameraSet::choose(&args.look, &opened)?;
    note_oddities(&opened);
    let up = orientation::up(&opened.orientation(args.look.scene_options.scene_up.map(Into::into))?);
    let mut map = None;
    if let Some(env) = &args.env {
        map = Some(relight(&mut opened.scene, env, &args.env_options, up)?);
    } else if opened.scene.gaussians.layout.is_shaded() && opened.scene.light.is_none() {
        tracing::warn!("the scene has no light, so nothing specular is shown; name one with --env");
    }
    let layers = layers_of(&args.layers, &opened);
    let folder = PictureFolder::of(&opened, args.output.as_deref(), set.name, &set, &words_of(args, &opened))?;
    output::make_folder(&folder.path)?;
    folder.claim(&set, args.env.is_some())?;
    if layers.contains(&Layer::Light) {
        write_light(&folder.path.join("light.png"), opened.scene.light.as_ref(), up)?;
    }

    let behind = behind(&args.look, &set, &opened, map.zip(Some(args.env_options.env_up.stand(up))))?;
    let job = Job { look: &args.look, cameras: &set, layers: &layers, folder: &folder, behind: &behind };
    let truths = if args.env.is_none() { true_views(&opened, &set) } else { Vec::new() };
    job.write_truths(&truths)?;
    let mut verification = match args.verify_omissions {
        true => {
            Some(Verification::new(opened.scene.clone(), Layer::channels(&layers), &args.look.scene_options.machine)?)
        }
        false => None,
    };
    if let Some(error) = args.max_error {
        return render_within(error, args, opened, &job);
    }
    job.run(opened, |index, image| match &mut verification {
        Some(verification) => verification.compare(&set.cameras[index].1, image),
        None => Ok(()),
    })?;
    output::say(&folder.path.display().to_string())?;
    verification.map_or(Ok(()), Verification::report)
}

/// Refuses options without effect, and bounds that are not kept.
fn refuse_contradictions(args: &Render) -> Result<(), Failure> {
    refuse_options_without_light(args.env.as_deref(), &args.env_options)?;
    if args.max_error.is_some() && !Layer::expanded(&args.layers).contains(&Layer::Rgb) {
        return Err(Failure::Input("--max-error is of colours; add rgb to --layers".into()));
    }
    Ok(())
}

/// Words for everything in which the pictures differ from those of `specula render MODEL`.
fn words_of(args: &Render, opened: &OpenedModel) -> Vec<String> {
    let Look { background, scene_options, .. } = &args.look;
    let mut words = differences(opened, &scene_options.machine, *background, scene_options.profile);
    words.extend(args.env.as_deref().map(|env| format!("env-{}", output::stem(env))));
    words.extend(light_differences(&args.env_options));
    words.extend(args.max_error.map(|error| format!("error-{error}")));
    words
}

/// Background of the pictures: a colour, the light of a file, or the scene's own.
pub(crate) fn behind(
    look: &Look,
    set: &CameraSet,
    opened: &OpenedModel,
    map: Option<(LatLong, MapOrientation)>,
) -> Result<Backdrop, Failure> {
    let own = || opened.scene.light.clone().filter(|_| opened.scene.gaussians.layout.is_shaded());
    match (look.background, map) {
        (Some(BackgroundChoice::Environment), Some((map, stand))) => {
            Ok(Backdrop::from_map(&map, stand, set.cameras.iter().map(|(_, camera)| camera)))
        }
        (Some(BackgroundChoice::Environment), None) => own().map(Backdrop::Environment).ok_or_else(|| {
            Failure::Input("the scene has no light to be its background; use --background black, white or R,G,B".into())
        }),
        (asked, _) => Ok(Backdrop::Color(background_of(opened, asked.and_then(BackgroundChoice::color)))),
    }
}

/// Renders what was asked for within an error.
fn render_within(error: f64, args: &Render, opened: OpenedModel, job: &Job<'_>) -> Result<(), Failure> {
    if let ExecutorChoice::Gpu(_) = args.look.scene_options.machine.executor {
        return Err(Failure::Input("errors are kept by the processor; use --max-error with --executor cpu".into()));
    }
    let cameras = job.cameras.cameras.iter().map(|(_, camera)| *camera).collect();
    if job.layers.len() > 1 {
        tracing::info!("only colours are verified; other layers have the same setting");
    }
    let background = job.behind.color().0;
    let certified = CertifiedScene::new(&opened.scene, cameras, background, error, !args.no_verify)?;
    let renderer = certified.renderer(&opened.scene, Layer::channels(job.layers));
    job.run_with(renderer, opened.scene.shading_model.shading.form, |_, _| Ok(()))?;
    output::say(&job.folder.path.display().to_string())?;
    output::say(certified.certificate())?;
    output::say(&certified::report(&certified))
}

/// Whether what the plan leaves out is missed anywhere.
#[derive(Debug)]
struct Verification {
    unplanned: SceneRenderer,
    channels: Channels,
    largest: f32,
}

impl Verification {
    fn new(scene: Scene, channels: Channels, options: &MachineOptions) -> Result<Self, Failure> {
        let unplanned = SceneRenderer::unplanned(scene, channels, &options.into())?;
        Ok(Self { unplanned, channels, largest: 0.0 })
    }

    /// Renders a view again with nothing left out.
    fn compare(&mut self, camera: &Camera, planned: &Image<Vec<f32>>) -> Result<(), Failure> {
        let full = self.unplanned.render(camera)?;
        self.largest = self.largest.max(largest_difference(planned, &full, self.channels));
        Ok(())
    }

    fn report(self) -> Result<(), Failure> {
        output::say(&format!("largest difference: {}", self.largest))?;
        if self.largest == 0.0 {
            return Ok(());
        }
        Err(Failure::Internal(format!("what the plan leaves out changes pictures by up to {}", self.largest)))
    }
}

/// The layers that the scene has, of those that were asked for.
fn layers_of(asked: &[Layer], opened: &OpenedModel) -> Vec<Layer> {
    let mut layers = Layer::expanded(asked);
    if !opened.scene.gaussians.layout.is_shaded() {
        let names: Vec<&str> = layers.iter().filter(|layer| layer.is_of_shading()).map(|layer| layer.name()).collect();
        if !names.is_empty() {
            tracing::warn!("the scene is plain Gaussian splatting, which has no {}", names.join(", "));
        }
        layers.retain(|layer| !layer.is_of_shading());
    }
    layers
}

/// Pictures to be made.
#[derive(Debug)]
pub(crate) struct Job<'a> {
    pub(crate) look: &'a Look,
    pub(crate) cameras: &'a CameraSet,
    pub(crate) layers: &'a [Layer],
    pub(crate) folder: &'a PictureFolder,
    pub(crate) behind: &'a Backdrop,
}

impl Job<'_> {
    /// Renders and writes every view; `each` sees every rendered view as well.
    pub(crate) fn run(
        &self,
        opened: OpenedModel,

        each: impl FnMut(usize, &Image<Vec<f32>>) -> Result<(), Failure> + Send,
    ) -> Result<(), Failure> {
        let form = opened.scene.shading_model.shading.form;
        let options = RenderOptions::from(&self.look.scene_options.machine);
        let renderer = SceneRenderer::new(opened.scene, Layer::channels(self.layers), &options)?;
        self.run_with(renderer, form, each)
    }

    /// Renders and writes every view by this renderer.
    pub(crate) fn run_with(
        &self,
        mut renderer: SceneRenderer,
        form: ShadingForm,

        mut each: impl FnMut(usize, &Image<Vec<f32>>) -> Result<(), Failure> + Send,
    ) -> Result<(), Failure> {
        let work = progress::work("rendering", self.cameras.cameras.len() as u64);
        let make = |index: usize| -> Result<_, Failure> {
            let image = renderer.render(&self.cameras.cameras[index].1)?;
            each(index, &image)?;
            Ok(image)
        };
        let finish = |index, image: Image<Vec<f32>>| {
            let colors = self.write(index, &image, form)?;
            Ok(colors.filter(|_| self.cameras.is_turntable))
        };
        let progress = |done| work.done(done as u64, String::new);
        let frames = overlap(self.cameras.cameras.len(), progress, make, finish)?;
        work.finish();
        let frames: Vec<RgbImage> = frames.into_iter().flatten().collect();
        if frames.len() > 1 {
            picture::write_animation(&self.folder.path.join("turntable.png"), &frames, FRAME_MS)?;
        }
        Ok(())
    }

    /// Writes the layers of a view; returns its colours, if they are among them.
    fn write(&self, index: usize, image: &Image<Vec<f32>>, form: ShadingForm) -> Result<Option<RgbImage>, Failure> {
        let mut colors = None;
        for layer in self.layers {
            let picture = match layer {
                Layer::Rgb => self.behind.picture(image, &self.cameras.cameras[index].1),
                other => other.picture(image, form, self.behind.color().0),
            };
            picture::write(&self.folder.of_layer(*layer).join(picture_name(index)), &picture)?;
            if *layer == Layer::Rgb {
                colors = Some(picture);
            }
        }
        Ok(colors)
    }

    /// Writes the true pictures of the views, where they are known and of the same size.
    fn write_truths(&self, views: &[View]) -> Result<(), Failure> {
        let pairs = self.cameras.cameras.par_iter().zip(views).enumerate();
        pairs.try_for_each(|(index, ((name, camera), view))| {
            let size = [camera.width, camera.height];
            if *name != view.name || size != [view.camera.width, view.camera.height] {
                return Ok(());
            }
            let path = self.folder.path.join("gt").join(picture_name(index));
            Ok(picture::write(&path, &self.behind.photograph(view))?)
        })
    }
}

/// The photographs of a set's views, if the data set of the training is still there.
fn true_views(opened: &OpenedModel, set: &CameraSet) -> Vec<View> {
    let (Some(info), Some(split)) = (&opened.info, set.split) else { return Vec::new() };
    views_of(info, split.has_test(), split.has_train()).unwrap_or_else(|failure| {
        tracing::warn!("without true pictures: {failure}");
        Vec::new()
    })
}

fn views_of(info: &ModelInfo, test: bool, train: bool) -> Result<Vec<View>, Failure> {
    let data = dataset::load(Path::new(&info.source_path), &options_of(info))?;
    let tests = data.test.into_iter().filter(|_| test);
    Ok(tests.chain(data.train.into_iter().filter(|_| train)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::scene::{Gaussians, Layout, QUAT, len_of_values};
    use specula_scene::ShadingModel;

    /// A Gaussian in front of the camera, grey from everywhere.
    fn scene() -> Scene {
        let layout = Layout::radiance(0);
        let values = vec![0.0; len_of_values(1, layout)];
        let mut gaussians = Gaussians { count: 1, layout, values };
        gaussians.set(0, QUAT, [1.0, 0.0, 0.0, 0.0]);
        Scene { gaussians, light: None, shading_model: ShadingModel::PAPER }
    }

    #[test]
    fn a_picture_that_lacks_something_is_a_fault_of_the_program() {
        let camera = Camera::look_at(glam::Vec3::X * 5.0, glam::Vec3::ZERO, glam::Vec3::Z, 0.7, 16, 16);
        let options = MachineOptions::in_full(&ExecutorChoice::Cpu);
        let mut renderer = SceneRenderer::new(scene(), Channels::Color, &(&options).into()).unwrap();
        let mut planned = renderer.render(&camera).unwrap();
        let mut verification = Verification::new(scene(), Channels::Color, &options).unwrap();
        verification.compare(&camera, &planned).unwrap();
        assert_eq!(verification.largest, 0.0);

        let number = &mut planned.plane_mut(1)[70];
        let added = (*number + 0.25) - *number;
        *number += added;
        verification.compare(&camera, &planned).unwrap();
        assert_eq!(verification.largest, added);
        let failure = verification.report().unwrap_err();
        assert_eq!(failure.exit_code(), 1);
        assert!(failure.to_string().contains(&added.to_string()), "{failure}");
    }
}
