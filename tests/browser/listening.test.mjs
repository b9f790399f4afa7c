// The page of `compare` as a listener uses it, in Chromium, with the network blocked, and the score of its answers.

import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import fs from "node:fs";
import path from "node:path";
import { test } from "node:test";

import { browser, folder } from "./bench.mjs";
import { Opened, PHONE } from "./chromium.mjs";

const { STYLUS_LISTENING: file, STYLUS_PROGRAM: stylus } = process.env;
// The key of a page: what is right in each trial.
const planOf = (place) => JSON.parse(fs.readFileSync(place, "utf8").split('id="plan">')[1].split("</script>")[0]);
const plan = planOf(file);
const total = plan.trials.length;

// Where text is hard to read or a control has no name, in light and dark.
async function checkLooks(page, at) {
  for (const colorScheme of ["light", "dark"]) {
    await page.page.emulateMedia({ colorScheme });
    const [least, text] = await page.leastContrast();
    assert.ok(least >= 4.5, `${at}, ${colorScheme}: ${least} of '${text}'`);
  }
  assert.deepEqual(await page.unnamed(), [], at);
}

async function begun(page, listener) {
  await page.page.fill("#listener", String(listener));
  await page.page.click("#begin");
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
  await titled(page, `Trial ${number + 1} of ${total}`);
  // Blind: nothing that is seen names a kind.
  const seen = (await page.value(() => document.body.innerText + document.title)).toLowerCase();
  for (const kind of ["recording", "gaussian", "fitted"]) assert.ok(!seen.includes(kind), seen);
  // An answer before all three were heard is none.
  await page.press("1");
  const right = trial.a === trial.x ? 0 : 1;
  const given = number % 3 === 0 ? 1 - right : right;
  await play(page, number % 2 === 0 ? [0, 1, 2] : [0, 1, 2, 2], number % 2 === 0);
  if (number % 2 === 0) await page.press(["1", "2"][given]);
  else await page.page.click(`#answer-${given}`);
  return given;
}

const titled = (page, title) =>
  page.wait((own) => document.getElementById("trial-title").textContent === own, title);

// Plays sounds until the page has counted them.
async function play(page, sounds, byKeys = true) {
  const heard = (index) => JSON.parse(localStorage.getItem(Object.keys(localStorage)[0])).plays[index];
  for (const index of sounds) {
    const before = await page.value(heard, index);
    if (byKeys) await page.press("abx"[index]);
    else await page.page.click(`#play-${index}`);
    await page.loaded(([index, before]) =>
      JSON.parse(localStorage.getItem(Object.keys(localStorage)[0])).plays[index] > before, [index, before]);
  }
}

// The rows of the file that the page saves, after its header.
async function savedBy(page, header) {
  const [download] = await Promise.all([page.page.waitForEvent("download"), page.page.click("#save")]);
  const saved = path.join(folder, download.suggestedFilename());
  await download.saveAs(saved);
  const [names, ...rows] = fs.readFileSync(saved, "utf8").trim().split("\n");
  assert.equal(names, header);
  return [saved, rows];
}

// The cells of the rows of the table at the end.
const results = (page) => page.value(() =>
  [...document.querySelectorAll("#results tbody tr")].map((row) => [...row.cells].map((cell) => cell.textContent)));

async function closed(page) {
  assert.deepEqual(page.requests.filter((url) => !url.startsWith("blob:")), []);
  assert.deepEqual(page.complaints, []);
  await page.close();
}

