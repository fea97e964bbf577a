//! Clearing up after processes that were killed: iceoryx2 frees what they held when somebody asks it to.

use std::fs;
use std::path::Path;

use iceoryx2::node::NodeView;
use iceoryx2::prelude::{CallbackProgression, Config, Node, NodeState, SemanticString, Service};

/// Frees what processes that died have left behind; a writer would wait for their buffers for ever.
pub fn remove_dead_nodes<S: Service>(config: &Config) {
    let _ = Node::<S>::list(config, |state| {
        if let NodeState::Dead(node) = state {
            let _ = node.try_remove_stale_resources(); // another process may have been quicker
        }
        CallbackProgression::Continue
    });
}

/// The same, and removes what iceoryx2 leaves of a process that was killed while it joined: a node without details, which
/// would be looked at again by every process that joins. To be done by one process of the ring.
pub(crate) fn purge_dead_nodes<S: Service>(config: &Config) {
    let _ = Node::<S>::list(config, |state| {
        if let NodeState::Dead(node) = state {
            let (id, bare) = (node.id().value(), node.details().is_none());
            if node.try_remove_stale_resources().is_err() && bare {
                remove_files(config, id);
            }
        }
        CallbackProgression::Continue
    });
}

fn remove_files(config: &Config, id: u128) {
    let root = Path::new(std::str::from_utf8(config.global.root_path().as_bytes()).unwrap_or_default());
    let nodes = root.join(String::from_utf8_lossy(config.global.node.directory.as_bytes()).as_ref());
    let _ = fs::remove_dir_all(nodes.join(id.to_string()));
    let prefix = format!("{}{id}.", String::from_utf8_lossy(config.global.prefix.as_bytes()));
    for entry in fs::read_dir(&nodes).into_iter().flatten().flatten() {
        if entry.file_name().to_string_lossy().starts_with(&prefix) {
            let _ = fs::remove_file(entry.path());
        }
    }
}
