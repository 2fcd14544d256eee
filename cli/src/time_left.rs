//! Time left of some work: time per unit of expected cost so far, times the cost of the remaining
//! steps, plus the mean time of a pause so far, times the number of remaining pauses.

use core::fmt;

/// Costs and pauses of the steps of some work, as known before it begins.
#[derive(Clone, Debug, Default)]
pub(crate) struct Plan {
    /// Cumulative cost before each step, then of all, in any unit; if empty, all steps cost the
    /// same.
    pub(crate) costs: Vec<f64>,
    /// Steps that include a pause of unknown length, in ascending order.
    pub(crate) pauses: Vec<u64>,
    /// Expected cost of a pause, until one is over.
    pub(crate) pause_cost: f64,
    /// First steps, in which pictures are decoded; their rate is forgotten after them.
    pub(crate) warm_up: u64,
}

/// Estimate that learns from the steps done.
#[derive(Clone, Debug, Default)]
pub(crate) struct TimeLeft {
    plan: Plan,
    /// Steps done, and the time since the start in seconds.
    done: u64,
    seconds: f64,
    /// Cost and seconds of the steps, without pauses.
    steps: Sum,
    /// Number and seconds of pauses.
    pauses: Sum,
}

#[derive(Clone, Copy, Debug, Default)]
struct Sum {
    amount: f64,
    seconds: f64,
}

impl Sum {
    fn add(&mut self, amount: f64, seconds: f64) {
        self.amount += amount;
        self.seconds += seconds;
    }

    /// Seconds of one pause.
    fn mean(self) -> Option<f64> {
        (self.amount > 0.0).then(|| self.seconds / self.amount)
    }
}

impl TimeLeft {
    /// Estimate of work that begins after `done` steps.
    pub(crate) fn new(plan: Plan, done: u64) -> Self {
        Self { plan, done, ..Self::default() }
    }

    /// Replaces the expected costs of the remaining steps.
    pub(crate) fn replan(&mut self, plan: Plan) {
        self.plan = plan;
    }

    /// Records that `done` steps are done `seconds` after the start.
    pub(crate) fn advance(&mut self, done: u64, seconds: f64) {
        if done <= self.done {
            return;
        }
        let (cost, pauses) = (self.cost(self.done, done), self.pauses_between(self.done, done));
        let passed = (seconds - self.seconds).max(0.0);
        let step_seconds = match self.steps.mean() {
            Some(mean) if pauses > 0.0 => passed.min(mean * cost),
            _ => passed,
        };
        if (self.done..done).contains(&self.plan.warm_up) {
            self.steps = Sum::default();
        }
        self.steps.add(cost, step_seconds);
        self.pauses.add(pauses, passed - step_seconds);
        (self.done, self.seconds) = (done, seconds);
    }

    /// Seconds left of `all` steps; `None` before the first is done.
    pub(crate) fn seconds(&self, all: u64) -> Option<f64> {
        let rate = self.steps.mean()?;
        let pause = self.pauses.mean().unwrap_or(rate * self.plan.pause_cost);
        Some(rate * self.cost(self.done, all) + pause * self.pauses_between(self.done, all))
    }

    fn cost(&self, from: u64, to: u64) -> f64 {
        let at = |step: u64| self.plan.costs.get(step as usize).or(self.plan.costs.last());
        match (at(from), at(to)) {
            (Some(from), Some(to)) => to - from,
            _ => to.saturating_sub(from) as f64,
        }
    }

    fn pauses_between(&self, from: u64, to: u64) -> f64 {
        self.plan.pauses.iter().filter(|pause| (from + 1..=to).contains(*pause)).count() as f64
    }
}

/// Seconds as hours, minutes and seconds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spoken(pub(crate) f64);

