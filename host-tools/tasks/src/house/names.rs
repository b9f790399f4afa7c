//! Items that pages name, with the file they are in, are there: [`name`](path) and `name` in `path`.

use std::collections::BTreeSet;

use syn::visit::{self, Visit};

use super::finding::Finding;
use super::pages::{Piece, Placed, pieces};
use super::source::{self, Source};
use super::tree::{Tree, folder, joined};

/// The number of names and the departures.
pub struct Checked {
    /// The number of names.
    pub count: usize,
    /// The departures.
    pub findings: Vec<Finding>,
}

/// Checks every named item that comes with a Rust file. A file that does not exist is the finding of another rule.
pub fn check(tree: &Tree, sources: &[Source]) -> Checked {
    let mut checked = Checked {
        count: 0,
        findings: Vec::new(),
    };
    for (page, text) in tree.texts().filter(|(path, _)| path.ends_with(".md")) {
        for (name, path, line) in named(&pieces(text)) {
            let paths = [joined(folder(page), &path), joined("", &path)];
            let mut files = paths.iter().flatten();
            let file = files.find_map(|path| sources.iter().find(|source| source.path == *path));
            let Some(file) = file else {
                continue;
            };
            checked.count += 1;
            if !is_in(file, &name) {
                let problem = format!("'{name}' is not in {}", file.path);
                checked.findings.push(Finding::new(page, line, problem));
            }
        }
    }
    checked
}

/// The names with the path and the line of each.
fn named(pieces: &[Placed]) -> Vec<(String, String, usize)> {
    let mut found = Vec::new();
    for (index, placed) in pieces.iter().enumerate() {
        let (name, path) = match &placed.piece {
            Piece::Link { text, target } => {
                let code = text
                    .strip_prefix('`')
                    .and_then(|text| text.strip_suffix('`'));
                let target = target.split('#').next().unwrap_or_default();
                (code.map(str::to_owned), target.to_owned())
            }
            Piece::Code(path) => {
                let is_in = placed.before.split_whitespace().eq(["in"]);
                let before = index.checked_sub(1).map(|before| &pieces[before].piece);
                let name = match before {
                    Some(Piece::Code(name)) if is_in => Some(name.clone()),
                    _ => None,
                };
                (name, path.clone())
            }
        };
        if let Some(name) = name.as_deref().and_then(identifier)
            && path.ends_with(".rs")
        {
            found.push((name, path, placed.line));
        }
    }
    found
}

/// `text` as a path of identifiers, without `()` and `!`; `None` for anything else.
fn identifier(text: &str) -> Option<String> {
    let text = text.trim_end_matches("()").trim_end_matches('!');
    let is_identifier = |part: &str| {
        part.starts_with(|first: char| first.is_alphabetic() || first == '_')
            && part
                .chars()
                .all(|char| char.is_alphanumeric() || char == '_')
    };
    text.split("::").all(is_identifier).then(|| text.to_owned())
}

/// True where `file` has an item of that name. Of a path, the last two parts count; the first may be a module on the
/// way.
fn is_in(file: &Source, name: &str) -> bool {
    let mut items = Items::default();
    items.visit_file(&file.syntax);
    let mut parts = name.rsplit("::");
    let (last, owner) = (parts.next().unwrap_or_default(), parts.next());
    match owner {
        None => items.names.contains(last),
        Some(owner) => {
            let stem = file.path.trim_end_matches(".rs");
            let is_module = stem.split('/').any(|part| part == owner);
            items.owned.contains(&(owner.to_owned(), last.to_owned()))
                || is_module && items.names.contains(last)
        }
    }
}

/// The names of all items, variants and methods of a file, and those of them that belong to a type or an inline module.
#[derive(Default)]
struct Items {
    names: BTreeSet<String>,
    owned: BTreeSet<(String, String)>,
    owner: Option<String>,
}

