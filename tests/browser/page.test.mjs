// The page as a reader uses it, in Chromium, with the network blocked; in virtual time, but for one stroke.

import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import fs from "node:fs";
import path from "node:path";
import { test } from "node:test";

import { browser, folder } from "./bench.mjs";
import { Opened, PHONE } from "./chromium.mjs";

const { STYLUS_PAGE: file, STYLUS_LIBRARY: library, STYLUS_PROGRAM: stylus } = process.env;

// Opens the page, lets `use` use it, and holds that nothing was asked for and nothing went wrong.
async function opened(options, use, how = {}) {
  const page = await Opened.open(browser, file, options, how);
  try {
    await use(page);
    assert.deepEqual(page.requests, [], "no request");
    assert.deepEqual(page.complaints, [], "no error and no warning");
    assert.equal(await page.value(() => document.getElementById("trouble").hidden), true);
  } finally {
    await page.close();
  }
}

// What `stylus render` plays along a take's motion: samples in m/s².
function rendered(name, take, extra = []) {
  const [motion, wav] = [path.join(folder, `${name}.csv`), path.join(folder, `${name}.wav`)];
  fs.writeFileSync(motion, take.csv);
  const seconds = String(take.words.length / take.rate);
  const command = ["render", library, "--motion", motion, "--seconds", seconds, "--out", wav, "--overwrite", ...extra];
  const run = spawnSync(stylus, command, { encoding: "utf8" });
  assert.equal(run.status, 0, run.stderr);
  return samplesOf(fs.readFileSync(wav));
}

// The samples of a WAV file of 32-bit floats.
function samplesOf(bytes) {
  const data = bytes.indexOf("data", 12, "latin1");
  const count = bytes.readUInt32LE(data + 4) / 4;
  return Float32Array.from({ length: count }, (_, n) => bytes.readFloatLE(data + 8 + 4 * n));
}

// Levels of third octaves from 25 to 1000 Hz, dB, by a plain DFT of pieces of 0.4 s.
function thirdOctaves(samples, rate) {
  const length = Math.round(0.4 * rate);
  const window = Float64Array.from({ length }, (_, n) => 0.5 - 0.5 * Math.cos((2 * Math.PI * n) / length));
  const pieces = Array.from({ length: Math.floor(samples.length / length) }, (_, piece) =>
    window.map((weight, n) => weight * samples[piece * length + n]));
  const powerOf = (k) => {
    // A unit that turns by the same angle with each sample.
    const [cos, sin] = [Math.cos((2 * Math.PI * k) / length), Math.sin((2 * Math.PI * k) / length)];
    return pieces.reduce((sum, piece) => {
      let re = 0;
      let im = 0;
      let x = 1;
      let y = 0;
      for (let n = 0; n < length; n++) {
        re += piece[n] * x;
        im += piece[n] * y;
        const turned = x * cos - y * sin;
        y = x * sin + y * cos;
        x = turned;
      }
      return sum + re * re + im * im;
    }, 0);
  };
  const levels = [];
  for (let band = -16; band <= 0; band++) {
    const centre = 1000 * 2 ** (band / 3);
    let power = 0;
    for (let k = Math.ceil((centre / 2 ** (1 / 6)) * 0.4); k < centre * 2 ** (1 / 6) * 0.4; k++) power += powerOf(k);
    levels.push(10 * Math.log10(power + 1e-12));
  }
  return levels;
}

const rms = (samples) => Math.sqrt(samples.reduce((sum, x) => sum + x * x, 0) / samples.length);

// The take that the page keeps while `action` happens.
async function taken(page, action) {
  const count = await page.value(() => rubPage.takes.length);
  await page.press("t");
  await action();
  await page.press("t");
  await page.wait((count) => rubPage.takes.length > count, count);
  return page.value(() => {
    const take = rubPage.takes.at(-1);
    return { csv: take.csv, rate: take.rate, choice: take.choice, words: Array.from(take.words) };
  });
}

