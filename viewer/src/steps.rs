//! Stepped colour scales with round limits, and their legend entries.

use re_sdk_types::archetypes::AnnotationContext;
use re_sdk_types::datatypes::AnnotationInfo;

use crate::colour::{self, Rgb};

/// Slack of the highest value that is compared with an edge, relative to it.
const EDGE_SLACK: f64 = 1e-9;

/// Slack of a full buffer [%].
const FULL_SLACK_PERCENT: f64 = 1e-9;

/// A stepped colour scale. Step 0 ends at the first edge; the last step starts at the last edge.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Steps {
    edges: Vec<f64>,
    /// All steps, for a legend.
    pub(crate) entries: Vec<ScaleStep>,
}

/// Name and colour of a step.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ScaleStep {
    pub(crate) name: String,
    pub(crate) colour: Rgb,
}

/// Edges between 0 and the highest value.
const EDGES: usize = 6;

impl Steps {
    /// Steps from 0 to `highest` with round limits, finer for lower values. 0 has its own step, `zero`. `colour` maps 0
    /// to 1 to the colours of the other steps.
    pub(crate) fn of(highest: f64, unit: &str, zero: ScaleStep, colour: impl Fn(f64) -> Rgb) -> Self {
        let edges: Vec<f64> = std::iter::once(0.0).chain(round_edges(highest)).collect();
        let between = edges.windows(2).map(|ends| format!("{} to {} {unit}", ends[0], ends[1]));
        let beyond = format!("over {} {unit}", edges[edges.len() - 1]);
        let last = (edges.len() - 1) as f64;
        let named = between.chain([beyond]).zip(0..);
        let rest = named.map(|(name, step)| ScaleStep { name, colour: colour(f64::from(step) / last) });
        let entries = std::iter::once(zero).chain(rest).collect();
        Self { edges, entries }
    }

    /// Steps of queue fills, in percent of the buffer.
    pub(crate) fn of_fill() -> Self {
        const EDGES: [f64; 6] = [0.0, 20.0, 40.0, 60.0, 80.0, 100.0 - FULL_SLACK_PERCENT];
        let between = EDGES.windows(2).map(|ends| format!("{} to {:.0} %", ends[0], ends[1]));
        let names = std::iter::once("empty".to_owned()).chain(between).chain(["full".to_owned()]);
        let colour = |step: u32| colour::of_fill(f64::from(step) / EDGES.len() as f64);
        let entries = names.zip(0..).map(|(name, step)| ScaleStep { name, colour: colour(step) });
        Self { edges: EDGES.to_vec(), entries: entries.collect() }
    }

    /// Steps of errors in percent, finer for smaller errors.
    pub(crate) fn of_errors() -> Self {
        const EDGES: [f64; 8] = [-50.0, -20.0, -5.0, -1.0, 1.0, 5.0, 20.0, 50.0];
        let between = EDGES.windows(2).map(|ends| format!("{:+} to {:+} %", ends[0], ends[1]));
        let names = std::iter::once("below −50 %".to_owned()).chain(between).chain(["over +50 %".to_owned()]);
        let middle = EDGES.len() as f64 / 2.0;
        let colour = |step: u32| colour::of_error((f64::from(step) - middle) / middle);
        let entries =
            names.zip(0..).map(|(name, step)| ScaleStep { name: name.replace('-', "−"), colour: colour(step) });
        Self { edges: EDGES.to_vec(), entries: entries.collect() }
    }

    /// Adds a last step, for missing values.
    pub(crate) fn with_last(mut self, entry: ScaleStep) -> Self {
        self.entries.push(entry);
        self
    }

    /// The step of a value; without one, the last.
    pub(crate) fn step(&self, value: Option<f64>) -> u16 {
        let last = self.entries.len() - 1;
        value.map_or(last, |value| self.edges.partition_point(|&edge| edge < value)) as u16
    }

    /// The steps as rerun classes, so that entities refer to a step by its number. rerun shows the name on hover.
    pub(crate) fn classes(&self) -> AnnotationContext {
        AnnotationContext::new(self.entries.iter().zip(0..).map(|(entry, id)| AnnotationInfo {
            id,
            label: Some(entry.name.as_str().into()),
            color: Some(entry.colour.into()),
        }))
    }
}

/// The largest numbers 1, 2, 5, 10, 20, 50, ... (and 0.5, 0.2, ...) that are at most `highest`, ascending.
fn round_edges(highest: f64) -> Vec<f64> {
    let highest = if highest.is_finite() && highest > 0.0 { highest } else { 1.0 };
    let top = highest.log10().floor() as i32;
    let decades = (0..).map(|decade| top - decade);
    let descending = decades.flat_map(|power| [5, 2, 1].map(|digit| round_number(digit, power)));
    let mut edges: Vec<f64> = descending.filter(|&edge| edge <= highest * (1.0 + EDGE_SLACK)).take(EDGES).collect();
    edges.reverse();
    edges
}

/// `digit · 10^power`, as the nearest number to its decimal.
fn round_number(digit: i32, power: i32) -> f64 {
    let digit = f64::from(digit);
    if power < 0 { digit / 10f64.powi(-power) } else { digit * 10f64.powi(power) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn steps(highest: f64) -> Steps {
        Steps::of(highest, "s", ScaleStep { name: "now".to_owned(), colour: [0; 3] }, |_| [1; 3])
    }

    #[test]
    fn edges_are_round_numbers_up_to_the_highest_value() {
        assert_eq!(round_edges(300.0), [5.0, 10.0, 20.0, 50.0, 100.0, 200.0]);
        assert_eq!(round_edges(0.5), [0.01, 0.02, 0.05, 0.1, 0.2, 0.5]);
        assert_eq!(round_edges(f64::INFINITY), round_edges(1.0));
    }

    #[test]
    fn a_value_is_in_the_step_with_its_range() {
        let steps = steps(300.0);
        let name = |value: f64| steps.entries[usize::from(steps.step(Some(value)))].name.clone();
        assert_eq!([0.0, 0.1, 5.0, 5.1, 200.0].map(name), ["now", "0 to 5 s", "0 to 5 s", "5 to 10 s", "100 to 200 s"]);
        assert_eq!([201.0, f64::INFINITY].map(name), ["over 200 s", "over 200 s"]);
        assert_eq!(steps.step(None), 7);
    }

    #[test]
    fn only_a_full_buffer_is_labelled_full() {
        let steps = Steps::of_fill();
        let name = |percent| steps.entries[usize::from(steps.step(Some(percent)))].name.clone();
        assert_eq!(
            [0.0, 0.1, 20.0, 99.99, 100.0].map(name),
            ["empty", "0 to 20 %", "0 to 20 %", "80 to 100 %", "full"]
        );
    }

    #[test]
    fn an_error_of_less_than_one_per_cent_is_white() {
        let steps = Steps::of_errors();
        let shown = |error| &steps.entries[usize::from(steps.step(Some(error)))];
        assert_eq!(shown(0.5).colour, colour::of_error(0.0));
        assert_eq!((shown(-60.0).name.as_str(), shown(3.0).name.as_str()), ("below −50 %", "+1 to +5 %"));
        assert_eq!(shown(-3.0).name, "−5 to −1 %");
    }
}
