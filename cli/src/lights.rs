//! Lights of `specula relight`: those of a file and of the command line, and a scene under them.

use crate::{
    args::{EnvChoice, FirstLights, LampOptions, Lights},
    failure::Failure,
    output,
    scene::{fuse_near_field, fusing, read_env, refuse_plain},
};
use core::{fmt::Display, str::FromStr};
use glam::Vec3;
use serde::Deserialize;
use specula_core::lamps::{Lamp, check};
use specula_io::budget::FACTS;
use specula_scene::{
    Lighting, OpenedModel, RenderOptions, Scene, SceneError, Shading, Surface,
    foreground::Foreground,
    ground::GroundPlane,
    lamps::{SphereChoice, SunChoice, direction, lamps_of, shadow_surface, share_in_shadow},
    light_file::{LightOptions, MapUp},
    picture_folder::light_differences,
};
use specula_viewer::{LightSetup, SetupEnvironment};
use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

/// Light that a scene is put under.
#[derive(Debug)]
pub(crate) struct LightPlan {
    /// File of the environment map; `None` for no environment light.
    env: Option<PathBuf>,
    options: LightOptions,
    /// Suns and lamps; [`LightPlan::shine`] adds the environment map, the occluder and the ground.
    lighting: Lighting,
    /// Ground, and its height if it is not that of the scene's lowest point.
    ground: Option<Option<f32>>,
}

/// Contents of a file of lights.
#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
struct LightFile {
    env: Option<String>,
    env_up: MapUp,
    exposure: f32,
    turn: f32,
    ground: bool,
    sun: Vec<String>,
    lamp: Vec<String>,
}

/// Lights of a file, if one is named, and the suns and lamps of the command line.
#[derive(Clone, Debug, Default)]
pub(crate) struct NamedLights {
    /// File of an environment map that the file of lights names.
    pub(crate) env: Option<PathBuf>,
    /// Up direction of that map.
    pub(crate) env_up: MapUp,
    /// Exposure in stops that the file of lights names.
    pub(crate) exposure: f32,
    /// Turn in degrees that the file of lights names.
    pub(crate) turn: f32,
    /// Whether the file of lights asks for ground.
    pub(crate) has_ground: bool,
    pub(crate) suns: Vec<SunChoice>,
    pub(crate) spheres: Vec<SphereChoice>,
}

impl NamedLights {
    /// Reads the file.
    ///
    /// # Errors
    ///
    /// A file that cannot be read or parsed.
    pub(crate) fn read(options: &LampOptions) -> Result<Self, Failure> {
        let file = options.lights.as_deref().map_or(Ok(LightFile::default()), read)?;
        let folder = options.lights.as_deref().and_then(Path::parent).unwrap_or(Path::new(""));
        let name = options.lights.clone().unwrap_or_default();
        let mut suns: Vec<SunChoice> = parsed(&file.sun, "sun", &name)?;
        let mut spheres: Vec<SphereChoice> = parsed(&file.lamp, "lamp", &name)?;
        suns.extend(&options.sun);
        spheres.extend(&options.lamp);
        let env = file.env.filter(|name| name != "none").map(|name| folder.join(name));
        let LightFile { env_up, exposure, turn, ground: has_ground, .. } = file;
        Ok(Self { env, env_up, exposure, turn, has_ground, suns, spheres })
    }

    /// First lights of a page of a scene.
    ///
    /// # Errors
    ///
    /// A file that cannot be read or parsed; lamps or ground on a scene without physical materials.
    pub(crate) fn first(options: &FirstLights, scene: &Scene) -> Result<Self, Failure> {
        let mut lights = Self::read(&options.lamps)?;
        lights.has_ground |= options.ground;
        if lights.has_lamps() || lights.has_ground {
            refuse_without_materials(scene)?;
        }
        Ok(lights)
    }

    /// Up direction of the environment map: that of the command line, unless it is the default.
    pub(crate) fn up(&self, asked: MapUp) -> MapUp {
        if asked == MapUp::Scene { self.env_up } else { asked }
    }

