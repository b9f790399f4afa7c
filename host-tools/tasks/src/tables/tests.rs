//! Tests of blocks of pages, and of the pages themselves.

use super::page::Page;
use super::{check_instant, write};

const TEXT: &str = "# Page\n\n<!-- table: a, made by `cargo tasks tables a` -->\n| x |\n|---|\n| 1 |\n<!-- end -->\n\
                    between\n<!-- table: b, made by `cargo tasks tables b` -->\n<!-- end -->\nafter\n";

fn page_of(text: &str) -> (tempfile::TempDir, Page) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("page.md");
    std::fs::write(&path, text).unwrap();
    let page = Page::read(&path).unwrap();
    (folder, page)
}

#[test]
fn a_changed_figure_is_refused_with_page_table_row_and_command() {
    let (_folder, page) = page_of(TEXT);
    assert!(page.check("a", "| x |\n|---|\n| 1 |\n").is_ok());
    for (expected, row) in [
        ("| x |\n|---|\n| 2 |\n", "row 3"),
        ("| x |\n|---|\n", "row 3"),
        ("| x |\n|---|\n| 1 |\n| 2 |\n", "row 4"),
        ("", "row 1"),
    ] {
        let error = page.check("a", expected).unwrap_err().to_string();
        for part in ["page.md", "table 'a'", row, "`cargo tasks tables a`"] {
            assert!(error.contains(part), "{part}: {error}");
        }
    }
}

#[test]
fn writing_changes_one_block_alone_and_then_holds() {
    let (folder, mut page) = page_of(TEXT);
    assert!(page.write("b", "| y |\n").unwrap());
    assert!(!page.write("b", "| y |\n").unwrap());
    let again = Page::read(&folder.path().join("page.md")).unwrap();
    assert_eq!(again.block("b").unwrap(), "| y |\n");
    assert_eq!(again.block("a").unwrap(), page.block("a").unwrap());
    let text = std::fs::read_to_string(folder.path().join("page.md")).unwrap();
    assert_eq!(text.replace("| y |\n", ""), TEXT);
}

#[test]
fn a_block_that_is_missing_or_left_open_is_refused() {
    let left_open = TEXT.replacen("<!-- end -->\n", "", 1);
    for (text, name) in [(TEXT, "c"), (left_open.as_str(), "a")] {
        let (_folder, page) = page_of(text);
        let error = page.block(name).unwrap_err();
        assert!(error.to_string().contains("no table"), "{error}");
    }
}

#[test]
fn every_table_that_is_made_within_a_second_has_a_page_and_holds() {
    check_instant().unwrap_or_else(|error| panic!("{error}"));
}

#[test]
fn a_name_of_no_table_is_refused_with_those_that_there_are() {
    let error = write(&["nothing".to_owned()], |_| ()).unwrap_err().to_string();
    assert!(error.contains("nothing"), "{error}");
    assert!(error.contains("settings"), "{error}");
}
