//! Cameras of a rendering: the model's own, those of a file, or a turntable.

use crate::{
    args::{Look, Split},
    failure::Failure,
};
use specula_io::cameras::{self, NamedCamera};
use specula_scene::{
    OpenedModel,
    orbit::{DEFAULT_COUNT, DEFAULT_SIZE, near_plane, turntable},
};

/// Cameras to render.
#[derive(Debug)]
pub(crate) struct CameraSet {
    /// Name of the set, which names the folder of its pictures.
    pub(crate) name: &'static str,
    pub(crate) cameras: Vec<NamedCamera>,
    /// Split of the data set; none for other cameras.
    pub(crate) split: Option<Split>,
    /// Whether the pictures are frames of an animation.
    pub(crate) is_turntable: bool,
    /// Requested size, if it differs from that of the views.
    pub(crate) other_size: Option<[u32; 2]>,
}

impl CameraSet {
    /// Cameras that are asked for; by default the test views, else all of the model's cameras, else
    /// a turntable.
    pub(crate) fn choose(look: &Look, opened: &OpenedModel) -> Result<Self, Failure> {
        let own = opened.cameras()?;
        let mut set = Self::unsized_set(look, opened, &own)?;
        let near = near_plane(if own.is_empty() { &set.cameras } else { &own });
        set.cameras.iter_mut().for_each(|(_, camera)| camera.near = near);
        if let Some(size @ [width, height]) = look.size {
            let is_other = set.cameras.iter().any(|(_, camera)| [camera.width, camera.height] != size);
            set.other_size = is_other.then_some(size);
            set.cameras.iter_mut().for_each(|(_, camera)| *camera = camera.framed(width, height));
        }
        Ok(set)
    }

    fn unsized_set(look: &Look, opened: &OpenedModel, own: &[NamedCamera]) -> Result<Self, Failure> {
        if let Some(file) = &look.cameras {
            let cameras = cameras::read_cameras(file, look.size.unwrap_or(DEFAULT_SIZE))?;
            return Ok(Self { name: "cameras", cameras, split: None, is_turntable: false, other_size: None });
        }
        match look.turntable {
            None if !own.is_empty() => Self::of_split(look.split, own.to_vec(), opened),
            None if look.split.is_some() => Err(Failure::Input(
                "the scene has no cameras for --split; name some with --cameras, or use --turntable".into(),
            )),
            count => {
                let orientation = opened.orientation(look.scene_options.scene_up.map(Into::into))?;
                let cameras = turntable(&orientation, own, count.unwrap_or(DEFAULT_COUNT), look.size);
                Ok(Self { name: "turntable", cameras, split: None, is_turntable: true, other_size: None })
            }
        }
    }

    /// Split of the model's cameras, which are listed test views first.
    fn of_split(asked: Option<Split>, mut own: Vec<NamedCamera>, opened: &OpenedModel) -> Result<Self, Failure> {
        let test_count = opened.test_views().map(|count| count.min(own.len()));
        let default = if test_count.is_some_and(|count| count > 0) { Split::Test } else { Split::All };
        let split = asked.unwrap_or(default);
        match (split, test_count) {
            (Split::All, _) => {}
            (_, None) => {
                return Err(Failure::Input(
                    "the model does not say which of its cameras are test views; use --split all or --cameras".into(),
                ));
            }
            (Split::Test, Some(count)) => own.truncate(count),
            (Split::Train, Some(count)) => drop(own.drain(..count)),
        }
        if own.is_empty() {
            let name = split.name();
            return Err(Failure::Input(format!("the model has no {name} views; use --split all or --cameras")));
        }
        Ok(Self { name: split.name(), cameras: own, split: Some(split), is_turntable: false, other_size: None })
    }
}
