//! The user's configuration: defaults of the command's options, in one TOML text.
//!
//! A key is the long name of an option, and stands for the value that the option has where the command line does not
//! give it. Keys of one command are in a table of its name. Values are kept as text, because the option's own parser
//! judges them.

use std::ffi::OsString;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use toml::de::{DeInteger, DeTable, DeValue};

use super::bounded_file::Limit;
use super::error::{Error, Result};
use super::nearest::nearest;
use super::toml_field::{line_at, parse_failure};

/// The text of a configuration.
pub const TEXT: Limit = Limit {
    of: "a configuration",
    bytes: 64 << 10,
};

/// Path of the file in the user's folder of configurations.
const FILE: &str = "stylus/config.toml";

/// Table of the keys that are in no table.
pub const TOP: &str = "";

/// Keys of a table.
pub type Keys = (&'static str, &'static [&'static str]);

/// All keys by their tables; those of [`TOP`] are for all commands.
pub const KEYS: [Keys; 2] = [
    (TOP, &["link", "timeout", "quiet", "color"]),
    (
        "fit",
        &[
            "order",
            "estimator",
            "structure",
            "theta",
            "reduce",
            "silence-floor",
            "excitation",
            "modulation",
            "lines",
            "snap",
        ],
    ),
];

/// A text to start from, with every key and what it means. It changes nothing as it is.
pub const TEMPLATE: &str = "\
# Defaults of the command `stylus`. A key is the long name of an option; the command line and the
# environment (STYLUS_LINK, NO_COLOR) win over this file. Remove the # before the keys that you set.

# The stylus, where several are attached: usb, usb:SERIAL, serial:PATH, tcp:HOST:PORT or
# usb-virtual:HOST:PORT
# link = \"serial:/dev/ttyACM0\"
# Timeout of an answer, in seconds
# timeout = 2
# Results, warnings and errors only: no progress and no notes
# quiet = true
# Colour of help, warnings and errors: auto, always or never
# color = \"auto\"

[fit]
# Order of the models: 0 to 400, \"auto\" or \"bic\"
# order = 400
# Estimator of the autocorrelation: auto, rectangular, tapered or multitaper
# estimator = \"auto\"
# Filter structure: lattice, direct or direct16
# structure = \"lattice\"
# Bytes of a lattice's angles: auto, fine or compact
# theta = \"auto\"
# Reduction from three axes to one: pca, dft321, x, y or z
# reduce = \"pca\"
# RMS below which a trial counts as silent, in m/s²
# silence-floor = 0.001
# Source of the excitation: auto, gaussian or residual
# excitation = \"auto\"
# Level of the excitation: auto, none or track
# modulation = \"auto\"
# Lines that are locked to place: auto or none
# lines = \"auto\"
# Largest share by which measured speeds and forces move to nominal ones
# snap = 0.03
";

/// A key with its value.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// The table, [`TOP`] for keys in none.
    pub table: &'static str,
    /// The key.
    pub key: &'static str,
    /// The value as text.
    pub value: String,
    /// The line of the key, from 1.
    pub line: u64,
}

/// The keys that a text sets.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Configuration {
    /// The keys in the order of [`KEYS`].
    pub entries: Vec<Entry>,
}

impl Configuration {
    /// Reads the configuration at `path`, which sets nothing if there is none.
    ///
    /// # Errors
    /// A file that cannot be read, and those of [`Configuration::from_toml`].
    pub fn read(path: &Path) -> Result<Self> {
        if let Err(failure) = std::fs::metadata(path)
            && matches!(
                failure.kind(),
                ErrorKind::NotFound | ErrorKind::NotADirectory
            )
        {
            return Ok(Self::default());
        }
        drop(TEXT.open(path)?);
        Self::from_toml(path, &TEXT.read_text(path)?)
    }

