//! A play on the image, compared with what the product's own kernel computes on this computer.

use virtual_stylus::model::dac::Cause;

use crate::device::{CODES, Device, MID_SCALE, MS};
use crate::expected::{Began, Heard, Recorded, explain, explained};
use crate::requests::assert_even;

/// Codes at the output before those of the first tick: the timer of the codes runs for 17 of them before the tick's own
/// timer starts and that tick's first code is due.
pub const BEFORE_FIRST_TICK: usize = 17;

/// The codes of each tick that were put out at the triggers, from the first tick on, after a check of their instants.
pub fn latched(device: &mut Device) -> Vec<[u16; CODES]> {
    let outputs = device.triggered();
    assert_even(&outputs);
    let codes: Vec<u16> = (outputs[BEFORE_FIRST_TICK..].iter())
        .map(|output| output.code.expect("driven"))
        .collect();
    codes.as_chunks().0.to_vec()
}

/// A recorded play.
pub struct Compared {
    /// The inputs.
    pub recorded: Recorded,
    /// The codes of each tick.
    pub codes: Vec<[u16; CODES]>,
    /// The tick at which playing was asked for.
    pub asked: u64,
    /// Number of ticks that were audited, none of which touched flash.
    pub audits: usize,
}

impl Compared {
    /// The number of the first tick after the recording.
    pub fn end(&self) -> u64 {
        self.recorded.first_tick + self.recorded.samples.len() as u64
    }

    /// The beginning of the output that equals `heard`, and the first tick from which it does not.
    pub fn explained(&self, heard: &Heard<'_>) -> (Began, u64) {
        explain(heard, &self.recorded, &self.codes, self.asked)
    }

    /// As [`Compared::explained`], for a beginning that is known.
    pub fn explained_from(&self, heard: &Heard<'_>, began: Began) -> u64 {
        explained(heard, &self.recorded, &self.codes, self.asked, began)
    }

    /// Checks that more than a quarter of the codes since `began` are not mid-scale.
    pub fn assert_heard(&self, began: Began) {
        let played = &self.codes[began.unmuted as usize..self.end() as usize];
        let codes = played.as_flattened();
        let sounding = codes.iter().filter(|&&code| code != MID_SCALE).count();
        assert!(sounding > codes.len() / 4, "{sounding} of {}", codes.len());
    }
}

/// Records while `play` is played for as long as it takes; no tick may be late, saturated or touch flash.
pub fn recorded(device: &mut Device, play: impl FnOnce(&mut Device)) -> Compared {
    device.record();
    // More than the window of the speed.
    device.run_for(60 * MS);
    let asked = device.status().tick.ticks;
    device.stylus.audit_ticks(997);
    play(device);
    let stopped = device.stop_recording();
    assert_eq!(stopped.lost_blocks, 0);
    device.assert_undisturbed();
    assert_eq!(device.status().output.saturations, 0);
    let audits = device.stylus.take_audits();
    for audit in &audits {
        let from_flash = (audit.flash_fetches, audit.flash_reads);
        assert_eq!(from_flash, (0, 0), "{audit:x?}");
    }
    let late = device.dac().iter().find(|output| {
        output.cause != Cause::Trigger && output.code.is_some_and(|code| code != MID_SCALE)
    });
    assert_eq!(late, None, "a code that no trigger has put out");
    Compared {
        recorded: Recorded::of(device),
        codes: latched(device),
        asked,
        audits: audits.len(),
    }
}

/// Has `play` begin and go on for `millis`, and compares all codes with those that the host computes for `heard`.
pub fn plays_as_the_host_does(
    device: &mut Device,
    heard: &Heard<'_>,
    millis: u64,
    play: impl FnOnce(&mut Device),
) -> Compared {
    let compared = recorded(device, |device| {
        play(device);
        device.run_for(millis * MS);
    });
    let (began, same_until) = compared.explained(heard);
    let end = compared.end();
    assert_eq!(
        same_until, end,
        "codes differ from there on, with {began:?}"
    );
    compared.assert_heard(began);
    compared
}
