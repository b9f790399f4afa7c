//! Files and folders that a command writes: one rule for all, checked right after the command line is parsed.
//!
//! Each such argument is a [`Destination`], so that [`check`] finds it among a command's arguments, whatever the
//! command. All other paths of a command are its inputs. A destination must be no input, nothing but a regular file or
//! a folder, of the kind that is written, and in a folder that takes it.

mod inputs;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use clap::ArgMatches;
use clap::builder::{PathBufValueParser, TypedValueParser};
use host_tools::fit::record::FitRecord;
use host_tools::recording::freehand;
use host_tools::support::error::{Error, Result};
use host_tools::support::file_kind::{Content, FileKind};
use host_tools::support::same_file::Identity;
use host_tools::support::{atomic_file, output_file, output_folder};

use inputs::Inputs;

/// Name of the flag that replaces files of another kind.
const OVERWRITE: &str = "overwrite";

/// Name of the flag that makes fit's library a folder of libraries.
const EACH: &str = "each";

/// A file or folder to write.
#[derive(Clone, Debug, PartialEq)]
pub struct Destination {
    path: PathBuf,
    what: What,
}

/// The thing that is written.
#[derive(Clone, Copy, Debug, PartialEq)]
enum What {
    /// A file of one kind.
    File(FileKind),
    /// A library, which may replace the one that it is made from.
    LibraryInPlace,
    /// A library with its record; with --each a folder of such.
    FittedLibrary,
    /// A folder that a command writes whole, in place of an earlier result of the same command.
    Folder(&'static str),
    /// A folder with the pieces of a free hand's recordings, replaced only with --overwrite.
    Pieces,
    /// A simulated set.
    SimulatedSet,
    /// A folder of recordings that grows.
    #[cfg(feature = "device")]
    GrowingSet,
    /// A folder of partial results that grows.
    Parts,
    /// A record of a self test: a file, or a folder for a file of its own name.
    #[cfg(feature = "device")]
    SelfTest,
}

impl Destination {
    /// Its path.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

/// Flag that lets a file of another kind be replaced.
#[derive(clap::Args)]
pub struct Overwrite {
    /// Replace a file of another kind than the one that is written
    // Read by the check alone, for all commands in one place.
    #[arg(long = OVERWRITE)]
    overwrite: bool,
}

fn parser(what: What) -> impl TypedValueParser<Value = Destination> {
    PathBufValueParser::new().map(move |path| Destination { path, what })
}

/// Parses a file of `kind` to write.
pub fn file(kind: FileKind) -> impl TypedValueParser<Value = Destination> {
    parser(What::File(kind))
}

/// Parses a library to write, which may replace the one that it is made from.
pub fn library_in_place() -> impl TypedValueParser<Value = Destination> {
    parser(What::LibraryInPlace)
}

/// Parses a library that a fit writes, with its record; with --each a folder of such.
pub fn fitted_library() -> impl TypedValueParser<Value = Destination> {
    parser(What::FittedLibrary)
}

/// Parses a folder that `command` writes whole.
pub fn folder(command: &'static str) -> impl TypedValueParser<Value = Destination> {
    parser(What::Folder(command))
}

/// Parses a folder for the pieces of a free hand's recordings.
pub fn pieces() -> impl TypedValueParser<Value = Destination> {
    parser(What::Pieces)
}

/// Parses a folder for a simulated set.
pub fn simulated_set() -> impl TypedValueParser<Value = Destination> {
    parser(What::SimulatedSet)
}

/// Parses a folder of recordings that grows.
#[cfg(feature = "device")]
pub fn growing_set() -> impl TypedValueParser<Value = Destination> {
    parser(What::GrowingSet)
}

/// Parses a folder of partial results.
pub fn parts() -> impl TypedValueParser<Value = Destination> {
    parser(What::Parts)
}

/// Parses a place for the record of a self test.
#[cfg(feature = "device")]
pub fn self_test_record() -> impl TypedValueParser<Value = Destination> {
    parser(What::SelfTest)
}

/// Checks all destinations of the command that `matches` names, before anything is done.
///
/// # Errors
/// The first destination that must not or cannot be written, with the reason.
pub fn check(matches: &ArgMatches) -> Result<()> {
    let mut command = matches;
    while let Some((_, inner)) = command.subcommand() {
        command = inner;
    }
    let mut destinations: Vec<&Destination> = Vec::new();
    let mut named: Vec<&PathBuf> = Vec::new();
    for id in command.ids() {
        let id = id.as_str();
        if let Ok(Some(values)) = command.try_get_many::<Destination>(id) {
            destinations.extend(values);
        } else if let Ok(Some(values)) = command.try_get_many::<PathBuf>(id) {
            named.extend(values);
        }
    }
    if destinations.is_empty() {
        return Ok(());
    }
    let rule = Rule {
        replaces: flag(command, OVERWRITE),
        can_overwrite: command
            .try_contains_id(OVERWRITE)
            .is_ok_and(|is_known| is_known),
        is_each: flag(command, EACH),
        inputs: Inputs::of(&named),
    };
    let mut targets: Vec<PathBuf> = Vec::new();
    for destination in destinations {
        rule.check(destination)?;
        let target = std::fs::canonicalize(&destination.path).ok();
        let target = target.unwrap_or_else(|| destination.path.clone());
        if targets.contains(&target) {
            let problem = "is named for two outputs: name another for one of them";
            return Err(Error::file(&destination.path, problem));
        }
        targets.push(target);
    }
    Ok(())
}

/// Returns true if the command has this flag, and it is given.
fn flag(command: &ArgMatches, name: &str) -> bool {
    let is_set = command.try_get_one::<bool>(name);
    is_set.is_ok_and(|set| set == Some(&true))
}

/// The rule, with what it needs to know of a command's other arguments.
struct Rule {
    /// Files of another kind are replaced.
    replaces: bool,
    /// The command has the flag for that.
    can_overwrite: bool,
    is_each: bool,
    inputs: Inputs,
}

impl Rule {
    fn check(&self, Destination { path, what }: &Destination) -> Result<()> {
        match *what {
            What::File(kind) => self.file(path, kind),
            What::LibraryInPlace => match FileKind::of_file(&atomic_file::target(path)?) {
                Ok(Content::Of(FileKind::Library)) => self.kind(path, FileKind::Library),
                _ => self.file(path, FileKind::Library),
            },
            What::FittedLibrary if self.is_each => grown(path, is_of_a_fit),
            What::FittedLibrary => {
                self.file(path, FileKind::Library)?;
                self.file(&FitRecord::path_for(path), FileKind::Json)
            }
            What::Folder(command) => {
                let find = |folder: &Path| output_folder::earlier_of(folder, command);
                output_folder::check(path, &find).map(drop)
            }
            What::Pieces => {
                let find = |folder: &Path| output_folder::earlier_of(folder, freehand::COMMAND);
                let is_there = !output_folder::check(path, &find)?.is_empty();
                if is_there && !self.replaces {
                    let problem = "a result of segment is there already: name another folder, or give --overwrite";
                    return Err(Error::file(path, problem));
                }
                Ok(())
            }
            What::SimulatedSet => host_tools::rig::check(path),
            #[cfg(feature = "device")]
            What::GrowingSet => grown(path, |_| false),
            What::Parts => output_folder::check(path, &|_| Ok(Vec::new())).map(drop),
            #[cfg(feature = "device")]
            What::SelfTest if path.is_dir() => output_file::check_folder(path, path),
            #[cfg(feature = "device")]
            What::SelfTest => self.file(path, FileKind::Json),
        }
    }

