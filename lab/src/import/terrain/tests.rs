use super::*;

/// Three columns and two rows of 10 m from (100, 200); 1 to 3 in the south, 4 to 6 in the north.
const SMALL: &str = "ncols 3\nnrows 2\nXLLCORNER 100\nyllcorner 200\ncellsize 10\nNODATA_value -9\n4 5 6\n1 2 3\n";

#[test]
fn the_first_row_is_the_northernmost() {
    let grid = HeightGrid::parse(SMALL).unwrap();
    let height_m = |x_m: f64, y_m: f64| grid.height_m(&Position::new(x_m, y_m));
    assert_eq!([height_m(105.0, 205.0), height_m(125.0, 215.0)], [Some(1.0), Some(6.0)]);
    // Half-way between 1, 2, 4 and 5; beyond the middles of the outer cells constant; no ground outside.
    assert_eq!([height_m(110.0, 210.0), height_m(100.0, 200.0), height_m(99.0, 205.0)], [Some(3.0), Some(1.0), None]);
    let centre = SMALL.replace("XLLCORNER 100", "xllcenter 105").replace("yllcorner 200", "yllcenter 205");
    assert_eq!(HeightGrid::parse(&centre).unwrap(), grid);
}

#[test]
fn the_ground_under_the_area_has_its_coordinates() {
    let grid = HeightGrid::parse(SMALL).unwrap();
    // The area begins at (112, 201), and ends in the same column and in the row above.
    let under = grid.over([7.0, 12.0], [-112.0, -201.0]).unwrap();
    assert_eq!((under.cells, &under.heights_m), ([1, 2], &vec![2.0, 5.0]));
    assert_eq!(under.corner, Position::new(-2.0, -1.0));
    assert_eq!(under.height_m(&Position::new(3.0, 4.0)), Some(2.0));
    let error = grid.over([7.0, 22.0], [-112.0, -201.0]).unwrap_err();
    assert_eq!(
        error,
        "x = 100 to 130, y = 200 to 220 m: expected the ground under all of the area, x = 112 to 119, y = 201 to 223 m"
    );
    for text in [SMALL.replace("4 5 6", "4 -9 6"), SMALL.replace("-9\n4 5 6", "nan\nnan nan 6")] {
        let holed = HeightGrid::parse(&text).unwrap();
        assert!(holed.over([7.0, 8.0], [-112.0, -201.0]).is_ok(), "the hole is north of the area");
        let error = holed.over([7.0, 12.0], [-112.0, -201.0]).unwrap_err();
        assert_eq!(error, "row 1 of the heights, column 2: NODATA_value: expected a height in all of the area");
    }
    assert!(HeightGrid::parse(&SMALL.replace("4 5 6", "4 nan 6")).is_err(), "-9 stands for none");
}

/// Cells of 10 m in a row from west to east with a ridge of 12 m in the fifth, at x = 45.
fn ridge() -> HeightGrid {
    let row = "0 0 0 0 12 0 0 0 0 0\n";
    let head = "ncols 10\nnrows 3\nxllcorner 0\nyllcorner 0\ncellsize 10\n";
    HeightGrid::parse(&format!("{head}{row}{row}{row}")).unwrap()
}

/// From (5, 15) at the ground, 40 m west of the ridge's crest: a UAV 20 m high at x sees the SN above the crest if
/// `20 · 40/(x − 5) > 12`, for x < 71.67 m.
#[test]
fn the_shadow_of_a_ridge_begins_where_the_ray_grazes_its_crest() {
    let grid = ridge();
    let sees = |x_m: f64, y_m: f64| grid.is_in_sight(&Point3::new(5.0, 15.0, 0.0), &Point3::new(x_m, y_m, 20.0));
    assert_eq!([15.0, 45.0, 60.0, 71.6, 71.7, 95.0].map(|x_m| sees(x_m, 15.0)), [true, true, true, true, false, false]);
    // The same beside the line between middles, to the north and to the south.
    assert_eq!([71.6, 71.7].map(|x_m| sees(x_m, 23.0)), [true, false]);
    assert_eq!([71.6, 71.7].map(|x_m| sees(x_m, 7.0)), [true, false]);
    // To the west there is nothing, and from the crest all is seen.
    assert!(grid.is_in_sight(&Point3::new(95.0, 5.0, 0.0), &Point3::new(50.0, 25.0, 20.0)));
    let crest = |x_m: f64| grid.is_in_sight(&Point3::new(45.0, 15.0, 12.0), &Point3::new(x_m, 15.0, 20.0));
    assert!([5.0, 44.0, 45.0, 46.0, 95.0].into_iter().all(crest));
    // Half-way up the slope, at (40, 15) and 6 m, the crest is beside: 20 m high, 10 m on, the ray has 13 m there.
    let slope = |x_m: f64| grid.is_in_sight(&Point3::new(40.0, 15.0, 6.0), &Point3::new(x_m, 15.0, 20.0));
    assert_eq!([50.0, 60.0].map(slope), [true, false]);
}

#[test]
fn flat_ground_hides_nothing() {
    let flat = HeightGrid::parse(&SMALL.replace("4 5 6", "7 7 7").replace("1 2 3", "7 7 7")).unwrap();
    assert!(flat.is_flat() && !ridge().is_flat() && flat.above(7.0).iter().all(|is_above| !is_above));
    for (x_m, y_m) in [(100.0, 200.0), (105.0, 205.0), (130.0, 220.0), (117.3, 211.9)] {
        let uav = Point3::new(125.0, 215.0, 7.001);
        assert!(flat.is_in_sight(&Point3::new(x_m, y_m, 7.0), &uav), "{x_m}, {y_m}");
    }
}

#[test]
fn an_invalid_grid_is_refused() {
    let changed = |from: &str, to: &str| HeightGrid::parse(&SMALL.replace(from, to)).unwrap_err();
    for (error, message) in [
        (changed("ncols 3", "ncols x"), "line 1: `ncols x`: expected ncols, nrows, xllcorner"),
        (changed("ncols 3\n", ""), "no ncols: expected it in the header"),
        (changed("nrows 2", "nrows 2.5"), "nrows = 2.5: expected a whole number of cells"),
        (changed("nrows 2", "nrows 99999999"), "ncols, nrows = [3, 99999999]: expected at most 100000000 cells"),
        (
            changed("cellsize 10", "cellsize 0.0002777"),
            "cellsize = 0.0002777: expected 0.1 to 1e6 m; degrees? expected",
        ),
        (changed("cellsize 10", "cellsize 1e300"), "cellsize = 1e300: expected 0.1 to 1e6 m"),
        (changed("XLLCORNER 100", "XLLCORNER 1e300"), "xllcorner = 1e300: expected -1e9 to 1e9 m"),
        (changed("ncols 3", "ncols 1e300"), "ncols = 1e300: expected a whole number of cells"),
        (changed("cellsize 10\n", "dx 10\ndy 9\n"), "line 5: `dx 10`: expected ncols"),
        (changed("yllcorner 200\n", ""), "no yllcorner: expected it in the header"),
        (changed("4 5 6", "4 5"), "5 heights: expected ncols × nrows = 3 × 2"),
        (changed("4 5 6", "4 five 6"), "line 7: `five`: expected a height [m]"),
        (changed("4 5 6", "4 nan 6"), "line 7: `nan`: expected a height [m]"),
        (HeightGrid::parse("").unwrap_err(), "no ncols"),
    ] {
        assert!(error.starts_with(message), "{error}");
    }
}
