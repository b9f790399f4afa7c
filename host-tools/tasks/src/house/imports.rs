//! The paths that a module's code names, outside tests.

use std::collections::BTreeSet;

use proc_macro2::{TokenStream, TokenTree};
use syn::visit::{self, Visit};

use super::source::{attributes, each_group, is_test};

/// The form of an import.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// `use a::B;`
    Use,
    /// `use a::*;`
    Glob,
    /// `pub use a::B;` and `pub use a::*;`, at any visibility.
    Reexport,
    /// A path in code, a macro or an attribute.
    Inline,
}

/// A path that code names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Import {
    /// The path as written, from its first segment.
    pub segments: Vec<String>,
    /// The line, from 1.
    pub line: usize,
    /// Its form.
    pub kind: Kind,
}

/// A `use` of one name.
pub struct Leaf {
    /// The path.
    pub segments: Vec<String>,
    /// The name that it has here; `None` for a glob.
    pub name: Option<String>,
    /// The line, from 1.
    pub line: usize,
}

/// The names that `item` imports, one by one.
pub fn leaves(item: &syn::ItemUse) -> Vec<Leaf> {
    let mut leaves = Vec::new();
    flatten(&item.tree, &mut Vec::new(), &mut leaves);
    leaves
}

fn flatten(tree: &syn::UseTree, before: &mut Vec<String>, leaves: &mut Vec<Leaf>) {
    use syn::UseTree;
    let mut leaf = |ident: &syn::Ident, name: &syn::Ident| {
        let mut segments = before.clone();
        // `a::{self}` is `a`.
        if ident != "self" || before.is_empty() {
            segments.push(ident.to_string());
        }
        let name = if name == "self" {
            segments.last().cloned()
        } else {
            Some(name.to_string())
        };
        leaves.push(Leaf {
            segments,
            name,
            line: ident.span().start().line,
        });
    };
    match tree {
        UseTree::Name(name) => leaf(&name.ident, &name.ident),
        UseTree::Rename(rename) => leaf(&rename.ident, &rename.rename),
        UseTree::Glob(glob) => leaves.push(Leaf {
            segments: before.clone(),
            name: None,
            line: glob.star_token.spans[0].start().line,
        }),
        UseTree::Path(path) => {
            before.push(path.ident.to_string());
            flatten(&path.tree, before, leaves);
            before.pop();
        }
        UseTree::Group(group) => {
            for tree in &group.items {
                flatten(tree, before, leaves);
            }
        }
    }
}

/// The imports of a module, without those of its inline modules, and the names that its code binds.
#[derive(Default)]
pub struct Imports {
    /// The imports, in the order of the code.
    pub all: Vec<Import>,
    /// Names of variables and parameters. A path of one segment with such a name is taken for the variable.
    pub bound: BTreeSet<String>,
}

impl Imports {
    /// The imports of `items`.
    pub fn of(items: &[syn::Item]) -> Self {
        let mut imports = Self::default();
        for item in items {
            imports.visit_item(item);
        }
        imports
    }

    fn push(&mut self, segments: Vec<String>, line: usize, kind: Kind) {
        self.all.push(Import {
            segments,
            line,
            kind,
        });
    }
}

impl<'ast> Visit<'ast> for Imports {
    fn visit_item(&mut self, item: &'ast syn::Item) {
        if !is_test(attributes(item)) && !matches!(item, syn::Item::Mod(_)) {
            visit::visit_item(self, item);
        }
    }

