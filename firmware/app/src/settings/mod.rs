//! Settings in flash: two copies, each a log of records of all settings, so that a change is appended, and a sector is
//! erased only once in some hundred changes. The actuator's response is part of the record, so that it and the settings
//! that belong to it change together.
//!
//! A change is written to the first copy, read back, then to the second one; it counts when both hold it. So one copy
//! always holds the last change that was acknowledged, whatever the power does and whichever word of a copy is lost.
//! For the same reason a copy that is full is erased only while the other one keeps what is in force. An erasure that
//! is cut may leave any of a copy's older records as its last one. Its number tells it from the change before.
//! A record holds all settings under one checksum, because a map of single values would answer a damaged value with an
//! older one, which may be a weaker limit.
//!
//! At the start:
//!
//! | found | in force |
//! |---|---|
//! | both copies end with the same record | that record |
//! | the first one is one change ahead | its record, with the tighter value of each limit |
//! | the same, and with another response | the second one's: a calibration that was cut off changes nothing |
//! | one ends with a record, and the other one is damaged there, or otherwise behind | the record |
//! | both are damaged behind their last record | nothing plays: every limit is lost |
//! | nothing that can be read, and yet not blank | nothing plays: everything is lost |
//!
//! Except in the last case both copies are then written anew. What is lost stays lost, over restarts, until it is set
//! again or all settings are reset.

mod copy;
mod record;

use core::ops::Range;

use embedded_storage_async::nor_flash::NorFlash;
use model_format::link::{
    FlashOperation, Response, SettingChange, SettingSet, Settings, SettingsError, SettingsState,
};

use copy::{Buffers, Copy};
use record::{RECORD_BYTES, Record, Snapshot};

/// Range of the settings, bytes from the start of bank 1: its last two sectors of 128 KB, one per copy. The code ends
/// before them.
///
/// While one of them is erased or written, code of the same bank stalls; the tick runs from ITCM and does not.
pub const SETTINGS_RANGE: Range<u32> = 0x000c_0000..0x0010_0000;

/// Damaged places at the beginning of the first copy that cuts during the very first change may leave.
const MOST_FIRST_CUTS: usize = 8;

/// Settings in flash and in memory.
pub struct SettingsStore<F: NorFlash> {
    flash: F,
    copies: [Copy; 2],
    /// Number of the copy that is written and erased first: the first one, unless the other has to be mended. The
    /// other one keeps what is in force meanwhile.
    spare: usize,
    /// The record in force.
    record: Record,
    /// The record that is being written.
    draft: Record,
    buffers: Buffers,
    differing: SettingSet,
    mended: bool,
    unwritable: bool,
}

impl<F: NorFlash> SettingsStore<F> {
    /// Reads the settings in `range` of `flash`, which is an even number of whole sectors, and mends the copies.
    pub async fn open(flash: F, range: Range<u32>) -> Self {
        let mut store = Self::unread(flash, range);
        store.read().await;
        store
    }

    /// A store that is to be [`SettingsStore::read`] in its place: it is some kilobytes.
    pub const fn unread(flash: F, range: Range<u32>) -> Self {
        let middle = range.start.midpoint(range.end);
        Self {
            flash,
            copies: [Copy::new(range.start..middle), Copy::new(middle..range.end)],
            spare: 0,
            record: NEVER_SET,
            draft: NEVER_SET,
            buffers: [[0; RECORD_BYTES]; 2],
            differing: SettingSet::NONE,
            mended: false,
            unwritable: false,
        }
    }

    /// Reads the settings, once, and mends the copies.
    pub async fn read(&mut self) {
        for copy in &mut self.copies {
            copy.read(&mut self.flash, &mut self.buffers).await;
        }
        if self.is_to_be_mended() {
            // If this fails, the next change reports it.
            let _ = self.write().await;
        }
    }

    /// Gives the flash back.
    pub fn into_flash(self) -> F {
        self.flash
    }

    /// The settings in force.
    pub fn settings(&self) -> Settings {
        self.record.snapshot.settings
    }

    /// The actuator's response, if one was stored.
    pub fn response(&self) -> Option<Response> {
        self.record.snapshot.response
    }

