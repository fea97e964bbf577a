//! What a program is built from, so that its results can be traced to the code.

use std::sync::OnceLock;

/// Version of Skysink.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

static BUILD: OnceLock<&str> = OnceLock::new();

/// Says what this program is built from. Only the first call counts.
///
/// The executables and the Python package call it, because only they are built again for each commit.
pub fn identify(build: &'static str) {
    BUILD.get_or_init(|| build);
}

/// Commit, compiler and target of this program: `777e2b2cd21a-dirty, rustc 1.95.0 (...), x86_64-unknown-linux-gnu`. The
/// commit is that of `git describe --long --dirty`, or `no commit` if it was not built in a checkout. A program that
/// has not called [`identify`] has `no commit` alone.
#[must_use]
pub fn build() -> &'static str {
    BUILD.get().unwrap_or(&"no commit")
}

/// The commit of a [`build`].
#[must_use]
pub fn commit_of(build: &str) -> &str {
    build.split(',').next().unwrap_or_default()
}
