//! Inputs out of inputs: bits flipped, pieces moved, and tokens put in that are known to matter.

use rand::RngExt;
use rand::seq::IndexedRandom;
use rand_chacha::ChaCha8Rng;

use crate::targets::Input;

/// Longest input [byte].
pub const LONGEST: usize = 4096;

/// Most changes between an input of the corpus and what is made of it.
const MOST_CHANGES: u32 = 8;

/// Words of the files that people write, and numbers that are easy to forget.
const WORDS: &str = include_str!("words.txt");

/// Floats that are easy to forget, and such as the small scenarios of the targets can use.
const FLOATS: [f64; 24] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    1e-9,
    5e-324,
    f64::MIN_POSITIVE,
    f64::MAX,
    f64::MIN,
    f64::INFINITY,
    f64::NEG_INFINITY,
    f64::NAN,
    10.0,
    20.0,
    25.0,
    30.0,
    40.0,
    50.0,
    59.999_999_999,
    60.0,
    60.000_000_06,
    100.0,
    120.0,
    1e10,
];

/// Integers that are easy to forget.
const INTEGERS: [u64; 16] = [
    0,
    1,
    2,
    3,
    9,
    10,
    63,
    64,
    65,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
    1 << 32,
    1 << 53,
    i64::MAX.cast_unsigned(),
    u64::MAX,
];

/// An input out of the corpus, changed in a few places.
///
/// # Panics
/// If the corpus is empty.
#[must_use]
pub fn mutate(corpus: &[Vec<u8>], kind: Input, random: &mut ChaCha8Rng) -> Vec<u8> {
    let mut bytes = corpus.choose(random).expect("a corpus has at least one input").clone();
    for _ in 0..random.random_range(1..=MOST_CHANGES) {
        change(&mut bytes, corpus, kind, random);
    }
    bytes.truncate(LONGEST);
    bytes
}

fn change(bytes: &mut Vec<u8>, corpus: &[Vec<u8>], kind: Input, random: &mut ChaCha8Rng) {
    let place = random.random_range(0..=bytes.len());
    let piece = piece(bytes.len(), random);
    match random.random_range(0..10) {
        0 | 1 => overwrite(bytes, kind, random),
        2 => insert(bytes, place, &token(kind, random)),
        3 => {
            bytes.drain(piece);
        }
        4 => {
            let copy = bytes[piece].to_vec();
            insert(bytes, place, &copy);
        }
        5 => bytes.truncate(place),
        6 => {
            let other = corpus.choose(random).expect("a corpus has at least one input");
            bytes.truncate(place);
            bytes.extend_from_slice(&other[random.random_range(0..=other.len())..]);
        }
        7 => lend_a_line(bytes, corpus.choose(random).expect("a corpus has at least one input"), random),
        8 => bytes.iter_mut().skip(place).take(1).for_each(|byte| *byte ^= 1 << random.random_range(0..8)),
        _ => bytes.iter_mut().skip(place).take(1).for_each(|byte| *byte = random.random()),
    }
}

/// A short piece of so many bytes.
fn piece(length: usize, random: &mut ChaCha8Rng) -> std::ops::Range<usize> {
    let start = random.random_range(0..=length);
    let end = length.min(start + (1 << random.random_range(0..8)));
    start..end
}

fn insert(bytes: &mut Vec<u8>, place: usize, new: &[u8]) {
    bytes.splice(place..place, new.iter().copied());
}

/// A token instead of a number or a word, or, among numbers, of as many bytes.
fn overwrite(bytes: &mut Vec<u8>, kind: Input, random: &mut ChaCha8Rng) {
    let token = token(kind, random);
    let start = random.random_range(0..=bytes.len());
    let end = match kind {
        Input::Binary => bytes.len().min(start + token.len()),
        Input::Text => {
            let of_word = |byte: &u8| byte.is_ascii_alphanumeric() || b"._-+".contains(byte);
            start + bytes[start..].iter().take_while(|byte| of_word(byte)).count()
        }
    };
    let begin = match kind {
        Input::Binary => start,
        Input::Text => start - bytes[..start].iter().rev().take_while(|byte| !b" ,=[\n".contains(byte)).count(),
    };
    bytes.splice(begin..end, token);
}

/// A line of `other` after a line; in binary inputs the bytes up to the next 10.
fn lend_a_line(bytes: &mut Vec<u8>, other: &[u8], random: &mut ChaCha8Rng) {
    let lines: Vec<&[u8]> = other.split_inclusive(|&byte| byte == b'\n').collect();
    let Some(line) = lines.choose(random) else { return };
    let ends: Vec<usize> = bytes.iter().enumerate().filter(|&(_, &byte)| byte == b'\n').map(|(i, _)| i + 1).collect();
    let place = ends.choose(random).copied().unwrap_or(0);
    insert(bytes, place, line);
}

fn token(kind: Input, random: &mut ChaCha8Rng) -> Vec<u8> {
    match kind {
        Input::Text => {
            let words: Vec<&str> = WORDS.lines().collect();
            words.choose(random).expect("there are words").replace("\\n", "\n").into_bytes()
        }
        Input::Binary => match random.random_range(0..3) {
            0 => FLOATS.choose(random).expect("there are floats").to_le_bytes().to_vec(),
            1 => INTEGERS.choose(random).expect("there are integers").to_le_bytes().to_vec(),
            _ => (*INTEGERS.choose(random).expect("there are integers") as u32).to_le_bytes().to_vec(),
        },
    }
}
