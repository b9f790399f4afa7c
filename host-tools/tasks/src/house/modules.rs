//! The module trees of all crates, and the resolution of a path to the file that defines its item.

use std::collections::{BTreeMap, BTreeSet};

use super::imports::{Import, Imports, leaves};
use super::source::{Source, attributes, is_test, name};
use super::tree::{folder, joined};

/// Re-exports of re-exports that are followed. More are taken for a circle of `use`.
const DEPTH: usize = 16;

/// A module, in a file of its own or inline.
pub struct Module {
    /// The path from the crate's root, without `crate`.
    pub path: Vec<String>,
    /// The index of its file among the sources.
    pub file: usize,
    /// The paths that its code names.
    pub imports: Vec<Import>,
    /// Names that its code binds to variables.
    pub bound: BTreeSet<String>,
    /// Modules in it.
    pub children: BTreeMap<String, usize>,
    parent: Option<usize>,
    items: BTreeSet<String>,
    uses: BTreeMap<String, Vec<String>>,
    globs: Vec<Vec<String>>,
}

/// A crate: a root file and all modules that it declares, tests excepted.
pub struct Crate {
    /// The modules; the root is the first.
    pub modules: Vec<Module>,
}

/// The place of an item's definition.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Definition {
    /// In a module, by its index.
    Item(usize),
    /// The path is that of a module itself.
    Module(usize),
}

/// All crates of `sources`: every file that no other declares as a module is a root.
pub fn crates(sources: &[Source]) -> Vec<Crate> {
    let files: BTreeMap<&str, usize> = (0..)
        .zip(sources)
        .map(|(index, source)| (source.path.as_str(), index))
        .collect();
    let mut declared = BTreeSet::new();
    for source in sources {
        each_declared(
            &source.syntax.items,
            &mut Vec::new(),
            &mut |module, inside| {
                declared.extend(file_of(&files, &source.path, module, inside));
            },
        );
    }
    let roots = (0..sources.len()).filter(|index| !declared.contains(index));
    roots
        .map(|root| {
            let mut tree = Crate {
                modules: Vec::new(),
            };
            tree.add(sources, &files, root, &sources[root].syntax.items, None, "");
            tree
        })
        .collect()
}

/// Calls `take` with each `mod name;` among `items`, and with the inline modules around it.
fn each_declared(
    items: &[syn::Item],
    inside: &mut Vec<String>,
    take: &mut impl FnMut(&syn::ItemMod, &[String]),
) {
    for item in items {
        let syn::Item::Mod(module) = item else {
            continue;
        };
        match &module.content {
            None => take(module, inside),
            Some((_, items)) => {
                inside.push(module.ident.to_string());
                each_declared(items, inside, take);
                inside.pop();
            }
        }
    }
}

/// The file of `mod name;` in the file `path`.
fn file_of(
    files: &BTreeMap<&str, usize>,
    path: &str,
    module: &syn::ItemMod,
    inside: &[String],
) -> Option<usize> {
    let here = folder(path);
    if let Some(given) = given_path(module) {
        return files.get(joined(here, &given)?.as_str()).copied();
    }
    let stem = path.trim_end_matches(".rs");
    let inside: String = inside.iter().map(|name| format!("{name}/")).collect();
    let name = &module.ident;
    // A file that is no `mod.rs` has its modules in a folder of its name, unless it is a crate's root.
    [stem, here].into_iter().find_map(|base| {
        let stem = joined(base, &format!("{inside}{name}"))?;
        let candidates = [format!("{stem}.rs"), format!("{stem}/mod.rs")];
        candidates
            .iter()
            .find_map(|file| files.get(file.as_str()).copied())
    })
}

/// The path that `#[path = "..."]` gives.
fn given_path(module: &syn::ItemMod) -> Option<String> {
    module.attrs.iter().find_map(|attribute| {
        let syn::Meta::NameValue(pair) = &attribute.meta else {
            return None;
        };
        let syn::Expr::Lit(literal) = &pair.value else {
            return None;
        };
        match &literal.lit {
            syn::Lit::Str(text) if pair.path.is_ident("path") => Some(text.value()),
            _ => None,
        }
    })
}

