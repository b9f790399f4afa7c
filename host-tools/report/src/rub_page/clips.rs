//! Parts of recordings that a page plays (clips): their duration, their nodes, and their bytes.

use std::f64::consts::FRAC_PI_2;
use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use model_format::{Library, SAMPLE_RATE_HZ};
use serde::Serialize;
use stylus_fit::texture::grid::is_recorded;

use super::{Clips, JudgedRecordings};

/// Size of all clips of a page with [`Clips::Budget`], bytes. Each sample takes one byte; in the page they take a third
/// more.
const BUDGET_BYTES: f64 = 380_000.0;

/// Shortest and longest clip with [`Clips::Budget`], s.
const DURATION_S: (f64, f64) = (0.5, 1.5);

/// Duration over which a clip's end is faded into its beginning, s.
const JOINT_S: f64 = 0.03;

/// Largest code.
const FULL_CODE: f64 = 127.0;

/// Parameter μ of the codes' compression: μ-law as in telephony (ITU-T G.711).
const MU: f64 = 255.0;

/// A part of a recording.
#[derive(Serialize)]
pub struct Clip {
    texture: usize,
    node: usize,
    speed_mm_s: f64,
    force_n: f64,
    file: String,
    sample_rate_hz: u32,
    peak_m_s2: f64,
    /// Samples as `i8`. The code c stands for sign(c) · `peak_m_s2` · (256^(|c|/127) - 1)/255, m/s².
    codes_base64: String,
}

impl Clip {
    /// Returns the middle `samples` samples of `signal`, m/s², as a clip. The first argument is its node: the index of
    /// the texture, the index of the node, speed, mm/s, and force, N. `None` if the signal is silent or too short for a
    /// joint.
    pub fn of(
        (texture, node, speed_mm_s, force_n): (usize, usize, f64, f64),
        file: &Path,
        signal: &[f64],
        samples: usize,
    ) -> Option<Self> {
        let looped = looped(signal, samples)?;
        let peak = looped.iter().fold(0.0f64, |peak, x| peak.max(x.abs()));
        if peak <= 0.0 {
            return None;
        }
        let codes: Vec<u8> = looped
            .iter()
            // Relative to the peak, so that a quiet clip has as many steps as a loud one.
            .map(|&x| code(x / peak).cast_unsigned())
            .collect();
        let name = file.file_name().unwrap_or(file.as_os_str());
        Some(Self {
            texture,
            node,
            speed_mm_s,
            force_n,
            file: name.to_string_lossy().into_owned(),
            sample_rate_hz: SAMPLE_RATE_HZ,
            peak_m_s2: peak,
            codes_base64: STANDARD.encode(codes),
        })
    }
}

/// Returns the middle `samples` samples of `signal`, or fewer if it is shorter. The end is cross-faded into the
/// beginning at equal power, so that the clip can be repeated.
fn looped(signal: &[f64], samples: usize) -> Option<Vec<f64>> {
    let joint = (JOINT_S * f64::from(SAMPLE_RATE_HZ)) as usize;
    let length = samples.min(signal.len().checked_sub(joint)?);
    // A joint may take half of the clip at most.
    if length < 2 * joint {
        return None;
    }
    let begin = (signal.len() - length - joint) / 2;
    let mut clip = signal[begin..begin + length].to_vec();
    let after = &signal[begin + length..begin + length + joint];
    for (at, (x, &after)) in clip.iter_mut().zip(after).enumerate() {
        // Because sin² + cos² = 1, the power of noise is constant: the two signals that are mixed are uncorrelated.
        let turn = FRAC_PI_2 * (at as f64 + 0.5) / joint as f64;
        *x = *x * turn.sin() + after * turn.cos();
    }
    Some(clip)
}

/// Returns the code of a value from -1 to 1.
fn code(value: f64) -> i8 {
    // `ln_1p` keeps the digits of small values, which 1 + x would lose.
    let magnitude = (MU * value.abs()).ln_1p() / MU.ln_1p();
    (FULL_CODE * magnitude * value.signum()).round() as i8
}

/// The choice of the nodes that have clips, and the clips' duration.
pub struct Thinning {
    /// One clip per this number of speeds and of forces, counted from the last ones of the largest grid.
    every: (usize, usize),
    /// Numbers of speeds and of forces of the largest grid.
    counts: (usize, usize),
    duration_s: f64,
}

