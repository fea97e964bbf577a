//! What a browser is shown, where this build has the web viewer.

use std::net::SocketAddr;
use std::path::Path;
use std::time::Duration;

use skysink_common::stop::Stop;
use skysink_ring::role::Role;
use skysink_web::{PageError, Server, WebPage};

use super::Shown;
use crate::error::Error;
use crate::report::print;

/// How often a stop is looked for.
const PAUSE: Duration = Duration::from_millis(50);

/// Serves what is shown until a stop, and says where.
pub fn serve(shown: &Shown, address: SocketAddr, stop: &Stop) -> Result<(), Error> {
    end_on_panic();
    let server = Server::start(address, page(shown)).map_err(|error| {
        Error::Usage(format!("{address}: {error}: expected a free --port, and a --bind of this machine"))
    })?;
    let address = server.address();
    let port = address.port();
    for recording in &shown.recordings {
        print(format_args!("Recording:  {}", recording.display()))?;
    }
    if let Some(live) = shown.live {
        print(format_args!("Mission:    live on port {live} of 127.0.0.1"))?;
    }
    match address.ip() {
        ip if ip.is_unspecified() => {
            print(format_args!("Address:    http://HOST:{port}/, with the name of this machine"))?;
        }
        _ => print(format_args!("Address:    http://{address}/"))?,
    }
    if address.ip().is_loopback() {
        let tunnel = |port: u16| format!(" -L {port}:{}", SocketAddr::new(address.ip(), port));
        let tunnels = tunnel(port) + &shown.live.map(tunnel).unwrap_or_default();
        print(format_args!("Elsewhere:  ssh -C{tunnels} HOST\n            there, then the same address"))?;
    }
    print("            Ctrl-C ends it")?;
    while stop.requested().is_none() {
        if let Some(error) = server.failure() {
            return Err(Error::NotServed(error.to_string()));
        }
        std::thread::sleep(PAUSE);
    }
    Ok(stop.check()?)
}

/// Ends the process where a thread of the server panics: nobody would be answered any more. tiny_http's does where it
/// has accepted a connection with the last file that the process may open.
fn end_on_panic() {
    std::panic::set_hook(Box::new(|panic| {
        let error = Error::NotServed(panic.payload_as_str().unwrap_or_default().to_owned());
        Role::Launcher.log(&error);
        std::process::exit(i32::from(error.exit_code()));
    }));
}

/// Leaves what is shown as a folder, and says how to try it.
pub fn leave(shown: &Shown, folder: &Path, stop: &Stop) -> Result<(), Error> {
    let left = page(shown).write(folder, &|| stop.requested().is_some());
    if matches!(left, Err(PageError::Stopped)) {
        stop.check()?;
    }
    left?;
    print(format_args!("Page:    {}", folder.join("index.html").display()))?;
    print(format_args!("Try it:  python3 -m http.server --directory {}", folder.display()))?;
    print("         then http://127.0.0.1:8000/")
}

fn page(shown: &Shown) -> WebPage {
    WebPage::new(&title(shown), &shown.recordings, shown.live)
}

/// The folder of the recordings, if they have one alone.
fn title(shown: &Shown) -> String {
    let folder =
        |recording: &Path| std::path::absolute(recording).ok()?.parent()?.file_name()?.to_str().map(str::to_owned);
    let mut folders: Vec<_> = shown.recordings.iter().filter_map(|recording| folder(recording)).collect();
    folders.dedup();
    match &folders[..] {
        [] => "Skysink".to_owned(),
        [folder] => folder.clone(),
        _ => format!("{} recordings", shown.recordings.len()),
    }
}
