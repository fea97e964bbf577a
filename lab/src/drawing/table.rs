//! The numbers of a figure as a table, in Markdown and for LaTeX.

use super::chart::{Chart, CurvePoint};
use crate::statistics::{limits_text, told_decimals};
use skysink_common::figure::Support;
use skysink_common::markup::{latex, markdown};

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
    pub fn table(&self, cells: TableCells) -> NumberTable {
        let interval = match cells {
            TableCells::Means => "",
            TableCells::Intervals if self.support == Support::Real => " ± half of the 95 % CI",
            TableCells::Intervals => " [95 % CI]",
        };
        let labels = self.series.iter().map(|series| series.label.clone());
        let row = |(index, point): (usize, &CurvePoint)| {
            let x = self.x_words.get(index).cloned().unwrap_or_else(|| point.x.to_string());
            let cells = self.series.iter().map(|series| series.points[index].told(cells).cell(self.support));
            [x].into_iter().chain(cells).collect()
        };
        NumberTable {
            title: self.look.title.clone(),
            about: format!("{}, mean{interval}", self.y_label),
            head: [self.x_label.clone()].into_iter().chain(labels).collect(),
            rows: self.series[0].points.iter().enumerate().map(row).collect(),
        }
    }
}

/// What the cells of a table say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TableCells {
    /// Means with their intervals.
    Intervals,
    /// Means alone.
    Means,
}

impl CurvePoint {
    /// What is told of it.
    fn told(self, cells: TableCells) -> Self {
        Self { limits: self.limits.filter(|_| cells == TableCells::Intervals), ..self }
    }

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
        // A symmetric interval must show whether it contains 0.
        let half = limits.filter(|_| support == Support::Real).map(|[_, high]| high - mean);
        let is_told = |digits: &usize| {
            half.is_none_or(|half| {
                half == mean.abs() || format!("{half:.digits$}") != format!("{:.digits$}", mean.abs())
            })
        };
        let digits = (digits..digits + 6).find(is_told).unwrap_or(digits);
        let digits = limits.and_then(|limits| told_decimals(limits, digits)).unwrap_or(digits);
        let number = |value: f64| {
            let text = format!("{value:.digits$}");
            // No sign for −0.0000.
            text.strip_prefix('-')
                .filter(|text| text.bytes().all(|byte| b"0.".contains(&byte)))
                .unwrap_or(&text)
                .to_owned()
        };
        match (half, limits) {
            (_, None) => number(*mean),
            (Some(half), _) => format!("{} ± {}", number(*mean), number(half)),
            (None, Some(limits)) => format!("{} {}", number(*mean), limits_text(*limits, digits)),
        }
    }
}

impl NumberTable {
    /// The table in Markdown, below its title.
    pub fn markdown(&self) -> String {
        let title = if self.title.is_empty() { String::new() } else { format!("**{}**; ", markdown(&self.title)) };
        let line = |cells: &Vec<String>| {
            let cells: Vec<String> = cells.iter().map(|cell| markdown(cell)).collect();
            format!("| {} |\n", cells.join(" | "))
        };
        let rule = format!("|{}\n", " --- |".repeat(self.head.len()));
        format!("\n{title}{}\n\n", markdown(&self.about))
            + &line(&self.head)
            + &rule
            + &self.rows.iter().map(line).collect::<String>()
    }

    /// The table for LaTeX with the package booktabs, after its title and `about` as a comment. If it is wider than
    /// `room_pt` [pt], each cell has a line of its own.
    pub fn latex(&self, about: &str, room_pt: Option<f64>) -> String {
        if room_pt.is_some_and(|room_pt| self.width_pt() > room_pt) {
            return self.narrow().latex(about, None);
        }
        let line = |cells: &Vec<String>| {
            let cells: Vec<String> = cells.iter().map(|cell| latex_cell(cell)).collect();
            format!("  {} \\\\\n", cells.join(" & "))
        };
        let title = [&self.title, &self.about, about].into_iter().filter(|text| !text.is_empty());
        let comments: String = title.map(|text| format!("% {text}\n")).collect();
        let columns = "r".repeat(self.head.len());
        let rows: String = self.rows.iter().map(line).collect();
        let head = line(&self.head);
        format!("{comments}\\begin{{tabular}}{{{columns}}}\n  \\toprule\n{head}  \\midrule\n{rows}")
            + "  \\bottomrule\n\\end{tabular}\n"
    }
}

