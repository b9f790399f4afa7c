"use strict";
(() => {
  const plan = JSON.parse(document.getElementById("plan").textContent);
  const sounds = JSON.parse(document.getElementById("sounds").textContent);
  const NAMES = ["A", "B", "X"];
  const KEY = "stylus-compare-" + plan.page;
  const at = (id) => document.getElementById(id);

  // ---- What is kept. A browser that keeps nothing still runs the test, and says so.
  const fresh = () => ({ answers: [], plays: [0, 0, 0], seconds: 0 });
  const isCount = (n) => Number.isInteger(n) && n >= 0;
  const isSound = (s) =>
    s !== null && typeof s === "object" && Array.isArray(s.answers) && s.answers.length <= plan.trials.length &&
    s.answers.every((a) => (a.answer === "A" || a.answer === "B") && isCount(a.replays) && a.seconds >= 0) &&
    Array.isArray(s.plays) && s.plays.length === 3 && s.plays.every(isCount) && s.seconds >= 0;
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
    for (const index of [0, 1, 2]) at("play-" + index).setAttribute("aria-pressed", "false");
  };
  let asked = 0;
  // True if the sound was begun, and false if another one was asked for in the meantime.
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
    const number = state.answers.length;
    if (at("trial").hidden || number >= plan.trials.length) return;
    if (!(await sounded(plan.trials[number].sounds[which]))) return;
    at("play-" + which).setAttribute("aria-pressed", "true");
    state.plays[which] += 1;
    keep();
    allow();
  };
  const stop = () => { asked += 1; silence(); };

  // ---- Trials.
  const heard = () => state.plays.every((count) => count > 0);
  const allow = () => {
    for (const index of [0, 1]) at("answer-" + index).disabled = !heard();
    const missing = NAMES.filter((_, index) => state.plays[index] === 0);
    at("hint").textContent = heard() ? "Which is X like? Guess if you do not know."
      : "Hear " + missing.join(" and ") + " before you answer.";
  };
  const show = (section) => {
    for (const id of ["start", "trial", "break", "end"]) at(id).hidden = id !== section;
    at(section + "-title").focus();
  };
  const next = () => {
    stop();
    const done = state.answers.length;
    at("progress").max = plan.trials.length;
    at("progress").value = done;
    if (done === plan.trials.length) {
      since = null;
      results();
      show("end");
      return;
    }
    at("trial-title").textContent = "Trial " + (done + 1) + " of " + plan.trials.length;
    since = performance.now();
    allow();
    show("trial");
  };
  const isRight = (number) => {
    const trial = plan.trials[number];
    const answer = state.answers[number].answer;
    return (answer === "A" ? trial.a : trial.b) === trial.x;
  };
  const answer = (letter) => {
    const done = state.answers.length;
    if (at("trial").hidden || !heard() || done >= plan.trials.length) return;
    settle();
    state.answers.push({
      answer: letter,
      replays: state.plays.reduce((sum, count) => sum + count, 0) - 3,
      seconds: Math.round(state.seconds * 100) / 100,
    });
    state.plays = [0, 0, 0];
    state.seconds = 0;
    since = null;
    keep();
    at("status").textContent = "Kept: trial " + (done + 1) + ", X is like " + letter + ".";
    const left = plan.trials.length - state.answers.length;
    if (left > 0 && state.answers.length % plan.break_every === 0) {
      stop();
      at("progress").value = state.answers.length;
      show("break");
    } else {
      next();
    }
    if (isInside) parent.postMessage({ stylus: "compare", csv: csv(), is_last: !at("end").hidden }, "*");
  };

  // ---- Files.
  const quoted = (text) => '"' + String(text).replaceAll('"', '""') + '"';
  const csv = () => {
    const rows = ["trial,pair,a,b,x,answer,correct,replays,seconds,surface,page,origin"];
    state.answers.forEach((given, number) => {
      const trial = plan.trials[number];
      rows.push([number + 1, trial.pair, trial.a, trial.b, trial.x, given.answer, isRight(number) ? 1 : 0,
        given.replays, given.seconds, quoted(trial.surface), plan.page,
        plan.simulated ? "SIMULATED" : "recorded"].join(","));
    });
    return rows.join("\n") + "\n";
  };
  const save = () => {
    const url = URL.createObjectURL(new Blob([csv()], { type: "text/csv" }));
    const link = document.createElement("a");
    link.href = url;
    link.download = "answers-" + plan.page + ".csv";
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
      const correct = numbers.filter(isRight).length;
      return { pair, trials: numbers.length, correct, interval: clopperPearson(correct, numbers.length, plan.confidence) };
    };
    const answered = state.answers.map((_, number) => number);
    const rows = pairs.map((pair) => of(pair, answered.filter((number) => plan.trials[number].pair === pair)));
    if (pairs.length > 1) rows.push(of("all", answered));
    return rows;
  };
  const element = (tag, text, className) => {
    const made = document.createElement(tag);
    if (text !== undefined) made.textContent = text;
    if (className) made.className = className;
    return made;
  };
  const drawn = (score) => {
    const space = "http://www.w3.org/2000/svg";
    const svg = document.createElementNS(space, "svg");
    const x = (share) => 10 + 180 * share;
    svg.setAttribute("width", "200");
    svg.setAttribute("height", "26");
    svg.setAttribute("role", "img");
    const [low, high] = score.interval;
    const share = score.correct / Math.max(1, score.trials);
    const percent = (value) => Math.round(100 * value) + " %";
    svg.setAttribute("aria-label", "Interval from " + percent(low) + " to " + percent(high) + ", chance at " +
      percent(plan.chance));
    const draw = (tag, attributes) => {
      const part = document.createElementNS(space, tag);
      for (const [name, value] of Object.entries(attributes)) part.setAttribute(name, value);
      svg.append(part);
    };
    draw("line", { class: "interval", x1: x(low), x2: x(high), y1: 13, y2: 13 });
    draw("line", { class: "chance", x1: x(plan.chance), x2: x(plan.chance), y1: 0, y2: 26 });
    draw("circle", { class: "found", cx: x(share), cy: 13, r: 5 });
    return svg;
  };
  const results = () => {
    const table = element("table");
    table.append(element("caption", "Right answers by pair of kinds" + (plan.simulated ? " (SIMULATED recordings)" : "")));
    const head = element("tr");
    for (const name of ["pair", "right", "trials", "share", "95 % interval", "0 to 100 %, chance dashed"]) {
      const cell = element("th", name);
      cell.scope = "col";
      head.append(cell);
    }
    const top = element("thead");
    top.append(head);
    const body = element("tbody");
    for (const score of scores()) {
      const row = element("tr");
      row.dataset.pair = score.pair;
      const percent = (value) => (100 * value).toFixed(0) + " %";
      const name = element("th", score.pair.replace("-", " and "));
      name.scope = "row";
      row.append(name, element("td", score.correct, "number"), element("td", score.trials, "number"),
        element("td", percent(score.correct / Math.max(1, score.trials)), "number"),
        element("td", percent(score.interval[0]) + " to " + percent(score.interval[1]), "number"));
      const picture = element("td");
      picture.append(drawn(score));
      row.append(picture);
      body.append(row);
    }
    table.append(top, body);
    at("results").replaceChildren(table);
  };

  // ---- Wires.
  at("facts").textContent = plan.trials.length + " trials, with a break after every " + plan.break_every + ". " + plan.facts;
  at("origin").textContent = "Page " + plan.page + ", seed " + plan.seed + ". Held out: " + plan.held_out;
  if (state.answers.length > 0) {
    at("begin").textContent = "Go on with trial " + Math.min(state.answers.length + 1, plan.trials.length);
  }
  at("level").addEventListener("click", () => sounded(Math.floor(Math.random() * sounds.length)));
  at("begin").addEventListener("click", () => { keep(); next(); });
  at("go-on").addEventListener("click", next);
  at("stop").addEventListener("click", stop);
  at("save").addEventListener("click", save);
  at("save-early").addEventListener("click", save);
  at("again").addEventListener("click", () => {
    if (!confirm("Erase all answers of this page in this browser?")) return;
    state = fresh();
    keep();
    at("begin").textContent = "Begin";
    at("status").textContent = "";
    show("start");
  });
  for (const index of [0, 1, 2]) at("play-" + index).addEventListener("click", () => play(index));
  for (const index of [0, 1]) at("answer-" + index).addEventListener("click", () => answer(NAMES[index]));
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.repeat || at("trial").hidden) return;
    const key = event.key.toLowerCase();
    const sound = ["a", "b", "x"].indexOf(key);
    if (sound >= 0) play(sound);
    else if (key === "s" || key === "escape") stop();
    else if (key === "1" || key === "2") answer(NAMES[Number(key) - 1]);
    else return;
    event.preventDefault();
  });
  at("kept-here").hidden = isInside;
  addEventListener("pagehide", () => { if (since !== null) keep(); });
  // For whoever checks the page's arithmetic.
  globalThis.clopperPearson = clopperPearson;
})();
