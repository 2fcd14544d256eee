//! Lights that a scene can be put under: its own, and those that were named or dropped onto the page.

use super::request::LightAsk;
use crate::{args::EnvUp, failure::Failure, scene::read_env_with_notes};
use glam::Vec3;
use specula_core::scene::{Environment, RadianceActivation};
use specula_io::latlong::{self, LatLong, Stand};
use specula_scene::environment::radiance;
use std::{
    path::Path,
    sync::{Arc, Mutex, MutexGuard},
};

/// The number of the scene's own light.
pub(super) const OWN: u32 = 0;
/// Lights that are kept beside the scene's own; the oldest makes room.
const LIGHTS_MAX: usize = 16;
/// Letters of a light's name, at most.
const NAME_MAX: usize = 64;
/// Pixels of a preview.
const PREVIEW: [usize; 2] = [256, 128];

const HELD_SHORTLY: &str = "nothing panics while it holds the lights";

/// A light as a cube map.
pub(super) type Cube = Environment<Vec<f32>>;

/// What a light is called.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Label {
    pub(super) id: u32,
    pub(super) name: String,
}

/// The lights that there are.
#[derive(Debug)]
pub(super) struct Lights {
    /// Texels along an edge of lights that come in.
    resolution: usize,
    up: Vec3,
    shelf: Mutex<Shelf>,
}

#[derive(Debug)]
struct Shelf {
    own: Option<Arc<Cube>>,
    others: Vec<(Label, Arc<Cube>)>,
    /// How many came in so far.
    count: u32,
}

impl Lights {
    /// The light of a scene, whose world has this direction above; others come in with this resolution.
    pub(super) fn new(own: Option<Cube>, resolution: usize, up: Vec3) -> Self {
        let shelf = Shelf { own: own.map(Arc::new), others: Vec::new(), count: 0 };
        Self { resolution, up, shelf: Mutex::new(shelf) }
    }

    /// The scene has another light of its own now.
    pub(super) fn set_own(&self, own: Option<Cube>) {
        self.lock().own = own.map(Arc::new);
    }

    /// Reads a lat-long map, and keeps it; sentences about what is odd in it.
    pub(super) fn add(&self, file: &Path, name: &str, up: EnvUp) -> Result<(Label, Vec<String>), Failure> {
        let (map, notes) = read_env_with_notes(file, 0.0)?;
        let values = latlong::to_cube(&map, self.resolution, up.stand(self.up));
        let cube = Cube { resolution: self.resolution, activation: RadianceActivation::Identity, values };
        let mut shelf = self.lock();
        shelf.count += 1;
        let label = Label { id: shelf.count, name: name.chars().take(NAME_MAX).collect() };
        if shelf.others.len() == LIGHTS_MAX {
            shelf.others.remove(0);
        }
        shelf.others.push((label.clone(), Arc::new(cube)));
        Ok((label, notes))
    }

    /// All that there are, the scene's own first.
    pub(super) fn labels(&self) -> Vec<Label> {
        let shelf = self.lock();
        let own = shelf.own.as_ref().map(|_| Label { id: OWN, name: "its own".into() });
        own.into_iter().chain(shelf.others.iter().map(|(label, _)| label.clone())).collect()
    }

    /// A light as it is asked for: none if the scene has none of its own, and no answer if it is not there any more.
    pub(super) fn get(&self, ask: LightAsk) -> Option<Option<Cube>> {
        let shelf = self.lock();
        let cube = match ask.id {
            OWN => shelf.own.clone(),
            id => Some(shelf.others.iter().find(|(label, _)| label.id == id)?.1.clone()),
        };
        drop(shelf);
        Some(cube.map(|cube| self.moved(&cube, ask)))
    }

    /// A preview of a light as it is asked for.
    pub(super) fn preview(&self, ask: LightAsk) -> Option<LatLong> {
        let cube = self.get(ask)??;
        let values = radiance(cube.activation, &cube.values);
        let [width, height] = PREVIEW;
        let stand = Stand::above(self.up.as_dvec3().to_array());
        Some(latlong::from_cube(&values, cube.resolution, width, height, stand))
    }

