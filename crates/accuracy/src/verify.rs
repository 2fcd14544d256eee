//! Pictures within an error, each compared with the most exact one in `f32`.

use crate::{
    budget::{Certificate, Refusal, apart, cheapest_within, root_mean_square},
    reference::{Exact, Reference},
    setting::Setting,
    subject::Subject,
    trial::{Taken, Trial},
};
use specula_core::{camera::Camera, rules::Channels, scene::Image};
use specula_cpu::CpuError;
use specula_train::evaluate::over_background;

/// Subject with pictures that are verified to be within an error.
#[derive(Debug)]
pub struct Verified {
    trial: Trial<'static>,
    chosen: Setting,
    exact: Setting,
    background: [f32; 3],
    /// Allowed distance from the most exact pictures.
    allowed: f64,
    /// True if pictures are compared.
    compares: bool,
    tally: Tally,
}

/// Outcome of the comparisons.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tally {
    /// Number of pictures.
    pub pictures: usize,
    /// Number of pictures beyond the error, which the most exact ones replaced.
    pub replaced: usize,
    /// Largest distance of the other pictures from the most exact ones.
    pub kept: f64,
    /// Largest distance of the replaced pictures.
    pub beyond: f64,
    /// Cost of the setting's pictures, and of all pictures rendered.
    pub cost: [f64; 2],
    /// Both costs in milliseconds.
    pub milliseconds: [f64; 2],
}

impl Verified {
    /// Prepares a subject under the setting of a certificate. Without comparisons every picture is
    /// the setting's.
    ///
    /// # Errors
    ///
    /// [`CpuError`] if the light cannot be filtered.
    pub fn new(
        subject: Subject,
        reference: &Reference,
        certificate: &Certificate,
        compares: bool,
    ) -> Result<Self, CpuError> {
        let (exact, background) = (Setting::exact(&subject), subject.background);
        let trial = Trial::under(subject, reference)?;
        let (chosen, allowed) = (certificate.setting, certificate.allowed());
        // The most exact setting needs no comparison.
        let compares = compares && chosen != exact;
        Ok(Self { trial, chosen, exact, background, allowed, compares, tally: Tally::default() })
    }

    /// Renders a view: channels, then transmittance. If the error is larger, the most exact
    /// picture, rendered for the comparison, replaces the setting's: a setting between the two
    /// would cost more and be less exact.
    ///
    /// # Errors
    ///
    /// [`CpuError`] if the view cannot be rendered.
    pub fn view(&mut self, camera: &Camera, channels: Channels) -> Result<Image<Vec<f32>>, CpuError> {
        let view = self.take(self.chosen, camera, channels, 0)?;
        self.tally.pictures += 1;
        if !self.compares {
            return Ok(view.image);
        }
        let exact = self.take(self.exact, camera, channels, 1)?;
        let apart = apart(&view.image, &over_background(&exact.image, self.background), self.background);
        if apart <= self.allowed {
            self.tally.kept = self.tally.kept.max(apart);
            return Ok(view.image);
        }
        self.tally.replaced += 1;
        self.tally.beyond = self.tally.beyond.max(apart);
        Ok(exact.image)
    }

    /// Outcome of the pictures so far.
    pub fn tally(&self) -> Tally {
        self.tally
    }

    /// Returns whether pictures are compared; the most exact setting needs no comparison.
    pub fn compares(&self) -> bool {
        self.compares
    }

    /// Returns whether the setting is the most exact one.
    pub fn is_exact(&self) -> bool {
        self.chosen == self.exact
    }

    fn take(&mut self, setting: Setting, camera: &Camera, channels: Channels, first: usize) -> Result<Taken, CpuError> {
        let taken = self.trial.view(&Setting { channels, ..setting }, camera)?;
        for k in first..2 {
            self.tally.cost[k] += taken.work.cost();
            self.tally.milliseconds[k] += taken.milliseconds();
        }
        Ok(taken)
    }
}

