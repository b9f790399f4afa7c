//! Fits sections to the inverse of a response.

use model_format::scene::Biquad;
use model_format::scene::limits::{MAX_EQUALISER_GAIN, MAX_RESPONSE_SECTIONS};
use nalgebra::{DMatrix, DVector};

use super::{MAX_SECTION_GAIN_DB, Response, ResponseFault, Section, SectionKind, cascade_db, stored_level_db};

/// Largest gain of a calibration's equaliser unless the user asks for another, dB.
pub const CALIBRATION_GAIN_DB: f64 = 20.0;

/// Band that is corrected, Hz. It is a little wider than the band that must be flat, 30 to 800 Hz.
const BAND_HZ: [f64; 2] = [22.0, 950.0];

/// Smallest accepted ratio of the band's upper edge to its lower edge.
const LEAST_RATIO: f64 = 1.5;

/// Number of frequencies at which the level is fitted.
const POINTS: usize = 200;

/// Smallest reduction of the RMS deviation for which one more section is added, dB, because each section costs
/// instructions in every tick.
const LEAST_REDUCTION_PER_SECTION_DB: f64 = 0.05;

/// Iterations of Levenberg-Marquardt after each section.
const ROUNDS: usize = 60;

/// Range of quality factors of fitted peaks. Above 12, a peak is narrower than the resolution of a response.
const PEAKING_QS: [f64; 2] = [0.3, 12.0];

/// Range of quality factors of fitted shelves. Above 1/√2, a shelf overshoots: at 1, by 0.8 dB for a gain of 12 dB.
const SHELF_QS: [f64; 2] = [0.3, 1.0];

/// A fitted equaliser.
#[derive(Clone, Debug, PartialEq)]
pub struct Design {
    /// The sections in ascending order of gain, so that no level between them saturates.
    pub sections: Vec<Section>,
    /// The stored forms of the sections.
    pub biquads: Vec<Biquad>,
    /// Largest gain at any frequency, dB.
    pub max_gain_db: f64,
}

/// Fits the equaliser that inverts `response` at the sample rate `rate_hz`, with a gain of at most `max_gain_db` at any
/// frequency. The band is the part of 22 to 950 Hz that the response covers.
///
/// # Errors
/// The format does not allow `max_gain_db`, or the response covers too little of the band.
pub fn design(response: &Response, rate_hz: f64, max_gain_db: f64) -> Result<Design, ResponseFault> {
    let most_db = 20.0 * MAX_EQUALISER_GAIN.log10();
    if !(0.0..=most_db).contains(&max_gain_db) {
        return Err(ResponseFault::Gain { max_gain_db, most_db });
    }
    let points = response.points();
    let low_hz = BAND_HZ[0].max(points[0].0);
    let high_hz = BAND_HZ[1].min(points[points.len() - 1].0);
    if high_hz < LEAST_RATIO * low_hz {
        return Err(ResponseFault::Band { low_hz, high_hz });
    }
    let [low, high] = [low_hz, high_hz].map(f64::ln);
    let frequencies: Vec<f64> = (0..POINTS)
        .map(|n| (low + (high - low) * n as f64 / (POINTS - 1) as f64).exp())
        .collect();
    let levels: Vec<f64> = frequencies.iter().map(|&hz| response.level_db(hz)).collect();
    let mean_db = levels.iter().sum::<f64>() / POINTS as f64;
    let target: Vec<f64> = levels
        .iter()
        .map(|level_db| (mean_db - level_db).clamp(-MAX_SECTION_GAIN_DB, max_gain_db))
        .collect();
    let fit = Fit {
        rate_hz,
        band_hz: [low_hz, high_hz],
        frequencies: &frequencies,
        target: &target,
    };
    let mut sections = fit.sections(MAX_RESPONSE_SECTIONS);
    // Ascending gains, so that the partial products of the cascade stay low.
    sections.sort_by(|a, b| a.gain_db.total_cmp(&b.gain_db));
    // The fit bounds each section and the target in the band, but not the cascade at every frequency.
    let (sections, biquads) = within_limits(&sections, rate_hz, max_gain_db);
    let gains_db = everywhere(rate_hz).map(|hz| cascade_db(&biquads, rate_hz, hz));
    Ok(Design {
        max_gain_db: gains_db.fold(f64::NEG_INFINITY, f64::max),
        sections,
        biquads,
    })
}