// Holds that a take of the texture is what `stylus render` plays along its motion.
function assertRendered(take, name) {
  const played = take.words.map((word) => Math.fround(word / 2 ** 20));
  assert.ok(played.some((value) => value !== 0), name);
  const expected = rendered(name, take, ["--texture", name, "--seed", String(take.choice.seed)]);
  assert.equal(played.length, expected.length);
  const first = played.findIndex((value, n) => value !== expected[n]);
  assert.equal(first, -1, `${name}: sample ${first} is ${played[first]}, and ${expected[first]} from the command`);
}

// The digests below are of every texture.
test("a drawn stroke sounds, and what it plays is what stylus render plays along its motion, bit for bit", async () => {
  await opened({}, async (page) => {
    const withLines = await page.value(() =>
      rubPage.textures.findIndex(({ data }) => data.can_leave_out.lines.length > 0));
    assert.ok(withLines > 0);
    for (const index of [0, withLines]) {
      await page.press(String(index + 1));
      const name = await page.value((index) => rubPage.textures[index].name, index);
      await page.wait((wanted) => rubPage.surface.name === wanted, name);
      const take = await taken(page, () => page.rub(2));
      assert.ok(rms(take.words) / 2 ** 20 > 1e-3, `${name}: ${rms(take.words)}`);
      assertRendered(take, name);
    }
  });
});

// The browser's own clock and sound thread, as they go on this machine: what is played may be any stroke.
test("a mouse that rubs in real time sounds, and that is what stylus render plays along its motion", async () => {
  const use = async (page) => {
    const name = await page.value(() => rubPage.surface.name);
    const take = await taken(page, async () => {
      const { x, y, width, height } = await page.box("#patch");
      await page.move(x + width / 2, y + height / 2);
      await page.page.mouse.down();
      let turn = 0;
      const isHeard = () => rubPage.played?.takeBlocks > 500 && rubPage.times.heard !== null;
      while (!(await page.value(isHeard))) {
        turn += 0.3;
        await page.move(x + width * (0.5 + 0.3 * Math.sin(turn)), y + height * (0.5 + 0.1 * Math.cos(turn)));
      }
      await page.page.mouse.up();
    });
    assertRendered(take, name);
  };
  await opened({}, use, { isReal: true });
});

test("the level and the spectrum that the page shows are those of stylus render at that speed and force", async () => {
  await opened({}, async (page) => {
    await page.press("Space");
    await page.advance(3500);
    const { name, speed, force, seed, levels, frequencies } = await page.value(() => ({
      name: rubPage.surface.name,
      speed: rubPage.keySpeed,
      force: rubPage.force,
      seed: rubPage.seed,
      levels: rubPage.spectrum.levels(),
      frequencies: rubPage.data.frequencies_hz,
    }));
    await page.press("Space");
    const wav = path.join(folder, "steady.wav");
    const motion = ["--speed", String(speed), "--force", String(force), "--seconds", "30"];
    const what = ["--texture", name, "--seed", String(seed + 1), ...motion];
    const command = ["render", library, ...what, "--out", wav, "--overwrite"];
    const run = spawnSync(stylus, command, { encoding: "utf8" });
    assert.equal(run.status, 0, run.stderr);
    const samples = samplesOf(fs.readFileSync(wav));
    const expected = thirdOctaves(samples, 5000);
    // The page's levels are densities in twelfths of an octave; together they are those of third octaves.
    const shown = expected.map((_, index) => {
      const centre = 1000 * 2 ** ((index - 16) / 3);
      const inside = levels.filter((_, n) => Math.abs(Math.log2(frequencies[n] / centre)) < 1 / 6);
      return 10 * Math.log10(inside.reduce((sum, level) => sum + 10 ** (level / 10), 0) / inside.length) +
        10 * Math.log10(centre * (2 ** (1 / 6) - 2 ** (-1 / 6)));
    });
    // Third octaves scatter by some decibels in a second; their means and their shape do not.
    const length = Math.round(0.4 * 5000);
    const scale = 10 * Math.log10((samples.length * length * 0.375) / 2);
    const apart = shown.map((level, index) => level - (expected[index] - scale));
    const strong = apart.filter((_, index) => expected[index] > Math.max(...expected) - 40);
    const mean = strong.reduce((sum, x) => sum + x, 0) / strong.length;
    assert.ok(Math.abs(mean) < 1.5, `${mean} dB on average: ${apart.map((x) => x.toFixed(1))}`);
    assert.ok(strong.every((x) => Math.abs(x) < 7), `${apart.map((x) => x.toFixed(1))}`);
  });
});

