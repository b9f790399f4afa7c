//! All arguments of all commands that take a path, so that none writes past the rule.

use std::any::TypeId;
use std::collections::BTreeSet;
use std::path::PathBuf;

use clap::CommandFactory;

use super::Destination;
use crate::cli::Arguments;

/// Arguments that are read and never written, by command and name. A new path argument is either a [`Destination`] or
/// belongs here.
const INPUTS: &[&str] = &[
    "certify library",
    "compare inputs",
    "compare library",
    "compare score",
    "compare takes",
    "evaluate inputs",
    "evaluate library",
    "evaluate takes",
    "fit inputs",
    "fit-tap recordings",
    "frontier before",
    "frontier data",
    "frontier redraw",
    "frontier takes",
    "import-hatt paths",
    "inspect library",
    "page input",
    "page recordings",
    "record trials",
    "render library",
    "render motion",
    "report inputs",
    "report library",
    "report takes",
    "resample library",
    "scene check file",
    "scene check library",
    "scene compile library",
    "scene compile scenes",
    "scene plot file",
    "scene plot library",
    "scene plot motion",
    "scene render file",
    "scene render library",
    "scene render motion",
    "segment files",
    "simulate-rig rig",
    "upload library",
];

/// Arguments that are written.
const OUTPUTS: &[&str] = &[
    "certify picture",
    "compare out",
    "demo out",
    "evaluate json",
    "evaluate report",
    "fit out",
    "fit parts",
    "frontier out",
    "import-hatt out",
    "man out",
    "page data",
    "page out",
    "record folder",
    "record-strokes file",
    "render out",
    "report data",
    "report out",
    "resample out",
    "scene compile out",
    "scene plot out",
    "scene render out",
    "segment out",
    "selftest record",
    "simulate-rig out",
];

/// Names of all arguments of this type, each after its command's.
fn arguments_of(wanted: TypeId) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    let mut commands = vec![(String::new(), Arguments::command())];
    while let Some((name, command)) = commands.pop() {
        for argument in command.get_arguments() {
            if argument.get_value_parser().type_id() == wanted {
                found.insert(format!("{name}{}", argument.get_id()));
            }
        }
        for inner in command.get_subcommands() {
            commands.push((format!("{name}{} ", inner.get_name()), inner.clone()));
        }
    }
    found
}

fn listed(names: &[&str]) -> BTreeSet<String> {
    names.iter().map(ToString::to_string).collect()
}

#[cfg(all(feature = "device", feature = "hatt"))]
#[test]
fn every_path_of_every_command_is_an_input_or_goes_through_the_rule() {
    let paths = arguments_of(TypeId::of::<PathBuf>());
    let inputs: BTreeSet<String> = listed(INPUTS);
    let unknown: Vec<&String> = paths.difference(&inputs).collect();
    assert!(
        unknown.is_empty(),
        "inputs, or outputs past the rule? {unknown:?}"
    );
    assert_eq!(arguments_of(TypeId::of::<Destination>()), listed(OUTPUTS));
}

/// A path as plain text would be seen by no rule.
#[test]
fn no_text_argument_is_called_a_file_to_write() {
    let mut commands = vec![Arguments::command()];
    while let Some(command) = commands.pop() {
        for argument in command.get_arguments() {
            let help = argument
                .get_help()
                .map(ToString::to_string)
                .unwrap_or_default();
            let writes = ["to write", "Folder for", "file for"]
                .iter()
                .any(|word| help.contains(word));
            let is_output = argument.get_value_parser().type_id() == TypeId::of::<Destination>();
            let is_flag = !argument.get_action().takes_values();
            assert!(
                !writes || is_output || is_flag,
                "{} {}: {help}",
                command.get_name(),
                argument.get_id()
            );
        }
        commands.extend(command.get_subcommands().cloned());
    }
}
