//! The exports of the module: the calls and arrays of the package's page.
//!
//! A module has one thread, and one session. Its arrays lie in a box that is made with the module's first call and
//! never moves, so that their addresses stay.

use std::cell::RefCell;

use model_format::{Library, OutputSample};
use stylus_kernel::digest::{DIGEST_SEED, DIGEST_WORDS};
use stylus_player::{BLOCK_NUMBERS, BlockMotion, Filter, Selection, Without, delay_s};

use crate::session::{Fault, MOST_BLOCKS};
use crate::session::{MOST_SAMPLES, STATE_NUMBERS, Session, motion_of_digest};

/// Room for texts, bytes.
const TEXT_BYTES: usize = 1024;

/// All that the module holds.
struct Module {
    /// Room for the library, until it is loaded.
    bytes: Vec<u8>,
    session: Option<Session<'static>>,
    motion: [[f64; BLOCK_NUMBERS]; MOST_BLOCKS],
    blocks: Vec<BlockMotion>,
    outputs: Vec<OutputSample>,
    words: Vec<i32>,
    samples: Vec<f32>,
    state: [f64; STATE_NUMBERS],
    filter: Option<Filter>,
}

thread_local! {
    static MODULE: RefCell<Box<Module>> = RefCell::new(Box::new(Module::new()));
    static TEXT: RefCell<String> = RefCell::new(String::with_capacity(TEXT_BYTES));
}

impl Module {
    fn new() -> Self {
        // The text of a fault is all that a page has to show for it.
        std::panic::set_hook(Box::new(|fault| say(&fault.to_string())));
        Self {
            bytes: Vec::new(),
            session: None,
            motion: [[0.0; BLOCK_NUMBERS]; MOST_BLOCKS],
            blocks: Vec::with_capacity(MOST_BLOCKS),
            outputs: vec![OutputSample::SILENCE; MOST_SAMPLES],
            words: vec![0; MOST_SAMPLES],
            samples: vec![0.0; MOST_SAMPLES],
            state: [0.0; STATE_NUMBERS],
            filter: None,
        }
    }

    fn session(&mut self) -> Result<&mut Session<'static>, Fault> {
        self.session.as_mut().ok_or(Fault::NoLibrary)
    }

    /// Decodes the library, and keeps its bytes for the rest of the module's life, because the session has views into
    /// them.
    fn load(&mut self) -> Result<(), Fault> {
        if self.session.is_some() {
            return Err(Fault::Loaded);
        }
        // Before they are kept, because the bytes of a refused library are not.
        Library::decode(&self.bytes).map_err(Fault::Library)?;
        let bytes = Vec::leak(std::mem::take(&mut self.bytes));
        let library = Library::decode(bytes).map_err(Fault::Library)?;
        self.session = Some(Session::new(library));
        Ok(())
    }

    fn run(&mut self, blocks: usize) -> Result<(), Fault> {
        let session = self.session.as_mut().ok_or(Fault::NoLibrary)?;
        if blocks > MOST_BLOCKS {
            return Err(Fault::TooManyBlocks(blocks));
        }
        // Refilled within its capacity, because nothing is allocated once something was chosen.
        self.blocks.clear();
        let motion = self.motion[..blocks].iter().copied();
        self.blocks.extend(motion.map(BlockMotion::of_numbers));
        session.play(&self.blocks, &mut self.outputs)?;
        let count = blocks * session.block_samples() as usize;
        for (at, output) in self.outputs[..count].iter().enumerate() {
            self.words[at] = output.0;
            self.samples[at] = output.metres_per_second_squared().0;
        }
        self.state = session.state();
        Ok(())
    }
}

fn with<R>(call: impl FnOnce(&mut Module) -> R) -> R {
    MODULE.with_borrow_mut(|module| call(module))
}

/// Makes `text` the module's text.
fn say(text: &str) {
    TEXT.with_borrow_mut(|held| {
        held.clear();
        held.push_str(text);
    });
}

/// The status of `done`, whose fault becomes the module's text.
fn status(done: Result<(), Fault>) -> u32 {
    match done {
        Ok(()) => 0,
        Err(fault) => {
            say(&fault.to_string());
            fault.status()
        }
    }
}

