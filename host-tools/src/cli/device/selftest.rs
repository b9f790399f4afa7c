//! `stylus selftest`

use std::path::PathBuf;

use stylus_link::link::{Device, LinkAddress, LinkError};
use stylus_link::procedures::self_test::Record;
use stylus_link::procedures::self_test::{self, Options, Step, Verdict};
use stylus_support::progress;
use stylus_support::{Error, Result};

use super::Link;
use super::slots::Slot;
use crate::cli::files::Overwrite;
use crate::cli::input::positive;
use crate::cli::output::{print, print_json, tell};
use crate::cli::table::{headed, table};

#[derive(clap::Args)]
#[expect(clippy::struct_excessive_bools, reason = "each is a switch of the command line")]
pub struct Arguments {
    /// Duration of the traffic on the link, in seconds
    #[arg(long, value_name = "S", value_parser = positive, default_value_t = 30.0)]
    seconds: f64,
    /// Leave the sensors out, because none are connected
    #[arg(long)]
    bare: bool,
    /// Move the output although no enable is wired, because no amplifier is connected; holds for this run alone
    #[arg(long)]
    no_amplifier: bool,
    /// Test the encoder too, while you move the tool in one direction when asked
    #[arg(long = "move", conflicts_with = "bare")]
    moves: bool,
    /// Slot whose library may be erased to test the flash, where no slot is empty
    #[arg(long, value_name = "SLOT", value_enum, ignore_case = true)]
    use_slot: Option<Slot>,
    /// Address of a second link to the same stylus, to test its traffic too
    #[arg(long, value_name = "LINK")]
    also: Option<LinkAddress>,
    /// File of the record, or folder for a file named by serial number and date
    #[arg(long, value_name = "PATH", default_value = ".")]
    record: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
    /// Print the record as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    link: Link,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    // In a folder the record gets a new name of serial number and date, which replaces nothing.
    if !arguments.record.is_dir() {
        arguments.overwrite.file(&arguments.record)?;
    }
    let device = arguments.link.connect()?;
    // Opened before the test, so that a wrong address does not cost the half minute of a test.
    let also = (arguments.also.as_ref())
        .map(|address| other(arguments, address, device.info().serial.as_str()))
        .transpose()?;
    let options = Options {
        traffic_s: arguments.seconds,
        sensors: !arguments.bare,
        no_amplifier: arguments.no_amplifier,
        moves: arguments.moves,
        erasable: arguments.use_slot.and_then(Slot::id),
        ..Options::default()
    };
    if arguments.no_amplifier {
        tell("no amplifier may be connected: the test moves the output over its range");
    }
    let line = progress::line("self test");
    let mut lines = self_test::run(&device, &options, |step| {
        let words = words(step, arguments.seconds);
        line.set_message(words.clone());
        if matches!(step, Step::Move) {
            // A person must see this, also where progress is hidden.
            line.suspend(|| tell(&words));
        }
    })?;
    if let Some(also) = &also {
        lines.extend(self_test::other_link(also, arguments.seconds)?);
    }
    line.finish_and_clear();
    let record = Record::new(device.info(), lines);
    // The record is shown before it is written, so that it is not lost if the file cannot be written.
    if arguments.json {
        print_json(&record)?;
    } else {
        print(&text(&record))?;
    }
    let path = record.write(&arguments.record)?;
    if !arguments.json {
        print(&format!("record: {}", path.display()))?;
    }
    match record.failed {
        0 => Ok(()),
        failed => Err(Error::Request(format!(
            "{failed} of {} lines fail: see what to do beside each",
            record.lines.len()
        ))),
    }
}

/// Opens a second link to the device with this serial number.
fn other(arguments: &Arguments, address: &LinkAddress, serial: &str) -> Result<Device> {
    let device = arguments.link.connect_to(address)?;
    if device.info().serial.as_str() != serial {
        return Err(LinkError::NotVerified {
            link: address.to_string(),
            what: format!(
                "this is device {}, not {serial}: name a second link to the same device",
                device.info().serial
            ),
        }
        .into());
    }
    Ok(device)
}

fn words(step: Step, seconds: f64) -> String {
    match step {
        Step::Measuring(what) => format!("measuring: {what}"),
        Step::Rest => "leave the tool alone".to_owned(),
        Step::Move => "move the tool in one direction now, for five seconds".to_owned(),
        Step::Traffic => format!("traffic on the link for {seconds:.0} s"),
    }
}

/// Returns the lines as a table, with each remedy beside its line, and the counts and the names of the lines that fail.
fn text(record: &Record) -> String {
    let (header, rows) = headed(record.lines.iter().map(|line| {
        [
            ("what", line.name.clone()),
            ("value", line.value.clone()),
            ("limits", line.limits.clone()),
            ("verdict", line.verdict.to_string()),
            ("what to do", line.remedy.clone()),
        ]
    }));
    let mut text = table(&header, &rows);
    let bad: Vec<&str> = (record.lines.iter())
        .filter(|line| line.verdict == Verdict::Fail)
        .map(|line| line.name.as_str())
        .collect();
    text.push_str(&format!(
        "\n{} {}: {} pass, {} fail, {} not measured",
        record.device.product, record.device.serial, record.passed, record.failed, record.not_measured
    ));
    if !bad.is_empty() {
        text.push_str(&format!("\nfails: {}", bad.join(", ")));
    }
    text
}
