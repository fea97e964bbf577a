//! Notes what the executables are built from: commit, compiler and target.

use std::env;
use std::fs;
use std::path::Path;
use std::process::Command;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let root = env::var("CARGO_MANIFEST_DIR").expect("set by cargo");
    let compiler = env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let compiler = output(Command::new(compiler).arg("--version")).unwrap_or_default();
    let commit = commit(Path::new(&root)).unwrap_or_else(|| "no commit".to_owned());
    let target = env::var("TARGET").expect("set by cargo");
    println!("cargo::rustc-env=SKYSINK_RUSTC={compiler}");
    println!("cargo::rustc-env=SKYSINK_BUILD={commit}, {compiler}, {target}");
}

/// The commit of the checkout in the folder `root`, and whether files differ from it; `None` if it is no checkout.
fn commit(root: &Path) -> Option<String> {
    let git = |arguments: &[&str]| output(Command::new("git").arg("-C").arg(root).args(arguments));
    let checkout = git(&["rev-parse", "--show-toplevel"])?;
    if fs::canonicalize(checkout).ok()? != fs::canonicalize(root).ok()? {
        return None; // unpacked somewhere in another checkout
    }
    // This package alone, which depends on all others, is built again if the commit or a source file has changed.
    for file in ["HEAD", "logs/HEAD"] {
        watch(&root.join(git(&["rev-parse", "--git-path", file])?));
    }
    for folder in fs::read_dir(root).ok()?.flatten().map(|entry| entry.path()) {
        if folder.join("Cargo.toml").exists() {
            watch(&folder.join("src"));
        }
    }
    ["Cargo.toml", "Cargo.lock", "src"].iter().for_each(|name| watch(&root.join(name)));
    git(&["describe", "--always", "--long", "--dirty", "--abbrev=12", "--match=v*"])
}

/// Has cargo run this program again if the file, or any in the folder, has changed.
fn watch(path: &Path) {
    if path.exists() {
        println!("cargo::rerun-if-changed={}", path.display());
    }
}

/// What a command prints, if it succeeds.
fn output(command: &mut Command) -> Option<String> {
    let output = command.output().ok().filter(|output| output.status.success())?;
    Some(String::from_utf8(output.stdout).ok()?.trim().to_owned())
}
