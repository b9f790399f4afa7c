//! Refusals of calls, and what they leave as it was.

use std::ffi::{CStr, CString, c_char};
use std::ptr::{null, null_mut};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use kernel_vectors::digest_library;
use stylusplayer::*;

/// A handle that is closed at the end.
pub struct Opened<T>(*mut T, unsafe extern "C" fn(*mut T) -> Status);

// SAFETY: calls may come from any thread.
unsafe impl<T> Sync for Opened<T> {}

impl<T> Opened<T> {
    pub fn handle(&self) -> *mut T {
        self.0
    }
}

impl Opened<LibraryHandle> {
    pub fn library() -> Self {
        let (bytes, mut library) = (digest_library(), null_mut());
        // SAFETY: the bytes are there, and the handle is.
        let status = unsafe { stylus_library_decode(bytes.as_ptr(), bytes.len(), &raw mut library) };
        assert_eq!(status, Status::STYLUS_OK);
        Self(library, stylus_library_close)
    }
}

impl Opened<PlayerHandle> {
    pub fn player(rate_hz: u32) -> Self {
        let mut player = null_mut();
        // SAFETY: the handle is there.
        let status = unsafe { stylus_player_open(rate_hz, &raw mut player) };
        assert_eq!(status, Status::STYLUS_OK);
        Self(player, stylus_player_close)
    }

    pub fn choose(&self, library: &Opened<LibraryHandle>, index: usize) {
        // SAFETY: both are open.
        let status = unsafe { stylus_player_choose(self.0, library.handle(), 0, index, 1) };
        assert_eq!(status, Status::STYLUS_OK);
    }
}

impl<T> Drop for Opened<T> {
    fn drop(&mut self) {
        // SAFETY: it is open, and nobody else has it.
        assert_eq!(unsafe { (self.1)(self.0) }, Status::STYLUS_OK);
    }
}

fn last_text() -> String {
    let mut text = [0 as c_char; 512];
    // SAFETY: there is room, and the text ends with a 0.
    unsafe {
        assert_eq!(stylus_last_text(text.as_mut_ptr(), text.len()), Status::STYLUS_OK);
        CStr::from_ptr(text.as_ptr()).to_str().expect("it is UTF-8").to_owned()
    }
}

#[test]
fn null_a_closed_handle_one_of_another_kind_and_an_odd_address_are_told() {
    let (library, player) = (Opened::library(), Opened::player(5000));
    let mut samples = [1.0f32; 8];
    let odd = |samples: &mut [f32]| samples.as_mut_ptr().wrapping_byte_add(1);
    // SAFETY: what is no handle is memory that can be read as one, or is refused before it is read.
    unsafe {
        let fill = |player: *const PlayerHandle, samples: *mut f32, length| stylus_player_fill(player, samples, length);
        assert_eq!(fill(null(), samples.as_mut_ptr(), 8), Status::STYLUS_NULL);
        assert_eq!(fill(player.handle(), null_mut(), 8), Status::STYLUS_NULL);
        assert_eq!(fill(player.handle(), null_mut(), 0), Status::STYLUS_OK);
        assert_eq!(fill(player.handle(), odd(&mut samples), 1), Status::STYLUS_ALIGNMENT);
        assert_eq!(
            fill(player.handle(), samples.as_mut_ptr(), usize::MAX),
            Status::STYLUS_LENGTH
        );
        assert_eq!(
            fill(library.handle().cast(), samples.as_mut_ptr(), 8),
            Status::STYLUS_HANDLE
        );
        let inside = player.handle().wrapping_byte_add(4);
        assert_eq!(fill(inside, samples.as_mut_ptr(), 8), Status::STYLUS_ALIGNMENT);
        assert_eq!(
            stylus_player_choose(player.handle(), player.handle().cast(), 0, 0, 1),
            Status::STYLUS_HANDLE
        );
        assert_eq!(
            stylus_player_choose(player.handle(), null(), 0, 0, 1),
            Status::STYLUS_NULL
        );
        assert_eq!(stylus_player_follow(player.handle(), null()), Status::STYLUS_NULL);
        assert_eq!(stylus_player_open(5000, null_mut()), Status::STYLUS_NULL);
        assert_eq!(stylus_library_open(null(), null_mut()), Status::STYLUS_NULL);
        assert_eq!(stylus_player_close(null_mut()), Status::STYLUS_OK);
        assert_eq!(stylus_library_close(player.handle().cast()), Status::STYLUS_HANDLE);
        // A closed handle, in memory that still can be read.
        let mut closed = vec![0u64; 4096];
        assert_eq!(
            fill(closed.as_mut_ptr().cast(), samples.as_mut_ptr(), 8),
            Status::STYLUS_HANDLE
        );
    }
    assert_eq!(samples, [1.0; 8], "nothing was written");
}

/// Checks the status of a call, and that the last text has this word.
fn refused(status: Status, expected: Status, word: &str) {
    assert_eq!(status, expected);
    let text = last_text();
    assert!(text.contains(word), "{text}");
}

