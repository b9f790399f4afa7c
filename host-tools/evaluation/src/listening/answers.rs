//! Answers of a listening test as a page saves them, and their score.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Serialize;
use stylus_dsp::binomial::clopper_pearson;
use stylus_support::bounded_file::Format;
use stylus_support::csv_table::{CsvTable, Header, Row};
use stylus_support::{Error, Result};

/// Proportion of right answers by chance.
pub const CHANCE: f64 = 0.5;

/// Confidence of intervals.
pub const CONFIDENCE: f64 = 0.95;

/// Longest text of a field, bytes: many times what a page saves.
const LONGEST_TEXT: usize = 256;

/// Largest number of pairs of kinds: many times as many as there are.
const MOST_PAIRS: usize = 64;

/// Form of a column.
#[derive(Clone, Copy)]
enum Form {
    Text,
    Count,
    Number,
}

/// A field of a row.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Field {
    /// A count.
    Count(u32),
    /// A number.
    Number(f64),
    /// Any text.
    Text(String),
}

/// A row of a file of answers.
#[derive(Clone, Debug, PartialEq)]
struct Answered {
    /// Fields of the design's columns.
    own: Vec<(&'static str, Field)>,
    /// Fields of further columns, with their names.
    further: Vec<(String, Field)>,
}

/// The answers of one file.
#[derive(Clone, Debug)]
pub struct Answers {
    path: PathBuf,
    rows: Vec<Answered>,
}

/// The score of a pair, or of all.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Score {
    /// The pair; `all` for all.
    pub pair: String,
    /// Number of files with answers about the pair.
    pub files: usize,
    /// Number of answered trials.
    pub trials: u32,
    /// Number of right answers.
    pub correct: u32,
    /// Proportion of right answers.
    pub proportion: f64,
    /// The exact interval of the proportion at [`CONFIDENCE`].
    pub interval: (f64, f64),
    /// Proportion by chance.
    pub chance: f64,
    /// True if the interval lies above chance.
    pub is_told_apart: bool,
    /// True if any recording of these trials is simulated.
    pub simulated: bool,
}

impl Answers {
    /// Reads a file that a page has saved. Rows with an empty design, such as those of other trials of an experiment,
    /// are left out.
    ///
    /// # Errors
    /// A file that cannot be read or has no answers; or a row that is invalid or contradicts itself.
    fn read(path: &Path, seen: &mut BTreeMap<(String, String, u32), PathBuf>) -> Result<Self> {
        let table = CsvTable::read(path, Format::Answers).map_err(|failure| not_saved(path, failure))?;
        let header = table.header()?;
        let design = header.column("design")?;
        let mut rows: Vec<Answered> = Vec::new();
        let mut lines = table.rows_below_header()?;
        while let Some(line) = lines.next_row().map_err(|failure| not_saved(path, failure))? {
            // Earlier pages asked about A, B and X only, and named no design.
            let design = design.map_or("abx", |column| line.text(column));
            if design.is_empty() {
                continue;
            }
            let row = Answered::of(design, &header, &line)?;
            row.check().map_err(|problem| line.error(problem))?;
            let (trial, listener) = (row.count("trial"), row.text("listener"));
            let asked = (row.text("page").to_owned(), listener.to_owned(), trial);
            if let Some(other) = seen.insert(asked, path.to_owned()) {
                return Err(line.error(format!(
                    "trial {trial} of listener {listener} on this page is in {}, too; give each listener's answers \
                     once, or, if two people had one number, give the other one a number of their own in the column \
                     'listener'",
                    other.display()
                )));
            }
            rows.push(row);
        }
        if rows.is_empty() {
            return Err(Error::file(path, "has no answers"));
        }
        Ok(Self {
            path: path.to_owned(),
            rows,
        })
    }

    /// Reads the files of one or several listeners.
    ///
    /// # Errors
    /// A file that cannot be read or has no answers; a row that is invalid or contradicts itself; or a trial of a page
    /// that a listener has answered twice, in one file or in two.
    pub fn read_all(paths: &[PathBuf]) -> Result<Vec<Self>> {
        let mut seen = BTreeMap::new();
        paths.iter().map(|path| Self::read(path, &mut seen)).collect()
    }

