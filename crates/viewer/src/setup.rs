//! First light of the page.

use crate::{
    ViewerError,
    lights::id_json,
    request::{DARKNESS, LampSetting, LightSetting},
};
use core::fmt::Display;
use serde_json::{Value, json};
use specula_core::lamps::RAYS;
use specula_scene::lamps::{SphereChoice, SunChoice};

/// Environment map of a [`LightSetup`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SetupEnvironment {
    /// Light of the training.
    #[default]
    Scene,
    /// No light.
    None,
    /// Light with this identifier ([`Viewer::add_light`](crate::Viewer::add_light)).
    Added(u32),
}

/// First light of the page: environment, suns and lamps.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LightSetup {
    /// Environment map.
    pub environment: SetupEnvironment,
    /// Turn of the environment and the suns about the scene's up direction, in degrees.
    pub turn: f32,
    /// Exposure of the environment in stops; 1 doubles the radiance.
    pub exposure: f32,
    /// Suns.
    pub suns: Vec<SunChoice>,
    /// Lamps.
    pub spheres: Vec<SphereChoice>,
    /// True if ground catches the scene's shadows.
    pub has_ground: bool,
}

impl LightSetup {
    /// Rejects values that requests may not contain.
    ///
    /// # Errors
    ///
    /// [`ViewerError::Request`] with the valid range.
    pub(crate) fn check(&self) -> Result<(), ViewerError> {
        let lamps = LampSetting::new(self.suns.clone(), self.spheres.clone(), RAYS).map(drop);
        let light = LightSetting::new(self.id(), self.turn, self.exposure).map(drop);
        lamps.and(light).map_err(ViewerError::Request)
    }

    /// Whether there are suns or lamps.
    pub(crate) fn has_lamps(&self) -> bool {
        !self.suns.is_empty() || !self.spheres.is_empty()
    }

    const fn id(&self) -> u32 {
        match self.environment {
            SetupEnvironment::Scene => 0,
            SetupEnvironment::None => DARKNESS,
            SetupEnvironment::Added(id) => id,
        }
    }

    /// Parameters of requests, for the page.
    pub(crate) fn json(&self) -> Value {
        json!({
            "light": id_json(self.id()),
            "turn": self.turn,
            "stops": self.exposure,
            "suns": listed(&self.suns),
            "lamps": listed(&self.spheres),
            "ground": self.has_ground,
        })
    }
}

/// Entries separated by semicolons.
fn listed(entries: &[impl Display]) -> String {
    entries.iter().map(ToString::to_string).collect::<Vec<_>>().join(";")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_setup_has_the_notation_of_requests() {
        assert_eq!(
            LightSetup::default().json(),
            json!({"light": 0, "turn": 0.0, "stops": 0.0, "suns": "", "lamps": "", "ground": false})
        );
        let setup = LightSetup {
            environment: SetupEnvironment::None,
            turn: 20.0,
            exposure: -1.0,
            suns: ["30,45", "0,10,1:ff8800"].map(|text| text.parse().unwrap()).into(),
            spheres: vec!["1,0,2,5,0.5".parse().unwrap()],
            has_ground: true,
        };
        let json = setup.json();
        assert_eq!((&json["light"], &json["lamps"]), (&json!("none"), &json!("1,0,2,5,0.5")));
        assert_eq!(json["ground"], json!(true));
        assert_eq!(json["suns"], json!("30,45,3,0.53;0,10,1,0.53:ff8800"));
        assert!(setup.check().is_ok());
    }

    #[test]
    fn a_setup_that_is_invalid_in_requests_is_rejected() {
        let nine = LightSetup { suns: vec!["0,45".parse().unwrap(); 9], ..LightSetup::default() };
        let dazzling = LightSetup { exposure: 40.0, ..LightSetup::default() };
        for (setup, word) in [(nine, "at most 8"), (dazzling, "stops")] {
            let refused = setup.check().unwrap_err().to_string();
            assert!(refused.contains(word), "{refused}");
        }
    }
}
