//! Folders of pictures and names of results: one for each way of rendering, so that none overwrites
//! another's.

use crate::{
    args::{EnvOptions, EnvUp, MachineOptions, ProfileName},
    camera_set::CameraSet,
    failure::Failure,
    output::stem,
    scene::background_of,
};
use specula_core::{cutoffs::ProjectionModel, pack::Storage};
use specula_io::{cameras, model_folder::method_of};
use specula_scene::{Layer, OpenedModel, backdrop::BackgroundChoice};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// Cameras of a folder's pictures.
const CAMERAS: &str = "views.json";
/// Folders beside those of layers.
const OTHERS: [&str; 2] = ["renders", "gt"];

/// Parts of a name, one for each difference from `specula render MODEL`.
pub(crate) fn differences(
    opened: &OpenedModel,
    machine: &MachineOptions,
    background: Option<BackgroundChoice>,
    profile: Option<ProfileName>,
) -> Vec<String> {
    let storage = (machine.storage() != Storage::F32).then(|| "f16".to_owned());
    let projection = match machine.projection {
        ProjectionModel::Affine => None,
        ProjectionModel::Tangent => Some("tangent".to_owned()),
        ProjectionModel::Ray => Some("ray".to_owned()),
        ProjectionModel::Within(alpha) => Some(format!("within-{alpha}")),
    };
    let background = background.and_then(|asked| match asked {
        BackgroundChoice::Environment => Some("on-env".to_owned()),
        BackgroundChoice::Color(color) => (color != background_of(opened, None)).then(|| format!("on-{color}")),
    });
    let read = profile.filter(|_| !opened.is_read_as_saved).map(|profile| format!("as-{}", profile.name()));
    [storage, projection, background, read].into_iter().flatten().collect()
}

/// Parts of a name, one for each change to the light of a file.
pub(crate) fn light_differences(options: &EnvOptions) -> Vec<String> {
    let up = match options.env_up {
        EnvUp::Scene => None,
        EnvUp::Y => Some("up-y".to_owned()),
        EnvUp::Z => Some("up-z".to_owned()),
    };
    let exposure = (options.exposure != 0.0).then(|| format!("exposure{:+}", options.exposure));
    [up, exposure].into_iter().flatten().collect()
}

/// Refuses options of a light without a light, which would change nothing.
pub(crate) fn refuse_options_without_light(light: Option<&Path>, options: &EnvOptions) -> Result<(), Failure> {
    if light.is_some() || light_differences(options).is_empty() {
        return Ok(());
    }
    Err(Failure::Input("--exposure and --env-up are of the light that --env names; name one".into()))
}

/// Folder of pictures.
#[derive(Debug)]
pub(crate) struct PictureFolder {
    pub(crate) path: PathBuf,
    /// Folder of colours: `renders` as in other tools, `rgb` in a folder that the user named.
    rgb: &'static str,
}

impl PictureFolder {
    /// Folder `asked` for, or `MODEL/GROUP/ours_N`, its name followed by `differences` and by a
    /// size other than that of the views.
    pub(crate) fn of(
        opened: &OpenedModel,
        asked: Option<&Path>,
        group: &str,
        set: &CameraSet,
        differences: &[String],
    ) -> Result<Self, Failure> {
        match (asked, &opened.folder, opened.iteration) {
            (Some(folder), _, _) => Ok(Self { path: folder.to_owned(), rgb: "rgb" }),
            (None, Some(model), Some(iteration)) => {
                let size = set.other_size.map(|[width, height]| format!("{width}x{height}"));
                let name = [&[method_of(iteration)], differences, &Vec::from_iter(size)].concat().join("_");
                Ok(Self { path: model.join(group).join(name), rgb: "renders" })
            }
            _ => Err(Failure::Input("a PLY file has no folder for pictures; name one with -o".into())),
        }
    }

    /// Folder of a layer.
    pub(crate) fn of_layer(&self, layer: Layer) -> PathBuf {
        self.path.join(if layer == Layer::Rgb { self.rgb } else { layer.name() })
    }

    /// Lists the cameras beside the pictures, and removes an earlier rendering's pictures if its
    /// cameras differ, or if its light may differ.
    pub(crate) fn claim(&self, set: &CameraSet, may_be_relit: bool) -> Result<(), Failure> {
        let path = self.path.join(CAMERAS);
        let before = fs::read(&path).ok();
        cameras::write(&path, &set.cameras)?;
        let now = fs::read(&path).ok();
        if before.is_some() && (may_be_relit || before != now) {
            self.remove_pictures();
        }
        Ok(())
    }

    /// Removes numbered pictures of all layers. Failures show when the pictures are written.
    fn remove_pictures(&self) {
        let layers = Layer::EACH.into_iter().map(Layer::name).chain(OTHERS);
        for folder in layers.map(|name| self.path.join(name)) {
            let entries = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
            entries.filter(|path| is_numbered(path)).for_each(|path| drop(fs::remove_file(path)));
        }
        let _ = fs::remove_file(self.path.join("turntable.png"));
    }
}

/// Returns whether a file has a name of [`specula_report::measure::picture_name`].
fn is_numbered(path: &Path) -> bool {
    let stem = stem(path);
    path.extension().is_some_and(|ending| ending == "png")
        && stem.len() >= 5
        && stem.bytes().all(|byte| byte.is_ascii_digit())
}
