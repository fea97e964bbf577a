//! The files of the page: the viewer, the recordings, and the index that opens the recordings in the viewer.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, Read as _};
use std::os::fd::AsRawFd as _;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

use rustix::fs::{Mode, OFlags};

/// The index with its placeholders.
const INDEX: &str = include_str!("index.html");

/// Prefix of the temporary folder of an incomplete page.
const UNFINISHED: &str = ".page.";

/// Bytes that are copied between two checks for a stop.
const PART_BYTES: u64 = 1 << 24;

/// File name of the index.
const INDEX_NAME: &str = "index.html";

/// The files of the viewer.
const VIEWER: [(&str, &[u8]); 3] = [
    ("re_viewer.js", include_bytes!(concat!(env!("OUT_DIR"), "/re_viewer.js"))),
    ("re_viewer_bg.wasm", include_bytes!(concat!(env!("OUT_DIR"), "/re_viewer_bg.wasm"))),
    ("favicon.ico", include_bytes!(concat!(env!("OUT_DIR"), "/favicon.ico"))),
];

/// A web page that shows recordings, with all its files.
#[derive(Debug)]
pub struct WebPage {
    /// The files by path, relative to the page.
    files: BTreeMap<String, Content>,
}

/// The content of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Content {
    /// Generated for this page.
    Text(String),
    /// Embedded in the executable, the same for every page.
    Embedded(&'static [u8]),
    /// A recording, by its path without links. It is read on every request, because it may still be growing.
    File(PathBuf),
}

/// The error of writing a page. Its `Display` is one line.
#[derive(Debug, thiserror::Error)]
pub enum PageError {
    /// The folder is not empty.
    #[error("page folder {}: {found}: expected one that is empty, or does not exist", path.display())]
    Taken {
        /// The folder.
        path: PathBuf,
        /// Why it cannot be used.
        found: String,
    },
    /// Writing was stopped before the page was complete.
    #[error("stopped before the page was complete")]
    Stopped,
    /// A file cannot be read or written.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The error of the file system.
        source: io::Error,
    },
}

impl WebPage {
    /// A page with these recordings (.rrd), grouped by folder, and the running mission that is served on the port
    /// `live`.
    #[must_use]
    pub fn new(title: &str, recordings: &[PathBuf], live: Option<u16>) -> Self {
        let mut files: BTreeMap<String, Content> =
            VIEWER.map(|(name, bytes)| (name.to_owned(), Content::Embedded(bytes))).into();
        let mut paths = Vec::new();
        for recording in recordings {
            let path = free_path(&files, recording);
            let resolved = fs::canonicalize(recording).unwrap_or_else(|_| recording.clone());
            files.insert(path.clone(), Content::File(resolved));
            paths.push(format!("\"{path}\""));
        }
        let hosts = |port| format!(" http://127.0.0.1:{port} http://localhost:{port}");
        let index = INDEX
            .replace("{{title}}", &plain(title))
            .replace("{{connect}}", &live.map(hosts).unwrap_or_default())
            .replace("{{recordings}}", &paths.join(", "))
            .replace("{{live}}", &live.unwrap_or(0).to_string());
        files.insert(INDEX_NAME.to_owned(), Content::Text(index));
        Self { files }
    }

    /// The content of a file and its MIME type; `None` if the file does not exist. The path starts with `/` and has no
    /// query.
    pub(crate) fn find(&self, path: &str) -> Option<(&Content, &'static str)> {
        let name = match path.strip_prefix('/')? {
            "" => INDEX_NAME,
            name => name,
        };
        Some((self.files.get(name)?, content_type(name)))
    }

