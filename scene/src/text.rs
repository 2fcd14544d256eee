//! Values as text, as users write them and as files of settings keep them.

use core::str::FromStr;

/// Parses numbers separated by commas; none if any part is no number.
pub(crate) fn numbers<T: FromStr>(text: &str) -> Option<Vec<T>> {
    text.split(',').map(|number| number.trim().parse().ok()).collect()
}

/// Implements `Serialize` by `Display`.
macro_rules! serialize_as_text {
    ($value:ty) => {
        impl serde::Serialize for $value {
            fn serialize<S: serde::Serializer>(&self, out: S) -> Result<S::Ok, S::Error> {
                out.collect_str(self)
            }
        }
    };
}
pub(crate) use serialize_as_text;
