// The hand, the grid and the spectrum, by the page's own scripts: a pointer's places to speeds, a keys' stroke, nodes of a
// voice, Welch's estimate.

import assert from "node:assert/strict";
import fs from "node:fs";
import path from "node:path";
import { test } from "node:test";
import vm from "node:vm";

const scripts = path.join(import.meta.dirname, "../../host-tools/report/src/rub_page");

// What these scripts declare.
function load(files, names) {
  const context = vm.createContext({});
  for (const file of files) vm.runInContext(fs.readFileSync(path.join(scripts, file), "utf8"), context);
  return vm.runInContext(`({ ${names.join(", ")} })`, context);
}

const { PointerPath, KeyStroke } = load(["stroke.js"], ["PointerPath", "KeyStroke"]);
const { distinctNodes, beyondGrid } = load(["data.js"], ["distinctNodes", "beyondGrid"]);
const { LiveSpectrum } = load(["spectrum.js"], ["LiveSpectrum"]);

// Numbers from 0 to 1, by a xorshift of 32 bits (Marsaglia, 2003).
function generator(seed) {
  let state = seed;
  return () => {
    state ^= state << 13;
    state ^= state >>> 17;
    state ^= state << 5;
    return (state >>> 0) / 2 ** 32;
  };
}

// A path of 600 ms at `speed`, px/s, in whole pixels, an event every `interval` ms.
function steady(speed, interval) {
  const path = new PointerPath();
  for (let time = 0; time <= 600; time += interval) path.add(time, Math.round((speed * time) / 1000), 5);
  return path;
}

test("a steady pointer has its speed, whatever the interval of its events", () => {
  for (const interval of [1, 4, 8, 16.7]) {
    for (const speed of [100, 400, 1500]) {
      const path = steady(speed, interval);
      const last = path.points.at(-1).time;
      const found = path.speed(last);
      // A pixel more or less in the window of a slow one.
      const bound = Math.max(0.05, 1.2 / ((speed * 0.08) - 1));
      assert.ok(Math.abs(found / speed - 1) <= bound, `${speed} px/s every ${interval} ms: ${found}`);
      assert.equal(path.speed(last + interval), found, "between two events the speed is held");
      assert.equal(path.along(last), found, "and is all along the patch");
    }
  }
});

test("a pointer that rests has no speed after 80 ms, and one that has not moved has none", () => {
  for (const interval of [1, 8, 16.7]) {
    const path = steady(500, interval);
    const last = path.points.at(-1).time;
    let before = path.speed(last);
    for (let late = 0; late <= 80; late += 2) {
      const speed = path.speed(last + late);
      assert.ok(speed <= before, "it only falls");
      before = speed;
    }
    assert.equal(before, 0);
  }
  const path = new PointerPath();
  path.add(10, 3, 3);
  assert.equal(path.speed(12), 0);
});

test("a speed is never negative, infinite or above what the places allow", () => {
  const random = generator(12345);
  for (let round = 0; round < 200; round++) {
    const path = new PointerPath();
    let [time, x, fastest] = [0, 0, 0];
    for (let event = 0; event < 60; event++) {
      // Moments may repeat or go back, as coalesced events do.
      const step = random() < 0.1 ? 0 : random() * 30;
      const way = Math.round((random() - 0.5) * 60);
      time += step;
      x += way;
      path.add(time, x, 0);
      for (const [index, point] of path.points.entries()) {
        const from = path.points[index - 1];
        if (from) fastest = Math.max(fastest, (1000 * (point.path - from.path)) / (point.time - from.time));
      }
      const speed = path.speed(time + random() * 20);
      assert.ok(speed >= 0 && speed <= fastest * 1.000001, `${speed} of ${fastest}`);
    }
  }
});

test("a stroke of the keys turns at the ends and goes as far as its speed says", () => {
  const stroke = new KeyStroke();
  let way = 0;
  stroke.hold(1);
  for (let n = 0; n < 5000; n++) {
    const before = stroke.place;
    stroke.step(4, 120, 80);
    assert.ok(stroke.place >= 0 && stroke.place <= 1);
    way += Math.abs(stroke.place - before) * 80;
  }
  // At a turn a step is folded, and seems shorter.
  assert.ok(way <= 2400.001 && way > 2350, `${way} mm in 20 s at 120 mm/s`);
  stroke.hold(-1);
  stroke.release(-1);
  assert.equal(stroke.direction, 1, "the key that is still held counts");
  stroke.release(1);
  assert.equal(stroke.moves, false);
});

