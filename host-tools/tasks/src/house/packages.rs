//! The floors between packages, by the dependencies of every `Cargo.toml`.

use std::collections::BTreeSet;

use super::finding::Finding;
use super::tree::Tree;

/// A package and the packages of this repository that it may depend on.
struct Package {
    name: &'static str,
    /// In its code.
    code: &'static [&'static str],
    /// In its tests and benches besides.
    tests: &'static [&'static str],
}

/// All packages: first the product from the ground up, then its tests and tasks.
const PACKAGES: [Package; 18] = [
    package("model-format", &[], &[]),
    package("stylus-kernel", &["model-format"], &[]),
    package(
        "stylus-app",
        &["model-format", "stylus-kernel"],
        &["fake-stylus"],
    ),
    package(
        "stylus-firmware",
        &["model-format", "stylus-app", "stylus-kernel", "stylus-realtime"],
        &[],
    ),
    package(
        "stylus-realtime",
        &["model-format", "stylus-app", "stylus-kernel"],
        &[],
    ),
    package(
        "stylus-browser",
        &["model-format", "stylus-kernel"],
        &["host-tools", "kernel-vectors"],
    ),
    package("stylus-costs", &[], &[]),
    package("virtual-link", &[], &[]),
    package(
        "host-tools",
        &[
            "model-format",
            "stylus-app",
            "stylus-costs",
            "stylus-kernel",
            "virtual-link",
        ],
        &["fake-stylus"],
    ),
    package(
        "stylus-python",
        &["host-tools", "model-format", "stylus-kernel"],
        &[],
    ),
    package(
        "fake-stylus",
        &["model-format", "stylus-app", "stylus-kernel"],
        &[],
    ),
    package(
        "hil",
        &[
            "host-tools",
            "kernel-vectors",
            "model-format",
            "stylus-costs",
        ],
        &["fake-stylus"],
    ),
    package("kernel-vectors", &["model-format", "stylus-kernel"], &[]),
    package(
        "qemu-tests",
        &["stylus-costs"],
        &[
            "host-tools",
            "kernel-vectors",
            "model-format",
            "stylus-kernel",
            "tasks",
        ],
    ),
    package(
        "tasks",
        &[
            "kernel-vectors",
            "model-format",
            "qemu-tests",
            "stylus-costs",
            "stylus-kernel",
        ],
        &[],
    ),
    package(
        "kernel-guest",
        &[
            "kernel-vectors",
            "model-format",
            "stylus-kernel",
            "stylus-realtime",
        ],
        &[],
    ),
    package(
        "fuzz",
        &["host-tools", "model-format", "stylus-kernel"],
        &[],
    ),
    package(
        "virtual-stylus",
        &["model-format", "virtual-link"],
        &[
            "host-tools",
            "kernel-vectors",
            "model-format",
            "stylus-app",
            "stylus-kernel",
        ],
    ),
    package(
        "probe-image",
        &[
            "kernel-vectors",
            "model-format",
            "stylus-kernel",
            "stylus-realtime",
        ],
        &[],
    ),
];

const fn package(
    name: &'static str,
    code: &'static [&'static str],
    tests: &'static [&'static str],
) -> Package {
    Package { name, code, tests }
}

/// The number of packages and the departures.
pub struct Checked {
    /// The number of packages.
    pub count: usize,
    /// The departures.
    pub findings: Vec<Finding>,
}

/// Checks the dependencies of all packages.
pub fn check(tree: &Tree) -> Checked {
    let mut findings = Vec::new();
    let mut manifests = Vec::new();
    for (path, text) in tree.texts() {
        if path != "Cargo.toml" && !path.ends_with("/Cargo.toml") {
            continue;
        }
        match text.parse::<toml::Table>() {
            Err(error) => findings.push(Finding::new(path, 0, error.to_string())),
            Ok(table) => {
                let name = table.get("package").and_then(|package| package.get("name"));
                if let Some(name) = name.and_then(toml::Value::as_str) {
                    manifests.push((path, text, name.to_owned(), table));
                }
            }
        }
    }
    let own: BTreeSet<&str> = manifests
        .iter()
        .map(|(_, _, name, _)| name.as_str())
        .collect();
    for (path, text, name, table) in &manifests {
        let Some(package) = PACKAGES.iter().find(|package| package.name == name) else {
            let problem = format!(
                "package '{name}' has no floor: add it to host-tools/tasks/src/house/packages.rs"
            );
            findings.push(Finding::new(path, 0, problem));
            continue;
        };
        for (key, is_test) in dependencies(table) {
            // A package may name itself, to have its own features in its tests.
            let is_allowed = key.package == *name
                || package.code.contains(&key.package.as_str())
                || is_test && package.tests.contains(&key.package.as_str());
            if own.contains(key.package.as_str()) && !is_allowed {
                let problem = format!(
                    "depends on {}: {name} may depend on nothing of this repository but {}",
                    key.package,
                    list(package, is_test)
                );
                findings.push(Finding::new(path, line_of(text, &key.name), problem));
            }
        }
    }
    Checked {
        count: manifests.len(),
        findings,
    }
}

