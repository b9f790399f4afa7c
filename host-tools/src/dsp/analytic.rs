//! The analytic signal of a band, for envelopes.

use super::with_planner;

/// A block within a range of frequencies, and its Hilbert transform.
pub struct Analytic {
    /// The block's part within the range.
    pub signal: Vec<f64>,
    quadrature: Vec<f64>,
}

impl Analytic {
    /// Transforms the block, keeps the bins from `low_hz` to `high_hz`, and transforms back: as they are, and a quarter
    /// of a period later. The transform is circular: a block's ends are taken for neighbours.
    pub fn of(block: &[f64], rate_hz: f64, low_hz: f64, high_hz: f64) -> Self {
        let len = block.len();
        if len < 2 {
            return Self {
                signal: vec![0.0; len],
                quadrature: vec![0.0; len],
            };
        }
        let (forward, inverse) =
            with_planner(|planner| (planner.plan_fft_forward(len), planner.plan_fft_inverse(len)));
        let mut bins = forward.make_output_vec();
        forward
            .process(&mut block.to_vec(), &mut bins)
            .expect("lengths come from the plan");
        for (bin, value) in bins.iter_mut().enumerate() {
            let frequency_hz = bin as f64 * rate_hz / len as f64;
            // Bins at 0 Hz and at half the rate have no quadrature.
            let is_edge = bin == 0 || 2 * bin == len;
            let is_kept = (low_hz..=high_hz).contains(&frequency_hz) && !is_edge;
            *value *= if is_kept { 1.0 / len as f64 } else { 0.0 };
        }
        let mut later = bins.clone();
        for value in &mut later {
            (value.re, value.im) = (value.im, -value.re);
        }
        let back = |bins: &mut Vec<_>| {
            let mut signal = inverse.make_output_vec();
            inverse
                .process(bins, &mut signal)
                .expect("lengths come from the plan, and edges are zero");
            signal
        };
        Self {
            signal: back(&mut bins),
            quadrature: back(&mut later),
        }
    }

    /// Magnitude of the analytic signal, sample by sample.
    pub fn envelope(&self) -> Vec<f64> {
        self.signal
            .iter()
            .zip(&self.quadrature)
            .map(|(x, y)| x.hypot(*y))
            .collect()
    }
}
