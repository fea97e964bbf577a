//! Views of a layout: the entities that they show, their cameras, axes and backgrounds.

use re_sdk::RecordingStreamResult;
use re_sdk_types::blueprint::archetypes::{
    Background, EyeControls3D, LineGrid3D, PlotLegend, ScalarAxis, SpatialInformation, VisualBounds2D,
};
use re_sdk_types::blueprint::components::{self, BackgroundKind};

use crate::blueprint::{Blueprint, Tile, class};
use crate::colour;

/// An entity.
pub(crate) fn select(entity: &str) -> String {
    format!("+ /{entity}")
}

/// An entity and all below it.
pub(crate) fn select_all(entity: &str) -> String {
    format!("+ /{entity}/**")
}

/// Excludes an entity.
pub(crate) fn omit(entity: &str) -> String {
    format!("- /{entity}")
}

/// Excludes an entity and all below it.
pub(crate) fn omit_all(entity: &str) -> String {
    format!("- /{entity}/**")
}

/// Sets the camera and the background of a 3D view.
pub(crate) fn film(layout: &Blueprint, view: Tile, camera: &EyeControls3D) -> RecordingStreamResult<()> {
    layout.set(view, camera)?;
    layout.set(view, &background())?;
    layout.set(view, &LineGrid3D::new().with_visible(false))?; // the area has its own
    layout.set(view, &SpatialInformation::update_fields().with_show_axes(false))
}

/// A plot whose title names the curves. A legend would cover them.
pub(crate) fn plot<E: AsRef<str>>(layout: &mut Blueprint, name: &str, entities: &[E]) -> RecordingStreamResult<Tile> {
    let entities: Vec<_> = entities.iter().map(|entity| select(entity.as_ref())).collect();
    let view = layout.view(class::CURVES, name, "", &entities)?;
    layout.set(view, &PlotLegend::new().with_visible(false))?;
    Ok(view)
}

/// Fixes the range of the y axis of a plot.
pub(crate) fn lock_axis(layout: &Blueprint, plot: Tile, range: [f64; 2]) -> RecordingStreamResult<()> {
    layout.set(plot, &ScalarAxis::new().with_range(range).with_zoom_lock(true))
}

/// A 2D view of the entities below `root` and those that `others` selects, with these bounds in x and y.
pub(crate) fn picture(
    layout: &mut Blueprint,
    name: &str,
    root: &str,
    others: &[String],
    bounds: [[f64; 2]; 2],
) -> RecordingStreamResult<Tile> {
    let view = layout.view(class::PICTURE, name, root, &[&[select_all(root)], others].concat())?;
    frame(layout, view, bounds)?;
    Ok(view)
}

/// Sets the bounds in x and y and the background of a 2D view.
pub(crate) fn frame(layout: &Blueprint, view: Tile, [x, y]: [[f64; 2]; 2]) -> RecordingStreamResult<()> {
    let bounds = re_sdk_types::datatypes::Range2D { x_range: x.into(), y_range: y.into() };
    layout.set(view, &VisualBounds2D::new(components::VisualBounds2D(bounds)))?;
    layout.set(view, &background())
}

fn background() -> Background {
    Background::new(BackgroundKind::SolidColor).with_color(colour::BACKGROUND)
}
