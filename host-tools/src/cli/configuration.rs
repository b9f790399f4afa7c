//! The user's configuration as defaults of the command line, and `stylus config`, which shows it.

use std::path::{Path, PathBuf};

use clap::{Arg, Command};
use host_tools::support::configuration::{Configuration, Entry, KEYS, TEMPLATE, TOP, path};
use host_tools::support::error::{Error, Result};
use serde::Serialize;

use super::output::{print, print_json};
use super::table::table;

#[derive(clap::Args)]
pub struct Arguments {
    /// Print the file's path alone
    #[arg(long, conflicts_with_all = ["template", "json"])]
    path: bool,
    /// Print a file to start from, with every key
    #[arg(long, conflicts_with = "json")]
    template: bool,
    /// Print keys and values as JSON
    #[arg(long)]
    json: bool,
}

impl Arguments {
    /// Returns true if the command helps where the configuration cannot be used.
    pub fn is_remedy(&self) -> bool {
        self.path || self.template
    }
}

/// `command`, the whole command line, with the defaults of the user's configuration.
///
/// # Errors
/// A file that cannot be read, or a key or value that cannot be used, with its line.
pub fn with_users_defaults(command: Command) -> Result<Command> {
    match path() {
        Some(path) => with_defaults(command, &Configuration::read(&path)?, &path),
        None => Ok(command),
    }
}

/// `command` with the defaults of `configuration`, which was read from `path`.
fn with_defaults(
    mut command: Command,
    configuration: &Configuration,
    path: &Path,
) -> Result<Command> {
    for entry in &configuration.entries {
        // A build may leave a key's command out.
        if let Some(argument) = argument_of(&command, entry.table, entry.key) {
            check(argument, entry).map_err(|problem| Error::line(path, entry.line, problem))?;
        }
        command = with_default(command, entry);
    }
    Ok(command)
}

/// `command` with the default of `entry`, in all commands that have the option.
fn with_default(command: Command, entry: &Entry) -> Command {
    let set = |argument: Arg| {
        if argument.get_long() == Some(entry.key) {
            argument.default_value(entry.value.clone())
        } else {
            argument
        }
    };
    let inner = |inner: Command| {
        if inner.is_hide_set() || entry.table != TOP && inner.get_name() != entry.table {
            inner
        } else if entry.table == TOP {
            with_default(inner, entry)
        } else {
            inner.mut_args(set)
        }
    };
    if entry.table == TOP {
        command.mut_args(set).mut_subcommands(inner)
    } else {
        command.mut_subcommands(inner)
    }
}

/// The option that `key` of `table` is the default of.
fn argument_of<'a>(command: &'a Command, table: &str, key: &str) -> Option<&'a Arg> {
    let of = |command: &'a Command| {
        let mut arguments = command.get_arguments();
        arguments.find(|argument| argument.get_long() == Some(key))
    };
    if table == TOP {
        let mut inner = command
            .get_subcommands()
            .filter(|inner| !inner.is_hide_set());
        return of(command).or_else(|| inner.find_map(of));
    }
    of(command.find_subcommand(table)?)
}

/// Checks a value by the option's own parser, which says in a line what is wrong.
fn check(argument: &Arg, entry: &Entry) -> std::result::Result<(), String> {
    let option = format!("--{}={}", entry.key, entry.value);
    let argument = Arg::new(entry.key)
        .long(entry.key)
        .num_args(1)
        .value_parser(argument.get_value_parser().clone());
    let probe = Command::new("config").no_binary_name(true).arg(argument);
    let Err(refusal) = probe.try_get_matches_from([option]) else {
        return Ok(());
    };
    let text = refusal.render().to_string();
    let lines: Vec<&str> = (text.lines().map(str::trim))
        .take_while(|line| !line.is_empty())
        .collect();
    Err(lines.join(" ").trim_start_matches("error: ").to_owned())
}

/// A key with its value, and where that is from.
#[derive(Serialize)]
struct Row {
    key: String,
    value: Option<String>,
    from: String,
}

#[derive(Serialize)]
struct Shown {
    path: Option<PathBuf>,
    is_there: bool,
    keys: Vec<Row>,
}

/// Shows the configuration of `command`, the whole command line without it.
pub fn run(arguments: &Arguments, command: &Command) -> Result<()> {
    if arguments.template {
        return print(TEMPLATE.trim_end());
    }
    let path = path();
    if arguments.path {
        let path = path.ok_or_else(|| Error::Request(NOWHERE.to_owned()))?;
        return print(&path.display().to_string());
    }
    let configuration = match &path {
        Some(path) => Configuration::read(path)?,
        None => Configuration::default(),
    };
    let keys = KEYS.iter().flat_map(|(table, keys)| {
        let key = |key: &&'static str| row(command, &configuration, table, key);
        keys.iter().filter_map(key).collect::<Vec<_>>()
    });
    let shown = Shown {
        is_there: path.as_ref().is_some_and(|path| path.exists()),
        keys: keys.collect(),
        path,
    };
    if arguments.json {
        return print_json(&shown);
    }
    print(&in_words(&shown))
}

/// Words for an environment without a folder for configurations.
const NOWHERE: &str = "there is no place for a configuration: set HOME or XDG_CONFIG_HOME";

