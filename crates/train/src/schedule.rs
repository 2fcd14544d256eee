//! Order in which a training visits its views. It depends only on the seed and the previous steps,
//! so it is known in advance.

use core::ops::Range;
use specula_core::random;

/// Views of a training, and the parameters of their order.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ViewSchedule {
    pub(crate) seed: u64,
    /// Number of views.
    pub(crate) views: usize,
    /// Number of views that a step fits.
    pub(crate) per_step: u32,
}

impl ViewSchedule {
    /// Numbers of the visits of a step among all visits of the training, from 1.
    pub(crate) fn visits(&self, step: u32) -> Range<u64> {
        let per_step = u64::from(self.per_step);
        let first = u64::from(step - 1) * per_step + 1;
        first..first + per_step
    }

    /// Views of a step, taken from the remaining views of the current pass. Each pass visits all
    /// views in random order.
    pub(crate) fn take(&self, order: &mut Vec<u32>, step: u32) -> Vec<usize> {
        self.visits(step).map(|visit| self.next(order, visit) as usize).collect()
    }

    fn next(&self, order: &mut Vec<u32>, visit: u64) -> u32 {
        if order.is_empty() {
            *order = (0..self.views as u32).collect();
            for k in (1..order.len()).rev() {
                let other = random::bits(self.seed, visit, k as u64) % (k as u64 + 1);
                order.swap(k, other as usize);
            }
        }
        order.pop().expect("the order was just filled")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pass_visits_all_views_in_another_order() {
        let schedule = ViewSchedule { seed: 3, views: 7, per_step: 2 };
        let mut order = Vec::new();
        let visited: Vec<usize> = (1..=7).flat_map(|step| schedule.take(&mut order, step)).collect();
        let (first, second) = visited.split_at(7);
        for pass in [first, second] {
            let mut views = pass.to_vec();
            views.sort_unstable();
            assert_eq!(views, [0, 1, 2, 3, 4, 5, 6]);
        }
        assert_ne!(first, second);
        assert_eq!((schedule.visits(1), schedule.visits(4)), (1..3, 7..9));
    }
}
