//! A page as PDF and PNG, converted from SVG by krilla and resvg.

use std::path::{Path, PathBuf};

use krilla::metadata::Metadata;
use krilla::page::PageSettings;
use krilla_svg::{SurfaceExt, SvgSettings};
use resvg::{tiny_skia, usvg};
use skysink_mission::files::write_whole;

use super::page::{DEJAVU_SANS, Look};
use crate::error::LabError;

/// Points per pixel of a document.
const PT_PER_PIXEL: f32 = 0.75;

/// Writes the document `svg` as `stem`.pdf, and as `stem`.png with this width [pixels]; returns both files.
pub fn write(svg: &str, look: &Look, width: f64, stem: &Path) -> Result<[PathBuf; 2], LabError> {
    let mut options = usvg::Options::default();
    options.fontdb_mut().load_font_data(DEJAVU_SANS.to_vec());
    let tree = usvg::Tree::from_str(svg, &options).expect("the document is valid SVG");
    let files = ["pdf", "png"].map(|extension| stem.with_added_extension(extension));
    write_whole(&files[0], &pdf(&tree, look))?;
    write_whole(&files[1], &png(&tree, width))?;
    Ok(files)
}

/// The page as PDF.
fn pdf(tree: &usvg::Tree, look: &Look) -> Vec<u8> {
    let size = tree.size().scale_by(PT_PER_PIXEL).expect("a page is not empty");
    let size = krilla::geom::Size::from_wh(size.width(), size.height()).expect("a page is not empty");
    let mut document = krilla::Document::new();
    document.set_metadata(Metadata::new().title(look.title.clone()).description(look.description.clone()));
    let mut page = document.start_page_with(PageSettings::new(size));
    let mut surface = page.surface();
    surface.draw_svg(tree, size, SvgSettings::default()).expect("the document uses supported features only");
    surface.finish();
    page.finish();
    document.finish().expect("the document uses supported features only")
}

/// The page as PNG with this width [pixels].
fn png(tree: &usvg::Tree, width: f64) -> Vec<u8> {
    let scale = width as f32 / tree.size().width();
    let [width, height] = [tree.size().width(), tree.size().height()].map(|pixels| (pixels * scale).round() as u32);
    let mut pixels = tiny_skia::Pixmap::new(width, height).expect("a page fits into memory");
    resvg::render(tree, tiny_skia::Transform::from_scale(scale, scale), &mut pixels.as_mut());
    pixels.encode_png().expect("memory takes everything")
}
