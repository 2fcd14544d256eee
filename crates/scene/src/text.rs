//! Values as text, for options and settings files; escaping of text from files.

use core::str::FromStr;
use std::path::Path;

/// Text with JSON escapes for characters that move the cursor, colour a terminal, begin lines or
/// change the reading direction: names from files could forge output.
pub fn printable(text: &str) -> String {
    let mut shown = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '\n' => shown.push_str("\\n"),
            '\r' => shown.push_str("\\r"),
            '\t' => shown.push_str("\\t"),
            _ if letter.is_control() || is_format(letter) => shown.push_str(&format!("\\u{:04x}", u32::from(letter))),
            _ => shown.push(letter),
        }
    }
    shown
}

/// True if a character separates lines or changes the reading direction.
const fn is_format(letter: char) -> bool {
    matches!(letter, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// Path for display.
pub fn shown(path: &Path) -> String {
    printable(&path.to_string_lossy())
}

/// Parses numbers separated by commas; `None` if any part is not a number.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_escaped_as_in_json() {
        let hostile = "a\r\n\t\x1b]0;b\x07\u{9b}2J\u{202e}\u{2066}\u{2028}\x7f";
        let shown = printable(hostile);
        assert_eq!(shown, "a\\r\\n\\t\\u001b]0;b\\u0007\\u009b2J\\u202e\\u2066\\u2028\\u007f");
        assert_eq!(serde_json::from_str::<String>(&format!("\"{shown}\"")).unwrap(), hostile, "JSON stays JSON");
        for harmless in ["", "Vögel/日本 – \"1\" ² …"] {
            assert_eq!(printable(harmless), harmless);
        }
    }
}
