//! Rules on manifests: the packages of this repository that each may depend on, and the workspace's lints.

use super::Outcome;
use super::tree::Tree;

/// A package per line, from the ground up: what its code may depend on and, after the bar, what its tests may besides.
const PACKAGES: &str = "
model-format:
stylus-kernel: model-format
stylus-app: model-format stylus-kernel | fake-stylus
stylus-realtime: model-format stylus-app stylus-kernel
stylus-firmware: model-format stylus-app stylus-kernel stylus-realtime
stylus-image: stylus-firmware
stylus-browser: model-format stylus-kernel | host-tools kernel-vectors
stylus-costs:
virtual-link:
host-tools: model-format stylus-app stylus-costs stylus-kernel virtual-link | fake-stylus
stylus-python: host-tools model-format stylus-kernel
fake-stylus: model-format stylus-app stylus-kernel
hil: host-tools kernel-vectors model-format | fake-stylus
kernel-vectors: model-format stylus-kernel
qemu-tests: | host-tools kernel-vectors model-format stylus-costs stylus-kernel tasks
tasks: kernel-vectors model-format qemu-tests stylus-costs stylus-kernel
kernel-guest: kernel-vectors model-format stylus-kernel stylus-realtime
fuzz: host-tools model-format stylus-kernel
virtual-stylus: model-format virtual-link | fake-stylus hil host-tools kernel-vectors stylus-app stylus-kernel
probe-image: kernel-vectors model-format stylus-kernel stylus-realtime
";

/// Packages with lints of their own: those that have unsafe code, and those of other workspaces.
const OWN_LINTS: [&str; 7] = [
    "stylus-realtime",
    "stylus-firmware",
    "stylus-browser",
    "kernel-guest",
    "fuzz",
    "virtual-stylus",
    "probe-image",
];

/// Checks every `Cargo.toml`.
pub fn check(tree: &Tree, outcome: &mut Outcome) {
    let mut count = 0;
    for (path, text) in tree.texts_of("toml") {
        let table = match text.parse::<toml::Table>() {
            Ok(table) if path.ends_with("Cargo.toml") => table,
            Ok(_) => continue,
            Err(error) => {
                outcome.find(path, 0, error.to_string());
                continue;
            }
        };
        let name = table.get("package").and_then(|package| package.get("name"));
        let Some(name) = name.and_then(toml::Value::as_str) else {
            continue;
        };
        count += 1;
        let Some((code, tests)) = allowed(name) else {
            let file = "host-tools/tasks/src/house/packages.rs";
            outcome.find(path, 0, format!("package '{name}' has no line in {file}"));
            continue;
        };
        for (package, is_test) in dependencies(&table) {
            // A package may name itself, to have its own features in its tests.
            let is_allowed =
                package == name || code.contains(&package) || is_test && tests.contains(&package);
            if allowed(package).is_some() && !is_allowed {
                outcome.find(
                    path,
                    0,
                    format!("depends on {package}, which is not below it"),
                );
            }
        }
        let lints = table.get("lints").and_then(|lints| lints.get("workspace"));
        if lints.is_none() && !OWN_LINTS.contains(&name) {
            outcome.find(
                path,
                0,
                "takes not the workspace's lints, which forbid unsafe code",
            );
        }
    }
    outcome.count("packages", count);
}

/// The packages that the code of `package` may depend on, and those that its tests may besides.
fn allowed(package: &str) -> Option<(Vec<&'static str>, Vec<&'static str>)> {
    let mut lines = PACKAGES.lines().filter_map(|line| line.split_once(':'));
    let (_, all) = lines.find(|(name, _)| *name == package)?;
    let (code, tests) = all.split_once('|').unwrap_or((all, ""));
    Some((
        code.split_whitespace().collect(),
        tests.split_whitespace().collect(),
    ))
}

/// The packages of all dependencies, and whether each is for tests only.
fn dependencies(table: &toml::Table) -> Vec<(&str, bool)> {
    let mut found = Vec::new();
    let targets = table.get("target").and_then(toml::Value::as_table);
    let targets = targets.into_iter().flat_map(toml::Table::values);
    for table in targets.filter_map(toml::Value::as_table).chain([table]) {
        for (section, is_test) in [
            ("dependencies", false),
            ("build-dependencies", false),
            ("dev-dependencies", true),
        ] {
            let section = table.get(section).and_then(toml::Value::as_table);
            for (name, value) in section.into_iter().flatten() {
                let package = value.get("package").and_then(toml::Value::as_str);
                found.push((package.unwrap_or(name), is_test));
            }
        }
    }
    found
}
