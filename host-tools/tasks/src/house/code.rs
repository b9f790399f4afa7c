//! The rule on imports: no circles between modules of a crate, except in tests.

use std::collections::{BTreeMap, BTreeSet};
use std::iter::Peekable;

use proc_macro2::{Delimiter, Ident, TokenStream, TokenTree, token_stream};

use super::Findings;
use super::tree::Tree;

/// The path of a module or an item. It begins with the crate's folder.
type Path = Vec<String>;

/// A path that code names outside tests, as a path within the crate.
struct Import<'a> {
    module: Path,
    file: &'a str,
    line: usize,
    target: Path,
    /// For a path in a `use`, the name that it gets in the module.
    name: Option<String>,
}

type Trees = Peekable<token_stream::IntoIter>;

/// Reads modules without their tests.
#[derive(Default)]
struct Reader<'a> {
    /// The module that is read, and its file.
    module: Path,
    file: &'a str,
    /// The modules that those read so far declare, and those of them whose braces are in the same file.
    declared: BTreeSet<Path>,
    inline: BTreeSet<Path>,
    imports: Vec<Import<'a>>,
}

impl Reader<'_> {
    /// Reads `stream`. Its paths are below the segments `before`, which are not empty for a group in a `use`.
    fn read(&mut self, stream: TokenStream, before: &[String], mut is_use: bool) {
        let (mut is_of_tests, mut last) = (false, String::new());
        let mut trees = stream.into_iter().peekable();
        while let Some(tree) = trees.next() {
            let previous = std::mem::take(&mut last);
            match tree {
                // An item of tests ends with its block or semicolon.
                TokenTree::Group(group) if is_of_tests => {
                    is_of_tests = group.delimiter() != Delimiter::Brace;
                }
                TokenTree::Punct(punct) if is_of_tests => is_of_tests = punct.as_char() != ';',
                _ if is_of_tests => {}
                TokenTree::Ident(word) => {
                    last = word.to_string();
                    if previous == "mod" {
                        self.read_module(&last, &mut trees);
                        continue;
                    }
                    match last.as_str() {
                        "use" => is_use = true,
                        _ => self.read_path(&word, &mut trees, before, is_use),
                    }
                }
                TokenTree::Group(group) => {
                    if group.delimiter() == Delimiter::Bracket {
                        let text = group.to_string();
                        // Also `all(test, unix)`, but not `not(test)`, which is of the product.
                        is_of_tests = text.starts_with("[cfg") && text.contains("test") && !text.contains("not");
                    }
                    self.read(group.stream(), &[], false);
                }
                TokenTree::Punct(punct) if punct.as_char() == ';' => is_use = false,
                TokenTree::Punct(_) | TokenTree::Literal(_) => {}
            }
        }
    }

    /// Notes the module `name`, and reads what is between its braces if `trees` continue with them.
    fn read_module(&mut self, name: &str, trees: &mut Trees) {
        self.module.push(name.to_owned());
        self.declared.insert(self.module.clone());
        if let Some(TokenTree::Group(group)) = trees.next_if(|next| matches!(next, TokenTree::Group(_))) {
            self.inline.insert(self.module.clone());
            self.read(group.stream(), &[], false);
        }
        self.module.pop();
    }

    /// Reads the path that begins with `first`, or the paths of a `use`, below the segments `before`.
    fn read_path(&mut self, first: &Ident, trees: &mut Trees, before: &[String], is_use: bool) {
        let mut segments = [before, &[first.to_string()]].concat();
        let is_colon = |tree: &TokenTree| tree.to_string() == ":";
        while trees.next_if(is_colon).is_some() && trees.next_if(is_colon).is_some() {
            match trees.next() {
                Some(TokenTree::Ident(word)) => segments.push(word.to_string()),
                Some(TokenTree::Group(group)) => {
                    return self.read(group.stream(), &segments, is_use);
                }
                _ => break,
            }
        }
        // `a::{self}` means `a`.
        if segments.len() > 1 && segments.last().is_some_and(|last| last == "self") {
            segments.pop();
        }
        let mut name = segments.last().cloned();
        if is_use && trees.next_if(|next| next.to_string() == "as").is_some() {
            name = trees.next().map(|name| name.to_string());
        }
        self.imports.push(Import {
            module: self.module.clone(),
            file: self.file,
            line: first.span().start().line,
            target: absolute(&self.module, &segments),
            name: name.filter(|_| is_use),
        });
    }
}