test("a listener answers, reloads and saves, and the score is that of the seed's key", async () => {
  const page = await Opened.open(browser, file, {}, { waits: false });
  assert.ok((await page.page.innerText("body")).includes("X is of the same kind as A"));
  await checkLooks(page, "start");
  // Without a number of the listener's own it does not begin.
  assert.equal(await page.page.inputValue("#listener"), "");
  await page.page.click("#begin");
  assert.ok(await page.page.isVisible("#start"));
  await begun(page, 1);
  await checkLooks(page, "trial");
  const given = [];
  for (let number = 0; number < total; number++) given.push(await answer(page, number));
  await page.wait(() => !document.getElementById("end").hidden);
  await checkLooks(page, "end");
  const correct = given.filter((_, number) => number % 3 !== 0).length;
  const cells = (await results(page))[0];
  assert.deepEqual(cells.slice(1, 3), [String(correct), String(total)]);

  const [saved, rows] = await savedBy(page,
    "design,listener,trial,pair,a,b,x,answer,correct,replays,seconds,surface,page,origin");
  assert.equal(rows.length, total);
  rows.forEach((row, number) => {
    const { pair, a, b, x } = plan.trials[number];
    const replays = (number % 2) + (number === RELOADS_IN ? 1 : 0);
    const expected = ["abx", 1, number + 1, pair, a, b, x, "AB"[given[number]], number % 3 === 0 ? 0 : 1, replays];
    assert.ok(row.startsWith(`${expected.join(",")},`), `${row}: ${expected}`);
    assert.ok(row.endsWith(`${plan.page},SIMULATED`), row);
  });
  const score = spawnSync(stylus, ["compare", "--score", saved], { encoding: "utf8" });
  const line = score.stdout.split("\n").find((one) => one.startsWith("recording-gaussian"));
  assert.deepEqual(line.split(/\s+/).slice(1, 4), ["1", String(total), String(correct)]);
  await closed(page);
});

test("a finger finds every control, and no key is named", async () => {
  for (const place of [file, file.replace(".html", "-similarity.html")]) {
    const page = await Opened.open(browser, place, PHONE, { waits: false });
    assert.deepEqual(await page.unfitForFingers(), []);
    await begun(page, 1);
    assert.deepEqual(await page.unfitForFingers(), []);
    await closed(page);
  }
});

test("ratings come in the listener's own order, and are kept as they were given, also on a page by http", async () => {
  const place = file.replace(".html", "-similarity.html");
  const { orders, trials } = planOf(place);
  const page = await Opened.open(browser, place, {}, { waits: false, address: "http://192.168.7.7/listen.html" });
  assert.ok((await page.page.innerText("body")).includes("Rate how alike"));
  await checkLooks(page, "start");
  // A link brings the number.
  await page.page.goto(`${page.page.url()}#listener=3`);
  await page.page.reload();
  await page.page.click("#begin");
  const width = orders[0].length;
  const expected = [];
  for (let number = 0; number < trials.length; number++) {
    if (number > 0 && number % plan.break_every === 0) await page.page.click("#go-on");
    if (number === 2) {
      await page.page.reload();
      assert.ok(await page.page.isDisabled("#listener"));
      await page.page.click("#begin");
    }
    const [block, position] = [Math.floor(number / width), number % width];
    const { pair, a, b } = trials[block * width + orders[(2 + block) % orders.length][position]];
    await titled(page, `Trial ${number + 1} of ${trials.length}`);
    assert.ok(await page.page.isDisabled("#rating"), "no rating before both were heard");
    await play(page, [0, 1], number % 2 === 0);
    assert.ok(await page.page.isDisabled("#rate"), "no rating that nobody has given");
    await page.page.focus("#rating");
    const rating = a === b ? 100 - number : 50 + (number % 7);
    await page.press(a === b ? "End" : "ArrowRight");
    for (let n = a === b ? 100 : 51; n !== rating; n += n < rating ? 1 : -1) {
      await page.press(n < rating ? "ArrowRight" : "ArrowLeft");
    }
    if (number === 0) await checkLooks(page, "trial");
    if (number % 2 === 0) await page.press("Enter");
    else await page.page.click("#rate");
    expected.push(["similarity", 3, number + 1, block + 1, position + 1, pair, a, b, a === b ? 1 : 0, rating, 0]);
  }
  await page.wait(() => !document.getElementById("end").hidden);
  await checkLooks(page, "end");
  const [saved, rows] = await savedBy(page,
    "design,listener,trial,block,position,pair,a,b,same,rating,replays,seconds,surface,page,origin");
  assert.equal(rows.length, expected.length);
  rows.forEach((row, number) => {
    assert.ok(row.startsWith(`${expected[number].join(",")},`), `${row}: ${expected[number]}`);
  });
  for (const [name, count, mean] of await results(page)) {
    const own = expected.filter((row) => row[5] === name.replace(" and ", "-")).map((row) => row[9]);
    assert.deepEqual([count, mean], [String(own.length), (own.reduce((x, y) => x + y) / own.length).toFixed(1)]);
  }
  const refused = spawnSync(stylus, ["compare", "--score", saved], { encoding: "utf8" });
  assert.ok(refused.status !== 0 && refused.stderr.includes("'similarity'"), refused.stderr);
  await closed(page);
});

