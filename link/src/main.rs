//! iceoryx2's link over zenoh, for a ring: `iox2-link-tunnel-zenoh` with the same crates and options, and one change.
//!
//! `iox2-link-tunnel-zenoh` discovers new services before each sample (`spin` in its tunnel.rs), which reads a file for
//! each service and each process that has opened it: some 10 ms. This program does so twice a second.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Result, anyhow};
use clap::Parser;
use iceoryx2::prelude::*;
use iceoryx2_integrations_zenoh_link_carrier::ZenohCarrier;
use iceoryx2_link::Link;
use iceoryx2_link_backend::AllowList;
use iceoryx2_link_tunnel::Tunnel;

/// Period of the discovery of new services on all hosts.
const DISCOVER_EVERY: Duration = Duration::from_millis(500);

/// iceoryx2's link over zenoh. It runs in the folder of a ring, where it finds config/iceoryx2.toml.
#[derive(Parser)]
#[command(version, max_term_width = 80)]
struct Cli {
    /// zenoh configuration file.
    #[arg(long, short)]
    zenoh_config: PathBuf,
    /// Services to carry, by wildcards (repeatable).
    #[arg(long, short)]
    allow: Vec<String>,
    /// Event services of this host that wake the link (repeatable).
    #[arg(long)]
    listener: Vec<String>,
    /// Look for samples so often, whatever wakes it [ms].
    #[arg(long, default_value_t = 10)]
    poll: u64,
    /// Be woken by samples of other hosts, too; it always is.
    #[arg(long)]
    reactive: bool,
}

fn main() -> Result<()> {
    set_log_level_from_env_or(LogLevel::Error);
    let cli = Cli::parse();
    let config = iceoryx2::config::Config::global_config();
    let zenoh = zenoh::Config::from_file(&cli.zenoh_config).map_err(anyhow::Error::from_boxed)?;
    let node = NodeBuilder::new().config(config).create::<ipc::Service>()?;
    let allowed = AllowList::new(&cli.allow);
    let link = Link::new(node, Tunnel::new(ZenohCarrier::create(zenoh)?, config));
    let mut link = link.with_filter(move |name: &ServiceName| allowed.admits(name.as_str()));

    let wait_set = WaitSetBuilder::new().create::<ipc::Service>()?;
    let remote = link.listener()?;
    let mut local = Vec::new();
    for name in &cli.listener {
        let service = link.node().service_builder(&name.as_str().try_into()?).event().open_or_create()?;
        local.push(service.listener_builder().create()?);
    }
    let _poll = wait_set.attach_interval(Duration::from_millis(cli.poll))?;
    let _remote = wait_set.attach_notification(&remote)?;
    let _local = local.iter().map(|listener| wait_set.attach_notification(listener)).collect::<Result<Vec<_>, _>>()?;
    let mut discovered: Option<Instant> = None;
    wait_set
        .wait_and_process(|_| {
            // Drain all notifications: one that arrives meanwhile may not wake the set again.
            while remote.try_wait(|_| {}).is_ok_and(|woken| woken > 0) {}
            for listener in &local {
                while listener.try_wait(|_| {}).is_ok_and(|woken| woken > 0) {}
            }
            if discovered.is_none_or(|discovered| discovered.elapsed() >= DISCOVER_EVERY) {
                if let Err(error) = link.discover() {
                    eprintln!("discovery: {error}");
                }
                discovered = Some(Instant::now());
            }
            if let Err(error) = link.propagate() {
                eprintln!("propagation: {error}");
            }
            CallbackProgression::Continue
        })
        .map_err(|error| anyhow!("wait: {error:?}"))?;
    Ok(())
}
