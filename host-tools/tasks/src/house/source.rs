//! Rust files, parsed once for all rules.

use proc_macro2::{TokenStream, TokenTree};

use super::finding::Finding;
use super::tree::Tree;

/// A parsed file.
pub struct Source {
    /// The path from the repository's root.
    pub path: String,
    /// Its tokens. Unlike [`Self::syntax`] they show what is inside macros.
    pub tokens: TokenStream,
    /// Its items.
    pub syntax: syn::File,
}

/// Parses all Rust files of `tree`, and finds those that cannot be parsed.
pub fn parse(tree: &Tree) -> (Vec<Source>, Vec<Finding>) {
    let (mut sources, mut findings) = (Vec::new(), Vec::new());
    for (path, text) in tree.texts().filter(|(path, _)| path.ends_with(".rs")) {
        match parsed(path, text) {
            Ok(source) => sources.push(source),
            Err(error) => {
                let line = error.span().start().line;
                findings.push(Finding::new(path, line, format!("no Rust: {error}")));
            }
        }
    }
    (sources, findings)
}

fn parsed(path: &str, text: &str) -> syn::Result<Source> {
    let tokens: TokenStream = text.parse()?;
    Ok(Source {
        path: path.to_owned(),
        syntax: syn::parse2(tokens.clone())?,
        tokens,
    })
}

/// Calls `take` with the tokens of `stream` and of every group inside, one slice for each group.
pub fn each_group(stream: &TokenStream, take: &mut impl FnMut(&[TokenTree])) {
    let tokens: Vec<TokenTree> = stream.clone().into_iter().collect();
    take(&tokens);
    for token in &tokens {
        if let TokenTree::Group(group) = token {
            each_group(&group.stream(), take);
        }
    }
}

/// True where `attributes` keep an item out of all builds but tests: `cfg(test)`, `cfg(all(test, ...))` and `test`.
pub fn is_test(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        let path = attribute.path();
        if path.is_ident("test") {
            return true;
        }
        let syn::Meta::List(list) = &attribute.meta else {
            return false;
        };
        let text = list.tokens.to_string().replace(' ', "");
        path.is_ident("cfg") && (text == "test" || text.starts_with("all(test,"))
    })
}

/// The attributes of `item`.
pub fn attributes(item: &syn::Item) -> &[syn::Attribute] {
    use syn::Item;
    match item {
        Item::Const(item) => &item.attrs,
        Item::Enum(item) => &item.attrs,
        Item::ExternCrate(item) => &item.attrs,
        Item::Fn(item) => &item.attrs,
        Item::ForeignMod(item) => &item.attrs,
        Item::Impl(item) => &item.attrs,
        Item::Macro(item) => &item.attrs,
        Item::Mod(item) => &item.attrs,
        Item::Static(item) => &item.attrs,
        Item::Struct(item) => &item.attrs,
        Item::Trait(item) => &item.attrs,
        Item::TraitAlias(item) => &item.attrs,
        Item::Type(item) => &item.attrs,
        Item::Union(item) => &item.attrs,
        Item::Use(item) => &item.attrs,
        _ => &[],
    }
}

/// The name that `item` defines, if any; a `use`, an `impl` and an `extern crate` define none.
pub fn name(item: &syn::Item) -> Option<&syn::Ident> {
    use syn::Item;
    match item {
        Item::Const(item) => Some(&item.ident),
        Item::Enum(item) => Some(&item.ident),
        Item::Fn(item) => Some(&item.sig.ident),
        Item::Macro(item) => item.ident.as_ref(),
        Item::Mod(item) => Some(&item.ident),
        Item::Static(item) => Some(&item.ident),
        Item::Struct(item) => Some(&item.ident),
        Item::Trait(item) => Some(&item.ident),
        Item::TraitAlias(item) => Some(&item.ident),
        Item::Type(item) => Some(&item.ident),
        Item::Union(item) => Some(&item.ident),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_is_no_rust_is_found() {
        let tree = Tree::of(&[("a.rs", "fn good() {}\n"), ("b.rs", "\nfn {}\n")]);
        let (sources, findings) = parse(&tree);
        assert_eq!(sources.len(), 1);
        assert_eq!((findings[0].path.as_str(), findings[0].line), ("b.rs", 2));
    }
}