    /// The rows, each as its fields and the names of their columns.
    pub fn rows(&self) -> impl Iterator<Item = Vec<(&str, &Field)>> {
        self.rows.iter().map(|row| {
            let own = row.own.iter().map(|(name, field)| (*name, field));
            let further = row.further.iter();
            own.chain(further.map(|(name, field)| (name.as_str(), field))).collect()
        })
    }
}

/// Remedy for a file that does not hold answers.
const FROM_A_PAGE: &str = "give a file that the page of `stylus compare` saved";

/// Columns of all designs, with their forms.
const OF_ALL: [(&str, Form); 6] = [
    ("listener", Form::Text),
    ("trial", Form::Count),
    ("replays", Form::Count),
    ("seconds", Form::Number),
    ("page", Form::Text),
    ("origin", Form::Text),
];

/// Returns the columns that only `design` has; `None` if there is no such design.
fn columns_of(design: &str) -> Option<&'static [(&'static str, Form)]> {
    use Form::{Count, Number, Text};
    Some(match design {
        "abx" => &[
            ("pair", Text),
            ("a", Text),
            ("b", Text),
            ("x", Text),
            ("answer", Text),
            ("correct", Count),
        ],
        "similarity" => &[
            ("block", Count),
            ("position", Count),
            ("pair", Text),
            ("a", Text),
            ("b", Text),
            ("same", Count),
            ("rating", Number),
        ],
        "staircase" => &[
            ("part", Text),
            ("step", Count),
            ("strength", Number),
            ("unit", Text),
            ("a", Text),
            ("b", Text),
            ("x", Text),
            ("answer", Text),
            ("correct", Count),
            ("reversal", Count),
        ],
        _ => return None,
    })
}

impl Answered {
    fn of(design: &str, header: &Header<'_>, line: &Row<'_, '_>) -> Result<Self> {
        let Some(columns) = columns_of(design) else {
            let design = bounded("design", design).map_err(|problem| line.error(problem))?;
            return Err(line.error(format!("the design is '{design}', which no page has; {FROM_A_PAGE}")));
        };
        let mut own = vec![("design", Field::Text(design.to_owned()))];
        let mut known = vec![header.column("design")?];
        for &(name, form) in OF_ALL.iter().chain(columns) {
            let column = header.needed(name, FROM_A_PAGE)?;
            let text = line.text(column);
            let field = match form {
                Form::Text => Field::Text(bounded(name, text).map_err(|problem| line.error(problem))?),
                Form::Number => Field::Number(line.finite(column, name)?),
                Form::Count => Field::Count(
                    text.parse()
                        .map_err(|_| line.error(format!("{name} is '{text}', which is no count; {FROM_A_PAGE}")))?,
                ),
            };
            own.push((name, field));
            known.push(Some(column));
        }
        let further = header
            .names()
            .enumerate()
            .filter(|(column, _)| !known.contains(&Some(*column)))
            .map(|(column, name)| {
                let text = line.text(column).to_owned();
                (name.to_owned(), Field::Text(text))
            });
        Ok(Self {
            further: further.collect(),
            own,
        })
    }

    fn field(&self, name: &str) -> Option<&Field> {
        let mut own = self.own.iter();
        own.find(|field| field.0 == name).map(|field| &field.1)
    }

    /// The text in a column; empty if the design lacks the column.
    fn text(&self, name: &str) -> &str {
        match self.field(name) {
            Some(Field::Text(text)) => text,
            _ => "",
        }
    }

    /// The count in a column; 0 if the design lacks the column.
    fn count(&self, name: &str) -> u32 {
        match self.field(name) {
            Some(Field::Count(count)) => *count,
            _ => 0,
        }
    }

