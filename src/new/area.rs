//! The sides of an area around positions.

/// Margin between the sensor nodes and the border of the area [m].
pub const MARGIN_M: f64 = 10.0;

/// A side that ends beyond this coordinate [m].
pub fn beyond(coordinate_m: f64) -> f64 {
    (coordinate_m + MARGIN_M).ceil()
}

/// The keys of the sides of an area [m].
pub fn sides([width_m, height_m]: [f64; 2]) -> String {
    format!("width_m = {width_m:?} # around the sensor nodes [m]\nheight_m = {height_m:?}")
}