    /// Whether there are suns or lamps.
    fn has_lamps(&self) -> bool {
        !self.suns.is_empty() || !self.spheres.is_empty()
    }

    /// Suns and lamps in a scene with this up direction.
    pub(crate) fn lamps(&self, up: Vec3) -> Vec<Lamp> {
        lamps_of(&self.suns, &self.spheres, up, self.turn)
    }

    /// First light of a page: the environment map that the page has under this identifier, else
    /// none beside lamps or a file of lights, else that of the scene.
    pub(crate) fn setup(self, map: Option<u32>, options: &FirstLights) -> LightSetup {
        let environment = match map {
            Some(id) => SetupEnvironment::Added(id),
            None if options.lamps.lights.is_some() || self.has_lamps() => SetupEnvironment::None,
            None => SetupEnvironment::Scene,
        };
        let Self { turn, exposure, suns, spheres, has_ground, .. } = self;
        LightSetup { environment, turn, exposure, suns, spheres, has_ground }
    }
}

/// Rejects lamps on a scene without physical materials.
fn refuse_without_materials(scene: &Scene) -> Result<(), Failure> {
    if scene.gaussians.layout.is_physical {
        return Ok(());
    }
    refuse_plain(scene)?;
    Err(Failure::Input(format!(
        "{}, so suns and lamps cannot light it; train on its photographs with --relightable, or use only an environment map",
        SceneError::NoMaterials
    )))
}

impl LightPlan {
    /// Lights of a file, if one is named, and of the command line.
    ///
    /// # Errors
    ///
    /// A file that cannot be read or parsed; no light at all; lamps out of range.
    pub(crate) fn new(args: &Lights, options: LightOptions) -> Result<Self, Failure> {
        let named = NamedLights::read(&args.lamps)?;
        let up = named.up(options.up);
        let NamedLights { env: in_file, exposure, turn, suns, spheres, has_ground, .. } = named;
        let env = match &args.env {
            Some(EnvChoice::File(path)) => Some(path.clone()),
            Some(EnvChoice::None) => None,
            None => in_file,
        };
        if env.is_none() && suns.is_empty() && spheres.is_empty() {
            return Err(Failure::Input(
                "no light is given; add an environment map with --env, such as --env sunset, a sun with --sun 30,45, or a \
                 lamp with --lamp 1,0,2,5"
                    .into(),
            ));
        }
        let options = LightOptions { up, exposure: options.exposure + exposure };
        let turn = args.turn + turn;
        if !turn.is_finite() || !options.exposure.is_finite() {
            return Err(Failure::Input(
                "the sum of the turns or exposures of --lights and the command line is not finite".into(),
            ));
        }
        let ground = args.ground.or(has_ground.then_some(None));
        if ground.is_some() && suns.iter().any(|sun| sun.elevation < 0.0) {
            tracing::warn!("a sun is below the horizon; the ground catches shadows, but casts none on the scene");
        }
        let (map_up, rays) = (options.up, args.shadow_rays);
        let lighting = Lighting { map_up, suns, spheres, turn, rays, ..Lighting::default() };
        check(&lighting.lamps(Vec3::Z), rays).map_err(|fault| Failure::Input(fault.to_string()))?;
        Ok(Self { env, options, lighting, ground })
    }

    /// File of the environment map, if there is one.
    pub(crate) fn env(&self) -> Option<&Path> {
        self.env.as_deref()
    }

    /// Whether there is ground.
    pub(crate) const fn has_ground(&self) -> bool {
        self.ground.is_some()
    }

    /// Name of the light, for a folder: that of the environment map.
    pub(crate) fn name(&self) -> String {
        self.env.as_deref().map_or_else(|| "lamps".to_owned(), output::stem)
    }

