//! Scenes rendered within an error: the cheapest setting, its certificate, and pictures that are
//! verified one by one.

use specula_accuracy::{
    budget::{Bounds, Certificate, Refusal, cheapest_within},
    reference::Reference,
    setting::{Difference, Setting},
    subject::Subject,
    verify::{Tally, Verified},
};
use specula_core::{
    camera::Camera,
    cutoffs::BlendOrder,
    near_field::NearField,
    rules::{Channels, RenderRules},
    scene::{Environment, Image},
};
use specula_scene::{
    RenderBackend, Scene, SceneError, SceneRenderer, ShadingModel, environment::fitting, lamps::SceneLamps,
};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Reason why an error cannot be certified.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum CertificateError {
    /// Shading of the authors' code, which has no exact pictures.
    #[error("no error can be guaranteed without exact pictures: the official shading is defined by code")]
    NoReference,
    /// Rounding to `f32` may already exceed the error.
    #[error("an error of {asked} cannot be guaranteed, because rounding to f32 may cause {rounding:.1e}")]
    Rounding {
        /// Requested error.
        asked: f64,
        /// Error by rounding, at most.
        rounding: f64,
    },
    /// Numbers in the most exact pictures that are not finite.
    #[error(
        "an error of {asked} cannot be guaranteed, because the scene's most exact pictures have numbers that are not \
         finite"
    )]
    NotFinite {
        /// Requested error.
        asked: f64,
    },
    /// Scene that the CPU executor cannot render.
    #[error("the CPU cannot render the scene")]
    Failed,
}

impl CertificateError {
    fn new(refusal: Refusal, asked: f64) -> Self {
        match refusal {
            Refusal::TooClose(rounding) if rounding.is_finite() => Self::Rounding { asked, rounding },
            Refusal::TooClose(_) => Self::NotFinite { asked },
            Refusal::Failed => Self::Failed,
        }
    }

    /// Achievable error with one digit, instead of one below the rounding, as text.
    pub fn error_min(&self) -> Option<String> {
        match self {
            Self::Rounding { rounding, .. } => Some(rounded_up(*rounding)),
            _ => None,
        }
    }
}

/// Scene, cameras and background as the subject of measurements, with splats in the order of means.
pub fn subject_of(scene: Scene, cameras: Vec<Camera>, background: [f32; 3]) -> Subject {
    let Scene { gaussians, light, near_field, shading_model, .. } = scene;
    let ShadingModel { shading, scheme, .. } = shading_model;
    let near_field = near_field.filter(|_| shading_model.traces_near());
    let near_field = near_field.map(|surface| Arc::new(NearField::clone(&surface)));
    let light = light.filter(|_| gaussians.layout.is_shaded()).map(|light| fitting(&light, scheme));
    Subject { gaussians, light, near_field, shading, scheme, cameras, background, order: BlendOrder::Mean }
}

/// Scene rendered with a setting whose error is certified.
#[derive(Clone, Debug)]
pub struct CertifiedScene {
    verified: Arc<Mutex<Verified>>,
    certificate: String,
    asked: f64,
}

impl CertifiedScene {
    /// Searches the cheapest setting whose pictures, over a background in sRGB, are within an
    /// error: the root mean square of sRGB colours in \[0, 1\]. Exact pictures have their splats in
    /// `order`; those of the setting may be in a coarser one. With `is_verified`, each picture is
    /// compared with the most exact one, which replaces it if the error is larger.
    ///
    /// # Errors
    ///
    /// [`CertificateError`]: a scene or an error without a certificate.
    pub fn new(
        scene: &Scene,
        cameras: Vec<Camera>,
        background: [f32; 3],
        order: BlendOrder,
        error: f64,
        is_verified: bool,
    ) -> Result<Self, CertificateError> {
        let subject = Subject { order, ..subject_of(scene.clone(), cameras, background) };
        if !subject.has_reference() {
            return Err(CertificateError::NoReference);
        }
        tracing::info!("searching the cheapest setting within {error}");
        let reference = Reference::new(&subject);
        let certificate =
            cheapest_within(&subject, &reference, error).map_err(|refusal| CertificateError::new(refusal, error))?;
        let text = certificate_text(&certificate, &subject);
        let verified =
            Verified::new(subject, &reference, &certificate, is_verified).map_err(|_| CertificateError::Failed)?;
        Ok(Self { verified: Arc::new(Mutex::new(verified)), certificate: text, asked: error })
    }

    /// Certificate of the setting: a sentence.
    pub fn certificate(&self) -> &str {
        &self.certificate
    }

    /// Renderer of the pictures of `scene`.
    pub fn renderer(&self, scene: &Scene, channels: Channels) -> SceneRenderer {
        SceneRenderer::with_backend(Box::new(self.clone()), scene, channels)
    }

    /// Sentence on the verification of the rendered pictures; its time is logged.
    pub fn report(&self) -> String {
        let verified = self.verified();
        let tally = verified.tally();
        if verified.compares() {
            let [rendering, all] = tally.milliseconds.map(|time| 1e-3 * time);
            tracing::info!("pictures took {all:.1} s, including {:.1} s for verification", all - rendering);
        }
        report_text(&tally, verified.compares(), verified.is_exact(), self.asked)
    }