    /// Returns what is wrong with the row.
    fn check(&self) -> std::result::Result<(), String> {
        let [design, a, b, x, answer] = ["design", "a", "b", "x", "answer"].map(|of| self.text(of));
        if design == "similarity" {
            return Ok(());
        }
        let chosen = match answer {
            "A" => a,
            "B" => b,
            other => return Err(format!("the answer is '{other}'; it must be A or B")),
        };
        let is_right = chosen == x;
        if a == b || (x != a && x != b) {
            return Err(format!(
                "X is '{x}', A '{a}' and B '{b}'; X must be one of two that differ"
            ));
        }
        let correct = self.count("correct");
        if u32::from(is_right) != correct {
            return Err(format!(
                "'correct' is {correct}, but the answer {answer} to X = '{x}' is {}; the file was changed",
                if is_right { "right" } else { "wrong" }
            ));
        }
        Ok(())
    }
}

/// Returns the text of a field, or the problem that it is longer than a page saves.
fn bounded(name: &str, text: &str) -> std::result::Result<String, String> {
    if text.len() <= LONGEST_TEXT {
        return Ok(text.to_owned());
    }
    Err(format!(
        "{name} has {} bytes, and a page saves at most {LONGEST_TEXT}; {FROM_A_PAGE}",
        text.len()
    ))
}

/// Adds the remedy to the error of a line that no page saved.
fn not_saved(path: &Path, failure: Error) -> Error {
    match failure {
        Error::Line { line, problem, .. } => Error::line(path, line, format!("{problem}; {FROM_A_PAGE}")),
        other => other,
    }
}

/// Scores the answers of all files together: each pair, in the order of its first answer, and all of them if there are
/// several.
///
/// # Errors
/// Ratings and staircases, which no proportion of right answers scores, or more pairs than a page can have.
pub fn score(files: &[Answers]) -> Result<Vec<Score>> {
    for file in files {
        let mut designs = file.rows.iter().map(|row| row.text("design"));
        if let Some(other) = designs.find(|design| *design != "abx") {
            return Err(Error::file(
                &file.path,
                format!(
                    "holds answers of the design '{other}', and --score counts those of 'abx'; analyse it by the \
                     Python package: `examples/analyse_listening.py`"
                ),
            ));
        }
    }
    let mut pairs: Vec<&str> = Vec::new();
    for (file, row) in (files.iter()).flat_map(|file| file.rows.iter().map(move |row| (file, row))) {
        let pair = row.text("pair");
        if pairs.contains(&pair) {
            continue;
        }
        if pairs.len() == MOST_PAIRS {
            let problem = format!("has more than {MOST_PAIRS} pairs of kinds; {FROM_A_PAGE}");
            return Err(Error::file(&file.path, problem));
        }
        pairs.push(pair);
    }
    let mut scores: Vec<Score> = pairs
        .iter()
        .map(|&pair| Score::of(files, pair, |row| row.text("pair") == pair))
        .collect();
    if pairs.len() > 1 {
        scores.push(Score::of(files, "all", |_| true));
    }
    Ok(scores)
}