    /// Parts of a folder's name, one for each change of the environment and each lamp.
    pub(crate) fn differences(&self) -> Vec<String> {
        let mut parts = light_differences(self.options);
        let Lighting { suns, spheres, turn, .. } = &self.lighting;
        parts.extend(suns.iter().map(|sun| format!("sun{sun}").replace(':', "-")));
        parts.extend(spheres.iter().map(|sphere| format!("lamp{sphere}").replace(':', "-")));
        parts.extend((*turn != 0.0).then(|| format!("turn{turn:+}")));
        parts.extend(self.ground.map(|height| height.map_or("ground".to_owned(), |height| format!("ground{height}"))));
        parts
    }

    /// Rejects view-dependent colours under lamps, which light only materials.
    ///
    /// # Errors
    ///
    /// View-dependent colours were requested.
    pub(crate) fn refuse_view_dependent(&self, shading: Option<Shading>) -> Result<(), Failure> {
        if self.lighting.has_lamps() && shading == Some(Shading::View) {
            return Err(Failure::Input("suns and lamps light only physical materials; omit --shading view".into()));
        }
        Ok(())
    }

    /// Puts a model under the light, which is returned.
    ///
    /// # Errors
    ///
    /// A map that cannot be read; lamps on a scene without physical materials; those of rendering.
    pub(crate) fn shine(
        &self,
        opened: &mut OpenedModel,
        up: Vec3,
        options: &RenderOptions,
    ) -> Result<Lighting, Failure> {
        refuse_plain(&opened.scene)?;
        let mut lighting = self.lighting.clone();
        if lighting.has_lamps() {
            refuse_without_materials(&opened.scene)?;
        }
        fuse_near_field(opened, options)?;
        lighting.map = self.env.as_deref().map(|path| read_env(path, self.options.exposure)).transpose()?;
        if lighting.has_lamps() || self.has_ground() {
            lighting.occluder = surface_of(opened, options)?;
        }
        if let Some(height) = self.ground {
            let surface = lighting.occluder.clone();
            lighting.ground = surface.and_then(|surface| GroundPlane::new(surface, up, height));
            if lighting.ground.is_none() {
                tracing::warn!("no ground is shown, since the scene has no surface that casts shadows");
            }
        }
        if lighting.map.is_none() {
            tracing::info!(
                "only suns and lamps shine, so shadows are black; --env sunset --exposure -2 adds a dim sky"
            );
        }
        if let Some(occluder) = &lighting.occluder {
            warn_of_hidden_suns(&lighting, occluder, opened, up)?;
        }
        lighting.light(&mut opened.scene, up)?;
        Ok(lighting)
    }
}

/// Warns of suns that the scene occludes, such as the walls of a room.
fn warn_of_hidden_suns(lighting: &Lighting, occluder: &Surface, opened: &OpenedModel, up: Vec3) -> Result<(), Failure> {
    /// Share in shadow above which a warning is printed.
    const MOST: f64 = 0.8;
    let Some(subject) = Foreground::Auto.ball(Some(&opened.orientation(None)?), opened.origin) else { return Ok(()) };
    let remedy = if opened.crop.is_none() { ", or --crop auto, which removes the surroundings" } else { "" };
    for sun in &lighting.suns {
        let to_sun = direction(sun.azimuth + lighting.turn, sun.elevation, up).as_vec3();
        if let Some(share) = share_in_shadow(occluder, to_sun, &subject).filter(|share| *share > MOST) {
            tracing::warn!(
                "--sun {sun}: the scene itself shadows {:.0} % of the subject; use another direction{remedy}",
                100.0 * share
            );
        }
    }
    Ok(())
}

/// Surface that casts shadows, with progress.
fn surface_of(opened: &OpenedModel, options: &RenderOptions) -> Result<Option<Arc<Surface>>, Failure> {
    let announce = |all| tracing::info!("fusing {all} views into the shadow-casting surface");
    let surface = fusing(announce, |progress| shadow_surface(opened, options, progress))?;
    if surface.is_none() {
        tracing::warn!("no view shows a surface, so there are no shadows and no ground");
    }
    Ok(surface)
}

