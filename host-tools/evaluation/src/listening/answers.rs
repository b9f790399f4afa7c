//! Answers of a listening test as a page saves them, and their score.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::dsp::binomial::clopper_pearson;
use crate::support::bounded_file::{Limit, MIB};
use crate::support::csv_table::{CsvTable, Header, Row};
use crate::support::error::{Error, Result};

/// Proportion of right answers by chance.
pub const CHANCE: f64 = 0.5;

/// Confidence of intervals.
pub const CONFIDENCE: f64 = 0.95;

/// Largest file of answers.
const LIMIT: Limit = Limit {
    of: "a file of answers",
    bytes: 16 * MIB,
};

/// Longest text of a field, bytes: many times what a page saves.
const LONGEST_TEXT: usize = 256;

/// Largest number of pairs of kinds: many times as many as there are.
const MOST_PAIRS: usize = 64;

/// A row of a file of answers.
#[derive(Clone, Debug, PartialEq)]
struct Answered {
    listener: String,
    trial: u32,
    pair: String,
    a: String,
    b: String,
    x: String,
    answer: String,
    correct: u32,
    replays: u32,
    seconds: f64,
    page: String,
    origin: String,
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
    /// Reads a file that a page has saved.
    ///
    /// # Errors
    /// A file that cannot be read, has no answers or those of another design; a row that is invalid or contradicts
    /// itself; or a trial that occurs twice.
    pub fn read(path: &Path) -> Result<Self> {
        let table = CsvTable::read(path, LIMIT).map_err(|failure| not_saved(path, failure))?;
        let header = table.header()?;
        // Files of other designs lack columns, but an error about these would not name the reason.
        refuse_other_designs(&table, header.column("design")?)?;
        let columns = Columns::of(&header)?;
        let mut rows: Vec<Answered> = Vec::new();
        let mut seen = BTreeSet::new();
        let mut lines = table.rows_below_header()?;
        while let Some(line) = lines
            .next_row()
            .map_err(|failure| not_saved(path, failure))?
        {
            let row = columns.answer(&line)?;
            row.check().map_err(|problem| line.error(problem))?;
            if !seen.insert((row.page.clone(), row.listener.clone(), row.trial)) {
                return Err(line.error(format!(
                    "trial {} of this page and listener is there twice; give each listener's file once",
                    row.trial
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
}

/// Remedy for a file that does not hold answers.
const FROM_A_PAGE: &str = "give a file that the page of `stylus compare` saved";

/// Names of the columns, in the order of [`Answered`]'s fields.
const NAMES: [&str; 12] = [
    "listener", "trial", "pair", "a", "b", "x", "answer", "correct", "replays", "seconds", "page",
    "origin",
];

/// Refuses ratings and staircases, because a proportion of right answers does not score them.
fn refuse_other_designs(table: &CsvTable, design: Option<usize>) -> Result<()> {
    let mut rows = table.rows_below_header()?;
    let (Some(column), Ok(Some(row))) = (design, rows.next_row()) else {
        return Ok(());
    };
    match row.text(column) {
        "abx" => Ok(()),
        other => Err(Error::file(
            table.path(),
            format!(
                "holds answers of the design '{other}', and --score counts those of 'abx'; analyse it by the Python \
                 package: `examples/analyse_listening.py`"
            ),
        )),
    }
}

/// Indices of the columns of [`NAMES`].
struct Columns([usize; NAMES.len()]);

impl Columns {
    fn of(header: &Header<'_>) -> Result<Self> {
        let mut columns = [0; NAMES.len()];
        for (column, name) in columns.iter_mut().zip(NAMES) {
            *column = header.needed(name, FROM_A_PAGE)?;
        }
        Ok(Self(columns))
    }

    fn answer(&self, line: &Row<'_, '_>) -> Result<Answered> {
        let text = |field: usize| match line.text(self.0[field]) {
            text if text.len() <= LONGEST_TEXT => Ok(text.to_owned()),
            text => Err(line.error(format!(
                "{} has {} bytes, and a page saves at most {LONGEST_TEXT}; {FROM_A_PAGE}",
                NAMES[field],
                text.len()
            ))),
        };
        let count = |field: usize| {
            let (text, name) = (line.text(self.0[field]), NAMES[field]);
            text.parse().map_err(|_| {
                line.error(format!(
                    "{name} is '{text}', which is no count; {FROM_A_PAGE}"
                ))
            })
        };
        Ok(Answered {
            listener: text(0)?,
            trial: count(1)?,
            pair: text(2)?,
            a: text(3)?,
            b: text(4)?,
            x: text(5)?,
            answer: text(6)?,
            correct: count(7)?,
            replays: count(8)?,
            seconds: line.finite(self.0[9], NAMES[9])?,
            page: text(10)?,
            origin: text(11)?,
        })
    }
}

impl Answered {
    /// Returns what is wrong with the row.
    fn check(&self) -> std::result::Result<(), String> {
        let chosen = match self.answer.as_str() {
            "A" => &self.a,
            "B" => &self.b,
            other => return Err(format!("the answer is '{other}'; it must be A or B")),
        };
        let is_right = *chosen == self.x;
        if self.a == self.b || (self.x != self.a && self.x != self.b) {
            return Err(format!(
                "X is '{}', A '{}' and B '{}'; X must be one of two that differ",
                self.x, self.a, self.b
            ));
        }
        if u32::from(is_right) != self.correct {
            return Err(format!(
                "'correct' is {}, but the answer {} to X = '{}' is {}; the file was changed",
                self.correct,
                self.answer,
                self.x,
                if is_right { "right" } else { "wrong" }
            ));
        }
        Ok(())
    }
}

/// Adds the remedy to the error of a line that no page saved.
fn not_saved(path: &Path, failure: Error) -> Error {
    match failure {
        Error::Line { line, problem, .. } => {
            Error::line(path, line, format!("{problem}; {FROM_A_PAGE}"))
        }
        other => other,
    }
}

/// Scores the answers of all files together: each pair, in the order of its first answer, and all of them if there are
/// several.
///
/// # Errors
/// Two files with the same answers, or more pairs than a page can have.
pub fn score(files: &[Answers]) -> Result<Vec<Score>> {
    for (index, file) in files.iter().enumerate() {
        // Two listeners who gave the same answers differ in their times.
        let same = |other: &&Answers| other.rows == file.rows;
        if let Some(other) = files[..index].iter().find(same) {
            return Err(Error::file(
                &file.path,
                format!(
                    "has the answers of {}; give each listener's file once",
                    other.path.display()
                ),
            ));
        }
    }
    let mut pairs: Vec<&str> = Vec::new();
    for (file, row) in (files.iter()).flat_map(|file| file.rows.iter().map(move |row| (file, row)))
    {
        if pairs.contains(&row.pair.as_str()) {
            continue;
        }
        if pairs.len() == MOST_PAIRS {
            let problem = format!("has more than {MOST_PAIRS} pairs of kinds; {FROM_A_PAGE}");
            return Err(Error::file(&file.path, problem));
        }
        pairs.push(&row.pair);
    }
    let mut scores: Vec<Score> = pairs
        .iter()
        .map(|&pair| Score::of(files, pair, |row| row.pair == pair))
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
        let correct = rows.iter().map(|row| row.correct).sum();
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
            simulated: rows.iter().any(|row| row.origin == "SIMULATED"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_helpers::holds;

    const HEADER: &str =
        "listener,trial,pair,a,b,x,answer,correct,replays,seconds,surface,page,origin\n";

    fn file(folder: &Path, name: &str, rows: &[String]) -> PathBuf {
        let path = folder.join(name);
        std::fs::write(&path, format!("{HEADER}{}", rows.concat())).unwrap();
        path
    }

    fn row(trial: u32, pair: &str, x: &str, answer: &str, correct: u8) -> String {
        format!(
            "1,{trial},{pair},recording,gaussian,{x},{answer},{correct},0,2.5,\"felt, 1 N\",p1,recorded\n"
        )
    }

    #[test]
    fn answers_of_several_listeners_are_counted_together_and_by_pair() {
        let folder = tempfile::tempdir().unwrap();
        let one: Vec<String> = (0..10)
            .map(|n| row(n, "recording-gaussian", "recording", "A", 1))
            .chain((10..14).map(|n| row(n, "recording-fitted", "gaussian", "A", 0)))
            .collect();
        let two: Vec<String> = (0..10)
            .map(|n| row(n, "recording-gaussian", "gaussian", "A", 0))
            .collect();
        let files = [("one.csv", one), ("two.csv", two)]
            .map(|(name, rows)| Answers::read(&file(folder.path(), name, &rows)).unwrap());
        let scores = score(&files).unwrap();
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
        let path = file(
            folder.path(),
            "long.csv",
            &[row(1, &long, "recording", "A", 1)],
        );
        let refused = Answers::read(&path).unwrap_err().to_string();
        holds(
            &refused,
            &["line 2", "pair has 1000000 bytes", "at most 256"],
        );
        assert!(refused.len() < 1000, "{}", refused.len());
        let rows = |count: usize| -> Vec<String> {
            let row = |n: usize| row(n as u32, &format!("pair {n}"), "recording", "A", 1);
            (0..count).map(row).collect()
        };
        for (count, is_scored) in [(MOST_PAIRS, true), (MOST_PAIRS + 1, false)] {
            let path = file(folder.path(), "many.csv", &rows(count));
            let scored = score(&[Answers::read(&path).unwrap()]);
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
            (good(), "twice"),
            ("1,2,short\n".into(), "compare"),
        ] {
            let path = file(folder.path(), "bad.csv", &[good(), bad]);
            holds(&Answers::read(&path).unwrap_err(), &["line 3", word]);
        }
        let other = format!("design,{HEADER}similarity,{}", good());
        let path = folder.path().join("other.csv");
        std::fs::write(&path, other).unwrap();
        let words = ["other.csv", "'similarity'", "'abx'", "analyse_listening.py"];
        holds(&Answers::read(&path).unwrap_err(), &words);
        let empty = file(folder.path(), "empty.csv", &[]);
        holds(&Answers::read(&empty).unwrap_err(), &["no answers"]);
    }

    #[test]
    fn one_file_does_not_count_twice() {
        let folder = tempfile::tempdir().unwrap();
        let rows = [row(1, "recording-gaussian", "recording", "A", 1)];
        let files = ["one.csv", "copy.csv"]
            .map(|name| Answers::read(&file(folder.path(), name, &rows)).unwrap());
        holds(&score(&files).unwrap_err(), &["copy.csv", "one.csv"]);
    }
}