    fn verified(&self) -> MutexGuard<'_, Verified> {
        self.verified.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Backend of one scene under one light, for which the certificate holds.
impl RenderBackend for CertifiedScene {
    fn render(&mut self, _: usize, camera: &Camera, rules: &RenderRules) -> Result<Image<Vec<f32>>, SceneError> {
        Ok(self.verified().view(camera, rules.channels)?)
    }

    fn set_light(&mut self, _: usize, _: &Environment<Vec<f32>>, _: &RenderRules) -> Result<(), SceneError> {
        Err(SceneError::Immutable)
    }

    fn add_lamps(&mut self, _: usize, _: &SceneLamps) -> Result<(), SceneError> {
        Err(SceneError::Immutable)
    }

    fn set_scene(&mut self, _: &Scene) -> Result<(), SceneError> {
        Err(SceneError::Immutable)
    }
}

/// Smallest number with one digit that is not below a number.
fn rounded_up(number: f64) -> String {
    let digit = 10_f64.powf(number.log10().floor());
    format!("{:.0e}", (number / digit).ceil() * digit)
}

fn certificate_text(certificate: &Certificate, subject: &Subject) -> String {
    let Certificate { setting, asked, rounding, chosen_by, tried_on, work: [chosen, default, _] } = certificate;
    let default_setting = Setting::default_for(subject);
    let difference = match *setting == default_setting {
        true => "nothing".to_owned(),
        false => Difference(setting, &default_setting).to_string(),
    };
    let share = chosen.cost() / default.cost();
    let views = |bounds: &Bounds| format!("{} view{}", bounds.views, if bounds.views == 1 { "" } else { "s" });
    let others = match tried_on.views {
        0 => String::new(),
        _ => format!("; {:.2e} (worst {:.2e}) on {} other views", tried_on.rms, tried_on.worst, views(tried_on)),
    };
    format!(
        "error {:.2e} (worst view {:.2e}) on {} that it was chosen by, where {asked:e} was allowed{others}; {rounding:.0e} of \
         that for rounding; {share:.2} of the default work; changed from the default: {difference}",
        chosen_by.rms,
        chosen_by.worst,
        views(chosen_by)
    )
}

fn report_text(tally: &Tally, compares: bool, is_exact: bool, asked: f64) -> String {
    let Tally { pictures, replaced, kept, beyond, cost: [rendering, all], .. } = tally;
    if is_exact {
        return "every picture is the most exact one".into();
    }
    if !compares {
        return format!("not verified: of {pictures} pictures, those of other views may have errors above {asked:e}");
    }
    let others = match replaced {
        0 => String::new(),
        _ => format!("; {replaced} had errors up to {beyond:.2e} and were replaced by the most exact ones"),
    };
    format!(
        "verified {pictures} pictures: errors are at most {asked:e}, those of this setting {kept:.2e} against the most \
         exact ones{others}; {:.2} times the work of unverified pictures",
        all / rendering
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_accuracy::verify::shares;
    use specula_scene::OpenedModel;
    use std::{env, path::Path};

    /// Models are named by `MODELS`, with colons: `MODELS=a:b cargo test --release -p
    /// specula-report --lib pictures_of_models -- --ignored --nocapture`. Ground truth is the
    /// independent renderer.
    #[test]
    #[ignore = "takes minutes, and models"]
    fn pictures_of_models_are_within_their_error() {
        const VIEWS: usize = 6;
        let models = env::var("MODELS").expect("MODELS names folders of models");
        for model in models.split(':') {
            let opened = OpenedModel::open(Path::new(model)).expect("a model");
            let cameras = opened.evaluation_cameras().expect("the model has cameras");
            let cameras: Vec<Camera> = (0..VIEWS).map(|k| cameras[k * cameras.len() / VIEWS].1).collect();
            let background = opened.background();
            let subject = subject_of(opened.scene, cameras, background);
            let reference = Reference::new(&subject);
            let truth = |camera: &Camera| (*camera, reference.independent_view(&subject, camera));
            let views: Vec<_> = subject.cameras.iter().map(truth).collect();
            for error in [1e-1, 3e-2, 1e-2, 3e-3, 1e-3] {
                let shares = shares(&subject, &reference, &views, error).expect("f32 is close enough");
                let [unverified, verified] = shares.map(|shares| shares.into_iter().fold(0.0, f64::max));
                println!("{model}: {error:e}: at most {unverified:.3} of it unverified, {verified:.3} verified");
                assert!(verified <= 1.0, "{model}: {error:e}");
            }
        }
    }

    #[test]
    fn advised_errors_can_be_guaranteed() {
        assert_eq!([2.31e-4, 1e-3, 0.97].map(rounded_up), ["3e-4", "1e-3", "1e0"]);
        let refused = CertificateError::new(Refusal::TooClose(2.31e-4), 1e-4);
        assert_eq!(refused.error_min().as_deref(), Some("3e-4"));
    }

    #[test]
    fn the_report_counts_replaced_pictures() {
        let tally = Tally { pictures: 9, replaced: 2, kept: 8e-3, beyond: 2e-2, cost: [1.0, 3.5], ..Tally::default() };
        let said = report_text(&tally, true, false, 1e-2);
        assert!(said.starts_with("verified 9 pictures: errors are at most 1e-2"), "{said}");
        assert!(
            said.contains("2 had errors up to 2.00e-2") && said.ends_with("3.50 times the work of unverified pictures"),
            "{said}"
        );
        assert!(report_text(&tally, false, false, 1e-2).starts_with("not verified"), "nothing is promised");
    }
}
