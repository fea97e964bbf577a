//! Skysink.
