//! Numbers as they are typed: with commas, and spaces around them.

use core::str::FromStr;

/// All of them; none where a part is no number.
pub(crate) fn numbers<T: FromStr>(text: &str) -> Option<Vec<T>> {
    text.split(',').map(|number| number.trim().parse().ok()).collect()
}
