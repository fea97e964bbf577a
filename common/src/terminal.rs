//! Text that is safe to write to a terminal, whatever file, option or other program it comes from.

use std::borrow::Cow;

/// Whether a terminal would execute the character, or let it change the order of others, instead of showing it, or
/// whether it is none.
fn is_control(character: char) -> bool {
    let is_directional = matches!(character, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2066}'..='\u{2069}');
    character.is_control() || is_directional || matches!(character, '\u{2028}'..='\u{202e}' | '\u{fffe}' | '\u{ffff}')
}

/// The text with its control characters escaped as in JSON and TOML (`\u001b`), except line breaks and tabs.
#[must_use]
pub fn printable(text: &str) -> Cow<'_, str> {
    escaped(text, |character| is_control(character) && !matches!(character, '\n' | '\t'))
}

/// The text on one line, control characters escaped: only its beginning and its end if it has more than `limit`
/// characters.
#[must_use]
pub fn one_line(text: &str, limit: usize) -> String {
    shortened(&escaped(text, is_control), limit)
}

fn escaped(text: &str, is_escaped: impl Fn(char) -> bool) -> Cow<'_, str> {
    if !text.contains(&is_escaped) {
        return Cow::Borrowed(text);
    }
    let mut escaped = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '\n' | '\r' | '\t' if is_escaped(character) => escaped.extend(character.escape_default()),
            _ if is_escaped(character) => escaped += &format!("\\u{:04x}", u32::from(character)),
            _ => escaped.push(character),
        }
    }
    Cow::Owned(escaped)
}

/// The text, or only its beginning and its end if it has more than `limit` characters.
#[must_use]
pub fn shortened(text: &str, limit: usize) -> String {
    let count = text.chars().count();
    if count <= limit {
        return text.to_owned();
    }
    let beginning: String = text.chars().take(limit / 2).collect();
    let end: String = text.chars().skip(count - limit / 2).collect();
    format!("{beginning} ... {end}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn terminal_control_sequences_are_escaped() {
        let text = "\x1b]0;title\x07 \u{9b}31m \u{202e}txt.exe\u{2066} 1\r2\t3\n4 µs η ✓";
        let safe = "\\u001b]0;title\\u0007 \\u009b31m \\u202etxt.exe\\u2066 1\\r2\t3\n4 µs η ✓";
        assert_eq!(printable(text), safe);
        assert_eq!(one_line(text, 100), safe.replace('\t', "\\t").replace('\n', "\\n"));
        assert_eq!(one_line("0123456789", 4), "01 ... 89");
        assert!(matches!(printable("1 µs\n"), Cow::Borrowed(_)));
    }

    #[test]
    fn escaping_preserves_the_toml_value() {
        let table = toml::Table::from_iter([("\u{202e}name\x7f".to_owned(), "a\u{9b}\x1b\n".into())]);
        let text = table.to_string();
        let safe = printable(&text);
        assert!(!safe.chars().any(|character| is_control(character) && character != '\n'), "{safe}");
        assert_eq!(safe.parse::<toml::Table>().unwrap(), table);
    }
}
