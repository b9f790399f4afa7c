// The page of `compare` as a listener uses it, in Chromium, with the network blocked, and the score of its answers.

import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import fs from "node:fs";
import os from "node:os";
import path from "node:path";
import { after, before, test } from "node:test";

import { Opened, launched } from "./chromium.mjs";

const { STYLUS_LISTENING: file, STYLUS_PROGRAM: stylus } = process.env;
const folder = fs.mkdtempSync(path.join(os.tmpdir(), "stylus-listening-"));
// The key of the page: what is right in each trial.
const plan = JSON.parse(fs.readFileSync(file, "utf8").split('id="plan">')[1].split("</script>")[0]);
const total = plan.trials.length;
let browser;

before(async () => {
  browser = await launched();
});

after(async () => {
  await browser.close();
  fs.rmSync(folder, { recursive: true });
});

// Where text is hard to read or a control has no name, in light and dark.
async function checkLooks(page, at) {
  for (const colorScheme of ["light", "dark"]) {
    await page.page.emulateMedia({ colorScheme });
    const [least, text] = await page.leastContrast();
    assert.ok(least >= 4.5, `${at}, ${colorScheme}: ${least} of '${text}'`);
  }
  assert.deepEqual(await page.unnamed(), [], at);
}

const RELOADS_IN = 5;

// A listener who answers right but in every third trial, by keys and by the mouse, and reloads the page in between.
async function answer(page, number) {
  const trial = plan.trials[number];
  if (number === RELOADS_IN) {
    const missing = () => document.getElementById("hint").textContent.startsWith("Hear B and X");
    await page.press("a");
    await page.wait(missing);
    await page.page.reload();
    assert.equal(await page.page.textContent("#begin"), `Go on with trial ${number + 1}`);
    await page.page.click("#begin");
    // What was heard before counts.
    await page.wait(missing);
  }
  if (number > 0 && number % plan.break_every === 0) {
    await page.wait(() => !document.getElementById("break").hidden);
    await page.page.click("#go-on");
  }
  await page.wait((title) => document.getElementById("trial-title").textContent === title, `Trial ${number + 1} of ${total}`);
  // Blind: nothing that is seen names a kind.
  const seen = (await page.value(() => document.body.innerText + document.title)).toLowerCase();
  for (const kind of ["recording", "gaussian", "fitted"]) assert.ok(!seen.includes(kind), seen);
  // An answer before all three were heard is none.
  await page.press("1");
  const right = trial.a === trial.x ? 0 : 1;
  const given = number % 3 === 0 ? 1 - right : right;
  const heard = (index) => page.value(
    (n) => JSON.parse(localStorage.getItem(Object.keys(localStorage)[0])).plays[n], index);
  for (const index of number % 2 === 0 ? [0, 1, 2] : [0, 1, 2, 2]) {
    const before = await heard(index);
    if (number % 2 === 0) await page.press("abx"[index]);
    else await page.page.click(`#play-${index}`);
    while ((await heard(index)) === before) await page.settle(10);
  }
  if (number % 2 === 0) await page.press(["1", "2"][given]);
  else await page.page.click(`#answer-${given}`);
  return given;
}

test("a listener answers, reloads and saves, and the score is that of the seed's key", async () => {
  const page = await Opened.open(browser, file, {}, { waits: false });
  assert.ok((await page.page.innerText("body")).includes("X is of the same kind as A"));
  await checkLooks(page, "start");
  await page.page.click("#begin");
  await checkLooks(page, "trial");
  const given = [];
  for (let number = 0; number < total; number++) given.push(await answer(page, number));
  await page.wait(() => !document.getElementById("end").hidden);
  await checkLooks(page, "end");
  const [download] = await Promise.all([page.page.waitForEvent("download"), page.page.click("#save")]);
  const saved = path.join(folder, download.suggestedFilename());
  await download.saveAs(saved);
  const correct = given.filter((_, number) => number % 3 !== 0).length;
  const cells = await page.value(() => [...document.querySelectorAll("#results tbody tr")[0].cells].map((c) => c.textContent));
  assert.deepEqual(cells.slice(1, 3), [String(correct), String(total)]);

  const [header, ...rows] = fs.readFileSync(saved, "utf8").trim().split("\n");
  assert.equal(header, "trial,pair,a,b,x,answer,correct,replays,seconds,surface,page,origin");
  assert.equal(rows.length, total);
  rows.forEach((row, number) => {
    const { pair, a, b, x } = plan.trials[number];
    const replays = (number % 2) + (number === RELOADS_IN ? 1 : 0);
    const expected = [number + 1, pair, a, b, x, "AB"[given[number]], number % 3 === 0 ? 0 : 1, replays];
    assert.ok(row.startsWith(`${expected.join(",")},`), `${row}: ${expected}`);
    assert.ok(row.endsWith(`${plan.page},SIMULATED`), row);
  });
  const score = spawnSync(stylus, ["compare", "--score", saved], { encoding: "utf8" });
  const line = score.stdout.split("\n").find((one) => one.startsWith("recording-gaussian"));
  assert.deepEqual(line.split(/\s+/).slice(1, 4), ["1", String(total), String(correct)]);
  assert.deepEqual(page.requests.filter((url) => !url.startsWith("blob:")), []);
  assert.deepEqual(page.complaints, []);
  await page.close();
});

test("the interval of a proportion leaves half of what the confidence leaves on either side", async () => {
  const page = await Opened.open(browser, file, {}, { waits: false });
  const cases = [[0, 4000], [1999, 2000], [777, 1200]];
  for (let n = 1; n < 20; n++) for (let k = 0; k <= n; k++) cases.push([k, n]);
  const found = await page.value((list) => list.map(([k, n]) => clopperPearson(k, n, 0.95)), cases);
  // Probability of `from` to `to` successes, by logarithms of the binomial's terms.
  const between = (from, to, n, p) => {
    let [logarithm, sum] = [0, 0];
    for (let k = 0; k <= to; k++) {
      if (k > 0) logarithm += Math.log((n - k + 1) / k);
      if (k >= from) sum += Math.exp(logarithm + k * Math.log(p) + (n - k) * Math.log1p(-p));
    }
    return sum;
  };
  cases.forEach(([k, n], index) => {
    const [low, high] = found[index];
    const tails = [k === 0 ? low + 0.025 : between(k, n, n, low), k === n ? 1.025 - high : between(0, k, n, high)];
    for (const tail of tails) assert.ok(Math.abs(tail - 0.025) < 1e-9, `${k} of ${n}: ${low} to ${high}, ${tail}`);
  });
  await page.close();
});
