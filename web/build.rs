//! Copies the web viewer out of `re_web_viewer_server`, which carries it, to where this crate embeds it.
//!
//! As a build dependency that crate leaves the features of everything else as they are.

use std::path::Path;
use std::{env, fs};

use re_web_viewer_server::WebViewerData;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let folder = env::var_os("OUT_DIR").expect("set by cargo");
    let viewer = WebViewerData::load(None).expect("the published crate embeds the viewer");
    for (name, bytes) in [
        ("re_viewer.js", viewer.viewer_js()),
        ("re_viewer_bg.wasm", viewer.viewer_wasm()),
        ("favicon.ico", viewer.favicon()),
    ] {
        fs::write(Path::new(&folder).join(name), bytes).expect("a folder to write to");
    }
}