    /// State of the settings.
    pub fn state(&self) -> SettingsState {
        SettingsState {
            set: self.record.snapshot.set,
            lost: self.record.snapshot.lost,
            differing: self.differing,
            mended: self.mended,
            unwritable: self.unwritable,
        }
    }

    /// Changes one setting, in flash first.
    ///
    /// # Errors
    /// The value is out of the setting's range, or the flash fails. The settings in force stay.
    pub async fn set(&mut self, change: SettingChange) -> Result<Settings, SettingsError> {
        self.set_all(&[change]).await
    }

    /// Changes settings, in flash first, by one record: all of them or none.
    ///
    /// # Errors
    /// A value is out of its setting's range, or the flash fails. The settings in force stay.
    pub async fn set_all(&mut self, changes: &[SettingChange]) -> Result<Settings, SettingsError> {
        for change in changes {
            change.setting.check(change.value)?;
        }
        let before = self.record.snapshot;
        let changed = (changes.iter()).fold(before, |snapshot, &change| snapshot.with(change));
        self.draft = self.next(&changed);
        self.write().await?;
        for change in changes {
            self.differing = self.differing.with(change.setting, false);
        }
        Ok(self.settings())
    }

    /// Stores `response` and the setting that belongs to it, by one record, or removes the response.
    ///
    /// # Errors
    /// The flash fails. What is in force stays.
    pub async fn set_response(&mut self, response: Option<&Response>) -> Result<(), SettingsError> {
        let changed = self.record.snapshot.with_response(response);
        self.draft = self.next(&changed);
        self.write().await?;
        if let Some(response) = response {
            self.differing = self.differing.with(response.change().setting, false);
        }
        Ok(())
    }

    /// Erases both copies and begins anew: every setting has its default and none is set.
    ///
    /// # Errors
    /// The flash fails. Every setting then has its default, and none is set, until a restart.
    pub async fn reset(&mut self) -> Result<Settings, SettingsError> {
        self.draft = self.next(&Snapshot::NEVER_SET);
        self.record = self.draft;
        self.differing = SettingSet::NONE;
        self.mended = false;
        self.unwritable = false;
        for index in [self.spare, 1 - self.spare] {
            if self.erase(index).await && self.append(index).await {
                self.spare = 1 - index;
            } else {
                self.unwritable = true;
            }
        }
        if self.unwritable {
            return Err(NOT_WRITTEN);
        }
        self.spare = 0;
        Ok(self.settings())
    }

    /// Decides which settings are in force. Returns true if both copies are to be written anew.
    fn is_to_be_mended(&mut self) -> bool {
        match judge(&self.copies) {
            Found::NeverSet => return false,
            Found::Lost => self.record.snapshot = Snapshot::lost(),
            Found::Same(record) => self.record = record,
            Found::Mendable {
                record,
                differing,
                spare,
            } => {
                self.record = record;
                self.differing = differing;
                self.mended = true;
                self.spare = spare;
                self.erase_remnants();
                // With its number, so that the other copy is no further behind after another cut.
                self.draft = record;
            }
        }
        self.mended
    }

    /// Has each copy erased before it is written that has not kept the last two changes. The cut of its erasure may
    /// have left words that read as blank now; behind a record they would later count as a damaged one.
    fn erase_remnants(&mut self) {
        let last = self.record.sequence;
        for copy in &mut self.copies {
            // Of a copy that was never written, the first change is behind by one.
            let own = copy.newest.map_or(0, |record| record.sequence);
            if last.wrapping_sub(own) > 1 {
                copy.count_as_full();
            }
        }
    }

    /// Writes the draft to both copies, beginning with the spare one; it is in force then.
    async fn write(&mut self) -> Result<(), SettingsError> {
        let first = self.spare;
        for index in [first, 1 - first] {
            if !self.has_or_makes_room(index).await || !self.append(index).await {
                self.unwritable = true;
                if index != first {
                    self.go_back(first).await;
                }
                return Err(NOT_WRITTEN);
            }
            // This one keeps what is in force from now on.
            self.spare = 1 - index;
        }
        self.record = self.draft;
        self.unwritable = false;
        self.spare = 0;
        Ok(())
    }

