//! A rendered stroke in memory, with what a file says of it.

use model_format::Texture;

use crate::playing::motion::MotionPath;
use crate::playing::render::{Rendered, Rendering};
use crate::support::error::{Error, Result};
use crate::support::progress;

/// Longest stroke of a file, s. It bounds the memory for samples and for the file's text to a few hundred megabytes.
pub const MAX_SECONDS: f64 = 600.0;

/// A texture, rendered along a motion.
#[derive(Clone, Debug)]
pub struct Stroke {
    rendered: Rendered,
    name: String,
}

impl Stroke {
    /// Renders `seconds` of `texture` along `motion`, with a progress bar.
    ///
    /// # Errors
    /// A duration above [`MAX_SECONDS`], and those of [`Rendering::new`].
    pub fn render(
        texture: Texture<'_>,
        motion: &MotionPath,
        seconds: f64,
        seed: u64,
    ) -> Result<Self> {
        if seconds > MAX_SECONDS {
            return Err(Error::Request(format!(
                "a file of a stroke holds at most {MAX_SECONDS} s, not {seconds}: give fewer --seconds, or use stylus \
                 render"
            )));
        }
        let mut rendering = Rendering::new(texture, motion, seconds, seed)?;
        let bar = progress::bar(rendering.len() as u64, "rendering");
        let samples = bar.wrap_iter(rendering.by_ref()).collect();
        bar.finish_and_clear();
        Ok(Self {
            rendered: Rendered {
                sample_rate_hz: texture.sample_rate_hz(),
                samples,
                saturations: rendering.saturations(),
            },
            name: format!(
                "Texture '{}' ({}) along a stroke of {seconds} s, seed {seed}, by stylus {}",
                texture.name(),
                texture.provenance(),
                env!("CARGO_PKG_VERSION")
            ),
        })
    }

    /// Samples, with their rate and the number of those at the kernel's full scale.
    pub fn rendered(&self) -> &Rendered {
        &self.rendered
    }

    /// Texture, provenance and stroke in words.
    pub fn name(&self) -> &str {
        &self.name
    }

    pub(super) fn accelerations(&self) -> Vec<f64> {
        self.rendered.accelerations_m_s2()
    }

    pub(super) fn rate_hz(&self) -> f64 {
        f64::from(self.rendered.sample_rate_hz)
    }
}
