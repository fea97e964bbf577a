//! The sensor nodes that were found in a file, in the frame of the file.

/// Longitudes are equal modulo this angle [°].
const FULL_CIRCLE_DEG: f64 = 360.0;

/// The frame of imported positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Frame {
    /// East and north [m].
    Plane,
    /// Latitude and longitude on WGS84 [°].
    Geodetic,
}

/// An imported sensor node.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportedSensor {
    /// Its location in the file, such as `line 3` or `point 2`.
    pub place: String,
    /// x and y [m], or latitude and longitude [°].
    pub position: [f64; 2],
    /// Values of further columns of the sensor list.
    pub others: Vec<String>,
}

/// The sensor nodes of a file, in its order.
#[derive(Debug, Clone, PartialEq)]
pub struct Imported {
    /// The frame of all positions.
    pub frame: Frame,
    /// The sensor nodes.
    pub sensors: Vec<ImportedSensor>,
    /// Names of the further columns.
    pub others: Vec<&'static str>,
    /// Descriptions of ignored content.
    pub ignored: Vec<String>,
}

/// The points of a file, as latitude and longitude [°], and the number of ignored items.
#[derive(Default)]
pub struct FoundPoints {
    /// The points.
    pub points: Vec<[f64; 2]>,
    /// The number of ignored items.
    pub ignored: usize,
}

impl Imported {
    /// Sensor nodes with only latitude and longitude [°].
    pub fn geodetic(FoundPoints { points, ignored }: FoundPoints) -> Result<Self, String> {
        let mut sensors = Vec::with_capacity(points.len());
        for (position, number) in points.into_iter().zip(1..) {
            let place = format!("point {number}");
            check_geodetic(position).map_err(|message| format!("{place}: {message}"))?;
            sensors.push(ImportedSensor { place, position, others: Vec::new() });
        }
        let ignored = (ignored > 0).then(|| format!("{ignored} lines, polygons or other items without a point"));
        Ok(Self { frame: Frame::Geodetic, sensors, others: Vec::new(), ignored: ignored.into_iter().collect() })
    }

    /// The sensor list (CSV) of Skysink with all positions translated by `shift` [m or °].
    #[must_use]
    pub fn to_csv(&self, shift: [f64; 2]) -> String {
        let axes = match self.frame {
            Frame::Plane => ["x_m", "y_m"],
            Frame::Geodetic => ["lat_deg", "lon_deg"],
        };
        let mut text = axes.into_iter().chain(self.others.iter().copied()).collect::<Vec<_>>().join(",") + "\n";
        for sensor in &self.sensors {
            let place = [0, 1].map(|axis| (sensor.position[axis] + shift[axis]).to_string());
            let line = place.iter().chain(&sensor.others).map(String::as_str).collect::<Vec<_>>().join(",");
            text.push_str(&(line + "\n"));
        }
        text
    }

    /// The latitude [°] of the southernmost sensor node and the longitude [°] of the westernmost one. The westernmost
    /// node is the one east of the widest gap, so that a field may cross the 180th meridian.
    #[must_use]
    pub fn south_west(&self) -> [f64; 2] {
        let mut longitudes: Vec<f64> = self.sensors.iter().map(|sensor| sensor.position[1]).collect();
        longitudes.sort_by(f64::total_cmp);
        let gaps_before = longitudes.iter().zip(longitudes.iter().cycle().skip(longitudes.len().saturating_sub(1)));
        let gap = |(east, west): &(&f64, &f64)| (**east - **west).rem_euclid(FULL_CIRCLE_DEG);
        let widest = gaps_before.max_by(|a, b| gap(a).total_cmp(&gap(b)));
        [self.bounds()[0][0], widest.map_or(f64::NAN, |(east, _)| *east)]
    }

    /// The lower and upper corner of the bounding box.
    #[must_use]
    pub fn bounds(&self) -> [[f64; 2]; 2] {
        let fold = |start: f64, pick: fn(f64, f64) -> f64| {
            [0, 1].map(|axis| self.sensors.iter().map(|sensor| sensor.position[axis]).fold(start, pick))
        };
        [fold(f64::INFINITY, f64::min), fold(f64::NEG_INFINITY, f64::max)]
    }
}

/// Checks the range of a latitude and a longitude.
pub fn check_geodetic([lat_deg, lon_deg]: [f64; 2]) -> Result<(), String> {
    if !(-90.0..=90.0).contains(&lat_deg) {
        return Err(format!("latitude {lat_deg}: expected -90 to 90"));
    }
    if !(-180.0..=180.0).contains(&lon_deg) {
        return Err(format!("longitude {lon_deg}: expected -180 to 180"));
    }
    Ok(())
}

/// An error with its causes, on one line.
pub fn with_causes(error: &dyn std::error::Error) -> String {
    let causes = std::iter::successors(error.source(), |cause| cause.source());
    let mut message = error.to_string();
    for cause in causes.map(ToString::to_string) {
        if !message.contains(&cause) {
            message = format!("{message}: {cause}");
        }
    }
    message
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_has_the_columns_of_its_frame() {
        let place = "line 2".to_owned();
        let sensor = ImportedSensor { place, position: [1.5, -2.0], others: vec!["50".to_owned()] };
        let others = vec!["sampling_bps"];
        let mut imported = Imported { frame: Frame::Plane, sensors: vec![sensor], others, ignored: Vec::new() };
        assert_eq!(imported.to_csv([0.0, 2.0]), "x_m,y_m,sampling_bps\n1.5,0,50\n");
        imported.frame = Frame::Geodetic;
        assert!(imported.to_csv([0.0; 2]).starts_with("lat_deg,lon_deg,"));
        assert_eq!(imported.bounds(), [[1.5, -2.0]; 2]);
    }

    #[test]
    fn the_westernmost_point_is_east_of_the_widest_gap() {
        let west = |longitudes: &[f64]| {
            let points = longitudes.iter().map(|&lon_deg| [1.0, lon_deg]).collect();
            Imported::geodetic(FoundPoints { points, ignored: 0 }).unwrap().south_west()
        };
        assert_eq!(west(&[13.4, 13.1, 13.5]), [1.0, 13.1]);
        assert_eq!(west(&[-179.9, 179.8, 179.9, -179.8]), [1.0, 179.8]);
        assert_eq!(west(&[-0.1, 0.1]), [1.0, -0.1]);
        assert_eq!(west(&[180.0, -180.0])[1].abs(), 180.0);
        assert_eq!(west(&[7.0]), [1.0, 7.0]);
        assert_eq!(west(&[7.0, 7.0]), [1.0, 7.0]);
    }

    #[test]
    fn a_point_with_invalid_coordinates_is_refused_by_its_number() {
        assert_eq!(
            Imported::geodetic(FoundPoints { points: vec![[1.0, 2.0], [91.0, 0.0]], ignored: 0 }).unwrap_err(),
            "point 2: latitude 91: expected -90 to 90"
        );
        assert!(
            Imported::geodetic(FoundPoints { points: vec![[0.0, f64::NAN]], ignored: 0 })
                .unwrap_err()
                .contains("longitude NaN")
        );
    }
}
