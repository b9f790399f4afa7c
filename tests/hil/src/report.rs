//! The report: a line per test with its value, its limits and its verdict.

use std::fmt;

use serde::Serialize;

/// Verdict of a test.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The value is within its limits.
    Passed,
    /// The value is outside its limits, or there is none.
    Failed,
    /// The test could not run here.
    LeftOut,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Passed => "passed",
            Self::Failed => "FAILED",
            Self::LeftOut => "left out",
        })
    }
}

/// One test.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Line {
    /// The subject that the test belongs to.
    pub subject: &'static str,
    /// Name of the test: the property that it holds.
    pub name: String,
    /// The value that was found.
    pub value: String,
    /// Limits of the value.
    pub limits: String,
    /// The verdict.
    pub verdict: Verdict,
}

impl fmt::Display for Line {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            subject,
            name,
            value,
            limits,
            verdict,
        } = self;
        if limits.is_empty() {
            write!(f, "{verdict:<8}  {subject}: {name}: {value}")
        } else {
            write!(f, "{verdict:<8}  {subject}: {name}: {value} ({limits})")
        }
    }
}

/// The lines of a run, in the order of its tests.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Report {
    /// The lines.
    pub lines: Vec<Line>,
    /// True if the run was ended before its last test.
    pub interrupted: bool,
}

impl Report {
    /// Number of tests with `verdict`.
    pub fn count(&self, verdict: Verdict) -> usize {
        let lines = self.lines.iter();
        lines.filter(|line| line.verdict == verdict).count()
    }

    /// Returns true if the run came to its end, something passed and nothing failed.
    pub fn holds(&self) -> bool {
        !self.interrupted && self.count(Verdict::Passed) > 0 && self.count(Verdict::Failed) == 0
    }

    /// The summary, in one line.
    pub fn summary(&self) -> String {
        let [passed, failed, left_out] =
            [Verdict::Passed, Verdict::Failed, Verdict::LeftOut].map(|verdict| self.count(verdict));
        let end = match (self.interrupted, failed, passed) {
            (true, ..) => "; interrupted before the last test",
            (false, 0, 0) => "; nothing was tested, which is a failure",
            _ => "",
        };
        format!("{passed} passed, {failed} failed, {left_out} left out{end}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(verdicts: &[Verdict]) -> Report {
        let line = |&verdict: &Verdict| Line {
            subject: "subject",
            name: "name".to_owned(),
            value: "1".to_owned(),
            limits: "at most 2".to_owned(),
            verdict,
        };
        Report {
            lines: verdicts.iter().map(line).collect(),
            interrupted: false,
        }
    }

    #[test]
    fn a_run_that_tests_nothing_fails() {
        assert!(!report(&[]).holds());
        assert!(!report(&[Verdict::LeftOut]).holds());
        assert!(
            report(&[Verdict::LeftOut])
                .summary()
                .contains("nothing was tested")
        );
    }

    #[test]
    fn a_test_that_was_left_out_does_not_count_as_passed() {
        let report = report(&[Verdict::Passed, Verdict::LeftOut]);
        assert!(report.holds());
        assert_eq!(report.summary(), "1 passed, 0 failed, 1 left out");
    }

    #[test]
    fn a_failure_or_an_interrupt_fails_the_run() {
        assert!(!report(&[Verdict::Passed, Verdict::Failed]).holds());
        let mut interrupted = report(&[Verdict::Passed]);
        interrupted.interrupted = true;
        assert!(!interrupted.holds());
    }
}
