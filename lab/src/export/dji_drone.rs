//! The aircraft of DJI for which route files are written.

use clap::ValueEnum;

/// An aircraft of DJI that flies route files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum DjiDrone {
    /// Matrice 300 RTK.
    M300,
    /// Matrice 350 RTK.
    M350,
    /// Matrice 30.
    M30,
    /// Mavic 3 Enterprise.
    #[value(name = "mavic-3e")]
    Mavic3e,
}
