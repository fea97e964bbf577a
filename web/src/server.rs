//! Serves a site over HTTP/1.1.
//!
//! What a client can make the server hold is bounded: one of `connections`, a head of `MAX_HEAD_BYTES` for `head`, no
//! body, and answers that it does not read for `stall`.

use std::convert::Infallible;
use std::io;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use hyper::Request;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::io::{AsyncRead, AsyncReadExt as _, AsyncWrite, AsyncWriteExt as _};
use tokio::runtime;
use tokio::task::JoinSet;
use tokio_io_timeout::TimeoutWriter;

use crate::site::Site;

/// Number of threads, so that a slow disk under one recording does not block the others.
const THREADS: usize = 4;

/// Largest head of a request [bytes].
const MAX_HEAD_BYTES: usize = 1 << 16;

/// What clients may take.
#[derive(Debug, Clone, Copy)]
struct Limits {
    /// Number of connections at once; further ones wait in the backlog of the listener.
    connections: usize,
    /// Time for the head of the next request, after which a connection is closed.
    head: Duration,
    /// Time without a byte read by the client while an answer waits, after which a connection is closed.
    stall: Duration,
}

/// The limits of a server: a browser that reads slowly is waited for, one that does not read is not.
const LIMITS: Limits = Limits { connections: 64, head: Duration::from_secs(5), stall: Duration::from_secs(30) };

/// A server for a site, which runs until the process ends.
#[derive(Debug)]
pub struct Server {
    /// The address that the server listens on.
    pub address: SocketAddr,
    failures: Receiver<io::Error>,
}

impl Server {
    /// Starts to serve `site` on `address`; port 0 selects a free port.
    ///
    /// # Errors
    /// If the address is in use, or does not belong to this machine.
    pub fn start(address: SocketAddr, site: Site) -> io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let runtime = runtime::Builder::new_multi_thread().worker_threads(THREADS).enable_all().build()?;
        let (failed, failures) = channel();
        std::thread::spawn(move || failed.send(runtime.block_on(accept(listener, site.into(), LIMITS))));
        Ok(Self { address, failures })
    }

    /// The error that has stopped the server from accepting connections, if any.
    pub fn failure(&self) -> Option<io::Error> {
        self.failures.try_recv().ok()
    }
}

/// Accepts connections, and returns the error that prevents it.
async fn accept(listener: TcpListener, site: Arc<Site>, limits: Limits) -> io::Error {
    let listener = match tokio::net::TcpListener::from_std(listener) {
        Ok(listener) => listener,
        Err(error) => return error,
    };
    let mut connections = JoinSet::new();
    loop {
        while connections.try_join_next().is_some() {}
        if connections.len() >= limits.connections {
            connections.join_next().await;
        }
        match listener.accept().await {
            Ok((stream, _)) => drop(connections.spawn(connection(stream, Arc::clone(&site), limits))),
            Err(error) if error.kind() == io::ErrorKind::ConnectionAborted => {}
            // Without a free file descriptor: the end of a connection frees one.
            Err(error) => {
                if connections.join_next().await.is_none() {
                    return error;
                }
            }
        }
    }
}

/// Answers the requests of a connection until either side closes it.
async fn connection(stream: impl AsyncRead + AsyncWrite, site: Arc<Site>, limits: Limits) {
    let service = service_fn(|request: Request<Incoming>| {
        let answer = site.answer(&request);
        async move { Ok::<_, Infallible>(answer) }
    });
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new()).header_read_timeout(limits.head).max_buf_size(MAX_HEAD_BYTES).half_close(true);
    let mut stream = Box::pin(TimeoutWriter::new(stream));
    stream.as_mut().set_timeout_pinned(Some(limits.stall)); // the client has to read
    let _ = http.serve_connection(TokioIo::new(stream), service).await; // an error means that the client has gone
}

