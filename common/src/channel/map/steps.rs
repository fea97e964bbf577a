//! The rates of SNRs: from which SNR on each is carried.

use std::path::Path;

use super::LinkMap;
use crate::csv_rows::read_rows;
use crate::error::InputError;

impl LinkMap {
    /// Parses the text of the file `path` of the rates of SNRs.
    ///
    /// # Errors
    /// If a row is invalid, or no step up from the one before.
    pub fn parse_steps(text: &str, path: &Path) -> Result<Vec<[f64; 2]>, InputError> {
        let refuse = |message: String| InputError::new("channel", path, message);
        let expected = "a finite SNR and a rate from 0 to 1e300";
        Self::checked_steps(read_rows(text, &["snr_db", "rate_bps"], expected, is_step).map_err(refuse)?)
            .map_err(refuse)
    }

    /// These rates of SNRs, each from which SNR on [dB] it is carried, and the rate [bit/s].
    ///
    /// # Errors
    /// If there is none, or one is no step up from the one before.
    pub fn checked_steps(steps: Vec<[f64; 2]>) -> Result<Vec<[f64; 2]>, String> {
        let is_up = |steps: &[[f64; 2]]| steps[0][0] < steps[1][0] && steps[0][1] < steps[1][1];
        let refuse = |[snr_db, rate_bps]: &[f64; 2]| {
            let expected = "expected ascending steps, of finite SNRs and rates from 0 to 1e300";
            Err(format!("snr_db = {snr_db}, rate_bps = {rate_bps}: {expected}"))
        };
        match (steps.iter().find(|step| !is_step(step)), steps.windows(2).find(|steps| !is_up(steps))) {
            (Some(step), _) | (None, Some([_, step])) => refuse(step),
            _ if steps.is_empty() => Err("no rows: expected a row for each step".to_owned()),
            _ => Ok(steps),
        }
    }
}

/// Whether a step has an SNR [dB] and a rate [bit/s].
fn is_step(&[snr_db, rate_bps]: &[f64; 2]) -> bool {
    snr_db.is_finite() && (0.0..=1e300).contains(&rate_bps)
}
