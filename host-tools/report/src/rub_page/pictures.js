// The live pictures: curves and points over the axes that the program has drawn.

const SVG_NAMESPACE = "http://www.w3.org/2000/svg";

// One pair of axes, by the attributes that every picture of the family carries.
class Axes {
  constructor(svg) {
    this.svg = svg;
    this.group = svg.querySelector("g.axes");
    this.data = stylusPlots.axes(this.group);
    Object.assign(this, this.data.frame);
    this.layer = this.add("g", "over", svg);
    this.layer.setAttribute("pointer-events", "none");
  }

  add(kind, name, parent = this.layer) {
    const element = document.createElementNS(SVG_NAMESPACE, kind);
    element.setAttribute("class", name);
    return parent.appendChild(element);
  }

  placeX(value) {
    return stylusPlots.place(this.group, value, this.data.y.from)[0];
  }

  placeY(value) {
    return stylusPlots.place(this.group, this.data.x.from, value)[1];
  }

  // Tells the values of curves to whoever points at them.
  tell(curves) {
    this.data.series = curves.map((curve) => ({ kind: "line", z: [], third: null, notes: [], levels: null, ...curve }));
  }

  // A path through points; those that are no numbers leave a gap. What is beyond the axes stays at their edge.
  path(xs, ys) {
    const { from, to } = this.data.y;
    const scale = (this.bottom - this.top) / (to - from);
    let text = "";
    let isGap = true;
    for (let n = 0; n < xs.length; n++) {
      const level = ys[n];
      if (level === null || Number.isNaN(level)) {
        isGap = true;
        continue;
      }
      const y = Math.max(this.top, Math.min(this.bottom, this.bottom - (level - from) * scale));
      text += `${isGap ? "M" : "L"}${xs[n].toFixed(1)} ${y.toFixed(1)}`;
      isGap = false;
    }
    return text;
  }
}

// The picture out of a template, in `holder`, after `prepare` has filled its element of the axes.
function pictureOf(holder, name, prepare = () => {}) {
  holder.replaceChildren(document.getElementById(name).content.cloneNode(true));
  prepare(holder.querySelector("g.axes"));
  // Values at the pointer, as on every page of the family.
  stylusPlots.attach(holder);
  return new Axes(holder.querySelector("svg"));
}

