"use strict";
// Values of pictures by pointer, touch and keyboard. A picture carries its data: see plot/figure.rs.
globalThis.stylusPlots = (() => {
  const SPACE = "http://www.w3.org/2000/svg";
  // Variables of the pictures' colours.
  const COLOURS = {/*COLOURS*/};
  // Farther from a point than this, in pixels shown, the pointer is not at it; where curves are read too, it is closer.
  const REACH = 40;
  const REACH_BESIDE_CURVES = 10;

  const number = (value) => {
    if (!Number.isFinite(value)) return "no value";
    const rounded = Number(value.toPrecision(4));
    const size = Math.abs(rounded);
    return size !== 0 && (size < 1e-4 || size >= 1e7) ? rounded.toExponential() : String(rounded + 0);
  };
  const withUnit = (text, unit) => (unit ? text + " " + unit : text);

  // ---- The box that says what is there.
  let box = null;
  const say = (x, y, lines) => {
    if (box === null) {
      box = document.createElement("div");
      box.className = "reading";
      box.setAttribute("role", "status");
      document.body.append(box);
    }
    box.replaceChildren(...lines.map((line, index) => {
      const { text, colour } = typeof line === "string" ? { text: line } : line;
      const element = document.createElement(index === 0 ? "b" : "span");
      if (colour) {
        const mark = document.createElement("i");
        mark.style.background = colour;
        element.append(mark);
      }
      element.append(text);
      return element;
    }));
    box.hidden = false;
    // Beside the pointer, on the side that has room, and never past the window's edge.
    const root = document.documentElement;
    const { width, height } = box.getBoundingClientRect();
    const gap = 14, edge = 6;
    const left = x + gap + width + edge <= root.clientWidth ? x + gap : x - gap - width;
    const top = y + gap + height + edge <= root.clientHeight ? y + gap : y - gap - height;
    const within = (value, size, all) => Math.max(edge, Math.min(value, all - size - edge));
    box.style.transform = "translate(" + within(left, width, root.clientWidth) + "px," +
      within(top, height, root.clientHeight) + "px)";
  };

  // ---- Axes: from values to places in the picture and back.
  // What is no number is null in the data.
  const numbers = (values) => (values ?? []).map((value) => value ?? NaN);
  const read = new WeakMap();
  const axes = (group) => {
    if (!read.has(group)) {
      const panel = JSON.parse(group.dataset.panel);
      const series = panel.series.map(({ x, y, z, notes, ...rest }) => ({
        ...rest,
        x: numbers(x),
        y: numbers(y),
        z: numbers(z?.values),
        third: z ?? null,
        notes: notes ?? [],
        levels: panel.levels ?? null,
      }));
      const [svg, image] = [group.closest("svg"), group.querySelector("image")];
      read.set(group, { ...panel, series, group, svg, image });
    }
    return read.get(group);
  };
  const positions = (axis) => {
    axis.values = axis.values ?? axis.names.map(Number);
    return axis.values;
  };
  // Of an axis of names that are numbers, a value between two of them lies between their places.
  const share = (axis, value) => {
    let place = value, { from, to } = axis;
    if (axis.scale === "log") [place, from, to] = [Math.log(value), Math.log(from), Math.log(to)];
    if (axis.scale === "names") {
      const values = positions(axis);
      const next = values.findIndex((other) => other >= value);
      if (next < 0) place = values.length - 1;
      else if (next === 0) place = 0;
      else place = next - (values[next] - value) / (values[next] - values[next - 1]);
    }
    return (place - from) / (to - from);
  };
  const unshare = (axis, part) => {
    if (axis.scale === "log") return axis.from * (axis.to / axis.from) ** part;
    return axis.from + (axis.to - axis.from) * part;
  };
  // On an axis of names a series counts in positions.
  const spot = (axis, value) =>
    axis.scale === "names" ? (value - axis.from) / (axis.to - axis.from) : share(axis, value);
  const along = ({ frame }, across, up) => [
    frame.left + (frame.right - frame.left) * across,
    frame.bottom - (frame.bottom - frame.top) * up,
  ];
  const place = (group, x, y) => {
    const own = axes(group);
    return along(own, share(own.x, x), share(own.y, y));
  };
  const placeOf = (own, series, index) =>
    along(own, spot(own.x, series.x[index]), spot(own.y, series.y[index]));
  const value = (group, px, py) => {
    const own = axes(group);
    const { left, top, right, bottom } = own.frame;
    return [unshare(own.x, (px - left) / (right - left)), unshare(own.y, (bottom - py) / (bottom - top))];
  };

  // ---- What is at a place, as lines of text.
  const onAxis = (axis, at) =>
    axis.scale === "names" ? withUnit(axis.names[Math.round(at)] ?? "", axis.unit) : withUnit(number(at), axis.unit);
  const title = (own, x) => (own.name ? own.name + ": " : "") + own.x.quantity + " " + x;
  const named = (series, text) => ({ text: series.name ? series.name + ": " + text : text, colour: shown(series) });
  // The quantity stands once above several curves, and beside the value of a single one.
  const ofCurve = (own, series, index, isAlone) =>
    named(series, (isAlone ? own.y.quantity + " " : "") + onAxis(own.y, series.y[index]));
  // The colour as it is drawn, in the dark too.
  const shown = (series) => {
    if (!series.colour) return undefined;
    const variable = COLOURS[series.colour.toUpperCase()];
    return variable ? "var(" + variable + ")" : series.colour;
  };

  const valueOf = ({ z, third }, index) =>
    Number.isFinite(z[index]) ? withUnit(number(z[index]), third.unit) : "–";

  const nearestIn = (sorted, wanted) => {
    let low = 0, high = sorted.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (sorted[middle] < wanted) low = middle; else high = middle;
    }
    return Math.abs(sorted[low] - wanted) <= Math.abs(sorted[high] - wanted) ? low : high;
  };
  const readLevel = (own, series, px, py) => {
    const image = own.image;
    if (image === null || !image.pixels) return null;
    const [left, top, width, height] = ["x", "y", "width", "height"].map((name) => image[name].baseVal.value);
    const { data, columns, rows } = image.pixels;
    const column = Math.floor((px - left) / width * columns);
    const row = Math.floor((py - top) / height * rows);
    if (column < 0 || row < 0 || column >= columns || row >= rows) return null;
    const at = 4 * (row * columns + column);
    const { from, to, palette, x, y } = series.levels;
    const colours = palette.length / 6;
    const part = (index, shift) => parseInt(palette.slice(6 * index + shift, 6 * index + shift + 2), 16);
    let best = 0, least = Infinity;
    for (let index = 0; index < colours; index += 1) {
      const far = [0, 2, 4].reduce((sum, shift) => sum + Math.abs(part(index, shift) - data[at + shift / 2]), 0);
      if (far < least) [best, least] = [index, far];
    }
    const level = from + (to - from) * best / (colours - 1);
    return {
      x: x[0] + x[1] * column,
      y: y[0] + y[1] * (rows - 1 - row),
      level,
      // Beyond its ends the scale does not tell.
      bound: best === 0 ? "at most " : best === colours - 1 ? "at least " : "",
    };
  };
  // Pixels of a bitmap, once it is asked for.
  const load = (own) => {
    const image = own.image;
    if (image === null || image.pixels !== undefined) return;
    image.pixels = null;
    const picture = new Image();
    picture.onload = () => {
      const canvas = document.createElement("canvas");
      [canvas.width, canvas.height] = [picture.naturalWidth, picture.naturalHeight];
      const context = canvas.getContext("2d", { willReadFrequently: true });
      context.drawImage(picture, 0, 0);
      const { data } = context.getImageData(0, 0, canvas.width, canvas.height);
      image.pixels = { data, columns: canvas.width, rows: canvas.height };
    };
    picture.src = image.getAttribute("href");
  };

  const cellAt = (own, px, py) => {
    const [x, y] = value(own.group, px, py).map(Math.round);
    const series = own.series.find((one) => one.kind === "cells");
    const index = x * own.y.names.length + y;
    return x >= 0 && y >= 0 && x < own.x.names.length && y < own.y.names.length ? { series, index, x, y } : null;
  };
  const nearestPoint = (own, px, py) => {
    let best = null;
    for (const series of own.series.filter((one) => one.kind === "points")) {
      series.x.forEach((_, index) => {
        const [x, y] = placeOf(own, series, index);
        const far = Math.hypot(x - px, y - py);
        if (best === null || far < best.far) best = { series, index, far, x, y };
      });
    }
    return best;
  };
  const pointLines = (own, best) => {
    const { series: first, index: at } = best;
    const lines = [title(own, onAxis(own.x, first.x[at])), own.y.quantity + " " + onAxis(own.y, first.y[at])];
    // Points of several series may lie in one place.
    for (const series of own.series.filter((one) => one.kind === "points")) {
      series.x.forEach((_, index) => {
        const [x, y] = placeOf(own, series, index);
        if (Math.hypot(x - best.x, y - best.y) > 1) return;
        const third = series.third;
        const value = third ? third.quantity + " " + withUnit(number(series.z[index]), third.unit) : "";
        const text = [value, series.notes[index]].filter(Boolean).join(", ");
        lines.push(text ? named(series, text) : { text: series.name, colour: shown(series) });
      });
    }
    return lines;
  };

  // What is at a place of the picture: lines, marks to draw, and a node or a time that can be played.
  const reading = (own, px, py) => {
    const kinds = new Set(own.series.map((series) => series.kind));
    if (kinds.has("cells")) {
      const cell = cellAt(own, px, py);
      if (cell === null) return null;
      const { series, index, x, y } = cell;
      const third = series.third;
      const lines = [withUnit(own.x.names[x], own.x.unit) + ", " + withUnit(own.y.names[y], own.y.unit),
        third.quantity + " " + valueOf(series, index)];
      if (series.notes[index]) lines.push(series.notes[index]);
      const [left, bottom] = along(own, spot(own.x, x - 0.5), spot(own.y, y - 0.5));
      const [right, top] = along(own, spot(own.x, x + 0.5), spot(own.y, y + 0.5));
      return {
        lines, marks: [["rect", { x: left, y: top, width: right - left, height: bottom - top }]],
        node: [positions(own.x)[x], positions(own.y)[y]],
      };
    }
    if (kinds.has("levels")) {
      const series = own.series.find((one) => one.kind === "levels");
      load(own);
      const level = readLevel(own, series, px, py);
      const [x, y] = level === null ? value(own.group, px, py) : [level.x, level.y];
      const { quantity, unit } = series.third;
      const lines = [title(own, withUnit(number(x), own.x.unit)),
        own.y.quantity + " " + withUnit(number(y), own.y.unit)];
      if (level !== null) lines.push(quantity + " " + level.bound + withUnit(number(level.level), unit));
      return { lines, marks: cross(own, px, py), time: value(own.group, px, py)[0] };
    }
    if (kinds.has("points")) {
      const scale = own.svg.getScreenCTM()?.a ?? 0.5;
      const best = nearestPoint(own, px, py);
      const reach = kinds.has("line") ? REACH_BESIDE_CURVES : REACH;
      if (best !== null && best.far * scale <= reach) {
        return { lines: pointLines(own, best), marks: [["circle", { cx: best.x, cy: best.y, r: 12 }]] };
      }
    }
    // Curves: each at the pointer's x, or the nearest that it has.
    const wanted = value(own.group, px, py)[0];
    let at = null;
    const lines = [], marks = [];
    const curves = own.series.filter(({ kind, x: xs }) => kind === "line" && xs.length > 0);
    for (const series of curves) {
      if (wanted < series.x[0] && at !== null) continue;
      const index = nearestIn(series.x, wanted);
      at = at ?? series.x[index];
      lines.push(ofCurve(own, series, index, curves.length === 1));
      const [x, y] = placeOf(own, series, index);
      if (Number.isFinite(y)) marks.push(["circle", { cx: x, cy: y, r: 8 }]);
    }
    if (lines.length === 0) return null;
    const [x] = along(own, spot(own.x, at), 0);
    marks.push(["line", { x1: x, x2: x, y1: own.frame.top, y2: own.frame.bottom }]);
    if (curves.length > 1) lines.unshift(own.y.quantity);
    return { lines: [title(own, onAxis(own.x, at)), ...lines], marks };
  };
  const cross = ({ frame }, px, py) => [
    ["line", { x1: px, x2: px, y1: frame.top, y2: frame.bottom }],
    ["line", { x1: frame.left, x2: frame.right, y1: py, y2: py }],
  ];

  // The axes that are read by keys.
  let byKey = null;
  let marked = null;
  const mark = (own, marks) => {
    marked?.remove();
    marked = document.createElementNS(SPACE, "g");
    marked.setAttribute("class", "at");
    marked.setAttribute("pointer-events", "none");
    for (const [tag, attributes] of marks) {
      const element = document.createElementNS(SPACE, tag);
      for (const [name, text] of Object.entries(attributes)) element.setAttribute(name, text);
      marked.append(element);
    }
    own.svg.append(marked);
  };
  const hush = () => {
    byKey = null;
    marked?.remove();
    marked = null;
    if (box !== null) box.hidden = true;
  };

  // ---- Where the reader is.
  const toPicture = (own, event) => {
    const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(own.svg.getScreenCTM().inverse());
    return [point.x, point.y];
  };
  const toWindow = (own, px, py) => {
    const point = new DOMPoint(px, py).matrixTransform(own.svg.getScreenCTM());
    return [point.x, point.y];
  };
  const show = (own, px, py, clientX, clientY) => {
    const found = reading(own, px, py);
    if (found === null) {
      hush();
      return null;
    }
    own.last = [px, py];
    mark(own, found.marks);
    say(clientX, clientY, found.lines);
    return found;
  };
  const plots = { onplay: null, onseek: null };
  const act = async (own, found, clientX, clientY) => {
    if (found === null) return;
    let answer = null;
    if (own.play !== undefined && found.node && plots.onplay !== null) {
      answer = await plots.onplay(own.play, ...found.node);
    } else if (found.time !== undefined && plots.onseek !== null) {
      answer = await plots.onseek(own.group, found.time);
    }
    if (answer) say(clientX, clientY, [...found.lines, answer]);
  };

  // ---- Keys: arrows go from value to value, Page keys from panel to panel, Enter plays.
  const step = (own, key) => {
    const { left, top, right, bottom } = own.frame;
    let [px, py] = own.last ?? [(left + right) / 2, (top + bottom) / 2];
    const [across, up] = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[key];
    const kinds = new Set(own.series.map((series) => series.kind));
    const points = own.series.filter((series) => series.kind === "points");
    const first = own.series[0];
    const isCurve = first && first.kind === "line" && first.x.length > 0;
    if (isCurve && across !== 0) {
      // A hundredth of the axis, and at least to the next value.
      const at = nearestIn(first.x, value(own.group, px, py)[0]);
      const jump = Math.max(1, Math.round(first.x.length / 100));
      const next = Math.max(0, Math.min(first.x.length - 1, at + across * jump));
      return [along(own, spot(own.x, first.x[next]), 0)[0], py];
    }
    if (kinds.has("points")) {
      // Points of all series, from left to right, or upwards; several in one place are one.
      const places = points.flatMap((series) => series.x.map((_, index) => placeOf(own, series, index)));
      const all = [...new Map(places.map((place) => [place.join(), place])).values()];
      all.sort(across !== 0 ? (a, b) => a[0] - b[0] || b[1] - a[1] : (a, b) => b[1] - a[1] || a[0] - b[0]);
      const here = all.findIndex(([x, y]) => x === px && y === py);
      const next = here < 0 ? 0 : here + across + up;
      return all[Math.max(0, Math.min(all.length - 1, next))] ?? [px, py];
    }
    const cells = kinds.has("cells") ? [own.x.names.length, own.y.names.length] : [60, 40];
    px += across * (right - left) / cells[0];
    py -= up * (bottom - top) / cells[1];
    const inner = (v, low, high) => Math.max(low + 1, Math.min(high - 1, v));
    return [inner(px, left, right), inner(py, top, bottom)];
  };
  const listen = (own, panels) => {
    const { group } = own;
    group.setAttribute("role", "img");
    const plays = own.play !== undefined ? ", Enter plays" : "";
    group.setAttribute("aria-label", (own.name || own.svg.getAttribute("aria-label")) + ": " + own.y.quantity +
      " over " + own.x.quantity + "; arrow keys read values" + plays);
    group.addEventListener("pointermove", (event) => {
      const [px, py] = toPicture(own, event);
      show(own, px, py, event.clientX, event.clientY);
    });
    group.addEventListener("pointerleave", (event) => { if (event.pointerType === "mouse") hush(); });
    group.addEventListener("click", (event) => {
      const [px, py] = toPicture(own, event);
      act(own, show(own, px, py, event.clientX, event.clientY), event.clientX, event.clientY);
    });
    group.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      const here = own.last ?? step(own, "ArrowRight");
      if (event.key.startsWith("Arrow")) {
        const [px, py] = step(own, event.key);
        show(own, px, py, ...toWindow(own, px, py));
        byKey = own;
      } else if (event.key === "Enter" || event.key === " ") {
        const at = toWindow(own, ...here);
        act(own, show(own, ...here, ...at), ...at);
      } else if (event.key === "PageDown" || event.key === "PageUp") {
        const index = panels.indexOf(own) + (event.key === "PageDown" ? 1 : -1);
        const next = panels[(index + panels.length) % panels.length];
        for (const panel of panels) panel.group.tabIndex = panel === next ? 0 : -1;
        next.group.focus();
      } else if (event.key === "Escape") {
        hush();
      } else {
        return;
      }
      event.preventDefault();
    });
    group.addEventListener("focus", () => {
      if (!group.matches(":focus-visible")) return;
      const here = own.last ?? [(own.frame.left + own.frame.right) / 2, (own.frame.top + own.frame.bottom) / 2];
      show(own, ...here, ...toWindow(own, ...here));
      byKey = own;
    });
    group.addEventListener("blur", hush);
  };
  const attach = (root = document) => {
    for (const svg of root.querySelectorAll("svg.plot")) {
      if (svg.dataset.attached) continue;
      svg.dataset.attached = "yes";
      const panels = [...svg.querySelectorAll("g.axes")].map(axes);
      if (panels.length === 0) continue;
      svg.setAttribute("role", "group");
      panels.forEach((own, index) => {
        // One stop of the tab key for a picture, whatever the number of its panels.
        own.group.tabIndex = index === 0 ? 0 : -1;
        listen(own, panels);
      });
    }
  };
  // A box at a pointer stays behind when the page moves; one that keys have brought goes along.
  const moved = () => {
    if (byKey === null) hush();
    else show(byKey, ...byKey.last, ...toWindow(byKey, ...byKey.last));
  };
  addEventListener("scroll", moved, { passive: true, capture: true });
  attach();
  return Object.assign(plots, { attach, axes, place });
})();
