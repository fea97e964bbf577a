//! Margins of the bounds against rounding.

/// Margin on rates, altitudes and bits, relative to them, so that rounding does not put a bound below a flown mission.
pub(crate) const RELATIVE_MARGIN: f64 = 1e-9;

/// Margin on lengths, relative to them: more than the slack of range and reach (decision D5).
pub(crate) const LENGTH_MARGIN: f64 = 1e-8;
