//! Pairs of pictures that are matched, in the order of their names: neighbours, pictures at powers
//! of two, and all pairs of a thinned sequence, which close loops without a vocabulary tree.

use std::collections::BTreeSet;

/// Largest number of pictures of which all pairs are matched at once.
pub(crate) const FEW: usize = 30;
/// Largest number of pictures of which all pairs are matched if a sequence registers too few.
pub(crate) const EXHAUSTIVE: usize = 150;

/// Sequence of pictures, each of which shows much of the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Sequence {
    /// Number of neighbours on each side that are matched.
    neighbours: usize,
    /// Largest number of pictures in the thinned sequence, of which all pairs are matched.
    thinned: usize,
}

impl Sequence {
    /// Pictures whose other pairs are matched if too few register.
    pub(crate) const SPARSE: Self = Self { neighbours: 6, thinned: 20 };
    /// Pictures that are too many for all pairs, and may go around an object several times.
    pub(crate) const DENSE: Self = Self { neighbours: 10, thinned: 60 };

    /// Indices of pictures to match, of each pair the smaller one first, in ascending order.
    pub(crate) fn pairs(self, count: usize) -> Vec<[usize; 2]> {
        let near = 1..=self.neighbours;
        let doubled = core::iter::successors(Some(2 * self.neighbours), |gap| Some(2 * gap));
        let gaps: Vec<usize> = near.chain(doubled.take_while(|gap| *gap < count)).collect();
        let mut pairs: BTreeSet<[usize; 2]> = BTreeSet::new();
        for first in 0..count {
            pairs.extend(gaps.iter().map(|gap| [first, first + gap]).filter(|[_, second]| *second < count));
        }
        let thinned: Vec<usize> = (0..count).step_by(count.div_ceil(self.thinned).max(1)).collect();
        for (index, first) in thinned.iter().enumerate() {
            pairs.extend(thinned[index + 1..].iter().map(|second| [*first, *second]));
        }
        pairs.into_iter().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_and_ends_of_a_loop_are_matched_with_few_pairs() {
        let pairs = Sequence::DENSE.pairs(600);
        assert!(pairs.contains(&[17, 18]) && pairs.contains(&[17, 27]) && pairs.contains(&[0, 590]), "{pairs:?}");
        assert!(pairs.len() < 600 * 599 / 2 / 10, "{}", pairs.len());
        assert!(pairs.iter().all(|[first, second]| first < second && *second < 600));
    }

    #[test]
    fn short_sequences_are_matched_in_full() {
        for count in [0, 1, 2, 9, 60] {
            assert_eq!(Sequence::DENSE.pairs(count).len(), count * count.saturating_sub(1) / 2, "{count}");
        }
    }

    #[test]
    fn a_sparse_sequence_has_a_fraction_of_the_pairs_around_a_loop() {
        let pairs = Sequence::SPARSE.pairs(100);
        assert!(pairs.contains(&[41, 47]) && pairs.contains(&[0, 95]), "{pairs:?}");
        assert!(pairs.len() < 100 * 99 / 2 / 4, "{}", pairs.len());
    }
}
