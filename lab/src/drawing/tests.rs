//! What the files must hold, and what is refused.

use std::fs;
use std::path::{Path, PathBuf};

use super::chart::{Chart, CurvePoint, Scale, Series};
use super::levels::{self, LevelMap};
use super::map::{AreaKind, AreaOutline, MapSensor, MapSheet, TrajectoryMap};
use super::page::{self, Look};
use super::style;
use super::table::TableCells;
use crate::error::LabError;
use skysink_common::figure::Support;

fn series(label: &str, points: &[(f64, f64, f64)]) -> Series {
    let points = points
        .iter()
        .map(|&(x, mean, half_width)| CurvePoint {
            x,
            n: 20,
            mean,
            limits: Some([mean - half_width, mean + half_width]),
        })
        .collect();
    Series { label: label.to_owned(), style: 0, points }
}

fn look(title: &str, description: &str) -> Look {
    Look { title: title.to_owned(), description: description.to_owned(), ..Look::default() }
}

fn chart(series: Vec<Series>) -> Chart {
    Chart {
        look: look("Loss against area", "seeds 1 to 50, 95 % CI · skysink"),
        x_label: "side of the area [m]".to_owned(),
        x_words: Vec::new(),
        y_label: "data loss rate η [−]".to_owned(),
        series,
        support: Support::Fraction,
        y_scale: Scale::Linear,
    }
}

fn sheet() -> MapSheet {
    let map = |title: &str| TrajectoryMap {
        title: title.to_owned(),
        width_m: 100.0,
        height_m: 80.0,
        links: None,
        areas: Vec::new(),
        names: Vec::new(),
        sensors: vec![
            MapSensor { position_m: [20.0, 30.0], fraction: 0.0, energy: None },
            MapSensor { position_m: [90.0, 5.0], fraction: 0.4, energy: None },
        ],
        paths_m: vec![vec![[50.0, 40.0], [50.0, 40.0], [50.0, 40.0], [20.0, 30.0]]],
    };
    MapSheet {
        look: look("Trajectories", "seed 1 · skysink"),
        maps: vec![map("rfs"), map("uts-wide")],
        fraction_label: "bits lost / bits sampled [−]".to_owned(),
    }
}

/// Draws into a folder of its own and returns SVG and PNG.
fn files(draw: impl Fn(&Path) -> Result<Vec<PathBuf>, LabError>) -> (String, Vec<u8>) {
    let folder = tempfile::tempdir().unwrap();
    draw(&folder.path().join("fig.2a")).unwrap();
    let read = |name| fs::read(folder.path().join(name)).unwrap();
    (String::from_utf8(read("fig.2a.svg")).unwrap(), read("fig.2a.png"))
}

/// The one-line message with which a chart is refused.
fn refusal(chart: &Chart) -> String {
    let message = chart.draw(Path::new("/nowhere/at/all")).unwrap_err().to_string();
    assert!(!message.contains('\n'), "{message}");
    message
}

#[test]
fn the_same_figure_gives_the_same_bytes() {
    let chart =
        chart(vec![series("rfs", &[(100.0, 0.1, 0.02), (200.0, 0.3, 0.01)]), series("gfs", &[(150.0, 0.2, 0.1)])]);
    assert_eq!(files(|stem| chart.draw(stem)), files(|stem| chart.draw(stem)));
    assert_eq!(files(|stem| sheet().draw(stem)), files(|stem| sheet().draw(stem)));
}

