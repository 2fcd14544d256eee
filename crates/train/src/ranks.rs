//! Steps of a training on several ranks, bit-identical to a training on one rank.
//!
//! ```text
//! rank v mod R   gradient of view v, whole, as a single rank would compute it
//! every rank     sends each other rank the numbers of the Gaussians that it owns
//! owner          takes Adam's step for each view, in the order of the views
//! every rank     gathers the parameters
//! ```
//!
//! A rank owns a range of blocks of Gaussians, and the last rank owns the light. Only the owner
//! holds Adam's moments and the statistics of densification; every rank holds all parameters. Each
//! number is computed by one rank from the same inputs and in the same order as on one rank, so
//! results do not depend on the number of ranks. Densification, checkpoints and everything else
//! that needs all moments runs on every rank after gathering them, so checkpoints are the same for
//! any number of ranks.

use crate::{
    batch::{Updates, apply, batch_step, gradient_of},
    error::TrainError,
    exchange::{Exchange, ExchangeError},
    fingerprint::fingerprint,
    pictures::PictureError,
    transfer::{download, download_gaussians},
};
use core::ops::Range;
use specula_core::{
    executor::{Executor, StepReport, TrainingStep},
    expose::Exposure,
    loss::LossReport,
    pipeline::{ViewGradient, train_step},
    scene::{BLOCK, Gaussians, Layout, len_of_values},
    state::{AdamMoments, SceneState, Statistics},
};
use std::{collections::VecDeque, time::Instant};

/// Messages of a rank so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Traffic {
    /// Bytes that were sent to other ranks.
    pub sent: u64,
    /// Seconds spent in sending and waiting.
    pub seconds: f64,
}

/// Sizes that determine how much ranks send in a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepSizes {
    /// Number of Gaussians.
    pub gaussians: usize,
    /// Their attributes.
    pub layout: Layout,
    /// Numbers of the light; 0 without one.
    pub light: usize,
    /// Views of a step.
    pub views: usize,
    /// Number of ranks.
    pub ranks: usize,
}

impl StepSizes {
    /// Bytes that a rank sends to all others in a step, apart from densification, checkpoints and
    /// further steps of physical materials, which send no statistics.
    pub fn sent_by(&self, rank: usize) -> u64 {
        let Self { gaussians, layout, light, views, ranks } = *self;
        let own_views = (rank..views).step_by(ranks).count();
        let values = |rank: usize| values_of(&range_of(gaussians, rank, ranks), layout).len();
        let statistics = |rank: usize| 2 * range_of(gaussians, rank, ranks).len();
        let light_of = |rank: usize| if rank + 1 == ranks { light } else { 0 };
        let others = (0..ranks).filter(|other| *other != rank);
        let gradient: usize = others.map(|other| values(other) + statistics(other) + light_of(other)).sum();
        let reports = size_of::<f64>() * (1 + REPORT_LEN * own_views);
        let parameters = size_of::<f32>() * (values(rank) + light_of(rank));
        (size_of::<f32>() * own_views * gradient + (ranks - 1) * (reports + parameters)) as u64
    }
}

/// Answer of a rank to a question of all ranks, and their common answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Answer {
    /// No, on all ranks.
    No,
    /// Yes, on at least one rank.
    Yes,
    /// The rank cannot show a picture of the next step; in common, the first one that cannot.
    Fault(PictureError),
}

impl Answer {
    pub(crate) fn of(is_yes: bool) -> Self {
        if is_yes { Self::Yes } else { Self::No }
    }

    fn to_message(&self) -> Vec<u8> {
        match self {
            Self::No => vec![0],
            Self::Yes => vec![1],
            Self::Fault(PictureError(sentence)) => [&[2], sentence.as_bytes()].concat(),
        }
    }

    fn from_message(message: &[u8]) -> Self {
        match message {
            [1] => Self::Yes,
            [2, sentence @ ..] => Self::Fault(PictureError(String::from_utf8_lossy(sentence).into_owned())),
            _ => Self::No,
        }
    }
}

/// One rank of a training.
#[derive(Debug)]
pub(crate) struct Ranks {
    /// Connection with the others; `None` for the only rank.
    exchange: Option<Box<dyn Exchange>>,
    traffic: Traffic,
}

/// Numbers of a report as a message: seven losses, whether there is an exposure, its twelve
/// numbers.
const REPORT_LEN: usize = 20;

impl Ranks {
    /// The only rank of a training, which exchanges nothing.
    pub(crate) fn alone() -> Self {
        Self { exchange: None, traffic: Traffic::default() }
    }