test("the kernel's digest of the fixed motion is the host's, for every texture", async () => {
  await opened({}, async (page) => {
    const digests = await page.value(() => rubPage.data.digest.of_textures);
    for (const [index, digest] of digests.entries()) {
      await page.press(String(index + 1));
      await page.wait((texture) => rubPage.digests.has(texture), index);
      const found = await page.value((texture) => rubPage.digests.get(texture), index);
      assert.equal(found.digest, digest);
      assert.equal(found.words, 50_000);
    }
    await page.wait(() => document.getElementById("bits").textContent.includes("the same"));
  });
});

test("keys alone reach everything", async () => {
  await opened({}, async (page) => {
    // Focus comes to the patch by the Tab key.
    const focus = () => page.value(() => document.activeElement.id);
    for (let n = 0; n < 12 && (await focus()) !== "patch"; n++) await page.press("Tab");
    assert.equal(await focus(), "patch");
    const sounding = () => page.value(() => rubPage.recent.some((sample) => sample !== 0));
    assert.equal(await sounding(), false);
    await page.down("ArrowRight");
    await page.wait(() => rubPage.recent.some((sample) => sample !== 0));
    const place = await page.value(() => rubPage.stroke.place);
    await page.wait((before) => rubPage.stroke.place > before, place);
    await page.up("ArrowRight");
    await page.wait(() => rubPage.recent.length > 0 && rubPage.recent.every((sample) => sample === 0));
    const state = () => page.value(() => ({
      force: rubPage.force,
      speed: rubPage.keySpeed,
      seed: rubPage.seed,
      surface: rubPage.surface.name,
      kind: rubPage.kind,
      mute: rubPage.isMute,
      said: document.getElementById("said").textContent,
    }));
    const begin = await state();
    await page.press("ArrowUp");
    assert.ok((await state()).force > begin.force);
    await page.press("ArrowDown");
    await page.press("ArrowDown");
    assert.ok((await state()).force < begin.force);
    await page.press("+");
    assert.ok((await state()).speed > begin.speed);
    await page.press("-");
    assert.ok(Math.abs((await state()).speed - begin.speed) <= 1);
    await page.press("s");
    assert.equal((await state()).seed, begin.seed + 1);
    await page.press("Shift+S");
    assert.equal((await state()).seed, begin.seed);
    await page.press("m");
    assert.equal((await state()).mute, true);
    await page.press("m");
    const kinds = await page.value(() => rubPage.kinds().map(({ id }) => id));
    assert.ok(kinds.includes("recording") && kinds.includes("gaussian"), kinds.join());
    for (const kind of [...kinds.slice(1), kinds[0]]) {
      await page.press("c");
      assert.equal((await state()).kind, kind);
    }
    await page.press("2");
    assert.notEqual((await state()).surface, begin.surface);
    assert.equal((await state()).said, (await state()).surface, "and each is said to a screen reader");
    await page.press("Space");
    await page.wait(() => rubPage.recent.some((sample) => sample !== 0));
    await page.press("Space");
    await page.wait(() => !rubPage.touches);
    // A held key is not stuck when the window loses the focus.
    await page.down("ArrowLeft");
    await page.wait(() => rubPage.touches);
    await page.value(() => globalThis.dispatchEvent(new Event("blur")));
    await page.wait(() => !rubPage.touches);
    await page.up("ArrowLeft");
  });
});

