//! `skysink figures`: curves with confidence bands ([`chart`]) and trajectory maps ([`map`]), each drawn once and written
//! as SVG and PNG, with the sweeps behind them.
//!
//! The same missions give the same bytes: no system font, no clock, no random number takes part.

mod altitude;
mod axis;
pub mod campaign;
pub mod chart;
pub mod error;
mod knowledge;
pub mod map;
mod page;
mod study;
mod style;
#[cfg(test)]
mod tests;
mod trajectories;

use std::path::PathBuf;

use skysink_common::stop::Stop;

use crate::error::LabError;
use crate::progress::OnProgress;
use campaign::{Campaign, Choice, FigurePart};

/// Flies what is wanted and draws everything; returns the figures' paths without their extensions.
///
/// # Errors
/// If a sweep is refused, something cannot be written, or on a stop.
pub fn draw(choice: &Choice, stop: &Stop, on_progress: OnProgress) -> Result<Vec<PathBuf>, LabError> {
    let mut campaign = Campaign::open(choice, stop, on_progress)?;
    for study in study::STUDIES.iter().filter(|study| choice.wants(study.part)) {
        study.draw(&mut campaign)?;
    }
    if choice.wants(FigurePart::Knowledge) {
        knowledge::draw(&mut campaign)?;
    }
    if choice.wants(FigurePart::Altitude) {
        altitude::draw(&mut campaign)?;
    }
    if choice.wants(FigurePart::Maps) {
        trajectories::draw(&mut campaign)?;
    }
    campaign.finish()
}
