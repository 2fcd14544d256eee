//! Lights of a scene: its own, and added environment maps.

use crate::{
    ViewerError,
    request::{DARKNESS, LightSetting, NONE},
};
use core::f32::consts::LN_2;
use glam::Vec3;
use serde_json::{Value, json};
use specula_core::{
    light_network::CHANNELS,
    scene::{Environment, RadianceActivation},
};
use specula_io::{
    Input,
    latlong::{self, LatLong},
    picture,
};
use specula_scene::{
    environment::radiance,
    light_file::{self, MapUp},
};
use std::{
    path::Path,
    sync::{Arc, Mutex, MutexGuard},
};

/// Identifier of the scene's own light.
const SCENE_LIGHT: u32 = 0;
/// Unchanged light of the scene.
pub(crate) const OF_SCENE: LightSetting = LightSetting { id: SCENE_LIGHT, turn: 0.0, stops: 0.0 };
/// Largest number of added lights; the oldest one is replaced.
const LIGHTS_MAX: usize = 16;
/// Longest name of a light, in characters.
const NAME_MAX: usize = 64;
/// Width and height of a preview, in pixels.
const PREVIEW_SIZE: [usize; 2] = [256, 128];
/// JPEG quality of a preview.
const PREVIEW_QUALITY: u8 = 85;

const NO_POISON: &str = "nothing panics under the lock of the lights";

/// Environment map as a cube.
pub(crate) type Cube = Environment<Vec<f32>>;

/// Identifier and name of a light.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Label {
    pub(crate) id: u32,
    pub(crate) name: String,
    /// Name of its file, and the up direction of reading it; `None` for a light without a file.
    pub(crate) file: Option<(String, MapUp)>,
}

impl Label {
    /// Label for the page.
    pub(crate) fn json(&self) -> Value {
        let mut json = json!({"id": id_json(self.id), "name": self.name});
        if let Some((file, up)) = &self.file {
            json["file"] = file.as_str().into();
            json["up"] = up.name().into();
        }
        json
    }
}

/// Identifier in requests.
pub(crate) fn id_json(id: u32) -> Value {
    if id == DARKNESS { NONE.into() } else { id.into() }
}

/// Lights that requests can select.
#[derive(Debug)]
pub(crate) struct Lights {
    /// Resolution of added lights, in texels along a face's edge.
    resolution: usize,
    /// Up direction of the scene.
    up: Vec3,
    /// True if no light can be selected, because suns and lamps can replace it.
    offers_darkness: bool,
    table: Mutex<Table>,
}

#[derive(Debug)]
struct Table {
    scene_light: Option<Arc<Cube>>,
    added: Vec<(Label, Arc<Cube>)>,
    /// Total number of lights added so far.
    count: u32,
}

impl Lights {
    /// Lights of a scene with this up direction and light; others are added at this resolution.
    pub(crate) fn new(scene_light: Option<Cube>, resolution: usize, up: Vec3, offers_darkness: bool) -> Self {
        let table = Table { scene_light: scene_light.map(Arc::new), added: Vec::new(), count: 0 };
        Self { resolution, up, offers_darkness, table: Mutex::new(table) }
    }

    /// Up direction of the scene.
    pub(crate) fn up(&self) -> Vec3 {
        self.up
    }

    /// Black light.
    pub(crate) fn darkness(&self) -> Cube {
        let resolution = self.resolution;
        let values = vec![0.0; 18 * resolution * resolution];
        Cube { resolution, activation: RadianceActivation::Identity, values }
    }

    /// Replaces the scene's own light.
    pub(crate) fn set_scene_light(&self, light: Option<Cube>) {
        self.lock().scene_light = light.map(Arc::new);
    }

    /// Reads and adds a lat-long map with the file name `name`. Returns its label, and warnings
    /// about its contents.
    pub(crate) fn add(&self, file: Input<'_>, name: &str, up: MapUp) -> Result<(Label, Vec<String>), ViewerError> {
        let (map, warnings) = light_file::read(file)?;
        let values = latlong::to_cube(&map, self.resolution, up.orientation(self.up));
        let cube = Cube { resolution: self.resolution, activation: RadianceActivation::Identity, values };
        Ok((self.add_cube(cube, name, up), warnings))
    }

    /// Adds a cube made from a lat-long map with the file name `name`. Returns its label.
    pub(crate) fn add_cube(&self, cube: Cube, name: &str, up: MapUp) -> Label {
        let stem = Path::new(name).file_stem().unwrap_or_default().to_string_lossy();
        let file_name = Path::new(name).file_name().unwrap_or_default().to_string_lossy().into_owned();
        self.insert(cube, &stem, Some((file_name, up)))
    }

