//! The batteries of the sensor nodes (decision D33): a ring about each, coloured by the energy left, a cross over each
//! dead one, and the number of those alive. Missions without batteries contain none of this.

use re_sdk::RecordingStreamResult;
use re_sdk_types::archetypes::{AnnotationContext, LineStrips3D, Scalars};
use re_sdk_types::components::{ClassId, Radius};
use re_sdk_types::datatypes::AnnotationInfo;
use skysink_common::nodes::Answer;
use skysink_common::scenario::Scenario;

use crate::blueprint::Blueprint;
use crate::canvas::Canvas;
use crate::colour;
use crate::layer::{Layer, LayerRow, LayerSetup, LayerTile, OpenLayer};
use crate::shapes::{Point, circle_of, curve_style, line_style};
use crate::sizes::MAX_BARS;
use crate::slot::SlotView;
use crate::views;

/// A ring about each sensor node with a battery, coloured by the energy left; none where that is unknown.
pub const ENERGY: &str = "world/energy";
/// Crosses over dead sensor nodes.
pub const DEAD_MARKS: &str = "world/dead";
/// Number of sensor nodes that are alive; only with batteries.
pub const ALIVE: &str = "metrics/alive";

/// Levels of the energy above none, 10 % each.
const FULL_LEVEL: u16 = 10;

/// What sensor nodes have left, and which are dead.
pub(crate) const LAYER: LayerRow = LayerRow { legend, plot, ..LayerRow::new(NodeEnergy::open) };

/// Whether the sensor nodes of a mission have something that runs out.
fn is_drawn(scenario: &Scenario) -> bool {
    scenario.node_traits().has_level
}

/// The batteries of the scene.
struct NodeEnergy {
    feet: Vec<Point>,
    /// Radius of the rings [m].
    radius_m: f32,
    /// Corners of a ring.
    corners: u16,
    /// Whether the energies are shown.
    is_shown: bool,
}

impl NodeEnergy {
    /// Styles the rings and crosses.
    fn open(canvas: &Canvas, LayerSetup { scenario, sensors, sizes }: LayerSetup<'_>) -> OpenLayer {
        if !is_drawn(scenario) {
            return Ok(None);
        }
        canvas.log_static(ENERGY, &AnnotationContext::new((0..=FULL_LEVEL).map(describe)))?;
        let style = LineStrips3D::update_fields().with_radii([Radius::new_ui_points(1.5)]).with_show_labels(false);
        canvas.log_static(ENERGY, &style)?;
        canvas.log_static(DEAD_MARKS, &line_style(colour::DEAD, 1.5))?;
        canvas.log_static(ALIVE, &curve_style("SNs alive", colour::CHARGE))?;
        let z_m = 0.1 * sizes.layer_m;
        Ok(Some(Box::new(Self {
            feet: sensors.positions.iter().map(|at| [at.x as f32, at.y as f32, z_m]).collect(),
            radius_m: 1.9 * sizes.bar_half_m,
            corners: if sensors.count() <= MAX_BARS { 24 } else { 8 },
            is_shown: false,
        })))
    }

    /// The two lines over a dead sensor node.
    fn cross(&self, [x_m, y_m, z_m]: Point) -> [[Point; 2]; 2] {
        let half_m = 1.3 * self.radius_m;
        let line = |sign: f32| [-1.0, 1.0].map(|end: f32| [x_m + end * half_m, y_m + sign * end * half_m, z_m]);
        [line(1.0), line(-1.0)]
    }
}

impl Layer for NodeEnergy {
    fn log_slot(&mut self, canvas: &Canvas, view: &SlotView) -> RecordingStreamResult<()> {
        let feet = || self.feet.iter().zip(view.told.answers);
        let dead = || feet().filter(|(_, answer)| **answer == Answer::Dead).map(|(foot, _)| *foot);
        let crosses = dead().flat_map(|foot| self.cross(foot));
        canvas.show(DEAD_MARKS, &LineStrips3D::update_fields().with_strips(crosses))?;
        canvas.append(ALIVE, &Scalars::single((self.feet.len() - dead().count()) as f64))?;
        let Some(features) = view.features else {
            let was_shown = std::mem::take(&mut self.is_shown);
            return if was_shown { canvas.clear(ENERGY) } else { Ok(()) };
        };
        self.is_shown = true;
        let rings = self.feet.iter().map(|foot| circle_of(*foot, self.radius_m, self.corners));
        let left = (0..self.feet.len()).map(|id| features.level(id).unwrap_or_default());
        let levels = left.map(|fraction| ClassId::from(level(fraction)));
        canvas.show(ENERGY, &LineStrips3D::update_fields().with_strips(rings).with_class_ids(levels))
    }
}

fn legend(scenario: &Scenario) -> Option<String> {
    let row = "| ring, brown → light green; cross | energy left in the SN; dead SN |\n";
    is_drawn(scenario).then(|| row.to_owned())
}

/// The number of sensor nodes that are alive, of `count`.
fn plot(layout: &mut Blueprint, scenario: &Scenario, count: usize) -> LayerTile {
    if !is_drawn(scenario) {
        return Ok(None);
    }
    let alive = views::plot(layout, "SNs alive", &[ALIVE])?;
    views::lock_axis(layout, alive, [-0.04, 1.1].map(|part| part * count as f64))?;
    Ok(Some(alive))
}

/// Level of an energy left: 0 only of an empty battery.
fn level(fraction: f64) -> u16 {
    (f64::from(FULL_LEVEL) * fraction).ceil() as u16
}

/// Name and colour of a level, which the viewer shows on hovering.
fn describe(level: u16) -> AnnotationInfo {
    let fraction = f64::from(level) / f64::from(FULL_LEVEL);
    let label =
        if level == 0 { "dead".to_owned() } else { format!("up to {:.0} % of the energy left", 100.0 * fraction) };
    AnnotationInfo { id: level, label: Some(label.into()), color: Some(colour::of_energy(fraction).into()) }
}