impl Crate {
    /// Adds the module of `items`, and those that it declares; `name` is empty for the root.
    fn add(
        &mut self,
        sources: &[Source],
        files: &BTreeMap<&str, usize>,
        file: usize,
        items: &[syn::Item],
        parent: Option<usize>,
        name: &str,
    ) -> usize {
        let index = self.modules.len();
        let mut path = parent.map_or(Vec::new(), |parent| self.modules[parent].path.clone());
        path.extend((!name.is_empty()).then(|| name.to_owned()));
        self.modules.push(Module::new(path, file, parent, items));
        for item in items {
            let syn::Item::Mod(module) = item else {
                continue;
            };
            if is_test(&module.attrs) {
                continue;
            }
            let name = module.ident.to_string();
            let child = match &module.content {
                Some((_, items)) => self.add(sources, files, file, items, Some(index), &name),
                None => {
                    let inside = self.inline_modules(index);
                    let path = &sources[file].path;
                    let Some(file) = file_of(files, path, module, &inside) else {
                        continue;
                    };
                    let items = &sources[file].syntax.items;
                    self.add(sources, files, file, items, Some(index), &name)
                }
            };
            self.modules[index].children.insert(name, child);
        }
        index
    }

    /// The names of the inline modules from a file's own module down to `module`.
    fn inline_modules(&self, mut module: usize) -> Vec<String> {
        let mut names = Vec::new();
        while let Some(parent) = self.modules[module].parent
            && self.modules[parent].file == self.modules[module].file
        {
            names.extend(self.modules[module].path.last().cloned());
            module = parent;
        }
        names.reverse();
        names
    }

    /// `segments`, as `module` writes them, from the crate's root; `None` for a path that leaves the crate.
    pub fn absolute(&self, module: usize, segments: &[String]) -> Option<Vec<String>> {
        self.absolute_within(module, segments, DEPTH)
    }

    fn absolute_within(
        &self,
        module: usize,
        segments: &[String],
        depth: usize,
    ) -> Option<Vec<String>> {
        let depth = depth.checked_sub(1)?;
        let here = &self.modules[module];
        let (first, rest) = segments.split_first()?;
        let after = |path: &[String], rest: &[String]| Some([path, rest].concat());
        match first.as_str() {
            "crate" => return Some(rest.to_vec()),
            "self" => return self.absolute_from(module, rest),
            "super" => return self.absolute_from(here.parent?, rest),
            _ => {}
        }
        if here.children.contains_key(first) && !rest.is_empty() || here.items.contains(first) {
            return after(&here.path, segments);
        }
        if let Some(path) = here.uses.get(first) {
            return self.absolute_within(module, &after(path, rest)?, depth);
        }
        if here.children.contains_key(first) {
            return after(&here.path, segments);
        }
        here.globs.iter().find_map(|glob| {
            let path = self.absolute_within(module, glob, depth)?;
            match self.definition_within(&path, depth)? {
                Definition::Module(of) if self.modules[of].has(first) => after(&path, segments),
                _ => None,
            }
        })
    }

    /// Takes further `super` of a path that began with `self` or `super`.
    fn absolute_from(&self, module: usize, segments: &[String]) -> Option<Vec<String>> {
        match segments.split_first() {
            Some((first, rest)) if first == "super" => {
                self.absolute_from(self.modules[module].parent?, rest)
            }
            _ => Some([&self.modules[module].path[..], segments].concat()),
        }
    }

    /// The module that defines what the absolute `path` leads to, past all re-exports; `None` outside the crate.
    pub fn definition(&self, path: &[String]) -> Option<Definition> {
        self.definition_within(path, DEPTH)
    }

