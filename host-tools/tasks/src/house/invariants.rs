//! Libraries and language features that have their place, by the imports of the code outside tests.

use proc_macro2::{TokenStream, TokenTree};

use super::finding::Finding;
use super::imports::{Import, Kind};
use super::modules::Crate;
use super::source::{Source, each_group};

/// A rule on imports.
struct Invariant {
    /// Folders and files under the rule.
    of: &'static [&'static str],
    /// Folders and files among them that are not.
    except: &'static [&'static str],
    /// The paths that they may not import.
    barred: &'static [&'static str],
    /// Completes "imports ...: ".
    reason: &'static str,
}

const HOST: &str = "host-tools/src/";

const INVARIANTS: [Invariant; 7] = [
    Invariant {
        of: &["host-tools/src/dsp/"],
        except: &[],
        barred: &[
            "std::fs",
            "std::io",
            "std::path",
            "clap",
            "indicatif",
            "csv",
            "hound",
        ],
        reason: "dsp computes, and knows no files and no command line",
    },
    Invariant {
        of: &[HOST],
        except: &["host-tools/src/cli/", "host-tools/src/main.rs"],
        barred: &["clap"],
        reason: "the command line is of cli alone",
    },
    Invariant {
        of: &[HOST],
        except: &["host-tools/src/cli/", "host-tools/src/support/progress.rs"],
        barred: &["indicatif"],
        reason: "progress bars are of support/progress.rs and cli",
    },
    Invariant {
        of: &[HOST],
        except: &["host-tools/src/cli/device/", "host-tools/src/link/"],
        barred: &["tokio", "tokio_serial", "nusb"],
        reason: "talking to a device is of link and cli/device",
    },
    Invariant {
        of: &[HOST],
        except: &["host-tools/src/report/"],
        barred: &["plotters"],
        reason: "pictures are of report",
    },
    Invariant {
        of: &["firmware/app/src/", "firmware/kernel/src/"],
        except: &[],
        barred: &["std", "alloc"],
        reason: "this code runs on the device, without an allocator and an operating system",
    },
    Invariant {
        of: &["model-format/src/"],
        except: &[],
        barred: &["std"],
        reason: "this code runs on the device, without an operating system",
    },
];

/// A path that an invariant bars and that one kind of declaration may name all the same.
struct Allowance {
    path: &'static str,
    files: &'static [&'static str],
}

/// Choices of the command line that are declared where they are made.
const ALLOWANCE: Allowance = Allowance {
    path: "clap::ValueEnum",
    files: &[
        "host-tools/src/dsp/reduction.rs",
        "host-tools/src/evaluation/leave_one_out/options.rs",
        "host-tools/src/evaluation/listening/plan.rs",
        "host-tools/src/evaluation/played.rs",
        "host-tools/src/fit/options.rs",
        "host-tools/src/texture/quantise.rs",
        "host-tools/src/texture/theta/choice.rs",
    ],
};

/// The places of `unsafe`. Each of these packages states the reason where it stands.
const UNSAFE: [&str; 7] = [
    "firmware/realtime/src/",
    "firmware/src/",
    "host-tools/browser/src/exports.rs",
    "host-tools/python/src/",
    "tests/qemu/guest/src/",
    "tests/virtual-stylus/probe-image/src/",
    "tests/virtual-stylus/src/core.rs",
];

/// Checks every invariant. An invariant, an exception and a place of `unsafe` that no file is under is a finding too.
pub fn check(sources: &[Source], crates: &[Crate]) -> Vec<Finding> {
    let mut findings = imported(sources, crates);
    for source in sources {
        if !is_in(&source.path, &UNSAFE) {
            let lines = unsafe_lines(&source.tokens).into_iter();
            findings.extend(lines.map(|line| {
                let problem = format!("unsafe code: it may stand only in {}", UNSAFE.join(", "));
                Finding::new(&source.path, line, problem)
            }));
        }
    }
    findings
}

