//! First light of the page.

use crate::{
    ViewerError,
    lights::id_json,
    request::{DARKNESS, LampSetting, LightId, LightSetting, entries},
};
use core::fmt::Display;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use specula_core::lamps::RAYS;
use specula_scene::{
    SceneError,
    lamps::{SphereChoice, SunChoice},
};

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
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(into = "SetupParameters", try_from = "SetupParameters")]
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

/// Setup in the notation of requests.
#[derive(Serialize, Deserialize)]
struct SetupParameters {
    light: Value,
    turn: f32,
    stops: f32,
    suns: String,
    lamps: String,
    ground: bool,
}

impl From<LightSetup> for SetupParameters {
    fn from(setup: LightSetup) -> Self {
        Self {
            light: id_json(setup.id()),
            turn: setup.turn,
            stops: setup.exposure,
            suns: listed(&setup.suns),
            lamps: listed(&setup.spheres),
            ground: setup.has_ground,
        }
    }
}

impl TryFrom<SetupParameters> for LightSetup {
    type Error = String;

    fn try_from(parameters: SetupParameters) -> Result<Self, String> {
        let SetupParameters { light, turn, stops: exposure, suns, lamps, ground: has_ground } = parameters;
        let text = light.as_str().map_or_else(|| light.to_string(), str::to_owned);
        let environment = match LightId::try_from(text)? {
            LightId(0) => SetupEnvironment::Scene,
            LightId(DARKNESS) => SetupEnvironment::None,
            LightId(id) => SetupEnvironment::Added(id),
        };
        let (suns, spheres) = (entries(&suns, "suns")?, entries(&lamps, "lamps")?);
        Ok(Self { environment, turn, exposure, suns, spheres, has_ground })
    }
}

impl LightSetup {
    /// Rejects values that requests may not contain, and lamps on a scene without materials.
    ///
    /// # Errors
    ///
    /// [`ViewerError::Request`] with the valid range; [`SceneError::NoMaterials`].
    pub(crate) fn check(&self, is_physical: bool) -> Result<(), ViewerError> {
        let needs_materials = self.has_ground || !self.suns.is_empty() || !self.spheres.is_empty();
        if needs_materials && !is_physical {
            return Err(SceneError::NoMaterials.into());
        }
        self.settings().map(drop).map_err(ViewerError::Request)
    }

    /// Light and lamps of pictures under this setup.
    ///
    /// # Errors
    ///
    /// A sentence with the valid range.
    pub(crate) fn settings(&self) -> Result<(LightSetting, LampSetting), String> {
        let lamps = LampSetting::new(self.suns.clone(), self.spheres.clone(), RAYS)?;
        Ok((LightSetting::new(self.id(), self.turn, self.exposure)?, lamps))
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
        json!(self)
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
        assert!(setup.check(true).is_ok());
        assert!(setup.check(false).unwrap_err().to_string().contains("physical materials"));
        assert_eq!(serde_json::from_value::<LightSetup>(json).unwrap(), setup);
    }

    #[test]
    fn a_setup_that_is_invalid_in_requests_is_rejected() {
        let nine = LightSetup { suns: vec!["0,45".parse().unwrap(); 9], ..LightSetup::default() };
        let dazzling = LightSetup { exposure: 40.0, ..LightSetup::default() };
        for (setup, word) in [(nine, "at most 8"), (dazzling, "stops")] {
            let refused = setup.check(true).unwrap_err().to_string();
            assert!(refused.contains(word), "{refused}");
        }
    }
}
