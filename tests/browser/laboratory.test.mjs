// The laboratory as a person uses it, in Chromium, with the network blocked: its library, record and pages are those of
// the command.

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import fs from "node:fs";
import path from "node:path";
import { test } from "node:test";

import { browser, folder } from "./bench.mjs";
import { Opened, PHONE, launched } from "./chromium.mjs";

const PAGE = process.env.STYLUS_LABORATORY;
const AXE = fs.readFileSync(path.join(process.env.STYLUS_NODE_MODULES, "node_modules/axe-core/axe.min.js"), "utf8");
const stylus = (...list) => execFileSync(process.env.STYLUS_PROGRAM, list, { cwd: folder, stdio: "pipe" });

// Opens the page, lets `use` use it, and holds that nothing was asked for and nothing went wrong.
async function opened(use, options = {}, from = browser) {
  const page = await Opened.open(from, PAGE, { acceptDownloads: true, ...options }, { waits: false, isReal: true });
  try {
    await page.loaded(() => globalThis.laboratoryIsReady === true);
    await use(page);
    assert.deepEqual(page.requests.filter((url) => !url.startsWith("blob:")), [], "no request");
    assert.deepEqual(page.complaints, [], "no error and no warning");
  } finally {
    await page.close();
  }
}

// Drops files on the page, by their paths.
function drop(page, files) {
  const dropped = files.map((file) => [path.basename(file), fs.readFileSync(file).toString("base64")]);
  return page.value((dropped) => {
    const dataTransfer = new DataTransfer();
    for (const [name, text] of dropped) {
      dataTransfer.items.add(new File([Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0))], name));
    }
    document.getElementById("drop").dispatchEvent(new DragEvent("drop", { dataTransfer, bubbles: true }));
    return laboratory.last;
  }, dropped);
}

// Waits until all that was begun is done.
const settled = (page) => page.value(() => laboratory.last);

// Gives the page files, as its button for files does, or a folder, as that for a folder does.
async function give(page, files, input = "#files") {
  await page.page.locator(input).setInputFiles(files);
  await settled(page);
}

async function fit(page) {
  await page.page.locator("#fit").click();
  await settled(page);
}

// Saves what this button keeps. Returns the path.
async function saved(page, name) {
  const download = page.page.waitForEvent("download");
  await page.page.getByRole("button", { name, exact: true }).click();
  const file = await download;
  const to = path.join(folder, `saved-${file.suggestedFilename()}`);
  await file.saveAs(to);
  return to;
}

const text = (page, selector) => page.page.locator(selector).innerText();
const column = (page, name) =>
  page.value((name) => laboratory.state.rows.map((row) => row[name]), name);

// A small set as loggers write it, WAV and CSV, with a list, in a folder that the command and the page are given.
function recordings(name) {
  const tutorial = path.resolve("../../host-tools/examples/tutorial");
  stylus("simulate-rig", "--rig", `${tutorial}/rig.toml`, "--out", `${name}-rig`);
  execFileSync("python3", [`${tutorial}/logger.py`, path.join(folder, `${name}-rig`), path.join(folder, name)]);
  stylus("trials", name, "--pattern", "{texture}_{speed}mms_{force}N.csv", "--scale", "mg");
  return path.join(folder, name);
}

