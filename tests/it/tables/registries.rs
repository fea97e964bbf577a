//! Tables of the book from the registries: strategies, metrics, warnings of `check`, formats of exports, columns of
//! files, commands, and the scenarios that come with Skysink.

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

use clap::{Arg, Command};
use skysink_common::sensors::columns;
use skysink_lab::export::FORMATS;
use skysink_lab::import::{COORDINATES, OTHERS};
use skysink_library::{Library, gap};
use skysink_mission::metrics::Metric;
use skysink_planner::strategies::STRATEGIES;
use skysink_planner::strategy::Registered;

use super::{Documented, documented, plain, root};
use crate::names::sources;
use crate::support::Place;

/// The documentation of a strategy whose file has it at its beginning.
const AT_BEGINNING: &str = "The strategy in the registry.";

/// The strategies: name, what it does in a line, how it plans.
pub fn strategies() -> String {
    let row = |(strategy, text): (&Registered, String)| {
        let before = before_declaration(&text, strategy).expect("the file was found by it");
        let own = documented(before).into_iter().rev().find(|item| !item.words.is_empty()).expect("its documentation");
        let paragraphs = module_documentation(&text);
        let words = match own.words.as_str() {
            AT_BEGINNING => paragraphs.get(1).unwrap_or(&paragraphs[0]),
            words => words,
        };
        let words = words.strip_prefix(&format!("`{}`: ", strategy.name)).unwrap_or(words);
        format!("| `{}` | {} | {} |\n", strategy.name, strategy.about, words.replace('|', "\\|"))
    };
    let rows: String = strategies_with_texts().map(row).collect();
    format!("| name | | how it plans |\n|---|---|---|\n{rows}")
}

/// The instances of the library, with best known values and bounds.
pub fn library() -> String {
    let library = Library::default();
    let row = |instance| {
        let best = library.best(&instance).unwrap().expect("every instance has a best known flight");
        let open = library.open(instance).unwrap();
        let digits =
            |value: f64| if value == 0.0 || value >= 100.0 { format!("{value:.0}") } else { format!("{value:.5}") };
        let gap = best.bound.map(|bound| format!("{:.1} %", 100.0 * gap(best.measure, best.value, bound)));
        let cells = [
            format!("`{}`", open.instance.name),
            open.instance.about,
            open.list.sensors().len().to_string(),
            open.scenario.uav.uavs().to_string(),
            open.scenario.slots.to_string(),
            best.measure.label().to_owned(),
            digits(best.value),
            best.bound.map_or_else(String::new, digits),
            gap.unwrap_or_default(),
            best.by,
        ];
        format!("| {} |\n", cells.join(" | "))
    };
    let rows: String = library.instances().unwrap().into_iter().map(row).collect();
    format!("| instance | | SNs | UAVs | slots | | best known | bound | gap | by |\n|{}\n{rows}", "---|".repeat(10))
}

/// The works that strategies are from, and what is adapted.
pub fn sources_of_strategies() -> String {
    let source = |(strategy, text): (&Registered, String)| {
        let paragraphs = module_documentation(&text);
        let source = paragraphs.iter().find_map(|paragraph| paragraph.strip_prefix("Source: "))?;
        Some(format!("- `{}`: {source}\n", strategy.name))
    };
    strategies_with_texts().filter_map(source).collect()
}

/// The text of a file before it declares a strategy; `None` if it does not.
fn before_declaration<'a>(text: &'a str, strategy: &Registered) -> Option<&'a str> {
    let name = format!("\"{}\",", strategy.name);
    let mut calls = text.match_indices("Registered::new(");
    calls.find(|(at, call)| text[at + call.len()..].trim_start().starts_with(&name)).map(|(at, _)| &text[..at])
}

/// The strategies with the texts of their files.
fn strategies_with_texts() -> impl Iterator<Item = (&'static Registered, String)> {
    let files = sources(&root().join("planner/src/strategies"));
    let texts: Vec<String> = files.iter().map(|file| fs::read_to_string(file).unwrap()).collect();
    STRATEGIES.iter().map(move |&strategy| {
        let text = texts.iter().find(|text| before_declaration(text, strategy).is_some());
        (strategy, text.unwrap_or_else(|| panic!("{}: expected it in a file", strategy.name)).clone())
    })
}

/// The paragraphs at the beginning of a file.
fn module_documentation(text: &str) -> Vec<String> {
    let lines: Vec<&str> = text.lines().map_while(|line| line.strip_prefix("//!")).map(str::trim).collect();
    lines.split(|line| line.is_empty()).map(|lines| plain(&lines.join(" "))).collect()
}

