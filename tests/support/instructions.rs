//! Instructions per step, counted by valgrind and held against limits: unlike time, they do not depend on what else the
//! machine does.
//!
//! A test program made with this, without the usual harness, calls itself under `valgrind --tool=callgrind` once per
//! case and counts inside [`counted`] only. Without valgrind its tests are ignored.
//!
//! Limits are kept in a text file, one line per case, for both profiles: `cargo test` builds with little optimisation,
//! which shows a step that does more work; `cargo test --release` shows code that is compiled worse. They hold for the
//! compiler that the file names; another one is allowed twice as many.

use std::path::Path;
use std::process::{Command, ExitCode, Stdio};

use libtest_mimic::{Arguments, Completion, Failed, Trial};

/// What is counted.
#[derive(Clone, Copy)]
pub struct Case {
    /// Its name in the file of limits.
    pub name: &'static str,
    /// Calls of [`counted`] in `work`.
    pub steps: u64,
    /// Makes what it needs, and hands each step to [`counted`].
    pub work: fn(),
}

/// Room [%] between what was measured and the limit.
const HEAD_ROOM_PERCENT: u64 = 10;

/// Which column of the file counts.
const PROFILE: &str = if cfg!(debug_assertions) { "dev" } else { "release" };

/// The one function whose instructions count, and those of what it calls.
#[inline(never)]
pub fn counted<R>(step: impl FnOnce() -> R) -> R {
    step()
}

/// The program: checks all cases, or with `--refresh` writes the limits of this profile anew.
///
/// # Panics
/// If the limits cannot be read or written.
pub fn main(cases: &[Case], limits: &Path) -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let [flag, name] = &arguments[..]
        && flag == "--count"
    {
        (cases.iter().find(|case| case.name == name).expect("a case of that name").work)();
        return ExitCode::SUCCESS;
    }
    let text = std::fs::read_to_string(limits).expect("the limits lie beside the test");
    if arguments == ["--refresh"] {
        let limits_of = |case: &Case| count(case) * (100 + HEAD_ROOM_PERCENT) / 100;
        let refreshed = refreshed(&text, cases, &cases.iter().map(limits_of).collect::<Vec<_>>());
        std::fs::write(limits, refreshed).expect("the limits can be written");
        return ExitCode::SUCCESS;
    }
    let factor = if text.contains(&format!("compiler {}\n", compiler())) { 1 } else { 2 };
    let trial = |case: &Case| {
        let limit = factor * limit(&text, case.name).expect("a limit for every case");
        let case = *case;
        Trial::ignorable_test(case.name, move || check(&case, limit))
    };
    libtest_mimic::run(&Arguments::from_args(), cases.iter().map(trial).collect()).exit_code()
}

/// Fails if a step of the case takes more instructions than the limit.
fn check(case: &Case, limit: u64) -> Result<Completion, Failed> {
    if !cfg!(target_arch = "x86_64") {
        return Ok(Completion::ignored_with("the limits are for x86-64"));
    }
    if !Command::new("valgrind").arg("--version").stdout(Stdio::null()).status().is_ok_and(|status| status.success()) {
        return Ok(Completion::ignored_with("needs valgrind: apt install valgrind"));
    }
    match count(case) {
        count if count > limit => Err(format!("{count} instructions per step: expected at most {limit}").into()),
        _ => Ok(Completion::Completed),
    }
}

/// Instructions per step of a case.
fn count(case: &Case) -> u64 {
    let program = std::env::current_exe().expect("a program knows its file");
    let counts = program.with_extension(format!("{}.{}.callgrind", std::process::id(), case.name));
    let valgrind = Command::new("valgrind")
        .args(["--tool=callgrind", "--collect-atstart=no", "--toggle-collect=*instructions*counted*"])
        .arg(format!("--callgrind-out-file={}", counts.display()))
        .arg(program)
        .args(["--count", case.name])
        .output()
        .expect("valgrind is there");
    let said = String::from_utf8_lossy(&valgrind.stderr);
    assert!(valgrind.status.success(), "{}: {said}", case.name);
    let text = std::fs::read_to_string(&counts).expect("callgrind writes its counts");
    std::fs::remove_file(&counts).expect("it was there");
    let total = text.lines().find_map(|line| line.strip_prefix("totals: ")).expect("callgrind ends with its totals");
    let total: u64 = total.trim().parse().expect("a number of instructions");
    assert!(total > 0, "{}: nothing was counted", case.name);
    total / case.steps
}

/// The name and version of the compiler; nothing where it does not say.
fn compiler() -> String {
    let said = Command::new("rustc").arg("--version").output().map(|output| output.stdout).unwrap_or_default();
    String::from_utf8_lossy(&said).split_whitespace().take(2).collect::<Vec<_>>().join(" ")
}

/// The limit of a case in this profile: lines are `profile, instructions, name`.
fn limit(text: &str, name: &str) -> Option<u64> {
    text.lines().find_map(|line| {
        let (profile, rest) = line.split_once(' ')?;
        let (limit, of) = rest.trim_start().split_once(' ')?;
        (profile == PROFILE && of.trim_start() == name).then(|| limit.parse().expect("a limit is a number"))
    })
}

/// The file with the limits of this profile replaced, and the compiler.
fn refreshed(text: &str, cases: &[Case], limits: &[u64]) -> String {
    let outdated = |line: &&str| line.starts_with(PROFILE) || line.starts_with("compiler ");
    let mut lines: Vec<String> = text.lines().filter(|line| !outdated(line)).map(str::to_owned).collect();
    let comments = lines.iter().take_while(|line| line.starts_with('#')).count();
    lines.insert(comments, format!("compiler {}", compiler()));
    lines.extend(cases.iter().zip(limits).map(|(case, limit)| format!("{PROFILE} {limit} {}", case.name)));
    lines.join("\n") + "\n"
}
