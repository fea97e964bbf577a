//! What a plot of a sweep is to show.

use std::iter::zip;
use std::path::PathBuf;

use skysink_common::error::InputError;
use skysink_common::scenario::Setting;

use crate::drawing::chart::Scale;
use crate::drawing::page::{Look, check_text};
use crate::error::LabError;
use crate::metrics::Metric;

/// The parameters of a plot.
#[derive(Debug, Clone)]
pub struct PlotRequest {
    /// The folder of the sweep.
    pub sweep: PathBuf,
    /// The key on the x axis.
    pub x: String,
    /// The metric on the y axis.
    pub metric: Metric,
    /// The strategies, in the order of the legend; all of the sweep if empty.
    pub strategies: Vec<String>,
    /// If set, there is a curve for each strategy and value of this key.
    pub by: Option<String>,
    /// If set, the plot shows the differences to this strategy, or with `by` to this value, paired by seed.
    pub reference: Option<String>,
    /// Whether the best known loss and the lower bounds of the loss are drawn.
    pub bounds: BoundCurves,
    /// Selects the missions with these values of other keys.
    pub conditions: Vec<Setting>,
    /// Scale of the y axis; linear for differences.
    pub y_scale: Scale,
    /// Label of the x axis; `None` for the key.
    pub x_label: Option<String>,
    /// Label of the y axis; `None` for that of the metric.
    pub y_label: Option<String>,
    /// Title, footer, width and folder.
    pub sheet: SheetOptions,
}

/// Whether bounds are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BoundCurves {
    /// The strategies alone.
    Hidden,
    /// The best known loss and the lower bounds, too, from the missions of `offline`.
    Shown,
}

/// Whether the footer with seeds, intervals and version is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Footer {
    /// Only contained as metadata.
    Hidden,
    /// Drawn below the figure.
    Shown,
}

/// How a page looks, and where its files go.
#[derive(Debug, Clone)]
pub struct SheetOptions {
    /// Title above the figure, or empty.
    pub title: String,
    /// Whether seeds, intervals and version are shown below the figure.
    pub footer: Footer,
    /// Printed width [mm]; `None` for a screen.
    pub width_mm: Option<f64>,
    /// Output folder; `None` for the default one.
    pub out: Option<PathBuf>,
}

impl SheetOptions {
    /// The look of the page; `description` follows `footer` in the metadata.
    pub(crate) fn look(&self, footer: String, description: &str) -> Look {
        let description = format!("{footer}{description}");
        let footer = if self.footer == Footer::Shown { footer } else { String::new() };
        Look { title: self.title.clone(), footer, description, width_mm: self.width_mm }
    }

    /// Refuses a title with characters that the embedded font lacks.
    pub(crate) fn check(&self) -> Result<(), InputError> {
        check_text(&self.title).map_err(|message| InputError::of_argument("--title", &self.title, message))
    }
}

impl PlotRequest {
    /// Refuses texts with characters that the embedded font lacks.
    pub(crate) fn check_texts(&self) -> Result<(), InputError> {
        self.sheet.check()?;
        for (option, text) in zip(["--x-label", "--y-label"], [&self.x_label, &self.y_label]) {
            let text = text.as_deref().unwrap_or_default();
            check_text(text).map_err(|message| InputError::of_argument(option, text, message))?;
        }
        Ok(())
    }

    /// An error about the sweep.
    pub(crate) fn refuse(&self, message: String) -> LabError {
        InputError::new("sweep", &self.sweep, message).into()
    }
}
