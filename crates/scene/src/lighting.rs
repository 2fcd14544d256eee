//! Lighting of a scene: an environment map and suns, which turn about the up direction, lamps, and
//! ground that catches shadows.

use crate::{
    RenderOptions, Scene, SceneError, SceneRenderer, Surface,
    backdrop::Backdrop,
    ground::{Ground, GroundPlane},
    lamps::{SceneLamps, SphereChoice, SunChoice, lamps_of, turned},
    light_file::MapUp,
};
use glam::Vec3;
use specula_core::lamps::{Lamp, RAYS};
use specula_io::latlong::{LatLong, MapOrientation};
use std::sync::Arc;

/// Light that replaces the light of a scene.
#[derive(Clone, Debug)]
pub struct Lighting {
    /// Environment map of radiance; `None` for no environment light.
    pub map: Option<LatLong>,
    /// Direction of the scene at the upper edge of the map.
    pub map_up: MapUp,
    /// Suns.
    pub suns: Vec<SunChoice>,
    /// Spherical lamps, which do not turn.
    pub spheres: Vec<SphereChoice>,
    /// Turn of map and suns about the up direction in degrees, counterclockwise seen from above.
    pub turn: f32,
    /// Shadow rays of each lamp and pixel.
    pub rays: usize,
    /// Ground that catches shadows.
    pub ground: Option<Arc<GroundPlane>>,
    /// Surface that casts shadows; `None` for none.
    pub occluder: Option<Arc<Surface>>,
}

impl Default for Lighting {
    fn default() -> Self {
        Self {
            map: None,
            map_up: MapUp::Scene,
            suns: Vec::new(),
            spheres: Vec::new(),
            turn: 0.0,
            rays: RAYS,
            ground: None,
            occluder: None,
        }
    }
}

impl Lighting {
    /// Whether there are suns or lamps.
    pub fn has_lamps(&self) -> bool {
        !self.suns.is_empty() || !self.spheres.is_empty()
    }

    /// Suns and lamps in a scene with this up direction.
    pub fn lamps(&self, up: Vec3) -> Vec<Lamp> {
        lamps_of(&self.suns, &self.spheres, up, self.turn)
    }

    /// Orientation of the map in a scene with this up direction.
    pub fn map_orientation(&self, up: Vec3) -> MapOrientation {
        turned(self.map_up.orientation(up), up, self.turn)
    }

    /// Applies the lighting to a scene with this up direction.
    ///
    /// # Errors
    ///
    /// [`SceneError::NoMaterials`] for lamps in a scene without physical materials.
    pub fn light(&self, scene: &mut Scene, up: Vec3) -> Result<(), SceneError> {
        if self.has_lamps() {
            let occluder = self.occluder.clone();
            scene.add_lamps(SceneLamps { lamps: self.lamps(up), rays: self.rays, occluder })?;
        }
        match &self.map {
            Some(map) => scene.relight(map, self.map_orientation(up)),
            None => scene.darken(),
        }
        Ok(())
    }

    /// Applies the lighting to a scene with an existing renderer, for instance after a turn.
    ///
    /// # Errors
    ///
    /// Those of [`Lighting::light`] and of the renderer.
    pub fn update(
        &self,
        scene: &mut Scene,
        renderer: &mut SceneRenderer,
        up: Vec3,
        options: &RenderOptions,
    ) -> Result<(), SceneError> {
        self.light(scene, up)?;
        // The visibility-weighted light of materials depends on the environment.
        options.storage.round(&mut scene.gaussians);
        renderer.set_scene(scene)
    }

    /// Backdrop with the ground, which catches shadows under the light of `scene`; without ground,
    /// the backdrop itself.
    pub fn grounded(&self, backdrop: Backdrop, scene: &Scene) -> Backdrop {
        match &self.ground {
            Some(plane) => {
                let ground = Ground::new(plane.clone(), scene.light.as_ref(), scene.lamps.as_ref());
                Backdrop::Ground(Box::new(backdrop), Arc::new(ground))
            }
            None => backdrop,
        }
    }
}