test("each kind of sound plays, and the recording sounds at its level", async () => {
  await opened({}, async (page) => {
    for (const kind of await page.value(() => rubPage.kinds().map(({ id }) => id))) {
      await page.wait((wanted) => rubPage.kind === wanted, kind);
      await page.press("Space");
      await page.advance(700);
      const level = rms(await page.value(() => Array.from(rubPage.recent)));
      const expected = await page.value(() => {
        const texture = rubPage.texture;
        const nodes = distinctNodes(placeOnGrid(texture.data, rubPage.keySpeed, rubPage.force));
        return texture.nodes[nodes.sort((a, b) => b[1] - a[1])[0][0]].rms_m_s2;
      });
      assert.ok(Math.abs(20 * Math.log10(level / expected)) < 8, `${kind}: ${level} m/s² near ${expected}`);
      await page.press("Space");
      await page.press("c");
    }
  });
});

test("a pen's pressure is its force, and a finger rubs", async () => {
  await opened({ hasTouch: true }, async (page) => {
    const box = await page.box("#patch");
    const [x, y] = [box.x + box.width / 3, box.y + box.height / 2];
    const pen = (type, dx, force) => page.devtools("Input.dispatchMouseEvent", { type, x: x + dx, y, force,
      button: "left", buttons: 1, pointerType: "pen", clickCount: 1 });
    await pen("mousePressed", 0, 0.25);
    for (let n = 0; n < 20; n++) await pen("mouseMoved", 5 * n, 0.25);
    const [light, most, least] = await page.value(() => [rubPage.hand.force, document.getElementById("force").max,
      document.getElementById("force").min].map(Number));
    assert.ok(Math.abs(light - (least + 0.25 * (most - least))) < 0.02 * most, `${light} N`);
    await pen("mouseMoved", 110, 0.75);
    await page.wait((light) => rubPage.hand.force > light, light);
    await pen("mouseReleased", 110, 0);
    await page.wait(() => !rubPage.touches);
    const touch = (type, dx) => page.devtools("Input.dispatchTouchEvent", { type,
      touchPoints: type === "touchEnd" ? [] : [{ x: x + dx, y, force: 0.5 }] });
    await touch("touchStart", 0);
    let [fastest, sounds] = [0, false];
    for (let n = 0; n < 60; n++) {
      await touch("touchMove", 4 * n);
      await page.advance(8);
      const seen = await page.value(() => [rubPage.hand.speed, rubPage.recent.some((sample) => sample !== 0)]);
      fastest = Math.max(fastest, seen[0]);
      sounds ||= seen[1];
    }
    assert.ok(fastest > 0 && sounds, `${fastest} mm/s`);
    await touch("touchEnd", 0);
    await page.wait(() => !rubPage.touches);
  });
});

test("a scene plays the surface under the tool, as stylus scene render does along the same motion", async () => {
  await opened({}, async (page) => {
    const index = await page.value(() => rubPage.surfaces.findIndex(({ scene }) => scene !== undefined));
    assert.ok(index >= 0, "the page of this test has a scene");
    await page.press(String(index + 1));
    await page.advance(100);
    const seen = new Set();
    const take = await taken(page, async () => {
      for (const under of await page.rub(2.5, { reach: 0.45, probe: () => rubPage.under ?? null })) seen.add(under);
    });
    assert.ok([...seen].filter((texture) => texture !== null).length >= 2, `surfaces under the tool: ${[...seen]}`);
    const [motion, wav] = [path.join(folder, "scene.csv"), path.join(folder, "scene.wav")];
    fs.writeFileSync(motion, take.csv);
    const command = ["scene", "render", process.env.STYLUS_SCENE, "--library", library, "--motion", motion, "--seconds",
      String(take.words.length / take.rate), "--seed", String(take.choice.seed), "--out", wav, "--overwrite"];
    const run = spawnSync(stylus, command, { encoding: "utf8" });
    assert.equal(run.status, 0, run.stderr);
    const expected = samplesOf(fs.readFileSync(wav));
    const played = take.words.map((word) => Math.fround(word / 2 ** 20));
    assert.ok(rms(played) > 1e-4);
    assert.equal(played.findIndex((value, n) => value !== expected[n]), -1);
    assert.equal(await page.value(() => document.querySelectorAll("#regions li").length > 1), true);
  });
});