/// The status of a call that needs a session.
fn of_session(call: impl FnOnce(&mut Session<'static>) -> Result<(), Fault>) -> u32 {
    status(with(|module| call(module.session()?)))
}

/// Returns what `call` finds in the filter, or 0 without one.
fn of_filter(call: impl FnOnce(&Filter) -> usize) -> usize {
    with(|module| module.filter.as_ref().map_or(0, call))
}

/// Returns what `call` finds in the session, or 0 without one.
fn asked(call: impl FnOnce(&Session<'static>) -> u32) -> u32 {
    with(|module| module.session.as_ref().map_or(0, call))
}

const fn seed(low: u32, high: u32) -> u64 {
    low as u64 | (high as u64) << 32
}

/// Exports functions by their own names.
macro_rules! exports {
    ($($(#[doc = $doc:literal])+ fn $name:ident($($argument:ident: $kind:ty),*) -> $result:ty $body:block)+) => {
        $(
            $(#[doc = $doc])+
            // SAFETY: no other function of the module has this name, because nothing else here keeps its own and the
            // names are none of the compiler's.
            #[expect(unsafe_code, reason = "an export has to keep its name")]
            #[unsafe(no_mangle)]
            pub extern "C" fn $name($($argument: $kind),*) -> $result $body
        )+
    };
}

exports! {
    /// Makes room for a library of `bytes` bytes, and returns its address; 0 if there is none.
    fn reserve(bytes: usize) -> *mut u8 {
        with(|module| {
            if module.session.is_some() {
                status(Err(Fault::Loaded));
                return std::ptr::null_mut();
            }
            let mut room = Vec::new();
            // The size comes from the page. A failed allocation would end the module instead of the call.
            if room.try_reserve_exact(bytes).is_err() {
                say(&format!("there is no room for a library of {bytes} bytes"));
                return std::ptr::null_mut();
            }
            room.resize(bytes, 0);
            module.bytes = room;
            module.bytes.as_mut_ptr()
        })
    }

    /// Decodes the library in the room that was made for it.
    fn load() -> u32 {
        status(with(Module::load))
    }

    /// Address of the last text.
    fn text() -> *const u8 {
        TEXT.with_borrow(|text| text.as_ptr())
    }

    /// Length of the last text, bytes.
    fn text_length() -> usize {
        TEXT.with_borrow(String::len)
    }

    /// Plays a texture from the next block on.
    fn choose_texture(index: usize, without: u32, seed_low: u32, seed_high: u32) -> u32 {
        let (without, seed) = (Without::of_bits(without), seed(seed_low, seed_high));
        of_session(|session| session.choose(Selection::Texture(index), without, seed))
    }

    /// Plays a scene from the next block on.
    fn choose_scene(index: usize, without: u32, seed_low: u32, seed_high: u32) -> u32 {
        let (without, seed) = (Without::of_bits(without), seed(seed_low, seed_high));
        of_session(|session| session.choose(Selection::Scene(index), without, seed))
    }

    /// Sample rate of the choice, Hz.
    fn sample_rate_hz() -> u32 {
        asked(Session::sample_rate_hz)
    }

    /// Samples of a block of the choice.
    fn block_samples() -> u32 {
        asked(Session::block_samples)
    }

    /// Largest number of blocks of a run.
    fn most_blocks() -> usize {
        MOST_BLOCKS
    }

    /// Address of the motion.
    fn motion() -> *mut f64 {
        with(|module| module.motion.as_flattened_mut().as_mut_ptr())
    }

    /// Plays blocks.
    fn run(blocks: usize) -> u32 {
        status(with(|module| module.run(blocks)))
    }

    /// Address of the samples of the last run, m/s².
    fn samples() -> *const f32 {
        with(|module| module.samples.as_ptr())
    }

    /// Address of the words of the last run.
    fn words() -> *const i32 {
        with(|module| module.words.as_ptr())
    }

    /// Address of the state after the last run.
    fn state() -> *const f64 {
        with(|module| module.state.as_ptr())
    }

    /// Makes the filter of a resampler between two rates, Hz, and returns the address of its rows of taps.
    fn filter(from_hz: u32, to_hz: u32) -> *const f32 {
        with(|module| module.filter.insert(Filter::new(from_hz, to_hz)).rows.as_ptr())
    }

    /// Taps of a row of the filter, from the newest sample on.
    fn filter_taps() -> usize {
        of_filter(|filter| filter.taps)
    }

    /// Number of the filter's rows: phases per sample that it takes.
    fn filter_phases() -> usize {
        of_filter(|filter| filter.phases)
    }

    /// Phases of the filter per sample that it gives.
    fn filter_step() -> usize {
        of_filter(|filter| filter.step)
    }

    /// Delay of a filter between two rates, s.
    fn filter_delay_s(from_hz: u32, to_hz: u32) -> f64 {
        delay_s(from_hz, to_hz)
    }

    /// Writes blocks of the digest's motion.
    fn digest_motion(first: u32, blocks: usize) -> u32 {
        status(with(|module| {
            let rate = module.session()?.sample_rate_hz();
            if rate == 0 {
                return Err(Fault::NothingChosen);
            }
            let written = module.motion.get_mut(..blocks).ok_or(Fault::TooManyBlocks(blocks))?;
            for (block, written) in (first..).zip(written) {
                *written = motion_of_digest(block, rate).numbers();
            }
            Ok(())
        }))
    }

    /// Number of words that digests are compared of.
    fn digest_length() -> u32 {
        DIGEST_WORDS
    }

    /// Seed of the textures that digests are compared of.
    fn digest_seed() -> u32 {
        DIGEST_SEED as u32
    }

    /// Digest of the words since the choice took effect.
    fn digest() -> u32 {
        asked(|session| session.digest().0.value())
    }

    /// Number of these words.
    fn digest_words() -> u32 {
        asked(|session| session.digest().1)
    }
}