fn in_words(shown: &Shown) -> String {
    let head = match &shown.path {
        None => NOWHERE.to_owned(),
        Some(path) if shown.is_there => path.display().to_string(),
        Some(path) => format!(
            "{} is not there; `stylus config --template` prints one to start from",
            path.display()
        ),
    };
    let cells = |row: &Row| {
        let value = row.value.clone().unwrap_or_else(|| "not set".to_owned());
        vec![row.key.clone(), value, row.from.clone()]
    };
    let rows: Vec<Vec<String>> = shown.keys.iter().map(cells).collect();
    format!("{head}\n\n{}", table(&["key", "value", "from"], &rows))
}

/// The row of a key; none if this build has no such option.
fn row(
    command: &Command,
    configuration: &Configuration,
    table: &str,
    key: &'static str,
) -> Option<Row> {
    let argument = argument_of(command, table, key)?;
    let name = if table == TOP {
        key.to_owned()
    } else {
        format!("{table}.{key}")
    };
    let by_environment = || {
        let variable = argument.get_env()?;
        let value = std::env::var_os(variable).filter(|value| !value.is_empty())?;
        let value = value.to_string_lossy().into_owned();
        Some((value, variable.to_string_lossy().into_owned()))
    };
    let by_file = || {
        let entry = configuration.entry(table, key)?;
        Some((entry.value.clone(), format!("line {}", entry.line)))
    };
    let (value, from) = by_environment().or_else(by_file).unzip();
    let by_default = || {
        let default = argument.get_default_values().first()?;
        Some(default.to_string_lossy().into_owned())
    };
    let (value, from) = (
        value.or_else(by_default),
        from.unwrap_or_else(|| "default".to_owned()),
    );
    Some(Row {
        key: name,
        value,
        from,
    })
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;
    use host_tools::fit::Order;

    use super::*;

    fn matched(text: &str, words: &[&str]) -> Result<clap::ArgMatches> {
        let path = Path::new("c.toml");
        let configuration = Configuration::from_toml(path, text)?;
        let command = with_defaults(crate::cli::Arguments::command(), &configuration, path)?;
        Ok(command.try_get_matches_from(words).unwrap())
    }

    /// Every key is an option of its command, or of all that have it.
    #[cfg(all(feature = "device", feature = "hatt"))]
    #[test]
    fn every_key_is_an_option_and_the_template_holds_values_that_it_takes() {
        let command = crate::cli::Arguments::command();
        for (table, keys) in KEYS {
            for key in keys {
                assert!(argument_of(&command, table, key).is_some(), "{table} {key}");
            }
        }
        let set: Vec<&str> = TEMPLATE
            .lines()
            .map(|line| match line.strip_prefix("# ") {
                Some(rest)
                    if rest
                        .split_once(" = ")
                        .is_some_and(|(key, _)| !key.contains(' ')) =>
                {
                    rest
                }
                _ => line,
            })
            .collect();
        matched(&set.join("\n"), &["stylus", "config"]).unwrap();
    }

    #[test]
    fn a_value_that_the_option_does_not_take_is_refused_with_its_line() {
        for (text, words) in [
            (
                "[fit]\norder = 401",
                &["c.toml, line 2: invalid value '401'", "400"][..],
            ),
            (
                "[fit]\nstructure = 'ladder'",
                &["line 2", "'ladder'", "lattice, direct, direct16"],
            ),
            ("\nquiet = 'very'", &["line 2", "'very'", "true, false"]),
            (
                "color = 'blue'",
                &["line 1", "'blue'", "auto, always, never"],
            ),
            ("[fit]\nsnap = -1", &["line 2", "'-1'"]),
            #[cfg(feature = "device")]
            ("timeout = 0", &["line 1", "'0'"]),
            #[cfg(feature = "device")]
            ("link = 'bluetooth'", &["line 1", "tcp:HOST:PORT"]),
        ] {
            let message = matched(text, &["stylus", "config"])
                .unwrap_err()
                .to_string();
            assert_eq!(message.lines().count(), 1, "{message}");
            for word in words {
                assert!(message.contains(word), "{message}");
            }
        }
    }

    #[test]
    fn the_command_line_wins_over_the_file() {
        let text = "quiet = true\n[fit]\norder = 7\nestimator = 'tapered'\n";
        let fit = ["stylus", "fit", "set", "--out", "a.lib"];
        let order = |matches: &clap::ArgMatches| {
            let (_, fit) = matches.subcommand().unwrap();
            fit.get_one::<Order>("order").copied().unwrap()
        };
        assert_eq!(order(&matched(text, &fit).unwrap()), Order::Fixed(7));
        let given = [&fit[..], &["--order", "9", "--quiet=false"]].concat();
        let given = matched(text, &given).unwrap();
        assert_eq!(order(&given), Order::Fixed(9));
        assert!(!given.get_flag("quiet"));
        let before = ["stylus", "--quiet=false", "fit", "set", "--out", "a.lib"];
        assert!(!matched(text, &before).unwrap().get_flag("quiet"));
        assert!(matched(text, &fit).unwrap().get_flag("quiet"));
        assert!(
            matched("", &["stylus", "fit", "set", "-q", "--out", "a.lib"])
                .unwrap()
                .get_flag("quiet")
        );
        assert!(!matched("", &fit).unwrap().get_flag("quiet"));
    }
}
