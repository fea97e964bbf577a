//! `skysink view` and `skysink page`: recordings in a browser, served or left as a folder.

#[cfg(feature = "viewer")]
mod browser;

use std::fs::{self, File};
use std::io::{self, Read as _};
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpStream};
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;
use skysink_common::error::InputError;
use skysink_common::stop::Stop;
use skysink_mission::error::FileContext;

use crate::error::Error;
#[cfg(feature = "viewer")]
use browser::{leave, serve};

/// Where runs are put if nothing else is said.
const RUNS: &str = "runs";

/// Beginning of every recording of rerun.
const MAGIC: &[u8] = b"RRF2";

/// How long a server of this machine may take to answer.
const ANSWER: Duration = Duration::from_secs(1);

/// Options of `skysink view`.
#[derive(Debug, Args)]
pub struct ViewOptions {
    /// Run folders, or recordings (.rrd) [default: the newest run of runs/].
    #[arg(value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Show the mission that skysink run --live flies, on port 9876 if none is given.
    #[arg(long, value_name = "PORT", num_args = 0..=1, require_equals = true, default_missing_value = "9876")]
    live: Option<u16>,
    /// Address to serve on; whoever reaches it can read the recordings.
    #[arg(long, value_name = "ADDRESS", default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    bind: IpAddr,
    /// Port to serve on; 0 takes a free one.
    #[arg(long, default_value_t = 9090)]
    port: u16,
}

/// Options of `skysink page`.
#[derive(Debug, Args)]
pub struct PageOptions {
    /// Run folder, or recording (.rrd).
    run: PathBuf,
    /// Folder to write.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

impl ViewOptions {
    /// Serves the recordings until a stop.
    ///
    /// # Errors
    /// If there is no such recording, or the address is taken; on the stop.
    pub fn view(self, stop: &Stop) -> Result<(), Error> {
        if let Some(port) = self.live {
            self.check_live(port)?;
        }
        let runs = match (&self.runs[..], self.live) {
            ([], None) => vec![newest_run(Path::new(RUNS))?],
            _ => self.runs.clone(),
        };
        let shown = Shown { recordings: recordings(&runs)?, live: self.live };
        serve(&shown, SocketAddr::new(self.bind, self.port), stop)
    }

    /// Fails where no mission is served, or the browser could not reach it.
    fn check_live(&self, port: u16) -> Result<(), Error> {
        if self.bind != Ipv4Addr::LOCALHOST {
            let message =
                "expected it without --bind: the mission is served on 127.0.0.1 alone; an ssh tunnel leads there";
            return Err(Error::Usage(format!("--live with --bind {}: {message}", self.bind)));
        }
        TcpStream::connect_timeout(&SocketAddr::from((Ipv4Addr::LOCALHOST, port)), ANSWER).map(drop).map_err(|error| {
            let message = format!("expected a mission under way, by `skysink run --live={port}` in another terminal");
            Error::Usage(format!("--live={port}: port {port} of 127.0.0.1: {error}: {message}"))
        })
    }
}

impl PageOptions {
    /// Leaves the page.
    ///
    /// # Errors
    /// If there is no such recording, or the folder is not free or cannot be written.
    pub fn write(self) -> Result<(), Error> {
        let Self { run, folder } = self;
        let runs = [run];
        leave(&Shown { recordings: recordings(&runs)?, live: None }, &folder)
    }
}

/// What a page shows.
struct Shown {
    recordings: Vec<PathBuf>,
    live: Option<u16>,
}

#[cfg(not(feature = "viewer"))]
fn serve(shown: &Shown, _: SocketAddr, _: &Stop) -> Result<(), Error> {
    Err(Error::NoWebViewer(shown.rerun()))
}

#[cfg(not(feature = "viewer"))]
fn leave(shown: &Shown, _: &Path) -> Result<(), Error> {
    Err(Error::NoWebViewer(shown.rerun()))
}

#[cfg(not(feature = "viewer"))]
impl Shown {
    /// How to open it without this build.
    fn rerun(&self) -> String {
        let files = self.recordings.iter().map(|recording| format!(" {}", recording.display()));
        let live = self.live.map(|port| format!(" rerun+http://127.0.0.1:{port}/proxy"));
        format!("rerun{}", files.chain(live).collect::<String>())
    }
}

/// The run in `runs` that was written last.
fn newest_run(runs: &Path) -> Result<PathBuf, InputError> {
    let written = |folder: &PathBuf| fs::metadata(folder.join("slots.csv")).and_then(|trace| trace.modified()).ok();
    let folders = fs::read_dir(runs).into_iter().flatten().flatten().map(|entry| entry.path());
    let newest = folders.filter_map(|folder| Some((written(&folder)?, folder))).max();
    newest.map(|(_, folder)| folder).ok_or_else(|| {
        InputError::new("runs", runs, "no run in it: expected one by `skysink run`, or the name of a run or recording")
    })
}

/// All recordings of the runs, or these files themselves.
fn recordings(runs: &[PathBuf]) -> Result<Vec<PathBuf>, Error> {
    let mut recordings = Vec::new();
    for run in runs {
        let refuse = |message: &str| Err(InputError::new("recording", run, message).into());
        if !run.is_dir() {
            if !is_recording(run).map_err(|error| InputError::new("recording", run, error))? {
                return refuse("expected a recording of rerun (.rrd), or a folder with one");
            }
            recordings.push(run.clone());
            continue;
        }
        let names = fs::read_dir(run).at(run)?.flatten().map(|entry| entry.path());
        let mut found: Vec<_> = names.filter(|path| path.extension().is_some_and(|ending| ending == "rrd")).collect();
        if found.is_empty() {
            return refuse("no recording in it: `skysink replay` makes one of a finished run");
        }
        found.sort_by_key(|path| (path.as_os_str().len(), path.clone())); // mission.rrd before mission-2.rrd
        recordings.extend(found);
    }
    Ok(recordings)
}

/// Whether a file begins as a recording does.
fn is_recording(path: &Path) -> io::Result<bool> {
    let mut begin = Vec::new();
    File::open(path)?.take(MAGIC.len() as u64).read_to_end(&mut begin)?;
    Ok(begin == MAGIC)
}