    pub(crate) fn of(exchange: Box<dyn Exchange>) -> Self {
        Self { exchange: Some(exchange), traffic: Traffic::default() }
    }

    pub(crate) fn rank(&self) -> usize {
        self.exchange.as_ref().map_or(0, |exchange| exchange.rank())
    }

    pub(crate) fn size(&self) -> usize {
        self.exchange.as_ref().map_or(1, |exchange| exchange.size())
    }

    /// Messages to other ranks so far; `None` for the only rank.
    pub(crate) fn traffic(&self) -> Option<Traffic> {
        self.exchange.as_ref().map(|_| self.traffic)
    }

    /// Common answer of all ranks: a fault before a yes, and a yes before a no.
    pub(crate) fn agree(&mut self, own: Answer) -> Result<Answer, ExchangeError> {
        let all: Vec<Answer> = match &self.exchange {
            None => vec![own],
            Some(_) => self.all_gather(own.to_message())?.iter().map(|told| Answer::from_message(told)).collect(),
        };
        let is_yes = all.contains(&Answer::Yes);
        let fault = all.into_iter().find(|answer| matches!(answer, Answer::Fault(_)));
        Ok(fault.unwrap_or(Answer::of(is_yes)))
    }

    /// Rejects ranks with a text other than rank 0's. `what` is a plural noun for the error.
    pub(crate) fn check_alike(&mut self, what: &'static str, own: &[u8]) -> Result<(), ExchangeError> {
        let all = self.all_gather(own.to_vec())?;
        match all.iter().position(|text| *text != all[0]) {
            Some(rank) => Err(ExchangeError::Different { rank, what }),
            None => Ok(()),
        }
    }

