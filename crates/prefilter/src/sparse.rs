//! Sparse matrices, row by row.

use core::ops::Range;
use std::sync::OnceLock;

/// A linear map and its transpose.
#[derive(Clone, Debug, Default)]
pub struct Linear {
    /// The map itself.
    pub forward: Sparse,
    column_count: usize,
    /// Its transpose, computed for the first gradient: rendering needs none.
    transposed: OnceLock<Sparse>,
}

/// A sparse matrix by rows.
#[derive(Clone, Debug, Default)]
pub struct Sparse {
    /// Start of each row among the weights, and one past the last.
    pub starts: Vec<usize>,
    /// The column of each weight.
    pub columns: Vec<u32>,
    /// The weights, row by row.
    pub weights: Vec<f32>,
}

impl Linear {
    pub(crate) fn new(forward: Sparse, column_count: usize) -> Self {
        Self { forward, column_count, transposed: OnceLock::new() }
    }
    /// Its transpose, for gradients; built on first use.
    pub fn transposed(&self) -> &Sparse {
        self.transposed.get_or_init(|| self.forward.transpose(self.column_count))
    }
}

impl Sparse {
    /// Number of rows.
    pub fn row_count(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }
    /// Rows in as few ranges as possible, with at most this many weights each; a longer row has a
    /// range of its own.
    pub fn ranges(&self, weights_max: usize) -> Vec<Range<usize>> {
        let mut ranges = Vec::new();
        let mut first = 0;
        while first < self.row_count() {
            let end = self.starts.partition_point(|start| *start <= self.starts[first] + weights_max) - 1;
            let end = end.clamp(first + 1, self.row_count().min(first + weights_max.max(1)));
            ranges.push(first..end);
            first = end;
        }
        ranges
    }
    pub(crate) fn push(&mut self, column: usize, weight: f32) {
        self.columns.push(column as u32);
        self.weights.push(weight);
    }
    pub(crate) fn end_row(&mut self) {
        self.starts.push(self.columns.len());
    }
    pub(crate) fn join(parts: &[Self]) -> Self {
        let count = parts.iter().map(|part| part.columns.len()).sum();
        let (columns, weights) = (Vec::with_capacity(count), Vec::with_capacity(count));
        let mut whole = Self { starts: vec![0], columns, weights };
        for part in parts {
            let offset = whole.columns.len();
            whole.starts.extend(part.starts[1..].iter().map(|start| start + offset));
            whole.columns.extend(&part.columns);
            whole.weights.extend(&part.weights);
        }
        whole
    }

    /// Rows become columns.
    #[must_use]
    pub fn transpose(&self, column_count: usize) -> Self {
        let mut starts = vec![0; column_count + 1];
        self.columns.iter().for_each(|column| starts[*column as usize + 1] += 1);
        (0..column_count).for_each(|column| starts[column + 1] += starts[column]);
        let mut next = starts.clone();
        let (mut columns, mut weights) = (vec![0; self.columns.len()], vec![0.0; self.columns.len()]);
        for row in 0..self.row_count() {
            for tap in self.starts[row]..self.starts[row + 1] {
                let index = &mut next[self.columns[tap] as usize];
                columns[*index] = row as u32;
                weights[*index] = self.weights[tap];
                *index += 1;
            }
        }
        Self { starts, columns, weights }
    }
}

#[cfg(test)]
mod tests {
    use super::Sparse;

    #[test]
    fn ranges_contain_every_row_once_within_the_limit_of_weights() {
        let starts = vec![0, 3, 3, 10, 11, 12, 12, 20];
        let sparse = Sparse { columns: vec![0; 20], weights: vec![1.0; 20], starts };
        for most in 0..25 {
            let ranges = sparse.ranges(most);
            let rows: Vec<usize> = ranges.iter().flat_map(Clone::clone).collect();
            assert_eq!(rows, (0..7).collect::<Vec<usize>>(), "at most {most} weights");
            let weights = |rows: &core::ops::Range<usize>| sparse.starts[rows.end] - sparse.starts[rows.start];
            assert!(ranges.iter().all(|rows| rows.len() == 1 || weights(rows) <= most), "at most {most} weights");
        }
        assert_eq!(sparse.ranges(20).len(), 1, "all fit at once");
        assert!(Sparse::default().ranges(5).is_empty(), "there are no rows");
    }
}
