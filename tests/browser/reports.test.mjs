// The reports of `evaluate --report` and `frontier` as a reader sees them, in Chromium, with the network blocked.

import assert from "node:assert/strict";
import { test } from "node:test";

import { browser } from "./bench.mjs";
import { Opened, PHONE } from "./chromium.mjs";

const PAGES = [
  ["evaluation", process.env.STYLUS_REPORT],
  ["frontier", process.env.STYLUS_FRONTIER],
];

// Opens a page, lets `use` use it, and holds that nothing was asked for and nothing went wrong.
async function opened(file, use, options = {}) {
  const page = await Opened.open(browser, file, options, { waits: false, isReal: true });
  try {
    // What is folded, too.
    await page.value(() => document.querySelectorAll("details").forEach((part) => (part.open = true)));
    await use(page);
    assert.deepEqual(page.requests, [], "no request");
    assert.deepEqual(page.complaints, [], "no error and no warning");
  } finally {
    await page.close();
  }
}

// Elements that make the page wider than its window, pictures whose letters are too small, links to nowhere, and what
// has no name.
function faults() {
  const root = document.documentElement;
  const found = [];
  const of = (selector) => [...document.querySelectorAll(selector)];
  if (root.scrollWidth > root.clientWidth) found.push(`page: ${root.scrollWidth}`);
  for (const e of of("body *")) {
    if (e.closest("svg") || (e.closest(".wide") && !e.matches(".wide"))) continue;
    const r = e.getBoundingClientRect();
    if (r.width > 0 && (r.right > root.clientWidth + 1 || r.left < -1)) found.push(`wide: ${e.tagName}.${e.className}`);
  }
  for (const e of of(".plot")) {
    // Text 13 pixels high as drawn, twice as large, is to be shown ten pixels high.
    const height = (e.getBoundingClientRect().width / e.viewBox.baseVal.width) * 26;
    if (height < 9.5) found.push(`small: ${e.getAttribute("aria-label")}`);
  }
  for (const a of of("a")) if (!document.getElementById(a.hash.slice(1))) found.push(`leads nowhere: ${a.hash}`);
  const isNamed = (e) => e.getAttribute("aria-label") || e.getAttribute("aria-labelledby");
  for (const e of of("audio, .plot, figure, .wide")) if (!isNamed(e)) found.push(`nameless: ${e.tagName}`);
  return found;
}

for (const [name, file] of PAGES) {
  test(`${name}: readable on narrow and wide windows, in light and dark`, () =>
    opened(file, async (page) => {
      for (const width of [420, 1400]) {
        await page.page.setViewportSize({ width, height: 900 });
        assert.deepEqual(await page.value(faults), [], `at ${width}`);
        if (width === 1400) assert.deepEqual(await page.overlaps(), []);
        for (const colorScheme of ["light", "dark"]) {
          await page.page.emulateMedia({ colorScheme });
          const [least, text] = await page.leastContrast();
          assert.ok(least >= 4.5, `${width}, ${colorScheme}: ${least} of '${text}'`);
        }
      }
    }));

  test(`${name}: a finger finds every control, and no key is named`, () =>
    opened(file, async (page) => assert.deepEqual(await page.unfitForFingers(), []), PHONE));

  test(`${name}: pointing tells the values of the pictures' data, within the window`, () =>
    opened(file, async (page) => {
      for (const width of [420, 1400]) {
        await page.page.setViewportSize({ width, height: 900 });
        const told = await page.value(pointed);
        assert.ok(told.length > 5);
        for (const { what, kind, value, lines, within } of told) {
          assert.ok(within, `cut off: ${what}`);
          // Four digits, or a step of the palette's 255 over 60 dB.
          const room = kind === "levels" ? 0.13 : 1e-3 * Math.abs(value) + 1e-9;
          const isTold = (line) =>
            line.split(/[ :,]/).some((word) => word !== "" && Math.abs(Number(word) - value) <= room);
          const isBeyond = (line) => kind === "levels" && /at (most|least)/.test(line);
          assert.ok(lines.some((line) => isTold(line) || isBeyond(line)), `${what}: ${value} in ${lines.join(" | ")}`);
        }
      }
    }));
}

