//! Import circles between files: there is none, not even within a folder.
//!
//! A path counts for the file that defines its item: a module on the way, and a re-export in a file with modules of its
//! own, are no imports. A re-export counts where the same file's code uses the name.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use super::finding::Finding;
use super::imports::{Import, Kind};
use super::modules::{Crate, Definition, Module};
use super::source::Source;

/// The files that each file imports, with the line of the first import.
type Graph = BTreeMap<usize, BTreeMap<usize, usize>>;

/// Finds one of the shortest circles of each group of files that import each other.
pub fn check(sources: &[Source], crates: &[Crate]) -> Vec<Finding> {
    let graph = graph(crates);
    let reach: BTreeMap<usize, BTreeSet<usize>> = graph
        .keys()
        .map(|&file| (file, reached(&graph, file)))
        .collect();
    let mut findings = Vec::new();
    let mut told = BTreeSet::new();
    for (&file, reached) in &reach {
        if !reached.contains(&file) || told.contains(&file) {
            continue;
        }
        let is_in_group =
            |other: &&usize| reach.get(other).is_some_and(|back| back.contains(&file));
        let group: BTreeSet<usize> = reached.iter().filter(is_in_group).copied().collect();
        let circles = group.iter().filter_map(|&file| circle(&graph, file));
        if let Some(circle) = circles.min_by_key(Vec::len) {
            findings.push(finding(sources, &circle, group.len()));
        }
        told.extend(group);
    }
    findings
}

fn graph(crates: &[Crate]) -> Graph {
    let mut graph = Graph::new();
    for tree in crates {
        for (index, module) in tree.modules.iter().enumerate() {
            for import in &module.imports {
                let Some(to) = imported(tree, index, import) else {
                    continue;
                };
                if to != module.file {
                    let edges = graph.entry(module.file).or_default();
                    let line = edges.entry(to).or_insert(import.line);
                    *line = import.line.min(*line);
                }
            }
        }
    }
    graph
}

/// The file that `import` of the module `index` needs, if any.
fn imported(tree: &Crate, index: usize, import: &Import) -> Option<usize> {
    let module = &tree.modules[index];
    let is_alone = import.segments.len() == 1;
    let skipped = match import.kind {
        Kind::Reexport => is_facade(tree, module),
        Kind::Inline => is_alone && module.bound.contains(&import.segments[0]),
        Kind::Use | Kind::Glob => false,
    };
    if skipped {
        return None;
    }
    let path = tree.absolute(index, &import.segments)?;
    match tree.definition(&path)? {
        Definition::Item(of) => Some(tree.modules[of].file),
        Definition::Module(of) if import.kind == Kind::Glob => Some(tree.modules[of].file),
        // A module's name alone; paths through it count.
        Definition::Module(_) => None,
    }
}

/// True for a module with modules in files of their own.
fn is_facade(tree: &Crate, module: &Module) -> bool {
    let mut children = module.children.values();
    children.any(|&child| tree.modules[child].file != module.file)
}

/// All files that `from` imports, directly or not.
fn reached(graph: &Graph, from: usize) -> BTreeSet<usize> {
    let mut reached = BTreeSet::new();
    let mut left = vec![from];
    while let Some(file) = left.pop() {
        for &to in graph.get(&file).into_iter().flat_map(BTreeMap::keys) {
            if reached.insert(to) {
                left.push(to);
            }
        }
    }
    reached
}

/// A shortest way from `file` back to itself: each file with the line of its import of the next.
fn circle(graph: &Graph, file: usize) -> Option<Vec<(usize, usize)>> {
    let mut before: BTreeMap<usize, (usize, usize)> = BTreeMap::new();
    let mut left = VecDeque::from([file]);
    while let Some(at) = left.pop_front() {
        for (&to, &line) in graph.get(&at)? {
            if !before.contains_key(&to) && graph.contains_key(&to) {
                before.insert(to, (at, line));
                left.push_back(to);
            }
        }
        if before.contains_key(&file) {
            break;
        }
    }
    let mut way = Vec::new();
    let mut at = file;
    loop {
        let &(from, line) = before.get(&at)?;
        way.push((from, line));
        at = from;
        if at == file {
            way.reverse();
            return Some(way);
        }
    }
}

