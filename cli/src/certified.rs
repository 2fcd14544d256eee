//! `--max-error`: the cheapest setting for an error, its certificate, and pictures that are
//! verified one by one.

use crate::{failure::Failure, scene::into_subject};
use specula_accuracy::{
    budget::{Bounds, Certificate, Refusal, cheapest_within},
    reference::Reference,
    setting::{Difference, Setting},
    subject::Subject,
    verify::{Tally, Verified},
};
use specula_core::{
    camera::Camera,
    rules::{Channels, RenderRules},
    scene::{Environment, Gaussians, Image},
};
use specula_scene::{RenderBackend, Scene, SceneError, SceneRenderer, backdrop::BackgroundColor};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Scene rendered with a setting whose error is certified.
#[derive(Clone, Debug)]
pub(crate) struct CertifiedScene {
    verified: Arc<Mutex<Verified>>,
    certificate: String,
    asked: f64,
}

/// Searches the cheapest setting within an error. With `is_verified`, each picture is compared with
/// the most exact one.
pub(crate) fn certify(
    scene: &Scene,
    cameras: Vec<Camera>,
    background: BackgroundColor,
    error: f64,
    is_verified: bool,
) -> Result<CertifiedScene, Failure> {
    let subject = into_subject(scene.clone(), cameras, background.0);
    check(&subject)?;
    tracing::info!("looking for the cheapest setting within {error}");
    let reference = Reference::new(&subject);
    let certificate = cheapest_within(&subject, &reference, error).map_err(|refusal| refused(refusal, error))?;
    let words = words(&certificate, &subject);
    let verified =
        Verified::new(subject, &reference, &certificate, is_verified).map_err(|_| refused(Refusal::Failed, error))?;
    Ok(CertifiedScene { verified: Arc::new(Mutex::new(verified)), certificate: words, asked: error })
}

impl CertifiedScene {
    /// Certificate of the setting.
    pub(crate) fn certificate(&self) -> &str {
        &self.certificate
    }

    /// Renderer of its pictures, which are those of `scene`.
    pub(crate) fn renderer(&self, scene: &Scene, channels: Channels) -> SceneRenderer {
        SceneRenderer::with_backend(Box::new(self.clone()), scene, channels)
    }

    /// Outcome of verifying the pictures that were rendered; the time it took is a note.
    pub(crate) fn report(&self) -> String {
        let verified = self.verified();
        let tally = verified.tally();
        if verified.compares() {
            let [own, all] = tally.milliseconds.map(|time| 1e-3 * time);
            tracing::info!("pictures took {all:.1} s, {:.1} s of which to verify them", all - own);
        }
        report(&tally, verified.compares(), verified.is_exact(), self.asked)
    }

    fn verified(&self) -> MutexGuard<'_, Verified> {
        self.verified.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The certificate holds for one scene under one light.
impl RenderBackend for CertifiedScene {
    fn render(&mut self, _: usize, camera: &Camera, rules: &RenderRules) -> Result<Image<Vec<f32>>, SceneError> {
        Ok(self.verified().view(camera, rules.channels)?)
    }

    fn set_light(&mut self, _: usize, _: &Environment<Vec<f32>>, _: &RenderRules) -> Result<(), SceneError> {
        Err(SceneError::Immutable)
    }

