//! Tables of inputs in foreign formats with what each becomes.

/// Checks what files of this name with each of these bytes become; fails with all differences at once.
#[track_caller]
pub fn assert_outcomes<T: AsRef<[u8]>>(outcome: fn(&str, &[u8]) -> String, file: &str, cases: &[(T, &str)]) {
    let wrong: Vec<String> = cases
        .iter()
        .map(|(input, expected)| (input, outcome(file, input.as_ref()), expected))
        .filter(|(_, found, expected)| found != *expected)
        .map(|(input, found, expected)| {
            let input = String::from_utf8_lossy(input.as_ref()).into_owned();
            format!("{file}: {input:?}\n   found {found:?}\nexpected {expected:?}")
        })
        .collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
