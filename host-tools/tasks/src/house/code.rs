//! The tokens of Rust files outside tests, and the rule on their imports: no circles between modules of a crate.

use std::collections::{BTreeMap, BTreeSet};

use proc_macro2::{TokenStream, TokenTree};

use super::Outcome;
use super::tree::Tree;

/// A Rust file: its tokens outside tests, groups opened and closed by tokens of their own.
pub struct Source {
    pub path: String,
    tokens: Vec<(String, usize)>,
}

/// A path that code names, with its line.
struct Import {
    segments: Vec<String>,
    line: usize,
    /// The name that it has in the module, of a path in a `use`.
    name: Option<String>,
}

impl Source {
    /// True where an item of this name is defined. Of `A::b`, `b` counts, which may be a variant.
    pub fn defines(&self, name: &str) -> bool {
        const KEYWORDS: [&str; 9] = [
            "fn",
            "struct",
            "enum",
            "trait",
            "const",
            "static",
            "type",
            "mod",
            "macro_rules",
        ];
        let last = name.rsplit("::").next().unwrap_or(name);
        let mut pairs = self.tokens.windows(2);
        pairs.any(|pair| {
            pair[1].0 == last && (name != last || KEYWORDS.contains(&pair[0].0.as_str()))
        })
    }

    /// True where the module `name` is declared.
    fn declares(&self, name: &str) -> bool {
        let mut pairs = self.tokens.windows(2);
        pairs.any(|pair| pair[0].0 == "mod" && pair[1].0 == name)
    }

    /// The paths of two segments or more, those of a `use` one by one.
    fn imports(&self) -> Vec<Import> {
        let mut imports = Vec::new();
        let mut at = 0;
        while at < self.tokens.len() {
            let begin = at;
            if is_word(self.text(at)) && self.text(at + 1) == "::" {
                let first = imports.len();
                at = self.take(at, &[], &mut imports);
                if begin == 0 || self.text(begin - 1) != "use" {
                    imports[first..]
                        .iter_mut()
                        .for_each(|path| path.name = None);
                }
            }
            at = at.max(begin + 1);
        }
        imports
    }

    fn text(&self, at: usize) -> &str {
        self.tokens.get(at).map_or("", |(text, _)| text)
    }

    /// Reads the path or the tree of paths at token `at`, below the segments `before`, into `imports`. Returns the
    /// place after it.
    fn take(&self, mut at: usize, before: &[String], imports: &mut Vec<Import>) -> usize {
        let mut segments = before.to_vec();
        let line = self.tokens[at].1;
        while is_word(self.text(at)) {
            // `a::{self}` is `a`.
            if self.text(at) != "self" || segments.is_empty() {
                segments.push(self.text(at).to_owned());
            }
            at += 1;
            if self.text(at) != "::" {
                break;
            }
            at += 1;
            if self.text(at) == "{" {
                at += 1;
                while at < self.tokens.len() && self.text(at) != "}" {
                    at = self.take(at, &segments, imports).max(at + 1);
                }
                return at + 1;
            }
        }
        // Not the cast to a path.
        let name = if self.text(at) == "as" && self.text(at + 2) != "::" {
            at += 2;
            Some(self.text(at - 1).to_owned())
        } else {
            segments.last().cloned()
        };
        imports.push(Import {
            segments,
            line,
            name,
        });
        at
    }
}

fn is_word(text: &str) -> bool {
    text.starts_with(|first: char| first.is_alphabetic() || first == '_')
}

/// Reads all Rust files of `tree`.
pub fn read(tree: &Tree, outcome: &mut Outcome) -> Vec<Source> {
    let mut sources = Vec::new();
    for (path, text) in tree.texts_of("rs") {
        match text.parse::<TokenStream>() {
            Ok(stream) => {
                let mut tokens = Vec::new();
                flatten(stream, &mut tokens);
                let path = path.to_owned();
                sources.push(Source { path, tokens });
            }
            Err(error) => outcome.find(path, error.span().start().line, error.to_string()),
        }
    }
    outcome.count("Rust files", sources.len());
    sources
}

fn flatten(stream: TokenStream, tokens: &mut Vec<(String, usize)>) {
    let mut is_of_tests = false;
    let mut trees = stream.into_iter().peekable();
    while let Some(tree) = trees.next() {
        let line = tree.span().start().line;
        if is_of_tests {
            // The item goes up to its block or semicolon.
            let text = tree.to_string();
            is_of_tests = text != ";" && !text.starts_with('{');
            continue;
        }
        match tree {
            TokenTree::Group(group) => {
                let text = group.to_string();
                let is_cfg = text.starts_with("[cfg (") || text.starts_with("[cfg(");
                is_of_tests = is_cfg && text.contains("test") && !text.contains("not");
                let (open, close) = (&text[..1], &text[text.len() - 1..]);
                tokens.push((open.to_owned(), line));
                flatten(group.stream(), tokens);
                tokens.push((close.to_owned(), group.span_close().start().line));
            }
            TokenTree::Punct(punct) if punct.as_char() == ':' => {
                let next = trees.next_if(|next| next.to_string() == ":");
                tokens.push((if next.is_some() { "::" } else { ":" }.to_owned(), line));
            }
            tree => tokens.push((tree.to_string(), line)),
        }
    }
}

/// A module of a crate by its path, the crate's folder first.
type Module = Vec<String>;

