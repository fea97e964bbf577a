//! The channel of a scenario: which keys belong to which model, and the probabilistic one's parameters.

use super::check::Checker;
use super::raw::{Environment, Link, LinkModel, LosFit, letter};
use super::{LosCurve, LosModel, ScenarioError};
use crate::units::ratio_of_db;

/// The probabilistic model of a link, its defaults filled in; none in free space.
pub(super) fn los(checker: &Checker, link: &mut Link) -> Result<Option<LosModel>, ScenarioError> {
    match link.model {
        LinkModel::FreeSpace => {
            free_space(checker, link)?;
            Ok(None)
        }
        LinkModel::ProbabilisticLos => probabilistic(checker, link).map(Some),
    }
}

/// Free space has a range of gains, and no other key of a channel.
fn free_space(checker: &Checker, link: &mut Link) -> Result<(), ScenarioError> {
    link.gain_db.get_or_insert(letter::GAIN_DB);
    link.gain.get_or_insert(letter::GAIN);
    let only = "it only with model = \"probabilistic-los\"";
    checker.that("link.environment", link.environment, link.environment.is_none(), only)?;
    checker.that("link.los", link.los, link.los.is_none(), only)?;
    for (key, value) in [
        ("link.reference_gain_db", link.reference_gain_db),
        ("link.los_exponent", link.los_exponent),
        ("link.nlos_exponent", link.nlos_exponent),
        ("link.nlos_extra_db", link.nlos_extra_db),
        ("link.snr_gap_db", link.snr_gap_db),
    ] {
        checker.that(key, value, value.is_none(), only)?;
    }
    Ok(())
}

/// The probabilistic model has one reference gain for all, surroundings, and two path losses.
fn probabilistic(checker: &Checker, link: &mut Link) -> Result<LosModel, ScenarioError> {
    let only = "it only with model = \"free-space\"; here it is reference_gain_db for all";
    checker.that("link.gain_db", link.gain_db, link.gain_db.is_none(), only)?;
    checker.that("link.gain", link.gain, link.gain.is_none(), only)?;
    if let (Some(environment), Some(_)) = (link.environment, link.los) {
        checker.that("link.environment", environment, false, "either environment or los, not both")?;
    }
    let curve = match link.los {
        None => {
            let (a, b) = link.environment.get_or_insert(Environment::Urban).sigmoid();
            LosCurve::Sigmoid { a, b }
        }
        Some(LosFit::Sigmoid { a, b }) => {
            checker.positive("link.los.a", a)?;
            checker.positive("link.los.b", b)?;
            LosCurve::Sigmoid { a, b }
        }
        Some(LosFit::Logistic { b1, b2, b3, b4 }) => {
            checker.that("link.los.b1", b1, b1.is_finite(), "a finite number")?;
            checker.positive("link.los.b2", b2)?;
            checker.positive("link.los.b4", b4)?;
            checker.that("link.los.b3", b3, (b3 + b4 - 1.0).abs() < 1e-9, "1 − b4, so that the chance ends at 1")?;
            LosCurve::Logistic { b1, b2, b3, b4 }
        }
    };
    let level = |key, value: &mut Option<f64>, default: f64| {
        let level_db = *value.get_or_insert(default);
        checker.that(key, level_db, (-300.0..=0.0).contains(&level_db), "a level from -300 to 0 dB")?;
        Ok(ratio_of_db(level_db))
    };
    let reference_gain = level("link.reference_gain_db", &mut link.reference_gain_db, -60.0)?;
    let nlos_extra = level("link.nlos_extra_db", &mut link.nlos_extra_db, -20.0)?;
    let exponent = |key, value: &mut Option<f64>, default: f64| {
        let exponent = *value.get_or_insert(default);
        checker.that(key, exponent, (1.0..=10.0).contains(&exponent), "an exponent from 1 to 10")?;
        Ok(exponent)
    };
    let los_exponent = exponent("link.los_exponent", &mut link.los_exponent, 2.5)?;
    let nlos_exponent = exponent("link.nlos_exponent", &mut link.nlos_exponent, 3.5)?;
    let snr_gap_db = *link.snr_gap_db.get_or_insert(8.2);
    checker.that("link.snr_gap_db", snr_gap_db, (0.0..=100.0).contains(&snr_gap_db), "0 to 100 dB")?;
    Ok(LosModel { curve, reference_gain, los_exponent, nlos_exponent, nlos_extra, snr_gap: ratio_of_db(snr_gap_db) })
}
