//! The spectrum that the bytes of a library play at a motion: that of the kernel's own response to an impulse.

use model_format::{MillimetresPerSecond, Newton, OutputSample, SAMPLE_RATE_HZ, Texture};
use realfft::RealFftPlanner;
use stylus_kernel::arithmetic::Portable;
use stylus_kernel::excitation;
use stylus_kernel::grid::{GridPoint, Motion};
use stylus_kernel::lattice::{LatticeFrame, LatticeState};

/// Length of the response, samples: 1 s, so that the densities are 1 Hz apart.
const LENGTH: usize = SAMPLE_RATE_HZ as usize;

/// Height of the impulse in standard deviations of the excitation, as a power of two: half of full scale.
const HEIGHT_BITS: u32 = 2;

/// Returns the density on one side of the spectrum, (m/s²)²/Hz, at 0 Hz, 1 Hz and so on to half the sample rate, of
/// `texture`, a lattice, at a speed, mm/s, and a force, N, both finite.
pub(super) fn density(texture: &Texture<'_>, (speed_mm_s, force_n): (f64, f64)) -> Vec<f64> {
    let motion = Motion::new(
        MillimetresPerSecond(speed_mm_s as f32),
        Newton(force_n as f32),
    )
    .expect("speeds and forces of a file are finite");
    let mut frame = LatticeFrame::silent(texture.max_order());
    frame.update::<Portable>(
        texture,
        &GridPoint::locate(texture, motion),
        frame.levels(0),
        1,
    );
    let mut state = LatticeState::new();
    let step = f64::from(1u32 << HEIGHT_BITS) * f64::from(1u32 << OutputSample::FRACTION_BITS);
    let mut response: Vec<f64> = (0..LENGTH)
        .map(|sample| {
            let excitation = if sample == 0 {
                1 << (excitation::FRACTION_BITS + HEIGHT_BITS)
            } else {
                0
            };
            let (output, _) = state.next_sample::<Portable>(&frame, excitation, 0);
            f64::from(output.0) / step
        })
        .collect();
    let transform = RealFftPlanner::new().plan_fft_forward(LENGTH);
    let mut spectrum = transform.make_output_vec();
    transform
        .process(&mut response, &mut spectrum)
        .expect("lengths come from the plan");
    let scale = 2.0 / f64::from(SAMPLE_RATE_HZ);
    spectrum.iter().map(|bin| scale * bin.norm_sqr()).collect()
}