/// Approximate width of a character of 8 pt, and of the space between two columns [pt].
const CHARACTER_PT: f64 = 4.25;
const GAP_PT: f64 = 12.0;

impl NumberTable {
    /// Approximate width of the table in print [pt].
    fn width_pt(&self) -> f64 {
        let width = |column: usize| {
            let cells = self.rows.iter().chain([&self.head]).map(|row| row[column].chars().count());
            cells.max().unwrap_or(0) as f64 * CHARACTER_PT
        };
        (0..self.head.len()).map(width).sum::<f64>() + GAP_PT * self.head.len() as f64
    }

    /// The table with a line for each cell, below the x value of its first.
    fn narrow(&self) -> Self {
        let cells = |row: &Vec<String>| -> Vec<Vec<String>> {
            let x = |index: usize| if index == 0 { row[0].clone() } else { String::new() };
            let cells = self.head[1..].iter().zip(&row[1..]).enumerate();
            cells.map(|(index, (label, cell))| vec![x(index), label.clone(), cell.clone()]).collect()
        };
        let head = vec![self.head[0].clone(), String::new(), self.about.clone()];
        let rows = self.rows.iter().flat_map(cells).collect();
        Self { title: self.title.clone(), about: String::new(), head, rows }
    }
}

/// The text of a cell in LaTeX; that of a number has minus signs.
fn latex_cell(text: &str) -> String {
    let is_number = text.starts_with(|first: char| first == '-' || first.is_ascii_digit());
    if is_number { latex(&text.replace('-', "−")) } else { latex(text) }
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
        let markdown = "\n**Loss &amp; more**; η, mean ± half\n\n| area.side_m | uts\\|{a} |\n| --- | --- |\n";
        assert_eq!(table.markdown(), format!("{markdown}| [50, 150] | -0.5 ± 0.1 |\n| dense-urban | 50 % |\n"));
        let expected = r"% Loss & more
% η, mean ± half
% seeds 1 to 3
\begin{tabular}{rr}
  \toprule
  area.side\_m & uts\textbar{}\{a\} \\
  \midrule
  {[}50, 150] & $-$0.5 $\pm$ 0.1 \\
  dense-urban & 50 \% \\
  \bottomrule
\end{tabular}
";
        assert_eq!(table.latex("seeds 1 to 3", None), expected);
        assert_eq!(table.latex("seeds 1 to 3", Some(250.0)), expected);
    }

    #[test]
    fn a_table_too_wide_for_the_page_has_a_line_per_cell() {
        let cells = |cells: &[&str]| cells.iter().map(|cell| (*cell).to_owned()).collect::<Vec<_>>();
        let interval = "0.0163 [0.0151, 0.0175]";
        let table = NumberTable {
            title: String::new(),
            about: "η".to_owned(),
            head: cells(&["side [m]", "uts", "gfs", "rfs"]),
            rows: vec![cells(&["100", interval, interval, interval]), cells(&["200", interval, interval, interval])],
        };
        assert!(table.latex("", Some(500.0)).contains("side {[}m] & uts & gfs & rfs"));
        let narrow = table.latex("", Some(250.0));
        let lines: Vec<&str> = narrow.lines().filter(|line| line.contains('&')).collect();
        assert_eq!(lines.len(), 7, "{narrow}");
        assert_eq!(lines[0], "  side {[}m] &  & $\\eta$ \\\\");
        assert_eq!(lines[1], "  100 & uts & 0.0163 {[}0.0151, 0.0175] \\\\");
        assert_eq!(lines[2], "   & gfs & 0.0163 {[}0.0151, 0.0175] \\\\");
        assert!(table.narrow().width_pt() < 250.0);
    }
}
