"use strict";
(() => {
  const plan = JSON.parse(document.getElementById("plan").textContent);
  const sounds = JSON.parse(document.getElementById("sounds").textContent);
  const rates = plan.design === "similarity";
  const climbs = plan.design === "staircase";
  const NAMES = rates ? ["A", "B"] : ["A", "B", "X"];
  const KEY = "stylus-compare-" + plan.page;
  const at = (id) => document.getElementById(id);

  // ---- Designs.
  const isRight = (trial, answer) => (answer === "A" ? trial.a : trial.b) === trial.x;
  // A block has an order of the Latin square: the listener's own one first, and then the next.
  const rated = (number) => {
    const width = plan.orders[0].length;
    const block = Math.floor(number / width);
    const order = plan.orders[(state.listener - 1 + block) % plan.orders.length];
    return { ...plan.trials[block * width + order[number % width]], block: block + 1, position: number % width + 1 };
  };
  // Staircases take turns. Two right answers in a row make a step down, and a wrong one makes a step up.
  const climbed = (answers) => {
    const tracks = plan.tracks.map((track) => (
      { track, step: track.strengths.length - 1, run: 0, isDown: null, steps: [], reversals: [] }));
    const asked = [];
    for (const given of [...answers, null]) {
      const open = tracks.filter(({ track, steps, reversals }) =>
        reversals.length < plan.rule.reversals && steps.length < track.coins.length);
      if (open.length === 0) return { tracks, asked, next: null };
      const one = open.reduce((least, other) => (other.steps.length < least.steps.length ? other : least));
      const { track, step } = one;
      const coin = track.coins[one.steps.length];
      const name = (isChanged) => (isChanged ? "changed" : "reference");
      const trial = {
        part: track.part, unit: track.unit, surface: track.surface, step: step + 1, strength: track.strengths[step],
        a: name(coin.a_is_changed), b: name(!coin.a_is_changed), x: name(coin.x_is_changed), reversal: 0,
      };
      trial.sounds = [trial.a, trial.b, trial.x].map((kind, place) =>
        (kind === "changed" ? track.changed[step] : track.reference)[coin.windows[place]]);
      if (given === null) return { tracks, asked, next: trial };
      asked.push(trial);
      one.steps.push(step);
      const right = isRight(trial, given.answer);
      one.run = right ? one.run + 1 : 0;
      if (right && one.run < 2) continue;
      if (one.isDown === !right) {
        one.reversals.push(step);
        trial.reversal = 1;
      }
      one.run = 0;
      one.isDown = right;
      const size = one.reversals.length < plan.rule.coarse_reversals ? 2 : 1;
      one.step = Math.max(0, Math.min(track.strengths.length - 1, step + (right ? -size : size)));
    }
  };
  const most = climbs ? plan.tracks.reduce((sum, track) => sum + track.coins.length, 0) : plan.trials.length;
  // The trial after so many answers, and null after the last one.
  const trialAfter = (number) => {
    if (climbs) {
      const { asked, next } = climbed(state.answers.slice(0, number));
      return asked[number] ?? next;
    }
    if (number >= most) return null;
    return rates ? rated(number) : plan.trials[number];
  };

  // ---- What is kept. A browser that keeps nothing still runs the test, and says so.
  const fresh = () => ({ listener: null, answers: [], plays: NAMES.map(() => 0), seconds: 0 });
  const isCount = (n) => Number.isInteger(n) && n >= 0;
  const isAnswer = (a) => (rates ? isCount(a) && a <= 100 : a === "A" || a === "B");
  const isSound = (s) =>
    s !== null && typeof s === "object" && Array.isArray(s.answers) && (isCount(s.listener) || s.answers.length === 0) &&
    s.answers.length <= most && s.answers.every((a) => isAnswer(a.answer) && isCount(a.replays) && a.seconds >= 0) &&
    Array.isArray(s.plays) && s.plays.length === NAMES.length && s.plays.every(isCount) && s.seconds >= 0;
  let keeps = true;
  // An experiment's page around this one gets every answer and keeps it, and the next listener begins anew.
  const isInside = parent !== window;
  const load = () => {
    if (isInside) return fresh();
    try {
      const text = localStorage.getItem(KEY);
      const state = text === null ? fresh() : JSON.parse(text);
      return isSound(state) ? state : fresh();
    } catch {
      keeps = false;
      return fresh();
    }
  };
  let state = load();
  let since = null;
  const settle = () => {
    if (since !== null) {
      const now = performance.now();
      state.seconds += (now - since) / 1000;
      since = now;
    }
  };
  const keep = () => {
    settle();
    if (isInside) return;
    try {
      localStorage.setItem(KEY, JSON.stringify(state));
      keeps = true;
    } catch {
      keeps = false;
    }
    at("trouble").hidden = keeps;
    at("trouble").textContent = keeps ? "" :
      "This browser keeps nothing for this page. Do not close it before you have saved your answers.";
  };

  // ---- Sounds.
  let context = null;
  let playing = null;
  const buffers = new Map();
  const buffer = async (index) => {
    if (!buffers.has(index)) {
      const bytes = Uint8Array.from(atob(sounds[index]), (c) => c.charCodeAt(0));
      buffers.set(index, await context.decodeAudioData(bytes.buffer));
    }
    return buffers.get(index);
  };
  const silence = () => {
    if (playing !== null) {
      const source = playing;
      playing = null;
      source.onended = null;
      try { source.stop(); } catch { /* It had ended. */ }
    }
    for (const index of NAMES.keys()) at("play-" + index).setAttribute("aria-pressed", "false");
  };
  let asked = 0;
  // True if the sound was begun, and false if another one was asked for in the meantime, or this one cannot be played.
  const sounded = async (index) => {
    const own = ++asked;
    silence();
    try {
      context = context ?? new AudioContext();
      if (context.state === "suspended") context.resume();
      const decoded = await buffer(index);
      if (own !== asked) return false;
      const source = context.createBufferSource();
      source.buffer = decoded;
      source.connect(context.destination);
      source.onended = () => { if (playing === source) silence(); };
      source.start();
      playing = source;
      return true;
    } catch (failure) {
      at("trouble").hidden = false;
      at("trouble").textContent = "The sound cannot be played: " + failure.message;
      return false;
    }
  };
  const play = async (which) => {
    const trial = trialAfter(state.answers.length);
    if (at("trial").hidden || trial === null) return;
    if (!(await sounded(trial.sounds[which]))) return;
    at("play-" + which).setAttribute("aria-pressed", "true");
    state.plays[which] += 1;
    keep();
    allow();
  };
  const stop = () => { asked += 1; silence(); };

  // ---- Trials.
  const all = new Intl.ListFormat("en-GB");
  const heard = () => state.plays.every((count) => count > 0);
  let isMoved = false;
  const allow = () => {
    for (const index of [0, 1]) at("answer-" + index).disabled = !heard();
    at("rating").disabled = !heard();
    at("rate").disabled = !heard() || !isMoved;
    const missing = NAMES.filter((_, index) => state.plays[index] === 0);
    const question = rates ? "Move the slider, then answer." : "Which is X like? Guess if you do not know.";
    at("hint").textContent = heard() ? question : "Hear " + all.format(missing) + " before you answer.";
  };
  const show = (section) => {
    for (const id of ["start", "trial", "break", "end"]) at(id).hidden = id !== section;
    at(section + "-title").focus();
  };
  // How many trials staircases take is not known, but how many reversals.
  const showProgress = () => {
    const tracks = climbs ? climbed(state.answers).tracks : [];
    at("progress").max = climbs ? tracks.length * plan.rule.reversals : most;
    at("progress").value = climbs ? tracks.reduce((sum, one) => sum + one.reversals.length, 0) : state.answers.length;
  };
  const next = () => {
    stop();
    const done = state.answers.length;
    const trial = trialAfter(done);
    showProgress();
    if (trial === null) {
      since = null;
      results();
      show("end");
      return;
    }
    at("trial-title").textContent = "Trial " + (done + 1) + (climbs ? "" : " of " + most);
    isMoved = false;
    at("rating").value = 50;
    since = performance.now();
    allow();
    show("trial");
  };
  const answer = (given) => {
    const done = state.answers.length;
    if (at("trial").hidden || !heard() || trialAfter(done) === null || (rates && !isMoved)) return;
    settle();
    state.answers.push({
      answer: given,
      replays: state.plays.reduce((sum, count) => sum + count, 0) - NAMES.length,
      seconds: Math.round(state.seconds * 100) / 100,
    });
    state.plays = NAMES.map(() => 0);
    state.seconds = 0;
    since = null;
    keep();
    at("status").textContent = "Kept: trial " + (done + 1) + (rates ? ", rated " : ", X is like ") + given + ".";
    if (trialAfter(done + 1) !== null && state.answers.length % plan.break_every === 0) {
      stop();
      showProgress();
      show("break");
    } else {
      next();
    }
    if (isInside) parent.postMessage({ stylus: "compare", csv: csv(), is_last: !at("end").hidden }, "*");
  };

  // ---- Files.
  // A spreadsheet shows a text that begins like a formula, and computes none.
  const quoted = (text) => '"' + String(text).replace(/^'*[=+\-@]/, "'$&").replaceAll('"', '""') + '"';
  const COLUMNS = {
    abx: ["pair", "a", "b", "x", "answer", "correct"],
    similarity: ["block", "position", "pair", "a", "b", "same", "rating"],
    staircase: ["part", "step", "strength", "unit", "a", "b", "x", "answer", "correct", "reversal"],
  }[plan.design];
  const csv = () => {
    const names = ["design", "listener", "trial", ...COLUMNS, "replays", "seconds", "surface", "page", "origin"];
    const rows = [names.join(",")];
    const trials = climbs ? climbed(state.answers).asked : state.answers.map((_, number) => trialAfter(number));
    state.answers.forEach((given, number) => {
      const trial = trials[number];
      const cells = {
        ...trial, answer: given.answer, rating: given.answer, same: trial.a === trial.b ? 1 : 0,
        correct: isRight(trial, given.answer) ? 1 : 0,
      };
      rows.push([plan.design, state.listener, number + 1, ...COLUMNS.map((name) => cells[name]), given.replays,
        given.seconds, quoted(trial.surface), plan.page, plan.simulated ? "SIMULATED" : "recorded"].join(","));
    });
    return rows.join("\n") + "\n";
  };
  const save = () => {
    const url = URL.createObjectURL(new Blob([csv()], { type: "text/csv" }));
    const link = document.createElement("a");
    link.href = url;
    link.download = "answers-" + plan.page + "-" + state.listener + ".csv";
    link.click();
    setTimeout(() => URL.revokeObjectURL(url), 10000);
  };

  // ---- The exact interval of a proportion, after Clopper and Pearson.
  // Probability of at least `least` successes: each term follows from the one before it, from the likeliest outwards,
  // so that none is lost to underflow, and all are divided by their sum.
  const atLeast = (least, trials, proportion) => {
    const odds = proportion / (1 - proportion);
    const mode = Math.min(trials, Math.floor((trials + 1) * proportion));
    let all = 1;
    let above = mode >= least ? 1 : 0;
    for (let term = 1, count = mode; count < trials && term > 0; count += 1) {
      term *= (trials - count) / (count + 1) * odds;
      all += term;
      if (count + 1 >= least) above += term;
    }
    for (let term = 1, count = mode; count > 0 && term > 0; count -= 1) {
      term *= count / (trials - count + 1) / odds;
      all += term;
      if (count - 1 >= least) above += term;
    }
    return above / all;
  };
  const halved = (isBelow) => {
    let low = 0, high = 1;
    for (let i = 0; i < 60; i += 1) {
      const middle = (low + high) / 2;
      if (isBelow(middle)) low = middle; else high = middle;
    }
    return (low + high) / 2;
  };
  const clopperPearson = (successes, trials, confidence) => {
    const tail = (1 - confidence) / 2;
    const failures = trials - successes;
    return [
      successes === 0 ? 0 : halved((p) => atLeast(successes, trials, p) < tail),
      failures === 0 ? 1 : halved((p) => atLeast(failures, trials, 1 - p) > tail),
    ];
  };

  // ---- Results.
  const scores = () => {
    const pairs = [...new Set(plan.trials.map((trial) => trial.pair))];
    const of = (pair, numbers) => {
      const correct = numbers.filter((number) => isRight(plan.trials[number], state.answers[number].answer)).length;
      const interval = clopperPearson(correct, numbers.length, plan.confidence);
      return { pair, trials: numbers.length, correct, interval };
    };
    const answered = state.answers.map((_, number) => number);
    const rows = pairs.map((pair) => of(pair, answered.filter((number) => plan.trials[number].pair === pair)));
    if (pairs.length > 1) rows.push(of("all", answered));
    return rows;
  };
  const ratings = () => {
    const found = new Map();
    state.answers.forEach((given, number) => {
      const { pair } = rated(number);
      found.set(pair, [...(found.get(pair) ?? []), given.answer]);
    });
    return [...found].map(([pair, own]) => {
      const mean = own.reduce((a, b) => a + b, 0) / own.length;
      return { pair, trials: own.length, mean, range: [Math.min(...own), Math.max(...own)] };
    });
  };
  // The geometric mean of the last reversals, none of too few, and whether one of them stands at an end of the grid.
  const thresholds = () => climbed(state.answers).tracks.map(({ track, steps, reversals }) => {
    const { averaged_reversals: averaged, coarse_reversals: coarse } = plan.rule;
    const last = reversals.slice(-averaged);
    const isWhole = reversals.length >= coarse + averaged;
    const mean = Math.exp(last.reduce((sum, step) => sum + Math.log(track.strengths[step]), 0) / last.length);
    const atEnd = last.some((step) => step === 0 || step === track.strengths.length - 1);
    return { track, steps, reversals: reversals.length, threshold: isWhole ? mean : null, atEnd };
  });
  const element = (tag, text, className) => {
    const made = document.createElement(tag);
    if (text !== undefined) made.textContent = text;
    if (className) made.className = className;
    return made;
  };
  const picture = (label, parts) => {
    const space = "http://www.w3.org/2000/svg";
    const svg = document.createElementNS(space, "svg");
    const set = (one, attributes) => {
      for (const [name, value] of Object.entries(attributes)) one.setAttribute(name, value);
      return one;
    };
    set(svg, { viewBox: "0 0 200 26", role: "img", "aria-label": label });
    for (const [tag, attributes] of parts) svg.append(set(document.createElementNS(space, tag), attributes));
    return svg;
  };
  const along = (share) => 10 + 180 * share;
  const percent = (value) => (100 * value).toFixed(0) + " %";
  // An interval with what was found in it, and a dashed line, as shares of the width.
  const interval = (label, [low, high], share, dashed) => picture(label, [
    ["line", { class: "interval", x1: along(low), x2: along(high), y1: 13, y2: 13 }],
    ["line", { class: "chance", x1: along(dashed), x2: along(dashed), y1: 0, y2: 26 }],
    ["circle", { class: "found", cx: along(share), cy: 13, r: 5 }],
  ]);
  const ofAbx = () => ["Right answers by pair of kinds",
    ["pair", "right", "trials", "share", "95 % interval", "0 to 100 %, chance dashed"],
    scores().map(({ pair, trials, correct, interval: [low, high] }) => {
      const share = correct / Math.max(1, trials);
      const label = "Interval from " + percent(low) + " to " + percent(high) + ", chance at " + percent(plan.chance);
      return [pair, correct, trials, percent(share), percent(low) + " to " + percent(high),
        interval(label, [low, high], share, plan.chance)];
    })];
  const ofRatings = () => ["Ratings by pair of kinds",
    ["pair", "trials", "mean", "lowest to highest", "0 to 100, the middle dashed"],
    ratings().map(({ pair, trials, mean, range }) => {
      const label = "Mean " + mean.toFixed(1) + ", from " + range.join(" to ");
      const drawn = interval(label, range.map((rating) => rating / 100), mean / 100, 0.5);
      return [pair, trials, mean.toFixed(1), range.join(" to "), drawn];
    })];
  const ofStaircases = () => ["Thresholds", ["part", "trials", "reversals", "threshold", "strength by trial, greatest on top"],
    thresholds().map(({ track, steps, reversals, threshold, atEnd }) => {
      const found = threshold === null ? "none: too few reversals"
        : threshold.toPrecision(3) + " " + track.unit + (atEnd ? " (end)" : "");
      const x = (trial) => along(trial / Math.max(1, steps.length - 1));
      const y = (step) => 24 - 22 * step / (track.strengths.length - 1);
      const points = steps.map((step, trial) => x(trial).toFixed(1) + "," + y(step).toFixed(1)).join(" ");
      const drawn = picture("Strength by trial", [["polyline", { class: "track", points }]]);
      return [track.part, steps.length, reversals, found, drawn];
    })];
  const results = () => {
    const [caption, names, rows] = { abx: ofAbx, similarity: ofRatings, staircase: ofStaircases }[plan.design]();
    const table = element("table");
    at("results-title").textContent = caption + (plan.simulated ? " (SIMULATED recordings)" : "");
    table.setAttribute("aria-labelledby", "results-title");
    const head = element("tr");
    for (const name of names) {
      const cell = element("th", name);
      cell.scope = "col";
      head.append(cell);
    }
    const top = element("thead");
    top.append(head);
    const body = element("tbody");
    for (const [first, ...rest] of rows) {
      const row = element("tr");
      row.dataset.pair = first;
      const name = element("th", first.replace("-", " and "));
      name.scope = "row";
      row.append(name);
      for (const one of rest) {
        const cell = element("td", one instanceof Element ? undefined : one, one instanceof Element ? "" : "number");
        if (one instanceof Element) cell.append(one);
        row.append(cell);
      }
      body.append(row);
    }
    table.append(top, body);
    at("results").replaceChildren(table);
  };

  // ---- Wires.
  for (const part of document.querySelectorAll("[data-for]")) {
    if (!part.dataset.for.split(" ").includes(plan.design)) part.hidden = true;
  }
  at("facts").textContent =
    (climbs ? "Up to " : "") + most + (most === 1 ? " trial" : " trials") +
    (most > plan.break_every ? ", with a break after every " + plan.break_every : "") + ". " + plan.facts;
  at("origin").textContent = "Page " + plan.page + ", seed " + plan.seed + ". Held out: " + plan.held_out;
  if (state.answers.length > 0) {
    const number = state.answers.length + (trialAfter(state.answers.length) === null ? 0 : 1);
    at("begin").textContent = "Go on with trial " + number;
  }
  // A link can bring the number: page.html#listener=3.
  const told = new URLSearchParams(location.hash.slice(1)).get("listener");
  at("listener").value = state.listener ?? told ?? "";
  at("listener").disabled = state.answers.length > 0;
  at("level").addEventListener("click", () => sounded(Math.floor(Math.random() * sounds.length)));
  at("begin").addEventListener("click", () => {
    if (!at("listener").reportValidity()) return;
    state.listener = Number(at("listener").value);
    at("listener").disabled = true;
    keep();
    next();
  });
  at("go-on").addEventListener("click", next);
  at("stop").addEventListener("click", stop);
  at("save").addEventListener("click", save);
  at("save-early").addEventListener("click", save);
  at("again").addEventListener("click", () => {
    if (!confirm("Erase all answers of this page in this browser?")) return;
    state = fresh();
    keep();
    at("begin").textContent = "Begin";
    at("listener").disabled = false;
    at("listener").value = "";
    at("status").textContent = "";
    show("start");
  });
  for (const index of NAMES.keys()) at("play-" + index).addEventListener("click", () => play(index));
  for (const index of [0, 1]) at("answer-" + index).addEventListener("click", () => answer(NAMES[index]));
  for (const event of ["input", "pointerdown"]) {
    at("rating").addEventListener(event, () => { isMoved = heard(); allow(); });
  }
  at("rate").addEventListener("click", () => answer(Number(at("rating").value)));
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.repeat || at("trial").hidden) return;
    const key = event.key.toLowerCase();
    const sound = NAMES.indexOf(key.toUpperCase());
    if (sound >= 0) play(sound);
    else if (key === "s" || key === "escape") stop();
    else if (rates && key === "enter" && event.target === at("rating")) answer(Number(at("rating").value));
    else if (!rates && (key === "1" || key === "2")) answer(NAMES[Number(key) - 1]);
    else return;
    event.preventDefault();
  });
  at("kept-here").hidden = isInside;
  addEventListener("pagehide", () => { if (since !== null) keep(); });
  // For whoever checks the page's arithmetic.
  globalThis.clopperPearson = clopperPearson;
})();
