//! Values between two others.

use std::ops::{Add, Mul, Sub};

/// The value at `fraction` of the way from `from` to `to`: `from + fraction (to − from)`, of numbers and of points.
///
/// At 0 it is `from`. At 1 it is `to` but for rounding.
#[inline]
pub fn interpolate<T, Difference>(from: T, to: T, fraction: f64) -> T
where
    T: Copy + Add<Difference, Output = T> + Sub<Output = Difference>,
    Difference: Mul<f64, Output = Difference>,
{
    from + (to - from) * fraction
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point2, Point3};

    #[test]
    fn a_quarter_of_the_way_is_a_quarter_of_the_difference() {
        // 20 + (60 − 20)/4 = 30; 5 − 8/4 = 3.
        assert_eq!(interpolate(20.0, 60.0, 0.25), 30.0);
        assert_eq!(interpolate(Point2::new(20.0, 5.0), Point2::new(60.0, -3.0), 0.25), Point2::new(30.0, 3.0));
        assert_eq!([0.0, 1.0].map(|fraction| interpolate(-7.0, 9.0, fraction)), [-7.0, 9.0]);
        let [low, high] = [Point3::origin(), Point3::new(4.0, 8.0, 16.0)];
        assert_eq!(interpolate(low, high, 0.75), Point3::new(3.0, 6.0, 12.0));
    }

    #[test]
    fn it_is_the_form_of_which_the_difference_is_a_part() {
        // In thirds: 0.1 + (0.7 − 0.1)/3, not 0.1 · 2/3 + 0.7/3, which differs in the last bit.
        let third = 1.0 / 3.0;
        assert_eq!(interpolate(0.1, 0.7, third), 0.1 + third * (0.7 - 0.1));
    }
}
