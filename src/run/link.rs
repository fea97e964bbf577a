//! The link of a ring to other hosts: a process that runs iceoryx2's tunnel over zenoh.

use std::path::Path;

use skysink_common::error::InputError;
use skysink_common::scenario::Scenario;
use skysink_common::sensors::SensorList;
use skysink_mission::error::FileContext;
use skysink_ring::folder::RingFolder;
use skysink_ring::role::Role;
use skysink_ring::terms::LinkTerms;
use skysink_ring::topics::{LinkedServices, SCHEMA};

use crate::error::Error;
use crate::run::executables::is_command;
use crate::run::process::{Invocation, Process};
use crate::run::restart::{OF_LINK, Restart, Restarts};

/// Link programs; the first one found in PATH is started. `skysink-link` is in the folder `link` of this repository,
/// `iox2-link-tunnel-zenoh` is part of iceoryx2.
pub const PROGRAMS: [&str; 2] = ["skysink-link", "iox2-link-tunnel-zenoh"];

/// Time between two scans of the link for samples without an event [ms].
const POLL_MS: u64 = 10;

/// Environment variables of the link, unless they are set already. They limit the log to errors, and set enough threads
/// that closing the connection to a lost host, which can block a thread for 10 s, does not delay other connections.
const ENVIRONMENT: [(&str, &str); 2] = [
    ("IOX2_LOG_LEVEL", "error"),
    (
        "ZENOH_RUNTIME",
        "(tx: (worker_threads: 4), rx: (worker_threads: 4), acc: (worker_threads: 2), net: (worker_threads: 4))",
    ),
];

/// The terms that all hosts of a ring with this scenario must agree on.
///
/// # Errors
/// If its sensor list is refused.
pub fn terms(scenario: &Scenario) -> Result<LinkTerms, InputError> {
    let list = SensorList::of(scenario)?;
    Ok(LinkTerms { version: SCHEMA, scenario: list.hash(scenario.hash()) })
}

/// The installed link program.
fn find_program() -> Result<&'static str, Error> {
    PROGRAMS.into_iter().find(|program| is_command(program)).ok_or_else(|| {
        let [ours, theirs] = PROGRAMS;
        Error::Usage(format!(
            "--link: neither {ours} nor {theirs} is in the PATH: `cargo install --locked --path link`"
        ))
    })
}

/// Checks that the configuration file exists and a link program is installed.
///
/// # Errors
/// [`Error::Usage`].
pub fn check(config: &Path) -> Result<(), Error> {
    if !config.is_file() {
        let config = config.display();
        return Err(Error::Usage(format!("--link {config}: expected a zenoh configuration file, such as link.json5")));
    }
    find_program().map(drop)
}

/// The link of `ring` with the zenoh configuration file `config`, not started yet. `local` are the roles of the
/// processes on this host. It runs in the ring folder, where it finds the iceoryx2 configuration of the ring.
///
/// # Errors
/// If no link program is installed, or the path of the file is unknown.
pub fn process(ring: &RingFolder, config: &Path, local: &[Role]) -> Result<Process, Error> {
    let program = find_program()?;
    let config = std::path::absolute(config).at(config)?;
    let LinkedServices { all, written_here } = LinkedServices::of(&ring.terms(), local);
    let mut arguments = vec!["--zenoh-config".to_owned(), config.display().to_string()];
    arguments.extend(["--reactive".to_owned(), "--poll".to_owned(), POLL_MS.to_string()]);
    arguments.extend(all.into_iter().flat_map(|service| ["--allow".to_owned(), service]));
    arguments.extend(written_here.into_iter().flat_map(|service| ["--listener".to_owned(), service]));
    let is_unset = |(name, _): &(&str, &str)| std::env::var_os(name).is_none();
    let invocation = Invocation {
        program: program.into(),
        arguments: arguments.into_iter().map(Into::into).collect(),
        environment: ENVIRONMENT.into_iter().filter(is_unset).map(|(name, value)| (name, value.into())).collect(),
        folder: Some(ring.path().to_owned()),
        prefix: "link: ",
        ends_with_launcher: true,
    };
    Ok(Process::new(None, invocation, Restarts::new(Restart::OnFailure, &OF_LINK)))
}
