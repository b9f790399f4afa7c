//! The functions of the header.
//!
//! Addresses that they take are NULL or lead to what their types say, and nobody closes a handle meanwhile. No other
//! symbol begins with `stylus_`.
#![expect(unsafe_code, reason = "names and addresses are another language's")]
#![expect(clippy::missing_safety_doc, reason = "the header says it of all functions at once")]

use std::ffi::c_char;
use std::fs::File;
use std::io::Read;

use model_format::Library;
use model_format::limits::MAX_LIBRARY_BYTES;
use stylus_player::{BlockMotion, Fault, Selection, SharedLibrary, Without, band_hz, latency_s};

use crate::handle::{Handle, LibraryHandle, Player, PlayerHandle, check, guarded, put, room, slice, text};
use crate::status::{self, Failure, Status, last};

/// Number of this interface. A change that old callers would notice raises it.
pub const STYLUS_PLAYER_ABI: u32 = 1;

/// Kind of what is played.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(non_camel_case_types, reason = "names of C")]
pub enum Kind {
    /// A texture, everywhere and without effects.
    STYLUS_TEXTURE = 0,
    /// A scene.
    STYLUS_SCENE = 1,
}

/// Motion of one block of 2 ms. NaN is for what is not known: both positions follow from the speed then, and contact
/// from the force.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Tangential speed, mm/s, signed by the direction.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
    /// Position at the block's first sample, mm.
    pub begin_mm: f64,
    /// Position at the block's last sample, mm.
    pub end_mm: f64,
    /// Contact: 0, or another number.
    pub contact: f64,
}

impl From<Fault> for Failure {
    fn from(fault: Fault) -> Self {
        match fault {
            // The moving side allocates nothing.
            Fault::Motion(_) => Status::STYLUS_MOTION.into(),
            Fault::Gain | Fault::Coil => Status::STYLUS_GAIN.into(),
            Fault::OutputRate(_) => Self::new(Status::STYLUS_RATE, &fault),
            Fault::Choice(_) | Fault::SampleRate(_) => Self::new(Status::STYLUS_CHOICE, &fault),
        }
    }
}

fn decoded(bytes: Vec<u8>) -> Result<*mut LibraryHandle, Failure> {
    let library = SharedLibrary::decode(bytes).map_err(|error| Failure::new(Status::STYLUS_LIBRARY, &error))?;
    Ok(Handle::open(library))
}

fn selection(kind: u32, index: usize) -> Result<Selection, Failure> {
    match kind {
        0 => Ok(Selection::Texture(index)),
        1 => Ok(Selection::Scene(index)),
        _ => Err(Failure::new(
            Status::STYLUS_CHOICE,
            &format_args!("there is no kind {kind}: give STYLUS_TEXTURE or STYLUS_SCENE"),
        )),
    }
}

/// Names of textures or scenes, in the order of the library.
fn names<'a>(library: &Library<'a>, kind: u32) -> Box<dyn Iterator<Item = String> + 'a> {
    if kind == Kind::STYLUS_TEXTURE as u32 {
        Box::new(library.textures().map(|texture| texture.name().to_owned()))
    } else {
        Box::new(library.scenes().map(|scene| scene.name.as_str().to_owned()))
    }
}

/// Writes `said` with a 0 at its end to `length` bytes at `buffer`.
unsafe fn say(said: &str, buffer: *mut c_char, length: usize) -> Result<(), Failure> {
    // SAFETY: the caller says what can be written there; a byte and a character of C are the same.
    let room = unsafe { room(buffer.cast::<u8>(), length) }?;
    let Some((end, text)) = room.get_mut(..=said.len()).and_then(<[u8]>::split_last_mut) else {
        return Err(Status::STYLUS_LENGTH.into());
    };
    text.copy_from_slice(said.as_bytes());
    *end = 0;
    Ok(())
}

