//! Folders of pictures and names of results: one for each way of rendering, so that none overwrites
//! another's.

use crate::{
    Layer, OpenedModel, RenderOptions, SceneError,
    backdrop::{BackgroundChoice, BackgroundColor},
    camera_set::CameraSet,
    light_file::{LightOptions, MapUp},
};
use specula_core::{
    antialias::LowPass,
    cutoffs::{BlendOrder, ProjectionModel},
    pack::Storage,
};
use specula_io::{Result, budget::LIST, cameras, model_folder::method_of, whole_file, within};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// Cameras of a folder's pictures.
const CAMERAS: &str = "views.json";
/// Folders other than those of layers.
const OTHERS: [&str; 2] = ["renders", "gt"];
/// Animation of a turntable.
const ANIMATION: &str = "turntable.png";

/// File name of a view's picture.
pub fn picture_name(index: usize) -> String {
    format!("{index:05}.png")
}

/// Parts of a name, one for each difference from the model's default pictures: storage, projection,
/// order, a selected light, low-pass, background, the profile that the attributes were read with,
/// and the region that the scene was cropped to.
pub fn differences(
    opened: &OpenedModel,
    options: &RenderOptions,
    background: Option<BackgroundChoice>,
    profile: Option<&str>,
) -> Vec<String> {
    let storage = (options.storage != Storage::F32).then(|| "f16".to_owned());
    let projection = match options.projection {
        ProjectionModel::Affine => None,
        ProjectionModel::Tangent => Some("tangent".to_owned()),
        ProjectionModel::Ray => Some("ray".to_owned()),
        ProjectionModel::Within(alpha) => Some(format!("within-{alpha}")),
    };
    let order = match options.order {
        BlendOrder::Mean => None,
        BlendOrder::Window(count) => Some(format!("window-{count}")),
        BlendOrder::Pixel => Some("pixel-order".to_owned()),
    };
    let light = opened.own_light.map(|number| format!("light{number}"));
    let layout = opened.scene.gaussians.layout;
    let low_pass = match layout.low_pass {
        LowPass::Compensated => Some("antialiased".to_owned()),
        LowPass::Mip if !layout.is_smoothed => Some("antialiased-mip".to_owned()),
        LowPass::Dilated | LowPass::Mip => None,
    };
    let background = background.and_then(|requested| match requested {
        BackgroundChoice::Environment => Some("on-env".to_owned()),
        BackgroundChoice::Transparent => Some("on-nothing".to_owned()),
        BackgroundChoice::Color(color) => {
            (color != BackgroundColor(opened.background())).then(|| format!("on-{color}"))
        }
    });
    let profile = profile.filter(|_| !opened.is_read_as_saved).map(|profile| format!("as-{profile}"));
    let crop = opened.crop.map(|region| format!("crop-{region}"));
    [storage, projection, order, light, low_pass, background, profile, crop].into_iter().flatten().collect()
}

/// Parts of a name, one for each change to the light of a file.
pub fn light_differences(options: LightOptions) -> Vec<String> {
    let up = match options.up {
        MapUp::Scene => None,
        MapUp::Y => Some("up-y".to_owned()),
        MapUp::Z => Some("up-z".to_owned()),
    };
    let exposure = (options.exposure != 0.0).then(|| format!("exposure{:+}", options.exposure));
    [up, exposure].into_iter().flatten().collect()
}

/// Folder of pictures.
#[derive(Clone, Debug)]
pub struct PictureFolder {
    /// Path of the folder.
    pub path: PathBuf,
    /// Folder of colours: `renders` as in other tools, `rgb` in a folder that the user named.
    rgb: &'static str,
}

impl PictureFolder {
    /// Requested folder, or `MODEL/GROUP/ours_N`, its name followed by `differences`, by a size
    /// other than that of the views and by a mark of rotated pictures.
    ///
    /// # Errors
    ///
    /// [`SceneError::NoFolder`] for a single PLY file without a requested folder;
    /// [`specula_io::Error::Link`] if pictures would be written or removed through a link.
    pub fn of(
        opened: &OpenedModel,
        requested: Option<&Path>,
        group: &str,
        set: &CameraSet,
        differences: &[String],
    ) -> core::result::Result<Self, SceneError> {
        let (root, pictures) = match (requested, &opened.folder, opened.iteration) {
            (Some(folder), _, _) => (folder, Self { path: folder.to_owned(), rgb: "rgb" }),
            (None, Some(model), Some(iteration)) => {
                let size = set.other_size.map(|[width, height]| format!("{width}x{height}"));
                let upright = set.is_turned.then(|| "upright".to_owned());
                let name = [&[method_of(iteration)], differences, &Vec::from_iter(size), &Vec::from_iter(upright)];
                let name = name.concat().join("_");
                (model.as_path(), Self { path: model.join(group).join(name), rgb: "renders" })
            }
            _ => return Err(SceneError::NoFolder),
        };
        every_name().try_for_each(|name| within::refuse_links(root, &pictures.path.join(name)))?;
        Ok(pictures)
    }

