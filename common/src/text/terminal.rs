//! Text that is safe to write to a terminal, or to copy from it into a shell, whatever file, option or other program it
//! comes from.

use std::borrow::Cow;
use std::ffi::OsStr;
use std::fmt::Write as _;
use std::os::unix::ffi::OsStrExt as _;
use std::path::Path;

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

/// A word of a printed command, quoted for a shell where that is necessary.
///
/// A word with control characters, or that is not UTF-8, is written as `$'…'` (POSIX 2024; bash, zsh and ksh know it),
/// so that a terminal shows it as it is copied.
#[must_use]
pub fn shell_word(word: impl AsRef<OsStr>) -> String {
    let bytes = word.as_ref().as_bytes();
    let text = str::from_utf8(bytes).ok().filter(|text| !text.contains(is_control));
    let quoted = text.and_then(|text| shlex::try_quote(text).ok());
    quoted.map_or_else(|| escaped_word(bytes), Cow::into_owned)
}

/// A path in a printed command, as [`shell_word`]; one that begins like an option follows `./`.
#[must_use]
pub fn shell_path(path: &Path) -> String {
    match path.as_os_str().as_bytes() {
        [b'-', ..] => shell_word(Path::new(".").join(path)),
        _ => shell_word(path),
    }
}

/// Bytes in `$'…'`, those that are no printable text as octal numbers.
fn escaped_word(bytes: &[u8]) -> String {
    let mut word = "$'".to_owned();
    let push_octal = |word: &mut String, bytes: &[u8]| {
        bytes.iter().for_each(|byte| write!(word, "\\{byte:03o}").expect("a string has room"));
    };
    for chunk in bytes.utf8_chunks() {
        for character in chunk.valid().chars() {
            match character {
                '\'' | '\\' => word.extend(['\\', character]),
                _ if is_control(character) => push_octal(&mut word, character.encode_utf8(&mut [0; 4]).as_bytes()),
                _ => word.push(character),
            }
        }
        push_octal(&mut word, chunk.invalid());
    }
    word + "'"
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;

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
    fn a_shell_reads_a_quoted_word_as_it_was() {
        let plain = r##"runs/letter-uts-1

s'w $x
a b
a"b'c
back\slash\
a;b&c|d<e>f
*?[a-z]{b,c}
#no comment
~root
$(touch pwned)`id`
!history^
(a)
=ls
%1
-x
Größe µ 测
\'
it's \n"##;
        let escaped: [&[u8]; 6] =
            [b"two\nlines\n", b"\x1b]0;title\x07", b"\xff'\\\xfe0", "txt.\u{202e}exe".as_bytes(), b"\t", b"\x7f1"];
        // dash, which is the sh of some systems, does not know $'…' yet.
        let plain = plain.lines().map(|word| ("sh", word.as_bytes()));
        for (shell, word) in plain.chain(escaped.map(|word| ("bash", word))) {
            let quoted = shell_word(OsStr::from_bytes(word));
            let read = Command::new(shell).args(["-c", &format!("printf %s {quoted}")]).output().unwrap();
            assert_eq!(read.stdout, word, "{quoted}");
            assert!(printable(&quoted) == quoted && quoted.lines().count() == 1, "{quoted}");
        }
        assert_eq!(shell_word("runs/letter-uts-1"), "runs/letter-uts-1");
        assert_eq!(shell_word("s'w $x"), r#""s'w "'$x'"#);
        assert_eq!(shell_word("a\n1"), r"$'a\0121'");
        let paths = ["-x", "--out/run", "a-x", "/-x"].map(|path| shell_path(Path::new(path)));
        assert_eq!(paths, ["./-x", "./--out/run", "a-x", "/-x"]);
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
