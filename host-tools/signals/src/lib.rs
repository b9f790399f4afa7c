//! Signals that are recorded, simulated or played, and their files.
//!
//! Invariant: nothing here knows how a texture is fitted, or talks to a device.

pub mod export;

/// Playing on the host: a motion over time, and the samples that the stylus plays along this motion.
///
/// Invariant: the samples come from the device's own kernel and are equal to the device's to the bit.
pub mod playing {
    /// Motion of a hand over time, for a rendering: constant, or from a CSV file.
    ///
    /// ```text
    /// # Comments begin with a number sign.
    /// time_s,speed_mm_s,force_n
    /// 0.0,0,0.5
    /// 1.5,120,0.8
    /// ```
    /// The sign of a speed is its direction along the path, and a force at or below zero means no contact. This holds
    /// for every motion: on the command line, in a scene and on the link. Values that no hand reaches are refused.
    ///
    /// Columns may be in any order, and other columns are ignored. A column `position_mm` gives the position on the
    /// path; without it, the position is the integral of the speed, from 0 mm. A column `contact`, 0 or 1, gives
    /// contact with the surface; without it, contact follows from the force, see [`Hand`](motion::Hand).
    pub mod motion {
        mod path;
        mod table;

        pub use path::{Hand, MotionPath, MotionRow};
    }

    pub mod pin;

    /// A texture played on the host, to view and to listen to. The samples are equal to those of the stylus to the bit,
    /// because they come from the stylus's own kernel, and the motion is updated once per update interval, like on the
    /// device.
    pub mod render {
        mod samples;
        mod wav;

        #[cfg(test)]
        pub(crate) use samples::test_motions;
        pub use samples::{MAX_SECONDS, Rendered, Rendering, SampleClock, render};
        pub use wav::{RenderSummary, WavFormat, WavSummary, render_wav, write_floats_wav, write_wav};
    }

    pub mod wavefront;
}

/// Recordings: the trials of a set, their samples in m/s² at the models' sample rate, verdicts on them, and recordings
/// of a free hand.
///
/// | modules | subject |
/// |---|---|
/// | `set`, `pattern`, `snap`, `trial` | the trials of a set, and their speeds and forces |
/// | `kind`, `load` | the format of a file, and its reader: `wav` and `riff`, `csv_file`, `lvm` |
/// | `times`, `order`, `step`, `clock`, `uneven`, `polled`, `joined` | times of samples, and values that are repeated |
/// | `unit`, `numbers`, `axes` | scales, integers that were misread, and names of columns |
/// | `rate`, `resample` | sample rates and their conversion |
/// | `defects`, `triage` | defects of the samples as they were recorded, and verdicts on trials |
///
/// Invariant: inputs are files, or samples that a program holds; outputs are samples and verdicts. Nothing here fits a
/// model.
pub mod recording {
    mod axes;
    mod clock;
    mod csv_file;
    mod defects;

    /// Recordings of a free hand: accelerations with the speed and force at each sample.
    ///
    /// Values that no hand and no sensor can produce (10⁵ N) are outliers. The first is reported with its line, and
    /// no stretch in motion includes a block with an outlier. A file in which more than a tenth of the samples have an
    /// outlier is refused, because its columns or units are then likely to be wrong.
    pub mod freehand {
        mod moving;
        mod positions;
        mod read;

        pub use moving::{LEAST_FORCE_N, LEAST_SPEED_MM_S, jumps_s, moving};
        pub use read::{Freehand, is_simulated, read};
    }

    mod joined;
    mod kind;
    mod load;
    mod lvm;
    mod numbers;
    mod order;
    pub mod pattern;
    mod polled;
    mod rate;
    mod resample;
    mod riff;
    mod set;
    mod snap;
    mod step;
    mod times;
    pub mod triage;
    mod trial;
    mod uneven;
    mod unit;
    mod wav;

    pub use defects::{Defects, Gap, Hold, Spike, Timing, Truncation};
    pub use kind::Kind;
    pub use load::{held_table, read, read_at};
    pub use rate::{MAX_CHANNELS, MAX_FRAMES, RATES_HZ, SampleRate, most_frames};
    pub use resample::resample;
    pub use set::{Assumed, LIST_COLUMNS, MOST_TRIALS, RecordingSet, TRIALS_FILE, is_list, list_command};
    pub use snap::{Nominal, Rule, Snap, Spread, clear_grid, grid_by_gaps, nominal};
    pub(crate) use times::TimeColumn;
    pub use times::TimeUnit;
    pub use trial::{
        Account, Cut, HeldSamples, NOMINAL_FORCE_N, NOMINAL_SPEED_MM_S, Samples, Source, TRIAL_DURATION_S, Trial,
        texture_fault,
    };
    pub use unit::scale;
    pub use unit::{GRAVITY_M_S2, GRAVITY_TOLERANCE, Unscaled};
}

pub mod rig;
