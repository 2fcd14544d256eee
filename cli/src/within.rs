//! `--max-error`: the cheapest setting for an error, and the certificate that says so.

use crate::{
    background::Background,
    failure::Failure,
    progress::Talk,
    scene::{Renderer, into_subject},
};
use specula_accuracy::{
    budget::{Certificate, Refusal, cheapest_within},
    setting::{Difference, Setting},
    subject::Subject,
};
use specula_core::{camera::Camera, plan::Channels, shade::ShadingRules};
use specula_scene::{Scene, ShadingModel};

/// A scene that is rendered within an error, and the certificate of it.
pub(crate) fn renderer(
    scene: &Scene,
    cameras: Vec<Camera>,
    background: Background,
    channels: Channels,
    error: f64,
    talk: Talk,
) -> Result<(Renderer, String), Failure> {
    let subject = into_subject(scene.clone(), cameras, background.0);
    check(&subject)?;
    talk.note(&format!("looking for the cheapest setting within {error}"));
    let certificate = cheapest_within(&subject, error).map_err(|refusal| match refusal {
        Refusal::TooClose(least) => Failure::Input(format!(
            "an error of {error} cannot be kept, because f32 and the light's filter alone make {least:.1e}; use \
             --max-error {}",
            rounded_up(least)
        )),
        Refusal::Failed => {
            Failure::Input("the processor cannot render the scene; look at it without --max-error".into())
        }
    })?;
    let words = words(&certificate, &subject);
    Ok((Renderer::within(scene_of(&certificate.setting, &subject), &certificate.setting, channels)?, words))
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

/// The scene with its light and its reading as the setting has them.
fn scene_of(setting: &Setting, subject: &Subject) -> Scene {
    let Subject { gaussians, shading, .. } = subject.clone();
    let shading = ShadingRules { form: setting.form, ..shading };
    let shading_model = ShadingModel { shading, scheme: setting.scheme };
    Scene { gaussians, light: subject.light_at(setting.light), shading_model }
}

/// The next number with one digit.
fn rounded_up(number: f64) -> String {
    let digit = 10_f64.powf(number.log10().floor());
    format!("{:.0e}", (number / digit).ceil() * digit)
}

fn words(certificate: &Certificate, subject: &Subject) -> String {
    let Certificate { setting, asked, chosen_by, verified, tiles: [choosing, verifying], work: [own, usual] } =
        certificate;
    let difference = Difference(setting, &Setting::usual(subject)).to_string();
    let share = own.cost() / usual.cost();
    format!(
        "error {:.2e} (worst tile {:.2e}) on {verifying} tiles that it was not chosen by, where {asked:e} was allowed \
         ({:.1} dB, largest difference {:.1e}); {:.2e} (worst tile {:.2e}) on {choosing} that it was; {share:.2} of the \
         usual work; turned from the usual: {difference}",
        verified.rms, verified.worst, verified.psnr, verified.max, chosen_by.rms, chosen_by.worst
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_advised_can_be_kept() {
        assert_eq!([2.31e-4, 1e-3, 0.97].map(rounded_up), ["3e-4", "1e-3", "1e0"]);
    }
}
