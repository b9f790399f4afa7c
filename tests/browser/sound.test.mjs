// The worklet's sound, computed outside of a browser from a page's own text: filter, voices, crossfades, silence.

import assert from "node:assert/strict";
import { test } from "node:test";

import { OfflineWorklet, declared, partsOf } from "./worklet.mjs";

const parts = partsOf(process.env.STYLUS_PAGE);
const { Resampler, Kernel } = declared(parts.worklet, ["Resampler", "Kernel"]);
const module = new WebAssembly.Module(parts.kernel);
const choice = { texture: 0, seed: 1, without: 0, recording: false };
const stroke = { speed: 120, force: 0.8 };

// Amplitude of a frequency in a signal, under Hann's window.
function amplitude(signal, frequency, rate) {
  let [re, im, sum] = [0, 0, 0];
  signal.forEach((value, n) => {
    const window = 0.5 - 0.5 * Math.cos((2 * Math.PI * (n + 0.5)) / signal.length);
    const angle = (2 * Math.PI * frequency * n) / rate;
    re += window * value * Math.cos(angle);
    im -= window * value * Math.sin(angle);
    sum += window;
  });
  return (2 * Math.hypot(re, im)) / sum;
}

const decibels = (ratio) => 20 * Math.log10(ratio);

test("tones pass the filter within 0.1 dB and their images are 80 dB lower, at every rate of a context", () => {
  for (const [from, to] of [[5000, 44_100], [5000, 48_000], [5000, 96_000], [10_000, 44_100], [10_000, 48_000]]) {
    const filter = Kernel.filter(module, from, to);
    for (const share of [0.002, 0.05, 0.2, 0.4]) {
      const tone = share * from;
      let n = 0;
      const source = { next: () => Math.sin((2 * Math.PI * tone * n++) / from) };
      const resampler = new Resampler(filter);
      const signal = Array.from({ length: to }, () => resampler.next(source)).slice(to / 10);
      const passed = amplitude(signal, tone, to);
      assert.ok(Math.abs(decibels(passed)) < 0.1, `${tone} Hz of ${from} to ${to}: ${decibels(passed)} dB`);
      for (let image = from - tone; image < to / 2; image += from) {
        for (const frequency of [image, image + 2 * tone]) {
          if (frequency >= to / 2) continue;
          const level = decibels(amplitude(signal, frequency, to) / passed);
          assert.ok(level < -80, `image of ${tone} Hz at ${frequency} Hz, ${from} to ${to}: ${level} dB`);
        }
      }
    }
  }
});

test("the filter delays by as much as the page says", () => {
  for (const [from, to] of [[5000, 44_100], [5000, 48_000], [10_000, 48_000]]) {
    const filter = Kernel.filter(module, from, to);
    const resampler = new Resampler(filter);
    // A slow ramp's value is its time.
    let n = 0;
    const source = { next: () => n++ / from };
    const count = to;
    let last = 0;
    for (let k = 0; k < count; k++) last = resampler.next(source);
    const delay = (count - 1) / to - last;
    assert.ok(Math.abs(delay - filter.delay) < 1e-5, `${delay} s of ${filter.delay} s`);
    assert.ok(delay < 0.6e-3, `${delay} s`);
  }
});

test("a take holds the kernel's words for its own motion, and what sounded is these words through the filter", () => {
  const worklet = new OfflineWorklet(parts, 48_000);
  worklet.tell({ type: "gain", gain: 1 / 30 });
  worklet.tell({ type: "choose", choice: { ...choice, seed: 7 }, take: true });
  const hand = (time) => ({
    speed: 150 + 100 * Math.sin(9 * time),
    force: 0.5 + 0.3 * Math.sin(4 * time),
    contact: time > 0.1,
  });
  const output = worklet.run(2, hand);
  worklet.tell({ type: "take" });
  const [take] = worklet.taken("taken");
  assert.ok(take.words.length > 9900 && take.words.some((word) => word !== 0));
  const kernel = new Kernel(module, parts.library);
  kernel.choose({ texture: 0, seed: 7 });
  const words = [];
  let position = take.start;
  for (let block = 0; block < take.motion.length / 4; block++) {
    const [speed, force, after, contact] = take.motion.slice(4 * block, 4 * block + 4);
    const last = position + (after - position) * 0.9;
    kernel.motion.set([speed, force, position, last, contact]);
    kernel.run(1);
    words.push(...kernel.words.subarray(0, 10));
    position = after;
  }
  assert.deepEqual([...take.words], words);
  // The gain has come up after 0.1 s.
  const resampler = new Resampler(Kernel.filter(module, 5000, 48_000));
  let n = 0;
  const source = { next: () => (words[n++] ?? 0) / 2 ** 20 };
  const expected = output.map(() => resampler.next(source) / 30);
  let largest = 0;
  for (let k = 9600; k < output.length - 4800; k++) largest = Math.max(largest, Math.abs(output[k] - expected[k]));
  assert.ok(largest < 1e-5, `${largest}`);
});

// The largest step from sample to sample.
const roughness = (signal) => Math.max(...signal.slice(1).map((sample, n) => Math.abs(sample - signal[n])));

