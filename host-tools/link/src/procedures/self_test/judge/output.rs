//! The output's pin, read back by a converter.

use model_format::link::{
    CONVERSIONS_PER_CODE, OUTPUT_CODE_STEP, OUTPUT_CODES, OutputValues, REST_CONVERSIONS, RestValues, STEP_CODES,
    STEP_INSTANT_CYCLES, STEP_INSTANTS, output_code,
};

use crate::procedures::self_test::line::Line;

/// Words of the 16-bit converter per code of the 12-bit output.
const WORDS_PER_CODE: f64 = 16.0;

/// Limits of the gain of output and converter together. They allow twice the 1 % of the DAC (DS12110, gain error).
const GAIN: (f64, f64) = (0.98, 1.02);

/// Largest offset at mid-scale, codes of 12 bits. It is twice the 12 LSB of the DAC (DS12110, offset error at middle
/// code).
const OFFSET_CODES: f64 = 24.0;

/// Largest distance of a code's mean reading from the line through all of them, codes. It is twice the 4 LSB of the DAC
/// (DS12110, integral linearity).
const BEND_CODES: f64 = 8.0;

/// Smallest and largest step between two neighbouring codes of the sweep.
const STEP_OF_CODES: (f64, f64) = (OUTPUT_CODE_STEP as f64 - 8.0, OUTPUT_CODE_STEP as f64 + 8.0);

/// Largest noise at mid-scale, codes RMS.
const NOISE_CODES: f64 = 2.0;

/// Largest distance of the lowest from the highest word at rest, codes: eight times [`NOISE_CODES`].
const REST_RANGE_CODES: f64 = 8.0 * NOISE_CODES;

/// Code at rest.
const MID_SCALE: f64 = 2048.0;

/// Largest delay from the trigger to half of the step, µs. The buffered DAC settles within 3 µs (DS12110, settling
/// time).
const DELAY_US: f64 = 3.0;

/// Distance from its end at which a step counts as settled, codes.
const SETTLED_CODES: f64 = 16.0;

/// Longest time until a step has settled, µs.
const SETTLED_US: f64 = 8.0;

const AMPLIFIER: &str = "take the amplifier's input off PA4 and test again, because a load bends the output; if it \
                         stays, the chip's output is damaged";

/// Returns the mean word for each code of the sweep, in codes.
fn means(values: &OutputValues) -> [f64; OUTPUT_CODES] {
    values
        .sums
        .map(|sum| f64::from(sum) / f64::from(CONVERSIONS_PER_CODE) / WORDS_PER_CODE)
}

/// Slope and value at mid-scale of the straight line through `means`, by least squares.
fn line_through(means: &[f64; OUTPUT_CODES]) -> (f64, f64) {
    let codes: Vec<f64> = (0..OUTPUT_CODES).map(|n| f64::from(output_code(n))).collect();
    let count = OUTPUT_CODES as f64;
    let (code, mean) = (codes.iter().sum::<f64>() / count, means.iter().sum::<f64>() / count);
    let spread: f64 = codes.iter().map(|x| (x - code).powi(2)).sum();
    let product = codes.iter().zip(means).map(|(x, y)| (x - code) * (y - mean));
    let slope = product.sum::<f64>() / spread;
    (slope, mean + slope * (MID_SCALE - code))
}

/// Returns the delays until half of the step and until the step has settled, µs; none if that does not happen.
fn delays(values: &OutputValues, core_hz: u32, (slope, middle): (f64, f64)) -> [Option<f64>; 2] {
    let ends = STEP_CODES.map(|code| middle + slope * (f64::from(code) - MID_SCALE));
    let words = values.step_words.map(|word| f64::from(word) / WORDS_PER_CODE);
    let instant_us = |index: usize| {
        let cycles = index as u32 * STEP_INSTANT_CYCLES + values.sample_cycles;
        f64::from(cycles) * 1e6 / f64::from(core_hz)
    };
    let half = f64::midpoint(ends[0], ends[1]);
    let first = |has: &dyn Fn(f64) -> bool| {
        // All later words must satisfy it too, so that one disturbed word does not count as the end.
        let away = words.iter().rposition(|&word| !has(word));
        let index = away.map_or(0, |last| last + 1);
        (index < STEP_INSTANTS).then(|| instant_us(index))
    };
    [
        first(&|word| word > half),
        first(&|word| (word - ends[1]).abs() <= SETTLED_CODES),
    ]
}

