// What the page holds besides its text: the kernel, the library, and what the library does not say.

function bytesOf(text) {
  const binary = atob(text.trim());
  const bytes = new Uint8Array(binary.length);
  for (let n = 0; n < binary.length; n++) bytes[n] = binary.charCodeAt(n);
  return bytes;
}

function bytesOfElement(id) {
  return bytesOf(document.getElementById(id).textContent);
}

function base64Of(bytes) {
  let binary = "";
  for (const byte of bytes) binary += String.fromCharCode(byte);
  return btoa(binary);
}

// Levels in dB of a list of bytes, half decibels below `top`; null is no level.
function levelsOf(base64, top) {
  return base64 ? Array.from(bytesOf(base64), (code) => (code === 255 ? null : top - code / 2)) : null;
}

// A number with four digits, or as many, and no idle ones.
function short(value, digits = 4) {
  return String(Number(value.toPrecision(digits)));
}

// Bits of a node's flags.
const FLAGS = { silent: 1, interpolated: 2, extrapolated: 4, doubtful: 8 };

// Samples of a clip, m/s²: codes are companded, so that quiet parts keep their shape.
function clipSamples({ peak_m_s2: peak, codes_base64: codes }) {
  const shares = Float32Array.from({ length: 128 }, (_, code) => (256 ** (code / 127) - 1) / 255);
  const bytes = new Int8Array(bytesOf(codes).buffer);
  return Float32Array.from(bytes, (code) => (code < 0 ? -peak : peak) * shares[Math.abs(code)]);
}

// A texture of the page with its spectra and clips.
class PageTexture {
  constructor(data, index) {
    this.data = data.textures[index];
    this.index = index;
    this.name = this.data.name;
    const { orders, rms_m_s2: levels, flags, costs } = this.data.nodes;
    const { speeds_mm_s: speeds, forces_n: forces } = this.data;
    this.nodes = orders.map((order, node) => ({
      speed_mm_s: speeds[Math.floor(node / forces.length)],
      force_n: forces[node % forces.length],
      order,
      rms_m_s2: levels[node],
      flags: flags[node],
      silent: (flags[node] & FLAGS.silent) !== 0,
      cost: costs?.[node] ?? null,
    }));
    this.count = data.frequencies_hz.length;
    this.clips = data.clips.filter((clip) => clip.texture === index);
    this.known = {};
  }

  // Levels of all nodes, decoded when they are first asked for.
  all(kind) {
    this.known[kind] ??= { levels: levelsOf(this.data[`${kind}_base64`], this.data.top_db) };
    return this.known[kind].levels;
  }

  // Clips as the worklet plays them.
  sounds() {
    return this.clips.map((clip) => {
      const { speed_mm_s: speed, force_n: force } = this.nodes[clip.node];
      return { speed, force, node: clip.node, rate: clip.sample_rate_hz, samples: clipSamples(clip) };
    });
  }

  // Levels of a node's model or recording, or null where there are none.
  levels(kind, node) {
    const levels = this.all(kind)?.slice(node * this.count, (node + 1) * this.count);
    return levels?.some((level) => level !== null) ? levels : null;
  }

  // Densities of model or recording, (m/s²)²/Hz, over nodes with weights: their mean by the law of the texture's
  // level, of those that have any; null if these have less than half of the weight.
  density(kind, nodes) {
    const known = nodes.filter(([node]) => this.levels(kind, node) !== null);
    const whole = known.reduce((sum, [, weight]) => sum + weight, 0);
    if (whole < 0.5) return null;
    const levels = this.all(kind);
    const laws = {
      "mean power": [(level) => 10 ** (level / 10), (mean) => mean],
      "mean amplitude": [(level) => 10 ** (level / 20), (mean) => mean ** 2],
      "mean dB": [(level) => level, (mean) => 10 ** (mean / 10)],
    };
    const [into, back] = laws[this.data.level_law];
    return Array.from({ length: this.count }, (_, band) => {
      const at = (node) => into(levels[node * this.count + band] ?? -200);
      return back(known.reduce((sum, [node, weight]) => sum + weight * at(node), 0) / whole);
    });
  }

  // What excites the models, in words.
  excitation() {
    const { codebooks, lines } = this.data.can_leave_out;
    const source = codebooks ? "recorded snippets" : "Gaussian noise";
    return lines.length > 0 ? `${source}, ${lines.length} lines` : source;
  }

  // Kinds of sound that can be compared: choices without texture, scene and seed.
  kinds() {
    const can = this.data.can_leave_out;
    const kinds = [{ id: "synthesis", name: "Synthesis", look: "synthesis", without: 0 }];
    if (this.clips.length > 0) kinds.push({ id: "recording", name: "Recording", look: "recorded", recording: true });
    if (can.codebooks) {
      kinds.push({ id: "gaussian", name: "Gaussian noise", look: "other", without: WITHOUT.codebooks });
    }
    if (can.lines.length > 0) {
      kinds.push({ id: "no-lines", name: "Without lines", look: "other", without: WITHOUT.lines });
    }
    return kinds;
  }
}

// Words on a speed, mm/s, and a force, N, above the highest of the grid: a texture is played there as at its edge, but
// for lines, which are tied to position.
function beyondGrid(nodes, speed, force, hasLines) {
  const highest = (key) => nodes.at(-1)[key];
  const words = [];
  if (speed > 1.02 * highest("speed_mm_s")) words.push(`${short(highest("speed_mm_s"))} mm/s`);
  if (force > 1.02 * highest("force_n")) words.push(`${short(highest("force_n"))} N`);
  if (words.length === 0) return "";
  const tone = hasLines ? ", but a tone follows the speed" : "";
  return `Off the grid, which ends at ${words.join(" and ")}: as there${tone}.`;
}

// Nodes of a voice, each once, with the sum of its weights. On a grid of one speed or force, and beyond the grid's edge,
// some of the four corners are one node.
function distinctNodes({ nodes, weights }) {
  const sums = new Map();
  nodes.forEach((node, corner) => sums.set(node, (sums.get(node) ?? 0) + weights[corner]));
  return [...sums];
}
