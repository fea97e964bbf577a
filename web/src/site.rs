//! Who may read which file of a page: requests that name this machine and the token of the page's address.

use std::fs::{self, File};
use std::io::{self, Read as _};
use std::net::IpAddr;

use futures_util::stream;
use http_body_util::combinators::UnsyncBoxBody;
use http_body_util::{BodyExt as _, Full, StreamBody};
use hyper::body::{Bytes, Frame};
use hyper::header::{self, HOST, HeaderName, HeaderValue, LOCATION};
use hyper::{Method, Request, Response, StatusCode, Uri};

use crate::page::{Content, WebPage, open};

/// Bytes of a recording that are read at once.
const PART_BYTES: u64 = 1 << 18;

/// Bytes of the token: 128 bits cannot be guessed.
const TOKEN_BYTES: usize = 16;

/// What a request without the token is told.
const NO_TOKEN: &str = "expected the whole address that `skysink view` has printed";

/// A page under a path that contains a token.
#[derive(Debug)]
pub struct Site {
    page: WebPage,
    /// `/` and the token.
    path: String,
    /// The name of this machine, in lower case.
    machine: String,
    /// The names of proxies before it, in lower case.
    proxies: Vec<String>,
}

impl Site {
    /// The page under a path that nobody can guess. Requests may name this machine, or one of the `proxies` before it.
    ///
    /// # Errors
    /// If the system has no random numbers.
    pub fn new(page: WebPage, proxies: &[String]) -> io::Result<Self> {
        let mut token = [0; TOKEN_BYTES];
        File::open("/dev/urandom")?.read_exact(&mut token)?;
        let site = Self::with_token(page, &token.map(|byte| format!("{byte:02x}")).concat());
        Ok(Self { proxies: proxies.iter().map(|name| name.to_ascii_lowercase()).collect(), ..site })
    }

    /// The page under a known token: for tests.
    #[must_use]
    pub fn with_token(page: WebPage, token: &str) -> Self {
        let machine = fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
        Self { page, path: format!("/{token}"), machine: machine.trim().to_ascii_lowercase(), proxies: Vec::new() }
    }

    /// The path of the page, such as `/81f0c43e10b3f2f9d2b2c52f8c4f1c7a/`.
    pub fn path(&self) -> String {
        format!("{}/", self.path)
    }

    /// The answer to a request.
    pub(crate) fn answer<B>(&self, request: &Request<B>) -> Response<FileBody> {
        if !matches!(*request.method(), Method::GET | Method::HEAD) {
            return refusal(StatusCode::METHOD_NOT_ALLOWED, "expected GET or HEAD");
        }
        if !self.is_addressed(request) {
            let given = named(request).unwrap_or_else(|| "NAME".to_owned());
            let expected = format!(
                "expected an IP address, localhost or the name of this machine as the host. Behind a proxy, such as \
                 those of JupyterHub, code-server and Codespaces, name it: skysink view --host {given}"
            );
            return refusal(StatusCode::FORBIDDEN, &expected);
        }
        let Some((given, path)) = request.uri().path().split_at_checked(self.path.len()) else {
            return refusal(StatusCode::FORBIDDEN, NO_TOKEN);
        };
        if !is_same(given, &self.path) {
            return refusal(StatusCode::FORBIDDEN, NO_TOKEN);
        }
        if path.is_empty() {
            let mut redirect = refusal(StatusCode::PERMANENT_REDIRECT, "expected a / at the end");
            // Relative: a proxy may have another path before it.
            let location = HeaderValue::try_from(&self.path()[1..]).expect("hexadecimal digits");
            redirect.headers_mut().insert(LOCATION, location);
            return redirect;
        }
        let Some((content, kind)) = self.page.find(path) else {
            return refusal(StatusCode::NOT_FOUND, "no such file");
        };
        match body_of(content) {
            Ok((body, length)) => response(StatusCode::OK, kind, body, length),
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                refusal(StatusCode::NOT_FOUND, "the recording is no longer there")
            }
            Err(error) => refusal(StatusCode::SERVICE_UNAVAILABLE, &error.to_string()),
        }
    }

    /// Whether the request names this machine. A web page whose name leads to this machine (DNS rebinding) names
    /// itself.
    fn is_addressed<B>(&self, request: &Request<B>) -> bool {
        let mut hosts = request.headers().get_all(HOST).iter();
        let is_host = |host: &HeaderValue| host.to_str().is_ok_and(|host| self.is_name(host));
        let is_one = hosts.next().is_some_and(is_host) && hosts.next().is_none();
        is_one && request.uri().authority().is_none_or(|authority| self.is_name(authority.as_str()))
    }

    /// Whether a host, with or without a port, is an IP address, `localhost`, the name of this machine or of a proxy.
    fn is_name(&self, host: &str) -> bool {
        let Some(name) = name_of(host) else { return false };
        let is_machine = !self.machine.is_empty() && name.strip_suffix(".local").unwrap_or(&name) == self.machine;
        let address = name.strip_prefix('[').and_then(|name| name.strip_suffix(']')).unwrap_or(&name);
        address.parse::<IpAddr>().is_ok() || name == "localhost" || is_machine || self.proxies.contains(&name)
    }
}

