//! A player: textures and scenes in real time, for the caller's own sound card or DAQ.
//!
//! The player is `stylus-player`. `fill` releases the interpreter's lock while it computes, and a lock of its own
//! refuses a second thread meanwhile. Another lock keeps what was chosen last.

use std::sync::{Mutex, MutexGuard, TryLockError};

use host_tools::evaluation::evaluate::texture_named;
use host_tools::scene::scene_named;
use numpy::PyArray1;
use pyo3::prelude::*;
use stylus_player::{
    BlockMotion, Filler, Mover, Selection, SharedLibrary, Without, band_hz, latency_s, player, player_as_rendered,
};

use crate::convert::filled;
use crate::error::{raised, refused};
use crate::library::Library;
use crate::playing::LibraryLike;

/// Largest number of samples of a block: a second at 192 kHz.
const MOST_SAMPLES: usize = 192_000;

/// A texture or a scene in real time: one thread moves, another fills the buffers of a sound card or a DAQ.
///
/// `library` is a `Library`, a `Fit`, or a path; `texture` or `scene` is the name of what plays first, or neither.
/// `output_rate_hz` is a multiple of 25 from 1000 to 192000. The same `seed` gives the same samples. At
/// a texture's own rate they are those of `render` along the same motion, to the bit, if `as_rendered` leaves the DC
/// blocker out: not for an amplifier that passes a steady voltage on.
///
/// `render` is no player: called per block it begins anew each time, which buzzes at the rate of the blocks.
#[pyclass(frozen, module = "stylus_haptics")]
pub struct Player {
    mover: Mover,
    filler: Mutex<Filler>,
    output_rate_hz: u32,
    /// The library that `choose` plays from if it is given no other, and the sample rate of what was chosen last, Hz;
    /// 5000 before the first choice.
    chosen: Mutex<(Py<Library>, SharedLibrary, u32)>,
}

/// Locks a mutex, even one whose holder has panicked: a panic leaves the locked value as it was.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

fn fault(fault: stylus_player::Fault) -> PyErr {
    refused(fault.to_string())
}

/// A library that players share.
fn shared(library: &Library) -> PyResult<SharedLibrary> {
    SharedLibrary::decode(library.bytes().to_vec()).map_err(|failure| refused(failure.to_string()))
}

/// The place and the sample rate of a texture or scene of `library`; none if neither is named.
fn found(library: &Library, texture: Option<&str>, scene: Option<&str>) -> PyResult<Option<(Selection, u32)>> {
    let decoded = library.decoded().map_err(raised)?;
    let place = match (texture, scene) {
        (None, None) => return Ok(None),
        (Some(_), Some(_)) => {
            return Err(refused("a texture or a scene is played, not both: leave one out"));
        }
        (Some(name), None) => {
            // By its name first, for the error that lists the names that there are.
            let texture = texture_named(&decoded, name).map_err(raised)?;
            let index = decoded.textures().position(|other| other.name() == name);
            (index.map(Selection::Texture), texture.sample_rate_hz())
        }
        (None, Some(name)) => {
            let scene = scene_named(&decoded, Some(name), &library.named()).map_err(raised)?;
            let rate_hz = scene.plan(&decoded).map_err(raised)?.sample_rate_hz();
            let index = decoded.scenes().position(|other| other.name.as_str() == name);
            (index.map(Selection::Scene), rate_hz)
        }
    };
    let (Some(selection), rate_hz) = place else {
        return Err(refused("the library has no such texture or scene"));
    };
    Ok(Some((selection, rate_hz)))
}

impl Player {
    /// Locks the player's only filling side.
    fn filling(&self) -> PyResult<MutexGuard<'_, Filler>> {
        // It does not wait: two threads in turn would each have only parts of the sound.
        match self.filler.try_lock() {
            Ok(filler) => Ok(filler),
            // A filler is of no use after a panic, which left it amid a sample.
            Err(TryLockError::Poisoned(_)) => Err(refused("the player has failed before: make another one")),
            Err(TryLockError::WouldBlock) => Err(refused(
                "another thread fills from this player: make a player for each output",
            )),
        }
    }
}