test("the tip is the pin through the plant's response, as stylus render computes it code by code", async () => {
  await opened({}, async (page) => {
    const choose = (end) => page.value((end) => document.querySelectorAll("[name=end]")[end].click(), end);
    await page.press("Space");
    await choose(1);
    await page.wait(() => rubPage.ends?.gains.tip.gain.value > 0.99 && rubPage.ends.gains.pin.gain.value < 0.01);
    await choose(2);
    await page.wait(() => rubPage.ends.gains.calibrated?.gain.value > 0.99 && rubPage.ends.gains.tip.gain.value < 0.01);
    await choose(0);
    await page.wait(() => {
      const { pin, tip, calibrated } = rubPage.ends.gains;
      return pin.gain.value > 0.99 && tip.gain.value < 0.01 && calibrated.gain.value < 0.01;
    });
    await page.press("Space");
    const [rate, name] = [16_000, await page.value(() => rubPage.textures[0].name)];
    const [impulse, calibrated] = await page.value(
      (rate) => ["tip", "calibrated"].map((end) => Array.from(impulseOf(rubPage.data.plant, end, rate))),
      rate,
    );
    const [pin, tip] = [["--pin"], ["--plant", "haptuator"]].map((of) => {
      const wav = path.join(folder, "end.wav");
      const stroke = ["--speed", "120", "--force", "0.8", "--seconds", "2"];
      const run = spawnSync(stylus, ["render", library, "--texture", name, ...stroke, ...of, "--out", wav, "--overwrite"]);
      assert.equal(run.status, 0, String(run.stderr));
      return thirdOctaves(samplesOf(fs.readFileSync(wav)), 40_000);
    });
    // What a convolution does to a tone in the middle of each band.
    const gainsOf = (impulse) => pin.map((_, band) => {
      const angle = (2 * Math.PI * 1000 * 2 ** ((band - 16) / 3)) / rate;
      const [re, im] = [Math.cos, Math.sin].map((of) => impulse.reduce((sum, x, n) => sum + x * of(angle * n), 0));
      return 10 * Math.log10(re ** 2 + im ** 2);
    });
    const gains = gainsOf(impulse);
    const apart = tip.map((level, band) => level - pin[band] - gains[band]);
    const mean = apart.reduce((sum, x) => sum + x, 0) / apart.length;
    assert.ok(apart.every((x) => Math.abs(x - mean) < 1.5), `${apart.map((x) => x.toFixed(1))}`);
    // At the pin's mean level.
    const middle = gains.slice(1, 16);
    assert.ok(Math.abs(middle.reduce((sum, x) => sum + x, 0) / middle.length) < 0.3);
    // A calibration makes it flat from 30 to 800 Hz, which it is not before.
    const off = (gains) => Math.max(...gains.slice(1, 16).map(Math.abs));
    assert.ok(off(gainsOf(calibrated)) < 1 && off(gains) > 2, `${gainsOf(calibrated)} ${gains}`);
  });
});

test("values at the pointer, and a click on a node strokes there", async () => {
  await opened({}, async (page) => {
    // The pictures are below the controls.
    await page.value(() => document.querySelector("#spectrum-picture").scrollIntoView({ block: "center" }));
    const map = await page.box("#map-picture .plot");
    const target = [map.x + map.width * 0.4, map.y + map.height * 0.45];
    await page.move(...target);
    await page.wait(() => document.querySelector(".reading")?.hidden === false);
    const text = await page.value(() => document.querySelector(".reading").textContent);
    assert.match(text, /mm\/s.* N/);
    await page.click(...target);
    await page.wait(() => rubPage.recent.some((sample) => sample !== 0));
    const [speed, force] = text.match(/[\d.]+/g).map(Number);
    assert.deepEqual(await page.value(() => [rubPage.keySpeed, rubPage.force]), [speed, force]);
    await page.wait(() => !rubPage.touches);
    const spectrum = await page.box("#spectrum-picture .plot");
    await page.move(spectrum.x + spectrum.width * 0.6, spectrum.y + spectrum.height * 0.5);
    await page.wait(() => document.querySelector(".reading").textContent.includes("as it sounds"));
  });
});