#[test]
fn what_cannot_be_is_refused_by_status_and_text() {
    let (library, player) = (Opened::library(), Opened::player(48_000));
    let (mut handle, mut other) = (null_mut(), null_mut());
    // SAFETY: handles are open, and all addresses are of this function.
    unsafe {
        let choose = |kind, index| stylus_player_choose(player.handle(), library.handle(), kind, index, 1);
        let no_texture = "there is no texture 99";
        refused(choose(0, 99), Status::STYLUS_CHOICE, no_texture);
        refused(choose(7, 0), Status::STYLUS_CHOICE, "STYLUS_SCENE");
        let status = stylus_library_open(c"no-such-file".as_ptr(), &raw mut handle);
        refused(status, Status::STYLUS_FILE, "no-such-file");
        assert_eq!(
            stylus_library_open(c"\xff".as_ptr(), &raw mut handle),
            Status::STYLUS_TEXT
        );
        assert_eq!(
            stylus_library_decode(b"text".as_ptr(), 4, &raw mut handle),
            Status::STYLUS_LIBRARY
        );
        assert!(handle.is_null());
        let status = stylus_player_open(44_101, &raw mut other);
        refused(status, Status::STYLUS_RATE, "44101");
        assert_eq!(
            stylus_player_move(player.handle(), f64::INFINITY, 1.0),
            Status::STYLUS_MOTION
        );
        assert_eq!(
            stylus_player_reach(player.handle(), 0.0, f64::NAN, 1.0),
            Status::STYLUS_MOTION
        );
        assert_eq!(stylus_player_set_gain(player.handle(), 1.0, -1.0), Status::STYLUS_GAIN);
        assert_eq!(
            stylus_player_set_coil(player.handle(), 8.0, 0.01, 0.0),
            Status::STYLUS_GAIN
        );
        assert_eq!(
            stylus_player_set_coil(player.handle(), 8.0, 0.01, 0.1),
            Status::STYLUS_OK
        );
        assert_eq!(last_text(), "", "the status says all, and the older text would mislead");
        refused(
            stylus_player_open(1, &raw mut other),
            Status::STYLUS_RATE,
            "rate of 1 Hz",
        );
        let mut short = [1 as c_char; 4];
        assert_eq!(stylus_last_text(short.as_mut_ptr(), 4), Status::STYLUS_LENGTH);
        assert_eq!(short, [1; 4]);
        assert!(last_text().contains("rate of 1 Hz"), "there is room now");
    }
}

#[test]
fn latency_and_band_are_the_players_own_and_of_a_librarys_rate() {
    let (mut seconds, mut hz) = (0.0, 0.0);
    // SAFETY: the address is of this function.
    unsafe {
        assert_eq!(stylus_player_latency(5000, 48_000, &raw mut seconds), Status::STYLUS_OK);
        assert_eq!(seconds, stylus_player::latency_s(5000, 48_000));
        assert_eq!(stylus_player_band(5000, 1000, &raw mut hz), Status::STYLUS_OK);
        assert_eq!(hz, 400.0);
        assert_eq!(
            stylus_player_latency(2000, 48_000, &raw mut seconds),
            Status::STYLUS_CHOICE
        );
    }
}

#[test]
fn names_are_found_by_number_and_numbers_by_name() {
    let library = Opened::library();
    // SAFETY: the handle is open, and all addresses are of this function.
    unsafe {
        for kind in [0, 1] {
            let mut count = usize::MAX;
            assert_eq!(
                stylus_library_count(library.handle(), kind, &raw mut count),
                Status::STYLUS_OK
            );
            assert_eq!(count, 1 - kind as usize);
            for index in 0..count {
                let (mut name, mut found) = ([0 as c_char; 64], usize::MAX);
                assert_eq!(
                    stylus_library_name(library.handle(), kind, index, name.as_mut_ptr(), 64),
                    Status::STYLUS_OK
                );
                assert_eq!(
                    stylus_library_find(library.handle(), kind, name.as_ptr(), &raw mut found),
                    Status::STYLUS_OK
                );
                assert_eq!(found, index);
            }
            let mut name = [0 as c_char; 64];
            assert_eq!(
                stylus_library_name(library.handle(), kind, count, name.as_mut_ptr(), 64),
                Status::STYLUS_CHOICE
            );
        }
        let (missing, mut index) = (CString::new("felt").expect("it has no 0"), 0);
        assert_eq!(
            stylus_library_find(library.handle(), 0, missing.as_ptr(), &raw mut index),
            Status::STYLUS_CHOICE
        );
        assert!(last_text().contains("'felt'"), "{}", last_text());
    }
}

#[test]
fn of_two_threads_that_fill_at_once_one_is_told() {
    let player = Opened::player(192_000);
    player.choose(&Opened::library(), 0);
    let fill = |length: usize| {
        let mut samples = vec![0.0f32; length];
        // SAFETY: the player is open, and the samples are there.
        unsafe { stylus_player_fill(player.handle(), samples.as_mut_ptr(), length) }
    };
    let is_told = AtomicBool::new(false);
    // Each is nearly always within a call. Ten minutes without a meeting are a fault.
    let begin = Instant::now();
    let fill_until_told = || {
        while !is_told.load(Ordering::Relaxed) && begin.elapsed() < Duration::from_mins(10) {
            match fill(100_000) {
                Status::STYLUS_BUSY => is_told.store(true, Ordering::Relaxed),
                status => assert_eq!(status, Status::STYLUS_OK),
            }
        }
    };
    std::thread::scope(|threads| {
        threads.spawn(fill_until_told);
        fill_until_told();
    });
    assert!(is_told.into_inner());
    assert_eq!(fill(1), Status::STYLUS_OK);
}

#[test]
fn every_status_has_a_text_and_an_unknown_one_too() {
    let text = |status| {
        // SAFETY: the text stays, and ends with a 0.
        let text = unsafe { CStr::from_ptr(stylus_status_text(status)) };
        text.to_str().expect("it is UTF-8")
    };
    let last = Status::STYLUS_FAULT as i32;
    assert!((0..=last).all(|status| !text(status).contains("unknown")));
    assert!(text(-1).contains("unknown") && text(last + 1).contains("unknown"));
}
