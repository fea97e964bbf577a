//! Progress bars of what takes long, on standard error.

use std::io::IsTerminal;

use indicatif::{ProgressBar, ProgressStyle};

/// The progress bar of a sweep; nothing at all where standard error is not a terminal.
#[derive(Debug)]
pub struct MissionProgress {
    bar: ProgressBar,
}

impl MissionProgress {
    /// A bar over `missions` missions, of which some are flown already.
    ///
    /// # Panics
    /// Never: the template is valid.
    #[must_use]
    pub fn new(missions: usize, flown: usize) -> Self {
        if !std::io::stderr().is_terminal() {
            return Self { bar: ProgressBar::hidden() };
        }
        let template = "{bar:25} mission {pos}/{len}  {eta} left";
        let style = ProgressStyle::with_template(template).expect("a valid template");
        let bar = ProgressBar::new(missions as u64).with_style(style).with_position(flown as u64);
        bar.reset_eta();
        Self { bar }
    }

    /// Another mission is flown.
    pub fn advance(&self) {
        self.bar.inc(1);
    }

    /// Removes the bar.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// The progress bar of a search; nothing at all where standard error is not a terminal.
#[derive(Debug)]
pub struct SearchProgress {
    bar: ProgressBar,
    steps: u64,
}

impl SearchProgress {
    /// A bar over `steps` search steps.
    ///
    /// # Panics
    /// Never: the template is valid.
    #[must_use]
    pub fn new(steps: u64) -> Self {
        if !std::io::stderr().is_terminal() {
            return Self { bar: ProgressBar::hidden(), steps };
        }
        let template = "{bar:25} step {human_pos}/{human_len}  {msg}  {eta} left";
        let style = ProgressStyle::with_template(template).expect("a valid template");
        Self { bar: ProgressBar::new(steps).with_style(style), steps }
    }

    /// Shows that a share of the steps is done, and the loss rate of the best plan so far.
    pub fn show(&self, share: f64, loss_rate: f64) {
        self.bar.set_message(format!("loss {loss_rate:.4}"));
        self.bar.set_position((share * self.steps as f64) as u64);
    }

    /// Removes the bar.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}
