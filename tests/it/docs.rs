//! The documentation: the commands of tutorials and guides run, quotes agree with their files, and links have targets.
use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

use crate::support::{Place, output};

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

/// Parts of the book whose commands are run.
const COMMANDS_RUN_IN: [&str; 3] = ["Tutorials", "Choosing", "How-to guides"];

/// The landing page of the repository, whose commands are run like those of guides.
const README: &str = "../../README.md";

/// Folders of the repository that commands read.
const READ: [&str; 2] = ["scenarios", "examples"];

/// Pages outside the book whose links are checked.
const OTHER_PAGES: [&str; 5] = ["README.md", "CONTRIBUTING.md", "CHANGELOG.md", "INVARIANTS.md", "python/README.md"];

/// The text before and after the reason why a block is not run.
const REASON: [&str; 2] = ["<!-- not run: ", " -->"];

/// The text before and after the file that a block quotes.
const QUOTED: [&str; 2] = ["<!-- from ", " -->"];

fn book() -> PathBuf {
    Path::new(ROOT).join("docs/src")
}

/// A fenced block of a page.
struct Block {
    /// Page and line, for messages.
    place: String,
    /// The text after the fence, such as `sh,no_run`.
    kind: String,
    /// The line before it.
    before: String,
    text: String,
}

impl Block {
    /// The part of the line before it between these two texts.
    fn remark(&self, [begin, end]: [&str; 2]) -> Option<&str> {
        self.before.strip_prefix(begin)?.strip_suffix(end).filter(|said| !said.is_empty())
    }

    /// Whether it has commands to type. (Messages of Skysink begin with `skysink: `.)
    fn has_commands(&self) -> bool {
        self.kind.starts_with("sh") || self.text.lines().any(|line| line.starts_with("skysink "))
    }
}

fn blocks(page: &str) -> Vec<Block> {
    let text = fs::read_to_string(book().join(page)).unwrap();
    let mut blocks: Vec<Block> = Vec::new();
    let mut before = "";
    let mut is_open = false;
    for (number, line) in text.lines().enumerate() {
        match line.strip_prefix("```") {
            Some(_) if is_open => is_open = false,
            Some(kind) => {
                is_open = true;
                let place = format!("{page}, line {}", number + 1);
                blocks.push(Block { place, kind: kind.into(), before: before.into(), text: String::new() });
            }
            None if is_open => blocks.last_mut().unwrap().text += &format!("{line}\n"),
            None => before = line,
        }
    }
    assert!(!is_open, "{page}: a fence is left open");
    blocks
}

/// The targets of Markdown links: `target` of `[text](target)`.
fn links(text: &str) -> impl Iterator<Item = &str> {
    text.split("](").skip(1).filter_map(|rest| Some(rest.split_once(')')?.0))
}

/// The pages of the book, each with the part that it belongs to.
fn summary() -> Vec<(String, String)> {
    let text = fs::read_to_string(book().join("SUMMARY.md")).unwrap();
    let mut part = String::new();
    let mut pages = Vec::new();
    for line in text.lines() {
        if let Some(heading) = line.strip_prefix("# ") {
            heading.clone_into(&mut part);
        }
        pages.extend(links(line).map(|page| (part.clone(), page.to_owned())));
    }
    pages
}

/// The pages whose commands are run.
fn guides() -> Vec<String> {
    let guides = summary().into_iter().filter(|(part, _)| COMMANDS_RUN_IN.contains(&part.as_str()));
    guides.map(|(_, page)| page).chain([README.to_owned()]).collect()
}

/// The words of a line of an output; wall-clock times widen its table.
fn words(line: &str) -> Vec<&str> {
    line.split(|letter: char| letter.is_whitespace() || "│┌─┐╞═╡└┘".contains(letter))
        .filter(|word| !word.is_empty())
        .collect()
}

/// What stands for lines of an output that a page omits.
const OMITTED: &str = "...";

/// Runs the blocks of a page in order, each in its own shell, in a folder with links to the repository's folders, as a
/// reader would from its root. The lines of a `text` block are among those that the commands before it print, in order.
fn run_page(page: &str) {
    let place = Place::new();
    for folder in READ {
        symlink(Path::new(ROOT).join(folder), place.path(folder)).unwrap();
    }
    let executables = Path::new(env!("CARGO_BIN_EXE_skysink")).parent().unwrap();
    let path = format!("{}:{}", executables.display(), std::env::var("PATH").unwrap());
    let mut printed = None;
    for block in blocks(page) {
        match (block.kind.as_str(), &printed) {
            ("sh", _) => {
                let mut shell = place.command("bash", &["-euo", "pipefail", "-c", &block.text]);
                let ended = output(shell.env("PATH", &path));
                assert_eq!(ended.code, Some(0), "{}:\n{}{ended:?}", block.place, block.text);
                printed = Some(ended.stdout);
            }
            ("text", Some(printed)) => {
                let mut lines = printed.lines().map(words);
                let mut shown = block.text.lines().filter(|line| *line != OMITTED);
                let missing = shown.find(|line| !lines.any(|printed| printed == words(line)));
                assert_eq!(missing, None, "{}: expected it in:\n{printed}", block.place);
            }
            _ => printed = None,
        }
    }
    place.assert_clean();
}

