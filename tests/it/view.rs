//! Recordings in a browser: served files, who may read them, the parts of a page, and refusals.
mod recordings;

use crate::support;
use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::Child;
use std::sync::mpsc::channel;

use crate::support::{Place, signal_and_wait, until, wait};
use expect_test::expect_file;
use rustix::process::Signal;

/// An answer to a request.
struct Answer {
    status: u16,
    headers: BTreeMap<String, String>,
    body: Vec<u8>,
}

impl Answer {
    fn text(&self) -> &str {
        std::str::from_utf8(&self.body).unwrap()
    }

    fn header(&self, name: &str) -> &str {
        self.headers.get(name).map_or("", String::as_str)
    }
}

/// A running `skysink view`.
struct View {
    child: Child,
    /// Its output until it serves.
    said: String,
    port: u16,
    /// The path of the page, without its last `/`.
    path: String,
}

impl View {
    /// `skysink view` with these arguments on a free port.
    fn start(place: &Place, arguments: &[&str]) -> Self {
        Self::of(place.skysink(&[&["view", "--port", "0"], arguments].concat()).spawn().unwrap())
    }

    /// A process that becomes `skysink view`.
    fn of(mut child: Child) -> Self {
        let said = address_said(&mut child);
        let (_, address) = said.split_once("http://127.0.0.1:").expect("an address");
        let (port, path) = address.lines().next().unwrap().split_once('/').unwrap();
        let [port, path] = [port.to_owned(), format!("/{}", path.trim_end_matches('/'))];
        Self { child, port: port.parse().unwrap(), path, said }
    }

    /// Asks for a path of the page.
    fn ask(&self, method: &str, path: &str) -> Answer {
        self.ask_with(&format!("{method} {}{path} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n", self.path))
    }

    /// Sends a request, and reads all that the server answers.
    fn ask_with(&self, request: &str) -> Answer {
        let mut stream = self.connect();
        stream.write_all(request.as_bytes()).unwrap();
        read(stream)
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        stream.set_read_timeout(Some(support::WATCHDOG)).unwrap();
        stream
    }

    /// Stops it with Ctrl-C.
    fn stop(self) {
        assert_eq!(stop(self.child), Some(130));
    }
}

/// Reads an answer until the server closes the connection.
fn read(mut stream: TcpStream) -> Answer {
    let mut bytes = Vec::new();
    stream.read_to_end(&mut bytes).unwrap();
    let head_end = bytes.windows(4).position(|window| window == b"\r\n\r\n").expect("a head");
    let head = String::from_utf8(bytes[..head_end].to_vec()).unwrap();
    let mut lines = head.lines();
    let status = lines.next().unwrap().split(' ').nth(1).unwrap().parse().unwrap();
    let headers = lines.filter_map(|line| line.split_once(": "));
    let headers = headers.map(|(name, value)| (name.to_ascii_lowercase(), value.to_owned())).collect();
    Answer { status, headers, body: bytes.split_off(head_end + 4) }
}

/// The output of `skysink view` until it serves.
fn address_said(child: &mut Child) -> String {
    let output = BufReader::new(child.stdout.take().unwrap());
    let (sender, lines) = channel();
    std::thread::spawn(move || output.lines().map_while(Result::ok).try_for_each(|line| sender.send(line)));
    let mut said = String::new();
    while !said.contains("Ctrl-C") {
        let line = lines.recv_timeout(support::WATCHDOG).unwrap_or_else(|error| panic!("{error}: {said}"));
        said = said + &line + "\n";
    }
    said
}

fn stop(child: Child) -> Option<i32> {
    signal_and_wait(Signal::INT, child).code
}

/// Leaves a recording of the smoke test in the folder.
fn recorded(place: &Place, out: &str) {
    place.flight("smoke").out(out).options(&["--record"]).simulate();
}

