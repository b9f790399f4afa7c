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

// The picture out of a template, in `holder`.
function pictureOf(holder, name) {
  holder.replaceChildren(document.getElementById(name).content.cloneNode(true));
  // Values at the pointer, as on every page of the family.
  stylusPlots.attach(holder);
  return new Axes(holder.querySelector("svg"));
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

// What sounds, over the recording and the model of the nearest node.
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

// A map with the point of the moment and the nodes that are mixed there, four at most.
class MapPicture {
  constructor(holder, name, texture) {
    this.texture = texture;
    this.axes = pictureOf(holder, name);
    this.ties = [0, 1, 2, 3].map(() => this.axes.add("line", "tie"));
    this.rings = [0, 1, 2, 3].map(() => this.axes.add("circle", "node"));
    this.point = this.axes.add("circle", "point");
    this.hide();
  }

  hide() {
    this.axes.layer.setAttribute("visibility", "hidden");
  }

  draw(voice) {
    const { axes } = this;
    axes.layer.setAttribute("visibility", "visible");
    const x = axes.placeX(Math.abs(voice.speed));
    const y = axes.placeY(voice.force);
    place(this.point, { cx: x, cy: y, r: 11 });
    const nodes = distinctNodes(voice);
    this.rings.forEach((ring, number) => {
      const [index, weight] = nodes[number] ?? [0, 0];
      const node = this.texture.nodes[index];
      const [nodeX, nodeY] = [axes.placeX(node.speed_mm_s), axes.placeY(node.force_n)];
      place(ring, { cx: nodeX, cy: nodeY, r: weight > 0 ? 5 + 13 * Math.sqrt(weight) : 0 });
      place(this.ties[number], { x1: x, y1: y, x2: nodeX, y2: nodeY });
      this.ties[number].setAttribute("opacity", Math.sqrt(Math.max(0, weight)));
    });
  }
}

function place(element, attributes) {
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value.toFixed(1));
}