    /// Adds a light of the scene's training. Returns its label.
    pub(crate) fn add_trained(&self, cube: Cube, name: &str) -> Label {
        self.insert(cube, name, None)
    }

    fn insert(&self, cube: Cube, name: &str, file: Option<(String, MapUp)>) -> Label {
        let mut table = self.lock();
        table.count += 1;
        let label = Label { id: table.count, name: name.chars().take(NAME_MAX).collect(), file };
        if table.added.len() == LIGHTS_MAX {
            table.added.remove(0);
        }
        table.added.push((label.clone(), Arc::new(cube)));
        label
    }

    /// Labels of all lights, the scene's own first.
    pub(crate) fn labels(&self) -> Vec<Label> {
        let table = self.lock();
        let plain = |id: u32, name: &str| Label { id, name: name.into(), file: None };
        let scene_light = table.scene_light.as_ref().map(|_| plain(SCENE_LIGHT, "scene light"));
        let darkness = self.offers_darkness.then(|| plain(DARKNESS, NONE));
        scene_light.into_iter().chain(darkness).chain(table.added.iter().map(|(label, _)| label.clone())).collect()
    }

    /// Light with its rotation and exposure. The outer option is `None` for a light that has been
    /// replaced, the inner one for a scene without a light.
    pub(crate) fn get(&self, setting: LightSetting) -> Option<Option<Cube>> {
        let table = self.lock();
        let cube = match setting.id {
            SCENE_LIGHT => table.scene_light.clone(),
            DARKNESS => return Some(Some(self.darkness())),
            id => Some(table.added.iter().find(|(label, _)| label.id == id)?.1.clone()),
        };
        drop(table);
        Some(cube.map(|cube| self.adjusted(&cube, setting)))
    }

    /// True if a setting turns a network; a turned cube map would not have its levels.
    pub(crate) fn turns_network(&self, setting: LightSetting) -> bool {
        let is_network = self.lock().scene_light.as_ref().is_some_and(|light| light.is_network());
        is_network && setting.id == SCENE_LIGHT && setting.turn != 0.0
    }

    /// Preview of a light with its rotation and exposure, as a JPEG.
    pub(crate) fn preview(&self, setting: LightSetting) -> Option<Vec<u8>> {
        let map = self.preview_map(setting)?;
        Some(picture::to_jpeg(&picture::tone_map_latlong(&map), PREVIEW_QUALITY))
    }

    /// Lat-long preview of a light with its rotation and exposure.
    fn preview_map(&self, setting: LightSetting) -> Option<LatLong> {
        let cube = self.get(setting)??;
        let values = radiance(&cube);
        let [width, height] = PREVIEW_SIZE;
        let orientation = MapUp::Scene.orientation(self.up);
        Some(latlong::from_cube(&values, cube.resolution, width, height, orientation))
    }

    /// Cube with a rotation and an exposure; unchanged to the last bit without either.
    fn adjusted(&self, cube: &Cube, LightSetting { turn, stops, .. }: LightSetting) -> Cube {
        if turn == 0.0 && stops == 0.0 {
            return cube.clone();
        }
        if turn == 0.0 && cube.is_network() {
            let mut brighter = cube.clone();
            let biases = brighter.values.len() - CHANNELS;
            brighter.values[biases..].iter_mut().for_each(|bias| *bias += stops * LN_2);
            return brighter;
        }
        let mut values = radiance(cube);
        values.iter_mut().for_each(|number| *number *= stops.exp2());
        let axis = self.up.as_dvec3().to_array();
        let values = latlong::rotated(&values, cube.resolution, axis, f64::from(turn).to_radians());
        Cube { resolution: cube.resolution, activation: RadianceActivation::Identity, values }
    }

    fn lock(&self) -> MutexGuard<'_, Table> {
        self.table.lock().expect(NO_POISON)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::light_network::{WEIGHT_COUNT, initial_weight};
    use specula_io::latlong::UpAxis;

    fn grey() -> Cube {
        Cube { resolution: 16, activation: RadianceActivation::Exponential, values: vec![0.5; 18 * 16 * 16] }
    }

    #[test]
    fn an_unmoved_light_is_unchanged_to_the_last_bit() {
        let lights = Lights::new(Some(grey()), 16, Vec3::Z, false);
        assert_eq!(lights.get(OF_SCENE), Some(Some(grey())));
        let brighter = lights.get(LightSetting { stops: 1.0, turn: 33.0, ..OF_SCENE }).unwrap().unwrap();
        assert!(brighter.values.iter().all(|number| (number - 2.0 * 0.5_f32.exp()).abs() < 1e-5), "twice as bright");
    }

