// Samples of the kernel, 5 or 10 kHz, at the rate of the audio context: interpolation by a polyphase filter, a windowed
// sinc (Kaiser's window) with its corner at half the kernel's rate.
//
// At 5 kHz, tones up to 2150 Hz pass within 0.1 dB, and their images, from 2850 Hz on, are at least 60 dB lower; at
// 10 kHz all of that is at twice the frequency. What is between 2150 and 2500 Hz has images between 2500 and 2850 Hz.
// The filter is symmetric; it delays by half its length, 3.2 ms at 5 kHz.

const FILTER_TAPS = 32;
const KAISER_BETA = 6.8;

// Modified Bessel function of the first kind, order 0, by its power series.
function besselI0(x) {
  let term = 1;
  let sum = 1;
  for (let k = 1; term > 1e-12 * sum; k++) {
    term *= (x / (2 * k)) ** 2;
    sum += term;
  }
  return sum;
}

function greatestCommonDivisor(a, b) {
  return b === 0 ? a : greatestCommonDivisor(b, a % b);
}

// The filter from `from` Hz to `to` Hz, both whole numbers, `to` at least `from`: phase after phase, each of
// FILTER_TAPS coefficients for the samples from the oldest on.
class PolyphaseFilter {
  constructor(from, to) {
    const common = greatestCommonDivisor(from, to);
    this.up = to / common;
    this.down = from / common;
    this.table = new Float32Array(this.up * FILTER_TAPS);
    for (let phase = 0; phase < this.up; phase++) this.fill(phase);
  }

  fill(phase) {
    const half = FILTER_TAPS / 2;
    const values = [];
    for (let tap = 0; tap < FILTER_TAPS; tap++) {
      // Time from the sample of this tap to the output, in samples.
      const time = half - 1 - tap + phase / this.up;
      const window = besselI0(KAISER_BETA * Math.sqrt(Math.max(0, 1 - (time / half) ** 2)));
      values.push(window * (time === 0 ? 1 : Math.sin(Math.PI * time) / (Math.PI * time)));
    }
    // Each phase passes a constant as it is, so that a constant has no image at all.
    const sum = values.reduce((a, b) => a + b);
    this.table.set(
      values.map((value) => value / sum),
      phase * FILTER_TAPS,
    );
  }
}

class Resampler {
  constructor(filter) {
    this.filter = filter;
    // Twice in a row, so that the last FILTER_TAPS samples are always contiguous.
    this.history = new Float32Array(2 * FILTER_TAPS);
    this.at = 0;
    this.phase = filter.up;
  }

  // Delay of the filter, s.
  static delay(from) {
    return (FILTER_TAPS / 2) / from;
  }

  // The next output. `source.next()` gives the next sample at `from` Hz.
  next(source) {
    const { up, down, table } = this.filter;
    while (this.phase >= up) {
      this.phase -= up;
      const sample = source.next();
      this.history[this.at] = sample;
      this.history[this.at + FILTER_TAPS] = sample;
      this.at = (this.at + 1) % FILTER_TAPS;
    }
    const row = this.phase * FILTER_TAPS;
    this.phase += down;
    let sum = 0;
    for (let tap = 0; tap < FILTER_TAPS; tap++) {
      sum += table[row + tap] * this.history[this.at + tap];
    }
    return sum;
  }
}
