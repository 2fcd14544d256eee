//! Data of the page templates.

/// Table of a page.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct HtmlTable {
    pub(crate) heads: Vec<String>,
    /// Cells of each row, one per head.
    pub(crate) rows: Vec<Vec<String>>,
}

impl HtmlTable {
    /// Table with these heads and rows.
    pub(crate) fn new<const N: usize>(heads: [&str; N], rows: impl IntoIterator<Item = [String; N]>) -> Self {
        Self { heads: heads.map(str::to_owned).into(), rows: rows.into_iter().map(Vec::from).collect() }
    }

    /// Rows, starting with the heads.
    pub(crate) fn with_heads<const N: usize>(rows: &[[String; N]]) -> Self {
        let mut rows = rows.iter().map(|row| row.to_vec());
        Self { heads: rows.next().unwrap_or_default(), rows: rows.collect() }
    }
}
