//! Values as they are typed: lists of numbers, and settings that files keep as somebody would type them.

use core::str::FromStr;

/// All numbers of a list with commas, and spaces around them; none where a part is no number.
pub(crate) fn numbers<T: FromStr>(text: &str) -> Option<Vec<T>> {
    text.split(',').map(|number| number.trim().parse().ok()).collect()
}

/// Serializes a type as it displays itself, which is how it is typed.
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