/// Line and message of an error in TOML.
fn place_of(text: &[u8], error: &toml::de::Error) -> String {
    let message = error.message().trim().replace('\n', " ");
    let before = error.span().and_then(|span| text.get(..span.start));
    let line = |before: &[u8]| before.iter().filter(|byte| **byte == b'\n').count() + 1;
    before.map_or_else(|| message.clone(), |before| format!("line {}: {message}", line(before)))
}

/// Reads a file of lights.
fn read(path: &Path) -> Result<LightFile, Failure> {
    let wrong = |error: &dyn Display| Failure::Input(format!("{path:?} is not a file of lights: {error}"));
    let text = FACTS.read(path)?;
    let file: LightFile =
        toml::from_slice(&text).map_err(|error| wrong(&format!("{} (docs/rendering.md)", place_of(&text, &error))))?;
    if !file.exposure.is_finite() || !file.turn.is_finite() {
        return Err(wrong(&"exposure and turn must be finite numbers"));
    }
    Ok(file)
}

/// Parses the entries of a file.
fn parsed<T: FromStr<Err: Display>>(entries: &[String], key: &str, path: &Path) -> Result<Vec<T>, Failure> {
    let parse = |entry: &String| {
        entry.parse().map_err(|error| Failure::Input(format!("{path:?}: invalid {key} {entry:?}; {error}")))
    };
    entries.iter().map(parse).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::lamps::RAYS;
    use std::fs;

    fn lights(file: Option<&Path>, sun: &[&str]) -> Lights {
        Lights {
            env: None,
            lamps: LampOptions {
                sun: sun.iter().map(|text| text.parse().unwrap()).collect(),
                lamp: Vec::new(),
                lights: file.map(Path::to_owned),
            },
            turn: 10.0,
            turn_light: None,
            shadow_rays: RAYS,
            ground: None,
        }
    }

    #[test]
    fn a_file_of_lights_has_the_meaning_of_the_options_and_options_are_added() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("evening.toml");
        let text = "env = \"sky.hdr\"\nexposure = -1\nturn = 20\nsun = [\"30,45\", \"0,10,1:ff8800\"]\nlamp = [\"1,0,2,5,0.1\"]\n";
        fs::write(&path, text).unwrap();
        let plan = LightPlan::new(
            &lights(Some(&path), &["90,80,2"]),
            LightOptions { exposure: 0.5, ..LightOptions::default() },
        );
        let plan = plan.unwrap();
        assert_eq!(plan.env, Some(folder.path().join("sky.hdr")));
        assert_eq!(
            (plan.options.exposure, plan.lighting.turn, plan.lighting.suns.len(), plan.lighting.spheres.len()),
            (-0.5, 30.0, 3, 1)
        );
        assert_eq!(plan.lighting.lamps(Vec3::Z).len(), 4);
        assert_eq!(plan.name(), "sky");

        let dark = Lights { env: Some(EnvChoice::None), ..lights(Some(&path), &[]) };
        assert_eq!(LightPlan::new(&dark, LightOptions::default()).unwrap().name(), "lamps");
        for wrong in ["suns = []", "sun = [\"30\"]", "sun = 3", "exposure = nan", "env = ["] {
            fs::write(&path, wrong).unwrap();
            let refused = LightPlan::new(&lights(Some(&path), &[]), LightOptions::default()).unwrap_err().to_string();
            assert!(refused.contains("evening.toml"), "{wrong}: {refused}");
        }
    }

    #[test]
    fn no_light_at_all_is_an_error_with_remedies() {
        let refused = LightPlan::new(&lights(None, &[]), LightOptions::default()).unwrap_err().to_string();
        assert!(refused.contains("--env") && refused.contains("--sun") && refused.contains("--lamp"), "{refused}");
        assert!(LightPlan::new(&lights(None, &["0,30"]), LightOptions::default()).is_ok());
    }
}