    /// Parses the TOML `text`; errors name `path`.
    ///
    /// ```
    /// use host_tools::support::configuration::Configuration;
    /// let read = |text| Configuration::from_toml("config.toml".as_ref(), text);
    /// let configuration = read("link = 'usb'\n[fit]\norder = 400\n").unwrap();
    /// assert_eq!(configuration.entries[1].value, "400");
    /// let unknown = read("\nlnik = 'usb'\n").unwrap_err().to_string();
    /// assert!(unknown.starts_with("config.toml, line 2: there is no key `lnik`: is `link` meant?"));
    /// ```
    ///
    /// # Errors
    /// Text that is not TOML, a key that there is not, and a value that is not one of text, number or truth, each with
    /// its line.
    pub fn from_toml(path: &Path, text: &str) -> Result<Self> {
        let document =
            DeTable::parse(text).map_err(|failure| parse_failure(path, text, &failure))?;
        let mut entries = Vec::new();
        let at = |span: std::ops::Range<usize>| line_at(text, span.start);
        for (name, value) in document.get_ref() {
            let (name, line) = (name.get_ref().as_ref(), at(name.span()));
            let Some(&table) = tables().find(|&table| *table == name) else {
                let key =
                    known(TOP, name).ok_or_else(|| Error::line(path, line, unknown(TOP, name)))?;
                let value = scalar(value.get_ref())
                    .map_err(|problem| Error::line(path, line, format!("`{key}` {problem}")))?;
                entries.push(Entry {
                    table: TOP,
                    key,
                    value,
                    line,
                });
                continue;
            };
            let Some(inner) = value.get_ref().as_table() else {
                let problem = format!("`{table}` is a table: write [{table}], and its keys below");
                return Err(Error::line(path, line, problem));
            };
            for (name, value) in inner {
                let (name, line) = (name.get_ref().as_ref(), at(name.span()));
                let key = known(table, name)
                    .ok_or_else(|| Error::line(path, line, unknown(table, name)))?;
                let value = scalar(value.get_ref())
                    .map_err(|problem| Error::line(path, line, format!("`{key}` {problem}")))?;
                entries.push(Entry {
                    table,
                    key,
                    value,
                    line,
                });
            }
        }
        let place = |entry: &Entry| {
            let table = KEYS.iter().position(|(table, _)| *table == entry.table);
            let keys = table.map(|table| KEYS[table].1).unwrap_or_default();
            (table, keys.iter().position(|key| *key == entry.key))
        };
        entries.sort_by_key(place);
        Ok(Self { entries })
    }

    /// The entry of a key, if the text sets it.
    pub fn entry(&self, table: &str, key: &str) -> Option<&Entry> {
        let mut entries = self.entries.iter();
        entries.find(|entry| entry.table == table && entry.key == key)
    }
}

/// Path of the user's configuration: in `XDG_CONFIG_HOME`, or else in `.config` of the home folder; on Windows in
/// `APPDATA`. None if the environment names none of them.
pub fn path() -> Option<PathBuf> {
    path_by(|name| std::env::var_os(name))
}

/// [`path`] by the environment that `get` gives.
fn path_by(get: impl Fn(&str) -> Option<OsString>) -> Option<PathBuf> {
    // A relative one is to be ignored (XDG Base Directory Specification 0.8).
    let absolute = |name: &str| {
        let folder = PathBuf::from(get(name)?);
        folder.is_absolute().then_some(folder)
    };
    let folder = absolute("XDG_CONFIG_HOME").or_else(|| {
        if cfg!(windows) {
            absolute("APPDATA")
        } else {
            absolute("HOME").map(|home| home.join(".config"))
        }
    });
    folder.map(|folder| folder.join(FILE))
}

/// Names of the tables.
fn tables() -> impl Iterator<Item = &'static &'static str> {
    let names = KEYS.iter().map(|(table, _)| table);
    names.filter(|table| **table != TOP)
}

/// Keys of `table`.
fn keys(table: &str) -> &'static [&'static str] {
    let found = KEYS.iter().find(|(name, _)| *name == table);
    found.map_or(&[], |(_, keys)| keys)
}

fn known(table: &str, name: &str) -> Option<&'static str> {
    keys(table).iter().find(|key| **key == name).copied()
}

/// Words for a key that there is not in `table`, with the one that is likely to be meant.
fn unknown(table: &str, name: &str) -> String {
    let other = KEYS
        .iter()
        .find(|(other, keys)| *other != table && keys.contains(&name));
    let meant = match other {
        Some((TOP, _)) => "it stands above all tables.".to_owned(),
        Some((other, _)) => format!("it belongs below [{other}]."),
        None => {
            let tables = tables().filter(|_| table == TOP);
            let there: Vec<&str> = keys(table).iter().chain(tables).copied().collect();
            format!("is `{}` meant?", nearest(name, &there).unwrap_or_default())
        }
    };
    let place = if table == TOP {
        String::new()
    } else {
        format!(" in [{table}]")
    };
    format!("there is no key `{name}`{place}: {meant} `stylus config --template` has all of them")
}

/// The text of a value.
fn scalar(value: &DeValue<'_>) -> std::result::Result<String, String> {
    let problem = "is one text, one number, or true or false";
    match value {
        DeValue::String(text) => Ok(text.to_string()),
        DeValue::Integer(integer) => decimal(integer)
            .map(|number| number.to_string())
            .ok_or_else(|| "is a number beyond 64 bits".to_owned()),
        DeValue::Float(float) => {
            let number = float.as_str().replace('_', "").parse::<f64>();
            number
                .map(|number| number.to_string())
                .map_err(|_| problem.to_owned())
        }
        DeValue::Boolean(truth) => Ok(truth.to_string()),
        DeValue::Datetime(_) | DeValue::Array(_) | DeValue::Table(_) => Err(problem.to_owned()),
    }
}