#[test]
fn the_page_its_viewer_and_the_recording_are_served_and_nothing_else() {
    let place = Place::new();
    recorded(&place, "run");
    let view = View::start(&place, &["run"]);
    let said = &view.said;
    let port = view.port;
    assert!(said.contains("run/mission.rrd") && said.contains(&format!("ssh -C -L {port}:127.0.0.1:{port} HOST")));

    let index = view.ask("GET", "/");
    assert_eq!((index.status, index.header("content-type")), (200, "text/html; charset=utf-8"));
    assert!(index.text().contains("const recordings = [\"run/mission.rrd\"]"), "{}", index.text());
    assert!(index.text().contains("connect-src 'self' data: blob:\""), "nothing is fetched elsewhere");
    assert_eq!(view.ask("GET", "/index.html?renderer=webgl").body, index.body);

    let wasm = view.ask("GET", "/re_viewer_bg.wasm");
    assert_eq!((wasm.status, wasm.header("content-type")), (200, "application/wasm"));
    assert!(wasm.body.starts_with(b"\0asm"));
    assert_eq!(wasm.header("content-length"), wasm.body.len().to_string());
    let script = view.ask("GET", "/re_viewer.js");
    assert_eq!((script.status, script.header("content-type")), (200, "text/javascript; charset=utf-8"));

    let recording = view.ask("GET", "/run/mission.rrd");
    let file = fs::read(place.path("run/mission.rrd")).unwrap();
    assert_eq!(recording.header("content-length"), file.len().to_string());
    assert!(recording.body == file, "another recording");
    let head = view.ask("HEAD", "/run/mission.rrd");
    assert_eq!((head.header("content-length"), head.body.len()), (file.len().to_string().as_str(), 0));

    for path in [
        "//",
        "/nothing",
        "/run/",
        "/run/slots.csv",
        "/run/mission.rrd/",
        "/../run/mission.rrd",
        "/run/../run/mission.rrd",
        "/%2e%2e/%2e%2e/etc/passwd",
        "/../../../../../../etc/passwd",
        "//etc/passwd",
        "/run\\mission.rrd",
    ] {
        assert_eq!(view.ask("GET", path).status, 404, "{path}");
    }
    assert_eq!(view.ask("POST", "/").status, 405);

    fs::write(place.path("run/mission.rrd"), &file[..1000]).unwrap();
    assert_eq!(view.ask("GET", "/run/mission.rrd").body.len(), 1000, "as the file is now");
    fs::remove_file(place.path("run/mission.rrd")).unwrap();
    assert_eq!(view.ask("GET", "/run/mission.rrd").status, 404);
    view.stop();
}

#[test]
fn a_proxy_that_is_named_may_show_the_page() {
    let place = Place::new();
    recorded(&place, "run");
    let view = View::start(&place, &["run", "--host", "Hub.example.org", "--host", "a-9090.app.github.dev"]);
    let ask = |path: &str, host: &str| {
        view.ask_with(&format!("GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n"))
    };
    let page = format!("{}/", view.path);
    assert!(view.said.contains(&format!("Proxy:      https://hub.example.org/PREFIX{page} with")), "{}", view.said);
    for host in ["hub.example.org", "a-9090.app.github.dev:443", "localhost"] {
        assert_eq!(ask(&page, host).status, 200, "{host}");
        assert_eq!(ask("/", host).status, 403, "{host}");
    }
    let refused = ask(&page, "other.example.org");
    assert_eq!(refused.status, 403);
    let says = refused.text().trim_end();
    assert!(says.ends_with("name it: skysink view --host other.example.org"), "{says}");
    view.stop();
    for host in ["https://hub.example.org", "hub.example.org:443", "", "a b", "hub/..", "$(id)"] {
        let ended = place.run(&["view", "run", "--port", "0", "--host", host]).assert_code(2);
        assert!(ended.stderr.contains("expected the name of a host such as hub.example.org"), "{ended:?}");
    }
}

