//! Pairs of pictures of a sequence that are matched: neighbours, pictures at powers of two, and all
//! pairs of a thinned sequence, which close loops without a vocabulary tree.

use std::collections::BTreeSet;

/// Largest number of pictures of which all pairs are matched.
pub(crate) const EXHAUSTIVE: usize = 150;
/// Number of neighbours on each side.
const OVERLAP: usize = 10;
/// Largest number of pictures in the thinned sequence.
const LOOP: usize = 60;

/// Indices of pictures to match, of each pair the smaller one first, in ascending order.
pub(crate) fn sequential(count: usize) -> Vec<[usize; 2]> {
    let near = 1..=OVERLAP;
    let far = core::iter::successors(Some(2 * OVERLAP), |gap| Some(2 * gap)).take_while(|gap| *gap < count);
    let gaps: Vec<usize> = near.chain(far).collect();
    let mut pairs: BTreeSet<[usize; 2]> = BTreeSet::new();
    for first in 0..count {
        pairs.extend(gaps.iter().map(|gap| [first, first + gap]).filter(|[_, second]| *second < count));
    }
    let thinned: Vec<usize> = (0..count).step_by(count.div_ceil(LOOP).max(1)).collect();
    for (index, first) in thinned.iter().enumerate() {
        pairs.extend(thinned[index + 1..].iter().map(|second| [*first, *second]));
    }
    pairs.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_and_ends_of_a_loop_are_matched_with_few_pairs() {
        let pairs = sequential(600);
        assert!(pairs.contains(&[17, 18]) && pairs.contains(&[17, 27]) && pairs.contains(&[0, 590]), "{pairs:?}");
        assert!(pairs.len() < 600 * 599 / 2 / 10, "{}", pairs.len());
        assert!(pairs.iter().all(|[first, second]| first < second && *second < 600));
    }

    #[test]
    fn short_sequences_are_matched_in_full() {
        for count in [0, 1, 2, 9, 60] {
            assert_eq!(sequential(count).len(), count * count.saturating_sub(1) / 2, "{count}");
        }
    }
}
