//! A texture played on the host, to look at and to listen to: the samples are bit-equal to those of the stylus, because
//! they come from the stylus's own kernel, with the motion taken over once per update interval as on the device.

mod samples;
#[cfg(test)]
pub(crate) mod test_motions;
mod wav;

pub use samples::{MAX_SECONDS, Rendered, Rendering, SampleClock, render};
pub use wav::{RenderSummary, WavFormat, WavSummary, render_wav, write_floats_wav, write_wav};
