//! Nothing: iceoryx2 lists bindgen as a build dependency for all hosts, and uses it on QNX only.