impl Items {
    fn add(&mut self, name: &syn::Ident) {
        let name = name.to_string();
        if let Some(owner) = &self.owner {
            self.owned.insert((owner.clone(), name.clone()));
        }
        self.names.insert(name);
    }
}

impl<'ast> Visit<'ast> for Items {
    fn visit_item(&mut self, item: &'ast syn::Item) {
        let name = source::name(item);
        if let Some(name) = name {
            self.add(name);
        }
        let owner = match item {
            syn::Item::Impl(block) => match &*block.self_ty {
                syn::Type::Path(of) => of.path.segments.last().map(|last| &last.ident),
                _ => None,
            },
            syn::Item::Trait(_) | syn::Item::Enum(_) | syn::Item::Mod(_) => name,
            _ => None,
        };
        let before = std::mem::replace(&mut self.owner, owner.map(ToString::to_string));
        visit::visit_item(self, item);
        self.owner = before;
    }

    fn visit_impl_item(&mut self, item: &'ast syn::ImplItem) {
        match item {
            syn::ImplItem::Const(item) => self.add(&item.ident),
            syn::ImplItem::Fn(item) => self.add(&item.sig.ident),
            syn::ImplItem::Type(item) => self.add(&item.ident),
            _ => {}
        }
    }

    fn visit_trait_item(&mut self, item: &'ast syn::TraitItem) {
        match item {
            syn::TraitItem::Const(item) => self.add(&item.ident),
            syn::TraitItem::Fn(item) => self.add(&item.sig.ident),
            syn::TraitItem::Type(item) => self.add(&item.ident),
            _ => {}
        }
    }

    fn visit_variant(&mut self, variant: &'ast syn::Variant) {
        self.add(&variant.ident);
    }
}

#[cfg(test)]
mod tests {
    use super::super::source::parse;
    use super::*;

    const CODE: (&str, &str) = (
        "firmware/src/tick.rs",
        "pub fn begin() {} pub struct Tick; impl Tick { pub fn run(&self) { fn hidden() {} } const N: u8 = 1; }\n\
         enum Kind { Idle } trait Port { fn send(); } mod inner { pub fn deep() {} } macro_rules! say { () => {} }\n",
    );

    fn found(page: &str, text: &str) -> Vec<String> {
        let tree = Tree::of(&[(page, text), CODE]);
        let (sources, _) = parse(&tree);
        let findings = check(&tree, &sources).findings;
        findings.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn a_name_that_its_file_does_not_have_is_found_with_its_line() {
        for name in [
            "attic",
            "attic()",
            "Tick::attic",
            "Kind::run",
            "Tick::begin",
            "Port::run",
        ] {
            let text = format!("First.\n\n[`{name}`](firmware/src/tick.rs)\n");
            let found = found("ARCHITECTURE.md", &text);
            let bare = name.trim_end_matches("()");
            let expected = format!("ARCHITECTURE.md:3: '{bare}' is not in firmware/src/tick.rs");
            assert_eq!(found, [expected]);
        }
        assert_eq!(
            found("README.md", "The `attic` in `firmware/src/tick.rs`.").len(),
            1
        );
        assert_eq!(
            found("firmware/README.md", "[`attic`](src/tick.rs#L3)").len(),
            1
        );
    }

    #[test]
    fn names_of_items_methods_variants_and_modules_are_not() {
        for name in [
            "begin",
            "begin()",
            "Tick",
            "Tick::run",
            "run()",
            "Tick::N",
            "Kind::Idle",
            "Port::send",
            "deep",
            "inner::deep",
            "tick::begin",
            "say!",
            "not an identifier",
            "cargo-run",
        ] {
            let text =
                format!("[`{name}`](firmware/src/tick.rs), `{name}` in `firmware/src/tick.rs`");
            assert_eq!(found("ARCHITECTURE.md", &text), [""; 0], "{name}");
        }
        assert_eq!(
            found("README.md", "The `attic` of `firmware/src/tick.rs`."),
            [""; 0]
        );
    }
}