test("comparing makes no click: no step is larger than those of either sound", () => {
  const others = [{ ...choice, without: 1 }, { ...choice, seed: 2 }, { ...choice, texture: 1 }];
  if (parts.data.clips.length > 0) others.push({ ...choice, recording: true });
  for (const other of others) {
    const worklet = new OfflineWorklet(parts, 48_000);
    worklet.tell({ type: "gain", gain: 0.01 });
    const samples = Float32Array.from({ length: 5000 }, (_, n) => Math.sin(n / 4));
    const clip = { speed: 120, force: 0.8, node: 0, rate: 5000, samples };
    worklet.tell({ type: "clips", texture: 0, rate: 5000, clips: [clip] });
    worklet.tell({ type: "choose", choice });
    worklet.run(0.3, stroke);
    let [before, after] = [worklet.run(1, stroke), []];
    for (let turn = 0; turn < 6; turn++) {
      worklet.tell({ type: "choose", choice: turn % 2 === 0 ? other : choice });
      const change = worklet.run(0.05, stroke);
      after = worklet.run(1, stroke);
      const bound = 1.5 * Math.max(roughness(before), roughness(after));
      const step = roughness([before.at(-1), ...change]);
      assert.ok(step <= bound, `${JSON.stringify(other)}: ${step} of ${bound}`);
      before = after;
    }
    assert.deepEqual(worklet.taken("fault"), []);
  }
});

test("a choice in the middle of another's fade, many times, never fails and never ends in silence", () => {
  const worklet = new OfflineWorklet(parts, 44_100);
  worklet.tell({ type: "gain", gain: 0.01 });
  const textures = parts.data.textures.length;
  for (let n = 0; n < 200; n++) {
    worklet.tell({ type: "choose", choice: { ...choice, texture: n % textures, seed: n }, take: n % 3 === 0 });
    worklet.run(0.003 * (n % 5), stroke);
  }
  const output = worklet.run(1, stroke).slice(-22_050);
  assert.ok(output.some((sample) => sample !== 0));
  assert.deepEqual(worklet.taken("fault"), []);
});

test("a hand that is told no more is lifted after a quarter of a second, and silence is exactly zero", () => {
  const worklet = new OfflineWorklet(parts, 48_000);
  worklet.tell({ type: "gain", gain: 0.01 });
  worklet.tell({ type: "choose", choice });
  assert.ok(worklet.run(0.5, stroke).some((sample) => sample !== 0));
  // As if the page hung while it touched.
  const after = worklet.run(1.5);
  assert.ok(after.slice(0, 4800).some((sample) => sample !== 0));
  assert.ok(after.slice(-24_000).every((sample) => sample === 0));
  assert.ok(worklet.run(0.5, stroke).some((sample) => sample !== 0), "and goes on when the page is back");
});

test("along a scene's path the tool keeps the hand's speed, whatever the steps of its places, and arrives", () => {
  const worklet = new OfflineWorklet(parts, 48_000);
  worklet.tell({ type: "choose", choice: { scene: 0, seed: 1, without: 0, recording: false }, take: true });
  let told = 0;
  // A pointer that reports its place 60 times per second, and turns after each second.
  const hand = (time) => {
    if (time - told > 1 / 60) told = time;
    const place = (time) => 30 + 160 * (time % 2 < 1 ? time % 1 : 1 - (time % 1));
    return { speed: 160, along: told % 2 < 1 ? 160 : -160, force: 0.8, path: place(told) };
  };
  worklet.run(3.9, hand);
  worklet.run(1.2, { speed: 0, along: 0, force: 0.8, path: 35 });
  worklet.tell({ type: "take" });
  const [{ motion }] = worklet.taken("taken");
  const blocks = Array.from({ length: motion.length / 4 }, (_, n) => motion.slice(4 * n, 4 * n + 4));
  const moving = blocks.filter((_, n) => n > 10 && n < 1900 && n % 500 > 30);
  for (const [speed] of moving) assert.ok(Math.abs(Math.abs(speed) - 160) < 25, `${speed} mm/s`);
  assert.ok(Math.abs(blocks.at(-1)[2] - 35) <= 0.51, `${blocks.at(-1)[2]} mm`);
  assert.equal(blocks.at(-1)[0], 0);
});

test("a stall of the audio clock is counted, and bursts of callbacks are not", () => {
  const worklet = new OfflineWorklet(parts, 48_000);
  worklet.tell({ type: "choose", choice });
  for (let burst = 0; burst < 50; burst++) {
    worklet.run(0.032, stroke);
    worklet.clock += burst % 2 === 0 ? 20 : -20;
  }
  assert.equal(worklet.taken("played").at(-1).gaps, 0);
  worklet.clock += 150;
  worklet.run(0.2, stroke);
  assert.equal(worklet.taken("played").at(-1).gaps, 1);
});

test("the first sample that a move changes comes within 20 ms, the filter's delay with it", () => {
  for (const sampleRate of [44_100, 48_000]) {
    const worklet = new OfflineWorklet(parts, sampleRate);
    worklet.tell({ type: "gain", gain: 0.01 });
    worklet.tell({ type: "choose", choice });
    const still = { ...stroke, speed: 0 };
    assert.ok(worklet.run(0.2, still).every((sample) => sample === 0));
    worklet.hand(stroke);
    const output = worklet.run(0.1);
    const first = output.findIndex((sample) => Math.abs(sample) > 1e-7);
    assert.ok(first >= 0 && first / sampleRate < 0.02, `${(1000 * first) / sampleRate} ms`);
  }
});

test("no output is beyond full scale, and what was cut is counted", () => {
  const worklet = new OfflineWorklet(parts, 48_000);
  worklet.tell({ type: "gain", gain: 1e6 });
  worklet.tell({ type: "choose", choice });
  const output = worklet.run(1, stroke);
  assert.ok(output.every((sample) => Math.abs(sample) <= 1));
  assert.ok(worklet.taken("played").some((report) => report.clipped > 0));
});

test("a kernel that cannot play says why, once, and leaves silence", () => {
  const worklet = new OfflineWorklet({ ...parts, library: parts.library.slice(0, 100) }, 48_000);
  const [fault] = worklet.taken("fault");
  assert.ok(fault.text.length > 10, fault.text);
  worklet.tell({ type: "choose", choice });
  assert.ok(worklet.run(0.1, stroke).every((sample) => sample === 0));
});