test("a voice's nodes are each told once, with all of their weight, whatever the grid", () => {
  const inside = { nodes: [3, 4, 8, 9], weights: [0.1, 0.2, 0.3, 0.4] };
  assert.deepEqual(distinctNodes(inside).flat().join(), "3,0.1,4,0.2,8,0.3,9,0.4");
  assert.equal(distinctNodes({ nodes: [7, 7, 7, 7], weights: [1, 0, 0, 0] }).flat().join(), "7,1");
  const random = generator(4711);
  for (let round = 0; round < 200; round++) {
    const nodes = Array.from({ length: 4 }, () => Math.floor(3 * random()));
    const weights = nodes.map(random);
    const found = distinctNodes({ nodes, weights });
    assert.equal(new Set(found.map(([node]) => node)).size, found.length);
    for (const [node, weight] of found) {
      const parts = weights.filter((_, corner) => nodes[corner] === node);
      assert.ok(Math.abs(weight - parts.reduce((sum, part) => sum + part, 0)) < 1e-12);
    }
    assert.equal(found.length, new Set(nodes).size);
  }
});

test("the spectrum of white noise is its power over its band, and a tone's power is its own", () => {
  const rate = 5000;
  const frequencies = Array.from({ length: 68 }, (_, n) => 20 * 2 ** (n / 12));
  const spectrum = new LiveSpectrum(rate, frequencies);
  const uniform = generator(99);
  const random = () => uniform() - 0.5;
  const samples = Float32Array.from({ length: 60 * rate }, random);
  // All at one weight, as the first windows are.
  const densities = [];
  for (let at = 0; at + spectrum.length <= samples.length; at += spectrum.length) {
    densities.push(spectrum.densityOf(samples.subarray(at, at + spectrum.length)));
  }
  const mean = densities[0].map((_, k) => densities.reduce((sum, density) => sum + density[k], 0) / densities.length);
  const power = mean.reduce((sum, density) => sum + density, 0) * (rate / spectrum.length);
  assert.ok(Math.abs(10 * Math.log10(power * 12)) < 0.2, "the power is 1/12");
  const expected = 1 / 12 / (rate / 2);
  spectrum.density = mean;
  for (const level of spectrum.levels()) assert.ok(Math.abs(level - 10 * Math.log10(expected)) < 2);

  const tone = new LiveSpectrum(rate, frequencies);
  tone.add(Float32Array.from({ length: 3 * rate }, (_, n) => 2 * Math.sin((2 * Math.PI * 237 * n) / rate)));
  const total = tone.density.reduce((sum, density) => sum + density, 0) * (rate / tone.length);
  assert.ok(Math.abs(total / 2 - 1) < 0.01, "half the square of the amplitude");
  const highest = tone.levels().indexOf(Math.max(...tone.levels()));
  assert.ok(Math.abs(Math.log2(frequencies[highest] / 237)) <= 1 / 24);
});

test("what is compared with a sound is averaged over the same windows, however it changes", () => {
  const rate = 5000;
  const frequencies = Array.from({ length: 68 }, (_, n) => 20 * 2 ** (n / 12));
  const spectrum = new LiveSpectrum(rate, frequencies);
  const uniform = generator(7);
  const power = (levels) => levels.reduce((sum, level) => sum + level, 0) / levels.length;
  let apart = 0;
  for (let piece = 0; piece < 600; piece += 1) {
    // Between 0.1 and 1, twice per second.
    const amplitude = 0.55 + 0.45 * Math.sin((2 * Math.PI * piece) / 15);
    const samples = Float32Array.from({ length: 167 }, () => amplitude * (uniform() - 0.5));
    const density = frequencies.map(() => (amplitude ** 2 / 12) / (rate / 2));
    if (!spectrum.add(samples, { model: density, recorded: piece % 30 === 0 ? density : null }) || piece < 30) continue;
    const shown = power(spectrum.levels().slice(24));
    assert.ok(Math.abs(shown - 10 * Math.log10(spectrum.compared.model[0])) < 2, `${piece}: ${shown} dB`);
    assert.equal(spectrum.compared.recorded, undefined, "of most of the time there is none");
    apart = Math.max(apart, Math.abs(shown - 10 * Math.log10(density[0])));
  }
  assert.ok(apart > 8, "and a moment alone is far from it");
});

test("a speed or force above the recorded ones is said", () => {
  const nodes = [{ speed_mm_s: 50, force_n: 0.5 }, { speed_mm_s: 200, force_n: 1 }];
  assert.equal(beyondGrid(nodes, 200, 1), "");
  assert.match(beyondGrid(nodes, 300, 1, false), /ends at 200 mm\/s: as there\./);
  assert.match(beyondGrid(nodes, 300, 2, true), /200 mm\/s and 1 N: as there, but a tone follows the speed/);
});
