//! The packages that are built into the files of a release, as a list in the format CycloneDX 1.5.
//!
//! There is one list for all files, from `cargo metadata`, so no further tool is needed. It names no folder and no
//! time, so that the same commit gives the same bytes.

use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

use anyhow::{Result, bail};
use serde_json::{Value, json};

use crate::{process, workspace};

/// Packages from which the files of a release are built.
const ROOTS: [&str; 6] = [
    "host-tools",
    "stylus-browser",
    "stylus-image",
    "stylus-laboratory",
    "stylus-player-c",
    "stylus-python",
];

/// Returns the list as JSON.
pub fn list() -> Result<String> {
    let mut cargo = Command::new("cargo");
    cargo.args(["metadata", "--format-version", "1", "--locked", "--all-features"]);
    let metadata = process::output(cargo.current_dir(workspace::root()))?;
    let listed = of_metadata(&serde_json::from_str(&metadata)?)?;
    Ok(format!("{listed:#}\n"))
}

fn text<'a>(value: &'a Value, key: &str) -> &'a str {
    value[key].as_str().unwrap_or_default()
}

fn items<'a>(value: &'a Value, key: &str) -> impl Iterator<Item = &'a Value> {
    value[key].as_array().into_iter().flatten()
}

/// Returns the list for a workspace that cargo describes by `metadata`.
fn of_metadata(metadata: &Value) -> Result<Value> {
    let packages: BTreeMap<&str, &Value> = items(metadata, "packages")
        .map(|package| (text(package, "id"), package))
        .collect();
    let nodes: BTreeMap<&str, &Value> = items(&metadata["resolve"], "nodes")
        .map(|node| (text(node, "id"), node))
        .collect();
    let roots: Vec<&str> = packages
        .iter()
        .filter(|(_, package)| ROOTS.contains(&text(package, "name")))
        .map(|(id, _)| *id)
        .collect();
    if roots.len() != ROOTS.len() {
        bail!("the workspace lacks one of the packages {ROOTS:?}");
    }
    let found = reached(roots, &nodes);
    let mut components: Vec<Value> = found.iter().map(|id| component(packages[*id])).collect();
    let mut dependencies: Vec<Value> = found
        .iter()
        .map(|id| {
            let on = built_in(nodes[*id]).map(|on| reference(packages[on]));
            json!({ "ref": reference(packages[*id]), "dependsOn": on.collect::<BTreeSet<_>>() })
        })
        .collect();
    // cargo's names of packages, by which they are found, contain folders, so their order differs by machine.
    components.sort_by_key(|component| text(component, "bom-ref").to_owned());
    dependencies.sort_by_key(|dependency| text(dependency, "ref").to_owned());
    Ok(json!({
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": { "component": {
            "type": "application",
            "name": "stylus",
            "version": env!("CARGO_PKG_VERSION"),
        } },
        "components": components,
        "dependencies": dependencies,
    }))
}

/// Returns the packages in `next`, and all packages that are built into them.
fn reached<'a>(mut next: Vec<&'a str>, nodes: &BTreeMap<&str, &'a Value>) -> BTreeSet<&'a str> {
    let mut found = BTreeSet::new();
    while let Some(id) = next.pop() {
        if found.insert(id) {
            next.extend(built_in(nodes[id]));
        }
    }
    found
}

fn reference(package: &Value) -> String {
    format!("{}@{}", text(package, "name"), text(package, "version"))
}

/// Returns the entry of `package`.
fn component(package: &Value) -> Value {
    let mut component = json!({
        "type": "library",
        "bom-ref": reference(package),
        "name": package["name"],
        "version": package["version"],
        "licenses": [{ "expression": package["license"] }],
    });
    // The workspace's own packages are in no registry.
    if package["source"].is_string() {
        component["purl"] = format!("pkg:cargo/{}", reference(package)).into();
    }
    component
}

/// Returns the packages that are built into that of `node`. Dependencies of only its tests or its build are not.
fn built_in(node: &Value) -> impl Iterator<Item = &str> {
    items(node, "deps")
        // cargo's word for the kind of a normal dependency is null.
        .filter(|dependency| items(dependency, "dep_kinds").any(|kind| kind["kind"].is_null()))
        .map(|dependency| text(dependency, "pkg"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_list_has_what_is_built_in_and_not_what_tests_use() {
        let listed: Value = serde_json::from_str(&list().expect("cargo runs")).expect("JSON");
        let names: Vec<&str> = items(&listed, "components")
            .map(|component| text(component, "name"))
            .collect();
        for built_in in ["embassy-stm32", "host-tools", "pyo3", "rustfft", "stylus-kernel"] {
            assert!(names.contains(&built_in), "{built_in}");
        }
        for of_tests in ["fake-stylus", "proptest", "wasmi"] {
            assert!(!names.contains(&of_tests), "{of_tests}");
        }
        let licensed = items(&listed, "components").all(|component| component["licenses"][0]["expression"].is_string());
        assert!(licensed, "a package without a licence");
        let references: BTreeSet<&str> = items(&listed, "components")
            .map(|component| text(component, "bom-ref"))
            .collect();
        assert_eq!(references.len(), names.len(), "each is there once");
        let on = items(&listed, "dependencies").flat_map(|dependency| items(dependency, "dependsOn"));
        assert!(
            on.into_iter()
                .all(|on| references.contains(on.as_str().unwrap_or_default()))
        );
    }
}
