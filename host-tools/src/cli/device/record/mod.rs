//! `stylus record`

mod arguments;
mod operator;
mod report;
mod session;

use host_tools::link::set::{Folder, PlannedTrial};
use host_tools::support::error::Result;

pub use arguments::Arguments;
use operator::say;
use report::RecordReport;
use session::{Outcome, Session};

use crate::cli::output::{print, print_json};

pub fn run(arguments: &Arguments) -> Result<()> {
    let points = arguments.points()?;
    let mut folder = Folder::open(arguments.folder.path())?;
    folder.check_names(&points)?;
    let (there, todo): (Vec<PlannedTrial>, Vec<PlannedTrial>) = points
        .into_iter()
        .partition(|point| !arguments.again && folder.has(point));
    let session = Session::open(arguments)?;
    say(&format!(
        "{} trial(s) to record, {} already in {}",
        todo.len(),
        there.len(),
        arguments.folder.path().display()
    ));
    let mut rows = Vec::new();
    for (index, point) in todo.iter().enumerate() {
        match session.trial(&mut folder, point, (index + 1, todo.len()))? {
            Outcome::Recorded(row) => rows.push(row),
            Outcome::Last(row) => {
                rows.push(row);
                break;
            }
            Outcome::Skipped => {}
            Outcome::End => break,
        }
    }
    let left_out = todo.len() - rows.len();
    let report = RecordReport::new(arguments.folder.path(), rows, there.len(), left_out);
    if arguments.json {
        return print_json(&report);
    }
    print(&report.text())
}
