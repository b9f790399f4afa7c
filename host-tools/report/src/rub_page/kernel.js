// The stylus's kernel as a WebAssembly module, by name instead of by address. The same text runs on the page and in its
// audio worklet, which has no TextDecoder.

// Time between two updates of the hand.
const BLOCK_S = 0.002;

// Places in the state: the number of voices, and the first number of the first voice; see the module's README.
const STATE = { voices: 3, first: 4, perVoice: 14 };

// What is left out of a texture, as a sum.
const WITHOUT = { codebooks: 1, track: 2, lines: 4 };

class Kernel {
  // An instance of `module`, a WebAssembly.Module, that has decoded `library`, a Uint8Array. Throws the module's words.
  constructor(module, library) {
    this.exports = new WebAssembly.Instance(module).exports;
    const at = this.exports.reserve(library.length);
    if (at === 0) throw new Error(this.text());
    new Uint8Array(this.exports.memory.buffer, at, library.length).set(library);
    this.check(this.exports.load());
    const { exports } = this;
    const buffer = exports.memory.buffer;
    const most = exports.most_blocks();
    this.motion = new Float64Array(buffer, exports.motion(), 5 * most);
    // The longest block is that of 10 kHz.
    this.samples = new Float32Array(buffer, exports.samples(), 20 * most);
    this.words = new Int32Array(buffer, exports.words(), 20 * most);
    this.state = new Float64Array(buffer, exports.state(), 32);
  }

  // The filter of a resampler between two rates, Hz. It is made in an instance of its own, because what it allocates
  // would move another's memory.
  static filter(module, from, to) {
    const { exports } = new WebAssembly.Instance(module);
    const at = exports.filter(from, to);
    const [taps, phases] = [exports.filter_taps(), exports.filter_phases()];
    const rows = new Float32Array(exports.memory.buffer, at, taps * phases).slice();
    return { rows, taps, phases, step: exports.filter_step(), delay: exports.filter_delay_s(from, to) };
  }

  text() {
    const { exports } = this;
    const bytes = new Uint8Array(exports.memory.buffer, exports.text(), exports.text_length());
    let coded = "";
    for (const byte of bytes) coded += "%" + byte.toString(16).padStart(2, "0");
    try {
      return decodeURIComponent(coded);
    } catch {
      return "the kernel's message is no UTF-8 text";
    }
  }

  check(status) {
    if (status !== 0) throw new Error(this.text());
  }

  // Calls `action`; a trap becomes an error with the module's own words.
  guarded(action) {
    try {
      return action();
    } catch (fault) {
      if (fault instanceof WebAssembly.RuntimeError) throw new Error(`the kernel stopped: ${this.text()}`);
      throw fault;
    }
  }

  // Plays `choice` ({ scene: index } or { texture: index }, without, seed) from its beginning.
  choose({ texture, scene, without = 0, seed = 1 }) {
    const low = seed >>> 0;
    const high = Math.floor(seed / 4294967296) >>> 0;
    const { exports } = this;
    this.guarded(() => {
      if (scene === undefined) this.check(exports.choose_texture(texture, without, low, high));
      else this.check(exports.choose_scene(scene, without, low, high));
    });
    this.rate = exports.sample_rate_hz();
    this.blockSamples = exports.block_samples();
  }

  // Plays the first `blocks` blocks of `motion`.
  run(blocks) {
    this.guarded(() => this.check(this.exports.run(blocks)));
  }

  // The voices after the last block, as objects: for pictures, because it allocates.
  static voices(state) {
    const voices = [];
    for (let index = 0; index < state[STATE.voices]; index++) {
      const at = STATE.first + STATE.perVoice * index;
      voices.push({
        surface: state[at],
        texture: state[at + 1],
        fade: state[at + 3],
        nodes: Array.from(state.slice(at + 4, at + 8)),
        weights: Array.from(state.slice(at + 8, at + 12)),
        speed: state[at + 12],
        force: state[at + 13],
      });
    }
    return voices;
  }
}
