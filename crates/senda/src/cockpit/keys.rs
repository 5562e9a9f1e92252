//! What a terminal sends when keys are pressed.

use senda_drivers::manual::Key;

/// Reads a terminal's bytes, which may break anywhere within a key.
#[derive(Debug, Default)]
pub(super) struct KeyReader {
    state: State,
}

#[derive(Debug, Default, Clone, Copy)]
enum State {
    #[default]
    Plain,
    /// After the escape character.
    Escape,
    /// After `ESC [` or `ESC O`; other keys' sequences go on until a letter or `~`.
    Sequence,
}

impl KeyReader {
    /// Adds the keys that these bytes complete.
    pub(super) fn read(&mut self, bytes: &[u8], keys: &mut Vec<Key>) {
        for byte in bytes {
            let key;
            (self.state, key) = match (self.state, byte) {
                (_, 0x1b) => (State::Escape, None),
                (State::Escape, b'[' | b'O') => (State::Sequence, None),
                (State::Sequence, b'A') => (State::Plain, Some(Key::Go)),
                (State::Sequence, b'B') => (State::Plain, Some(Key::Stop)),
                (State::Sequence, b'C') => (State::Plain, Some(Key::Right)),
                (State::Sequence, b'D') => (State::Plain, Some(Key::Left)),
                (State::Sequence, b'0'..=b'9' | b';') => (State::Sequence, None),
                (State::Sequence, _) => (State::Plain, None),
                (State::Plain | State::Escape, byte) => (State::Plain, plain(*byte)),
            };
            keys.extend(key);
        }
    }
}

fn plain(byte: u8) -> Option<Key> {
    Some(match byte {
        b'a' | b'A' | b'h' => Key::Left,
        b'd' | b'D' | b'l' => Key::Right,
        b'w' | b'W' | b'g' => Key::Go,
        b's' | b'S' | b' ' => Key::Stop,
        b'c' | b'x' => Key::Straight,
        b'+' | b'=' => Key::Faster,
        b'-' | b'_' => Key::Slower,
        // Ctrl-C and Ctrl-D as well: in this mode the terminal hands them on.
        b'q' | b'Q' | 0x03 | 0x04 => Key::Quit,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(bytes: &[u8]) -> Vec<Key> {
        let mut keys = Vec::new();
        KeyReader::default().read(bytes, &mut keys);
        keys
    }

    #[test]
    fn arrows_letters_and_control_c() {
        assert_eq!(
            keys(b"\x1b[A\x1b[D\x1bOC\x1b[B"),
            [Key::Go, Key::Left, Key::Right, Key::Stop]
        );
        assert_eq!(
            keys(b"wad c+-q\x03"),
            [
                Key::Go,
                Key::Left,
                Key::Right,
                Key::Stop,
                Key::Straight,
                Key::Faster,
                Key::Slower,
                Key::Quit,
                Key::Quit
            ]
        );
    }

    #[test]
    fn a_key_that_arrives_in_pieces_is_one_key() {
        let mut reader = KeyReader::default();
        let mut keys = Vec::new();
        for byte in b"\x1b[D" {
            reader.read(&[*byte], &mut keys);
        }
        assert_eq!(keys, [Key::Left]);
    }

    #[test]
    fn other_keys_do_nothing_and_swallow_nothing() {
        // Delete, F5, control and an arrow, a letter of another alphabet; then one that counts.
        assert_eq!(keys(b"\x1b[3~\x1b[15~a"), [Key::Left]);
        assert_eq!(keys(b"\x1b[1;5D"), [Key::Left]);
        assert_eq!(keys("äß€d".as_bytes()), [Key::Right]);
        assert_eq!(keys(b"\x1bd"), [Key::Right]);
        let all: Vec<u8> = (0..=255).collect();
        keys(&all);
    }
}
