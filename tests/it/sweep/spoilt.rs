//! Corrupted folders of sweeps are refused, or end with the same bytes.

use std::fs;

use super::{assert_equal, write_sweep};
use crate::support::Place;

/// Draws from 0 to below `most`, with a state that begins with a seed: xorshift.
fn below(state: &mut u64, most: usize) -> usize {
    *state ^= *state << 13;
    *state ^= *state >> 7;
    *state ^= *state << 17;
    (*state % most as u64) as usize
}

/// Corrupts bytes: a flipped bit, a cut, a missing byte, another digit, a repeated line, a missing line, or no bytes
/// left.
fn spoil(bytes: &mut Vec<u8>, state: &mut u64) {
    let at = below(state, bytes.len());
    let mut lines: Vec<Vec<u8>> = bytes.split_inclusive(|&byte| byte == b'\n').map(<[u8]>::to_vec).collect();
    let line = below(state, lines.len());
    match below(state, 7) {
        0 => bytes[at] ^= 1 << below(state, 8),
        1 => bytes.truncate(at),
        2 => drop(bytes.remove(at)),
        3 => {
            let digits: Vec<usize> = (0..bytes.len()).filter(|&at| bytes[at].is_ascii_digit()).collect();
            if let Some(&at) = digits.get(below(state, digits.len().max(1))) {
                bytes[at] = b'0' + (bytes[at] - b'0' + 1 + below(state, 9) as u8) % 10;
            }
        }
        4 => {
            let other = below(state, lines.len());
            lines.insert(other, lines[line].clone());
            *bytes = lines.concat();
        }
        5 => {
            lines.remove(line);
            *bytes = lines.concat();
        }
        _ => bytes.clear(),
    }
}

#[test]
fn a_corrupted_folder_is_refused_or_continued_to_the_same_bytes() {
    assert_never_silent(1..=60);
}

#[test]
#[ignore = "takes a minute"]
fn hundreds_of_corrupted_folders_are_refused_or_continued_to_the_same_bytes() {
    assert_never_silent(61..=360);
}

/// A sweep folder that is corrupted by each of the seeds is refused by `sweep` and by `merge`, or ends with the bytes
/// of the undisturbed one.
fn assert_never_silent(seeds: std::ops::RangeInclusive<u64>) {
    let place = Place::new();
    write_sweep(&place, 2);
    place.run_ok(&["sweep", "sweep.toml", "--out", "whole"]);
    let copy = |from: &str, to: &str| {
        let _ = fs::remove_dir_all(place.path(to));
        fs::create_dir(place.path(to)).unwrap();
        for entry in fs::read_dir(place.path(from)).unwrap().flatten() {
            fs::copy(entry.path(), place.path(to).join(entry.file_name())).unwrap();
        }
    };
    // A killed sweep has no results, and a part of the journal.
    copy("whole", "part");
    for name in ["results.csv", "summary.csv", "timings.csv"] {
        fs::remove_file(place.path("part").join(name)).unwrap();
    }
    let journal = fs::read(place.path("whole/journal.csv")).unwrap();
    fs::write(place.path("part/journal.csv"), &journal[..journal.len() * 2 / 3]).unwrap();
    let mut refused = 0;
    let mut tries = 0;
    for seed in seeds {
        let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        copy(["part", "whole"][below(&mut state, 2)], "spoilt");
        let mut names: Vec<_> =
            fs::read_dir(place.path("spoilt")).unwrap().flatten().map(|entry| entry.path()).collect();
        names.sort();
        // Half of the seeds corrupt the journal, which has the results.
        let journal = place.path("spoilt/journal.csv");
        let file = if below(&mut state, 2) == 0 { &journal } else { &names[below(&mut state, names.len())] };
        let mut bytes = fs::read(file).unwrap();
        if bytes.is_empty() {
            bytes.push(b'1'); // the lock
        } else {
            spoil(&mut bytes, &mut state);
        }
        fs::write(file, &bytes).unwrap();
        let _ = fs::remove_dir_all(place.path("merged"));
        for (arguments, out) in
            [(["merge", "spoilt", "--out", "merged"], "merged"), (["sweep", "sweep.toml", "--out", "spoilt"], "spoilt")]
        {
            tries += 1;
            let ended = place.run(&arguments);
            if ended.code == Some(0) {
                assert_equal(&place, "whole", out);
            } else {
                assert_eq!((ended.code, ended.stderr.lines().count()), (Some(2), 1), "seed {seed}: {ended:?}");
                refused += 1;
            }
        }
    }
    assert!(refused * 6 > tries && refused < tries, "{refused} of {tries}");
    println!("{refused} of {tries} refused, the others with the same bytes");
}

#[test]
fn a_pipe_or_an_endless_file_in_a_folder_is_refused_without_hanging() {
    let place = Place::new();
    write_sweep(&place, 1);
    for name in ["sweep.json", "sweep.toml", "scenario.toml", "journal.csv"] {
        for link in [false, true] {
            let _ = fs::remove_dir_all(place.path("odd"));
            place.run_ok(&["sweep", "sweep.toml", "--out", "odd"]);
            let file = place.path("odd").join(name);
            fs::remove_file(&file).unwrap();
            if link {
                std::os::unix::fs::symlink("/dev/zero", &file).unwrap();
            } else {
                assert!(std::process::Command::new("mkfifo").arg(&file).status().unwrap().success());
            }
            for arguments in [&["sweep", "odd"][..], &["sweep", "sweep.toml", "--out", "odd"]] {
                let ended = place.run(arguments);
                assert!(matches!(ended.code, Some(0..=2)) && ended.stderr.lines().count() <= 2, "{name}: {ended:?}");
            }
        }
    }
}
