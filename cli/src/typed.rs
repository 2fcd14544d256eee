//! Values as they are typed: lists of numbers, and settings that files keep as somebody would type them.

use core::str::FromStr;

/// All numbers of a list with commas, and spaces around them; none where a part is no number.
pub(crate) fn numbers<T: FromStr>(text: &str) -> Option<Vec<T>> {
    text.split(',').map(|number| number.trim().parse().ok()).collect()
}

/// A count as people write it: 30000, 30_000, 30k, 1.5M or 3e4.
pub(crate) fn count<N: TryFrom<u64>>(text: &str) -> Result<N, String> {
    const WRONG: &str = "use a whole number, such as 30000, 30_000, 30k or 3e4";
    let digits = text.replace('_', "");
    let (digits, factor) = match digits.strip_suffix(['k', 'K', 'm', 'M']) {
        Some(digits) => (digits.to_owned(), if text.ends_with(['k', 'K']) { 1e3 } else { 1e6 }),
        None => (digits, 1.0),
    };
    let exact = digits.parse().ok().filter(|_| factor == 1.0);
    let scaled = || {
        // From here on not every whole number is one of these.
        const LARGEST: f64 = (1_u64 << 53) as f64;
        let is_plain = digits.starts_with(|letter: char| letter.is_ascii_digit() || letter == '.');
        let number = digits.parse::<f64>().ok().filter(|_| is_plain)? * factor;
        ((0.0..LARGEST).contains(&number) && number.fract() == 0.0).then_some(number as u64)
    };
    let number = exact.or_else(scaled).ok_or_else(|| WRONG.to_owned())?;
    N::try_from(number).map_err(|_| format!("{number} is too large"))
}

/// A count of at least one.
pub(crate) fn positive<N: TryFrom<u64> + Default + PartialEq>(text: &str) -> Result<N, String> {
    count(text).and_then(|number| if number == N::default() { Err("use 1 or more".into()) } else { Ok(number) })
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_read_as_people_write_them() {
        for (text, number) in [
            ("30000", 30_000),
            ("30_000", 30_000),
            ("7k", 7000),
            ("7K", 7000),
            ("1.5k", 1500),
            ("1e4", 10_000),
            ("3E4", 30_000),
            ("2M", 2_000_000),
            ("0", 0),
            ("4294967295", u32::MAX),
        ] {
            assert_eq!(count::<u32>(text), Ok(number), "{text}");
        }
        for text in
            ["", "k", "-1", "+-1", "1.5", "7q", "1e-3", "NaN", "inf", "nan_k", "4294967296", "1e300", "7 k", "kk"]
        {
            assert!(count::<u32>(text).is_err(), "{text:?} passed for a count");
        }
        assert!(count::<u32>("7q").is_err_and(|words| words.contains("30k")));
        assert_eq!(positive::<u32>("0"), Err("use 1 or more".to_owned()));
        assert_eq!(positive::<u32>("1k"), Ok(1000));
    }
}