    fn definition_within(&self, path: &[String], depth: usize) -> Option<Definition> {
        let depth = depth.checked_sub(1)?;
        let mut at = 0;
        for (place, name) in path.iter().enumerate() {
            let module = &self.modules[at];
            let rest = &path[place + 1..];
            let is_other = module.items.contains(name) || module.uses.contains_key(name);
            match module.children.get(name) {
                Some(&child) if !rest.is_empty() || !is_other => {
                    at = child;
                    continue;
                }
                _ => {}
            }
            if module.items.contains(name) {
                return Some(Definition::Item(at));
            }
            if let Some(used) = module.uses.get(name) {
                let path = self.absolute_within(at, &[used, rest].concat(), depth)?;
                return self.definition_within(&path, depth);
            }
            let globbed = module.globs.iter().find_map(|glob| {
                let path = self.absolute_within(at, glob, depth)?;
                match self.definition_within(&path, depth)? {
                    Definition::Module(of) if self.modules[of].has(name) => {
                        self.definition_within(&[&path, &path_from(name, rest)[..]].concat(), depth)
                    }
                    _ => None,
                }
            });
            // A macro may have made an unknown name.
            return globbed.or(Some(Definition::Item(at)));
        }
        Some(Definition::Module(at))
    }
}

fn path_from(first: &str, rest: &[String]) -> Vec<String> {
    [&[first.to_owned()], rest].concat()
}

impl Module {
    fn new(path: Vec<String>, file: usize, parent: Option<usize>, items: &[syn::Item]) -> Self {
        let imports = Imports::of(items);
        let mut module = Self {
            path,
            file,
            imports: imports.all,
            bound: imports.bound,
            children: BTreeMap::new(),
            parent,
            items: BTreeSet::new(),
            uses: BTreeMap::new(),
            globs: Vec::new(),
        };
        let items = items.iter().filter(|item| !is_test(attributes(item)));
        for item in items {
            match item {
                syn::Item::Mod(_) => {}
                syn::Item::Use(item) => {
                    for leaf in leaves(item) {
                        match leaf.name {
                            Some(name) => drop(module.uses.insert(name, leaf.segments)),
                            None => module.globs.push(leaf.segments),
                        }
                    }
                }
                item => module.items.extend(name(item).map(ToString::to_string)),
            }
        }
        module
    }

    fn has(&self, name: &str) -> bool {
        self.items.contains(name)
            || self.children.contains_key(name)
            || self.uses.contains_key(name)
    }
}

#[cfg(test)]
mod tests {
    use super::super::source::parse;
    use super::super::tree::Tree;
    use super::*;

    fn defining<'a>(sources: &'a [Source], tree: &Crate, from: &str, path: &str) -> &'a str {
        let from = tree.modules.iter().position(|m| m.path.join("::") == from);
        let segments: Vec<String> = path.split("::").map(str::to_owned).collect();
        let path = tree.absolute(from.unwrap(), &segments).unwrap();
        match tree.definition(&path).unwrap() {
            Definition::Item(module) | Definition::Module(module) => {
                &sources[tree.modules[module].file].path
            }
        }
    }

    #[test]
    fn a_path_is_followed_through_facades_to_the_file_of_its_item() {
        let tree = Tree::of(&[
            (
                "src/lib.rs",
                "mod a; mod b { pub mod inner; }\n#[cfg(test)] mod tests;",
            ),
            (
                "src/a/mod.rs",
                "mod play; pub mod other; pub use play::play; pub use other::*; struct Own;",
            ),
            ("src/a/play.rs", "pub fn play() {} pub struct Hidden;"),
            ("src/a/other.rs", "pub struct Other;"),
            (
                "src/b/inner.rs",
                "use crate::a as alias; use super::super::a::Own;",
            ),
            ("src/tests.rs", "use super::*;"),
        ]);
        let (sources, findings) = parse(&tree);
        assert!(findings.is_empty(), "{findings:?}");
        let crates = crates(&sources);
        let [tree] = &crates[..] else {
            panic!("one root, and the tests are a module");
        };
        for (from, path, file) in [
            ("b::inner", "crate::a::play", "src/a/play.rs"),
            ("b::inner", "alias::play::Hidden", "src/a/play.rs"),
            ("b::inner", "alias::Other", "src/a/other.rs"),
            ("b::inner", "Own", "src/a/mod.rs"),
            ("a", "play", "src/a/play.rs"),
            ("a::play", "super::Own::new", "src/a/mod.rs"),
            ("b", "self::inner", "src/b/inner.rs"),
        ] {
            assert_eq!(defining(&sources, tree, from, path), file, "{path}");
        }
        assert_eq!(tree.absolute(0, &["std".to_owned(), "fs".to_owned()]), None);
    }
}
