//! Values as text, on the command line and in files of settings.

use core::str::FromStr;

/// Parses numbers separated by commas; `None` if any part is no number.
pub(crate) fn numbers<T: FromStr>(text: &str) -> Option<Vec<T>> {
    text.split(',').map(|number| number.trim().parse().ok()).collect()
}

/// Implements `Serialize` by `Display`.
macro_rules! kept_as_typed {
    ($setting:ty) => {
        impl serde::Serialize for $setting {
            fn serialize<S: serde::Serializer>(&self, out: S) -> Result<S::Ok, S::Error> {
                out.collect_str(self)
            }
        }
    };
}
pub(crate) use kept_as_typed;