test("a staircase finds the strength from which on a listener is right, and says it", async () => {
  const place = file.replace(".html", "-staircase.html");
  const { tracks, rule } = planOf(place);
  const page = await Opened.open(browser, place, {}, { waits: false });
  await checkLooks(page, "start");
  await begun(page, 1);
  // The strength that the listener of each part can just tell.
  const least = new Map(tracks.map(({ part }, index) => [part, 4 + 2 * index]));
  const done = () => page.value(() => !document.getElementById("end").hidden);
  const asked = tracks.map(() => 0);
  // The parts take turns as long as all are open: what is heard in each is known from the plan alone.
  const step = tracks.map(({ strengths }) => strengths.length);
  const [run, down, reversals] = [0, null, 0].map((value) => tracks.map(() => value));
  let number = 0;
  for (; !(await done()); number++) {
    if (await page.value(() => !document.getElementById("break").hidden)) await page.page.click("#go-on");
    await titled(page, `Trial ${number + 1}`);
    const open = [...tracks.keys()].filter((index) => reversals[index] < rule.reversals);
    const index = open.reduce((one, other) => (asked[other] < asked[one] ? other : one));
    const coin = tracks[index].coins[asked[index]];
    const isRight = step[index] >= least.get(tracks[index].part);
    await play(page, [0, 1, 2]);
    await page.press((coin.a_is_changed === coin.x_is_changed) === isRight ? "1" : "2");
    asked[index] += 1;
    run[index] = isRight ? run[index] + 1 : 0;
    if (isRight && run[index] < 2) continue;
    if (down[index] === !isRight) reversals[index] += 1;
    [run[index], down[index]] = [0, isRight];
    const size = reversals[index] < rule.coarse_reversals ? 2 : 1;
    step[index] = Math.min(tracks[index].strengths.length, Math.max(1, step[index] + (isRight ? -size : size)));
  }
  await checkLooks(page, "end");
  const [saved, text] = await savedBy(page,
    "design,listener,trial,part,step,strength,unit,a,b,x,answer,correct,reversal,replays,seconds,surface,page,origin");
  const rows = text.map((row) => row.split(","));
  assert.equal(rows.length, number);
  const table = await results(page);
  tracks.forEach(({ part, strengths, unit }, index) => {
    const own = rows.filter((row) => row[3] === part);
    for (const row of own) {
      assert.equal(Number(row[5]), strengths[row[4] - 1]);
      assert.equal(row[11], Number(row[4]) >= least.get(part) ? "1" : "0", row);
      assert.equal(row[11], row[{ A: 7, B: 8 }[row[10]]] === row[9] ? "1" : "0", row);
    }
    assert.equal(own.filter((row) => row[12] === "1").length, rule.reversals);
    // It goes to and fro between the strength that is heard and the one below.
    const threshold = Math.sqrt(strengths[least.get(part) - 1] * strengths[least.get(part) - 2]);
    const [name, trials, count, found] = table[index];
    assert.deepEqual([name, trials, count], [part, String(own.length), String(rule.reversals)]);
    assert.equal(found, `${threshold.toPrecision(3)} ${unit}`);
  });
  const refused = spawnSync(stylus, ["compare", "--score", saved], { encoding: "utf8" });
  assert.ok(refused.status !== 0 && refused.stderr.includes("'staircase'"), refused.stderr);
  if (process.env.STYLUS_ANSWERS) fs.cpSync(folder, process.env.STYLUS_ANSWERS, { recursive: true });
  await closed(page);
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