    /// Path of a layer's picture of a view.
    pub fn picture(&self, layer: Layer, index: usize) -> PathBuf {
        self.path.join(self.folder_of(layer)).join(picture_name(index))
    }

    /// Path of the numbers of a layer's view.
    pub fn numbers(&self, layer: Layer, index: usize) -> PathBuf {
        self.picture(layer, index).with_extension("exr")
    }

    /// Path of the true picture of a view.
    pub(crate) fn true_picture(&self, index: usize) -> PathBuf {
        self.path.join("gt").join(picture_name(index))
    }

    /// Path of the animation of a turntable.
    pub fn animation(&self) -> PathBuf {
        self.path.join(ANIMATION)
    }

    /// Writes the list of cameras, and removes pictures and numbers of an earlier rendering: the
    /// numbers of `layers`, or everything if its cameras differ or its light may differ. Removes
    /// nothing from a folder without a list.
    ///
    /// # Errors
    ///
    /// A list that cannot be written, or is not a file.
    pub fn claim(&self, set: &CameraSet, layers: &[Layer], may_be_relit: bool) -> Result<()> {
        whole_file::remove_unfinished(&self.path, 1);
        let path = self.path.join(CAMERAS);
        let is_listed = within::holds(&path)?;
        let before = LIST.read(&path).ok();
        cameras::write(&path, &set.cameras, set.origin)?;
        let is_same = before.is_some() && before == LIST.read(&path).ok();
        if is_listed && (may_be_relit || !is_same) {
            let every: Vec<&str> = every_name().collect();
            let removed = self.remove(&every, "png") + self.remove(&every, "exr");
            if removed > 0 && !is_same {
                tracing::info!("removed {removed} pictures of other views from {:?}", self.path);
            }
            let _ = fs::remove_file(self.animation());
        } else if is_listed {
            self.remove(&layers.iter().map(|layer| self.folder_of(*layer)).collect::<Vec<_>>(), "exr");
        }
        Ok(())
    }

    /// Name of a layer's folder.
    fn folder_of(&self, layer: Layer) -> &'static str {
        if layer == Layer::Rgb { self.rgb } else { layer.name() }
    }

    /// Removes numbered files with this extension from folders of these names; returns their
    /// number. Failures are reported when files are written.
    fn remove(&self, names: &[&str], extension: &str) -> usize {
        let folders = names.iter().map(|name| self.path.join(name));
        let files = folders.flat_map(|folder| fs::read_dir(folder).into_iter().flatten().flatten());
        let numbered = files.map(|entry| entry.path()).filter(|path| is_numbered(path, extension));
        numbered.filter(|path| fs::remove_file(path).is_ok()).count()
    }
}

/// Name of every folder of pictures.
fn every_name() -> impl Iterator<Item = &'static str> {
    Layer::EACH.into_iter().map(Layer::name).chain(OTHERS)
}

/// Returns whether a file has a name of [`picture_name`] with this extension.
fn is_numbered(path: &Path, extension: &str) -> bool {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    path.extension().is_some_and(|own| own == extension)
        && stem.len() >= 5
        && stem.bytes().all(|byte| byte.is_ascii_digit())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_pictures_are_numbers() {
        for name in ["00000.png", "123456.png"] {
            assert!(is_numbered(Path::new(name), "png"), "{name}");
        }
        assert!(is_numbered(Path::new(&picture_name(7)), "png"));
        assert!(is_numbered(Path::new("00007.exr"), "exr"));
        for name in ["0000.png", "00000.jpg", "00000.exr", "a0000.png", "00000"] {
            assert!(!is_numbered(Path::new(name), "png"), "{name}");
        }
    }
}
