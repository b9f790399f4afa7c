// The power spectrum of what sounds: Welch's estimate (Hann's window, half overlapping), averaged over the last second;
// and the mean, over the same windows, of what is compared with it.

class LiveSpectrum {
  // `frequencies` are where it is shown, Hz, ascending by one ratio.
  constructor(rate, frequencies) {
    this.rate = rate;
    this.frequencies = frequencies;
    // 0.4 s, for lines of 2.4 Hz.
    this.length = 2 ** Math.round(Math.log2(0.41 * rate));
    const { length } = this;
    this.window = Float64Array.from({ length }, (_, n) => 0.5 - 0.5 * Math.cos((2 * Math.PI * (n + 0.5)) / length));
    this.energy = this.window.reduce((sum, w) => sum + w * w, 0);
    this.cos = Float64Array.from({ length: length / 2 }, (_, k) => Math.cos((2 * Math.PI * k) / length));
    this.sin = Float64Array.from({ length: length / 2 }, (_, k) => -Math.sin((2 * Math.PI * k) / length));
    this.clear();
  }

  clear() {
    this.pending = [];
    this.besides = [];
    this.density = null;
    this.compared = {};
    this.count = 0;
  }

  // Adds samples, m/s², and what is compared with them: by name, densities at the frequencies, or null. Returns true if
  // the estimate has changed.
  add(samples, beside = {}) {
    for (const sample of samples) {
      this.pending.push(sample);
      this.besides.push(beside);
    }
    let isNew = false;
    while (this.pending.length >= this.length) {
      this.average(this.densityOf(this.pending), this.besideOf(this.besides));
      this.pending.splice(0, this.length / 2);
      this.besides.splice(0, this.length / 2);
      isNew = true;
    }
    return isNew;
  }

  // (m/s²)²/Hz of each bin from 0 to half the rate.
  densityOf(samples) {
    const { length, window } = this;
    const re = Float64Array.from({ length }, (_, n) => samples[n] * window[n]);
    const im = new Float64Array(length);
    this.transform(re, im);
    const scale = 2 / (this.rate * this.energy);
    return Float64Array.from({ length: length / 2 }, (_, k) => scale * (re[k] ** 2 + im[k] ** 2));
  }

  // By name, the mean of what belongs to a window's samples, by their share of its energy; nothing if half has none.
  besideOf(besides) {
    const shares = new Map();
    this.window.forEach((w, n) => shares.set(besides[n], (shares.get(besides[n]) ?? 0) + (w * w) / this.energy));
    const mean = {};
    for (const name of new Set([...shares.keys()].flatMap(Object.keys))) {
      const known = [...shares].filter(([beside]) => beside[name]);
      const whole = known.reduce((sum, [, share]) => sum + share, 0);
      if (whole <= 0.5) continue;
      const sumAt = (k) => known.reduce((sum, [beside, share]) => sum + share * beside[name][k], 0);
      mean[name] = this.frequencies.map((_, k) => sumAt(k) / whole);
    }
    return mean;
  }

  average(density, beside) {
    this.count += 1;
    // The mean of the first ones, then an exponential one over a second.
    const share = Math.max(1 / this.count, this.length / 2 / this.rate);
    const mixed = (before, now) => (before ? before.map((old, k) => old + share * (now[k] - old)) : now);
    this.density = mixed(this.density, density);
    const names = Object.entries(beside);
    this.compared = Object.fromEntries(names.map(([name, now]) => [name, mixed(this.compared[name], now)]));
  }

  // Levels at the frequencies, dB re 1 (m/s²)²/Hz: the mean over each one's share of an octave. -Infinity is silence.
  levels() {
    const { frequencies, density } = this;
    if (!density) return null;
    const ratio = Math.sqrt(frequencies[1] / frequencies[0]);
    const bin = this.rate / this.length;
    return frequencies.map((f) => 10 * Math.log10(meanOver(density, f / ratio / bin, (f * ratio) / bin)));
  }

  // Radix-2 transform in place.
  transform(re, im) {
    const { length } = this;
    for (let i = 1, j = 0; i < length; i++) {
      let bit = length >> 1;
      for (; j & bit; bit >>= 1) j ^= bit;
      j ^= bit;
      if (i < j) {
        [re[i], re[j]] = [re[j], re[i]];
        [im[i], im[j]] = [im[j], im[i]];
      }
    }
    for (let half = 1; half < length; half *= 2) {
      const stride = length / (2 * half);
      for (let begin = 0; begin < length; begin += 2 * half) {
        for (let k = 0; k < half; k++) {
          const [c, s] = [this.cos[k * stride], this.sin[k * stride]];
          const [a, b] = [begin + k, begin + k + half];
          const [x, y] = [re[b] * c - im[b] * s, re[b] * s + im[b] * c];
          [re[b], im[b]] = [re[a] - x, im[a] - y];
          [re[a], im[a]] = [re[a] + x, im[a] + y];
        }
      }
    }
  }
}

// Mean of a density, constant around each bin, from one place to another, in bins.
function meanOver(density, from, to) {
  let sum = 0;
  for (let k = Math.round(from); k <= Math.round(to) && k < density.length; k++) {
    const overlap = Math.min(to, k + 0.5) - Math.max(from, k - 0.5);
    if (overlap > 0) sum += density[k] * overlap;
  }
  return sum / (to - from);
}
