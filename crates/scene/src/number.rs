//! Numbers as text.

/// A number of things by their singular, such as "1 picture" and "12 pictures".
pub fn counted(number: usize, thing: &str) -> String {
    format!("{} {thing}{}", group_digits(number), if number == 1 { "" } else { "s" })
}

/// Decimal digits in groups of three, separated by spaces: 1 234 567.
pub fn group_digits(number: usize) -> String {
    let digits = number.to_string();
    let groups: Vec<&str> = digits.as_bytes().rchunks(3).rev().filter_map(|group| str::from_utf8(group).ok()).collect();
    groups.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_grouped_by_thousands() {
        assert_eq!([0, 999, 1000, 1_234_567].map(group_digits), ["0", "999", "1 000", "1 234 567"]);
    }
}