#[test]
fn a_chart_contains_its_labels_and_description() {
    let (svg, png) = files(|stem| {
        chart(vec![series("uts", &[(1.0, 0.1, 0.0), (2.0, 0.2, 0.0)]), series("exact", &[(1.0, 0.0, 0.0)])]).draw(stem)
    });
    for text in ["Loss against area", "side of the area [m]", "data loss rate η [−]", "uts", "exact"] {
        assert!(svg.contains(&format!(">\n{text}\n</text>")), "{text}");
    }
    assert!(svg.contains("<desc>seeds 1 to 50, 95 % CI · skysink</desc>"), "in the file, but not drawn");
    assert!(svg.contains(r#"viewBox="0 0 1600 1000" width="457.143pt""#), "{}", &svg[..200]);
    assert!(svg.contains("font-family=\"DejaVu Sans, Verdana, Arial, sans-serif\""));
    let side = |at: usize| u32::from_be_bytes(png[at..at + 4].try_into().unwrap());
    assert_eq!((side(16), side(20)), (1600, 1000));
}

#[test]
fn a_map_sheet_contains_its_labels_and_description() {
    let (svg, _) = files(|stem| sheet().draw(stem));
    let texts = ["Trajectories", "rfs", "uts-wide", "bits lost / bits sampled [−]", "x [m]", "y [m]", "start"];
    for text in texts {
        assert!(svg.contains(&format!(">\n{text}\n</text>")), "{text}");
    }
    assert!(svg.contains("<desc>seed 1 · skysink</desc>"));
}

#[test]
fn a_table_shows_symmetric_and_bounded_intervals() {
    let mut curve = series("uts", &[(1.0, 0.25, 0.0), (2.0, -0.00001, 0.001), (3.0, 0.5, 0.0)]);
    curve.points[0].limits = Some([0.125, 0.5]);
    curve.points[2].limits = None;
    let fractions = chart(vec![curve.clone()]).table(TableCells::Intervals).markdown();
    let head = "**Loss against area**; data loss rate η [−], mean [95 % CI]\n\n| side of the area [m] | uts |";
    assert!(fractions.contains(head), "{fractions}");
    assert!(fractions.ends_with("| 1 | 0.2500 [0.1250, 0.5000] |\n| 2 | 0.0000 [-0.0010, 0.0010] |\n| 3 | 0.5000 |\n"));
    let small = chart(vec![series("uts", &[(1.0, 0.000_014, 0.000_01)])]).table(TableCells::Intervals).markdown();
    assert!(small.ends_with("| 1 | 0.000014 [0.000004, 0.000024] |\n"), "{small}");
    // 12.3 ± 12.3 would not say whether it contains 0.
    let near = Chart { support: Support::Real, ..chart(vec![series("uts", &[(1.0, 12.34, 12.31)])]) }
        .table(TableCells::Intervals)
        .markdown();
    assert!(near.ends_with("| 1 | 12.34 ± 12.31 |\n"), "{near}");
    let bits = Chart { support: Support::Real, ..chart(vec![series("uts", &[(1.0, 21_076.4, 55.2)])]) }
        .table(TableCells::Intervals)
        .markdown();
    assert!(bits.contains("mean ± half of the 95 % CI\n") && bits.ends_with("| 1 | 21076 ± 55 |\n"), "{bits}");
}

#[test]
fn a_point_without_an_interval_has_no_band() {
    let bands = |is_known: bool| {
        let mut curve = series("uts", &[(1.0, 0.1, 0.05), (2.0, 0.2, 0.05)]);
        if !is_known {
            curve.points.iter_mut().for_each(|point| point.limits = None);
        }
        files(|stem| chart(vec![curve.clone()]).draw(stem)).0.matches("fill-opacity").count()
    };
    assert_eq!((bands(false), bands(true)), (0, 1));
}

#[test]
fn a_mean_outside_the_axis_is_refused() {
    let drawn =
        |mean: f64, y_scale| Chart { y_scale, ..chart(vec![series("uts", &[(0.5, 0.1, 0.0), (1.0, mean, 0.0)])]) };
    for (mean, scale) in [(f64::NAN, Scale::Linear), (f64::INFINITY, Scale::Linear), (-0.5, Scale::Log)] {
        let expected = "expected a finite number, not below 0 on a logarithmic scale";
        let message = format!("figure \"Loss against area\": mean {mean} at 1: {expected}");
        assert_eq!(refusal(&drawn(mean, scale)), message);
    }
}

#[test]
fn a_mean_of_0_is_drawn_at_the_lower_end_of_a_logarithmic_axis() {
    let points = |first: f64| [(1.0, first, 0.0), (2.0, 0.001, 0.0), (3.0, 0.1, 0.0)];
    let log = |first: f64| Chart { y_scale: Scale::Log, ..chart(vec![series("uts", &points(first))]) };
    let (svg, _) = files(|stem| log(0.0).draw(stem));
    assert!(svg.contains(">\n0\n</text>") && svg.contains(">\n0.01\n</text>"));
    let (svg, _) = files(|stem| log(0.01).draw(stem));
    assert!(!svg.contains(">\n0\n</text>"), "no axis ends at 0 without need");
    let nothing = Chart { y_scale: Scale::Log, ..chart(vec![series("uts", &[(1.0, 0.0, 0.0)])]) };
    assert!(refusal(&nothing).contains("all means are 0"));
}

#[test]
fn a_character_without_a_glyph_is_refused() {
    let message = refusal(&chart(vec![series("城", &[(1.0, 0.1, 0.0)])]));
    let expected = "figure text \"城\": '城' is not in the embedded font: expected Latin, Greek or common symbols";
    assert_eq!(message, expected);
}

#[test]
fn a_file_that_cannot_be_written_is_named() {
    let chart = chart(vec![series("uts", &[(1.0, 0.1, 0.0)])]);
    assert_eq!(refusal(&chart), "/nowhere/at/all.svg: No such file or directory (os error 2)");
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("fig.png")).unwrap();
    let message = chart.draw(&folder.path().join("fig")).unwrap_err().to_string();
    assert!(message.starts_with(&format!("{}: ", folder.path().join("fig.png").display())), "{message}");
}

#[test]
fn latin_greek_and_common_symbols_have_glyphs() {
    let words = "Grüße, naïve Œuvre; ΑΒΓΔΩ αβγδηλμπσφω ‐–— ‘’ “” … ‰ 10⁻⁴⁹ x₀₉ ←↑→↓ ∆∑−√∝∞≈≠≤≥ ×·±°µ²³";
    let lacking = |character: char| page::text_width(&character.to_string(), 20.0) == 0.0;
    assert_eq!((' '..='~').chain(words.chars()).find(|&character| lacking(character)), None);
    assert!(lacking('城'));
}

#[test]
fn any_number_of_curves_has_distinct_styles() {
    let curves = (0..40).map(|i| series(&format!("curve {i}"), &[(f64::from(i), 0.1, 0.0)])).collect();
    let chart = chart(curves);
    let (svg, _) = files(|stem| chart.draw(stem));
    assert!(svg.contains(">\ncurve 39\n</text>"));
    let first = style::FIRST_STYLE;
    let styles: Vec<_> = (first..first + 40).map(|index| style::SeriesStyle::of(index, false)).collect();
    for (index, style) in styles.iter().enumerate() {
        assert!(styles[..index].iter().all(|other| other.colour != style.colour && other.marker != style.marker));
    }
}

#[test]
fn each_strategy_has_a_unique_style_in_every_chart() {
    let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
    let all: Vec<String> = skysink_planner::strategies::names().into_iter().map(str::to_owned).collect();
    let styles = style::styles_of(&[&all[..], &names(&["python:a.py:A", "python:b.py:B"])].concat());
    assert!((0..styles.len()).all(|index| !styles[..index].contains(&styles[index])), "{styles:?}");
    assert_eq!(
        style::styles_of(&names(&["python:a.py:A", "whittle"]))[1],
        styles[all.iter().position(|name| name == "whittle").unwrap()]
    );
}

#[test]
fn markers_and_lines_are_smaller_in_print() {
    let print = |width_mm| {
        let mut chart = chart(vec![series("uts", &[(1.0, 0.1, 0.0), (2.0, 0.2, 0.0)])]);
        chart.look.width_mm = width_mm;
        files(|stem| chart.draw(stem)).0
    };
    assert!(print(Some(88.0)).contains("scale(0.55)") && !print(None).contains("scale("));
}

#[test]
fn a_higher_fraction_is_darker() {
    let lightness = |fraction: f64| {
        let shade = style::shade(fraction);
        let channel = |at: usize| f64::from(u8::from_str_radix(&shade[at..at + 2], 16).unwrap());
        0.2126 * channel(1) + 0.7152 * channel(3) + 0.0722 * channel(5)
    };
    let lightness: Vec<_> = (0..=100).map(|percent| lightness(f64::from(percent) / 100.0)).collect();
    assert!(lightness.windows(2).all(|pair| pair[0] > pair[1]), "{lightness:?}");
}

#[test]
fn a_map_shows_links_in_bands_and_batteries_and_names_them_alone() {
    let mut sheet = sheet();
    let names = ["best SNR [dB]", "energy left", "dead sensor"];
    let (svg, _) = files(|stem| sheet.draw(stem));
    assert!(names.iter().all(|name| !svg.contains(name)) && !svg.contains(&levels::tint(0)));
    // Three of four cells have links, of the lowest, the lowest and the highest level.
    let rows = vec![vec![Some(-3.0), Some(-3.0)], vec![None, Some(21.0)]];
    sheet.maps[0].links = Some(LevelMap { label: names[0].to_owned(), cell_m: 50.0, rows });
    for (sensor, left) in sheet.maps[0].sensors.iter_mut().zip([0.25, 0.0]) {
        sensor.energy = Some(left);
    }
    let (svg, png) = files(|stem| sheet.draw(stem));
    assert!(names.iter().all(|name| svg.contains(name)) && !png.is_empty());
    let is_cells = |path: &&str| path.matches('h').count() > 0;
    let band = |band: usize| {
        let end = format!("fill=\"{}\"", levels::tint(band));
        svg.split('<').filter(|tag| tag.starts_with("path")).filter(is_cells).find(|tag| tag.contains(&end))
    };
    assert_eq!(band(0).unwrap().matches('M').count(), 2, "a run of two cells, and one");
    assert_eq!(band(7).unwrap().matches('M').count(), 1);
    assert!(svg.contains("\n−3\n") && svg.contains("\n9\n") && svg.contains("\n21\n"), "the ends of the scale");
    assert!(svg.contains(" 0 0 1 "), "a quarter of a ring");
}

#[test]
fn a_map_shows_its_areas_and_names_their_kinds_alone() {
    let mut sheet = sheet();
    let corners_m = vec![[10.0, 10.0], [40.0, 10.0], [40.0, 30.0]];
    sheet.maps[0].areas = vec![
        (AreaKind::NoFly, AreaOutline::Polygon(corners_m)),
        (AreaKind::Base, AreaOutline::Disk([50.0, 40.0], 5.0)),
    ];
    let (svg, _) = files(|stem| sheet.draw(stem));
    for (name, fill, is_shown) in
        [("no-fly zone", "#f4d3d3", true), ("base", "#d9efd3", true), ("building", "#dcdcdc", false)]
    {
        assert_eq!(svg.matches(fill).count(), if is_shown { 2 } else { 0 }, "{name}: on the map and in the legend");
        assert_eq!(svg.contains(name), is_shown, "{name}");
    }
}