test("wide and narrow, light and dark: nothing is cut off, nothing overlaps, every text can be read", async () => {
  for (const [hasTouch, widths] of [[false, [1240, 760]], [true, [420, 360]]]) {
    await opened({ hasTouch }, async (page) => {
      await page.press("Space");
      for (const width of widths) {
        await page.page.setViewportSize({ width, height: 900 });
        for (const colorScheme of ["light", "dark"]) {
          await page.page.emulateMedia({ colorScheme });
          await page.advance(500);
          const place = `${width} px, ${colorScheme}`;
          const needed = await page.value(() => document.documentElement.scrollWidth);
          assert.ok(needed <= width, `${place}: the page is ${needed} px wide`);
          assert.deepEqual(await page.overlaps(), [], place);
          const [contrast, text] = await page.leastContrast();
          assert.ok(contrast >= 4.5, `${place}: ${contrast} at '${text}'`);
          const unnamed = await page.unnamed();
          assert.deepEqual(unnamed, [], `${place}: controls without a name`);
        }
      }
      await page.press("Space");
    });
  }
});

test("with reduced motion there is no trail, and pictures come four times per second", async () => {
  await opened({ reducedMotion: "reduce" }, async (page) => {
    await page.press("Space");
    await page.value(() => {
      globalThis.draws = 0;
      const draw = rubPage.waveform.draw;
      rubPage.waveform.draw = function counted(...list) {
        draws += 1;
        return draw.apply(this, list);
      };
    });
    await page.wait(() => draws > 0);
    await page.value(() => (draws = 0));
    await page.advance(2000);
    assert.equal(await page.value(() => draws), 8);
    assert.equal(await page.value(() => rubPage.patch.trail.length), 0);
  });
});

test("the sound begins with the first touch, a move is in it within a block, and nothing breaks off", async () => {
  await opened({}, async (page) => {
    await page.press("Space");
    await page.wait(() => rubPage.times.heard !== null);
    const times = await page.value(() => rubPage.times);
    // The filter's delay, and the rise of a stroke.
    assert.ok(times.heard - times.touched < 20, `${times.heard - times.touched} ms`);
    await page.press("Space");
    await page.rub(3);
    const { latency, dropouts, frames, now } = await page.value(() => ({
      latency: rubPage.latency(),
      dropouts: rubPage.dropouts(),
      frames: rubPage.played.frames,
      now: performance.now(),
    }));
    // A block of the kernel's, and one of the browser's.
    assert.ok(latency.longestMs < 2 + 3, `${latency.longestMs} ms`);
    assert.equal(dropouts.gaps, 0);
    // The last report is not older than 1/30 s.
    const missing = now - times.touched - frames / 48;
    assert.ok(missing >= 0 && missing < 40, `${missing} ms`);
  });
});

// A tablet that got the page from a computer beside it, which a browser does not trust with an audio worklet.
const ADDRESS = "http://192.168.7.7/rub.html";