fn decimal(integer: &DeInteger<'_>) -> Option<i64> {
    i64::from_str_radix(&integer.as_str().replace('_', ""), integer.radix()).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Configuration> {
        Configuration::from_toml("c.toml".as_ref(), text)
    }

    fn refused(text: &str) -> String {
        read(text).unwrap_err().to_string()
    }

    #[test]
    fn values_of_every_kind_are_taken_as_the_options_would_be_given() {
        let text = "quiet = true\nlink = \"tcp:a:1\"\ntimeout = 1_0.50\n[fit]\norder = 0x10\nsnap = 3e-2\n";
        let entries = read(text).unwrap().entries;
        let told: Vec<String> = entries
            .iter()
            .map(|entry| {
                format!(
                    "{}.{}={}@{}",
                    entry.table, entry.key, entry.value, entry.line
                )
            })
            .collect();
        assert_eq!(
            told,
            [
                ".link=tcp:a:1@2",
                ".timeout=10.5@3",
                ".quiet=true@1",
                "fit.order=16@5",
                "fit.snap=0.03@6"
            ]
        );
    }

    #[test]
    fn an_unknown_key_is_named_with_its_line_and_the_nearest_one() {
        for (text, words) in [
            (
                "\n\nlnik = 'usb'\n",
                "c.toml, line 3: there is no key `lnik`: is `link` meant?",
            ),
            (
                "colour = 'never'",
                "line 1: there is no key `colour`: is `color` meant?",
            ),
            (
                "[fti]\norder = 4",
                "line 1: there is no key `fti`: is `fit` meant?",
            ),
            (
                "[fit]\nodrer = 4",
                "line 2: there is no key `odrer` in [fit]: is `order` meant?",
            ),
            (
                "order = 4",
                "line 1: there is no key `order`: it belongs below [fit]",
            ),
            (
                "[fit]\nlink = 'usb'",
                "line 2: there is no key `link` in [fit]: it stands above all",
            ),
        ] {
            let message = refused(text);
            assert!(message.contains(words), "{message}");
        }
    }

    #[test]
    fn what_is_no_value_or_no_toml_is_named_with_its_line() {
        for (text, words) in [
            ("fit = 4", "line 1: `fit` is a table: write [fit]"),
            ("\nlink = ['usb']", "line 2: `link` is one text"),
            ("[fit]\norder = { a = 1 }", "line 2: `order` is one text"),
            (
                "[fit]\norder = 9223372036854775808",
                "line 2: `order` is a number beyond 64 bits",
            ),
            ("link = 'a'\nlink = 'b'", "line 2"),
            ("link = ", "line 1"),
        ] {
            let message = refused(text);
            assert!(message.contains(words), "{message}");
        }
    }

    #[test]
    fn the_template_sets_nothing_and_has_every_key_once() {
        assert_eq!(read(TEMPLATE).unwrap(), Configuration::default());
        let set = |line: &str| match line.strip_prefix("# ") {
            Some(rest)
                if rest
                    .split_once(" = ")
                    .is_some_and(|(key, _)| !key.contains(' ')) =>
            {
                rest.to_owned()
            }
            _ => line.to_owned(),
        };
        let all: Vec<String> = TEMPLATE.lines().map(set).collect();
        let set = read(&all.join("\n")).unwrap();
        let expected: Vec<(&str, &str)> = KEYS
            .iter()
            .flat_map(|(table, keys)| keys.iter().map(|key| (*table, *key)))
            .collect();
        let found: Vec<(&str, &str)> = (set.entries.iter())
            .map(|entry| (entry.table, entry.key))
            .collect();
        assert_eq!(found, expected);
    }

    #[test]
    fn the_file_is_in_the_folder_that_the_environment_names() {
        let by = |pairs: &[(&str, &str)]| {
            path_by(|name| {
                let found = pairs.iter().find(|(key, _)| *key == name);
                found.map(|(_, value)| (*value).into())
            })
        };
        if cfg!(unix) {
            let named = |path: &str| Some(PathBuf::from(path));
            let (xdg, home) = (("XDG_CONFIG_HOME", "/x"), ("HOME", "/h"));
            assert_eq!(by(&[xdg, home]), named("/x/stylus/config.toml"));
            assert_eq!(by(&[home]), named("/h/.config/stylus/config.toml"));
            let relative = ("XDG_CONFIG_HOME", "x");
            assert_eq!(
                by(&[relative, home]),
                named("/h/.config/stylus/config.toml")
            );
        }
        assert_eq!(by(&[]), None);
    }

    #[test]
    fn a_file_that_is_not_there_sets_nothing_and_one_without_an_end_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("config.toml");
        assert_eq!(
            Configuration::read(&path).unwrap(),
            Configuration::default()
        );
        assert_eq!(
            Configuration::read(&path.join("x")).unwrap(),
            Configuration::default()
        );
        std::fs::write(&path, vec![b'#'; TEXT.bytes as usize + 1]).unwrap();
        let message = Configuration::read(&path).unwrap_err().to_string();
        assert!(message.contains("the most of a configuration"), "{message}");
        let message = Configuration::read(folder.path()).unwrap_err().to_string();
        assert!(message.contains("is a folder"), "{message}");
    }
}