    /// Writes the page to `folder`, for any web server. The folder is complete or not created.
    ///
    /// # Errors
    /// If the folder is not empty, a file cannot be read or written, or `is_stopped` returns true.
    pub fn write(&self, folder: &Path, is_stopped: &dyn Fn() -> bool) -> Result<(), PageError> {
        let taken = |found: String| PageError::Taken { path: folder.to_owned(), found };
        if folder.file_name().is_none() {
            return Err(taken("it has no name".to_owned()));
        }
        match fs::read_dir(folder).map(|mut entries| entries.next().is_none()) {
            Ok(true) => {}
            Ok(false) => return Err(taken("it is not empty".to_owned())),
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            Err(error) => return Err(taken(error.to_string())),
        }
        let parent = folder.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let permissions = fs::Permissions::from_mode(0o777); // minus the umask: a web server must be able to read it
        let temporary = fs::create_dir_all(parent)
            .and_then(|()| tempfile::Builder::new().prefix(UNFINISHED).permissions(permissions).tempdir_in(parent))
            .map_err(|source| PageError::File { path: parent.to_owned(), source })?;
        self.write_files(temporary.path(), is_stopped)?;
        fs::rename(temporary.path(), folder).map_err(|source| PageError::File { path: folder.to_owned(), source })?;
        let _ = temporary.keep(); // it has been renamed
        Ok(())
    }

    fn write_files(&self, folder: &Path, is_stopped: &dyn Fn() -> bool) -> Result<(), PageError> {
        for (name, content) in &self.files {
            let path = folder.join(name);
            let write = || {
                path.parent().map_or(Ok(()), fs::create_dir_all)?;
                match content {
                    Content::Text(text) => fs::write(&path, text),
                    Content::Embedded(bytes) => fs::write(&path, bytes),
                    // Without its permissions: a web server must be able to read it.
                    Content::File(source) => copy(source, &path, is_stopped),
                }
            };
            if is_stopped() {
                return Err(PageError::Stopped);
            }
            let at = if let Content::File(source) = content { source } else { &path };
            write().map_err(|source| PageError::File { path: at.clone(), source })?;
        }
        Ok(())
    }
}

/// Opens a recording by its path without links, and nothing else that has taken its place: a link, a folder, or a pipe,
/// which would block.
pub(crate) fn open(path: &Path) -> io::Result<File> {
    let flags = OFlags::RDONLY | OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let file = match rustix::fs::open(path, flags, Mode::empty()) {
        Ok(descriptor) => File::from(descriptor),
        Err(rustix::io::Errno::LOOP) => return Err(replaced()),
        Err(error) => return Err(error.into()),
    };
    let opened = fs::read_link(format!("/proc/self/fd/{}", file.as_raw_fd()))?;
    if file.metadata()?.is_file() && opened == path { Ok(file) } else { Err(replaced()) }
}

fn replaced() -> io::Error {
    io::Error::new(io::ErrorKind::NotFound, "expected the recording, not what has taken its place")
}

/// Copies a recording until `is_stopped` returns true.
fn copy(source: &Path, path: &Path, is_stopped: &dyn Fn() -> bool) -> io::Result<()> {
    let mut source = open(source)?;
    let mut file = File::create(path)?;
    while !is_stopped() && io::copy(&mut (&mut source).take(PART_BYTES), &mut file)? > 0 {}
    Ok(())
}

/// An unused path for a recording on the page: the name of its folder and of the file.
fn free_path(files: &BTreeMap<String, Content>, recording: &Path) -> String {
    let name = |path: Option<&Path>| {
        let name = path.and_then(Path::file_name).unwrap_or_default();
        plain(&name.to_string_lossy())
    };
    let absolute = std::path::absolute(recording).unwrap_or_else(|_| recording.to_owned());
    let folder = Some(name(absolute.parent())).filter(|name| !name.is_empty()).unwrap_or_else(|| "root".to_owned());
    let file = name(Some(&absolute));
    (1..)
        .map(|number| if number == 1 { format!("{folder}/{file}") } else { format!("{folder}-{number}/{file}") })
        .find(|path| !files.contains_key(path))
        .expect("the numbers are unbounded")
}

/// Replaces all characters with a meaning in URLs, HTML or scripts; the result is no relative path.
fn plain(text: &str) -> String {
    let is_plain = |character: &char| character.is_ascii_alphanumeric() || "-_.".contains(*character);
    let text: String = text.chars().map(|character| if is_plain(&character) { character } else { '-' }).collect();
    if text.starts_with('.') { text.replacen('.', "-", 1) } else { text }
}