impl fmt::Display for Spoken {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let seconds = self.0.max(0.0).round() as u64;
        let (hours, minutes) = (seconds / 3600, seconds / 60 % 60);
        match (hours, minutes) {
            (0, 0) => write!(out, "{seconds} s"),
            (0, _) => write!(out, "{minutes} min {} s", seconds % 60),
            _ => write!(out, "{hours} h {minutes} min"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ratio of estimate to truth after some of 1000 steps of `cost` seconds, with pauses of 4 s.
    fn ratio(plan: Plan, cost: impl Fn(u64) -> f64, pauses: &[u64], at: u64) -> f64 {
        let time = |to: u64| {
            let steps: f64 = (1..=to).map(&cost).sum();
            steps + 4.0 * pauses.iter().filter(|pause| **pause <= to).count() as f64
        };
        let mut left = TimeLeft::new(plan, 0);
        (1..=at).for_each(|step| left.advance(step, time(step)));
        left.seconds(1000).unwrap() / (time(1000) - time(at))
    }

    #[test]
    fn a_slow_step_is_not_taken_for_the_rate() {
        let pauses = [100, 300, 500, 700, 900];
        let even = |_| 0.025;
        for at in [101, 150, 300, 301, 600, 899] {
            let planned = Plan { pauses: pauses.into(), ..Plan::default() };
            assert!((ratio(planned, even, &pauses, at) - 1.0).abs() < 1e-9, "{at}");
        }
        assert!(ratio(Plan::default(), even, &pauses, 101) > 1.5, "unplanned, a pause is spread over all steps");
    }

    #[test]
    fn the_cost_of_later_steps_is_planned() {
        let cost = |step: u64| if step <= 250 { 0.01 } else { 0.03 };
        let costs = (0..=1000).scan(0.0, |sum, step| {
            *sum += if step == 0 { 0.0 } else { cost(step) * 7.0 };
            Some(*sum)
        });
        let planned = Plan { costs: costs.collect(), ..Plan::default() };
        assert!((ratio(planned, cost, &[], 100) - 1.0).abs() < 1e-9);
        assert!(ratio(Plan::default(), cost, &[], 100) < 0.5);
    }

    #[test]
    fn a_pause_to_come_is_expected_and_then_measured() {
        let plan = |factor: f64| Plan {
            costs: (0..=10).map(|step| factor * f64::from(step)).collect(),
            pauses: vec![5, 8],
            pause_cost: 3.0,
            warm_up: 0,
        };
        let mut left = TimeLeft::new(plan(1.0), 0);
        left.advance(4, 8.0);
        assert_eq!(left.seconds(10), Some(2.0 * 6.0 + 2.0 * 6.0), "2 s for each unit of cost");
        left.advance(5, 20.0);
        assert_eq!(left.seconds(10), Some(2.0 * 5.0 + 10.0), "the pause took 10 s");
        left.replan(plan(2.0));
        assert_eq!(left.seconds(10), Some(4.0 * 5.0 + 10.0), "steps to come cost twice as much");
    }

    #[test]
    fn the_rate_of_the_first_steps_is_forgotten_once_they_are_over() {
        let mut left = TimeLeft::new(Plan { warm_up: 2, ..Plan::default() }, 0);
        left.advance(1, 5.0);
        left.advance(2, 10.0);
        assert_eq!(left.seconds(10), Some(40.0), "nothing else is known");
        left.advance(3, 11.0);
        assert_eq!(left.seconds(10), Some(7.0));
    }

    #[test]
    fn resumed_work_counts_only_its_own_steps() {
        let mut left = TimeLeft::new(Plan::default(), 5000);
        assert_eq!(left.seconds(6000), None, "nothing is known yet");
        left.advance(5100, 2.0);
        assert_eq!(left.seconds(6000), Some(18.0));
        left.advance(5100, 3.0);
        assert_eq!(left.seconds(6000), Some(18.0), "no step was done");
        left.advance(6000, 20.0);
        assert_eq!(left.seconds(6000), Some(0.0));
    }

    #[test]
    fn times_are_printed_as_hours_minutes_and_seconds() {
        let told = [0.4, 59.4, 59.6, 3599.0, 5025.0, f64::NAN].map(|seconds| Spoken(seconds).to_string());
        assert_eq!(told, ["0 s", "59 s", "1 min 0 s", "59 min 59 s", "1 h 23 min", "0 s"]);
    }
}
