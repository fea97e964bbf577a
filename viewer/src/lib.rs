//! Everything of a mission as a rerun recording.