fn module_of(path: &str) -> Option<Module> {
    let (root, rest) = path.split_once("/src/")?;
    let rest = rest.strip_suffix(".rs")?;
    let rest = rest.strip_suffix("mod").unwrap_or(rest);
    let parts = rest
        .split('/')
        .filter(|part| !["", "lib", "main"].contains(part));
    let root = [format!("{root}/src")].into_iter();
    Some(root.chain(parts.map(str::to_owned)).collect())
}

/// Checks that imports have no circles.
pub fn check(sources: &[Source], outcome: &mut Outcome) {
    let modules = modules(sources);
    let known = |module: &[String]| modules.contains_key(module);
    // Names that a module re-exports from its own modules.
    let mut names: BTreeMap<Module, Module> = BTreeMap::new();
    for (module, (_, imports)) in &modules {
        for import in imports {
            let start = usize::from(import.segments[0] == "self");
            let target = [module.as_slice(), &import.segments[start..]].concat();
            if target.len() > module.len() + 1 && known(&target[..=module.len()]) {
                let name = target.last().cloned();
                names.insert(module.iter().cloned().chain(name).collect(), target);
            }
        }
    }
    let mut arrows = Arrows::new();
    for (module, (source, imports)) in &modules {
        let used = used(module, imports);
        for import in imports {
            let (first, rest) = import.segments.split_at(1);
            let by_use = || Some([used.get(first[0].as_str())?, rest].concat());
            let Some(target) = absolute(module, &import.segments).or_else(by_use) else {
                continue;
            };
            let mut target = defined(target, &names);
            while !known(&target) && target.len() > 1 {
                target.pop();
            }
            // What the root names may be of another crate.
            if target != *module && target.len() > 1 {
                let arrow = (target, source.path.as_str(), import.line);
                arrows.entry(module.clone()).or_default().push(arrow);
            }
        }
    }
    outcome.count("modules", modules.len());
    check_circles(arrows, outcome);
}

/// All modules outside tests, with their imports: each is declared by the one around it, if that is there.
fn modules(sources: &[Source]) -> BTreeMap<Module, (&Source, Vec<Import>)> {
    let mut modules: BTreeMap<Module, (&Source, Vec<Import>)> = BTreeMap::new();
    let mut found: Vec<(Module, &Source)> = sources
        .iter()
        .filter_map(|source| Some((module_of(&source.path)?, source)))
        .collect();
    // Each comes after the one around it.
    found.sort_by_key(|(module, _)| module.clone());
    for (module, source) in &found {
        let (name, around) = module.split_last().unwrap_or((&module[0], &[]));
        let mut arounds = found.iter().filter(|(other, _)| other == around).peekable();
        let is_top = arounds.peek().is_none();
        let is_declared = arounds.any(|(_, source)| source.declares(name));
        if is_top || modules.contains_key(around) && is_declared {
            let entry = modules.entry(module.clone());
            entry.or_insert_with(|| (*source, source.imports()));
        }
    }
    modules
}

/// Imports of each module: the imported one, the file and the line.
type Arrows<'a> = BTreeMap<Module, Vec<(Module, &'a str, usize)>>;

/// The module or item that `segments` name within the crate of `module`; `None` for what is outside of it.
fn absolute(module: &[String], segments: &[String]) -> Option<Module> {
    let ups = segments.iter().take_while(|part| *part == "super").count();
    let base = match segments[0].as_str() {
        "crate" => &module[..1],
        "self" => module,
        "super" => &module[..module.len().checked_sub(ups)?.max(1)],
        _ => return None,
    };
    Some([base, &segments[ups.max(1)..]].concat())
}

/// The names that `use` gives other parts of the crate in `module`.
fn used<'a>(module: &[String], imports: &'a [Import]) -> BTreeMap<&'a str, Module> {
    let named = imports.iter().filter_map(|import| {
        let name = import.name.as_deref()?;
        Some((name, absolute(module, &import.segments)?))
    });
    named.collect()
}

/// `target` with each part that a module re-exports under the path of its definition.
fn defined(mut target: Module, names: &BTreeMap<Module, Module>) -> Module {
    let mut length = 1;
    while length <= target.len() {
        if let Some(definition) = names.get(&target[..length]) {
            target.splice(..length, definition.iter().cloned());
            // A definition is below its re-export, so this ends.
            length = definition.len();
        } else {
            length += 1;
        }
    }
    target
}

/// Reports the imports that are in circles: those that stay when modules without imports or without importers are
/// removed until nothing changes.
fn check_circles(mut arrows: Arrows<'_>, outcome: &mut Outcome) {
    loop {
        let before = arrows.values().map(Vec::len).sum::<usize>();
        let importers: BTreeSet<Module> = arrows.keys().cloned().collect();
        let targets = arrows.values().flatten();
        let imported: BTreeSet<Module> = targets.map(|(to, ..)| to.clone()).collect();
        arrows.retain(|from, targets| {
            targets.retain(|(to, ..)| importers.contains(to));
            imported.contains(from) && !targets.is_empty()
        });
        if before == arrows.values().map(Vec::len).sum::<usize>() {
            break;
        }
    }
    for (to, path, line) in arrows.values().flatten() {
        let problem = format!("in a circle of imports: imports {}", to.join("::"));
        outcome.find(path, *line, problem);
    }
}
