//! Validation of an ONNX file's bytes before a runtime reads them.
//!
//! An ONNX file is a protocol-buffers message: numbered fields, with a length for text, messages
//! and packed numbers. Every length must be within its parent, every number must end, and the
//! number of fields is bounded, because each becomes a structure of hundreds of bytes. (rten 0.27
//! loops forever on a number of ten bytes without end, and seeks backwards for lengths beyond 2⁶³.)

/// Maximum number of fields: a thousand times those of the largest LPIPS network.
const FIELDS_MAX: usize = 1 << 18;
/// Maximum nesting of messages.
const DEPTH_MAX: usize = 24;
/// Maximum length of a number in bytes of seven bits.
const NUMBER_LEN: usize = 10;

/// A message type.
#[derive(Clone, Copy)]
enum Message {
    Model,
    Graph,
    Node,
    Attribute,
    Tensor,
    Value,
    Type,
    TensorType,
    Shape,
    Sequence,
    /// Message type whose fields are opaque bytes.
    Plain,
}

/// Content of a field with a length.
enum Holds {
    Message(Message),
    Numbers,
    Bytes,
}

impl Message {
    /// Content type of a field by its number.
    fn field(self, number: u64) -> Holds {
        Holds::Message(match (self, number) {
            (Self::Attribute, 8) | (Self::Tensor, 1 | 5 | 7) => return Holds::Numbers,
            (Self::Model, 7) | (Self::Attribute, 6) => Self::Graph,
            (Self::Graph, 1) => Self::Node,
            (Self::Node, 5) => Self::Attribute,
            (Self::Graph | Self::Attribute, 5) => Self::Tensor,
            (Self::Graph, 11..=13) => Self::Value,
            (Self::Value, 2) | (Self::Sequence, 1) => Self::Type,
            (Self::Type, 1) => Self::TensorType,
            (Self::Type, 4) => Self::Sequence,
            (Self::TensorType, 2) => Self::Shape,
            (Self::Model, 8 | 14) | (Self::Tensor, 13) | (Self::Shape, 1) => Self::Plain,
            _ => return Holds::Bytes,
        })
    }
}

/// Validates a file.
///
/// # Errors
///
/// The fault, as the end of a sentence.
pub(crate) fn check(bytes: &[u8]) -> Result<(), &'static str> {
    Walk { fields: FIELDS_MAX }.message(bytes, Message::Model, DEPTH_MAX)
}

struct Walk {
    /// Remaining number of fields.
    fields: usize,
}

impl Walk {
    fn message(&mut self, mut bytes: &[u8], kind: Message, depth: usize) -> Result<(), &'static str> {
        let depth = depth.checked_sub(1).ok_or("its messages are nested too deeply")?;
        while !bytes.is_empty() {
            self.fields = self.fields.checked_sub(1).ok_or("it has too many fields")?;
            let tag = number(&mut bytes)?;
            match tag & 7 {
                0 => drop(number(&mut bytes)?),
                1 => drop(part(&mut bytes, 8)?),
                5 => drop(part(&mut bytes, 4)?),
                2 => {
                    let len = number(&mut bytes)?;
                    let inside = part(&mut bytes, len)?;
                    match kind.field(tag >> 3) {
                        Holds::Message(kind) => self.message(inside, kind, depth)?,
                        Holds::Numbers => numbers(inside)?,
                        Holds::Bytes => {}
                    }
                }
                _ => return Err("it has a field of an unknown type"),
            }
        }
        Ok(())
    }
}

fn numbers(mut bytes: &[u8]) -> Result<(), &'static str> {
    while !bytes.is_empty() {
        number(&mut bytes)?;
    }
    Ok(())
}

/// Splits a number off the front.
fn number(bytes: &mut &[u8]) -> Result<u64, &'static str> {
    let longest = &bytes[..bytes.len().min(NUMBER_LEN)];
    let last = longest.iter().position(|byte| *byte < 0x80).ok_or("it has an unterminated number")?;
    if last + 1 == NUMBER_LEN && longest[last] > 1 {
        return Err("it has a number of more than 64 bits");
    }
    let value = longest[..=last].iter().rev().fold(0, |value, byte| value << 7 | u64::from(byte & 0x7f));
    *bytes = &bytes[last + 1..];
    Ok(value)
}

/// Splits bytes off the front.
fn part<'a>(bytes: &mut &'a [u8], len: u64) -> Result<&'a [u8], &'static str> {
    let len = usize::try_from(len).ok().filter(|len| *len <= bytes.len());
    let (part, rest) = bytes.split_at(len.ok_or("a field is longer than its message")?);
    *bytes = rest;
    Ok(part)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_and_numbers_must_end_within_their_message() {
        let endless = [0xff; 10];
        for (bytes, fits) in [
            (&[][..], true),
            (&[0x08, 0x96, 0x01], true),
            // A graph of one node with a name.
            (&[0x3a, 0x05, 0x0a, 0x03, 0x1a, 0x01, b'a'], true),
            (&[0x3a, 0x05, 0x0a, 0x03, 0x1a, 0x02, b'a'], false),
            (&[0x3a, 0x06, 0x0a, 0x03, 0x1a, 0x01, b'a'], false),
            // Packed dimensions of a tensor, the last of them truncated.
            (&[0x3a, 0x06, 0x2a, 0x04, 0x0a, 0x02, 0x05, 0x07], true),
            (&[0x3a, 0x06, 0x2a, 0x04, 0x0a, 0x02, 0x05, 0x87], false),
            (&[0x0d, 1, 2, 3, 4], true),
            (&[0x0d, 1, 2, 3], false),
            (&[0x0b, 0x0c], false),
            (&endless, false),
            (&[0x08, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x01], true),
            (&[0x08, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x02], false),
        ] {
            assert_eq!(check(bytes).is_ok(), fits, "{bytes:x?}: {:?}", check(bytes));
        }
    }

    #[test]
    fn fields_are_counted_at_any_depth() {
        let empty_fields = [0x42, 0x00].repeat(FIELDS_MAX);
        assert_eq!(check(&empty_fields), Ok(()));
        assert!(check(&[&empty_fields[..], &[0x42, 0x00]].concat()).unwrap_err().contains("fields"));
        // A graph nested in an attribute of a node, repeatedly.
        let mut bytes = Vec::new();
        for field in [0x32, 0x2a, 0x0a].iter().cycle().take(3 * DEPTH_MAX) {
            let len = bytes.len() as u8;
            let len = if len < 0x80 { vec![len] } else { vec![len | 0x80, len >> 7] };
            bytes = [&[*field][..], &len, &bytes].concat();
        }
        let len = bytes.len() as u8;
        assert!(len >= 0x80, "{len}");
        assert!(check(&[&[0x3a, len | 0x80, len >> 7][..], &bytes].concat()).unwrap_err().contains("messages"));
    }
}