fn finding(sources: &[Source], circle: &[(usize, usize)], group: usize) -> Finding {
    let path = |file: usize| sources[file].path.as_str();
    let nexts = circle.iter().cycle().skip(1);
    let edges = circle
        .iter()
        .zip(nexts)
        .map(|(&(from, line), &(to, _))| format!("{}:{line} imports {}", path(from), path(to)));
    let edges: Vec<String> = edges.collect();
    let more = if group > circle.len() {
        format!(" (one of the circles among {group} files)")
    } else {
        String::new()
    };
    let (file, line) = circle[0];
    let problem = format!("import circle: {}{more}", edges.join(", "));
    Finding::new(path(file), line, problem)
}

#[cfg(test)]
mod tests {
    use super::super::modules::crates;
    use super::super::source::parse;
    use super::super::tree::Tree;
    use super::*;

    fn found(files: &[(&str, &str)]) -> Vec<String> {
        let (sources, findings) = parse(&Tree::of(files));
        assert!(findings.is_empty(), "{findings:?}");
        let findings = check(&sources, &crates(&sources));
        findings.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn a_circle_is_found_with_every_edge() {
        let found = found(&[
            ("x/src/lib.rs", "mod a; mod b; mod c; mod d;"),
            ("x/src/a.rs", "\nuse crate::b::f;"),
            ("x/src/b.rs", "pub fn f() { crate::c::f() }"),
            (
                "x/src/c.rs",
                "\n\npub fn f() { println!(\"{}\", super::a::X) }",
            ),
            ("x/src/d.rs", "use crate::a::Y;"),
        ]);
        let [finding] = &found[..] else {
            panic!("one circle: {found:?}");
        };
        for edge in [
            "x/src/a.rs:2 imports x/src/b.rs",
            "x/src/b.rs:1 imports x/src/c.rs",
            "x/src/c.rs:3 imports x/src/a.rs",
        ] {
            assert!(finding.contains(edge), "{edge} in {finding}");
        }
        assert!(!finding.contains("d.rs"), "{finding}");
    }

    #[test]
    fn a_folder_that_uses_a_child_that_uses_the_folder_is_a_circle() {
        let lib = ("x/src/lib.rs", "mod a;");
        let child = ("x/src/a/b.rs", "use super::Own; pub struct B;");
        for text in [
            "mod b; pub struct Own; fn f() -> b::B {}",
            "mod b; pub use b::B; pub struct Own; fn f() -> B {}",
            "mod b; pub struct Own; use b::B;",
        ] {
            let found = found(&[lib, ("x/src/a/mod.rs", text), child]);
            assert_eq!(found.len(), 1, "{text}: {found:?}");
        }
    }

    #[test]
    fn facades_tests_and_variables_make_no_circle() {
        let found = found(&[
            ("x/src/lib.rs", "mod a; pub use a::B;"),
            (
                "x/src/a/mod.rs",
                "mod b; mod c; pub use b::{B, run}; pub struct Own; fn f(run: u8) -> u8 { run } fn c() {}\n\
                 #[cfg(test)] mod tests { use super::b::B; }",
            ),
            (
                "x/src/a/b.rs",
                "use super::Own; use super::c; fn f() { c::g() } pub struct B; pub fn run() {}",
            ),
            (
                "x/src/a/c.rs",
                "use super::Own; pub fn g() {} impl Own { fn h(&self) -> u8 { self.0 } }\n\
                 #[cfg(test)] mod tests { use crate::a::b::B; }",
            ),
        ]);
        assert_eq!(found, [""; 0]);
    }

    #[test]
    fn a_circle_through_a_facade_is_found() {
        let found = found(&[
            ("x/src/lib.rs", "mod a; mod d;"),
            ("x/src/a/mod.rs", "mod b; pub use b::B;"),
            ("x/src/a/b.rs", "use crate::d::D; pub struct B;"),
            ("x/src/d.rs", "use crate::a::B; pub struct D;"),
        ]);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(!found[0].contains("mod.rs"), "{found:?}");
    }
}