/// The metrics with their units and definitions.
pub fn metrics() -> String {
    let row = |metric: Metric| {
        let words = plain(metric.figure().definition.trim()).replace('|', "\\|");
        format!("| `{}` | {} | {words} |\n", metric.name(), metric.unit())
    };
    format!("| column | unit | definition |\n|---|---|---|\n{}", Metric::all().map(row).collect::<String>())
}

/// The figures that `check` prints of a scenario.
pub fn figures() -> String {
    let scenario = root().join("scenarios/sparse.toml");
    let checked = Place::new().run_ok(&["check", scenario.to_str().expect("a path of UTF-8")]).stdout;
    let figures: String =
        checked.lines().filter(|line| line.starts_with("#  ")).map(|line| format!("{line}\n")).collect();
    format!("```\n{figures}```\n")
}

/// Files with the warnings of `check`.
const WARNING: [&str; 5] = [
    "src/check/warnings.rs",
    "src/check/motion.rs",
    "src/check/energy.rs",
    "src/check/doubts.rs",
    "common/src/geodata/plausible.rs",
];

/// Fewest words of a warning.
const WARNING_WORDS: usize = 6;

/// The warnings: the texts of each documented function that returns some, and when it does.
pub fn warnings() -> String {
    let mut rows = String::new();
    for file in WARNING {
        let text = read(file);
        let (product, _) = text.split_once("#[cfg(test)]").unwrap_or((&text, ""));
        let mut condition = None;
        let mut body = String::new();
        let mut add = |condition: Option<String>, body: &str| {
            let texts = literals(body).into_iter().filter(|text| text.split_whitespace().count() >= WARNING_WORDS);
            let Some(condition) = condition else { return };
            rows.extend(texts.map(|text| format!("| {text} | {condition} |\n")));
        };
        for Documented { line, words, .. } in documented(product) {
            if line.contains("fn ") {
                add(condition.take(), &std::mem::take(&mut body));
                let is_warning = line.contains("-> Option<String>") || line.contains("-> Vec<String>");
                condition = (is_warning && !words.is_empty()).then_some(words);
            } else {
                body += &format!("{line}\n");
            }
        }
        add(condition, &body);
    }
    format!("| warning | when |\n|---|---|\n{rows}")
}

/// The string literals of a text, with `…` for what is inserted.
fn literals(text: &str) -> Vec<String> {
    let text = text.replace("\\\n", "").replace("\\\"", "”");
    let inserted = |literal: &str| {
        let mut parts = literal.split('{');
        let first = parts.next().unwrap_or_default().to_owned();
        parts.fold(first, |text, part| text + "…" + part.split_once('}').map_or("", |(_, rest)| rest))
    };
    let literals = text.split('"').skip(1).step_by(2).filter(|literal| !literal.starts_with(','));
    literals.map(|literal| inserted(literal).replace('”', "\"").replace("……", "…")).collect()
}

/// The formats of exports.
pub fn formats() -> String {
    let row = |format: &&skysink_lab::export::ExportFormat| {
        let text = read(&format!("lab/src/export/{}.rs", format.name.replace('-', "_")));
        let contents = documented(&text).into_iter().find(|item| item.line.starts_with("pub static FORMAT"));
        let contents = contents.expect("the format").words;
        format!("| `{}` | `.{}` | {} | {contents} |\n", format.name, format.extension, format.about)
    };
    let rows: String = FORMATS.iter().map(row).collect();
    format!("| `--format` | file | | contents |\n|---|---|---|---|\n{rows}")
}

/// The columns of imported files, with their other names.
pub fn imported_columns() -> String {
    let row = |names: &&[&str]| {
        let others: Vec<String> = names[1..].iter().map(|name| format!("`{name}`")).collect();
        format!("| `{}` | {} |\n", names[0], others.join(", "))
    };
    let rows: String = COORDINATES.iter().chain(&OTHERS).map(row).collect();
    format!("| column | also read as |\n|---|---|\n{rows}")
}

/// The columns of sensor lists.
pub fn sensor_columns() -> String {
    let rows: String = columns().map(|(name, values)| format!("| `{name}` | {values} |\n")).collect();
    format!("| column | values |\n|---|---|\n{rows}")
}

/// Pages on commands that are not called as the command.
const PAGES: [(&str, &str); 8] = [
    ("new", "own-field.md"),
    ("optimize", "compare.md#against-the-best-known-flight"),
    ("fleet", "compare.md#the-least-fleet"),
    ("merge", "cluster.md"),
    ("page", "view.md"),
    ("report", "interfaces.md#run-folder"),
    ("run", "introduction.md#the-ring"),
    ("join", "hosts.md"),
];

/// Commands from which on an option is listed once for all.
const SEVERAL: usize = 2;

/// Most values of an option that are listed.
const MOST_VALUES: usize = 6;