    /// Turned and made brighter; as it is, to the last bit, where it is neither.
    fn moved(&self, cube: &Cube, LightAsk { turn, stops, .. }: LightAsk) -> Cube {
        if turn == 0.0 && stops == 0.0 {
            return cube.clone();
        }
        let mut values = radiance(cube.activation, &cube.values);
        values.iter_mut().for_each(|number| *number *= stops.exp2());
        let axis = self.up.as_dvec3().to_array();
        let values = latlong::turned(&values, cube.resolution, axis, f64::from(turn).to_radians());
        Cube { resolution: cube.resolution, activation: RadianceActivation::Identity, values }
    }

    fn lock(&self) -> MutexGuard<'_, Shelf> {
        self.shelf.lock().expect(HELD_SHORTLY)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_io::latlong::UpAxis;

    const OWN_LIGHT: LightAsk = LightAsk { id: OWN, turn: 0.0, stops: 0.0 };

    fn grey() -> Cube {
        Cube { resolution: 16, activation: RadianceActivation::Exponential, values: vec![0.5; 18 * 16 * 16] }
    }

    #[test]
    fn a_light_that_is_not_moved_is_itself_to_the_last_bit() {
        let lights = Lights::new(Some(grey()), 16, Vec3::Z);
        assert_eq!(lights.get(OWN_LIGHT), Some(Some(grey())));
        let brighter = lights.get(LightAsk { stops: 1.0, turn: 33.0, ..OWN_LIGHT }).unwrap().unwrap();
        assert!(brighter.values.iter().all(|number| (number - 2.0 * 0.5_f32.exp()).abs() < 1e-5), "twice as bright");
    }

    #[test]
    fn a_light_stands_as_the_scene_does_and_its_preview_as_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("sky.exr");
        let (width, height) = (16, 8);
        let rgb = (0..3 * width * height).map(|k| if k < 3 * width * height / 2 { 1.0 } else { 0.0 }).collect();
        latlong::write(&file, &LatLong { width, height, rgb }).unwrap();
        for above in [Vec3::Z, Vec3::Y, Vec3::NEG_Y, Vec3::new(0.6, -0.48, -0.64)] {
            let lights = Lights::new(None, 16, above);
            let id = lights.add(&file, "sky", EnvUp::Scene).unwrap().0.id;
            let ask = LightAsk { id, ..OWN_LIGHT };
            let cube = lights.get(ask).unwrap().unwrap();
            let sees = |direction: Vec3| {
                let [u, v] = UpAxis::Z.place(direction.as_dvec3().to_array());
                let map = latlong::from_cube(&cube.values, 16, 64, 32, UpAxis::Z);
                map.rgb[3 * ((v * 31.99) as usize * 64 + (u * 63.99) as usize)]
            };
            assert!(sees(above) > 0.99 && sees(-above) < 0.01, "the sky is above where {above} is");
            let preview = lights.preview(ask).unwrap();
            let rows = preview.rgb.chunks_exact(3 * preview.width);
            let means: Vec<f32> = rows.map(|row| row.iter().sum::<f32>() / row.len() as f32).collect();
            let half = means.len() / 2;
            // The horizon is as wide as a pixel of the file, and a texel of the cube.
            assert!(means[..half - half / 4].iter().all(|mean| *mean > 0.99), "the sky is the upper half: {means:?}");
            assert!(means[half + half / 4..].iter().all(|mean| *mean < 0.01), "and nothing else: {means:?}");
        }
    }

    #[test]
    fn the_oldest_light_makes_room_and_the_scenes_own_stays() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("sky.hdr");
        latlong::write(&file, &LatLong { width: 8, height: 4, rgb: vec![1.0; 96] }).unwrap();
        let lights = Lights::new(Some(grey()), 16, Vec3::Z);
        for _ in 0..=LIGHTS_MAX {
            lights.add(&file, "sky", EnvUp::Z).unwrap();
        }
        let ids: Vec<u32> = lights.labels().iter().map(|label| label.id).collect();
        assert_eq!((ids.len(), ids[0], ids[1]), (LIGHTS_MAX + 1, OWN, 2));
        assert_eq!(lights.get(LightAsk { id: 1, ..OWN_LIGHT }), None, "it made room");
        assert!(lights.get(LightAsk { id: 2, ..OWN_LIGHT }).unwrap().is_some(), "the next is there");
    }
}