// Points at a value of every series of every picture, by formulas of its own, and returns what the box says.
async function pointed() {
  const share = (axis, v) =>
    axis.scale === "log" ? Math.log(v / axis.from) / Math.log(axis.to / axis.from) : (v - axis.from) / (axis.to - axis.from);
  const found = [];
  for (const svg of document.querySelectorAll("svg.plot")) {
    svg.scrollIntoView({ block: "center" });
    for (const group of svg.querySelectorAll("g.axes")) {
      const panel = JSON.parse(group.dataset.panel);
      const { left, top, right, bottom } = panel.frame;
      const say = async (x, y) => {
        const place = new DOMPoint(left + (right - left) * share(panel.x, x), bottom - (bottom - top) * share(panel.y, y))
          .matrixTransform(svg.getScreenCTM());
        const event = new PointerEvent("pointermove",
          { clientX: place.x, clientY: place.y, bubbles: true, pointerType: "mouse" });
        group.dispatchEvent(event);
        const image = group.querySelector("image");
        if (image && !image.pixels) {
          while (!image.pixels) await new Promise((done) => setTimeout(done, 10));
          group.dispatchEvent(event);
        }
        const box = document.querySelector(".reading");
        const r = box.getBoundingClientRect();
        const root = document.documentElement;
        const within = r.left >= 0 && r.top >= 0 && r.right <= root.clientWidth && r.bottom <= root.clientHeight &&
          box.scrollHeight <= box.clientHeight + 1 && !box.hidden;
        return { lines: [...box.children].map((line) => line.textContent), within };
      };
      for (const { name, kind, x, y, z } of panel.series) {
        const what = `${svg.getAttribute("aria-label")}: ${panel.name} ${name}`;
        if (kind === "levels") {
          const { levels } = panel;
          // Its time and frequency are exact; the level is the palette's.
          const [time, hertz] = [levels.x[0] + 7 * levels.x[1], levels.y[0] + 20 * levels.y[1]];
          found.push({ what, kind, value: hertz, ...await say(time, hertz) });
          continue;
        }
        const at = Math.floor(x.length / 3);
        const value = z ? z.values[at] : y[at];
        if (value !== null && y[at] !== null) found.push({ what, kind, value, ...await say(x[at], y[at]) });
      }
    }
  }
  return found;
}

test("a node of a map plays its recording and its synthesis, by mouse and by key", () =>
  opened(process.env.STYLUS_REPORT, async (page) => {
    for (const byKey of [false, true]) {
      const [x, y, ...node] = await page.value(() => {
        delete globalThis.stylusPlayed;
        const group = [...document.querySelectorAll("g.axes")].find((one) => stylusPlots.axes(one).play);
        group.scrollIntoView({ block: "center" });
        const { frame, x, y, play } = stylusPlots.axes(group);
        const p = new DOMPoint(frame.left + ((frame.right - frame.left) * 1.5) / x.names.length,
          frame.bottom - ((frame.bottom - frame.top) * 0.5) / y.names.length)
          .matrixTransform(group.closest("svg").getScreenCTM());
        return [p.x, p.y, play, Number(x.names[1]), Number(y.names[0])];
      });
      await page.move(x, y);
      if (byKey) {
        await page.value(() => [...document.querySelectorAll("g.axes")].find((one) => stylusPlots.axes(one).play).focus());
        await page.press("Enter");
      } else {
        await page.click(x, y);
      }
      await page.wait(() => globalThis.stylusPlayed?.context.currentTime > 0.02);
      const [played, duration, loudest] = await page.value(() => {
        const { texture, speed, force, source } = stylusPlayed;
        const samples = source.buffer.getChannelData(0).subarray(0, 20_000);
        return [[texture, speed, force], source.buffer.duration, Math.max(...samples.map(Math.abs))];
      });
      assert.deepEqual(played, node, `by key: ${byKey}`);
      assert.ok(duration > 0.4 && loudest > 0.001, `${duration} s, ${loudest}`);
    }
  }));

test("a click in a spectrogram plays its sound from there, and every sound of the page can be played", () =>
  opened(process.env.STYLUS_REPORT, async (page) => {
    const [x, y] = await page.value(() => {
      const group = document.querySelector("g.axes > image").parentNode;
      group.scrollIntoView({ block: "center" });
      const { frame, x } = stylusPlots.axes(group);
      const half = frame.left + ((frame.right - frame.left) * (0.5 - x.from)) / (x.to - x.from);
      const p = new DOMPoint(half, (frame.top + frame.bottom) / 2)
        .matrixTransform(group.closest("svg").getScreenCTM());
      return [p.x, p.y];
    });
    await page.click(x, y);
    await page.wait(() =>
      [...document.querySelectorAll("audio[data-panel=recorded]")]
        .some((a) => a.played.length > 0 && a.played.start(0) > 0.4 && a.currentTime > 0.5));
    // Every player shows how long its sound is before it is played.
    await page.wait(() => [...document.querySelectorAll("audio")].every((audio) => audio.duration > 0.4));
  }));