impl Score {
    fn of(files: &[Answers], pair: &str, is_of: impl Fn(&Answered) -> bool) -> Self {
        let rows: Vec<&Answered> = files
            .iter()
            .flat_map(|file| file.rows.iter().filter(|row| is_of(row)))
            .collect();
        let trials = rows.len() as u32;
        let correct = rows.iter().map(|row| row.count("correct")).sum();
        let interval = clopper_pearson(correct, trials, CONFIDENCE);
        let with = |file: &&Answers| file.rows.iter().any(&is_of);
        Self {
            pair: pair.to_owned(),
            files: files.iter().filter(with).count(),
            trials,
            correct,
            proportion: f64::from(correct) / f64::from(trials),
            interval,
            chance: CHANCE,
            is_told_apart: interval.0 > CHANCE,
            simulated: rows.iter().any(|row| row.text("origin") == "SIMULATED"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_helpers::{holds, new_file};

    const HEADER: &str = "listener,trial,pair,a,b,x,answer,correct,replays,seconds,surface,page,origin\n";

    fn file(folder: &Path, name: &str, rows: &[String]) -> PathBuf {
        let path = folder.join(name);
        std::fs::write(&path, format!("{HEADER}{}", rows.concat())).unwrap();
        path
    }

    fn read(path: &Path) -> Result<Vec<Answers>> {
        Answers::read_all(&[path.to_owned()])
    }

    fn row(trial: u32, pair: &str, x: &str, answer: &str, correct: u8) -> String {
        format!("1,{trial},{pair},recording,gaussian,{x},{answer},{correct},0,2.5,\"felt, 1 N\",p1,recorded\n")
    }

    #[test]
    fn answers_of_several_listeners_are_counted_together_and_by_pair() {
        let folder = tempfile::tempdir().unwrap();
        let one: Vec<String> = (0..10)
            .map(|n| row(n, "recording-gaussian", "recording", "A", 1))
            .chain((10..14).map(|n| row(n, "recording-fitted", "gaussian", "A", 0)))
            .collect();
        let two: Vec<String> = (0..10)
            .map(|n| row(n, "recording-gaussian", "gaussian", "A", 0).replacen('1', "2", 1))
            .collect();
        let files = [("one.csv", one), ("two.csv", two)].map(|(name, rows)| file(folder.path(), name, &rows));
        let scores = score(&Answers::read_all(&files).unwrap()).unwrap();
        let counts: Vec<(&str, usize, u32, u32)> = scores
            .iter()
            .map(|s| (s.pair.as_str(), s.files, s.trials, s.correct))
            .collect();
        assert_eq!(
            counts,
            [
                ("recording-gaussian", 2, 20, 10),
                ("recording-fitted", 1, 4, 0),
                ("all", 2, 24, 10)
            ]
        );
        assert_eq!(scores[0].interval, clopper_pearson(10, 20, CONFIDENCE));
        assert!(!scores[0].is_told_apart && !scores[0].simulated);
    }

    #[test]
    fn names_and_pairs_that_no_page_saves_are_refused_in_a_line_of_bounded_length() {
        let folder = tempfile::tempdir().unwrap();
        let long = "p".repeat(1_000_000);
        let path = file(folder.path(), "long.csv", &[row(1, &long, "recording", "A", 1)]);
        let refused = read(&path).unwrap_err().to_string();
        holds(&refused, &["line 2", "pair has 1000000 bytes", "at most 256"]);
        assert!(refused.len() < 1000, "{}", refused.len());
        let rows = |count: usize| -> Vec<String> {
            let row = |n: usize| row(n as u32, &format!("pair {n}"), "recording", "A", 1);
            (0..count).map(row).collect()
        };
        for (count, is_scored) in [(MOST_PAIRS, true), (MOST_PAIRS + 1, false)] {
            let path = file(folder.path(), "many.csv", &rows(count));
            let scored = score(&read(&path).unwrap());
            assert_eq!(scored.is_ok(), is_scored);
        }
    }

    #[test]
    fn rows_that_contradict_themselves_are_refused_with_their_line() {
        let folder = tempfile::tempdir().unwrap();
        let good = || row(1, "recording-gaussian", "recording", "A", 1);
        for (bad, word) in [
            (row(2, "recording-gaussian", "recording", "A", 0), "changed"),
            (row(2, "recording-gaussian", "recording", "C", 0), "A or B"),
            (row(2, "recording-gaussian", "fitted", "A", 0), "one of two"),
            (good(), "listener 1 on this page is in"),
            ("1,2,short\n".into(), "compare"),
        ] {
            let path = file(folder.path(), "bad.csv", &[good(), bad]);
            holds(&read(&path).unwrap_err(), &["line 3", word]);
        }
        let other = format!("design,{HEADER}triangle,{}", good());
        let path = folder.path().join("other.csv");
        std::fs::write(&path, other).unwrap();
        holds(&read(&path).unwrap_err(), &["line 2", "'triangle'"]);
        let empty = file(folder.path(), "empty.csv", &[]);
        holds(&read(&empty).unwrap_err(), &["no answers"]);
    }

    #[test]
    fn a_listener_answers_a_trial_once_so_two_people_with_one_number_and_a_file_given_twice_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let rows = [row(1, "recording-gaussian", "recording", "A", 1)];
        let one = file(folder.path(), "one.csv", &rows);
        let copy = folder.path().join("copy.csv");
        let saved = std::fs::read_to_string(&one).unwrap();
        let german = saved.replace("\"felt, 1 N\"", "felt").replace(',', ";");
        std::fs::write(&copy, german.replace("2.5", "2,5")).unwrap();
        let other = file(folder.path(), "other.csv", &[rows[0].replace("A,1", "B,0")]);
        for again in [copy, other] {
            let name = again.file_name().unwrap().to_str().unwrap().to_owned();
            let told = Answers::read_all(&[one.clone(), again]).unwrap_err();
            holds(&told, &[&name, "one.csv", "listener 1", "two people"]);
        }
        // What one listener saved in two sittings, and another's page.
        let later = file(folder.path(), "later.csv", &[rows[0].replacen(",1,", ",2,", 1)]);
        let page = file(folder.path(), "page.csv", &[rows[0].replace("p1", "p2")]);
        assert_eq!(Answers::read_all(&[one, later, page]).unwrap().len(), 3);
    }

    #[test]
    fn answers_of_all_designs_are_read_and_only_those_of_abx_are_scored() {
        let folder = tempfile::tempdir().unwrap();
        let written = |design: &str, names: &str, values: &str| {
            let path = folder.path().join(format!("{design}.csv"));
            let text = format!(
                "design,listener,trial,{names},replays,seconds,surface,page,origin\n\
                 {design},1,1,{values},0,2.5,felt,p1,recorded\n"
            );
            std::fs::write(&path, text).unwrap();
            read(&path)
        };
        let ratings = written(
            "similarity",
            "block,position,pair,a,b,same,rating",
            "1,1,recording-fitted,fitted,recording,0,62.5",
        )
        .unwrap();
        let rows: Vec<_> = ratings[0].rows().collect();
        assert!(rows[0].contains(&("rating", &Field::Number(62.5))));
        assert!(rows[0].contains(&("surface", &Field::Text("felt".into()))));
        let words = ["similarity.csv", "'similarity'", "'abx'", "analyse_listening.py"];
        holds(&score(&ratings).unwrap_err(), &words);
        let names = "part,step,strength,unit,a,b,x,answer,correct,reversal";
        let step = "level,17,8,dB,reference,changed,changed";
        let stairs = written("staircase", names, &format!("{step},B,1,0")).unwrap();
        holds(&score(&stairs).unwrap_err(), &["'staircase'"]);
        let changed = written("staircase", names, &format!("{step},A,1,0"));
        holds(&changed.unwrap_err(), &["line 2", "changed"]);
    }

    #[test]
    fn of_an_experiments_data_the_rows_of_a_listening_test_count() {
        let (_folder, path) = new_file("experiment.csv");
        // As jsPsych writes it: every field is quoted, and a trial has no value in the columns of others.
        let quoted = |fields: &[&str]| format!("\"{}\"\r\n", fields.join("\",\""));
        let names = "trial_type,texture,motion_csv,rt,design,listener,trial,pair,a,b,x,answer,correct,replays,seconds,\
                     surface,page,origin,is_last";
        let motion = "time_s,speed_mm_s\n0,100\n0.002,101\n";
        let rub = [&["stylus-rub", "felt", motion, "900"][..], &[""; 15]].concat();
        let answer = |trial: &'static str, answer, correct| {
            let own = [
                "stylus-compare",
                "",
                "",
                "2500",
                "abx",
                "1",
                trial,
                "r-g",
                "r",
                "g",
                "r",
            ];
            let rest = [
                answer,
                correct,
                "0",
                "2.5",
                "felt, 100 mm/s, 1 N",
                "p1",
                "recorded",
                "false",
            ];
            [&own[..], &rest].concat()
        };
        let names: Vec<&str> = names.split(',').collect();
        let rows = [names, rub, answer("1", "A", "1"), answer("2", "B", "0")];
        std::fs::write(&path, rows.map(|row| quoted(&row)).concat()).unwrap();
        let scores = score(&read(&path).unwrap()).unwrap();
        assert_eq!((scores[0].trials, scores[0].correct), (2, 1));
    }
}