fn content_type(name: &str) -> &'static str {
    match name.rsplit_once('.').map(|(_, extension)| extension) {
        Some("html") => "text/html; charset=utf-8",
        Some("js") => "text/javascript; charset=utf-8",
        Some("wasm") => "application/wasm",
        Some("ico") => "image/x-icon",
        _ => "application/octet-stream",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recordings_with_equal_names_have_different_paths() {
        let paths = ["/a/run/mission.rrd", "/b/run/mission.rrd", "/c/run/mission-2.rrd", "/c/other/mission.rrd"];
        let page = WebPage::new("x", &paths.map(PathBuf::from), None);
        for (path, file) in [
            ("/run/mission.rrd", paths[0]),
            ("/run-2/mission.rrd", paths[1]),
            ("/run/mission-2.rrd", paths[2]),
            ("/other/mission.rrd", paths[3]),
        ] {
            assert_eq!(page.find(path).unwrap().0, &Content::File(file.into()), "{path}");
        }
        let in_root = WebPage::new("x", &["/mission.rrd".into()], None);
        assert!(in_root.files.keys().any(|path| path.ends_with("/mission.rrd")), "a folder without a name");
        let Content::Text(index) = page.find("/").unwrap().0 else { panic!("no text") };
        assert!(index.contains("[\"run/mission.rrd\", \"run-2/mission.rrd\", \"run/mission-2.rrd\""), "{index}");
    }

    #[test]
    fn file_names_cannot_inject_html_or_scripts() {
        let page = WebPage::new("</title><script>", &["/x/..%2f\"];alert(1)//.rrd".into()], None);
        let Content::Text(index) = page.find("/").unwrap().0 else { panic!("no text") };
        assert!(index.contains("<title>--title--script-</title>"), "{index}");
        assert!(!index.contains("alert(1)") && !index.contains("{{"), "{index}");
        assert_eq!(plain("..%2f\"];a"), "-.-2f---a");
    }

    #[test]
    fn only_a_live_page_may_connect_to_another_port() {
        let index = |live| match WebPage::new("x", &[], live).find("/").unwrap().0 {
            Content::Text(text) => text.clone(),
            other => panic!("{other:?}"),
        };
        assert!(index(None).contains("connect-src 'self' data: blob:\"") && index(None).contains("livePort = 0;"));
        assert!(index(Some(9876)).contains("blob: http://127.0.0.1:9876 http://localhost:9876\""));
        assert!(index(Some(9876)).contains("livePort = 9876;"));
    }

    #[test]
    fn a_page_is_written_completely_and_only_to_an_empty_folder() {
        let place = tempfile::tempdir().unwrap();
        let recording = place.path().join("run.rrd");
        fs::write(&recording, "RRF2").unwrap();
        let page = WebPage::new("x", std::slice::from_ref(&recording), None);
        let folder = place.path().join("a/page");
        fs::create_dir(place.path().join("a")).unwrap();
        let killed = tempfile::Builder::new().prefix(UNFINISHED).tempdir_in(place.path().join("a")).unwrap();
        fs::write(killed.path().join("old.rrd"), "left by another process").unwrap();
        page.write(&folder, &|| false).unwrap();
        let expected = fs::metadata(place.path().join("a")).unwrap().permissions();
        assert_eq!(fs::metadata(&folder).unwrap().permissions(), expected, "a web server may read it");
        assert!(!folder.join("old.rrd").exists() && killed.path().join("old.rrd").exists());
        assert_eq!(fs::metadata(folder.join("re_viewer_bg.wasm")).unwrap().len(), VIEWER[1].1.len() as u64);
        let name = plain(&place.path().file_name().unwrap().to_string_lossy());
        assert_eq!(fs::read(folder.join(name).join("run.rrd")).unwrap(), b"RRF2");
        let error = page.write(&folder, &|| false).unwrap_err().to_string();
        assert!(error.contains("a/page: it is not empty: expected one that is empty"), "{error}");
        let stopped = page.write(&place.path().join("c"), &|| true);
        assert!(matches!(stopped, Err(PageError::Stopped)), "{stopped:?}");
        fs::remove_file(&recording).unwrap();
        let error = page.write(&place.path().join("b"), &|| false).unwrap_err().to_string();
        assert!(error.contains("run.rrd: No such file"), "{error}");
        let left: Vec<_> = fs::read_dir(place.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        assert_eq!(left, ["a"], "nothing half-written is left");
    }
}