#[test]
fn one_page_shows_several_recordings_or_by_default_the_newest() {
    let place = Place::new();
    for out in ["runs/first", "runs/second"] {
        recorded(&place, out);
    }
    let old = std::time::SystemTime::now() - std::time::Duration::from_secs(60);
    fs::File::open(place.path("runs/second/mission.rrd")).unwrap().set_modified(old).unwrap();
    let view = View::start(&place, &[]);
    assert!(view.ask("GET", "/").text().contains("[\"first/mission.rrd\"]"));
    view.stop();
    let view = View::start(&place, &["runs/second/mission.rrd", "runs/first"]);
    assert!(view.ask("GET", "/").text().contains("[\"second/mission.rrd\", \"first/mission.rrd\"]"));
    view.stop();
}

#[test]
fn invalid_recordings_are_refused_in_one_line() {
    let place = Place::new();
    place.flight("smoke").out("dark").simulate();
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    place.assert_transcript(&expect_file!["transcripts/view.txt"]); // nobody listens on port 1
    recorded(&place, "run");
    let ended = place.run(&["view", "run", "--port", &port]);
    assert_eq!(ended.code, Some(2), "{ended:?}");
    assert!(ended.stderr.contains(&format!("127.0.0.1:{port}: ")) && ended.stderr.contains("free --port"), "{ended:?}");
}

/// A mission that is served, and its port. One that another process has taken meanwhile is refused: then another port.
fn run_live(place: &Place) -> (Child, u16) {
    loop {
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let flight = place.flight("long").force().pace("1x").options(&[&format!("--live={port}")]);
        let mut run = flight.launcher().spawn().unwrap();
        let is_served = until("server", || match run.try_wait().unwrap() {
            Some(_) => Some(false),
            None => TcpStream::connect(("127.0.0.1", port)).is_ok().then_some(true),
        });
        if is_served {
            return (run, port);
        }
        let ended = wait(run);
        assert!(ended.stderr.contains("expected a free port"), "{ended:?}");
    }
}

#[test]
fn a_running_mission_is_shown_from_its_port() {
    let place = Place::new();
    let (run, free) = run_live(&place);
    let live = format!("--live={free}");
    let view = View::start(&place, &[&live]);
    let said = &view.said;
    let port = view.port;
    assert!(said.contains(&format!("-L {port}:127.0.0.1:{port} -L {free}:127.0.0.1:{free} HOST")), "{said}");
    let index = view.ask("GET", "/");
    assert!(index.text().contains(&format!("const livePort = {free};")), "{}", index.text());
    assert!(index.text().contains(&format!("blob: http://127.0.0.1:{free} http://localhost:{free}\"")));
    view.stop();
    assert_eq!(stop(run), Some(130));
    place.assert_clean();
}

#[test]
fn a_page_can_be_served_by_any_static_server() {
    let place = Place::new();
    recorded(&place, "run");
    let ended = place.run_ok(&["page", "run", "page"]);
    assert!(ended.stdout.contains("page/index.html"), "{ended:?}");
    assert!(place.read("page/index.html").contains("[\"run/mission.rrd\"]"));
    assert!(place.read("page/re_viewer.js").contains("wasm_bindgen"));
    assert!(fs::read(place.path("page/re_viewer_bg.wasm")).unwrap().starts_with(b"\0asm"));
    let recording = |path: &str| fs::read(place.path(path)).unwrap();
    assert!(recording("page/run/mission.rrd") == recording("run/mission.rrd"));
    for (arguments, says) in [
        (["page", "run", "page"], "page folder page: it is not empty"),
        (["page", "run", "run/mission.rrd"], "page folder run/mission.rrd: "),
        (["page", "nowhere", "other"], "recording nowhere"),
    ] {
        place.run_refused(&arguments, says);
    }
    assert!(!place.path("other").exists());
}

