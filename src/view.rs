//! `skysink view` and `skysink page`: recordings in a browser, served or exported as a static page.

#[cfg(feature = "viewer")]
mod browser;
mod content;
mod recording;

use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpStream};
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;
use skysink_common::stop::Stop;

use crate::error::Error;
#[cfg(feature = "viewer")]
use browser::{serve, write};
use content::{PageContent, newest, recordings};

/// The default folder of runs.
const RUNS: &str = "runs";

/// Timeout for a connection to a server on this machine.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(1);

/// Show recordings in a browser.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  skysink view                          the newest recording in runs/
  skysink view runs/letter-uts-1 runs/letter-gfs-1
  skysink view comparison/comparison.rrd
  skysink view --live                   a running mission of skysink run --live
  skysink view --host hub.example.org   behind the proxy of a JupyterHub

The printed address contains a secret, so that no other user can read the
recordings. The page loads nothing from other hosts. For a browser on another
machine, the command prints the ssh command that forwards the port. Behind a
proxy the printed path follows the proxy's own.")]
pub struct ViewCommand {
    /// Run folders or recordings (.rrd) [default: the newest in runs/].
    #[arg(value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Show the running mission that skysink run --live serves on PORT or 9876.
    #[arg(long, value_name = "PORT", num_args = 0..=1, require_equals = true, default_missing_value = "9876")]
    live: Option<u16>,
    /// Address to listen on. Whoever knows the printed address can read the recordings; the connection is not
    /// encrypted.
    #[arg(long, value_name = "ADDRESS", default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    bind: IpAddr,
    /// Port to listen on; 0 selects a free port.
    #[arg(long, default_value_t = 9090)]
    port: u16,
    /// Also answer requests for the host NAME, that of a proxy in front of this machine (repeatable).
    #[arg(long = "host", value_name = "NAME", value_parser = host_name)]
    hosts: Vec<String>,
}

/// Export a recording and its viewer as a static web page.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  skysink page runs/letter-uts-1 page
  python3 -m http.server --directory page   then http://127.0.0.1:8000/")]
pub struct PageCommand {
    /// Run folder or recording (.rrd).
    run: PathBuf,
    /// Output folder.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

impl ViewCommand {
    /// Serves the recordings until a stop.
    pub fn run(self, stop: &Stop) -> Result<(), Error> {
        if let Some(port) = self.live {
            self.check_live(port)?;
        }
        let runs = match (&self.runs[..], self.live) {
            ([], None) => vec![newest(Path::new(RUNS))?],
            _ => self.runs.clone(),
        };
        let content = PageContent { recordings: recordings(&runs)?, live: self.live };
        content.warn();
        serve(&content, SocketAddr::new(self.bind, self.port), &self.hosts, stop)
    }

    /// Fails if no mission is served on `port`, or the browser could not connect to it.
    fn check_live(&self, port: u16) -> Result<(), Error> {
        if self.bind != Ipv4Addr::LOCALHOST {
            let message = "expected --live without --bind: the mission is served on 127.0.0.1 only; use an ssh tunnel";
            return Err(Error::Usage(format!("--live with --bind {}: {message}", self.bind)));
        }
        if let Some(host) = self.hosts.first() {
            let message = "expected --live without --host: no proxy forwards the mission; use an ssh tunnel";
            return Err(Error::Usage(format!("--live with --host {host}: {message}")));
        }
        TcpStream::connect_timeout(&SocketAddr::from((Ipv4Addr::LOCALHOST, port)), CONNECT_TIMEOUT).map(drop).map_err(
            |error| {
                let message = format!("expected a running mission, by `skysink run --live={port}` in another terminal");
                Error::Usage(format!("--live={port}: port {port} of 127.0.0.1: {error}: {message}"))
            },
        )
    }
}

impl PageCommand {
    /// Writes the page.
    pub fn run(self, stop: &Stop) -> Result<(), Error> {
        let Self { run, folder } = self;
        let content = PageContent { recordings: recordings(&[run])?, live: None };
        content.warn();
        write(&content, &folder, stop)
    }
}

/// Parses the name of a host, without a port.
fn host_name(text: &str) -> Result<String, String> {
    let name = text.trim_end_matches('.').to_ascii_lowercase();
    let is_label = |label: &str| {
        let is_allowed = |byte: u8| byte.is_ascii_alphanumeric() || b"-_".contains(&byte);
        !label.is_empty() && label.bytes().all(is_allowed)
    };
    let is_name = name.split('.').all(is_label);
    is_name
        .then_some(name)
        .ok_or_else(|| "expected the name of a host such as hub.example.org, without port".to_owned())
}

#[cfg(not(feature = "viewer"))]
fn serve(content: &PageContent, _: SocketAddr, _: &[String], _: &Stop) -> Result<(), Error> {
    Err(Error::NoWebViewer(content.rerun_command()))
}

#[cfg(not(feature = "viewer"))]
fn write(content: &PageContent, _: &Path, _: &Stop) -> Result<(), Error> {
    Err(Error::NoWebViewer(content.rerun_command()))
}