    fn visit_impl_item_fn(&mut self, function: &'ast syn::ImplItemFn) {
        if !is_test(&function.attrs) {
            visit::visit_impl_item_fn(self, function);
        }
    }

    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        let is_private = matches!(item.vis, syn::Visibility::Inherited);
        for leaf in leaves(item) {
            let kind = match (is_private, &leaf.name) {
                (false, _) => Kind::Reexport,
                (true, None) => Kind::Glob,
                (true, Some(_)) => Kind::Use,
            };
            self.push(leaf.segments, leaf.line, kind);
        }
    }

    fn visit_item_extern_crate(&mut self, item: &'ast syn::ItemExternCrate) {
        let line = item.ident.span().start().line;
        self.push(vec![item.ident.to_string()], line, Kind::Use);
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        let idents = path.segments.iter().map(|segment| &segment.ident);
        let line = path.segments.first().map(|first| first.ident.span());
        // `self` alone is a value.
        if let Some(span) = line
            && !path.is_ident("self")
        {
            let segments = idents.map(ToString::to_string).collect();
            self.push(segments, span.start().line, Kind::Inline);
        }
        visit::visit_path(self, path);
    }

    fn visit_pat_ident(&mut self, pattern: &'ast syn::PatIdent) {
        self.bound.insert(pattern.ident.to_string());
        visit::visit_pat_ident(self, pattern);
    }

    /// `pub(crate)` imports nothing.
    fn visit_visibility(&mut self, _: &'ast syn::Visibility) {}

    /// Macros and attributes: paths by their tokens. A lower-case word alone is no path there.
    fn visit_token_stream(&mut self, stream: &'ast TokenStream) {
        each_group(stream, &mut |tokens| {
            let mut at = 0;
            while at < tokens.len() {
                let (segments, after) = path_at(tokens, at);
                let is_path = segments.len() > 1
                    || segments
                        .first()
                        .is_some_and(|word| word.starts_with(char::is_uppercase));
                if is_path {
                    let line = tokens[at].span().start().line;
                    self.push(segments, line, Kind::Inline);
                }
                at = after.max(at + 1);
            }
        });
    }
}

/// The path that begins at `at`, empty if none does, and the place after it.
fn path_at(tokens: &[TokenTree], mut at: usize) -> (Vec<String>, usize) {
    let mut segments = Vec::new();
    while let Some(TokenTree::Ident(ident)) = tokens.get(at) {
        segments.push(ident.to_string());
        at += 1;
        let is_colon = |place: usize| match tokens.get(place) {
            Some(TokenTree::Punct(punct)) => punct.as_char() == ':',
            _ => false,
        };
        let is_ident = matches!(tokens.get(at + 2), Some(TokenTree::Ident(_)));
        if !(is_colon(at) && is_colon(at + 1) && is_ident) {
            break;
        }
        at += 2;
    }
    (segments, at)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn imported(text: &str) -> Vec<(String, usize, Kind)> {
        let file = syn::parse_file(text).unwrap();
        let import = |import: &Import| (import.segments.join("::"), import.line, import.kind);
        Imports::of(&file.items).all.iter().map(import).collect()
    }

    #[test]
    fn every_form_of_an_import_is_seen() {
        let text = "use crate::a::{self, B as C, d::*};\n\
                    pub(crate) use super::e::F;\n\
                    fn f(x: g::H) {\n\
                    assert!(crate::i::j(x));\n\
                    }\n\
                    #[derive(k::L)]\n\
                    struct M;\n";
        let expected = [
            ("crate::a", 1, Kind::Use),
            ("crate::a::B", 1, Kind::Use),
            ("crate::a::d", 1, Kind::Glob),
            ("super::e::F", 2, Kind::Reexport),
            ("g::H", 3, Kind::Inline),
            ("crate::i::j", 4, Kind::Inline),
            ("k::L", 6, Kind::Inline),
        ];
        let found = imported(text);
        for (path, line, kind) in expected {
            let expected = (path.to_owned(), line, kind);
            assert!(found.contains(&expected), "{expected:?} in {found:?}");
        }
    }

    #[test]
    fn code_of_tests_imports_nothing() {
        let text = "#[cfg(test)]\nmod tests { use crate::a; }\n\
                    #[cfg(all(test, unix))]\nuse crate::b;\n\
                    struct S;\n\
                    impl S { #[cfg(test)] fn f() { crate::c::d(); } }\n";
        let found = imported(text);
        let is_local = |path: &str| path.starts_with("crate");
        assert!(!found.iter().any(|(path, ..)| is_local(path)), "{found:?}");
    }
}
