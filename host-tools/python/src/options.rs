//! Options of the command as keywords: names, rules, defaults and words come from the command's own description.
//!
//! A keyword is the identifier of an option, so it has its unit in its name, which a command line has in the help.

use std::error::Error as _;
use std::ffi::{CStr, CString, OsString};
use std::path::PathBuf;

use clap::error::{ContextKind, ContextValue};
use clap::{Arg, ArgAction, Args, Command};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyCFunction, PyDict, PyTuple};

use crate::convert::{Several, quoted};
use crate::error::refused;

/// The keyword that stands for the options in the signature of a function that `described` describes.
const OPTIONS: &str = "**options";

/// The description of the options `A` but those that are named in `without`.
fn description<A: Args>(without: &[&str]) -> Vec<Arg> {
    let mut command = A::augment_args(Command::new("options").disable_help_flag(true));
    command.build();
    let arguments = command.get_arguments().cloned();
    arguments
        .filter(|argument| !without.contains(&argument.get_id().as_str()))
        .collect()
}

/// The options `A` as `keywords` have them, without those of the command's that are named in `without`.
///
/// # Errors
/// An unknown keyword, a value of another type, or one that the command refuses, with its rule.
pub fn of_keywords<A: Args>(keywords: Option<&Bound<'_, PyDict>>, without: &[&str]) -> PyResult<A> {
    let known = description::<A>(without);
    let mut words = Vec::new();
    for (name, value) in keywords.into_iter().flatten() {
        let name: String = name.extract()?;
        let is_named = |argument: &&Arg| argument.get_id() == name.as_str();
        let Some(argument) = known.iter().find(is_named) else {
            let problem = format!("got an unexpected keyword argument '{name}'");
            return Err(PyTypeError::new_err(problem));
        };
        words.extend(written(argument, &value)?);
    }
    let command = Command::new("options").no_binary_name(true);
    let parsed = A::augment_args(command).try_get_matches_from(words);
    parsed
        .and_then(|matches| A::from_arg_matches(&matches))
        .map_err(|fault| refusal(&known, &fault))
}

/// `value` as a command line has it, in words of `argument`.
fn written(argument: &Arg, value: &Bound<'_, PyAny>) -> PyResult<Vec<OsString>> {
    let option = format!("--{}", argument.get_long().unwrap_or_default());
    let values = match argument.get_action() {
        _ if value.is_none() => Vec::new(),
        ArgAction::SetTrue if value.extract()? => return Ok(vec![option.into()]),
        ArgAction::SetTrue => Vec::new(),
        ArgAction::Append => value.extract::<Several<PathBuf>>()?.0,
        _ => vec![text(argument, value)?],
    };
    let word = |value: PathBuf| {
        let mut word = OsString::from(format!("{option}="));
        word.push(value);
        word
    };
    Ok(values.into_iter().map(word).collect())
}

/// `value`, a text, a path or a number, as the text that the command would be given.
fn text(argument: &Arg, value: &Bound<'_, PyAny>) -> PyResult<PathBuf> {
    let number = || {
        let whole = value.extract().map(|number: i64| number.to_string());
        whole.or_else(|_| value.extract().map(|number: f64| number.to_string()))
    };
    let text = value.extract().or_else(|_| number().map(PathBuf::from));
    text.map_err(|_: PyErr| {
        let problem = format!("argument '{}': give a text or a number", argument.get_id());
        PyTypeError::new_err(problem)
    })
}

/// The exception of a value that the command refuses: its keyword, the value, and the rule.
fn refusal(known: &[Arg], fault: &clap::Error) -> PyErr {
    let said = |kind| fault.get(kind).map(ToString::to_string).unwrap_or_default();
    let option = said(ContextKind::InvalidArg);
    let keyword = known.iter().find(|argument| argument.to_string() == option);
    let rule = match (fault.get(ContextKind::ValidValue), fault.source()) {
        (Some(ContextValue::Strings(choices)), _) => format!("must be {}", quoted(choices)),
        (_, Some(rule)) => rule.to_string(),
        _ => fault.kind().to_string(),
    };
    let it = if rule.starts_with("must") { "it " } else { "" };
    let value = said(ContextKind::InvalidValue);
    let name = keyword.map_or(option.as_str(), |argument| argument.get_id().as_str());
    refused(format!("{name} is '{value}': {it}{rule}"))
}

/// `function`, whose signature ends with `**options`, with the options `A` in its signature and its docstring.
///
/// # Errors
/// None for the functions of this package.
pub fn described<'py, A: Args>(
    function: Bound<'py, PyCFunction>,
    without: &[&str],
) -> PyResult<Bound<'py, PyCFunction>> {
    let attribute = |name: &str| function.getattr(name)?.extract::<String>();
    let (name, signature, doc) = (
        attribute("__name__")?,
        attribute("__text_signature__")?,
        attribute("__doc__")?,
    );
    let (mut keywords, mut words) = (Vec::new(), Vec::new());
    for argument in description::<A>(without) {
        let id = argument.get_id();
        keywords.push(format!("{id}={}", default(&argument)));
        let help = argument.get_help().map(ToString::to_string).unwrap_or_default();
        let choices: Vec<String> = (argument.get_possible_values().iter())
            .map(|choice| choice.get_name().to_owned())
            .collect();
        words.push(match argument.get_action() {
            ArgAction::SetTrue => format!("{id}: {help}"),
            _ if choices.is_empty() => format!("{id}: {help}"),
            _ => format!("{id}: {help}; {}", quoted(&choices)),
        });
    }
    let signature = signature.replace(OPTIONS, &keywords.join(", "));
    let doc = format!("{name}{signature}\n--\n\n{doc}\n\n{}", words.join("\n"));
    // As long as the interpreter, which asks for them as texts of the program.
    let lasting = |text: String| -> PyResult<&'static CStr> { Ok(Box::leak(CString::new(text)?.into_boxed_c_str())) };
    let plain = function.clone().unbind();
    let call = move |arguments: &Bound<'_, PyTuple>, keywords: Option<&Bound<'_, PyDict>>| {
        plain.call(arguments.py(), arguments, keywords)
    };
    PyCFunction::new_closure(function.py(), Some(lasting(name)?), Some(lasting(doc)?), call)
}

/// The default of `argument`, as Python writes it.
fn default(argument: &Arg) -> String {
    let text = |value: &clap::builder::OsStr| value.to_string_lossy().into_owned();
    match (argument.get_action(), argument.get_default_values().first().map(text)) {
        (ArgAction::SetTrue, _) => "False".into(),
        (ArgAction::Append, _) => "()".into(),
        (_, None) => "None".into(),
        (_, Some(number)) if number.parse::<f64>().is_ok() => number,
        (_, Some(text)) => format!("'{text}'"),
    }
}