/// The name of a host with or without a port, in lower case.
fn name_of(host: &str) -> Option<String> {
    let uri = host.parse::<Uri>().ok()?;
    let authority = uri.authority().filter(|authority| !authority.as_str().contains('@'))?;
    Some(authority.host().trim_end_matches('.').to_ascii_lowercase())
}

/// The one host that a request names, if it is a name of letters, digits, dots and hyphens.
fn named<B>(request: &Request<B>) -> Option<String> {
    let name = name_of(request.headers().get(HOST)?.to_str().ok()?)?;
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b".-_".contains(&byte);
    (!name.is_empty() && name.bytes().all(is_plain)).then_some(name)
}

/// Compares texts in a time that does not depend on where they differ.
fn is_same(one: &str, other: &str) -> bool {
    one.len() == other.len() && one.bytes().zip(other.bytes()).fold(0, |sum, (a, b)| sum | (a ^ b)) == 0
}

fn refusal(status: StatusCode, text: &str) -> Response<FileBody> {
    let text = Bytes::from(format!("{text}\n"));
    let length = text.len() as u64;
    response(status, "text/plain; charset=utf-8", whole(text), length)
}

fn response(status: StatusCode, kind: &'static str, body: FileBody, length: u64) -> Response<FileBody> {
    let mut response = Response::new(body);
    *response.status_mut() = status;
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_LENGTH, length.into()); // the browser can show the progress
    for (name, value) in [
        (header::CONTENT_TYPE, kind),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
        (header::REFERRER_POLICY, "no-referrer"), // the address contains the token
        (header::CACHE_CONTROL, "no-cache"),      // a recording may grow, and another page may use the port later
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    response
}

/// The body of an answer: in memory, or read from a file in parts.
type FileBody = UnsyncBoxBody<Bytes, io::Error>;

fn whole(bytes: Bytes) -> FileBody {
    Full::new(bytes).map_err(|never| match never {}).boxed_unsync()
}

