//! Serves the files of a page over HTTP, and no other files.

use std::fs::File;
use std::io::{self, Read};
use std::net::{SocketAddr, TcpListener};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex, PoisonError};

use tiny_http::{Header, Method, Request, Response};

use crate::page::{Content, WebPage};

/// Number of threads, each of which answers one request at a time. Up to seven slow clients do not block others.
const THREADS: usize = 8;

/// A server for a page, which runs until the process ends.
#[derive(Debug)]
pub struct Server {
    /// The address that the server listens on.
    pub address: SocketAddr,
    failures: Mutex<Receiver<io::Error>>,
}

impl Server {
    /// Starts to serve `page` on `address`; port 0 selects a free port.
    ///
    /// # Errors
    /// If the address is in use, or does not belong to this machine.
    pub fn start(address: SocketAddr, page: WebPage) -> io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        let address = listener.local_addr()?;
        let http = tiny_http::Server::from_listener(listener, None).map_err(io::Error::other)?;
        let shared = Arc::new((http, page));
        let (failed, failures) = channel();
        for _ in 0..THREADS {
            let shared = Arc::clone(&shared);
            let failed = failed.clone();
            std::thread::spawn(move || {
                let (http, page) = &*shared;
                loop {
                    match http.recv() {
                        Ok(request) => drop(answer(page, request)), // an error means that the browser has disconnected
                        Err(error) => return drop(failed.send(error)),
                    }
                }
            });
        }
        Ok(Self { address, failures: Mutex::new(failures) })
    }

    /// The error that has stopped a thread from accepting connections, if any.
    pub fn failure(&self) -> Option<io::Error> {
        self.failures.lock().unwrap_or_else(PoisonError::into_inner).try_recv().ok()
    }
}

/// Answers a request.
fn answer(page: &WebPage, request: Request) -> io::Result<()> {
    if !matches!(request.method(), Method::Get | Method::Head) {
        return request.respond(Response::from_string("expected GET or HEAD\n").with_status_code(405));
    }
    let path = request.url().split(['?', '#']).next().unwrap_or_default();
    let found = page.find(path).and_then(|(content, kind)| Some((open(content).ok()?, kind)));
    let Some(((reader, length), kind)) = found else {
        return request.respond(Response::from_string("not found\n").with_status_code(404));
    };
    let header = |name: &str, value: &str| Header::from_bytes(name, value).expect("plain letters");
    let headers = vec![
        header("Content-Type", kind),
        header("X-Content-Type-Options", "nosniff"),
        header("Cross-Origin-Resource-Policy", "same-origin"),
        header("Cache-Control", "no-cache"), // a recording may grow, and another page may use the port later
    ];
    let response = Response::new(200.into(), headers, reader, usize::try_from(length).ok(), None);
    request.respond(response.with_chunked_threshold(usize::MAX)) // with a length, the browser can show the progress
}

/// A reader for a file, and its length. A growing file is read up to its length at this moment.
fn open(content: &Content) -> io::Result<(Box<dyn Read + Send + '_>, u64)> {
    Ok(match content {
        Content::Text(text) => (Box::new(text.as_bytes()), text.len() as u64),
        Content::Embedded(bytes) => (Box::new(*bytes), bytes.len() as u64),
        Content::File(path) => {
            let file = File::open(path)?;
            let length = file.metadata()?.len();
            (Box::new(file.take(length)), length)
        }
    })
}