impl Thinning {
    /// Chooses among the nodes of `library` for which `recordings` may have a recording.
    pub fn of(library: &Library<'_>, recordings: &JudgedRecordings<'_>) -> Self {
        let grids: Vec<(usize, usize)> = library
            .textures()
            .map(|texture| (texture.speed_axis().len(), texture.force_axis().len()))
            .collect();
        let counts = grids
            .iter()
            .fold((1, 1), |most, grid| (most.0.max(grid.0), most.1.max(grid.1)));
        let heard = |texture: model_format::Texture<'_>| texture.nodes().filter(|node| is_recorded(node.flags)).count();
        let recorded: usize = library.textures().map(heard).sum();
        if let Clips::Seconds(duration_s) = recordings.clips {
            return Self {
                every: (1, 1),
                counts,
                duration_s,
            };
        }
        let share_of_nodes = |every: (usize, usize)| {
            let kept = |count: usize, every: usize| count.div_ceil(every) as f64 / count as f64;
            kept(counts.0, every.0) * kept(counts.1, every.1)
        };
        let duration_s = |every| {
            // A library may have no recorded node.
            let clips = (recorded as f64 * share_of_nodes(every)).max(1.0);
            BUDGET_BYTES / clips / f64::from(SAMPLE_RATE_HZ)
        };
        let mut every = (1, 1);
        while duration_s(every) < DURATION_S.0 && every.0 * every.1 < counts.0 * counts.1 {
            // The axis on which more nodes are left is thinned.
            if counts.0.div_ceil(every.0) >= counts.1.div_ceil(every.1) {
                every.0 *= 2;
            } else {
                every.1 *= 2;
            }
        }
        Self {
            every,
            counts,
            duration_s: duration_s(every).min(DURATION_S.1),
        }
    }

    /// Returns true if the node with these indices has a clip, provided it has a recording.
    pub fn keeps(&self, speed: usize, force: usize) -> bool {
        let from_the_last = |index: usize, count: usize| count.saturating_sub(index + 1);
        from_the_last(speed, self.counts.0).is_multiple_of(self.every.0)
            && from_the_last(force, self.counts.1).is_multiple_of(self.every.1)
    }

    /// Length of a clip, samples.
    pub fn samples(&self) -> usize {
        (self.duration_s * f64::from(SAMPLE_RATE_HZ)).round() as usize
    }

    /// Returns the choice, in words.
    pub fn in_words(&self, clips: usize) -> String {
        let of_axis = [(self.every.0, "speed"), (self.every.1, "force")];
        let thinned: Vec<String> = of_axis
            .iter()
            .filter(|(every, _)| *every > 1)
            .map(|(every, axis)| format!("one {axis} in {every}"))
            .collect();
        let places = if thinned.is_empty() {
            "every recorded node has one".to_owned()
        } else {
            format!(
                "recorded nodes at {} have one, because of the page's size; elsewhere the nearest is heard",
                thinned.join(" and ")
            )
        };
        format!(
            "{clips} clips of recordings, up to {:.2} s each, repeated: {places}.",
            self.duration_s
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The value of a code, as the page's script computes it.
    fn value(code: i8) -> f64 {
        let magnitude = ((1.0 + MU).powf(f64::from(code).abs() / FULL_CODE) - 1.0) / MU;
        magnitude * f64::from(code).signum()
    }

    proptest! {
        /// The error is at most half a step of μ-law: ln(256)/127/2 times the sum of the value and 1/255.
        #[test]
        fn a_code_is_within_half_a_step_of_its_value(x in -1.0f64..1.0) {
            let step = (1.0 + MU).ln() / FULL_CODE;
            prop_assert!((value(code(x)) - x).abs() <= 0.51 * step * (x.abs() + 1.0 / MU));
        }
    }

    #[test]
    fn a_clip_goes_on_where_the_recording_goes_on_when_it_is_repeated() {
        // In a slow ramp, the only jump could be at the joint.
        let signal: Vec<f64> = (0..10_000).map(|n| n as f64 * 1e-3).collect();
        let clip = looped(&signal, 5000).expect("it is long enough");
        let joint = (clip[0] - clip[clip.len() - 1]).abs();
        assert!(joint < 0.1, "{joint}");
        assert_eq!(clip.len(), 5000);
        assert!(looped(&signal[..200], 5000).is_none());
        assert_eq!(looped(&signal[..1000], 5000).expect("short").len(), 850);
    }
}