    /// Checks a file that must be no input.
    fn file(&self, path: &Path, kind: FileKind) -> Result<()> {
        let target = atomic_file::target(path)?;
        if let Some(input) = Identity::of(&target).and_then(|found| self.inputs.name_of(&found)) {
            let also = if input == path {
                String::new()
            } else {
                format!(" (as {})", input.display())
            };
            let problem = format!("is an input of the command{also}: name another file to write");
            return Err(Error::file(path, problem));
        }
        self.kind(path, kind)
    }

    /// Checks a file's kind, and the folder that it is in.
    fn kind(&self, path: &Path, kind: FileKind) -> Result<()> {
        let remedy = if self.can_overwrite {
            ", or replace it by --overwrite"
        } else {
            ""
        };
        output_file::check(path, kind, self.replaces, remedy)
    }
}

/// Checks a folder that grows: it is new, empty, holds a list of trials, or nothing but what `is_own` knows by name.
fn grown(path: &Path, is_own: impl Fn(&str) -> bool) -> Result<()> {
    output_folder::check(path, &|_| Ok(Vec::new()))?;
    let Ok(entries) = std::fs::read_dir(path) else {
        return Ok(());
    };
    let names = entries.flatten().map(|entry| entry.file_name());
    let mut names: Vec<String> = names
        .map(|name| name.to_string_lossy().into_owned())
        .collect();
    names.sort();
    let is_list = |name: &String| name == host_tools::recording::TRIALS_FILE;
    let is_set = !is_own("any.lib") && names.iter().any(is_list);
    match names
        .iter()
        .find(|name| !name.starts_with('.') && !is_own(name))
    {
        Some(name) if !is_set => {
            let problem = format!(
                "the folder holds `{name}`, and results are not mixed with other files: name a new or empty folder"
            );
            Err(Error::file(path, problem))
        }
        _ => Ok(()),
    }
}

/// Returns true for the name of something that fit --each writes.
fn is_of_a_fit(name: &str) -> bool {
    let name = Path::new(name);
    let ends = |ending: &str| name.to_string_lossy().ends_with(ending);
    ends(".lib") || ends(".lib.fit.json") || name == Path::new("parts")
}