test("a folder with its list gives the command's library and record, and what is kept gives them again", () =>
  opened(async (page) => {
    const set = recordings("logger");
    stylus("fit", "logger", "--out", "textures.lib");
    stylus("page", "textures.lib", "--recordings", "logger", "--out", "rub.html");
    await give(page, set, "#folder");
    assert.equal(await text(page, "#trouble"), "");
    assert.match(await text(page, "#notes"), /8 rows from the list logger\/trials\.csv/);
    await fit(page);
    assert.equal(await text(page, "#trouble"), "");
    // What was fitted keeps its name when the next library is to have another.
    await page.page.locator("#name").fill("next");
    const bytes = (file) => fs.readFileSync(path.isAbsolute(file) ? file : path.join(folder, file));
    assert.deepEqual(bytes(await saved(page, "Library")), bytes("textures.lib"));
    assert.deepEqual(bytes(await saved(page, "Its record")), bytes("textures.lib.fit.json"));
    // What judges it, and what is rubbed.
    const evaluated = stylus("evaluate", "logger", "--library", "textures.lib").toString().replace(/\s+/g, " ");
    const verdict = await text(page, "#verdicts");
    assert.ok(evaluated.includes(verdict.replace(/\s+/g, " ").slice(0, 60)), `${verdict} in ${evaluated}`);
    const rubbed = bytes(await saved(page, "Page to rub")).toString();
    const element = (html, id) => html.split(`id="${id}">`)[1].split("</script>")[0];
    for (const id of ["kernel", "library"]) {
      assert.equal(element(rubbed, id), element(bytes("rub.html").toString(), id), id);
    }
    const zip = await saved(page, "List and recordings, zip");
    execFileSync("python3", ["-m", "zipfile", "-e", zip, path.join(folder, "unpacked")]);
    const options = { cwd: path.join(folder, "unpacked"), stdio: "pipe" };
    execFileSync(process.env.STYLUS_PROGRAM, ["fit", "logger", "--out", "again.lib"], options);
    assert.deepEqual(bytes("unpacked/again.lib"), bytes("textures.lib"));
    assert.deepEqual(bytes("unpacked/textures.lib.fit.json"), bytes("unpacked/again.lib.fit.json"));
    assert.ok(bytes(await saved(page, "Stroke over denim, WAV")).length > 50_000);
  }));

// A sound as a WAV file of 16 bits, at `rate` Hz.
function wave(rate, seconds, of) {
  const bytes = Buffer.alloc(44 + 2 * Math.round(rate * seconds));
  bytes.write("RIFF", 0);
  bytes.writeUInt32LE(bytes.length - 8, 4);
  bytes.write("WAVEfmt ", 8);
  const format = [[16, 16], [20, 1 + (1 << 16)], [24, rate], [28, 2 * rate], [32, 2 + (16 << 16)]];
  format.forEach(([at, value]) => bytes.writeUInt32LE(value, at));
  bytes.write("data", 36);
  bytes.writeUInt32LE(bytes.length - 44, 40);
  for (let n = 0; 44 + 2 * n < bytes.length; n++) bytes.writeInt16LE(Math.round(32_767 * of(n / rate)), 44 + 2 * n);
  return bytes;
}

// Noise that is the same in every run, of a spectrum that falls.
function noise(seed = 1) {
  let [state, held] = [seed, 0];
  return () => {
    state = (Math.imul(state, 1_664_525) + 1_013_904_223) >>> 0;
    held = 0.7 * held + 0.1 * (state / 2 ** 31 - 1);
    return held;
  };
}

const steady = () => wave(5000, 2, noise());

// Two recordings whose names say what they are, in a folder of this name.
function surfaces(name) {
  const home = path.join(folder, name);
  fs.mkdirSync(home);
  const files = ["cork_60mms_1N.wav", "felt_60mms_1N.wav"].map((file) => path.join(home, file));
  files.forEach((file, at) => fs.writeFileSync(file, wave(5000, 2, noise(at + 11))));
  return files;
}

test("a fault of a file is told in the command's words, with the table's columns for its options", () =>
  opened(async (page) => {
    const cases = {
      "empty.wav": "",
      "cut.wav": steady().subarray(0, 300),
      "sound.wav": "no sound at all",
      "words.csv": "time_s,x\n0,a\n0.001,b\n",
      "backwards.csv": "time_s,x\n0,1\n0.002,2\n0.001,3\n",
      "no-rate.csv": "x\n1\n2\n3\n",
      "matrix.mat": "MATLAB",
    };
    const home = path.join(folder, "faults");
    fs.mkdirSync(home);
    for (const [name, content] of Object.entries(cases)) fs.writeFileSync(path.join(home, name), content);
    fs.writeFileSync(path.join(home, "whole.wav"), steady());
    await give(page, Object.keys(cases).concat("whole.wav").map((name) => path.join(home, name)));
    const told = `${await text(page, "#notes")} ${await text(page, "#rows")}`.replace(/\s+/g, " ");
    for (const name of Object.keys(cases)) {
      const options = { cwd: folder, encoding: "utf8", stdio: "pipe" };
      const command = ["fit", `faults/${name}`, "--out", "none.lib"];
      const said = (() => {
        try {
          execFileSync(process.env.STYLUS_PROGRAM, command, options);
        } catch (fault) {
          return fault.stderr.replace(/\s+/g, " ").trim().split(`faults/${name}`).at(-1);
        }
        throw new Error(`${name} fits`);
      })();
      const words = said.replace(/--sample-rate(, or sample_rate_hz in the list)?/, '"sample rate, Hz"');
      assert.ok(told.includes(`recordings/${name}${words}`), `${words} not in ${told}`);
    }
    assert.match(told, /2\.00/);
  }));