test("a page that came by plain http sounds at its level, and plays what stylus render plays, bit for bit", async () => {
  // The last 32768 samples of what goes to the loudspeaker.
  const init = `const { connect } = AudioNode.prototype;
    AudioNode.prototype.connect = function connected(to, ...list) {
      if (to === this.context.destination) {
        globalThis.output = new AnalyserNode(this.context, { fftSize: 32768 });
        connect.call(this, output);
      }
      return connect.call(this, to, ...list);
    };`;
  const use = async (page) => {
    assert.deepEqual(await page.value(() => [isSecureContext, "audioWorklet" in rubPage.context]), [false, false]);
    const output = () => page.value(() => {
      const samples = new Float32Array(32768);
      output.getFloatTimeDomainData(samples);
      return Array.from(samples);
    });
    const { name, speed, force, fullScale } = await page.value(() => {
      const { surface, keySpeed, force, fullScale } = rubPage;
      return { name: surface.name, speed: keySpeed, force, fullScale };
    });
    const take = await taken(page, async () => {
      await page.advance(100);
      assert.ok((await output()).every((sample) => sample === 0));
      await page.press("Space");
      await page.advance(2000);
    });
    assertRendered(take, name);
    const level = rms(await output());
    const along = [0, 60].map((time) => `${time},${speed},${force}`).join("\n");
    const motion = { csv: `time_s,speed_mm_s,force_n\n${along}\n`, rate: 5000, words: { length: 300_000 } };
    const expected = rms(rendered("http", motion, ["--texture", name])) / fullScale;
    assert.ok(Math.abs(20 * Math.log10(level / expected)) < 2, `${level} of ${expected} of full scale`);
    const { latency, played } = await page.value(() => ({ latency: rubPage.latency(), played: rubPage.played }));
    assert.ok(latency.baseMs > 40 && played.gaps === 0, JSON.stringify(latency));
    page.complaints = page.complaints.filter((text) => !text.startsWith("The ScriptProcessorNode is deprecated"));
  };
  await opened({}, use, { init, address: ADDRESS });
});

test("a browser that lets no page by http sound says how to open it, also after a touch", async () => {
  const init = "delete BaseAudioContext.prototype.createScriptProcessor;";
  const page = await Opened.open(browser, file, {}, { waits: false, init, address: ADDRESS });
  await page.loaded(() => Boolean(globalThis.rubPage?.newKernel));
  await page.rub(2);
  assert.match(await page.value(() => document.getElementById("trouble").textContent), /as a file, or by https/);
  assert.ok(await page.value(() => rubPage.spectrum.compared.model !== undefined), "the pictures follow the hand");
  assert.deepEqual(page.complaints, []);
  await page.close();
});

// Firefox without an output device, and a policy that lets no sound begin.
for (const [name, stub] of [
  ["whose sound's thread never starts", "AudioWorklet.prototype.addModule = () => new Promise(() => {});"],
  ["that keeps the sound suspended", ""],
]) {
  test(`a browser ${name}: that is said within a second, and the pictures follow the hand`, async () => {
    const init = `${stub} globalThis.AudioContext = class extends AudioContext {
      resume() { return new Promise(() => {}); }
    };`;
    const page = await Opened.open(browser, file, {}, { waits: false, init });
    await page.loaded(() => Boolean(globalThis.rubPage?.newKernel));
    const probe = () => [document.getElementById("trouble").hidden ? null : performance.now(),
      Number.parseFloat(document.getElementById("now-speed").textContent)];
    const found = await page.rub(3, { probe });
    const [said] = found.find(([time]) => time !== null);
    const late = said - (await page.value(() => rubPage.times.touched));
    assert.ok(late < 1000, `${late} ms`);
    const fastest = Math.max(...found.map(([, speed]) => speed));
    assert.match(await page.value(() => document.getElementById("trouble").textContent), /^No sound: .*output device/);
    assert.ok(fastest > 20, `${fastest} mm/s`);
    await page.wait(() => rubPage.spectrum.compared.model !== undefined);
    assert.deepEqual(page.complaints, []);
    await page.close();
  });
}

test("on a phone no key is shown, force and volume are near the patch, and patches do not look alike", async () => {
  await opened(PHONE, async (page) => {
    assert.deepEqual(await page.unfitForFingers(), []);
    const seen = await page.value(() => {
      const below = document.getElementById("patch").getBoundingClientRect().bottom;
      const far = (id) => document.getElementById(id).getBoundingClientRect().top - below;
      return ["force", "volume"].map(far);
    });
    assert.ok(seen.every((px) => px < 400), seen.join());
    const looks = new Set();
    const count = await page.value(() => rubPage.textures.length);
    for (let texture = 0; texture < count; texture += 1) {
      await page.value((index) => rubPage.chooseSurface(index), texture);
      await page.wait((index) => rubPage.reliefs.has(index) && rubPage.patch.relief !== null, texture);
      // What a glance tells: its colour as a whole.
      looks.add(await page.value(() => {
        const context = new OffscreenCanvas(1, 1).getContext("2d", { willReadFrequently: true });
        context.drawImage(rubPage.patch.canvas, 0, 0, 1, 1);
        return context.getImageData(0, 0, 1, 1).data.map((value) => value / 4).join();
      }));
    }
    assert.equal(looks.size, Math.min(count, 6), [...looks].join(" "));
  });
});