fn module_of(file: &str) -> Option<Path> {
    let (root, rest) = file.split_once("/src/")?;
    let parts = rest
        .strip_suffix(".rs")?
        .split('/')
        .filter(|part| !["mod", "lib", "main"].contains(part));
    Some([root].into_iter().chain(parts).map(str::to_owned).collect())
}

/// Returns the path within the crate that `segments` mean in `module`.
fn absolute(module: &[String], segments: &[String]) -> Path {
    let ups = segments.iter().take_while(|part| *part == "super").count();
    let (base, rest) = match segments[0].as_str() {
        "crate" => (&module[..1], &segments[1..]),
        "self" => (module, &segments[1..]),
        _ => {
            let depth = module.len().saturating_sub(ups).max(1);
            (&module[..depth], &segments[ups..])
        }
    };
    [base, rest].concat()
}

/// Imports of each module: the imported module, the file and the line.
type Arrows<'a> = BTreeMap<Path, Vec<(Path, &'a str, usize)>>;

/// Checks that the imports between modules form no circles.
pub fn check(tree: &Tree, findings: &mut Findings) {
    let mut reader = Reader::default();
    let mut modules = BTreeSet::new();
    for (file, text) in tree.texts_of(".rs") {
        if let (Some(module), Ok(stream)) = (module_of(file), text.parse()) {
            modules.insert(module.clone());
            (reader.module, reader.file) = (module, file);
            reader.read(stream, &[], false);
        }
    }
    let Reader {
        declared,
        inline,
        mut imports,
        ..
    } = reader;
    modules.extend(inline);
    // The others are of tests: the crate's root or a module above them declares them there alone.
    modules.retain(|module| (2..=module.len()).all(|depth| declared.contains(&module[..depth])));
    imports.retain(|import| modules.contains(&import.module));
    // The names that `use` declarations introduce in modules, and the paths to which they refer.
    let mut names: BTreeMap<Path, &Path> = BTreeMap::new();
    for import in &imports {
        if let Some(name) = &import.name {
            let name = [&*import.module, std::slice::from_ref(name)].concat();
            if name != import.target {
                names.insert(name, &import.target);
            }
        }
    }
    let mut arrows = Arrows::new();
    for import in &imports {
        let mut target = defined(import.target.clone(), &names);
        // The last segments may name items. What is left is their module.
        while !modules.contains(&target) && target.len() > 1 {
            target.pop();
        }
        // A module may use the modules below it. Names at the root may belong to another crate.
        if !target.starts_with(&import.module) && target.len() > 1 {
            let arrow = (target, import.file, import.line);
            arrows.entry(import.module.clone()).or_default().push(arrow);
        }
    }
    check_circles(arrows, findings);
}

/// Returns `target` with each name that a `use` introduced replaced by the path to which it refers.
fn defined(mut target: Path, names: &BTreeMap<Path, &Path>) -> Path {
    /// Bound on the number of replacements, larger than any real chain of names, so that names which refer to each
    /// other end.
    const MOST: usize = 20;
    for _ in 0..MOST {
        let mut lengths = 1..=target.len();
        let Some(length) = lengths.find(|length| names.contains_key(&target[..*length])) else {
            break;
        };
        target.splice(..length, names[&target[..length]].iter().cloned());
    }
    target
}

/// Reports the imports that are in circles or lead from one circle to another: those that remain when modules without
/// imports or without importers are removed until nothing changes.
fn check_circles(mut arrows: Arrows<'_>, findings: &mut Findings) {
    loop {
        let before = arrows.values().map(Vec::len).sum::<usize>();
        let importers: BTreeSet<Path> = arrows.keys().cloned().collect();
        let targets = arrows.values().flatten();
        let imported: BTreeSet<Path> = targets.map(|(to, ..)| to.clone()).collect();
        arrows.retain(|from, targets| {
            targets.retain(|(to, ..)| importers.contains(to));
            imported.contains(from) && !targets.is_empty()
        });
        if before == arrows.values().map(Vec::len).sum::<usize>() {
            break;
        }
    }
    for (to, file, line) in arrows.values().flatten() {
        let problem = format!("in a circle of imports: imports {}", to.join("::"));
        findings.find(file, *line, problem);
    }
}