/// Scales the gains of all sections down until the limits hold, and returns the sections with their stored forms.
///
/// A solution exists, because sections of zero gain change nothing, which is within the limits.
fn within_limits(sections: &[Section], rate_hz: f64, max_gain_db: f64) -> (Vec<Section>, Vec<Biquad>) {
    const HALVINGS: usize = 24;
    let scaled = |share: f64| {
        let sections: Vec<Section> = sections
            .iter()
            .map(|section| Section {
                gain_db: share * section.gain_db,
                ..*section
            })
            .collect();
        let biquads: Option<Vec<Biquad>> = sections.iter().map(|s| s.biquad(rate_hz).ok()).collect();
        biquads
            .filter(|biquads| keeps_limits(biquads, rate_hz, max_gain_db))
            .map(|biquads| (sections, biquads))
    };
    if let Some(whole) = scaled(1.0) {
        return whole;
    }
    // No section is left if not even a small share of the gains holds.
    let (mut low, mut high) = (0.0, 1.0);
    let mut best = (Vec::new(), Vec::new());
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        match scaled(middle) {
            Some(found) => (low, best) = (middle, found),
            None => high = middle,
        }
    }
    best
}

/// Returns true if all limits hold: the poles are within the format's limit, the gain of the cascade is at most
/// `max_gain_db`, and the gain of each section and of each partial cascade is at most the format's largest gain.
fn keeps_limits(biquads: &[Biquad], rate_hz: f64, max_gain_db: f64) -> bool {
    /// Largest gain that rounding to the stored form may add, dB.
    const ROUNDING_DB: f64 = 1e-3;
    let format_db = 20.0 * MAX_EQUALISER_GAIN.log10() - 0.05;
    biquads.iter().all(Biquad::poles_are_within_limit)
        && everywhere(rate_hz).all(|frequency_hz| {
            let share = frequency_hz / rate_hz;
            let mut sum = 0.0;
            let partial = biquads.iter().all(|section| {
                let own = stored_level_db(section, share);
                sum += own;
                own <= format_db && sum <= format_db
            });
            partial && sum <= max_gain_db + ROUNDING_DB
        })
}

/// Returns frequencies from 0 to half the sample rate, Hz, denser at low frequencies.
fn everywhere(rate_hz: f64) -> impl Iterator<Item = f64> {
    const INTERVALS: u32 = 2000;
    (0..=INTERVALS).map(move |n| 0.5 * rate_hz * (f64::from(n) / f64::from(INTERVALS)).powi(3))
}

/// A fit of sections to target levels, dB.
struct Fit<'a> {
    rate_hz: f64,
    band_hz: [f64; 2],
    frequencies: &'a [f64],
    target: &'a [f64],
}

