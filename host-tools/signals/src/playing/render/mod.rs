//! A texture played on the host, to view and to listen to. The samples are equal to those of the stylus to the bit,
//! because they come from the stylus's own kernel, and the motion is updated once per update interval, like on the
//! device.

mod samples;
#[cfg(test)]
pub(crate) mod test_motions;
mod wav;

pub use samples::{MAX_SECONDS, Rendered, Rendering, SampleClock, render};
pub use wav::{RenderSummary, WavFormat, WavSummary, render_wav, write_floats_wav, write_wav};