    fn set_gaussians(&mut self, _: &Gaussians<Vec<f32>>) -> Result<(), SceneError> {
        Err(SceneError::Immutable)
    }
}

/// Refuses what has no exact pictures.
fn check(subject: &Subject) -> Result<(), Failure> {
    if subject.has_reference() {
        return Ok(());
    }
    Err(Failure::Input(
        "an error cannot be kept where there are no exact pictures: the authors' shading is what their code does; leave \
         --max-error out"
            .into(),
    ))
}

fn refused(refusal: Refusal, error: f64) -> Failure {
    Failure::Input(match refusal {
        Refusal::TooClose(least) if least.is_finite() => format!(
            "an error of {error} cannot be kept, because rounding to f32 alone may make {least:.1e}; use --max-error {}",
            rounded_up(least)
        ),
        Refusal::TooClose(_) => format!(
            "an error of {error} cannot be kept, because the scene's most exact pictures hold numbers that are not \
             finite; specula info finds them, or render without --max-error"
        ),
        Refusal::Failed => "the processor cannot render the scene; look at it without --max-error".into(),
    })
}

/// The next number with one digit.
fn rounded_up(number: f64) -> String {
    let digit = 10_f64.powf(number.log10().floor());
    format!("{:.0e}", (number / digit).ceil() * digit)
}

fn words(certificate: &Certificate, subject: &Subject) -> String {
    let Certificate { setting, asked, rounding, chosen_by, tried_on, work: [own, usual, _] } = certificate;
    let difference = Difference(setting, &Setting::default_for(subject)).to_string();
    let share = own.cost() / usual.cost();
    let views = |bounds: &Bounds| format!("{} view{}", bounds.views, if bounds.views == 1 { "" } else { "s" });
    let others = match tried_on.views {
        0 => String::new(),
        _ => format!("; {:.2e} (worst {:.2e}) on {} that it was not", tried_on.rms, tried_on.worst, views(tried_on)),
    };
    format!(
        "error {:.2e} (worst view {:.2e}) on {} that it was chosen by, where {asked:e} was allowed{others}; {rounding:.0e} of \
         that for rounding; {share:.2} of the usual work; changed from the default: {difference}",
        chosen_by.rms,
        chosen_by.worst,
        views(chosen_by)
    )
}

fn report(tally: &Tally, compares: bool, is_exact: bool, asked: f64) -> String {
    let Tally { pictures, replaced, kept, beyond, cost: [own, all], .. } = tally;
    if is_exact {
        return "every picture is the most exact one".into();
    }
    if !compares {
        return format!("not verified: of {pictures} pictures, those of other views may be further off than {asked:e}");
    }
    let others = match replaced {
        0 => String::new(),
        _ => format!("; {replaced} were up to {beyond:.2e} off and are the most exact ones instead"),
    };
    format!(
        "verified {pictures} pictures: none is further off than {asked:e}, those of this setting {kept:.2e} from the most \
         exact ones{others}; {:.2} times the work of --no-verify",
        all / own
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{self, background_of};
    use specula_accuracy::verify::shares;
    use std::{env, path::Path};

    /// Models are named by `MODELS`, with colons: `MODELS=a:b cargo test --release -p specula --bin
    /// specula pictures_of_models -- --ignored --nocapture`. Truth is the independent renderer.
    #[test]
    #[ignore = "takes minutes, and models"]
    fn pictures_of_models_are_within_their_error() {
        const VIEWS: usize = 6;
        let models = env::var("MODELS").expect("MODELS names folders of models");
        for model in models.split(':') {
            let opened = scene::open(Path::new(model), None).expect("a model");
            let cameras = opened.evaluation_cameras().expect("the model has cameras");
            let cameras: Vec<Camera> = (0..VIEWS).map(|k| cameras[k * cameras.len() / VIEWS].1).collect();
            let background = background_of(&opened, None).0;
            let subject = into_subject(opened.scene, cameras, background);
            let reference = Reference::new(&subject);
            let truth = |camera: &Camera| (*camera, reference.independent_view(&subject, camera));
            let views: Vec<_> = subject.cameras.iter().map(truth).collect();
            for error in [1e-1, 3e-2, 1e-2, 3e-3, 1e-3] {
                let shares = shares(&subject, &reference, &views, error).expect("f32 is close enough");
                let [alone, verified] = shares.map(|shares| shares.into_iter().fold(0.0, f64::max));
                println!("{model}: {error:e}: at most {alone:.3} of it unverified, {verified:.3} verified");
                assert!(verified <= 1.0, "{model}: {error:e}");
            }
        }
    }

    #[test]
    fn what_is_advised_can_be_kept() {
        assert_eq!([2.31e-4, 1e-3, 0.97].map(rounded_up), ["3e-4", "1e-3", "1e0"]);
    }

    #[test]
    fn pictures_that_were_replaced_are_told() {
        let tally = Tally { pictures: 9, replaced: 2, kept: 8e-3, beyond: 2e-2, cost: [1.0, 3.5], ..Tally::default() };
        let said = report(&tally, true, false, 1e-2);
        assert!(said.starts_with("verified 9 pictures: none is further off than 1e-2"), "{said}");
        assert!(
            said.contains("2 were up to 2.00e-2 off") && said.ends_with("3.50 times the work of --no-verify"),
            "{said}"
        );
        assert!(report(&tally, false, false, 1e-2).starts_with("not verified"), "nothing is promised");
    }
}