#[test]
fn recordings_require_the_token_and_the_host_name() {
    let place = Place::new();
    recorded(&place, "run");
    let view = View::start(&place, &["run"]);
    let ask = |path: &str, host: &str| {
        let request = format!("GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n");
        view.ask_with(&request).status
    };
    let recording = format!("{}/run/mission.rrd", view.path);
    for host in ["localhost:9090", "127.0.0.1", "[::1]:80"] {
        assert_eq!(ask(&recording, host), 200, "{host}");
    }
    assert_eq!(ask(&recording, "attacker.example"), 403);
    for path in ["/", "/run/mission.rrd", "/00000000000000000000000000000000/run/mission.rrd"] {
        assert_eq!(ask(path, "localhost"), 403, "{path}");
    }
    let other = View::start(&place, &["run"]);
    assert_ne!(other.path, view.path);
    assert_eq!(view.ask("GET", "/").header("referrer-policy"), "no-referrer");
    other.stop();
    view.stop();
}

#[test]
fn invalid_requests_and_replaced_recordings_do_not_stop_the_server() {
    let place = Place::new();
    recorded(&place, "run");
    let recording = place.path("run/mission.rrd");
    let view = View::start(&place, &["run"]);
    let head = format!("GET {}/ HTTP/1.1\r\nHost: localhost\r\n", view.path);
    let length = |length: &str| view.ask_with(&format!("{head}Connection: close\r\nContent-Length: {length}\r\n\r\n"));
    assert_eq!(length("9223372036854775808").status, 200);
    assert_eq!(length("18446744073709551615").status, 431);

    let mut endless = view.connect();
    endless.write_all(head.as_bytes()).unwrap();
    let sent = (0..1000).take_while(|_| endless.write_all(&[b'a'; 1 << 16]).is_ok()).count();
    assert!(sent < 1000, "a header line of 64 MB was taken");

    let whole = fs::metadata(&recording).unwrap().len();
    let large = whole.max(64 << 20);
    fs::File::options().write(true).open(&recording).unwrap().set_len(large).unwrap(); // more than the sockets buffer
    let mut cut = view.connect();
    write!(cut, "GET {}/run/mission.rrd HTTP/1.1\r\nHost: localhost\r\n\r\n", view.path).unwrap();
    cut.read_exact(&mut [0; 1]).unwrap();
    fs::File::options().write(true).open(&recording).unwrap().set_len(whole).unwrap();
    let received = std::io::copy(&mut cut, &mut std::io::sink());
    assert!(received.is_ok_and(|bytes| bytes < large), "the connection ends with the file");

    fs::write(place.path("secret"), "secret").unwrap();
    fs::remove_file(&recording).unwrap();
    std::os::unix::fs::symlink(place.path("secret"), &recording).unwrap();
    assert_eq!(view.ask("GET", "/run/mission.rrd").status, 404, "a link");
    fs::remove_file(&recording).unwrap();
    assert!(place.command("mkfifo", &["run/mission.rrd"]).status().unwrap().success());
    for _ in 0..16 {
        assert_eq!(view.ask("GET", "/run/mission.rrd").status, 404, "a pipe");
    }
    let page = place.run(&["page", "run/mission.rrd", "page"]);
    assert_eq!(page.code, Some(2), "{page:?}");
    assert_eq!(view.ask("GET", "/").status, 200);
    view.stop();
}

#[test]
fn a_server_without_free_file_descriptors_answers_when_idle_connections_have_ended() {
    let place = Place::new();
    recorded(&place, "run");
    let script = "ulimit -n 40 && exec \"$0\" view --port 0 run";
    let view = View::of(place.command("sh", &["-c", script, env!("CARGO_BIN_EXE_skysink")]).spawn().unwrap());
    let idle: Vec<_> = (0..40).map(|_| view.connect()).collect();
    assert_eq!(view.ask("GET", "/").status, 200);
    drop(idle);
    view.stop();
}