test("names that are markup, formulas or keys stay names, in the table, in the list and in every page", () =>
  opened(async (page) => {
    const hostile = "<img src=x onerror=\"hit=1\">";
    const home = path.join(folder, "hostile");
    fs.mkdirSync(home);
    const names = [`${hostile.replace("/", "")}_60mms_1N.wav`, "=1+1_120mms_1N.wav", "__proto___180mms_1N.wav"];
    names.forEach((name, at) => fs.writeFileSync(path.join(home, name), wave(5000, 2, noise(at + 2))));
    await drop(page, names.map((name) => path.join(home, name)));
    assert.deepEqual((await column(page, "texture")).toSorted(), [hostile, "=1+1", "__proto__"].toSorted());
    await page.page.locator("#column").selectOption("scale_m_s2");
    await page.page.locator("#value").fill("50");
    await page.page.locator("#fill-used").click();
    await settled(page);
    await rubbed(page);
    await page.page.locator("#open-report").click();
    await settled(page);
    const hits = page.page.frames().map((one) => one.evaluate(() => globalThis.hit ?? 0));
    assert.deepEqual(await Promise.all(hits), [0, 0, 0]);
    assert.equal(await page.value(() => document.querySelectorAll("img").length), 0);
    const zip = await saved(page, "List and recordings, zip");
    const list = execFileSync("python3", ["-c", "import sys, zipfile; " +
      "print(zipfile.ZipFile(sys.argv[1]).read('recordings/trials.csv').decode())", zip], { encoding: "utf8" });
    assert.ok(!/(^|,)"?=1/m.test(list), list);
  }));

test("nothing is fitted from a guess: what no name says is asked for, filled at once, and marked where it lacks", () =>
  opened(async (page) => {
    const home = path.join(folder, "plain");
    fs.mkdirSync(home);
    const names = ["felt.wav", "cork.wav", "steel.wav"];
    names.forEach((name, at) => fs.writeFileSync(path.join(home, name), wave(44_100, 2, noise(at + 5))));
    await give(page, names.map((name) => path.join(home, name)));
    assert.match(await text(page, "#notes"), /no usual pattern fits/);
    await fit(page);
    assert.match(await text(page, "#trouble"), /^cork\.wav: no "speed, mm\/s"/);
    assert.equal(await page.value(() => document.activeElement.getAttribute("aria-label")), "speed, mm/s of cork.wav");
    const filled = async (key, value) => {
      await page.page.locator("#column").selectOption(key);
      await page.page.locator("#value").fill(value);
      await page.page.locator("#fill-empty").click();
      await settled(page);
    };
    for (const [key, value] of [["speed_mm_s", "100"], ["force_n", "1"]]) await filled(key, value);
    await page.page.getByLabel("use steel.wav").uncheck();
    await fit(page);
    assert.match(await text(page, "#fit-notes"), /give "unit", such as 98\.1/);
    assert.equal((await text(page, "#rows")).match(/level is not known/g).length, 3);
    const axes = page.page.frameLocator("#rub-frame").locator("#waveform-picture text");
    await axes.getByText("acceleration, relative").waitFor();
    await filled("scale_m_s2", "2 g");
    await fit(page);
    assert.equal(await text(page, "#trouble"), "");
    assert.doesNotMatch(await text(page, "#rows"), /not known/);
    assert.match(await text(page, "#fit-text"), /2 trials -> textures\.lib/);
  }));

test("a fit that is cancelled leaves all that was entered, and a reload leaves all that was made", () =>
  opened(async (page) => {
    await page.value(() => {
      globalThis.changes = 0;
      new MutationObserver(() => (changes += 1)).observe(byId("rows"), { childList: true, subtree: true });
    });
    await page.page.locator("#demo").click();
    await settled(page);
    assert.equal((await column(page, "file")).length, 60);
    // Each is a layout of the whole table.
    assert.ok((await page.value(() => changes)) < 25);
    assert.match(await text(page, "#simulated"), /SIMULATED/);
    await page.page.locator("#fit").click();
    await page.loaded(() => document.getElementById("progress-text").textContent === "fitting");
    await page.page.locator("#cancel").click();
    await settled(page);
    assert.match(await text(page, "#trouble"), /Cancelled/);
    assert.equal((await column(page, "file")).length, 60);
    await fit(page);
    assert.equal(await text(page, "#trouble"), "");
    const state = () => page.value(() => JSON.stringify(laboratory.state));
    const library = () => saved(page, "Library").then((file) => fs.readFileSync(file));
    const before = [await state(), await library(), await text(page, "#verdicts")];
    await page.page.reload();
    await page.loaded(() => globalThis.laboratoryIsReady === true);
    assert.deepEqual([await state(), await library(), await text(page, "#verdicts")], before);
    await page.page.locator("#clear").click();
    await settled(page);
    await page.page.reload();
    await page.loaded(() => globalThis.laboratoryIsReady === true);
    assert.deepEqual(await column(page, "file"), []);
    assert.match(await text(page, "#stored"), /0 files/);
  }));

test("a panic of the module is told in its words, a new one has all files, and a lack of memory is told as that", () =>
  opened(async (page) => {
    await give(page, surfaces("panics"));
    // A worker whose next fit ends in a trap, with or without the words that a panic leaves.
    const trapped = (words) => page.value((words) => {
      const { lab } = laboratory;
      // (func (export "f") unreachable)
      const trap = [0, 97, 115, 109, 1, 0, 0, 0, 1, 4, 1, 96, 0, 0, 3, 2, 1, 0, 7, 5, 1, 1, 102, 0, 0, 10, 5, 1, 3, 0,
        0, 11];
      const faulty = `${byId("worker").textContent}
        const good = answered;
        answered = (asked) => {
          if (asked.ask.ask !== "fit") return good(asked);
          const words = new TextEncoder().encode(${JSON.stringify(words)});
          const room = exports.reserve(words.length + 1) >>> 0;
          bytesAt(room, words.length).set(words);
          exports = { ...exports, text: () => room, text_length: () => words.length };
          new WebAssembly.Instance(new WebAssembly.Module(new Uint8Array([${trap}]))).exports.f();
        };`;
      const whole = lab.source;
      lab.source = URL.createObjectURL(new Blob([faulty], { type: "text/javascript" }));
      lab.end();
      lab.source = whole;
    }, words);
    const rows = await page.value(() => JSON.stringify(laboratory.state.rows));
    const cases = [["panicked at fit.rs: <b>", /place: panicked at fit\.rs: <b>/], ["", /no memory left/]];
    for (const [words, told] of cases) {
      await trapped(words);
      await fit(page);
      assert.match(await text(page, "#trouble"), told);
      assert.match(await text(page, "#trouble"), /a new one took its place/);
      assert.equal(await page.value(() => JSON.stringify(laboratory.state.rows)), rows);
    }
    await fit(page);
    assert.equal(await text(page, "#trouble"), "");
    assert.match(await text(page, "#fit-text"), /2 trials/);
  }));

test("a file that is larger than a reader takes is refused in the readers' words before a byte of it is read", () =>
  opened(async (page) => {
    const told = (name, size) => page.value(([name, size]) => {
      const file = new File([], name);
      Object.defineProperty(file, "size", { value: size });
      file.arrayBuffer = file.stream = file.text = () => {
        throw new Error("it is read");
      };
      return laboratory.does(() => laboratory.add([{ path: name, file }])).then(() => byId("notes").innerText);
    }, [name, size]);
    const most = /recordings\/a\.csv: has more than 536870912 bytes, the most of a table of samples/;
    assert.match(await told("a.csv", 513 * 2 ** 20), most);
    assert.match(await told("a.lvm", 513 * 2 ** 20), /more than 536870912 bytes/);
    assert.match(await told("a.wav", 2 ** 33), /more than 4296015872 bytes, the most of a recording/);
    assert.match(await told("a.wav", 1.1e9), /all files together would have more than 1000\.0 MB/);
    assert.match(await text(page, "#stored"), /^0 files/);
  }));

test("keys alone lead from the page's beginning to sound", () =>
  opened(async (page) => {
    // Moves by tab to the control with this name, as a person without a mouse does.
    const tabbed = async (id) => {
      const at = () => page.value(() => document.activeElement.id);
      for (let n = 0; (await at()) !== id; n++) {
        assert.ok(n < 500, `no way to ${id}`);
        await page.press("Tab");
      }
    };
    // Before other calls, because the browser hears of it no sooner than of a key that follows.
    const chooser = page.page.waitForEvent("filechooser");
    await tabbed("files");
    await page.press("Enter");
    await (await chooser).setFiles(surfaces("keys"));
    await page.loaded(() => laboratory.state.rows.length === 2);
    await settled(page);
    await tabbed("fit");
    await page.press("Enter");
    await settled(page);
    // An empty frame would take the key and show nothing.
    await page.loaded(() => document.getElementById("rub-frame").contentDocument.getElementById("patch") !== null);
    await tabbed("rub-frame");
    const frame = await (await page.page.locator("#rub-frame").elementHandle()).contentFrame();
    for (let n = 0; !(await frame.evaluate(() => document.activeElement.id === "patch")); n++) {
      assert.ok(n < 100, "no way to the patch");
      await page.press("Tab");
    }
    // A browser draws nothing of a frame out of sight, and the patch is in sight by now.
    const isReady = () => globalThis.rubPage?.newKernel && rubPage.times.ready !== null;
    await frame.waitForFunction(isReady, null, { polling: 100 });
    await page.down("ArrowRight");
    const isMoving = () => document.getElementById("now-speed").textContent !== "0 mm/s";
    await frame.waitForFunction(isMoving, null, { polling: 50 });
    await page.up("ArrowRight");
  }));

// Elements that make the page wider than its window.
function tooWide() {
  const { clientWidth, scrollWidth } = document.documentElement;
  const found = scrollWidth > clientWidth ? [`page: ${scrollWidth}`] : [];
  for (const e of document.querySelectorAll("body *")) {
    if (e.closest(".wide") && !e.matches(".wide")) continue;
    const r = e.getBoundingClientRect();
    if (r.width > 0 && (r.right > clientWidth + 1 || r.left < -1)) found.push(`${e.tagName}.${e.className}#${e.id}`);
  }
  return found;
}

test("a telephone, a tablet and a wide window show all, light and dark, and a screen reader finds it", () =>
  opened(async (page) => {
    await page.page.locator("#demo").click();
    await settled(page);
    await page.page.locator("#record summary").click();
    await rubbed(page);
    for (const width of [390, 768, 1400]) {
      await page.page.setViewportSize({ width, height: 900 });
      assert.deepEqual(await page.value(tooWide), [], `at ${width}`);
      for (const colorScheme of ["light", "dark"]) {
        await page.page.emulateMedia({ colorScheme });
        const [least, words] = await page.leastContrast();
        assert.ok(least >= 4.5, `${width}, ${colorScheme}: ${least} of '${words}'`);
        if (process.env.STYLUS_PICTURES) {
          const to = path.join(process.env.STYLUS_PICTURES, `${width}-${colorScheme}.png`);
          await page.page.screenshot({ path: to, fullPage: true });
        }
      }
    }
    assert.deepEqual(await page.unnamed(), []);
    await page.page.locator("#open-report").click();
    await settled(page);
    for (const frame of page.page.frames()) {
      await frame.evaluate(AXE);
      const { violations } = await frame.evaluate(() => axe.run({ iframes: false }));
      const told = ({ id, nodes }) => `${id}: ${nodes.slice(0, 3).map(({ html }) => html.slice(0, 100))}`;
      const serious = violations.filter(({ impact }) => ["serious", "critical"].includes(impact));
      assert.deepEqual(serious.map(told), [], frame.url().slice(0, 60));
    }
  }));

test("on a telephone a finger finds every control, and rubs", () =>
  opened(async (page) => {
    await page.page.locator("#demo").tap();
    await settled(page);
    const frame = await rubbed(page);
    assert.deepEqual(await page.unfitForFingers(), []);
    const patch = frame.locator("#patch");
    await patch.scrollIntoViewIfNeeded();
    const { x, y, width, height } = await patch.boundingBox();
    const touch = (type, at) => page.devtools("Input.dispatchTouchEvent",
      { type, touchPoints: at === null ? [] : [{ x: x + width * at, y: y + height / 2, force: 0.5 }] });
    // A browser lets sound begin with the end of a touch.
    await touch("touchStart", 0.5);
    await touch("touchEnd", null);
    await touch("touchStart", 0.5);
    let speed = "0 mm/s";
    for (let n = 0; speed === "0 mm/s" && n < 3000; n++) {
      await touch("touchMove", 0.5 + 0.3 * Math.sin(n / 5));
      speed = await frame.locator("#now-speed").innerText();
    }
    assert.notEqual(speed, "0 mm/s");
    await touch("touchEnd", null);
  }, { ...PHONE, viewport: { width: 390, height: 800 } }));

// Fits what the page has. Returns the frame of the page to rub, ready.
async function rubbed(page) {
  await fit(page);
  assert.equal(await text(page, "#trouble"), "");
  const place = page.page.locator("#rub-frame");
  // A browser draws nothing of a frame out of sight.
  await place.scrollIntoViewIfNeeded();
  const frame = await (await place.elementHandle()).contentFrame();
  const isReady = () => globalThis.rubPage?.newKernel && rubPage.times.ready !== null;
  await frame.waitForFunction(isReady, null, { polling: 100, timeout: 120_000 });
  return frame;
}

test("a take by the microphone is the sound that is played to it, and gives its third octaves", async () => {
  const rate = 48_000;
  const next = noise(9);
  const heard = path.join(folder, "heard.wav");
  fs.writeFileSync(heard, wave(rate, 10, next));
  const from = await launched(["--use-fake-device-for-media-stream", "--use-fake-ui-for-media-stream",
    `--use-file-for-fake-audio-capture=${heard}`]);
  try {
    await opened(async (page) => {
      await page.page.locator("#record summary").click();
      const said = { texture: "cork", speed: "60", force: "0.5", scale: "20", seconds: "9" };
      for (const [id, value] of Object.entries(said)) await page.page.locator(`#take-${id}`).fill(value);
      await page.page.locator("#take").click();
      await settled(page);
      assert.equal(await text(page, "#trouble"), "");
      assert.match(await text(page, "#take-text"), /cork_60mms_0\.5N_1\.wav: 9\.\d s at \d+ Hz/);
      await rubbed(page);
      const library = await saved(page, "Library");
      // The truth at the same scale, as a recording that the library was not fitted to.
      const truth = path.join(folder, "truth");
      fs.mkdirSync(truth);
      fs.copyFileSync(heard, path.join(truth, "cork.wav"));
      fs.writeFileSync(path.join(truth, "trials.csv"),
        "file,texture,speed_mm_s,force_n,scale_m_s2\ncork.wav,cork,60,0.5,20\n");
      await saved(page, "Its record");
      stylus("evaluate", truth, "--library", library, "--synthesis", "60", "--json-out", "truth.json");
      const { trials } = JSON.parse(fs.readFileSync(path.join(folder, "truth.json")));
      const errors = trials[0].band_errors_db.filter((error) => error !== null);
      assert.ok(errors.length > 15 && errors.every((error) => Math.abs(error) < 1), errors.join(" "));
    }, {}, from);
  } finally {
    await from.close();
  }
});