/// A delay, or its absence.
fn delay_line(name: &str, delay: Option<f64>, limit_us: f64) -> Line {
    match delay {
        Some(delay) => Line::number(name, delay, (f64::NEG_INFINITY, limit_us), ("µs", 1), AMPLIFIER),
        None => Line::judged(name, "never", format!("at most {limit_us:.1} µs"), false, AMPLIFIER),
    }
}

/// Judges the pin of an output at rest.
pub fn rest(values: &RestValues) -> Vec<Line> {
    const DRIVEN: &str = "something drives or loads PA4, or the output does not run: take the amplifier's input off \
         PA4, restart and test again";
    let mean = f64::from(values.sum) / f64::from(REST_CONVERSIONS) / WORDS_PER_CODE;
    let [lowest, highest] = values.range.map(f64::from);
    let (offset, range) = (mean - MID_SCALE, (highest - lowest) / WORDS_PER_CODE);
    let (limits, most) = ((-OFFSET_CODES, OFFSET_CODES), (0.0, REST_RANGE_CODES));
    vec![
        Line::number("output at rest", offset, limits, ("codes", 1), DRIVEN),
        Line::number("output still at rest", range, most, ("codes peak to peak", 1), DRIVEN),
    ]
}

const UNEVEN: &str = "the output's steps are uneven: a bit of the DAC is stuck; replace the board";
const DISTURBED: &str = "the reference or the ground is disturbed: keep the probe's cable away from supplies, and \
     test again";

/// Judges the output of a device whose core runs at `core_hz`.
pub fn output(values: &OutputValues, core_hz: u32) -> Vec<Line> {
    let means = means(values);
    let (slope, middle) = line_through(&means);
    // With so small a slope, offset and delays would only show noise.
    if slope.abs() < 0.1 {
        return vec![Line::judged(
            "output at PA4",
            "does not follow its code",
            "follows",
            false,
            "PA4 is shorted or the chip's output is dead: take everything off PA4 and test again",
        )];
    }
    let offset = middle - MID_SCALE;
    let offsets = (-OFFSET_CODES, OFFSET_CODES);
    let noise = f64::from(values.noise) / WORDS_PER_CODE;
    let [half, settled] = delays(values, core_hz, (slope, middle));
    let follows = Line::judged("output at PA4", "follows its code", "follows", true, "");
    let mut lines = vec![
        follows,
        Line::number("output gain", slope, GAIN, ("", 4), AMPLIFIER),
        Line::number("output offset", offset, offsets, ("codes", 1), AMPLIFIER),
    ];
    lines.extend(evenness(&means, (slope, middle)));
    lines.push(Line::number(
        "output noise",
        noise,
        (f64::NEG_INFINITY, NOISE_CODES),
        ("codes RMS", 2),
        DISTURBED,
    ));
    lines.push(delay_line("output delay", half, DELAY_US));
    lines.push(delay_line("output settled", settled, SETTLED_US));
    lines
}

/// Judges the distance of `means` from the straight line through them, and their steps.
fn evenness(means: &[f64; OUTPUT_CODES], (slope, middle): (f64, f64)) -> [Line; 3] {
    let bend = (0..OUTPUT_CODES)
        .map(|n| (means[n] - middle - slope * (f64::from(output_code(n)) - MID_SCALE)).abs())
        .fold(0.0, f64::max);
    let steps = means.windows(2).map(|pair| pair[1] - pair[0]);
    let smallest = steps.clone().fold(f64::INFINITY, f64::min);
    let largest = steps.fold(f64::NEG_INFINITY, f64::max);
    let bends = (f64::NEG_INFINITY, BEND_CODES);
    let step = |name, value| Line::number(name, value, STEP_OF_CODES, ("codes", 1), UNEVEN);
    [
        Line::number("output bend", bend, bends, ("codes", 1), AMPLIFIER),
        step("output smallest step", smallest),
        step("output largest step", largest),
    ]
}