/// A dependency: its key in the table, and the package.
struct Dependency {
    name: String,
    package: String,
}

/// All dependencies, and whether each is for tests only.
fn dependencies(table: &toml::Table) -> Vec<(Dependency, bool)> {
    let mut found = Vec::new();
    let targets = table.get("target").and_then(toml::Value::as_table);
    let targets = targets.into_iter().flat_map(toml::Table::values);
    let tables = targets.filter_map(toml::Value::as_table);
    for table in tables.chain([table]) {
        for (section, is_test) in [
            ("dependencies", false),
            ("build-dependencies", false),
            ("dev-dependencies", true),
        ] {
            let section = table.get(section).and_then(toml::Value::as_table);
            for (name, value) in section.into_iter().flatten() {
                let package = value.get("package").and_then(toml::Value::as_str);
                let dependency = Dependency {
                    name: name.clone(),
                    package: package.unwrap_or(name).to_owned(),
                };
                found.push((dependency, is_test));
            }
        }
    }
    found
}

fn list(package: &Package, is_test: bool) -> String {
    let tests = if is_test { package.tests } else { &[] };
    let names = [package.code, tests].concat();
    if names.is_empty() {
        "itself".to_owned()
    } else {
        names.join(", ")
    }
}

/// The line of a dependency, 0 if it is written in another form.
fn line_of(text: &str, dependency: &str) -> usize {
    let mut lines = text.lines();
    let at = lines.position(|line| {
        line.strip_prefix(dependency)
            .is_some_and(|rest| rest.trim_start().starts_with(['=', '.']))
    });
    at.map_or(0, |index| index + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(files: &[(&str, &str)]) -> Vec<String> {
        let findings = check(&Tree::of(files)).findings;
        findings.iter().map(ToString::to_string).collect()
    }

    const KERNEL: (&str, &str) = (
        "firmware/kernel/Cargo.toml",
        "[package]\nname = \"stylus-kernel\"\n[dependencies]\nlibm = \"1\"\n",
    );
    const APP: (&str, &str) = (
        "firmware/app/Cargo.toml",
        "[package]\nname = \"stylus-app\"\n[dependencies]\nstylus-kernel.workspace = true\n",
    );

    #[test]
    fn a_dependency_on_a_higher_floor_is_found_in_every_section() {
        assert_eq!(found(&[KERNEL, APP]), [""; 0]);
        for section in [
            "[dependencies]",
            "[dev-dependencies]",
            "[build-dependencies]",
            "[target.'cfg(unix)'.dependencies]",
        ] {
            for line in [
                "stylus-app = { path = \"x\" }",
                "other = { package = \"stylus-app\" }",
            ] {
                let text = format!("[package]\nname = \"stylus-kernel\"\n{section}\n{line}\n");
                let found = found(&[("firmware/kernel/Cargo.toml", &text), APP]);
                let expected =
                    "firmware/kernel/Cargo.toml:4: depends on stylus-app: stylus-kernel may depend";
                assert_eq!(found.len(), 1, "{found:?}");
                assert!(found[0].starts_with(expected), "{found:?}");
            }
        }
    }

    #[test]
    fn a_dependency_of_tests_is_none_of_the_code() {
        let host = |section: &str| {
            format!("[package]\nname = \"host-tools\"\n[{section}]\nfake-stylus = \"1\"\n")
        };
        let fake = ("b/Cargo.toml", "[package]\nname = \"fake-stylus\"\n");
        let [tests, code] = ["dev-dependencies", "dependencies"].map(host);
        assert_eq!(found(&[("a/Cargo.toml", &tests), fake]).len(), 0);
        assert_eq!(found(&[("a/Cargo.toml", &code), fake]).len(), 1);
    }

    #[test]
    fn a_package_without_a_floor_is_found() {
        let found = found(&[("a/Cargo.toml", "[package]\nname = \"attic\"\n")]);
        assert!(
            found[0].starts_with("a/Cargo.toml: package 'attic' has no floor"),
            "{found:?}"
        );
    }
}
