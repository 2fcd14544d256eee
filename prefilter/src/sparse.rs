//! Sparse matrices, row by row.

/// A linear map and its transpose.
#[derive(Debug, Default)]
pub struct Linear {
    /// The map itself.
    pub forward: Sparse,
    /// Its transpose, for gradients.
    pub transposed: Sparse,
}

/// A sparse matrix by rows.
#[derive(Debug, Default)]
pub struct Sparse {
    /// Where each row begins among the weights, and one past the last.
    pub starts: Vec<usize>,
    /// The column of each weight.
    pub columns: Vec<u32>,
    /// The weights, row by row.
    pub weights: Vec<f32>,
}

impl Linear {
    pub(crate) fn new(forward: Sparse, column_count: usize) -> Self {
        let transposed = forward.transpose(column_count);
        Self { forward, transposed }
    }
}

impl Sparse {
    /// How many rows there are.
    pub fn row_count(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }
    pub(crate) fn push(&mut self, column: usize, weight: f32) {
        self.columns.push(column as u32);
        self.weights.push(weight);
    }
    pub(crate) fn end_row(&mut self) {
        self.starts.push(self.columns.len());
    }
    pub(crate) fn join(parts: &[Self]) -> Self {
        let mut whole = Self { starts: vec![0], ..Self::default() };
        for part in parts {
            let offset = whole.columns.len();
            whole.starts.extend(part.starts[1..].iter().map(|start| start + offset));
            whole.columns.extend(&part.columns);
            whole.weights.extend(&part.weights);
        }
        whole
    }

    fn transpose(&self, column_count: usize) -> Self {
        let mut starts = vec![0; column_count + 1];
        self.columns.iter().for_each(|column| starts[*column as usize + 1] += 1);
        (0..column_count).for_each(|column| starts[column + 1] += starts[column]);
        let mut next = starts.clone();
        let (mut columns, mut weights) = (vec![0; self.columns.len()], vec![0.0; self.columns.len()]);
        for row in 0..self.row_count() {
            for tap in self.starts[row]..self.starts[row + 1] {
                let place = &mut next[self.columns[tap] as usize];
                columns[*place] = row as u32;
                weights[*place] = self.weights[tap];
                *place += 1;
            }
        }
        Self { starts, columns, weights }
    }
}