/// Errors of verified and of unverified pictures against exact ones, relative to the allowed error:
/// without and with verification.
///
/// # Errors
///
/// [`Refusal`] if there is no setting or the CPU executor fails.
pub fn shares(
    subject: &Subject,
    reference: &Reference,
    views: &[(Camera, Exact)],
    error: f64,
) -> Result<[Vec<f64>; 2], Refusal> {
    let certificate = cheapest_within(subject, reference, error)?;
    let of = |compares: bool| {
        let mut verified = Verified::new(subject.clone(), reference, &certificate, compares)?;
        let share = |(camera, exact): &(Camera, Exact)| {
            let shown = over_background(&verified.view(camera, Channels::Color)?, subject.background);
            let differences = shown.iter().zip(&exact.colors.values).map(|(value, exact)| f64::from(*value) - exact);
            Ok(root_mean_square(differences) / error)
        };
        views.iter().map(share).collect::<Result<Vec<_>, CpuError>>()
    };
    Ok([of(false)?, of(true)?])
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::{cutoffs::BlendOrder, prefilter::PrefilterScheme, shade::ShadingRules};
    use specula_oracle::stress::{StressScene, stress_scenes};

    fn subject(scene: StressScene) -> Subject {
        subject_in(BlendOrder::Mean, scene)
    }

    fn subject_in(order: BlendOrder, scene: StressScene) -> Subject {
        Subject {
            gaussians: scene.cloud,
            light: None,
            near_field: None,
            shading: ShadingRules::PAPER,
            scheme: PrefilterScheme::Exact,
            cameras: scene.cameras,
            background: scene.background,
            order,
        }
    }

    /// Numbers of an orbit's pictures within and beyond some errors, without and with verification.
    /// Ground truth is the independent renderer in this order.
    fn beyond(order: BlendOrder, scene: StressScene, errors: &[f64]) -> (usize, [usize; 2]) {
        let (name, subject) = (scene.name, subject_in(order, scene));
        let reference = Reference::new(&subject);
        let truth = |camera: &Camera| (*camera, reference.independent_view(&subject, camera));
        let views: Vec<_> = subject.cameras.iter().map(truth).collect();
        let mut counts = (0, [0; 2]);
        for error in errors {
            let shares = shares(&subject, &reference, &views, *error).expect("f32 is close enough");
            let worst = shares.each_ref().map(|shares| shares.iter().copied().fold(0.0, f64::max));
            println!("{name}: {error:e}: at most {:.3} of it unverified, {:.3} verified", worst[0], worst[1]);
            counts.0 += views.len();
            (0..2).for_each(|k| counts.1[k] += shares[k].iter().filter(|share| **share > 1.0).count());
        }
        counts
    }

    #[test]
    fn pictures_of_hidden_haze_and_of_wide_splats_are_within_their_error() {
        for scene in stress_scenes(2).into_iter().take(2) {
            let (pictures, [_, verified]) = beyond(BlendOrder::Mean, scene, &[1e-2]);
            assert_eq!((pictures, verified), (2, 0));
        }
    }

    #[test]
    fn pictures_with_an_order_for_each_pixel_are_within_their_error() {
        let scene = stress_scenes(2).swap_remove(1);
        let (pictures, [_, verified]) = beyond(BlendOrder::Pixel, scene, &[3e-2, 1e-2]);
        assert_eq!((pictures, verified), (4, 0));
    }

    /// Takes minutes:
    /// `cargo test --release -p specula-accuracy --lib every_stress -- --ignored --nocapture`.
    #[test]
    #[ignore = "takes minutes"]
    fn pictures_of_every_stress_scene_are_within_their_error() {
        let mut all = (0, [0; 2]);
        for scene in stress_scenes(16) {
            let (pictures, beyond) = beyond(BlendOrder::Mean, scene, &[1e-1, 3e-2, 1e-2, 3e-3, 1e-3]);
            all = (all.0 + pictures, [all.1[0] + beyond[0], all.1[1] + beyond[1]]);
        }
        println!("of {} pictures {} exceed the error unverified, {} verified", all.0, all.1[0], all.1[1]);
        assert!(all.0 >= 480 && all.1[1] == 0, "{all:?}");
    }

    #[test]
    fn a_picture_with_a_larger_error_is_replaced_by_the_most_exact_one() {
        let scene = stress_scenes(2).swap_remove(0);
        let camera = scene.cameras[0];
        let subject = subject(scene);
        let reference = Reference::new(&subject);
        let certificate = cheapest_within(&subject, &reference, 1e-2).expect("f32 is close enough");
        let [wrong, exact] = [Setting::default_for(&subject), Setting::exact(&subject)];
        let certificate = Certificate { setting: wrong, asked: 1e-4, ..certificate };
        let view = |certificate: Certificate, compares: bool| {
            let mut verified =
                Verified::new(subject.clone(), &reference, &certificate, compares).expect("there is no light");
            (verified.view(&camera, Channels::Color).expect("it renders"), verified.tally())
        };
        let (shown, tally) = view(certificate, true);
        let (most_exact, exact_tally) = view(Certificate { setting: exact, ..certificate }, true);
        assert_eq!(shown.values, most_exact.values, "the default setting omits the haze");
        assert_eq!((tally.pictures, tally.replaced, exact_tally.replaced), (1, 1, 0));
        assert!(tally.beyond > 1e-4 && tally.cost[1] > tally.cost[0], "{tally:?}");
        assert_eq!(exact_tally.cost[0], exact_tally.cost[1], "the most exact setting is not compared with itself");

        let (unverified, tally) = view(certificate, false);
        assert!(unverified.values != most_exact.values && tally.replaced == 0, "it is the picture of the setting");
    }
}
