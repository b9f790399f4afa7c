//! The report: the lines of the product's self test, each with its subject; and failures that end a subject.

use std::fmt;
use std::path::PathBuf;

use serde::Serialize;
use stylus_link::link::LinkError;
use stylus_link::procedures::self_test::{Line, Verdict};

/// One test.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Test {
    /// The subject that the test belongs to.
    pub subject: &'static str,
    /// The name of the tested property, with value, limits and verdict; if there is no verdict, the reason.
    #[serde(flatten)]
    pub line: Line,
}

impl fmt::Display for Test {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Line {
            name,
            value,
            limits,
            verdict,
            remedy,
            ..
        } = &self.line;
        write!(f, "{verdict:<12}  {}: {name}: ", self.subject)?;
        match verdict {
            Verdict::NotMeasured => f.write_str(remedy),
            Verdict::Pass | Verdict::Fail => write!(f, "{value} ({limits})"),
        }
    }
}

/// The tests of a run, in the order in which they ran.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Report {
    /// The tests.
    pub tests: Vec<Test>,
    /// True if the run was interrupted before its last test.
    pub interrupted: bool,
}

impl Report {
    /// The tests with `verdict`.
    pub fn with(&self, verdict: Verdict) -> impl Iterator<Item = &Test> {
        self.tests.iter().filter(move |test| test.line.verdict == verdict)
    }

    /// Returns true if the run was completed, something passed and nothing failed.
    pub fn holds(&self) -> bool {
        let [passed, failed] = [Verdict::Pass, Verdict::Fail].map(|verdict| self.with(verdict).count());
        !self.interrupted && passed > 0 && failed == 0
    }

    /// The summary, in one line.
    pub fn summary(&self) -> String {
        let [passed, failed, left_out] =
            [Verdict::Pass, Verdict::Fail, Verdict::NotMeasured].map(|verdict| self.with(verdict).count());
        let end = match (self.interrupted, failed, passed) {
            (true, ..) => "; interrupted before the last test",
            (false, 0, 0) => "; nothing was tested, which is a failure",
            _ => "",
        };
        format!("{passed} passed, {failed} failed, {left_out} left out{end}")
    }
}

/// A failure of the bench, as opposed to a value outside its limits.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "each message says it")]
pub enum Error {
    /// The link failed, or the device refused a request.
    #[error(transparent)]
    Link(#[from] LinkError),
    #[error("{what} within {ms} ms of the device's clock")]
    NotReached {
        /// What did not happen, as the beginning of a sentence.
        what: String,
        /// The time within which it was expected, ms.
        ms: u64,
    },
    /// A program cannot be run, or failed.
    #[error("{program}: {problem}")]
    Program {
        program: String,
        /// The problem and the remedy.
        problem: String,
    },
    /// A file cannot be read or written.
    #[error("{path}: {source}", path = path.display())]
    File {
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The system refuses a service that the suite needs.
    #[error("{0}")]
    System(#[from] std::io::Error),
    /// The user ended the run.
    #[error("interrupted")]
    Interrupted,
}

/// Result of a step of the suite.
pub type Result<T> = std::result::Result<T, Error>;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_holds_if_it_ended_and_something_passed_and_nothing_failed() {
        let passed = Line::judged("name", "1", "at most 2", true, "");
        let failed = Line::judged("name", "3", "at most 2", false, "");
        let left_out = Line::not_measured("name", "no probe");
        for (lines, interrupted, summary, holds) in [
            (
                vec![],
                false,
                "0 passed, 0 failed, 0 left out; nothing was tested, which is a failure",
                false,
            ),
            (
                vec![&left_out],
                false,
                "0 passed, 0 failed, 1 left out; nothing was tested, which is a failure",
                false,
            ),
            (vec![&passed, &left_out], false, "1 passed, 0 failed, 1 left out", true),
            (vec![&passed, &failed], false, "1 passed, 1 failed, 0 left out", false),
            (
                vec![&passed],
                true,
                "1 passed, 0 failed, 0 left out; interrupted before the last test",
                false,
            ),
        ] {
            let test = |line: &Line| Test {
                subject: "subject",
                line: line.clone(),
            };
            let report = Report {
                tests: lines.into_iter().map(test).collect(),
                interrupted,
            };
            assert_eq!(report.summary().as_str(), summary);
            assert_eq!(report.holds(), holds);
        }
    }
}
