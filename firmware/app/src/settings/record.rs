//! Record of all settings in flash, and of the actuator's response: sixteen flash words with one checksum over all of
//! them, so that a response and the settings that belong to it are stored together or not at all.

use crc::{CRC_32_ISO_HDLC, Crc};
use model_format::link::{RESPONSE_BYTES, Response, Setting, SettingChange, SettingSet, Settings, Tighter};

use crate::flash::WORD_BYTES;

/// Length of a record, in whole flash words.
pub const RECORD_BYTES: usize = 16 * WORD_BYTES;

const MAGIC: [u8; 4] = *b"HTXD";
static CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// Offset of the number of settings: behind magic, sequence, set and lost, each of four bytes.
const COUNT: usize = 16;
/// Offset of the values.
const VALUES: usize = COUNT + 4;
/// Offset of the checksum, at the record's end.
const CHECKSUM: usize = RECORD_BYTES - 4;
/// Offset of the response. Before it lies room for more settings, then a word that is 1 if there is a response.
const RESPONSE: usize = CHECKSUM - RESPONSE_BYTES;
const HAS_RESPONSE: usize = RESPONSE - 4;
/// Largest number of settings that fit in a record.
const ROOM: usize = (HAS_RESPONSE - VALUES) / 4;

const _: () = assert!(Setting::ALL.len() <= ROOM);

/// All settings, with those that were set and those that were lost, and the actuator's response.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Snapshot {
    pub settings: Settings,
    /// Settings that somebody has set, and whose value was not lost since.
    pub set: SettingSet,
    /// Settings whose last value was lost.
    pub lost: SettingSet,
    pub response: Option<Response>,
}

/// A snapshot and its sequence number, which rises by one per change.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Record {
    pub sequence: u32,
    pub snapshot: Snapshot,
}

/// Content of the place of a record.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(
    clippy::large_enum_variant,
    reason = "there is no allocator, and a place lives for one judgement"
)]
pub enum Place {
    /// All ones: nothing was written.
    Blank,
    /// A record with a right checksum.
    Record(Record),
    /// Anything else.
    Damaged,
}

impl Snapshot {
    /// Default settings, none of which was set.
    pub const NEVER_SET: Self = Self {
        settings: Settings::DEFAULT,
        set: SettingSet::NONE,
        lost: SettingSet::NONE,
        response: None,
    };

    /// Settings about which nothing is known any more.
    pub fn lost() -> Self {
        Self {
            lost: SettingSet::ALL,
            ..Self::NEVER_SET
        }
    }

    /// This snapshot with one setting changed, which then counts as set and no longer as lost. The value must be in the
    /// setting's range.
    pub fn with(self, change: SettingChange) -> Self {
        Self {
            settings: self.settings.with(change).unwrap_or(self.settings),
            set: self.set.with(change.setting, true),
            lost: self.lost.with(change.setting, false),
            ..self
        }
    }

    /// This snapshot with `response` in place of its own, and with the setting that is stored with `response`. `None`
    /// removes the response.
    pub fn with_response(self, response: Option<&Response>) -> Self {
        let set = response.map_or(self, |response| self.with(response.change()));
        Self {
            response: response.copied(),
            ..set
        }
    }

    /// This snapshot with every limit lost, because a later snapshot with other limits was lost.
    pub fn without_limits(self) -> Self {
        let limits = limits();
        Self {
            set: self.set.without(limits),
            lost: self.lost.or(limits),
            ..self
        }
    }

    /// This snapshot with the tighter value of each limit that differs in `older`, and the set of these limits.
    ///
    /// A limit that only one of the two snapshots has set counts as not set.
    pub fn tightened(self, older: &Self) -> (Self, SettingSet) {
        let mut result = self;
        let mut differing = SettingSet::NONE;
        for (setting, tighter) in setting_limits() {
            let values = [self, *older].map(|snapshot| snapshot.settings.get(setting));
            let sets = [self, *older].map(|snapshot| snapshot.set.contains(setting));
            if values[0] == values[1] && sets[0] == sets[1] {
                continue;
            }
            let value = tighter.of(values[0], values[1]);
            let change = SettingChange { setting, value };
            result.settings = result.settings.with(change).unwrap_or(result.settings);
            result.set = result.set.with(setting, sets[0] && sets[1]);
            differing = differing.with(setting, true);
        }
        result.lost = self.lost.or(older.lost.and(limits()));
        (result, differing)
    }
}

/// The settings that limit the output, each with the direction in which it is tighter.
fn setting_limits() -> impl Iterator<Item = (Setting, Tighter)> {
    Setting::ALL
        .into_iter()
        .filter_map(|setting| setting.tighter().map(|tighter| (setting, tighter)))
}

fn limits() -> SettingSet {
    setting_limits().fold(SettingSet::NONE, |set, (setting, _)| set.with(setting, true))
}