/// The first `limit` bytes that a client receives which sends `bytes` and no more: for tests and fuzzing.
///
/// # Errors
/// If the system has no resources for a connection.
pub fn converse(site: &Arc<Site>, bytes: &[u8], limit: u64) -> io::Result<Vec<u8>> {
    runtime::Builder::new_current_thread().enable_time().build()?.block_on(async {
        let (mut client, server) = tokio::io::duplex(bytes.len().max(MAX_HEAD_BYTES));
        client.write_all(bytes).await?;
        client.shutdown().await?;
        tokio::spawn(connection(server, Arc::clone(site), LIMITS));
        let mut received = Vec::new();
        client.take(limit).read_to_end(&mut received).await?;
        Ok(received)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::page::WebPage;

    #[test]
    fn clients_that_do_not_read_are_disconnected_in_favour_of_waiting_ones() {
        let limits = Limits { connections: 4, head: Duration::from_secs(60), stall: Duration::from_millis(200) };
        let site = Arc::new(Site::with_token(WebPage::new("x", &[], None), "0badcafe"));
        let runtime = runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
        runtime.block_on(async {
            let listener = TcpListener::bind("127.0.0.1:0").unwrap();
            listener.set_nonblocking(true).unwrap();
            let address = listener.local_addr().unwrap();
            tokio::spawn(accept(listener, site, limits));
            let refused = "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n";
            let mut deaf = Vec::new();
            for _ in 0..limits.connections {
                let mut client = tokio::net::TcpStream::connect(address).await.unwrap();
                let sent = async { while client.write_all(refused.repeat(1000).as_bytes()).await.is_ok() {} };
                let cut_off = tokio::time::timeout(Duration::from_secs(60), sent).await;
                assert!(cut_off.is_ok(), "a client that does not read is still served");
                deaf.push(client);
            }
            for _ in 0..limits.connections {
                deaf.push(tokio::net::TcpStream::connect(address).await.unwrap()); // idle: takes the last places
            }
            let mut waits = tokio::net::TcpStream::connect(address).await.unwrap();
            waits.write_all(refused.as_bytes()).await.unwrap();
            let mut status = [0; 12];
            let early = tokio::time::timeout(Duration::from_millis(300), waits.read_exact(&mut status)).await;
            assert!(early.is_err(), "more connections are served than the limit");
            deaf.clear();
            tokio::time::timeout(Duration::from_secs(60), waits.read_exact(&mut status)).await.unwrap().unwrap();
            assert_eq!(&status, b"HTTP/1.1 403");
        });
    }

    #[test]
    fn invalid_requests_are_refused_and_release_their_connection() {
        let site = Arc::new(Site::with_token(WebPage::new("x", &[], None), "0badcafe"));
        let page = "GET /0badcafe/ HTTP/1.1\r\nHost: localhost\r\n";
        let endless = format!("{page}X: {}", "a".repeat(2 * MAX_HEAD_BYTES));
        let many = format!("{page}{}\r\n", "X: y\r\n".repeat(1000));
        let twice = format!("{page}\r\n{page}\r\n");
        for (request, statuses) in [
            (format!("{page}Content-Length: 9223372036854775808\r\n\r\n").as_str(), &["200"][..]),
            (&format!("{page}Content-Length: 1000000000000\r\n\r\n"), &["200"]),
            (&format!("{page}Content-Length: 18446744073709551615\r\n\r\n"), &["431"]),
            (&format!("{page}Content-Length: -1\r\n\r\n"), &["400"]),
            (&format!("{page}Transfer-Encoding: chunked\r\n\r\nFFFFFFFFFFFFFFFFFF\r\n"), &["200"]),
            (&format!("{page}Expect: 100-continue\r\nContent-Length: 100000000000\r\n\r\n"), &["200"]),
            (&format!("{page}Connection: upgrade\r\nUpgrade: websocket\r\n\r\n"), &["200"]),
            (&twice, &["200", "200"]),
            (&endless, &["431"]),
            (&many, &["431"]),
            (page, &[]),
            ("GET / HTTP/1.1\r\n\r\n", &["403"]),
            ("GET /0badcafe/ HTTP/1.0\r\n\r\n", &["403"]),
            ("GET /\0 HTTP/1.1\r\n\r\n", &["400"]),
            ("GET\r\n\r\n", &["400"]),
            ("OPTIONS * HTTP/1.1\r\nHost: a\r\n\r\n", &["405"]),
        ] {
            let received = String::from_utf8(converse(&site, request.as_bytes(), 1 << 20).unwrap()).unwrap();
            let answered: Vec<_> = received.split("HTTP/1.").skip(1).map(|answer| &answer[2..5]).collect();
            assert_eq!(answered, statuses, "{:.200}", request);
        }
    }
}
