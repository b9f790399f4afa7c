//! Settings in flash: two copies, each a log of records of all settings. A change is appended, so a sector is erased
//! only once in some 250 changes. The actuator's response is part of the record, so that it and the settings that
//! belong to it change together.
//!
//! A change is written to the first copy and read back, then to the second copy. It counts when both hold it. So one
//! copy always holds the last change that was acknowledged, whenever power is lost and whichever word of a copy is
//! lost. For the same reason a full copy is erased only while the other copy keeps what is in force. If power is lost
//! during an erasure, any older record of the copy may remain as its last one. The number of that record shows that it
//! is not the previous change. A record holds all settings under one checksum. In a map of single values, a damaged
//! value would be replaced by an older one, which may be a weaker limit. A record of an image with other settings or
//! ranges counts as damaged.
//!
//! At the start:
//!
//! | found | in force |
//! |---|---|
//! | both copies end with the same record | that record |
//! | the first one is one change ahead | its record, with the tighter value of each limit |
//! | the same, and with another response | the second one's: an interrupted calibration changes nothing |
//! | one ends with a record, and the other one is damaged at its end or further behind | that record |
//! | otherwise, the newer one is damaged behind its last record | nothing plays: every limit is lost |
//! | the first has a few damaged places only, and the second is blank | defaults: the first change of all was cut |
//! | neither is readable otherwise, unless both are blank | nothing plays: everything is lost |
//!
//! In all cases except the first and the last, both copies are then written again; in the first case, only if a copy
//! reads differently from read to read. What is lost stays lost, over restarts, until it is set again or all settings
//! are reset.

mod copy;
mod record;

use core::ops::Range;

use embedded_storage_async::nor_flash::NorFlash;
use model_format::link::{FlashOperation, Response, SettingChange, SettingSet, Settings, SettingsError, SettingsState};

use copy::{Buffers, Copy};
use record::{RECORD_BYTES, Record, Snapshot};

/// Range of the settings, bytes from the start of bank 1: its last two sectors of 128 KB, one per copy. The code ends
/// before them.
///
/// While one of them is erased or written, code of the same bank stalls; the tick runs from ITCM and does not.
pub const SETTINGS_RANGE: Range<u32> = 0x000c_0000..0x0010_0000;

/// Largest number of damaged places at the beginning of the first copy that count as left by losses of power during the
/// very first change. Each start that is cut while it writes this change again adds one.
const MOST_FIRST_CUTS: usize = 8;

/// Settings in flash and in memory.
pub struct SettingsStore<F: NorFlash> {
    flash: F,
    copies: [Copy; 2],
    /// Index of the copy that is written and erased first: the first copy, unless the second one has to be mended. The
    /// other copy keeps what is in force meanwhile.
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

    /// A store that [`SettingsStore::read`] is to read later, in its place, because the store takes some kilobytes.
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
        // All are checked first: `Snapshot::with` keeps a value in place of one out of range, and reports nothing.
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

    /// Erases both copies and begins again: every setting has its default and none is set.
    ///
    /// # Errors
    /// The flash fails. Every setting then has its default, and none is set, until a restart.
    pub async fn reset(&mut self) -> Result<Settings, SettingsError> {
        self.draft = self.next(&Snapshot::NEVER_SET);
        // In force at once, also if the flash fails: what could not be erased does not play.
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

    /// Decides which settings are in force. Returns true if both copies must be written again.
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
                // The draft keeps the record's number, so that the other copy is no further behind after another loss
                // of power.
                self.draft = record;
            }
        }
        self.mended
    }

    /// Makes each copy that holds neither of the last two changes count as full, so that it is erased before it is
    /// written. An interrupted erasure may have left words in it that read as blank now, and that would count as
    /// damaged behind a later record.
    fn erase_remnants(&mut self) {
        let last = self.record.sequence;
        for copy in &mut self.copies {
            // A copy that was never written counts as number 0, which is one behind the first change.
            let own = copy.newest.map_or(0, |record| record.sequence);
            if last.wrapping_sub(own) > 1 {
                copy.count_as_full();
            }
        }
    }

    /// Writes the draft to both copies, beginning with the spare one. Then the draft is in force.
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
            // From now on this copy keeps what is in force.
            self.spare = 1 - index;
        }
        self.record = self.draft;
        self.unwritable = false;
        self.spare = 0;
        Ok(())
    }

    /// Writes what is in force again to the copy at `first`, which has the draft, so that a restart finds what is in
    /// force. The new record keeps the draft's number, because a copy's last record counts, and the other copy must
    /// stay one change behind.
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
        copy.append(&mut self.flash, &self.draft, &mut self.buffers).await
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

/// What the two copies together show.
enum Found {
    /// Nothing was ever written.
    NeverSet,
    /// Both copies agree.
    Same(Record),
    /// The copies must be written again with this record.
    Mendable {
        record: Record,
        /// Settings of the record that differed between the copies.
        differing: SettingSet,
        /// Index of the copy to write first.
        spare: usize,
    },
    /// Nothing can be read.
    Lost,
}

/// Returns true if `newer` has another response than `older`: the storing of a calibration was interrupted.
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
        // Mending, too, writes the first copy first, so losses of power during the first change leave the second copy
        // blank.
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
        Some(other) if is_clean && other == record => match contents.iter().position(|copy| copy.is_uncertain) {
            Some(uncertain) => mendable(record, SettingSet::NONE, uncertain),
            None => Found::Same(record),
        },
        // Power was lost during a change. The second copy shows that no later change counted. It stays as it is until
        // the first copy is whole, because the newer record may have a word that reads right now and wrongly at the
        // next start. If an interrupted erasure has left such words in the second copy, that copy is written first.
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