impl Record {
    /// The record's bytes.
    pub fn bytes(&self) -> [u8; RECORD_BYTES] {
        let Snapshot {
            settings,
            set,
            lost,
            response,
        } = &self.snapshot;
        let count = Setting::ALL.len() as u32;
        let mut bytes = [0; RECORD_BYTES];
        bytes[..4].copy_from_slice(&MAGIC);
        for (word, value) in bytes[4..]
            .chunks_exact_mut(4)
            .zip([self.sequence, set.bits(), lost.bits(), count])
        {
            word.copy_from_slice(&value.to_le_bytes());
        }
        for (word, change) in bytes[VALUES..].chunks_exact_mut(4).zip(settings.iter()) {
            word.copy_from_slice(&change.value.to_le_bytes());
        }
        if let Some(response) = response {
            bytes[HAS_RESPONSE] = 1;
            bytes[RESPONSE..CHECKSUM].copy_from_slice(&response.bytes());
        }
        let crc = CRC.checksum(&bytes[..CHECKSUM]);
        bytes[CHECKSUM..].copy_from_slice(&crc.to_le_bytes());
        bytes
    }

    /// The record in `bytes`; none unless magic and checksum are right, it has as many settings as this image, and each
    /// value is in its range.
    fn read(bytes: &[u8; RECORD_BYTES]) -> Option<Self> {
        let word = |at: usize| bytes[at..].first_chunk().copied().unwrap_or_default();
        let number = |at: usize| u32::from_le_bytes(word(at));
        let is_known = bytes[..4] == MAGIC
            && number(CHECKSUM) == CRC.checksum(&bytes[..CHECKSUM])
            && number(COUNT) as usize == Setting::ALL.len();
        let value = |index| f32::from_le_bytes(word(VALUES + 4 * index));
        let settings = Settings::try_from(core::array::from_fn(value)).ok();
        let has_response = bytes[HAS_RESPONSE] == 1;
        let response = bytes[RESPONSE..].first_chunk();
        Some(Self {
            sequence: number(4),
            snapshot: Snapshot {
                settings: settings.filter(|_| is_known)?,
                set: SettingSet::from_bits(number(8)),
                lost: SettingSet::from_bits(number(12)),
                response: response.filter(|_| has_response).map(Response::from_bytes),
            },
        })
    }
}

impl Place {
    /// The content of `bytes`.
    pub fn read(bytes: &[u8; RECORD_BYTES]) -> Self {
        if is_blank(bytes) {
            return Self::Blank;
        }
        Record::read(bytes).map_or(Self::Damaged, Self::Record)
    }
}

/// Returns true if nothing was written.
pub fn is_blank(bytes: &[u8]) -> bool {
    bytes.iter().all(|&byte| byte == 0xff)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn record(sequence: u32, set: u32, lost: u32, share: f32) -> Record {
        let mut settings = Settings::default();
        for setting in Setting::ALL {
            let spec = setting.spec();
            let value = spec.lowest + (spec.highest - spec.lowest) * share;
            let value = if spec.whole { value.trunc() } else { value };
            // A scale has no value near 0.
            let value = if value.abs() < spec.least_magnitude {
                spec.least_magnitude
            } else {
                value
            };
            let change = SettingChange { setting, value };
            settings = settings.with(change).expect("it is in range");
        }
        let snapshot = Snapshot {
            settings,
            set: SettingSet::from_bits(set),
            lost: SettingSet::from_bits(lost),
            response: (share > 0.5).then(|| Response::from_bytes(&[(share * 255.0) as u8; _])),
        };
        Record { sequence, snapshot }
    }

    proptest! {
        #[test]
        fn a_record_comes_back_and_a_changed_bit_is_seen(
            sequence: u32, set: u32, lost: u32, share in 0.0..1.0f32, bit in 0..RECORD_BYTES * 8,
        ) {
            let record = record(sequence, set, lost, share);
            let mut bytes = record.bytes();
            prop_assert_eq!(Place::read(&bytes), Place::Record(record));
            bytes[bit / 8] ^= 1 << (bit % 8);
            prop_assert_eq!(Place::read(&bytes), Place::Damaged);
        }

        #[test]
        fn of_two_snapshots_each_limit_is_the_tighter_one(
            sets: [u32; 2], shares in [0.0..1.0f32, 0.0..1.0f32],
        ) {
            let [newer, older] = [0, 1].map(|n| record(1, sets[n], 0, shares[n]).snapshot);
            let (tight, differing) = newer.tightened(&older);
            for setting in Setting::ALL {
                let [a, b, t] = [newer, older, tight].map(|snapshot| snapshot.settings.get(setting));
                let both = newer.set.contains(setting) && older.set.contains(setting);
                match setting.tighter() {
                    Some(Tighter::Lower) => prop_assert_eq!(t, a.min(b)),
                    Some(Tighter::Higher) => prop_assert_eq!(t, a.max(b)),
                    None => prop_assert_eq!(t, a),
                }
                if setting.tighter().is_some() {
                    prop_assert_eq!(tight.set.contains(setting), both);
                    let differs = a != b || newer.set.contains(setting) != older.set.contains(setting);
                    prop_assert_eq!(differing.contains(setting), differs);
                }
            }
        }
    }
}