/// The body with a content, and its length. A growing recording is read up to its length at the request.
fn body_of(content: &Content) -> io::Result<(FileBody, u64)> {
    let bytes = match content {
        Content::Text(text) => Bytes::from(text.clone()),
        Content::Embedded(bytes) => Bytes::from_static(bytes),
        Content::File(path) => {
            let file = open(path)?;
            let length = file.metadata()?.len();
            let parts = (0..length).step_by(PART_BYTES as usize).map(move |begin| {
                let mut bytes = vec![0; PART_BYTES.min(length - begin) as usize];
                // Of a truncated file: the connection ends before its length.
                (&file).read_exact(&mut bytes)?;
                Ok(Frame::data(bytes.into()))
            });
            return Ok((StreamBody::new(stream::iter(parts)).boxed_unsync(), length));
        }
    };
    let length = bytes.len() as u64;
    Ok((whole(bytes), length))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;
    use std::path::{Path, PathBuf};
    use std::process::Command;

    /// A site with a recording of two parts, and its path.
    fn site(place: &Path) -> (Site, PathBuf) {
        let recording = place.join("run/mission.rrd");
        fs::create_dir(place.join("run")).unwrap();
        fs::write(&recording, vec![b'R'; PART_BYTES as usize + 1]).unwrap();
        let page = WebPage::new("x", std::slice::from_ref(&recording), None);
        (Site::with_token(page, "0badcafe"), recording)
    }

    fn answer(site: &Site, method: Method, uri: &str, hosts: &[&str]) -> Response<FileBody> {
        let request = hosts.iter().fold(Request::builder().method(method).uri(uri), |it, host| it.header(HOST, *host));
        site.answer(&request.body(()).unwrap())
    }

    fn status(site: &Site, uri: &str) -> u16 {
        answer(site, Method::GET, uri, &["localhost"]).status().as_u16()
    }

    #[test]
    fn a_page_is_shown_under_its_token_only() {
        let place = tempfile::tempdir().unwrap();
        let (site, _) = site(place.path());
        for (uri, expected) in [
            ("/0badcafe/", 200),
            ("/0badcafe/index.html?renderer=webgl", 200),
            ("/0badcafe/run/mission.rrd", 200),
            ("/0badcafe", 308),
            ("/0badcafe/run/slots.csv", 404),
            ("/0badcafe//run/mission.rrd", 404),
            ("/0badcafe0/run/mission.rrd", 404),
            ("/", 403),
            ("/run/mission.rrd", 403),
            ("/0badcaff/run/mission.rrd", 403),
            ("/0BADCAFE/run/mission.rrd", 403),
            ("/?token=0badcafe", 403),
        ] {
            assert_eq!(status(&site, uri), expected, "{uri}");
        }
        assert_eq!(answer(&site, Method::POST, "/0badcafe/", &["localhost"]).status(), 405);
        let tokens = [0, 1].map(|_| Site::new(WebPage::new("x", &[], None), &[]).unwrap().path());
        assert!(tokens[0] != tokens[1] && tokens[0].len() == 2 * TOKEN_BYTES + 2, "{tokens:?}");
    }

    #[test]
    fn a_request_must_name_this_machine() {
        let mut site = Site::with_token(WebPage::new("x", &[], None), "0badcafe");
        site.machine = "robot".to_owned();
        for host in ["localhost", "LocalHost:80", "127.0.0.1:9090", "[::1]:9090", "10.0.0.7", "Robot:1", "robot.local"]
        {
            assert_eq!(answer(&site, Method::GET, "/0badcafe/", &[host]).status(), 200, "{host}");
        }
        for host in
            ["attacker.example", "127.0.0.1.attacker.example", "localhost@a.example", "a@localhost", "", ".local"]
        {
            assert_eq!(answer(&site, Method::GET, "/0badcafe/", &[host]).status(), 403, "{host}");
        }
        assert_eq!(answer(&site, Method::GET, "/0badcafe/", &[]).status(), 403, "no host");
        assert_eq!(answer(&site, Method::GET, "/0badcafe/", &["localhost", "localhost"]).status(), 403, "two hosts");
        assert_eq!(answer(&site, Method::GET, "http://a.example/0badcafe/", &["localhost"]).status(), 403);
        site.machine = String::new();
        assert_eq!(answer(&site, Method::GET, "/0badcafe/", &[".local"]).status(), 403, "a machine without a name");
    }

    /// The text of an answer.
    fn text(answer: Response<FileBody>) -> String {
        let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
        String::from_utf8(runtime.block_on(answer.into_body().collect()).unwrap().to_bytes().to_vec()).unwrap()
    }

    #[test]
    fn a_proxy_that_is_named_may_ask_and_a_refusal_says_how() {
        let page = || WebPage::new("x", &[], None);
        let of_proxy = Site::new(page(), &["Hub.Example.org".to_owned(), "a-9090.app.github.dev".to_owned()]).unwrap();
        let path = of_proxy.path();
        for host in
            ["hub.example.org", "HUB.example.org:443", "hub.example.org.", "a-9090.app.github.dev", "localhost:1"]
        {
            assert_eq!(answer(&of_proxy, Method::GET, &path, &[host]).status(), 200, "{host}");
            assert_eq!(answer(&of_proxy, Method::GET, "/", &[host]).status(), 403, "{host}, without the token");
        }
        for host in ["example.org", "x.hub.example.org", "hub.example.org.attacker.example", "b-9090.app.github.dev"] {
            let refused = answer(&of_proxy, Method::GET, &path, &[host]);
            assert_eq!(refused.status(), 403, "{host}");
            let says = text(refused);
            assert!(says.ends_with(&format!("name it: skysink view --host {host}\n")), "{says}");
        }
        for host in ["a@b", "<script>", "[::1", "$(id)", "a;b", "é"] {
            let says = text(answer(&of_proxy, Method::GET, &path, &[host]));
            assert!(says.ends_with("skysink view --host NAME\n"), "{host}: {says}");
        }
        let redirect = answer(&of_proxy, Method::GET, path.trim_end_matches('/'), &["hub.example.org"]);
        let location = redirect.headers()[LOCATION].to_str().unwrap();
        assert!(redirect.status() == 308 && !location.starts_with('/') && path == format!("/{location}"), "{location}");
    }

    #[test]
    fn a_file_that_replaces_a_recording_is_not_served() {
        let place = tempfile::tempdir().unwrap();
        let (site, recording) = site(place.path());
        let other = place.path().join("other");
        let folder = place.path().join("run");
        fs::rename(&recording, &other).unwrap();
        assert_eq!(status(&site, "/0badcafe/run/mission.rrd"), 404, "nothing");
        symlink(&other, &recording).unwrap();
        assert_eq!(status(&site, "/0badcafe/run/mission.rrd"), 404, "a link");
        fs::remove_file(&recording).unwrap();
        assert!(Command::new("mkfifo").arg(&recording).status().unwrap().success());
        assert_eq!(status(&site, "/0badcafe/run/mission.rrd"), 404, "a pipe");
        fs::remove_file(&recording).unwrap();
        fs::create_dir(&recording).unwrap();
        assert_eq!(status(&site, "/0badcafe/run/mission.rrd"), 404, "a folder");
        fs::remove_dir(&recording).unwrap();
        fs::rename(&folder, place.path().join("moved")).unwrap();
        fs::rename(&other, place.path().join("moved/mission.rrd")).unwrap();
        symlink(place.path().join("moved"), &folder).unwrap();
        assert_eq!(status(&site, "/0badcafe/run/mission.rrd"), 404, "in a folder that is a link");
        fs::remove_file(&folder).unwrap();
        fs::rename(place.path().join("moved"), &folder).unwrap();
        assert_eq!(status(&site, "/0badcafe/run/mission.rrd"), 200, "the recording again");
    }

    #[test]
    fn a_recording_truncated_while_served_is_an_error_but_growth_is_not() {
        let place = tempfile::tempdir().unwrap();
        let (site, recording) = site(place.path());
        let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
        for (new_bytes, is_whole) in [(PART_BYTES, false), (2 * PART_BYTES, true)] {
            let mut body = answer(&site, Method::GET, "/0badcafe/run/mission.rrd", &["localhost"]).into_body();
            let mut next =
                || runtime.block_on(body.frame()).unwrap().map(|part| part.into_data().unwrap().len() as u64);
            assert_eq!(next().unwrap(), PART_BYTES);
            File::options().write(true).open(&recording).unwrap().set_len(new_bytes).unwrap();
            assert_eq!(next().is_ok_and(|bytes| bytes == 1), is_whole);
            File::options().write(true).open(&recording).unwrap().set_len(PART_BYTES + 1).unwrap();
        }
    }
}
