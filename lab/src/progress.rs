//! How far a piece of research is, for whoever shows it: the lab itself prints nothing.

/// How far a sweep or a search is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LabProgress {
    /// Missions flown of a sweep, or steps taken of a search.
    pub done: u64,
    /// All missions or steps.
    pub of: u64,
    /// Loss rate η of the best flight so far, of a search.
    pub loss_rate: Option<f64>,
}

/// Hears of progress, from any thread: once at the beginning, and then as it is made.
pub type OnProgress<'a> = &'a (dyn Fn(LabProgress) + Sync);
