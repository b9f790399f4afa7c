//! Collects the boards of the package's folder, `NAME.board` each, and selects the one that `STYLUS_BOARD` names.

use std::{env, error::Error, fmt::Write, fs, path::Path};

/// The board of a build that names none.
const DEFAULT: &str = "nucleo-h743zi2";

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-env-changed=STYLUS_BOARD");
    let wanted = env::var("STYLUS_BOARD").unwrap_or_else(|_| DEFAULT.to_owned());
    let folder = env::var("CARGO_MANIFEST_DIR")?;
    println!("cargo::rerun-if-changed={folder}");
    let mut boards = Vec::new();
    for file in fs::read_dir(folder)? {
        let path = file?.path();
        if path.extension().is_some_and(|extension| extension == "board") {
            let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            // The default board is the first.
            boards.push((name != DEFAULT, name, fs::read_to_string(path)?));
        }
    }
    boards.sort();
    let mut text = "/// All boards.\npub const ALL: &[Board] = &[\n".to_owned();
    for (_, _, board) in &boards {
        write!(text, "board! {{\n{board}}},\n")?;
    }
    let selected = boards.iter().find(|(_, name, _)| *name == wanted);
    let (_, _, board) = selected.ok_or_else(|| {
        let names: Vec<_> = boards.iter().map(|(_, name, _)| name.as_str()).collect();
        format!(
            "STYLUS_BOARD, {wanted}: there is no such board; there are {}",
            names.join(", ")
        )
    })?;
    write!(
        text,
        "];\n/// The board of this build.\npub const BOARD: Board = board! {{\n{board}}};\npins! {{ $\n{board}}}\n"
    )?;
    fs::write(Path::new(&env::var("OUT_DIR")?).join("boards.rs"), text)?;
    Ok(())
}
