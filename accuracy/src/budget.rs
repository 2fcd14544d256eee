//! The cheapest setting for an error: chosen by some views, verified on others.
//!
//! Each knob is turned alone, all others at their most exact; then all at once, each to its cheapest value whose own
//! error is within a bound. The bound begins at the whole error, because errors of different knobs seldom add up, and
//! falls until the setting holds, on the views that it was chosen by and on those that it was not. What is cheap is told
//! by counts of the work, so that the choice is the same on every machine and in every run.

use crate::{
    error::{Errors, Sums},
    reference::{Exact, Reference},
    setting::{KNOBS, Knob, Setting, Tried, is_possible, together},
    subject::Subject,
    trial::{Trial, Work, measured},
};
use rayon::prelude::*;
use specula_core::camera::Camera;
use specula_cpu::CpuError;

/// A bound is this share of the one before.
const TIGHTER: f64 = 0.7;
/// So many bounds are tried.
const BOUNDS: usize = 16;
/// Knobs that do not change what a picture costs here, or not its colours.
const LEFT_ALONE: [&str; 2] = ["storage", "channels"];

/// What was chosen, and by what right.
#[derive(Clone, Copy, Debug)]
pub struct Certificate {
    /// The setting.
    pub setting: Setting,
    /// The error that was asked for: root of the mean square of sRGB colours in [0, 1].
    pub asked: f64,
    /// On the views that it was chosen by.
    pub chosen_by: Errors,
    /// On views that it was not chosen by.
    pub verified: Errors,
    /// How many views each of the two are.
    pub views: [usize; 2],
    /// Work of the verified views, and under the usual setting.
    pub work: [Work; 2],
}

/// Why there is no setting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Refusal {
    /// Even the most exact setting is this far off.
    TooClose(f64),
    /// The processor could not render.
    Failed,
}

/// Exact views of some cameras.
pub fn exact_views(reference: &Reference, subject: &Subject, cameras: &[Camera]) -> Vec<Exact> {
    cameras.par_iter().map(|camera| reference.view(subject, camera)).collect()
}

/// Errors of a setting in some views, and the work of its pictures.
pub fn errors_of(
    trial: &mut Trial<'_>,
    subject: &Subject,
    setting: &Setting,
    views: &[(Camera, Exact)],
) -> Result<(Errors, Work), CpuError> {
    let (mut sums, mut work) = (Sums::default(), Work::default());
    for (camera, exact) in views {
        work = work.and(&trial.view(setting, camera)?.work);
        sums.add(&trial.view(&measured(setting), camera)?.image, exact, subject.background);
    }
    Ok((sums.errors(), work))
}

/// The cheapest setting whose error is at most `error` in both halves of the subject's views: the first of every two is
/// what it is chosen by, the second what it is verified on. A single view is both.
pub fn cheapest_within(subject: &Subject, error: f64) -> Result<Certificate, Refusal> {
    let reference = Reference::new(subject);
    let exact = exact_views(&reference, subject, &subject.cameras);
    let views: Vec<(Camera, Exact)> = subject.cameras.iter().copied().zip(exact).collect();
    let pick = |parity: usize| views.iter().skip(parity).step_by(2).cloned().collect::<Vec<_>>();
    let chosen_by = pick(0);
    let held_out = if views.len() > 1 { pick(1) } else { pick(0) };
    let mut search = Search { subject, trial: Trial::new(subject), error, chosen_by, held_out };
    search.run()
}

struct Search<'a> {
    subject: &'a Subject,
    trial: Trial<'a>,
    error: f64,
    chosen_by: Vec<(Camera, Exact)>,
    held_out: Vec<(Camera, Exact)>,
}

impl Search<'_> {
    fn run(&mut self) -> Result<Certificate, Refusal> {
        let exact = Setting::exact(self.subject);
        let of_knobs = self.turn_each(&exact)?;
        let mut bound = self.error;
        for _ in 0..BOUNDS {
            let setting = together(&exact, &of_knobs, bound);
            if let Some(certificate) = self.certify(if is_possible(&setting) { &setting } else { &exact })? {
                return Ok(certificate);
            }
            bound *= TIGHTER;
        }
        let (errors, _) = self.measure(&exact, false)?;
        match self.certify(&exact)? {
            Some(certificate) => Ok(certificate),
            None => Err(Refusal::TooClose(errors.rms)),
        }
    }

    fn turn_each(&mut self, exact: &Setting) -> Result<Vec<(Knob, Vec<Tried>)>, Refusal> {
        let mut of_knobs = Vec::new();
        for knob in KNOBS.into_iter().filter(|knob| !LEFT_ALONE.contains(&knob.name)) {
            let mut tried = Vec::new();
            for setting in knob.turned(self.subject, exact) {
                let (errors, work) = self.measure(&setting, true)?;
                let error = if errors.nonfinite == 0 { errors.rms } else { f64::INFINITY };
                tried.push(Tried { setting, error, cost: work.cost() });
            }
            of_knobs.push((knob, tried));
        }
        Ok(of_knobs)
    }

    fn measure(&mut self, setting: &Setting, chosen_by: bool) -> Result<(Errors, Work), Refusal> {
        let views = if chosen_by { &self.chosen_by } else { &self.held_out };
        errors_of(&mut self.trial, self.subject, setting, views).map_err(|_| Refusal::Failed)
    }

    /// A certificate for a setting, if it holds.
    fn certify(&mut self, setting: &Setting) -> Result<Option<Certificate>, Refusal> {
        let (chosen_by, _) = self.measure(setting, true)?;
        if !chosen_by.is_within(self.error) {
            return Ok(None);
        }
        let (verified, work) = self.measure(setting, false)?;
        if !verified.is_within(self.error) {
            return Ok(None);
        }
        let (_, usual) = self.measure(&Setting::usual(self.subject), false)?;
        Ok(Some(Certificate {
            setting: *setting,
            asked: self.error,
            chosen_by,
            verified,
            views: [self.chosen_by.len(), self.held_out.len()],
            work: [work, usual],
        }))
    }
}
