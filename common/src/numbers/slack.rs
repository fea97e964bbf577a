//! Slacks against rounding that several files share, each with what it is a slack of.
//!
//! [`RANGE_SLACK`](crate::geometry::RANGE_SLACK) is that of distances (decision D5). What only one file needs is there.

/// Of a number of slots [slots]: rounding neither adds nor takes one.
pub const SLOTS_SLACK: f64 = 1e-9;

/// Of a time that has to last for whole slots, relative to the time.
pub const TIME_SLACK: f64 = 1e-12;

/// Of the border of the area and of zones, relative to the longer side of the area
/// ([`Area::border_slack_m`](crate::scenario::Area::border_slack_m)).
pub const BORDER_SLACK: f64 = 1e-9;

/// Of the limits of altitudes, relative to them.
pub const ALTITUDE_SLACK: f64 = 1e-9;
