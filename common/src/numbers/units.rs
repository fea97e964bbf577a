//! Conversion of levels in decibels from input files. Messages and channel models are linear SI.

/// Linear power ratio of a level in dB: `10^(dB/10)`.
#[must_use]
pub fn ratio_of_db(level_db: f64) -> f64 {
    10f64.powf(level_db / 10.0)
}

/// Power [W] of a level in dBm: `10^((dBm − 30)/10)`.
#[must_use]
pub fn watts_of_dbm(level_dbm: f64) -> f64 {
    ratio_of_db(level_dbm - 30.0)
}

/// Level [dBm] of a power [W], the inverse of [`watts_of_dbm`].
#[must_use]
pub fn dbm_of_watts(power_w: f64) -> f64 {
    10.0 * power_w.log10() + 30.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decibels_become_ratios_and_watts() {
        assert!((ratio_of_db(-50.0) - 1e-5).abs() < 1e-20);
        assert!((watts_of_dbm(-100.0) - 1e-13).abs() < 1e-27); // −100 dBm = 10^−10 mW
        assert!((watts_of_dbm(30.0) - 1.0).abs() < 1e-15);
        assert!((dbm_of_watts(watts_of_dbm(-97.3)) + 97.3).abs() < 1e-12);
    }
}
