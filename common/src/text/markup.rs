//! Text of users in Markdown and LaTeX, in which it is to read as it was typed.

/// The text in Markdown, also in a cell of a table.
#[must_use]
pub fn markdown(text: &str) -> String {
    let character = |character: char| match character {
        '&' => "&amp;".to_owned(),
        '<' => "&lt;".to_owned(),
        '>' => "&gt;".to_owned(),
        '|' | '\\' | '`' | '*' | '~' | '$' => format!("\\{character}"),
        other => other.to_string(),
    };
    text.chars().map(character).collect()
}

/// The text in LaTeX, for every engine and encoding of fonts.
#[must_use]
pub fn latex(text: &str) -> String {
    let character = |character: char| match character {
        '#' | '$' | '%' | '&' | '_' | '{' | '}' => format!("\\{character}"),
        '[' => "{[}".to_owned(), // at the start of a row it would be parsed as an argument of \\
        '\\' => "\\textbackslash{}".to_owned(),
        '|' => "\\textbar{}".to_owned(),
        '<' => "\\textless{}".to_owned(),
        '>' => "\\textgreater{}".to_owned(),
        '"' => "\\texttt{\\char34}".to_owned(), // \textquotedbl is not in OT1
        '~' => "\\textasciitilde{}".to_owned(),
        '^' => "\\textasciicircum{}".to_owned(),
        '±' => "$\\pm$".to_owned(),
        'η' => "$\\eta$".to_owned(),
        'µ' => "$\\mu$".to_owned(),
        '−' => "$-$".to_owned(),
        other => other.to_string(),
    };
    text.chars().map(character).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn special_characters_are_escaped() {
        assert_eq!(markdown("a|b <c> \"d\" & `e` *f* g_h \\"), "a\\|b &lt;c&gt; \"d\" &amp; \\`e\\` \\*f\\* g_h \\\\");
        let expected =
            r#"a\textbar{}b \textless{}c\textgreater{} \texttt{\char34}d\texttt{\char34} \& {[}e] \textbackslash{}"#;
        assert_eq!(latex("a|b <c> \"d\" & [e] \\"), expected);
        for plain in ["uts at area.side_m = 100", "0.5 [0.1, 0.9] ± 3 %", "Größe η_w"] {
            assert_eq!(markdown(plain), plain);
        }
    }
}
