//! Pictures of a training's steps: their order, their size, and their upload before their turn.

use crate::{
    error::TrainError,
    pictures::{PictureKey, Pictures, Turn},
    schedule::ViewSchedule,
    targets::Targets,
    trainer::Settings,
};
use core::ops::Range;
use specula_core::executor::Executor;
use std::collections::VecDeque;

/// Turns of pictures that are known ahead at most: those of some passes, or of a part of a long
/// one.
const AHEAD_MAX: usize = 2048;

/// Views of the next step, whose targets are uploaded.
#[derive(Debug)]
pub(crate) struct Prepared {
    pub(crate) views: Vec<usize>,
    /// Remaining views of the pass after that step.
    pub(crate) order: Vec<u32>,
}

/// Turns of this rank's pictures after those that are uploaded.
#[derive(Debug)]
struct Ahead {
    turns: VecDeque<Turn>,
    /// Next step that is not among them, and the remaining views of the pass before it.
    step: u32,
    order: Vec<u32>,
}

/// Pictures of one rank in the order of the steps.
#[derive(Debug)]
pub(crate) struct PictureSchedule<T> {
    targets: Targets<T>,
    views: ViewSchedule,
    iterations: u32,
    /// Share of the training at half resolution; 0 if no view is halved.
    coarse_until: f32,
    rank: usize,
    rank_count: usize,
    prepared: Option<Prepared>,
    ahead: Option<Ahead>,
}

impl<T> PictureSchedule<T> {
    /// Schedule of `views` pictures, which a single rank computes.
    pub(crate) fn new(pictures: Box<dyn Pictures>, settings: &Settings, views: usize, is_halved: bool) -> Self {
        let Settings { seed, ref profile, iterations, .. } = *settings;
        Self {
            targets: Targets::new(pictures),
            views: ViewSchedule { seed, views, per_step: profile.views_per_step },
            iterations,
            coarse_until: if is_halved { profile.coarse_until } else { 0.0 },
            rank: 0,
            rank_count: 1,
            prepared: None,
            ahead: None,
        }
    }

    /// Shares the pictures of each step among ranks.
    pub(crate) fn share(&mut self, rank: usize, rank_count: usize) {
        (self.rank, self.rank_count) = (rank, rank_count);
        (self.prepared, self.ahead) = (None, None);
    }

    /// Changes the number of steps.
    pub(crate) fn end_at(&mut self, iterations: u32) {
        self.iterations = iterations;
        (self.prepared, self.ahead) = (None, None);
    }

    /// Numbers of the visits of a step among all that the training makes, from 1.
    pub(crate) fn visits(&self, step: u32) -> Range<u64> {
        self.views.visits(step)
    }

    /// Uploads this rank's pictures of a step, unless they are uploaded. `order` are the remaining
    /// views of the pass before it.
    ///
    /// # Errors
    ///
    /// [`TrainError::Picture`] or [`TrainError::Executor`]; the pictures may be asked for again.
    pub(crate) fn prepare<E: Executor<Target = T>>(
        &mut self,
        exec: &mut E,
        order: &[u32],
        step: u32,
    ) -> Result<(), TrainError<E::Error>> {
        if self.prepared.is_some() {
            return Ok(());
        }
        self.look_ahead::<E>(order, step);
        let mut order = order.to_vec();
        let views = self.views.take(&mut order, step);
        let turns = self.turns(step, &views);
        self.targets.prepare(exec, &turns)?;
        self.prepared = Some(Prepared { views, order });
        Ok(())
    }

    /// Views of the step that was prepared.
    pub(crate) fn take_prepared(&mut self) -> Prepared {
        self.prepared.take().expect("the views of the step are prepared")
    }

    /// Turns of the pictures in a step with these views whose gradients this rank computes.
    pub(crate) fn turns(&self, step: u32, views: &[usize]) -> Vec<Turn> {
        let is_halved = (step as f32 / self.iterations.max(1) as f32) < self.coarse_until;
        let visits = self.visits(step).zip(views).skip(self.rank).step_by(self.rank_count);
        visits.map(|(visit, view)| Turn { visit, picture: PictureKey { view: *view, is_halved } }).collect()
    }

    /// Target of a picture that was prepared.
    pub(crate) fn target(&self, picture: PictureKey) -> &T {
        self.targets.of(picture)
    }

    /// Announces turns of pictures ahead, once half of those that were known are over.
    fn look_ahead<E: Executor<Target = T>>(&mut self, order: &[u32], step: u32) {
        let mut ahead =
            self.ahead.take().unwrap_or_else(|| Ahead { turns: VecDeque::new(), step, order: order.to_vec() });
        let first = self.visits(step).start;
        while ahead.turns.front().is_some_and(|turn| turn.visit < first) {
            ahead.turns.pop_front();
        }
        let most = AHEAD_MAX.min(2 * self.views.views).max(2);
        if ahead.turns.len() <= most / 2 && ahead.step <= self.iterations {
            while ahead.turns.len() < most && ahead.step <= self.iterations {
                let views = self.views.take(&mut ahead.order, ahead.step);
                ahead.turns.extend(self.turns(ahead.step, &views));
                ahead.step += 1;
            }
            self.targets.expect::<E>(&ahead.turns);
        }
        self.ahead = Some(ahead);
    }
}