    /// Takes a step of Adam for each view of all ranks. `own` are the views of this one. Returns
    /// the report of each view.
    pub(crate) fn step<E: Executor>(
        &mut self,
        exec: &mut E,
        scene: &mut SceneState<E::Array>,
        own: &[TrainingStep<'_, E>],
        updates: &Updates<'_>,
    ) -> Result<Vec<StepReport>, TrainError<E::Error>> {
        match (&self.exchange, own) {
            (Some(_), own) => self.shared_step(exec, scene, own, updates),
            // The gradient of a single view is never stored.
            (None, [step]) => Ok(vec![train_step(exec, scene, step)?]),
            (None, steps) => Ok(batch_step(exec, scene, steps, updates)?),
        }
    }

    /// Takes the steps that [`batch_step`] takes on one rank.
    fn shared_step<E: Executor>(
        &mut self,
        exec: &mut E,
        scene: &mut SceneState<E::Array>,
        own: &[TrainingStep<'_, E>],
        updates: &Updates<'_>,
    ) -> Result<Vec<StepReport>, TrainError<E::Error>> {
        let (own_parts, mut reports) = self.compute_own(exec, scene, own)?;
        let whole = download_gaussians(exec, &scene.gaussians)?;
        let range = self.range(whole.count, self.rank());
        let slice = Gaussians {
            count: range.len(),
            layout: whole.layout,
            values: whole.values[values_of(&range, whole.layout)].to_vec(),
        };
        scene.gaussians = exec.upload_gaussians(&slice)?;
        let nonfinite = self.apply_all(exec, scene, updates, own_parts, whole.count)?;
        self.gather_parameters(exec, scene, whole, nonfinite, &mut reports, updates.views)?;
        Ok(reports)
    }

    /// Computes the gradients of this rank's views, and sends each rank its range. Returns this
    /// rank's range, and its reports.
    fn compute_own<E: Executor>(
        &mut self,
        exec: &mut E,
        scene: &SceneState<E::Array>,
        views: &[TrainingStep<'_, E>],
    ) -> Result<(VecDeque<Vec<f32>>, Vec<StepReport>), TrainError<E::Error>> {
        let (rank, size) = (self.rank(), self.size());
        let (mut own, mut reports) = (VecDeque::new(), Vec::new());
        for view in views {
            let light = scene.light.as_ref().map(|(light, _)| light);
            let (grad, report) = gradient_of(exec, &scene.gaussians, light, view)?;
            let grad = HostGradient::download(exec, &grad, light_len_of(scene))?;
            reports.push(report);
            for owner in 0..size {
                let part = grad.part(&self.range(scene.gaussians.count, owner), owner + 1 == size);
                if owner == rank {
                    own.push_back(part);
                } else {
                    self.send(owner, bytemuck::cast_slice(&part).to_vec()).map_err(TrainError::Exchange)?;
                }
            }
        }
        Ok((own, reports))
    }

    /// Takes Adam's step for each view, in their order, with the numbers that this rank owns, of
    /// `count` Gaussians in total. Returns the number of skipped numbers. `scene` has this rank's
    /// own Gaussians.
    fn apply_all<E: Executor>(
        &mut self,
        exec: &mut E,
        scene: &mut SceneState<E::Array>,
        updates: &Updates<'_>,
        mut own_parts: VecDeque<Vec<f32>>,
        count: usize,
    ) -> Result<usize, TrainError<E::Error>> {
        let (rank, size) = (self.rank(), self.size());
        let own = self.range(count, rank);
        let layout = scene.gaussians.layout;
        let light_len = if rank + 1 == size { light_len_of(scene) } else { 0 };
        let mut nonfinite = 0;
        let is_observed = updates.is_observed;
        for (from, position) in (0..size).cycle().zip(0..updates.views) {
            let least = len_of_values(own.len(), layout) + if is_observed { 2 * own.len() } else { 0 };
            let part = if from == rank {
                own_parts.pop_front().unwrap_or_default()
            } else {
                self.receive_numbers(from).map_err(TrainError::Exchange)?
            };
            let is_lit = light_len > 0 && part.len() == least + light_len;
            if part.len() != least && !is_lit {
                let (expected, found) = (4 * least, 4 * part.len());
                return Err(TrainError::Exchange(ExchangeError::Length { rank: from, expected, found }));
            }
            let (values, rest) = part.split_at(len_of_values(own.len(), layout));
            let (statistics, light_numbers) = rest.split_at(least - values.len());
            let (grad_sum, view_count) = statistics.split_at(statistics.len() / 2);
            let grad = ViewGradient {
                gaussians: exec.upload_gaussians(&Gaussians { count: own.len(), layout, values })?,
                light: if is_lit { Some(exec.upload(light_numbers)?) } else { None },
                statistics: if is_observed {
                    Some(Statistics { grad_sum: exec.upload(grad_sum)?, view_count: exec.upload(view_count)? })
                } else {
                    None
                },
            };
            nonfinite += apply(exec, scene, grad, updates, position)?;
        }
        Ok(nonfinite)
    }

    /// Gathers the parameters from their owners, and the reports of all views. Before the call
    /// `scene` has this rank's Gaussians, after it all Gaussians.
    fn gather_parameters<E: Executor>(
        &mut self,
        exec: &mut E,
        scene: &mut SceneState<E::Array>,
        mut whole: Gaussians<Vec<f32>>,
        nonfinite: usize,
        reports: &mut Vec<StepReport>,
        view_count: usize,
    ) -> Result<(), TrainError<E::Error>> {
        let size = self.size();
        let owns_light = self.rank() + 1 == size;
        let mut facts = vec![nonfinite as f64];
        reports.iter().for_each(|report| facts.extend(numbers_of(report)));
        let mut message = bytemuck::cast_slice::<f64, u8>(&facts).to_vec();
        message.extend_from_slice(bytemuck::cast_slice(&download_gaussians(exec, &scene.gaussians)?.values));
        if let Some((light, _)) = scene.light.as_ref().filter(|_| owns_light) {
            let values = download(exec, &light.values, light.len_of_values())?;
            message.extend_from_slice(bytemuck::cast_slice(&values));
        }
        let all = self.all_gather(message).map_err(TrainError::Exchange)?;

        let light_len = light_len_of(scene);
        let mut found = vec![StepReport::default(); view_count];
        let (mut skipped, mut light) = (0.0, Vec::new());
        for (rank, message) in all.iter().enumerate() {
            let own = values_of(&self.range(whole.count, rank), whole.layout);
            let views = (0..view_count).skip(rank).step_by(size);
            let facts_len = size_of::<f64>() * (1 + REPORT_LEN * views.len());
            let light_part = if rank + 1 == size { light_len } else { 0 };
            let expected = facts_len + size_of::<f32>() * (own.len() + light_part);
            check_length(rank, expected, message).map_err(TrainError::Exchange)?;
            let (facts, numbers) = message.split_at(facts_len);
            let facts: Vec<f64> = bytemuck::pod_collect_to_vec(facts);
            let numbers: Vec<f32> = bytemuck::pod_collect_to_vec(numbers);
            skipped += facts[0];
            views.zip(facts[1..].chunks_exact(REPORT_LEN)).for_each(|(view, facts)| found[view] = report_of(facts));
            light = numbers[own.len()..].to_vec();
            whole.values[own.clone()].copy_from_slice(&numbers[..own.len()]);
        }
        if let Some(last) = found.last_mut() {
            last.nonfinite = skipped as usize;
        }
        *reports = found;
        scene.gaussians = exec.upload_gaussians(&whole)?;
        if let Some((environment, _)) = scene.light.as_mut().filter(|_| !owns_light) {
            environment.values = exec.upload(&light)?;
        }
        Ok(())
    }

    /// Gathers moments and statistics of all Gaussians and of the light on every rank. Rejects
    /// ranks with different parameters.
    pub(crate) fn gather<E: Executor>(
        &mut self,
        exec: &mut E,
        scene: &mut SceneState<E::Array>,
    ) -> Result<(), TrainError<E::Error>> {
        if self.exchange.is_none() {
            return Ok(());
        }
        self.check_parameters(exec, scene)?;
        let light_len = light_len_of(scene);
        let SceneState { gaussians, moments, statistics, light } = scene;
        let (count, layout, size) = (gaussians.count, gaussians.layout, self.size());
        let lengths = |own: &Range<usize>| [len_of_values(own.len(), layout); 2].into_iter().chain([own.len(); 2]);
        let own = self.range(count, self.rank());
        let own_arrays = [&moments.mean, &moments.square, &statistics.grad_sum, &statistics.view_count];
        let mut message = Vec::new();
        for (array, len) in own_arrays.into_iter().zip(lengths(&own)) {
            message.extend(download(exec, array, len)?);
        }
        if let Some((_, moments)) = light.as_ref().filter(|_| self.rank() + 1 == size) {
            message.extend(download(exec, &moments.mean, light_len)?);
            message.extend(download(exec, &moments.square, light_len)?);
        }
        let all = self.all_gather(bytemuck::cast_slice(&message).to_vec()).map_err(TrainError::Exchange)?;

        let mut whole: [Vec<f32>; 4] = Default::default();
        let mut light_numbers = Vec::new();
        for (rank, message) in all.iter().enumerate() {
            let own = self.range(count, rank);
            let light_part = if rank + 1 == size { 2 * light_len } else { 0 };
            let expected = size_of::<f32>() * (lengths(&own).sum::<usize>() + light_part);
            check_length(rank, expected, message).map_err(TrainError::Exchange)?;
            let numbers: Vec<f32> = bytemuck::pod_collect_to_vec(message);
            let mut rest = &*numbers;
            for (whole, len) in whole.iter_mut().zip(lengths(&own)) {
                let (part, others) = rest.split_at(len);
                whole.extend_from_slice(part);
                rest = others;
            }
            light_numbers = rest.to_vec();
        }
        let [mean, square, grad_sum, view_count] = whole;
        *moments = upload_moments(exec, &gaussians.with_values([mean, square]))?;
        *statistics = Statistics { grad_sum: exec.upload(&grad_sum)?, view_count: exec.upload(&view_count)? };
        if let Some((_, moments)) = light {
            let (mean, square) = light_numbers.split_at(light_len);
            *moments = AdamMoments { mean: exec.upload(mean)?, square: exec.upload(square)? };
        }
        Ok(())
    }

    /// Keeps only the moments and statistics of this rank's Gaussians.
    pub(crate) fn keep_own<E: Executor>(&self, exec: &mut E, scene: &mut SceneState<E::Array>) -> Result<(), E::Error> {
        if self.exchange.is_none() {
            return Ok(());
        }
        let SceneState { gaussians, moments, statistics, .. } = scene;
        let (count, layout) = (gaussians.count, gaussians.layout);
        let own = self.range(count, self.rank());
        let values = values_of(&own, layout);
        let mut kept = |array| {
            let all = download(exec, array, len_of_values(count, layout));
            all.map(|all| all[values.clone()].to_vec())
        };
        let both = [kept(&moments.mean)?, kept(&moments.square)?];
        *moments = upload_moments(exec, &Gaussians { count: own.len(), layout, values: both })?;
        for array in [&mut statistics.grad_sum, &mut statistics.view_count] {
            let kept = download(exec, array, count)?[own.clone()].to_vec();
            *array = exec.upload(&kept)?;
        }
        Ok(())
    }

    /// Rejects ranks with Gaussians or a light other than rank 0's, bit by bit.
    pub(crate) fn check_parameters<E: Executor>(
        &mut self,
        exec: &mut E,
        scene: &SceneState<E::Array>,
    ) -> Result<(), TrainError<E::Error>> {
        let mut sum = fingerprint(&download_gaussians(exec, &scene.gaussians)?.values);
        if let Some((light, _)) = &scene.light {
            sum = sum.rotate_left(1) ^ fingerprint(&download(exec, &light.values, light.len_of_values())?);
        }
        self.check_alike("parameters", &sum.to_le_bytes()).map_err(TrainError::Exchange)
    }

    /// Gaussians that a rank owns, of `count`.
    fn range(&self, count: usize, rank: usize) -> Range<usize> {
        range_of(count, rank, self.size())
    }

    fn send(&mut self, to: usize, message: Vec<u8>) -> Result<(), ExchangeError> {
        self.traffic.sent += message.len() as u64;
        self.timed(|exchange| exchange.send(to, message))
    }

    fn receive_numbers(&mut self, from: usize) -> Result<Vec<f32>, ExchangeError> {
        let message = self.timed(|exchange| exchange.receive(from))?;
        check_length(from, message.len().next_multiple_of(size_of::<f32>()), &message)?;
        Ok(bytemuck::pod_collect_to_vec(&message))
    }

    fn all_gather(&mut self, own: Vec<u8>) -> Result<Vec<Vec<u8>>, ExchangeError> {
        self.traffic.sent += (own.len() * (self.size() - 1)) as u64;
        self.timed(|exchange| exchange.all_gather(own))
    }

    fn timed<T>(
        &mut self,
        run: impl FnOnce(&mut dyn Exchange) -> Result<T, ExchangeError>,
    ) -> Result<T, ExchangeError> {
        let exchange = self.exchange.as_deref_mut().expect("the only rank exchanges nothing");
        let start = Instant::now();
        let done = run(exchange);
        self.traffic.seconds += start.elapsed().as_secs_f64();
        done
    }
}

/// Gaussians, of `count`, owned by one of `size` ranks: whole blocks, except the last one.
fn range_of(count: usize, rank: usize, size: usize) -> Range<usize> {
    let blocks = count.div_ceil(BLOCK);
    let first = |rank: usize| (blocks * rank / size * BLOCK).min(count);
    first(rank)..first(rank + 1)
}

/// Numbers of the light; 0 without one.
fn light_len_of<A>(scene: &SceneState<A>) -> usize {
    scene.light.as_ref().map_or(0, |(light, _)| light.len_of_values())
}

/// Numbers of a range of Gaussians, which begins with a block.
fn values_of(gaussians: &Range<usize>, layout: Layout) -> Range<usize> {
    len_of_values(gaussians.start, layout)..len_of_values(gaussians.end, layout)
}

fn upload_moments<E: Executor>(
    exec: &mut E,
    moments: &Gaussians<[Vec<f32>; 2]>,
) -> Result<AdamMoments<E::Array>, E::Error> {
    let mut upload =
        |values: &Vec<f32>| exec.upload_gaussians(&moments.with_values(values)).map(|gaussians| gaussians.values);
    let [mean, square] = &moments.values;
    Ok(AdamMoments { mean: upload(mean)?, square: upload(square)? })
}

fn check_length(rank: usize, expected: usize, message: &[u8]) -> Result<(), ExchangeError> {
    let found = message.len();
    if found == expected { Ok(()) } else { Err(ExchangeError::Length { rank, expected, found }) }
}

/// Gradient of a view in host memory.
struct HostGradient {
    gaussians: Gaussians<Vec<f32>>,
    /// Sums of lengths and numbers of views; empty if the step is not observed.
    statistics: [Vec<f32>; 2],
    /// Gradient of the light; empty if there is none.
    light: Vec<f32>,
}

impl HostGradient {
    fn download<E: Executor>(exec: &mut E, grad: &ViewGradient<E::Array>, light_len: usize) -> Result<Self, E::Error> {
        let gaussians = download_gaussians(exec, &grad.gaussians)?;
        let statistics = match &grad.statistics {
            Some(Statistics { grad_sum, view_count }) => {
                [download(exec, grad_sum, gaussians.count)?, download(exec, view_count, gaussians.count)?]
            }
            None => Default::default(),
        };
        let light = match &grad.light {
            Some(light) => download(exec, light, light_len)?,
            None => Vec::new(),
        };
        Ok(Self { gaussians, statistics, light })
    }

    /// Numbers of a range of Gaussians, and those of the light if the range belongs to its owner.
    fn part(&self, range: &Range<usize>, owns_light: bool) -> Vec<f32> {
        let mut part = self.gaussians.values[values_of(range, self.gaussians.layout)].to_vec();
        for statistics in self.statistics.iter().filter(|statistics| !statistics.is_empty()) {
            part.extend_from_slice(&statistics[range.clone()]);
        }
        if owns_light {
            part.extend_from_slice(&self.light);
        }
        part
    }
}

fn numbers_of(report: &StepReport) -> [f64; REPORT_LEN] {
    let LossReport { total, absolute, squared, ssim, normal, smoothness, coverage } = report.loss;
    let mut numbers = [0.0; REPORT_LEN];
    numbers[..7].copy_from_slice(&[total, absolute, squared, ssim, normal, smoothness, coverage]);
    if let Some(exposure) = &report.exposure {
        numbers[7] = 1.0;
        numbers[8..].copy_from_slice(exposure.as_flattened());
    }
    numbers
}

fn report_of(numbers: &[f64]) -> StepReport {
    let &[total, absolute, squared, ssim, normal, smoothness, coverage, is_exposed, ref exposure @ ..] = numbers else {
        return StepReport::default();
    };
    let loss = LossReport { total, absolute, squared, ssim, normal, smoothness, coverage };
    let number = |row: usize, column: usize| exposure[4 * row + column];
    let exposure: Exposure<f64> = [0, 1, 2].map(|row| [0, 1, 2, 3].map(|column| number(row, column)));
    StepReport { loss, nonfinite: 0, exposure: (is_exposed == 1.0).then_some(exposure) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exchange::threads;
    use core::time::Duration;

    fn ranks(count: usize) -> Vec<Ranks> {
        let connected = threads(count, Duration::from_secs(60));
        connected.into_iter().map(|exchange| Ranks::of(Box::new(exchange))).collect()
    }

    #[test]
    fn every_gaussian_has_one_owner_and_ranges_begin_with_blocks() {
        for size in 1..6 {
            for count in [0, 1, 16, 17, 20, 100, 1000] {
                let ranges: Vec<Range<usize>> = (0..size).map(|owner| range_of(count, owner, size)).collect();
                assert!(ranges.iter().cloned().flatten().eq(0..count), "{count} on {size}: {ranges:?}");
                let begins = ranges.iter().all(|range| range.is_empty() || range.start.is_multiple_of(BLOCK));
                assert!(begins, "{count} on {size}: {ranges:?}");
            }
        }
    }

    #[test]
    fn reports_arrive_as_they_were() {
        let loss = LossReport {
            total: 1.0,
            absolute: 2.0,
            squared: 3.0,
            ssim: 4.0,
            normal: 5.0,
            smoothness: 7.0,
            coverage: 6.0,
        };
        let exposure = Some([[1.5, 2.5, 3.5, 4.5]; 3]);
        for report in [StepReport { loss, nonfinite: 0, exposure }, StepReport { loss, nonfinite: 0, exposure: None }] {
            assert_eq!(report_of(&numbers_of(&report)), report);
        }
    }

    #[test]
    fn a_fault_of_one_rank_is_the_answer_of_all() {
        let fault = |sentence: &str| Answer::Fault(PictureError(sentence.to_owned()));
        let answers = [Answer::Yes, fault("picture 3 is damaged"), fault(""), Answer::No];
        let handles = ranks(4).into_iter().map(|mut rank| {
            let own = answers[rank.rank()].clone();
            std::thread::spawn(move || rank.agree(own))
        });
        for handle in handles.collect::<Vec<_>>() {
            assert_eq!(handle.join().expect("no rank panics"), Ok(fault("picture 3 is damaged")));
        }
        for answer in answers {
            assert_eq!(Answer::from_message(&answer.to_message()), answer);
            assert_eq!(Ranks::alone().agree(answer.clone()), Ok(answer));
        }
    }

    #[test]
    fn ranks_that_differ_are_named() {
        let handles = ranks(3).into_iter().map(|mut rank| {
            let text = if rank.rank() == 2 { "7000 iterations" } else { "700 iterations" };
            std::thread::spawn(move || {
                (rank.agree(Answer::of(rank.rank() == 1)), rank.check_alike("options", text.as_bytes()))
            })
        });
        for handle in handles.collect::<Vec<_>>() {
            let (agreed, checked) = handle.join().expect("no rank panics");
            assert_eq!(
                (agreed, checked),
                (Ok(Answer::Yes), Err(ExchangeError::Different { rank: 2, what: "options" }))
            );
        }
    }
}