    /// Writes what is in force again to the copy at `first`, which has the draft, so that a restart finds it. It keeps
    /// the draft's number, because a copy's last record counts, and the other copy must stay one change behind.
    async fn go_back(&mut self, first: usize) {
        let is_same = self.draft.snapshot == self.record.snapshot;
        self.draft.snapshot = self.record.snapshot;
        self.record = self.draft;
        if !is_same {
            self.append(first).await;
        }
    }

    /// Erases the copy at `index` if it has no room for a record. False if the flash fails.
    async fn has_or_makes_room(&mut self, index: usize) -> bool {
        self.copies[index].has_room() || self.erase(index).await
    }

    async fn erase(&mut self, index: usize) -> bool {
        self.copies[index].erase(&mut self.flash).await
    }

    /// Writes the draft to the copy at `index`.
    async fn append(&mut self, index: usize) -> bool {
        let copy = &mut self.copies[index];
        copy.append(&mut self.flash, &self.draft, &mut self.buffers)
            .await
    }

    fn next(&self, snapshot: &Snapshot) -> Record {
        Record {
            sequence: self.record.sequence.wrapping_add(1),
            snapshot: *snapshot,
        }
    }
}

/// State of a store that was never written.
const NEVER_SET: Record = Record {
    sequence: 0,
    snapshot: Snapshot::NEVER_SET,
};

const NOT_WRITTEN: SettingsError = SettingsError::Flash {
    operation: FlashOperation::Write,
};

/// Settings that both copies together show.
enum Found {
    /// Nothing was ever written.
    NeverSet,
    /// Both copies agree.
    Same(Record),
    /// The copies are to be written anew with this record.
    Mendable {
        record: Record,
        /// Settings of it that differed.
        differing: SettingSet,
        /// Number of the copy to write first.
        spare: usize,
    },
    /// Nothing can be read.
    Lost,
}

/// Returns true if `newer` has another response than `older`: a calibration whose storing was cut off.
fn is_interrupted(newer: &Snapshot, older: &Snapshot) -> bool {
    newer.response.is_some() && newer.response != older.response
}

fn judge(contents: &[Copy; 2]) -> Found {
    let [first, second] = contents;
    let mendable = |record, differing, spare| Found::Mendable {
        record,
        differing,
        spare,
    };
    let (newest, record) = match (first.newest, second.newest) {
        (None, None) if first.is_blank() && second.is_blank() => return Found::NeverSet,
        // The first copy is written first, also by mending, so cuts during the first change leave the second one blank.
        (None, None) if second.is_blank() && first.damaged <= MOST_FIRST_CUTS => {
            return mendable(NEVER_SET, SettingSet::NONE, 0);
        }
        (None, None) => return Found::Lost,
        (Some(record), None) => (0, record),
        (None, Some(record)) => (1, record),
        (Some(one), Some(other)) => {
            // The number may wrap.
            let ahead = one.sequence.wrapping_sub(other.sequence) as i32;
            if ahead > 0 || (ahead == 0 && !second.is_clean()) {
                (0, one)
            } else {
                (1, other)
            }
        }
    };
    let is_clean = contents[newest].is_clean();
    let older = &contents[1 - newest];
    match older.newest.filter(|_| older.is_clean()) {
        Some(other) if is_clean && other == record => {
            match contents.iter().position(|copy| copy.is_uncertain) {
                Some(uncertain) => mendable(record, SettingSet::NONE, uncertain),
                None => Found::Same(record),
            }
        }
        // A change was cut. The second copy shows that none counted after it. It stays whole until the first one is: a
        // cut may have left a word of the newer record that reads right now and wrongly at the next start. An erasure
        // that was cut may have left such words of the second one, which is then the first to be written anew.
        Some(other) if newest == 0 && record.sequence == other.sequence.wrapping_add(1) => {
            let (snapshot, differing) = if is_interrupted(&record.snapshot, &other.snapshot) {
                (other.snapshot, SettingSet::NONE)
            } else {
                record.snapshot.tightened(&other.snapshot)
            };
            let spare = usize::from(older.is_uncertain && is_clean);
            mendable(Record { snapshot, ..record }, differing, spare)
        }
        _ if is_clean => mendable(record, SettingSet::NONE, 1 - newest),
        // Both copies may have held a later change.
        _ => {
            let snapshot = record.snapshot.without_limits();
            mendable(Record { snapshot, ..record }, SettingSet::NONE, 1 - newest)
        }
    }
}