/// Opens the library in a file, whose path is UTF-8, and writes its handle to `library`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stylus_library_open(path: *const c_char, library: *mut *mut LibraryHandle) -> Status {
    guarded(|| {
        // First, because a handle that cannot be handed over would never be closed.
        check(library)?;
        // SAFETY: the caller says what the addresses are.
        let path = unsafe { text(path) }?;
        let mut bytes = Vec::new();
        // One byte more than a library has, so that the decoder refuses what is longer.
        File::open(path)
            .and_then(|file| file.take(MAX_LIBRARY_BYTES as u64 + 1).read_to_end(&mut bytes))
            .map_err(|error| Failure::new(Status::STYLUS_FILE, &format_args!("{path}: {error}")))?;
        // SAFETY: the caller says what the addresses are.
        unsafe { put(library, decoded(bytes)?) }
    })
}

/// Decodes the library in `length` bytes, which it copies, and writes its handle to `library`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stylus_library_decode(
    bytes: *const u8,
    length: usize,
    library: *mut *mut LibraryHandle,
) -> Status {
    guarded(|| {
        check(library)?;
        // SAFETY: the caller says what the addresses are.
        let bytes = unsafe { slice(bytes, length) }?;
        // SAFETY: the caller says what the addresses are.
        unsafe { put(library, decoded(bytes.to_vec())?) }
    })
}

/// Closes a library. Players that play from it keep what they need. NULL is none.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stylus_library_close(library: *mut LibraryHandle) -> Status {
    guarded(|| {
        // SAFETY: the caller says what the addresses are.
        unsafe { Handle::close(library) }
    })
}

/// Writes the number of textures or scenes to `count`. `kind` is a `stylus_kind`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stylus_library_count(library: *const LibraryHandle, kind: u32, count: *mut usize) -> Status {
    guarded(|| {
        // SAFETY: the caller says what the addresses are.
        let library = unsafe { Handle::of(library) }?.library();
        let counted = match selection(kind, 0)? {
            Selection::Texture(_) => library.len(),
            Selection::Scene(_) => library.scene_count(),
        };
        // SAFETY: the caller says what the addresses are.
        unsafe { put(count, counted) }
    })
}

/// Writes the name of a texture or scene, with a 0 at its end, to `length` bytes at `name`; 64 suffice.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stylus_library_name(
    library: *const LibraryHandle,
    kind: u32,
    index: usize,
    name: *mut c_char,
    length: usize,
) -> Status {
    guarded(|| {
        // SAFETY: the caller says what the addresses are.
        let library = unsafe { Handle::of(library) }?.library();
        selection(kind, index)?;
        let found = names(&library, kind).nth(index);
        let missing = || Failure::new(Status::STYLUS_CHOICE, &format_args!("there is no number {index}"));
        // SAFETY: the caller says what the addresses are.
        unsafe { say(&found.ok_or_else(missing)?, name, length) }
    })
}

/// Writes the number of the texture or scene with a name to `index`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stylus_library_find(
    library: *const LibraryHandle,
    kind: u32,
    name: *const c_char,
    index: *mut usize,
) -> Status {
    guarded(|| {
        // SAFETY: the caller says what the addresses are.
        let library = unsafe { Handle::of(library) }?.library();
        // SAFETY: the caller says what the addresses are.
        let name = unsafe { text(name) }?;
        selection(kind, 0)?;
        let found = names(&library, kind).position(|other| other == name);
        let missing = || Failure::new(Status::STYLUS_CHOICE, &format_args!("there is no '{name}'"));
        // SAFETY: the caller says what the addresses are.
        unsafe { put(index, found.ok_or_else(missing)?) }
    })
}

/// Makes a player of an output rate, which plays nothing yet, and writes its handle to `player`.
/// Rates are multiples of 25 Hz from 1000 to 192000 Hz.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stylus_player_open(output_rate_hz: u32, player: *mut *mut PlayerHandle) -> Status {
    guarded(|| {
        check(player)?;
        let (mover, filler) = stylus_player::player(output_rate_hz)?;
        // SAFETY: the caller says what the addresses are.
        unsafe { put(player, Handle::open(Player::new(mover, filler))) }
    })
}