// A level's unit, of which nothing is left if the level is not known.
const relative = (unit) => unit.replace(/(re 1 \()?m\/s².*/, "relative");

// Names the unit of the levels in a picture, or none if levels are not known.
function showUnit({ svg, data }, isKnown) {
  const texts = [...svg.querySelectorAll("text")].map((text) => [text, "textContent"]);
  for (const [of, key] of [[data.y, "unit"], ...texts]) {
    of.whole ??= of[key];
    of[key] = isKnown ? of.whole : relative(of.whole);
  }
}

// The last 100 ms.
class Waveform {
  constructor(holder) {
    this.axes = pictureOf(holder, "waveform");
    this.curve = this.axes.add("path", "curve synthesis");
    this.gain = 1;
  }

  look(name) {
    this.colour = colourOf(name);
    this.curve.setAttribute("class", `curve ${name}`);
  }

  draw(samples, rate) {
    const times = Array.from(samples, (_, n) => (1000 * (n + 1 - samples.length)) / rate);
    const values = Array.from(samples, (value) => this.gain * value);
    this.curve.setAttribute("d", this.axes.path(this.placesOf(times), values));
    this.axes.tell([{ name: "", colour: this.colour, x: times, y: Array.from(samples) }]);
  }

  // The same times come again and again.
  placesOf(times) {
    if (this.times?.length !== times.length || this.times[0] !== times[0]) {
      this.times = times;
      this.places = times.map((time) => this.axes.placeX(time));
    }
    return this.places;
  }
}

// What sounds, over the recordings and the models of the nodes around the place of the moment, as means.
class SpectrumPicture {
  constructor(holder, frequencies) {
    this.axes = pictureOf(holder, "spectrum");
    this.places = frequencies.map((frequency) => this.axes.placeX(frequency));
    this.curves = {
      model: this.axes.add("path", "curve model"),
      recorded: this.axes.add("path", "curve recorded"),
      live: this.axes.add("path", "curve synthesis"),
    };
    this.frequencies = frequencies;
    this.levels = { model: null, recorded: null, live: null };
    this.look("synthesis");
  }

  look(name) {
    this.colours = { model: colourOf("model"), recorded: colourOf("recorded"), live: colourOf(name) };
    this.curves.live.setAttribute("class", `curve ${name}`);
  }

  // Draws the curve called `name`: levels in dB, or null for none.
  draw(name, levels) {
    this.curves[name].setAttribute("d", levels ? this.axes.path(this.places, levels) : "");
    this.levels[name] = levels;
    const shown = Object.entries(this.levels).filter(([, values]) => values !== null);
    this.axes.tell(
      shown.map(([kind, values]) => ({
        name: kind === "live" ? "as it sounds" : kind,
        colour: this.colours[kind],
        x: this.frequencies,
        y: values.map((level) => level ?? NaN),
      })),
    );
  }
}

// The colour of a kind of curve, as the stylesheet has it.
function colourOf(look) {
  const name = { synthesis: "--vermilion", recorded: "--blue", other: "--green", model: "--faded" }[look];
  return `var(${name})`;
}

// Letters of a picture are so high and, on average, so wide, in its pixels.
const [LETTER_HIGH, LETTER_WIDE] = [26, 15];

// Colours of a map's values at shares of its scale, as the program has them: in 49 shades, for which the picture's own
// style has those of a dark screen.
function cellColour(share) {
  const stops = [[247, 247, 247], [91, 163, 207], [8, 48, 107]];
  const place = Math.round(48 * Math.max(0, Math.min(1, share))) / 24;
  const below = place >= 1 ? 1 : 0;
  return stops[below].map((from, n) => Math.round(from + (stops[below + 1][n] - from) * (place - below)));
}

// Marks of nodes that are not of a good recording: a path from the upper left corner of the cell, in pixels, and words.
const NODE_MARKS = [
  { flag: FLAGS.interpolated, path: "M0 0H16L0 16Z", hollow: false, words: "a corner is interpolated" },
  { flag: FLAGS.extrapolated, path: "M1 1H15L1 15Z", hollow: true, words: "a hollow corner is extrapolated" },
  { flag: FLAGS.doubtful, path: "M3 0H13V10H3Z", hollow: false, words: "a square is of a doubtful recording" },
];

// The map of a texture's nodes, with the point of the moment and frames around the nodes that are mixed there, four at
// most. Values are written above both.
class MapPicture {
  constructor(holder, texture) {
    this.texture = texture;
    const { speeds_mm_s: speeds, forces_n: forces, nodes } = texture.data;
    this.counts = [speeds.length, forces.length];
    const values = nodes.costs ? nodes.costs.map((cost) => cost && 100 * cost) : nodes.rms_m_s2;
    this.axes = pictureOf(holder, nodes.costs ? "map-cost" : "map-level", (group) => {
      const panel = JSON.parse(group.dataset.panel);
      const [cells] = panel.series;
      [this.end] = cells.z.values;
      Object.assign(panel.x, { names: speeds.map((speed) => short(speed)), values: speeds, to: speeds.length - 0.5 });
      Object.assign(panel.y, { names: forces.map((force) => short(force, 3)), values: forces, to: forces.length - 0.5 });
      cells.x = values.map((_, n) => Math.floor(n / forces.length));
      cells.y = values.map((_, n) => n % forces.length);
      cells.z.values = values;
      if (!texture.data.level_is_known) cells.z.unit = relative(cells.z.unit);
      cells.notes = texture.nodes.map(({ flags }) => Object.keys(FLAGS).filter((name) => flags & FLAGS[name]).join("; "));
      panel.play = texture.name;
      group.dataset.panel = JSON.stringify(panel);
    });
    const { axes } = this;
    axes.svg.setAttribute("aria-label", `${axes.svg.getAttribute("aria-label")} of ${texture.name}`);
    const below = axes.svg.insertBefore(axes.add("g", "cells"), axes.group);
    axes.svg.insertBefore(axes.layer, axes.group);
    this.texts = axes.svg.insertBefore(axes.add("g", "values"), axes.group);
    this.marks = new Set();
    values.forEach((value, node) => this.drawCell(below, node, value));
    this.drawNames();
    this.frames = [0, 1, 2, 3].map(() => axes.add("rect", "node"));
    this.point = ["halo", "point"].map((name) => axes.add("circle", name));
    this.hide();
  }

  // The rectangle of a node.
  cell(node) {
    const { left, right, top, bottom } = this.axes;
    const [columns, rows] = this.counts;
    const [width, height] = [(right - left) / columns, (bottom - top) / rows];
    const [column, row] = [Math.floor(node / rows), node % rows];
    return { x: left + column * width, y: bottom - (row + 1) * height, width: width - 2, height: height - 2 };
  }

  write(text, x, y, fill, anchor = "middle") {
    const element = this.axes.add("text", "", this.texts);
    const attributes = { x, y, fill, dy: "0.35em", "text-anchor": anchor, "font-size": LETTER_HIGH };
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    element.textContent = text;
    return element;
  }

  drawCell(below, node, value) {
    const { axes } = this;
    const cell = this.cell(node);
    const { flags, silent } = this.texture.nodes[node];
    const colour = value === null ? null : cellColour(value / this.end);
    const hex = (part) => part.toString(16).toUpperCase().padStart(2, "0");
    const fill = colour ? `#${colour.map(hex).join("")}` : "#E1E1E1";
    const element = axes.add("rect", "", below);
    place(element, cell);
    element.setAttribute("fill", fill);
    const text = colour ? value.toFixed(1) : silent ? "silent" : "–";
    if (LETTER_WIDE * text.length < cell.width && LETTER_HIGH < cell.height) {
      const isDark = colour && 0.299 * colour[0] + 0.587 * colour[1] + 0.114 * colour[2] < 140;
      const ink = colour ? (isDark ? "#FFFFFF" : "#292929") : "#282828";
      const written = this.write(text, cell.x + cell.width / 2, cell.y + cell.height / 2, ink);
      // Over the frames and the point a value keeps the ground of its cell.
      written.setAttribute("stroke", fill);
    }
    for (const { flag, path, hollow, words } of NODE_MARKS) {
      if ((flags & flag) === 0) continue;
      const mark = axes.add("path", hollow ? "mark hollow" : "mark", below);
      mark.setAttribute("d", path);
      mark.setAttribute("transform", `translate(${cell.x.toFixed(1)} ${cell.y.toFixed(1)})`);
      this.marks.add(words);
    }
  }

  // Names along both axes, every so many, so that none touches the next.
  drawNames() {
    const { left, bottom } = this.axes;
    const { x, y } = this.axes.data;
    const { width, height } = this.cell(0);
    const widest = LETTER_WIDE * Math.max(...x.names.map((name) => name.length)) + 14;
    const every = (needed, size) => Math.ceil(needed / (size + 2));
    x.names.forEach((name, n) => {
      if (n % every(widest, width) === 0) this.write(name, left + (n + 0.5) * (width + 2), bottom + 24, "#282828");
    });
    y.names.forEach((name, n) => {
      if (n % every(LETTER_HIGH + 4, height) !== 0) return;
      this.write(name, left - 14, bottom - (n + 0.5) * (height + 2), "#282828", "end");
    });
  }

  hide() {
    this.axes.layer.setAttribute("visibility", "hidden");
  }

  draw(voice) {
    const { axes } = this;
    axes.layer.setAttribute("visibility", "visible");
    const [cx, cy] = [axes.placeX(Math.abs(voice.speed)), axes.placeY(voice.force)];
    this.point.forEach((circle) => place(circle, { cx, cy, r: 15 }));
    const nodes = distinctNodes(voice);
    this.frames.forEach((frame, number) => {
      const [index, weight] = nodes[number] ?? [0, 0];
      place(frame, this.cell(index));
      frame.setAttribute("stroke-width", weight > 0 ? 3 + 7 * Math.sqrt(weight) : 0);
    });
  }
}

function place(element, attributes) {
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value.toFixed(1));
}