test("off the grid the patch says so, and within it does not; a map's values stand above its frames", async () => {
  await opened({}, async (page) => {
    const label = () => page.value(() => !document.getElementById("patch-beyond").hidden);
    await page.press("Space");
    await page.wait(() => rubPage.played?.contact);
    assert.equal(await label(), false);
    await page.value(() => {
      const range = document.getElementById("speed");
      range.value = range.max;
      range.dispatchEvent(new Event("input"));
    });
    await page.wait(() => !document.getElementById("patch-beyond").hidden);
    const text = await page.value(() => document.getElementById("patch-beyond").textContent);
    const last = await page.value(() => rubPage.texture.data.speeds_mm_s.at(-1));
    assert.ok(text.includes(`ends at ${last} mm/s`), text);
    const follows = await page.value(() => {
      const of = (name) => document.querySelector(`#map-picture .${name}`);
      return (of("over").compareDocumentPosition(of("values")) & Node.DOCUMENT_POSITION_FOLLOWING) !== 0;
    });
    assert.ok(follows);
    await page.press("Space");
    await page.wait(() => document.getElementById("patch-beyond").hidden);
  });
});

test("many textures: a short title, a list that scrolls, a search whose letters do nothing else", async () => {
  const { STYLUS_MANY: many } = process.env;
  for (const width of [400, 1240]) {
    const page = await Opened.open(browser, many, { viewport: { width, height: 900 } });
    const { title, list, patch, wide, hasMap } = await page.value(() => {
      const of = (id) => document.getElementById(id).getBoundingClientRect();
      const wide = document.documentElement.scrollWidth;
      const hasMap = document.getElementById("map-picture").checkVisibility();
      return { title: document.title, list: of("surfaces").height, patch: of("patch").bottom, wide, hasMap };
    });
    assert.equal(title, "Rub one of 14 textures");
    assert.equal(hasMap, false, "one node alone is no map");
    assert.ok(list < 200 && patch < 900 && wide <= width, `${list} ${patch} ${wide}`);
    await page.page.locator("#search").fill("");
    await page.page.locator("#search").pressSequentially("surface 12 cst");
    assert.deepEqual(await page.value(() => [rubPage.shownChips().length, rubPage.seed, rubPage.isTaking]), [0, 1, false]);
    await page.page.locator("#search").fill("12");
    await page.press("Enter");
    assert.equal(await page.value(() => rubPage.surface.name), "surface 12");
    await page.page.locator("#search").fill("");
    await page.value(() => document.activeElement.blur());
    await page.press("2");
    assert.equal(await page.value(() => rubPage.surface.name), await page.value(() => rubPage.surfaces[1].name));
    assert.deepEqual(page.complaints, []);
    await page.close();
  }
});

test("a page whose kernel is damaged says so, and goes on without sound", async () => {
  const damaged = path.join(folder, "damaged.html");
  const text = fs.readFileSync(file, "utf8").replace(/(id="library">)[A-Za-z0-9+/]{40}/, `$1${"A".repeat(40)}`);
  fs.writeFileSync(damaged, text);
  const page = await Opened.open(browser, damaged, {}, { waits: false });
  await page.loaded(() => !document.getElementById("trouble").hidden);
  assert.match(await page.value(() => document.getElementById("trouble").textContent), /^No sound: .{10}/);
  assert.deepEqual(page.requests, []);
  await page.close();
});