/// The same without the DC blocker: at a texture's own rate, samples are those of `stylus render`, to the bit. Not for
/// an amplifier that passes a steady voltage on.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stylus_player_open_as_rendered(output_rate_hz: u32, player: *mut *mut PlayerHandle) -> Status {
    guarded(|| {
        check(player)?;
        let (mover, filler) = stylus_player::player_as_rendered(output_rate_hz)?;
        // SAFETY: the caller says what the addresses are.
        unsafe { put(player, Handle::open(Player::new(mover, filler))) }
    })
}

/// Closes a player. No thread may move any more, or begin to fill; while one fills, `STYLUS_BUSY` is returned and the
/// player stays open. NULL is none.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stylus_player_close(player: *mut PlayerHandle) -> Status {
    guarded(|| {
        // SAFETY: the caller says what the addresses are.
        unsafe { Handle::close(player) }
    })
}

/// Plays a texture or scene with the noise of `seed`, as soon as what sounds has faded. From any thread; it allocates.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stylus_player_choose(
    player: *const PlayerHandle,
    library: *const LibraryHandle,
    kind: u32,
    index: usize,
    seed: u64,
) -> Status {
    guarded(|| {
        // SAFETY: the caller says what the addresses are.
        let player = unsafe { Handle::of(player) }?;
        // SAFETY: the caller says what the addresses are.
        let library = unsafe { Handle::of(library) }?;
        let selection = selection(kind, index)?;
        Ok(player.mover.choose(library, selection, Without::default(), seed)?)
    })
}

/// Lets what sounds fade, and plays nothing until the next choice. From any thread; it allocates.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stylus_player_stop(player: *const PlayerHandle) -> Status {
    guarded(|| {
        // SAFETY: the caller says what the addresses are.
        unsafe { Handle::of(player) }?.mover.stop();
        Ok(())
    })
}

/// Moves at a speed, signed by the direction, with a force; held for 50 ms and the length of a buffer. From any
/// thread, without waiting.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stylus_player_move(player: *const PlayerHandle, speed_mm_s: f64, force_n: f64) -> Status {
    guarded(|| {
        // SAFETY: the caller says what the addresses are.
        Ok(unsafe { Handle::of(player) }?.mover.rub(speed_mm_s, force_n)?)
    })
}

/// Moves to a position with a force at a time of the caller's clock; the speed is that from the position before.
/// From any thread, without waiting.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stylus_player_reach(
    player: *const PlayerHandle,
    time_s: f64,
    position_mm: f64,
    force_n: f64,
) -> Status {
    guarded(|| {
        // SAFETY: the caller says what the addresses are.
        Ok(unsafe { Handle::of(player) }?
            .mover
            .reach(time_s, position_mm, force_n)?)
    })
}

/// Moves as `motion` says in the next block, and on at its speed. From any thread, without waiting.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stylus_player_follow(player: *const PlayerHandle, motion: *const Motion) -> Status {
    guarded(|| {
        // SAFETY: the caller says what the addresses are.
        let player = unsafe { Handle::of(player) }?;
        // SAFETY: the caller says what the addresses are.
        let [motion] = unsafe { slice(motion, 1) }? else {
            return Err(Status::STYLUS_LENGTH.into());
        };
        let Motion {
            speed_mm_s,
            force_n,
            begin_mm,
            end_mm,
            contact,
        } = *motion;
        let motion = BlockMotion {
            speed_mm_s,
            force_n,
            begin_mm,
            end_mm,
            contact,
        };
        Ok(player.mover.follow(motion)?)
    })
}

/// Multiplies what is played, m/s2, by `gain`, and clamps it to `limit` on either side. The gain changes over 2 ms,
/// the limit at once. From any thread, without waiting.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stylus_player_set_gain(player: *const PlayerHandle, gain: f32, limit: f32) -> Status {
    guarded(|| {
        // SAFETY: the caller says what the addresses are.
        Ok(unsafe { Handle::of(player) }?.mover.set_gain(gain, limit)?)
    })
}