impl Fit<'_> {
    /// Fits up to `most` sections, added one at a time.
    fn sections(&self, most: usize) -> Vec<Section> {
        let mut sections: Vec<Section> = Vec::new();
        let mut error = self.error(&self.residual(&sections));
        while sections.len() < most {
            let tried = self.candidates(&sections).map(|candidate| {
                let mut tried = sections.clone();
                tried.push(candidate);
                let error = self.refine(&mut tried);
                (error, tried)
            });
            let best = tried
                .into_iter()
                // The level of a section that the crate refuses is NaN.
                .filter(|(error, _)| error.is_finite())
                .min_by(|a, b| a.0.total_cmp(&b.0));
            let Some((found, better)) = best else { break };
            if found > error - LEAST_REDUCTION_PER_SECTION_DB {
                break;
            }
            (sections, error) = (better, found);
        }
        sections
    }

    /// Returns one candidate of each kind: a peak at the largest residual, and shelves at a third of the band (on a
    /// logarithmic scale) from its ends.
    fn candidates(&self, sections: &[Section]) -> [Section; 3] {
        let residual = self.residual(sections);
        let worst = (0..residual.len())
            .max_by(|&a, &b| residual[a].abs().total_cmp(&residual[b].abs()))
            .unwrap_or(0);
        let [low, high] = self.band_hz;
        let third = (high / low).cbrt();
        let section = |kind, frequency_hz, q, gain_db| {
            self.within_bounds(Section {
                kind,
                frequency_hz,
                q,
                gain_db,
            })
        };
        [
            section(SectionKind::Peaking, self.frequencies[worst], 1.5, residual[worst]),
            section(SectionKind::LowShelf, low * third, 0.7, residual[0]),
            section(SectionKind::HighShelf, high / third, 0.7, residual[residual.len() - 1]),
        ]
    }

    /// Residual at each frequency, dB.
    fn residual(&self, sections: &[Section]) -> DVector<f64> {
        let levels = self.frequencies.iter().zip(self.target).map(|(&hz, target)| {
            let level: f64 = sections.iter().map(|s| s.level_db(self.rate_hz, hz)).sum();
            target - level
        });
        DVector::from_iterator(self.frequencies.len(), levels)
    }

    /// RMS of a residual, dB.
    fn error(&self, residual: &DVector<f64>) -> f64 {
        residual.norm() / (self.frequencies.len() as f64).sqrt()
    }

    /// Refines all sections together by Levenberg-Marquardt with a numerical Jacobian (Marquardt, *An algorithm for
    /// least-squares estimation of nonlinear parameters*, J. SIAM 11, 1963). Each step is clamped to the bounds.
    /// Returns the remaining RMS error, dB.
    fn refine(&self, sections: &mut Vec<Section>) -> f64 {
        let mut residual = self.residual(sections);
        let mut damping: f64 = 1e-2;
        for _ in 0..ROUNDS {
            let jacobian = self.jacobian(sections);
            let square = jacobian.tr_mul(&jacobian);
            let gradient = jacobian.tr_mul(&residual);
            let mut damped = square.clone();
            for place in 0..damped.nrows() {
                // The frequency and the Q of a section without gain change nothing. Their diagonal elements are zero
                // and need a lower bound.
                damped[(place, place)] += damping * square[(place, place)].max(1e-9);
            }
            let Some(step) = damped.cholesky().map(|matrix| matrix.solve(&gradient)) else {
                break;
            };
            let tried: Vec<Section> = sections
                .iter()
                .enumerate()
                .map(|(index, section)| {
                    let part = [0, 1, 2].map(|own| step[3 * index + own].clamp(-3.0, 3.0));
                    self.within_bounds(moved(section, part))
                })
                .collect();
            let left = self.residual(&tried);
            if left.norm() < residual.norm() {
                let gained = 1.0 - left.norm() / residual.norm();
                (*sections, residual) = (tried, left);
                damping = (damping / 5.0).max(1e-9);
                if gained < 1e-5 {
                    break;
                }
            } else {
                damping *= 5.0;
                if damping > 1e9 {
                    break;
                }
            }
        }
        self.error(&residual)
    }

    /// Derivatives of the level at each frequency with respect to ln f, ln Q and gain of each section.
    fn jacobian(&self, sections: &[Section]) -> DMatrix<f64> {
        const STEP: f64 = 1e-4;
        let mut jacobian = DMatrix::zeros(self.frequencies.len(), 3 * sections.len());
        for (index, section) in sections.iter().enumerate() {
            for own in 0..3 {
                let aside = |sign: f64| {
                    let mut part = [0.0; 3];
                    part[own] = sign * STEP;
                    moved(section, part)
                };
                let (above, below) = (aside(1.0), aside(-1.0));
                for (row, &hz) in self.frequencies.iter().enumerate() {
                    let change = above.level_db(self.rate_hz, hz) - below.level_db(self.rate_hz, hz);
                    jacobian[(row, 3 * index + own)] = change / (2.0 * STEP);
                }
            }
        }
        jacobian
    }

    fn within_bounds(&self, section: Section) -> Section {
        /// Least distance of a pole from the unit circle that the format allows, with a margin for round-off.
        const LEAST_DAMPING: f64 = 1.1e-3;
        let [low, high] = self.band_hz;
        let frequency_hz = section.frequency_hz.clamp(low, high);
        let gain_db = section
            .gain_db
            .clamp(-MAX_SECTION_GAIN_DB + 1.0, MAX_SECTION_GAIN_DB - 1.0);
        let [least, most] = match section.kind {
            SectionKind::Peaking => PEAKING_QS,
            SectionKind::LowShelf | SectionKind::HighShelf => SHELF_QS,
        };
        // The pole radius of a peak is about 1 - sin(w) / (2 Q A), where A is the square root of its gain.
        let narrowest = (std::f64::consts::TAU * frequency_hz / self.rate_hz).sin()
            / (2.0 * 10f64.powf(gain_db / 40.0) * LEAST_DAMPING);
        Section {
            kind: section.kind,
            frequency_hz,
            // The upper bound is kept above the lower one, otherwise `clamp` would panic.
            q: section.q.clamp(least, most.min(narrowest.max(least))),
            gain_db,
        }
    }
}

/// Returns the section with ln f, ln Q and the gain in dB changed by the given amounts.
fn moved(section: &Section, [ln_frequency, ln_q, gain_db]: [f64; 3]) -> Section {
    Section {
        kind: section.kind,
        frequency_hz: section.frequency_hz * ln_frequency.exp(),
        q: section.q * ln_q.exp(),
        gain_db: section.gain_db + gain_db,
    }
}
