// The experiment in host-tools/browser/jspsych as a participant goes through it, from a folder, with the network
// blocked: jsPsych's table holds the takes and the answers.

import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import fs from "node:fs";
import path from "node:path";
import { before, test } from "node:test";
import { fileURLToPath } from "node:url";

import { browser, folder } from "./bench.mjs";
import { Opened } from "./chromium.mjs";

const { STYLUS_PAGE: rub, STYLUS_LISTENING: listening, STYLUS_PROGRAM: stylus } = process.env;
const { STYLUS_LIBRARY: library, STYLUS_NODE_MODULES: modules } = process.env;
const example = fileURLToPath(new URL("../../host-tools/browser/jspsych", import.meta.url));
const plan = JSON.parse(fs.readFileSync(listening, "utf8").split('id="plan">')[1].split("</script>")[0]);

before(() => {
  for (const name of fs.readdirSync(example)) fs.copyFileSync(path.join(example, name), path.join(folder, name));
  fs.copyFileSync(rub, path.join(folder, "rub.html"));
  fs.copyFileSync(listening, path.join(folder, "listening.html"));
  const jspsych = path.join("node_modules", "jspsych");
  fs.cpSync(path.join(modules, jspsych), path.join(folder, jspsych), { recursive: true });
});

// Rows of a table of quoted cells, by the names of its columns.
function rowsOf(csv) {
  const lines = [[]];
  for (const [, cell, end] of csv.matchAll(/"((?:[^"]|"")*)"(,|\r\n|$)/g)) {
    lines.at(-1).push(cell.replaceAll('""', '"'));
    if (end === "\r\n") lines.push([]);
  }
  const [names, ...rows] = lines.filter((line) => line.length > 0);
  return rows.map((cells) => Object.fromEntries(names.map((name, index) => [name, cells[index]])));
}

// How light the grounds of the experiment and of its frames are, 0 to 255.
function grounds(page) {
  return Promise.all(page.page.frames().map((frame) => frame.evaluate(() => {
    const probe = document.body.appendChild(document.createElement("div"));
    probe.style.background = "var(--ground, Canvas)";
    const [red] = getComputedStyle(probe).backgroundColor.match(/\d+/g).map(Number);
    probe.remove();
    return red;
  })));
}

// Lets time pass in the experiment and its frames until an element is there.
async function there(page, locator) {
  for (let ms = 0; !(await locator.isVisible()); ms += 10) {
    assert.ok(ms < 60_000, `not within a minute: ${locator}`);
    await page.advance(10);
  }
}

const RUBBED_S = 1.5;

// Tries to choose another texture by its key, and rubs the patch in the frame back and forth.
async function rubbed(page) {
  const frame = page.page.frameLocator("iframe");
  const seen = await frame.locator("body").innerText();
  for (const { surface } of plan.trials) assert.ok(!seen.includes(surface), `a participant reads: ${seen}`);
  await frame.locator("#patch").focus();
  await page.press("1");
  const [own, of] = page.page.frames();
  await of.evaluate((seconds) => stylusTime.rub(seconds), RUBBED_S);
  await own.evaluate((seconds) => stylusTime.advance(1000 * seconds), RUBBED_S);
}

// Hears all three sounds of the trial and says that X is like A.
async function answered(page, number) {
  const frame = page.page.frameLocator("iframe");
  if (number === 0) {
    await there(page, frame.locator("#begin"));
    await frame.locator("#listener").fill("4");
    await frame.locator("#begin").click();
  }
  if (number > 0 && number % plan.break_every === 0) await frame.locator("#go-on").click();
  await there(page, frame.getByText(`Trial ${number + 1} of ${plan.trials.length}`));
  for (const index of [0, 1, 2]) {
    await frame.locator(`#play-${index}`).click();
    await there(page, frame.locator(`#play-${index}[aria-pressed=true]`));
  }
  await frame.locator("#answer-0").click();
}

test("from the first trial to the table: takes are played by stylus render, and answers are the page's", async () => {
  const page = await Opened.open(browser, path.join(folder, "experiment.html"), {}, { waits: false });
  for (let number = 0; number < 2; number++) {
    const button = page.page.locator("button.jspsych-btn:enabled");
    await there(page, button);
    for (const colorScheme of ["dark", "light"]) {
      await page.page.emulateMedia({ colorScheme });
      const found = await grounds(page);
      const isOfScheme = (ground) => (colorScheme === "dark" ? ground < 64 : ground > 192);
      assert.ok(found.length === 2 && found.every(isOfScheme), `${colorScheme}: ${found}`);
    }
    await rubbed(page);
    await button.click();
    // Without time in the experiment, which waits for a take for a second of its own.
    await page.loaded((count) => jsPsych.data.get().count() === count, number + 1);
  }
  for (let number = 0; number < plan.trials.length; number++) await answered(page, number);
  const link = page.page.getByText("Save the data (CSV)");
  await there(page, link);
  assert.equal(await page.page.locator("iframe").count(), 0);
  const [download] = await Promise.all([page.page.waitForEvent("download"), link.click()]);
  await download.saveAs(path.join(folder, "experiment.csv"));
  const rows = rowsOf(fs.readFileSync(path.join(folder, "experiment.csv"), "utf8"));

  const takes = rows.filter((row) => row.trial_type === "stylus-rub");
  assert.deepEqual(takes.map(({ texture }) => texture).sort(), ["denim", "vinyl"]);
  for (const take of takes) {
    assert.equal(take.simulated, "true");
    assert.ok(Number(take.rt) >= 1000 * RUBBED_S && Number(take.ready_ms) >= 0, JSON.stringify(take));
    const [motion, wav] = ["motion.csv", "played.wav"].map((name) => path.join(folder, name));
    fs.writeFileSync(motion, take.motion_csv);
    const speeds = take.motion_csv.trim().split("\n").slice(1).map((row) => Number(row.split(",")[1]));
    assert.ok(Math.max(...speeds) > 20, `${Math.max(...speeds)} mm/s`);
    assert.ok(Number(take.take_s) >= RUBBED_S && Math.abs(speeds.length / 500 - Number(take.take_s)) < 0.01);
    const what = ["--texture", take.texture, "--motion", motion, "--seed", take.seed, "--seconds", take.take_s];
    const run = spawnSync(stylus, ["render", library, ...what, "--out", wav, "--overwrite"], { encoding: "utf8" });
    assert.equal(run.status, 0, run.stderr);
  }

  const answers = rows.filter((row) => row.trial_type === "stylus-compare");
  assert.equal(answers.length, plan.trials.length);
  answers.forEach((row, number) => {
    const { pair, a, b, x, surface } = plan.trials[number];
    const expected = { trial: String(number + 1), pair, a, b, x, surface, answer: "A", correct: a === x ? "1" : "0" };
    const found = Object.fromEntries(Object.keys(expected).map((name) => [name, row[name]]));
    assert.deepEqual(found, expected);
    assert.equal(row.is_last, String(number === plan.trials.length - 1));
  });
  assert.deepEqual(page.requests.filter((url) => !/^(file|blob):/.test(url)), []);
  assert.deepEqual(page.complaints, []);
  await page.close();
});

test("a trial says what is wrong with its texture's name", async () => {
  const text = fs.readFileSync(path.join(folder, "experiment.html"), "utf8");
  const other = path.join(folder, "wrong.html");
  fs.writeFileSync(other, text.replace('["vinyl", "denim"]', '["silk"]'));
  const page = await Opened.open(browser, other, {}, { waits: false });
  await there(page, page.page.getByText("no texture and no scene 'silk'"));
  await page.close();
});