/// Protects a coil, for as long as the player lives, by its resistance, the volts for each m/s2, and its lasting power.
/// The volts become the gain, and the output is the coil's voltage. It is then at most four times that at this power,
/// reaches it in 0.4 ms or more, and is attenuated before its mean power over 10 s exceeds the limit. Behind an
/// amplifier of gain a, give ohms / a^2 and volts / a. From any thread, without waiting.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stylus_player_set_coil(
    player: *const PlayerHandle,
    ohms: f32,
    volts_per_m_s2: f32,
    watts: f32,
) -> Status {
    guarded(|| {
        // SAFETY: the caller says what the addresses are.
        let player = unsafe { Handle::of(player) }?;
        Ok(player.mover.set_coil(ohms, volts_per_m_s2, watts)?)
    })
}

/// Plays the next `length` samples into `samples`. Only one thread at a time may call the function: another gets
/// `STYLUS_BUSY`. The call allocates nothing, takes no lock and makes no system call. Its time per sample is bounded.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stylus_player_fill(player: *const PlayerHandle, samples: *mut f32, length: usize) -> Status {
    guarded(|| {
        // SAFETY: the caller says what the addresses are.
        let player = unsafe { Handle::of(player) }?;
        // SAFETY: the caller says what the addresses are.
        player.fill(unsafe { room(samples, length) }?)
    })
}

/// Checks both rates, and writes what `of` says of them to `number`.
unsafe fn told(of: fn(u32, u32) -> f64, rates_hz: (u32, u32), number: *mut f64) -> Status {
    guarded(|| {
        // A player is made only because it checks the rate.
        stylus_player::player(rates_hz.1)?;
        if ![5000, 10_000].contains(&rates_hz.0) {
            return Err(Fault::SampleRate(rates_hz.0).into());
        }
        // SAFETY: the caller says what the addresses are.
        unsafe { put(number, of(rates_hz.0, rates_hz.1)) }
    })
}

/// Writes the time from a move to the middle of the change that it makes, s, to `seconds`, for a texture at
/// `sample_rate_hz`, 5000 or 10000. It is at most so much in the mean, and 1 ms more for a move just after a block
/// began.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stylus_player_latency(sample_rate_hz: u32, output_rate_hz: u32, seconds: *mut f64) -> Status {
    // SAFETY: the caller says what the addresses are.
    unsafe { told(latency_s, (sample_rate_hz, output_rate_hz), seconds) }
}

/// Writes the band, Hz, of a texture at `sample_rate_hz`, 5000 or 10000, that an output rate has left to `hz`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stylus_player_band(sample_rate_hz: u32, output_rate_hz: u32, hz: *mut f64) -> Status {
    // SAFETY: the caller says what the addresses are.
    unsafe { told(band_hz, (sample_rate_hz, output_rate_hz), hz) }
}

/// Writes the text of this thread's last failure, with a 0 at its end, to `length` bytes at `buffer`. It is empty if
/// the status of that failure says all.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn stylus_last_text(buffer: *mut c_char, length: usize) -> Status {
    guarded(|| {
        // SAFETY: the caller says what the addresses are.
        let told = last(|said| unsafe { say(said, buffer, length) });
        // A buffer that is too short leaves the text for a longer one.
        told.map_err(|Failure(status, _)| Failure::new(status, &last(str::to_owned)))
    })
}

/// Meaning of a status: a text that stays. An unknown status has one too.
#[unsafe(no_mangle)]
pub extern "C" fn stylus_status_text(status: i32) -> *const c_char {
    status::text(status).as_ptr()
}

/// Number of this interface: STYLUS_PLAYER_ABI of the header that it was built with.
#[unsafe(no_mangle)]
pub extern "C" fn stylus_player_abi() -> u32 {
    STYLUS_PLAYER_ABI
}
