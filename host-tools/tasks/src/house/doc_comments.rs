//! Doc comments begin with a noun phrase or a verb, and not with a question word.

use proc_macro2::{Delimiter, TokenStream, TokenTree};

use super::finding::Finding;
use super::source::{Source, each_group};

/// Words that no doc comment begins with.
const QUESTIONS: [&str; 9] = [
    "How", "That", "What", "When", "Where", "Whether", "Which", "Who", "Why",
];

/// Folders whose doc comments are still to be written anew. An empty list is the aim.
const LEFT: [&str; 0] = [];

/// The number of doc comments and the departures.
pub struct Checked {
    /// The number of doc comments.
    pub count: usize,
    /// The departures.
    pub findings: Vec<Finding>,
}

/// Checks the first word of every doc comment.
pub fn check(sources: &[Source]) -> Checked {
    let mut checked = Checked {
        count: 0,
        findings: Vec::new(),
    };
    for source in sources {
        if LEFT.iter().any(|folder| source.path.starts_with(folder)) {
            continue;
        }
        for (line, text) in comments(&source.tokens) {
            checked.count += 1;
            let text = text.trim_start_matches(|first: char| !first.is_alphanumeric());
            let word = text.split(|next: char| !next.is_alphanumeric()).next();
            if let Some(word) = word.filter(|word| QUESTIONS.contains(word)) {
                let problem = format!(
                    "a doc comment begins with '{word}': begin with a noun phrase or a verb in the third person"
                );
                checked
                    .findings
                    .push(Finding::new(&source.path, line, problem));
            }
        }
    }
    checked
}

/// The line and the first words of every doc comment: lines that follow each other are one.
fn comments(tokens: &TokenStream) -> Vec<(usize, String)> {
    let mut comments = Vec::new();
    each_group(tokens, &mut |tokens| {
        let mut at = 0;
        let mut last = None;
        while at < tokens.len() {
            let Some((after, text)) = doc_at(tokens, at) else {
                at += 1;
                last = None;
                continue;
            };
            let line = tokens[at].span().start().line;
            // A blank first line belongs to what follows it.
            if last.is_none() {
                comments.push((line, text));
            } else if let Some((begin, first)) = comments.last_mut()
                && first.trim().is_empty()
            {
                (*begin, *first) = (line, text);
            }
            last = Some(line);
            at = after;
        }
    });
    comments
}

/// The doc comment's line at `at`, which is an attribute to the parser, and the place after it.
fn doc_at(tokens: &[TokenTree], at: usize) -> Option<(usize, String)> {
    let is_punct = |place: usize, char: char| match tokens.get(place) {
        Some(TokenTree::Punct(punct)) => punct.as_char() == char,
        _ => false,
    };
    if !is_punct(at, '#') {
        return None;
    }
    let group = at + 1 + usize::from(is_punct(at + 1, '!'));
    let Some(TokenTree::Group(attribute)) = tokens.get(group) else {
        return None;
    };
    if attribute.delimiter() != Delimiter::Bracket {
        return None;
    }
    let inside: Vec<TokenTree> = attribute.stream().into_iter().collect();
    match &inside[..] {
        [
            TokenTree::Ident(doc),
            TokenTree::Punct(_),
            TokenTree::Literal(text),
        ] if doc == "doc" => {
            let text = syn::parse_str::<syn::LitStr>(&text.to_string()).ok()?;
            Some((group + 1, text.value()))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::super::source::parse;
    use super::super::tree::Tree;
    use super::*;

    fn found(text: &str) -> Vec<String> {
        let (sources, findings) = parse(&Tree::of(&[("a.rs", text)]));
        assert!(findings.is_empty(), "{findings:?}");
        let findings = check(&sources).findings;
        findings.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn a_doc_comment_that_begins_with_a_question_word_is_found_with_its_line() {
        for (text, line) in [
            ("//! What it is.\n", 1),
            (
                "/// A word.\nfn f() {}\n/// Where it is.\n/// More.\nfn g() {}\n",
                3,
            ),
            (
                "struct S {\n    /// **Whether** it is.\n    a: bool,\n}\n",
                2,
            ),
            ("fn f() { m! {\n/// How\nstruct S; } }\n", 2),
            ("/** Why. */\nfn f() {}\n", 1),
            ("#[derive(Debug)]\n/// Who's first.\nstruct S;\n", 2),
        ] {
            let found = found(text);
            assert_eq!(found.len(), 1, "{text}: {found:?}");
            assert!(
                found[0].starts_with(&format!("a.rs:{line}: a doc comment begins with")),
                "{found:?}"
            );
        }
    }

    #[test]
    fn other_words_and_lines_within_a_comment_are_not() {
        let text = "/// Whatever comes.\n/// What follows.\n///\n/// How so.\nfn f() {\n    // What is this?\n}\n\
                    const TEXT: &str = \"/// What\";\n";
        assert_eq!(found(text), [""; 0]);
    }
}
