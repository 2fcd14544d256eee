//! Work in parts: data in pieces of any lengths, which threads visit without a list of pieces.

/// Data that can be split in two.
pub(crate) trait Parts: Sized + Send {
    /// The first `count` parts, and the rest.
    fn split(self, count: usize) -> (Self, Self);
}

/// Slice that a function divides into parts.
pub(crate) struct Pieces<'a, T> {
    values: &'a mut [T],
    first: usize,
    /// Start of a part in the whole slice.
    start_of: &'a (dyn Fn(usize) -> usize + Sync),
}

impl<'a, T> Pieces<'a, T> {
    /// Slice with parts that begin at `start_of(k)`, the first at 0.
    pub(crate) fn new(values: &'a mut [T], start_of: &'a (dyn Fn(usize) -> usize + Sync)) -> Self {
        Self { values, first: 0, start_of }
    }
    /// The only remaining part.
    pub(crate) fn only(self) -> &'a mut [T] {
        self.values
    }
}

impl<T: Send> Parts for Pieces<'_, T> {
    fn split(self, count: usize) -> (Self, Self) {
        let middle = self.first + count;
        let (values, rest) = self.values.split_at_mut((self.start_of)(middle) - (self.start_of)(self.first));
        (Self { values, ..self }, Self { values: rest, first: middle, start_of: self.start_of })
    }
}

impl<A: Parts, B: Parts> Parts for (A, B) {
    fn split(self, count: usize) -> (Self, Self) {
        let ((a, a_rest), (b, b_rest)) = (self.0.split(count), self.1.split(count));
        ((a, b), (a_rest, b_rest))
    }
}

/// Visits each of `count` parts, on the threads of the pool.
pub(crate) fn each_part<P: Parts>(count: usize, parts: P, visit: &(impl Fn(usize, P) + Sync)) {
    if count > 0 {
        halve(0, count, parts, visit);
    }
}

fn halve<P: Parts>(first: usize, count: usize, parts: P, visit: &(impl Fn(usize, P) + Sync)) {
    if count == 1 {
        return visit(first, parts);
    }
    let half = count / 2;
    let (low, high) = parts.split(half);
    rayon::join(|| halve(first, half, low, visit), || halve(first + half, count - half, high, visit));
}

#[cfg(test)]
mod tests {
    use super::{Pieces, each_part};

    #[test]
    fn every_part_is_visited_once() {
        let starts = [0, 3, 3, 7, 8];
        let mut values = [0; 8];
        let start_of = |part: usize| starts[part];
        each_part(4, Pieces::new(&mut values, &start_of), &|part, piece: Pieces<'_, usize>| {
            piece.only().iter_mut().for_each(|value| *value += part + 1);
        });
        assert_eq!(values, [1, 1, 1, 3, 3, 3, 3, 4], "each part has its own number");
    }
}
