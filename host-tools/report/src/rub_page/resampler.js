// Samples of the kernel, 5 or 10 kHz, at the rate of the audio context, by the polyphase filter of the kernel's module.

class Resampler {
  constructor(filter) {
    this.filter = filter;
    // Twice in a row, so that the last samples, from the newest on, are always contiguous.
    this.past = new Float32Array(2 * filter.taps);
    this.newest = 0;
    this.phase = filter.phases;
  }

  // The next output. `source.next()` gives the next sample at the filter's input rate.
  next(source) {
    const { rows, taps, phases, step } = this.filter;
    while (this.phase >= phases) {
      this.phase -= phases;
      this.newest = (this.newest === 0 ? taps : this.newest) - 1;
      const sample = source.next();
      this.past[this.newest] = sample;
      this.past[this.newest + taps] = sample;
    }
    const row = this.phase * taps;
    this.phase += step;
    let sum = 0;
    for (let tap = 0; tap < taps; tap++) {
      sum += rows[row + tap] * this.past[this.newest + tap];
    }
    return sum;
  }
}