    #[test]
    fn a_network_can_be_brightened_but_not_turned() {
        let weight = |index| initial_weight(index, -0.5, 3) + 0.001 * (index % 7) as f32;
        let values = (0..WEIGHT_COUNT).map(weight).collect();
        let network = Cube { resolution: 16, activation: RadianceActivation::Network, values };
        let lights = Lights::new(Some(network.clone()), 16, Vec3::Z, false);
        assert_eq!(lights.get(OF_SCENE), Some(Some(network.clone())));
        let brighter = lights.get(LightSetting { stops: 2.0, ..OF_SCENE }).unwrap().unwrap();
        assert!(brighter.is_network(), "other levels become brighter as well");
        for (bright, own) in radiance(&brighter).iter().zip(radiance(&network)) {
            assert!((bright / own - 4.0).abs() < 1e-4, "{bright} is not four times {own}");
        }
        let turned = LightSetting { turn: 30.0, ..OF_SCENE };
        assert!(lights.turns_network(turned) && !lights.turns_network(LightSetting { id: 1, ..turned }));
        assert!(!lights.turns_network(OF_SCENE) && lights.preview_map(turned).is_some());
        lights.set_scene_light(Some(grey()));
        assert!(!lights.turns_network(turned), "a map can be turned");
    }

    #[test]
    fn a_light_is_oriented_like_the_scene_and_its_preview_like_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("sky.exr");
        let (width, height) = (16, 8);
        let rgb = (0..3 * width * height).map(|k| if k < 3 * width * height / 2 { 1.0 } else { 0.0 }).collect();
        latlong::write(&file, &LatLong { width, height, rgb }).unwrap();
        for above in [Vec3::Z, Vec3::Y, Vec3::NEG_Y, Vec3::new(0.6, -0.48, -0.64)] {
            let lights = Lights::new(None, 16, above, false);
            let id = lights.add(Input::file(&file), "sky", MapUp::Scene).unwrap().0.id;
            let setting = LightSetting { id, ..OF_SCENE };
            let cube = lights.get(setting).unwrap().unwrap();
            let sees = |direction: Vec3| {
                let [u, v] = UpAxis::Z.uv(direction.as_dvec3().to_array());
                let map = latlong::from_cube(&cube.values, 16, 64, 32, UpAxis::Z);
                map.rgb[3 * ((v * 31.99) as usize * 64 + (u * 63.99) as usize)]
            };
            assert!(sees(above) > 0.99 && sees(-above) < 0.01, "the sky is above where {above} is");
            let preview = lights.preview_map(setting).unwrap();
            let rows = preview.rgb.chunks_exact(3 * preview.width);
            let means: Vec<f32> = rows.map(|row| row.iter().sum::<f32>() / row.len() as f32).collect();
            let half = means.len() / 2;
            // The horizon is blurred by a pixel of the file and a texel of the cube.
            assert!(means[..half - half / 4].iter().all(|mean| *mean > 0.99), "the sky is the upper half: {means:?}");
            assert!(means[half + half / 4..].iter().all(|mean| *mean < 0.01), "and nothing else: {means:?}");
        }
    }

    #[test]
    fn no_light_can_be_selected_if_lamps_are_possible() {
        let names = |lights: &Lights| lights.labels().iter().map(|label| label.json()).collect::<Vec<_>>();
        let lights = Lights::new(Some(grey()), 16, Vec3::Z, true);
        assert_eq!(names(&lights), [json!({"id": 0, "name": "scene light"}), json!({"id": "none", "name": "none"})]);
        assert_eq!(names(&Lights::new(Some(grey()), 16, Vec3::Z, false)).len(), 1);
        let dark = lights.get(LightSetting { id: DARKNESS, turn: 30.0, stops: 4.0 }).unwrap().unwrap();
        assert!(dark.values.iter().all(|number| *number == 0.0), "for any turn and exposure");
    }

    #[test]
    fn the_oldest_added_light_is_evicted_first() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("sky.hdr");
        latlong::write(&file, &LatLong { width: 8, height: 4, rgb: vec![1.0; 96] }).unwrap();
        let lights = Lights::new(Some(grey()), 16, Vec3::Z, false);
        for _ in 0..=LIGHTS_MAX {
            lights.add(Input::file(&file), "sky", MapUp::Z).unwrap();
        }
        let ids: Vec<u32> = lights.labels().iter().map(|label| label.id).collect();
        assert_eq!((ids.len(), ids[0], ids[1]), (LIGHTS_MAX + 1, SCENE_LIGHT, 2));
        assert_eq!(lights.get(LightSetting { id: 1, ..OF_SCENE }), None, "it was evicted");
        assert!(lights.get(LightSetting { id: 2, ..OF_SCENE }).unwrap().is_some(), "the next is there");
    }
}
