//! Serves or writes the page, in builds with the web viewer.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::Duration;

use skysink_common::stop::Stop;
use skysink_common::terminal::{shell_path, shell_word};
use skysink_web::{PageError, Server, Site, WebPage};

use super::content::PageContent;
use crate::error::Error;
use crate::report::print;

/// Time between two checks for a stop.
const PAUSE: Duration = Duration::from_millis(50);

/// Serves the page until a stop, and prints its address. Requests may name this machine or one of `hosts`.
pub fn serve(content: &PageContent, address: SocketAddr, hosts: &[String], stop: &Stop) -> Result<(), Error> {
    let site = Site::new(page(content), hosts).map_err(|error| Error::NotServed(error.to_string()))?;
    let path = site.path();
    let server = Server::start(address, site).map_err(|error| {
        Error::Usage(format!("{address}: {error}: expected a free --port, and a --bind of this machine"))
    })?;
    let address = server.address;
    let port = address.port();
    for recording in &content.recordings {
        print(format_args!("Recording:  {}", recording.path.display()))?;
    }
    if let Some(live) = content.live {
        print(format_args!("Mission:    live on port {live} of 127.0.0.1"))?;
    }
    match address.ip() {
        ip if ip.is_unspecified() => {
            print(format_args!(
                "Address:    http://HOST:{port}{path}, with the name or an IP address of this machine"
            ))?;
        }
        _ => print(format_args!("Address:    http://{address}{path}"))?,
    }
    for host in hosts {
        print(format_args!(
            "Proxy:      https://{host}/PREFIX{path} with the proxy's prefix of the port, such as proxy/{port}, or none"
        ))?;
    }
    if address.ip().is_loopback() {
        let tunnel =
            |port: u16| format!(" -L {}", shell_word(format!("{port}:{}", SocketAddr::new(address.ip(), port))));
        let tunnels = tunnel(port) + &content.live.map(tunnel).unwrap_or_default();
        print(format_args!("Remotely:   ssh -C{tunnels} HOST\n            then open the same address"))?;
    }
    print("            Ctrl-C stops the server")?;
    while stop.requested().is_none() {
        if let Some(error) = server.failure() {
            return Err(Error::NotServed(error.to_string()));
        }
        std::thread::sleep(PAUSE);
    }
    Ok(stop.check()?)
}

/// Writes the page into a folder, and prints how to open it.
pub fn write(content: &PageContent, folder: &Path, stop: &Stop) -> Result<(), Error> {
    let written = page(content).write(folder, &|| stop.requested().is_some());
    if matches!(written, Err(PageError::Stopped)) {
        stop.check()?;
    }
    written?;
    print(format_args!("Page:    {}", folder.join("index.html").display()))?;
    print(format_args!("Try it:  python3 -m http.server --directory {}", shell_path(folder)))?;
    print("         then http://127.0.0.1:8000/")
}

fn page(content: &PageContent) -> WebPage {
    let paths: Vec<PathBuf> = content.recordings.iter().map(|recording| recording.path.clone()).collect();
    WebPage::new(&title(content), &paths, content.live)
}

/// The name of the folder of the recordings, or their number if they are in several folders.
fn title(content: &PageContent) -> String {
    let folder =
        |recording: &Path| std::path::absolute(recording).ok()?.parent()?.file_name()?.to_str().map(str::to_owned);
    let mut folders: Vec<_> = content.recordings.iter().filter_map(|recording| folder(&recording.path)).collect();
    folders.dedup();
    match &folders[..] {
        [] => "Skysink".to_owned(),
        [folder] => folder.clone(),
        _ => format!("{} recordings", content.recordings.len()),
    }
}
