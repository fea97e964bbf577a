//! The UAV and its radio channel.
