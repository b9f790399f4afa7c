//! Settings in flash: each has its own key in a sequential-storage map, so that a change is appended, and a sector is
//! erased only once in a thousand changes.
//!
//! A word that faults when it is read, as after a power cut, reads as zeros here. The map's checksums then drop it, and
//! the value before holds.

use core::ops::Range;

use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use model_format::link::{FlashOperation, Setting, SettingChange, Settings, SettingsError};
use sequential_storage::Error;
use sequential_storage::cache::{Cache, Uncached};
use sequential_storage::map::{MapConfig, MapStorage};

use crate::flash::WORD_BYTES;

/// Range of the settings, bytes from the start of bank 1: its last two sectors of 128 KB. The code ends before them.
///
/// While one of them is erased or written, code of the same bank stalls; the tick runs from ITCM and does not.
pub const SETTINGS_RANGE: Range<u32> = 0x000c_0000..0x0010_0000;

/// Space for a key and a value, in whole flash words.
const BUFFER_BYTES: usize = 64;

type NoCache = Cache<Uncached, Uncached, Uncached, u8>;

/// Settings in flash and in memory.
pub struct SettingsStore<F: NorFlash> {
    map: MapStorage<u8, Tolerant<F>, NoCache>,
    settings: Settings,
    faulty: bool,
}

impl<F: NorFlash> SettingsStore<F> {
    /// Reads the settings in `range` of `flash`, which is two whole sectors or more. A setting that is missing,
    /// unreadable or out of its range has its default.
    ///
    /// # Panics
    /// The range is not of whole sectors, or of less than two.
    pub async fn open(flash: F, range: Range<u32>) -> Self {
        let config = MapConfig::new(range);
        let mut store = Self {
            map: MapStorage::new(
                Tolerant(flash),
                config,
                Cache::new(Uncached, Uncached, Uncached),
            ),
            settings: Settings::default(),
            faulty: false,
        };
        if store.load().await.is_err() {
            store.start_anew().await;
        }
        store
    }

    /// The settings in force.
    pub fn settings(&self) -> Settings {
        self.settings
    }

    /// Returns true if some content of the flash could not be used when it was read, so that defaults hold instead.
    pub fn is_faulty(&self) -> bool {
        self.faulty
    }

    /// Changes one setting, in flash first.
    ///
    /// # Errors
    /// The value is out of the setting's range, or the flash fails. The settings in force stay.
    pub async fn set(&mut self, change: SettingChange) -> Result<Settings, SettingsError> {
        let settings = self.settings.with(change)?;
        self.store(change).await?;
        self.settings = settings;
        Ok(settings)
    }

    /// Resets every setting to its default.
    ///
    /// # Errors
    /// The flash fails. Some settings then have their defaults, the others stay.
    pub async fn reset(&mut self) -> Result<Settings, SettingsError> {
        for default in Settings::default().iter() {
            if self.faulty || self.settings.get(default.setting) != default.value {
                self.store(default).await?;
                self.settings = self.settings.with(default)?;
            }
        }
        self.faulty = false;
        Ok(self.settings)
    }

    async fn load(&mut self) -> Result<(), Error<F::Error>> {
        for setting in Setting::ALL {
            let mut buffer = [0; BUFFER_BYTES];
            let value = self
                .map
                .fetch_item::<f32>(&mut buffer, &(setting as u8))
                .await?;
            let Some(value) = value else { continue };
            match self.settings.with(SettingChange { setting, value }) {
                Ok(settings) => self.settings = settings,
                // Written by a firmware with other ranges.
                Err(_) => self.faulty = true,
            }
        }
        Ok(())
    }

    /// Starts with an empty map, because the flash holds none: it was never written, or is beyond repair.
    async fn start_anew(&mut self) {
        self.settings = Settings::default();
        self.faulty = true;
        // If this fails, the next change reports it.
        let _ = self.map.erase_all().await;
    }

    async fn store(&mut self, change: SettingChange) -> Result<(), SettingsError> {
        let mut buffer = [0; BUFFER_BYTES];
        let key = change.setting as u8;
        let stored = self.map.store_item(&mut buffer, &key, &change.value).await;
        stored.map_err(|_| SettingsError::Flash {
            operation: FlashOperation::Write,
        })?;
        // The change counts only if it can be read back.
        let back = self.map.fetch_item::<f32>(&mut buffer, &key).await;
        match back {
            Ok(Some(value)) if value == change.value => Ok(()),
            _ => Err(SettingsError::Flash {
                operation: FlashOperation::Read,
            }),
        }
    }
}

/// Flash in which a word that faults reads as zeros.
struct Tolerant<F>(F);

impl<F: ErrorType> ErrorType for Tolerant<F> {
    type Error = F::Error;
}

impl<F: NorFlash> ReadNorFlash for Tolerant<F> {
    /// A whole word, so that a fault affects only its own word.
    const READ_SIZE: usize = F::WRITE_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), F::Error> {
        const {
            assert!(
                F::WRITE_SIZE <= WORD_BYTES,
                "a flash word is longer than expected"
            );
        };
        for (index, word) in bytes.chunks_mut(F::WRITE_SIZE).enumerate() {
            let at = offset + (index * F::WRITE_SIZE) as u32;
            if self.0.read(at, word).await.is_err() {
                word.fill(0);
            }
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.0.capacity()
    }
}

impl<F: NorFlash> NorFlash for Tolerant<F> {
    const WRITE_SIZE: usize = F::WRITE_SIZE;
    const ERASE_SIZE: usize = F::ERASE_SIZE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), F::Error> {
        self.0.erase(from, to).await
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), F::Error> {
        self.0.write(offset, bytes).await
    }
}