#[pymethods]
impl Player {
    #[new]
    #[pyo3(signature = (
        library, texture = None, *, scene = None, output_rate_hz = 48_000, seed = 1, as_rendered = false
    ))]
    fn new(
        py: Python<'_>,
        library: LibraryLike<'_>,
        texture: Option<&str>,
        scene: Option<&str>,
        output_rate_hz: u32,
        seed: u64,
        as_rendered: bool,
    ) -> PyResult<Self> {
        let library = library.library(py)?;
        let decoded = shared(library.get())?;
        let open = if as_rendered { player_as_rendered } else { player };
        let (mover, filler) = open(output_rate_hz).map_err(fault)?;
        let player = Self {
            mover,
            filler: Mutex::new(filler),
            output_rate_hz,
            chosen: Mutex::new((library, decoded, model_format::SAMPLE_RATE_HZ)),
        };
        if texture.is_some() || scene.is_some() {
            player.choose(py, texture, scene, None, seed)?;
        }
        Ok(player)
    }

    /// Moves at `speed_mm_s`, signed by the direction, with `force_n`. From any thread; held for 50 ms and the length
    /// of a buffer, then the texture fades, so that a control loop that has died leaves no tone. Call it 20 times per
    /// second or more.
    #[pyo3(name = "move")]
    fn rub(&self, speed_mm_s: f64, force_n: f64) -> PyResult<()> {
        self.mover.rub(speed_mm_s, force_n).map_err(fault)
    }

    /// Moves to `position_mm` with `force_n` at `time_s` of the caller's clock, such as `time.monotonic()`. The speed
    /// is that from the position before. Lines that are tied to position stand where they were recorded.
    fn move_to(&self, time_s: f64, position_mm: f64, force_n: f64) -> PyResult<()> {
        self.mover.reach(time_s, position_mm, force_n).map_err(fault)
    }

    /// Moves as one block of 2 ms says: `begin_mm` and `end_mm` are the positions of its first and last sample,
    /// `contact` tells whether the tool touches. What is None follows from speed and force.
    #[pyo3(signature = (speed_mm_s, force_n, *, begin_mm = None, end_mm = None, contact = None))]
    fn follow(
        &self,
        speed_mm_s: f64,
        force_n: f64,
        begin_mm: Option<f64>,
        end_mm: Option<f64>,
        contact: Option<bool>,
    ) -> PyResult<()> {
        let motion = BlockMotion {
            begin_mm: begin_mm.unwrap_or(f64::NAN),
            end_mm: end_mm.unwrap_or(f64::NAN),
            contact: contact.map_or(f64::NAN, f64::from),
            ..BlockMotion::new(speed_mm_s, force_n)
        };
        self.mover.follow(motion).map_err(fault)
    }

    /// Plays another `texture` or `scene`, of `library` if it is given, as soon as what sounds has faded.
    #[pyo3(signature = (texture = None, *, scene = None, library = None, seed = 1))]
    fn choose(
        &self,
        py: Python<'_>,
        texture: Option<&str>,
        scene: Option<&str>,
        library: Option<LibraryLike<'_>>,
        seed: u64,
    ) -> PyResult<()> {
        let (library, decoded) = if let Some(library) = library {
            let library = library.library(py)?;
            let decoded = shared(library.get())?;
            (library, decoded)
        } else {
            let chosen = locked(&self.chosen);
            (chosen.0.clone_ref(py), chosen.1.clone())
        };
        let missing = || refused("name a texture or a scene, or stop the player");
        let (selection, rate_hz) = found(library.get(), texture, scene)?.ok_or_else(missing)?;
        self.mover
            .choose(&decoded, selection, Without::default(), seed)
            .map_err(fault)?;
        // Only after success: a refused choice leaves the library of what plays.
        *locked(&self.chosen) = (library, decoded, rate_hz);
        Ok(())
    }

    /// Lets what sounds fade, and plays nothing until the next choice.
    fn stop(&self) {
        self.mover.stop();
    }

    /// Multiplies samples, m/s², by `gain`, and clamps them to `limit` on either side: volts, if the gain is in V per
    /// m/s². The gain changes over 2 ms, the limit at once.
    #[pyo3(signature = (gain, limit = f32::INFINITY))]
    fn set_gain(&self, gain: f32, limit: f32) -> PyResult<()> {
        self.mover.set_gain(gain, limit).map_err(fault)
    }

    /// Protects a coil of `ohms` that needs `volts_per_m_s2` and bears `watts`, for as long as the player lives. The
    /// output is then the coil's voltage. It is at most four times that at this power, reaches it in 0.4 ms or more,
    /// and is attenuated before its mean power over 10 s exceeds the limit. Behind an amplifier of gain a, give
    /// `ohms` / a² and `volts_per_m_s2` / a.
    fn set_coil(&self, ohms: f32, volts_per_m_s2: f32, watts: f32) -> PyResult<()> {
        self.mover.set_coil(ohms, volts_per_m_s2, watts).map_err(fault)
    }

    /// Plays the next samples into `out`, a writable array of float32 of the shape (N,) or (N, 1), such as one channel
    /// of a sound card's buffer. Without the interpreter's lock, from one thread at a time.
    fn fill(&self, out: &Bound<'_, PyAny>) -> PyResult<()> {
        let filler = &mut *self.filling()?;
        filled(out, |samples| filler.fill(samples))
    }

    /// Blocks of `samples` samples without an end, each an array of its own: `for block in player.blocks(480)`.
    fn blocks(slf: Py<Self>, samples: usize) -> PyResult<Blocks> {
        if !(1..=MOST_SAMPLES).contains(&samples) {
            return Err(refused(format!(
                "a block has 1 to {MOST_SAMPLES} samples, and not {samples}"
            )));
        }
        Ok(Blocks { player: slf, samples })
    }

    /// Samples per second that `fill` plays.
    #[getter]
    fn output_rate_hz(&self) -> u32 {
        self.output_rate_hz
    }

    /// Time from a move to the middle of the change that it makes, s: at most so much in the mean, and 1 ms more for a
    /// move just after a block began. The buffers of the sound card or DAQ come on top of it.
    #[getter]
    fn latency_s(&self) -> f64 {
        latency_s(locked(&self.chosen).2, self.output_rate_hz)
    }

    /// Band of what was chosen that the output rate has left, Hz.
    #[getter]
    fn band_hz(&self) -> f64 {
        band_hz(locked(&self.chosen).2, self.output_rate_hz)
    }

    fn __enter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    /// Stops at the end of a `with` statement.
    #[pyo3(signature = (*_exception))]
    fn __exit__(&self, _exception: &Bound<'_, pyo3::types::PyTuple>) {
        self.stop();
    }
}

/// Blocks of a player.
#[pyclass(frozen, module = "stylus_haptics")]
pub struct Blocks {
    player: Py<Player>,
    samples: usize,
}

#[pymethods]
impl Blocks {
    fn __iter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    fn __next__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f32>>> {
        let mut block = vec![0.0; self.samples];
        let filler = &mut *self.player.get().filling()?;
        py.detach(|| filler.fill(&mut block));
        Ok(PyArray1::from_vec(py, block))
    }
}