/// Finds the places in the tables above that hold no file, and files of the allowance that do not need it.
pub fn check_places(sources: &[Source], crates: &[Crate]) -> Vec<Finding> {
    let of = INVARIANTS
        .iter()
        .flat_map(|invariant| [invariant.of, invariant.except].concat());
    let mut places: Vec<&str> = of
        .chain(UNSAFE)
        .chain(ALLOWANCE.files.iter().copied())
        .collect();
    places.sort_unstable();
    places.dedup();
    let mut findings = Vec::new();
    for place in places {
        if !sources.iter().any(|source| is_in(&source.path, &[place])) {
            let problem =
                "no Rust file is here, and host-tools/tasks/src/house/invariants.rs names it";
            findings.push(Finding::new(place, 0, problem));
        }
    }
    let modules = crates.iter().flat_map(|tree| &tree.modules);
    let is_allowed = |import: &Import| import.segments.join("::") == ALLOWANCE.path;
    let users = modules.filter(|module| module.imports.iter().any(is_allowed));
    let users: Vec<&str> = users
        .map(|module| sources[module.file].path.as_str())
        .collect();
    for file in ALLOWANCE.files {
        if !users.contains(file) {
            let problem = format!(
                "{} is allowed here and not used: leave the file out of host-tools/tasks/src/house/invariants.rs",
                ALLOWANCE.path
            );
            findings.push(Finding::new(file, 0, problem));
        }
    }
    findings
}

fn imported(sources: &[Source], crates: &[Crate]) -> Vec<Finding> {
    let mut findings = Vec::new();
    for tree in crates {
        for (index, module) in tree.modules.iter().enumerate() {
            let path = &sources[module.file].path;
            let invariants = INVARIANTS.iter();
            let invariants: Vec<&Invariant> = invariants
                .filter(|invariant| is_in(path, invariant.of) && !is_in(path, invariant.except))
                .collect();
            if invariants.is_empty() {
                continue;
            }
            for import in &module.imports {
                if is_local(tree, index, import) {
                    continue;
                }
                let import_path = import.segments.join("::");
                if import_path == ALLOWANCE.path && ALLOWANCE.files.contains(&path.as_str()) {
                    continue;
                }
                for invariant in &invariants {
                    let mut barred = invariant.barred.iter();
                    if barred.any(|barred| is_below(&import_path, barred)) {
                        let problem = format!("imports {import_path}: {}", invariant.reason);
                        findings.push(Finding::new(path, import.line, problem));
                    }
                }
            }
        }
    }
    findings.sort();
    findings.dedup();
    findings
}

/// True for a path within the crate, and for a word alone in code, which is a variable.
fn is_local(tree: &Crate, module: usize, import: &Import) -> bool {
    import.kind == Kind::Inline && import.segments.len() == 1
        || tree.absolute(module, &import.segments).is_some()
}

fn is_below(path: &str, barred: &str) -> bool {
    path.strip_prefix(barred)
        .is_some_and(|rest| rest.is_empty() || rest.starts_with("::"))
}

fn is_in(path: &str, places: &[&str]) -> bool {
    places.iter().any(|place| match place.strip_suffix('/') {
        Some(_) => path.starts_with(place),
        None => path == *place,
    })
}

fn unsafe_lines(tokens: &TokenStream) -> Vec<usize> {
    let mut lines = Vec::new();
    each_group(tokens, &mut |tokens| {
        for token in tokens {
            if matches!(token, TokenTree::Ident(ident) if ident == "unsafe") {
                lines.push(token.span().start().line);
            }
        }
    });
    lines
}

#[cfg(test)]
mod tests {
    use super::super::modules::crates;
    use super::super::source::parse;
    use super::super::tree::Tree;
    use super::*;

