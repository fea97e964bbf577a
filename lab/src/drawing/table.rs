//! The numbers of a figure as a table, in Markdown and for LaTeX.

use super::chart::{Chart, CurvePoint};
use crate::statistics::Support;

/// The numbers of a figure.
#[derive(Debug, Clone, PartialEq)]
pub struct NumberTable {
    /// Title above the table in Markdown, or empty.
    pub title: String,
    /// Description of the cells.
    pub about: String,
    /// Names of the columns.
    pub head: Vec<String>,
    /// Rows with one cell per column.
    pub rows: Vec<Vec<String>>,
}

impl Chart {
    /// The chart as a table.
    ///
    /// # Panics
    /// If the curves have different numbers of points.
    #[must_use]
    pub fn table(&self) -> NumberTable {
        let interval = if self.support == Support::Real { "± half of the 95 % CI" } else { "[95 % CI]" };
        let labels = self.series.iter().map(|series| series.label.clone());
        let row = |(index, point): (usize, &CurvePoint)| {
            let x = self.x_words.get(index).cloned().unwrap_or_else(|| point.x.to_string());
            let cells = self.series.iter().map(|series| series.points[index].cell(self.support));
            [x].into_iter().chain(cells).collect()
        };
        NumberTable {
            title: self.look.title.clone(),
            about: format!("{}, mean {interval}", self.y_label),
            head: [self.x_label.clone()].into_iter().chain(labels).collect(),
            rows: self.series[0].points.iter().enumerate().map(row).collect(),
        }
    }
}

impl CurvePoint {
    /// Formats the mean with its confidence interval, with decimals that depend on their magnitude. The interval is
    /// written with ± if it is symmetric, which it is for unbounded quantities only.
    pub fn cell(&self, support: Support) -> String {
        let Self { mean, limits, .. } = self;
        let size = limits.iter().flatten().fold(mean.abs(), |size, limit| size.max(limit.abs()));
        let is_small = size > 0.0 && size < 0.001;
        let digits = match mean.abs() {
            100.0.. => 0,
            1.0.. => 1,
            _ if is_small => 6,
            _ => 4,
        };
        let number = |value: f64| {
            let text = format!("{value:.digits$}");
            // No sign for −0.0000.
            text.strip_prefix('-')
                .filter(|text| text.bytes().all(|byte| b"0.".contains(&byte)))
                .unwrap_or(&text)
                .to_owned()
        };
        match limits {
            None => number(*mean),
            Some([_, high]) if support == Support::Real => format!("{} ± {}", number(*mean), number(high - mean)),
            Some([low, high]) => format!("{} [{}, {}]", number(*mean), number(*low), number(*high)),
        }
    }
}

impl NumberTable {
    /// The table in Markdown, below its title.
    #[must_use]
    pub fn markdown(&self) -> String {
        let title = if self.title.is_empty() { String::new() } else { format!("**{}**; ", self.title) };
        let line = |cells: &Vec<String>| {
            let cells: Vec<String> = cells.iter().map(|cell| cell.replace('|', "\\|")).collect();
            format!("| {} |\n", cells.join(" | "))
        };
        let rule = format!("|{}\n", " --- |".repeat(self.head.len()));
        format!("\n{title}{}\n\n", self.about)
            + &line(&self.head)
            + &rule
            + &self.rows.iter().map(line).collect::<String>()
    }

    /// The table for LaTeX with the package booktabs, after its title and `about` as a comment.
    #[must_use]
    pub fn latex(&self, about: &str) -> String {
        let line = |cells: &Vec<String>| {
            let cells: Vec<String> = cells.iter().map(|cell| latex_cell(cell)).collect();
            format!("  {} \\\\\n", cells.join(" & "))
        };
        let title = [&self.title, &self.about, about].into_iter().filter(|text| !text.is_empty());
        let comments: String = title.map(|text| format!("% {text}\n")).collect();
        let columns = "r".repeat(self.head.len());
        let rows: String = self.rows.iter().map(line).collect();
        format!("{comments}\\begin{{tabular}}{{{columns}}}\n  \\toprule\n{}  \\midrule\n{rows}", line(&self.head))
            + "  \\bottomrule\n\\end{tabular}\n"
    }
}

/// Escapes the text of a cell for every LaTeX engine.
fn latex_cell(text: &str) -> String {
    let character = |character: char| match character {
        '#' | '$' | '%' | '&' | '_' | '{' | '}' => format!("\\{character}"),
        '[' => "{[}".to_owned(), // at the start of a row it would be parsed as an argument of \\
        '\\' => "\\textbackslash{}".to_owned(),
        '~' => "\\textasciitilde{}".to_owned(),
        '^' => "\\textasciicircum{}".to_owned(),
        '±' => "$\\pm$".to_owned(),
        'η' => "$\\eta$".to_owned(),
        'µ' => "$\\mu$".to_owned(),
        '−' => "$-$".to_owned(),
        other => other.to_string(),
    };
    let is_number = text.starts_with(|first: char| first == '-' || first.is_ascii_digit());
    let text = if is_number { text.replace('-', "−") } else { text.to_owned() };
    text.chars().map(character).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn special_characters_are_escaped() {
        let cells = |cells: [&str; 2]| cells.map(str::to_owned).to_vec();
        let table = NumberTable {
            title: "Loss & more".to_owned(),
            about: "η, mean ± half".to_owned(),
            head: cells(["area.side_m", "uts|{a}"]),
            rows: vec![cells(["[50, 150]", "-0.5 ± 0.1"]), cells(["dense-urban", "50 %"])],
        };
        let markdown = "\n**Loss & more**; η, mean ± half\n\n| area.side_m | uts\\|{a} |\n| --- | --- |\n";
        assert_eq!(table.markdown(), format!("{markdown}| [50, 150] | -0.5 ± 0.1 |\n| dense-urban | 50 % |\n"));
        let expected = r"% Loss & more
% η, mean ± half
% seeds 1 to 3
\begin{tabular}{rr}
  \toprule
  area.side\_m & uts|\{a\} \\
  \midrule
  {[}50, 150] & $-$0.5 $\pm$ 0.1 \\
  dense-urban & 50 \% \\
  \bottomrule
\end{tabular}
";
        assert_eq!(table.latex("seeds 1 to 3"), expected);
    }
}