#[test]
fn the_commands_of_tutorials_and_guides_run() {
    let guides = guides();
    assert!(guides.len() > 10, "{guides:?}");
    std::thread::scope(|scope| {
        let running: Vec<_> = guides.iter().map(|page| (page, scope.spawn(|| run_page(page)))).collect();
        let failed: Vec<_> = running.into_iter().filter_map(|(page, run)| run.join().err().map(|_| page)).collect();
        assert!(failed.is_empty(), "{failed:?}");
    });
}

#[test]
fn commands_that_are_not_run_state_the_reason() {
    let blocks: Vec<Block> = guides().iter().flat_map(|page| blocks(page)).filter(Block::has_commands).collect();
    let mut reasons = Vec::new();
    for block in &blocks {
        match (block.kind.as_str(), block.remark(REASON)) {
            ("sh", None) => {}
            ("sh,no_run", Some(reason)) => reasons.push(format!("{}: {reason}", block.place)),
            ("sh", Some(_)) => panic!("{}: run, and says why it is not", block.place),
            ("sh,no_run", None) => panic!("{}: expected {}...{} before it", block.place, REASON[0], REASON[1]),
            (kind, _) => panic!("{}: ```{kind}: expected ```sh or ```sh,no_run before commands", block.place),
        }
    }
    let run = blocks.len() - reasons.len();
    println!("{run} blocks are run, {} are not:\n{}", reasons.len(), reasons.join("\n"));
    assert!(run > 15, "{run} blocks are run");
}

#[test]
fn quotations_from_files_are_up_to_date() {
    let pages = summary().into_iter().map(|(_, page)| page);
    let mut quoted = 0;
    for block in pages.flat_map(|page| blocks(&page)) {
        let Some(file) = block.remark(QUOTED) else { continue };
        let text = fs::read_to_string(Path::new(ROOT).join(file)).unwrap();
        assert!(text.contains(&block.text), "{}: it is not in {file} as it is here", block.place);
        quoted += 1;
    }
    assert!(quoted > 0);
}

#[test]
fn the_table_of_contents_has_every_page() {
    let listed: BTreeSet<String> = summary().into_iter().map(|(_, page)| page).collect();
    let names = fs::read_dir(book()).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let pages: BTreeSet<String> = names.filter(|name| name.ends_with(".md") && name != "SUMMARY.md").collect();
    assert_eq!(listed, pages);
}

/// The name of a heading in links, as GitHub and mdBook give it.
fn anchor(heading: &str) -> String {
    let kept = heading.chars().filter(|&letter| letter.is_alphanumeric() || " -_".contains(letter));
    kept.collect::<String>().trim().to_lowercase().replace(' ', "-")
}

/// The lines of a page that are not in a fenced block.
fn prose(page: &Path) -> Vec<String> {
    let text = fs::read_to_string(page).unwrap_or_else(|error| panic!("{}: {error}", page.display()));
    let mut is_open = false;
    let mut lines = Vec::new();
    for line in text.lines() {
        if line.starts_with("```") {
            is_open = !is_open;
        } else if !is_open {
            lines.push(line.to_owned());
        }
    }
    lines
}

#[test]
fn every_link_of_the_documentation_has_a_target() {
    let root = Path::new(ROOT);
    let pages = summary().into_iter().map(|(_, page)| book().join(page));
    let mut broken = Vec::new();
    let mut count = 0;
    for page in pages.chain(OTHER_PAGES.map(|page| root.join(page))) {
        let text = prose(&page).join("\n");
        assert_eq!(text.matches('`').count() % 2, 0, "{}: a backtick is left open", page.display());
        // Code may look like a link.
        let text: String = text.split('`').step_by(2).collect();
        for target in links(&text).filter(|target| !target.contains("://")) {
            count += 1;
            let (file, heading) = target.split_once('#').unwrap_or((target, ""));
            let file = if file.is_empty() { page.clone() } else { page.parent().unwrap().join(file) };
            let has_heading = || {
                let lines = prose(&file);
                let mut headings = lines.iter().filter(|line| line.starts_with('#'));
                headings.any(|line| anchor(line.trim_start_matches('#').trim()) == heading)
            };
            if !file.exists() || !heading.is_empty() && !has_heading() {
                broken.push(format!("{}: {target}", page.display()));
            }
        }
    }
    assert!(count > 100, "{count} links");
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}
