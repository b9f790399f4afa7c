//! The wings of the host's command: a wing may import those of lower floors, and no other.

use std::collections::BTreeSet;

use super::finding::Finding;
use super::modules::{Crate, Definition};
use super::source::Source;

/// The folder of the wings.
pub const FOLDER: &str = "host-tools/src";

/// The wings, floor by floor from the top.
pub const FLOORS: [&[&str]; 7] = [
    &["cli"],
    &["report"],
    &["evaluation"],
    &["fit"],
    &["texture", "scene", "link"],
    &["recording", "playing", "rig"],
    &["dsp", "support"],
];

/// The checked wings and the departures.
pub struct Checked {
    /// The names of all wings that have code.
    pub wings: BTreeSet<String>,
    /// The departures.
    pub findings: Vec<Finding>,
}

/// Checks every import of every wing against the floors.
pub fn check(sources: &[Source], crates: &[Crate]) -> Checked {
    let mut checked = Checked {
        wings: BTreeSet::new(),
        findings: Vec::new(),
    };
    for tree in crates {
        let root = &sources[tree.modules[0].file].path;
        if [FOLDER, "/lib.rs"].concat() == *root || [FOLDER, "/main.rs"].concat() == *root {
            checked.add(sources, tree);
        }
    }
    checked.findings.sort();
    checked.findings.dedup();
    checked
}

impl Checked {
    fn add(&mut self, sources: &[Source], tree: &Crate) {
        for (name, &module) in &tree.modules[0].children {
            if floor(name).is_none() {
                let path = &sources[tree.modules[module].file].path;
                let problem = format!(
                    "module '{name}' is in no wing: move it into one of {}",
                    all()
                );
                self.findings.push(Finding::new(path, 0, problem));
            }
        }
        for (index, module) in tree.modules.iter().enumerate() {
            let Some(wing) = module.path.first() else {
                continue;
            };
            let Some(own) = floor(wing) else {
                continue;
            };
            self.wings.insert(wing.clone());
            for import in &module.imports {
                let path = tree.absolute(index, &import.segments);
                let Some(target) = path.and_then(|path| target(tree, path)) else {
                    continue;
                };
                let other = &target[0];
                let way = match floor(other) {
                    _ if other == wing => continue,
                    Some(floor) if floor > own => continue,
                    Some(floor) if floor == own => "beside",
                    Some(_) => "above",
                    None => "outside",
                };
                let problem = format!(
                    "imports {}: {wing} may import nothing of {other}, which stands {way} it; below it are {}",
                    target.join("::"),
                    below(own),
                );
                let path = &sources[module.file].path;
                self.findings.push(Finding::new(path, import.line, problem));
            }
        }
    }
}

/// The path that an absolute path leads to past the root's own re-exports; `None` for the root and for what is outside.
fn target(tree: &Crate, path: Vec<String>) -> Option<Vec<String>> {
    if tree.modules[0].children.contains_key(path.first()?) {
        return Some(path);
    }
    match tree.definition(&path)? {
        Definition::Item(module) | Definition::Module(module) => {
            let found = tree.modules[module].path.iter().chain(path.last());
            Some(found.cloned().collect())
        }
    }
}

fn floor(wing: &str) -> Option<usize> {
    FLOORS.iter().position(|floor| floor.contains(&wing))
}

fn below(floor: usize) -> String {
    let names = FLOORS[floor + 1..].concat();
    if names.is_empty() {
        "none".to_owned()
    } else {
        names.join(", ")
    }
}

fn all() -> String {
    FLOORS.concat().join(", ")
}

#[cfg(test)]
mod tests {
    use super::super::modules::crates;
    use super::super::source::parse;
    use super::super::tree::Tree;
    use super::*;

    fn found(files: &[(&str, &str)]) -> Vec<String> {
        let (sources, _) = parse(&Tree::of(files));
        let checked = check(&sources, &crates(&sources));
        checked.findings.iter().map(ToString::to_string).collect()
    }

    const LIB: (&str, &str) = (
        "host-tools/src/lib.rs",
        "pub mod dsp; pub mod fit; pub mod link; pub mod scene; pub mod support;",
    );
    const DSP: (&str, &str) = ("host-tools/src/dsp.rs", "pub struct Model;");
    const FIT: (&str, &str) = (
        "host-tools/src/fit/mod.rs",
        "pub mod trial; use crate::{dsp::Model, scene::Scene};",
    );
    const SCENE: (&str, &str) = ("host-tools/src/scene.rs", "pub struct Scene;");

    #[test]
    fn an_import_of_a_lower_floor_is_as_drawn() {
        assert_eq!(found(&[LIB, DSP, FIT, SCENE]), [""; 0]);
    }

    #[test]
    fn an_import_of_a_higher_floor_is_found_with_both_wings_and_the_line() {
        let dsp = (
            "host-tools/src/dsp/mod.rs",
            "mod spectrum;\n#[cfg(test)] mod tests { use crate::fit; }",
        );
        let spectrum = (
            "host-tools/src/dsp/spectrum.rs",
            "\nfn f() { super::super::fit::trial::run() }",
        );
        let found = found(&[LIB, dsp, spectrum, FIT, SCENE]);
        let [finding] = &found[..] else {
            panic!("one: {found:?}");
        };
        assert_eq!(
            finding,
            "host-tools/src/dsp/spectrum.rs:2: imports fit::trial::run: dsp may import nothing of fit, \
             which stands above it; below it are none"
        );
    }

    #[test]
    fn an_import_of_the_same_floor_is_found_in_every_form() {
        for text in [
            "use crate::scene::Scene;",
            "pub use crate::scene::Scene;",
            "use crate::scene as other;",
            "use crate::scene::*;",
            "fn f() -> crate::scene::Scene {}",
            "fn f() { vec![crate::scene::Scene] }",
        ] {
            let link = ("host-tools/src/link.rs", text);
            let found = found(&[LIB, link, SCENE]);
            assert_eq!(found.len(), 1, "{text}: {found:?}");
            assert!(found[0].contains("link.rs:1: imports scene"), "{found:?}");
            assert!(found[0].contains("beside"), "{found:?}");
        }
    }

    #[test]
    fn a_wing_imports_nothing_of_the_crates_root() {
        let lib = ("host-tools/src/lib.rs", "pub mod dsp; pub struct Own;");
        let dsp = ("host-tools/src/dsp.rs", "use crate::Own;");
        let found = found(&[lib, dsp]);
        assert!(found[0].contains("dsp.rs:1: imports Own: dsp"), "{found:?}");
    }

    #[test]
    fn a_module_that_is_no_wing_is_found() {
        let lib = ("host-tools/src/lib.rs", "mod dsp; mod attic;");
        let attic = ("host-tools/src/attic.rs", "");
        let found = found(&[lib, DSP, attic]);
        assert!(
            found[0].starts_with("host-tools/src/attic.rs: module 'attic'"),
            "{found:?}"
        );
    }
}