    fn found(path: &str, text: &str) -> Vec<String> {
        let (sources, findings) = parse(&Tree::of(&[(path, text)]));
        assert!(findings.is_empty(), "{findings:?}");
        let findings = check(&sources, &crates(&sources));
        findings.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn a_library_out_of_its_place_is_found_with_its_line() {
        for (path, text, import) in [
            ("host-tools/src/dsp/a.rs", "\nuse std::fs;", "std::fs"),
            (
                "host-tools/src/dsp/a.rs",
                "\nfn f(x: std::path::PathBuf) {}",
                "std::path::PathBuf",
            ),
            (
                "host-tools/src/dsp/a.rs",
                "\nuse {rand::Rng, hound::WavReader};",
                "hound::WavReader",
            ),
            (
                "host-tools/src/fit/a.rs",
                "\n#[derive(clap::Args)] struct A;",
                "clap::Args",
            ),
            (
                "host-tools/src/fit/a.rs",
                "\n#[derive(clap::ValueEnum)] enum A {}",
                "clap::ValueEnum",
            ),
            (
                "host-tools/src/fit/a.rs",
                "\nuse indicatif::ProgressBar;",
                "indicatif::ProgressBar",
            ),
            (
                "host-tools/src/cli/fit.rs",
                "\nasync fn f() { tokio::spawn(x) }",
                "tokio::spawn",
            ),
            ("host-tools/src/scene/a.rs", "\nuse nusb;", "nusb"),
            (
                "host-tools/src/cli/plot.rs",
                "\nuse plotters::prelude::*;",
                "plotters::prelude",
            ),
            ("firmware/kernel/src/a.rs", "\nextern crate alloc;", "alloc"),
            (
                "firmware/app/src/a.rs",
                "\nfn f() { std::mem::swap(a, b) }",
                "std::mem::swap",
            ),
            (
                "model-format/src/a.rs",
                "\nuse std::vec::Vec;",
                "std::vec::Vec",
            ),
        ] {
            let found = found(path, text);
            assert!(!found.is_empty(), "{text}");
            let expected = format!("{path}:2: imports {import}: ");
            assert!(
                found.iter().all(|line| line.starts_with(&expected)),
                "{found:?}"
            );
        }
    }

    #[test]
    fn a_library_in_its_place_and_a_module_or_variable_of_its_name_is_not() {
        for (path, text) in [
            (
                "host-tools/src/cli/fit.rs",
                "#[derive(clap::Args)] struct A;",
            ),
            (
                "host-tools/src/link/usb.rs",
                "use nusb::Device; use tokio::time;",
            ),
            ("host-tools/src/report/plot.rs", "use plotters::prelude::*;"),
            (ALLOWANCE.files[0], "#[derive(clap::ValueEnum)] enum A {}"),
            (
                "host-tools/src/dsp/a.rs",
                "mod csv { pub fn f() {} } fn g(hound: u8) -> u8 { csv::f(); hound }",
            ),
            (
                "host-tools/src/dsp/a.rs",
                "#[cfg(test)] mod tests { use std::fs; }",
            ),
            (
                "firmware/kernel/src/a.rs",
                "use core::mem; fn f() { assert!(true, \"std::\"); }",
            ),
        ] {
            assert_eq!(found(path, text), [""; 0], "{text}");
        }
    }

    #[test]
    fn unsafe_code_out_of_its_place_is_found_with_its_line() {
        let text = "fn f() {\n    m!(unsafe { x })\n}\n";
        let found_in = found("firmware/kernel/src/a.rs", text);
        assert_eq!(found_in.len(), 1, "{found_in:?}");
        assert!(
            found_in[0].starts_with("firmware/kernel/src/a.rs:2: unsafe code"),
            "{found_in:?}"
        );
        assert_eq!(found("firmware/src/a.rs", text), [""; 0]);
    }

    #[test]
    fn a_place_without_a_file_and_an_allowance_without_need_are_found() {
        let used = (ALLOWANCE.files[0], "#[derive(clap::ValueEnum)] enum A {}");
        let unused = (ALLOWANCE.files[1], "enum A {}");
        let (sources, _) = parse(&Tree::of(&[("firmware/src/a.rs", ""), used, unused]));
        let findings = check_places(&sources, &crates(&sources));
        let is_named = |place: &str| findings.iter().any(|finding| finding.path == place);
        assert!(is_named("firmware/kernel/src/") && is_named("tests/virtual-stylus/src/core.rs"));
        assert!(!is_named("firmware/src/"), "{findings:?}");
        assert!(!is_named(used.0) && is_named(unused.0), "{findings:?}");
    }
}