/// The commands and their options.
pub fn commands() -> String {
    let mut skysink = skysink::cli::command();
    skysink.build();
    let commands: Vec<&Command> = skysink.get_subcommands().filter(|command| command.get_name() != "help").collect();
    let mut uses: BTreeMap<(String, String), usize> = BTreeMap::new();
    for option in commands.iter().flat_map(|command| options(command)) {
        *uses.entry((called(option), row(option))).or_default() += 1;
    }
    uses.retain(|_, count| *count >= SEVERAL);
    let meanings = |name: &String| uses.keys().filter(|(other, _)| other == name).count();
    let common: BTreeMap<&String, &String> =
        uses.keys().filter(|(name, _)| meanings(name) == 1).map(|(name, row)| (name, row)).collect();
    let is_common = |option: &Arg| common.get(&called(option)).is_some_and(|common| **common == row(option));
    let common: String = common.values().map(|row| row.as_str()).collect();
    let mut text = format!("Options of several commands:\n\n| option | |\n|---|---|\n{common}");
    for command in commands {
        let name = command.get_name();
        let own: String = options(command).filter(|option| !is_common(option)).map(row).collect();
        let also: Vec<String> =
            options(command).filter(|option| is_common(option)).map(|option| format!("`{}`", called(option))).collect();
        let other = PAGES.iter().find(|(other, _)| *other == name).map(|(_, page)| (*page).to_owned());
        let own_page = Some(format!("{name}.md")).filter(|page| root().join("docs/src").join(page).exists());
        let page = other.or(own_page);
        let link = page.map_or_else(String::new, |page| format!(" ([page]({page}))"));
        let about = command.get_about().map(ToString::to_string).unwrap_or_default();
        text += &format!("\n### `skysink {name}`\n\n{}{link}.\n", plain(&about.replace('\n', " ")));
        text += &if own.is_empty() { String::new() } else { format!("\n| option | |\n|---|---|\n{own}") };
        text += &if also.is_empty() { String::new() } else { format!("\nAlso {}.\n", also.join(", ")) };
    }
    text
}

/// The arguments of a command.
fn options(command: &Command) -> impl Iterator<Item = &Arg> {
    command.get_arguments().filter(|option| option.get_id() != "help" && !option.is_hide_set())
}

/// The option or argument without what follows it.
fn called(option: &Arg) -> String {
    option.get_long().map_or_else(|| option.to_string(), |name| format!("--{name}"))
}

/// The row of an option or argument.
fn row(option: &Arg) -> String {
    let help = option.get_long_help().or(option.get_help()).map(ToString::to_string).unwrap_or_default();
    let values: Vec<String> =
        option.get_possible_values().iter().map(|value| format!("`{}`", value.get_name())).collect();
    let is_listed = option.get_action().takes_values() && (1..=MOST_VALUES).contains(&values.len());
    let values = if is_listed { format!(" ({})", values.join(", ")) } else { String::new() };
    let is_shown =
        option.get_action().takes_values() && !option.is_hide_default_value_set() && !help.contains("[default");
    let defaults = option.get_default_values().iter().map(|value| value.to_string_lossy()).filter(|_| is_shown);
    let default: String =
        defaults.filter(|value| !value.is_empty()).map(|value| format!(" [default: {value}]")).collect();
    let text = format!("{}{values}{default}", help.trim_end_matches('.').replace('\n', " "));
    format!("| `{}` | {} |\n", option.to_string().replace('|', "\\|"), text.replace('|', "\\|"))
}

/// The scenarios that come with Skysink, with the first sentence of each file.
pub fn scenarios() -> String {
    let folder = root().join("scenarios");
    let entries = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path());
    let file = |path: PathBuf| {
        let inside = path.join(path.file_name()?).with_extension("toml");
        [path, inside].into_iter().find(|file| file.is_file() && file.extension().is_some_and(|end| end == "toml"))
    };
    let mut files: Vec<PathBuf> = entries.filter_map(file).collect();
    files.sort();
    let row = |file: &PathBuf| {
        let text = fs::read_to_string(file).unwrap();
        let comment: Vec<&str> = text.lines().map_while(|line| line.strip_prefix("# ")).collect();
        let comment = comment.join(" ");
        let sentence = comment.split_once(". ").map_or(comment.as_str(), |(first, _)| first).trim_end_matches('.');
        format!("| `{}` | {sentence} |\n", file.strip_prefix(&folder).unwrap().display())
    };
    let rows: String = files.iter().map(row).collect();
    format!("| in `scenarios/` | |\n|---|---|\n{rows}")
}

fn read(file: &str) -> String {
    fs::read_to_string(root().join(file)).unwrap_or_else(|error| panic!("{file}: {error}"))
}
