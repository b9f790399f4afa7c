// The worklet of a page outside of a browser: its text and the page's kernel and library in a Node context, so that
// sound can be computed sample by sample, without a clock.

import fs from "node:fs";
import vm from "node:vm";

// The text of a page's element.
function elementOf(page, id) {
  const begin = page.indexOf(`id="${id}"`);
  const from = page.indexOf(">", begin) + 1;
  return page.slice(from, page.indexOf("</script>", from));
}

// A page's worklet text, data, kernel and library.
export function partsOf(file) {
  const page = fs.readFileSync(file, "utf8");
  const bytes = (id) => new Uint8Array(Buffer.from(elementOf(page, id), "base64"));
  return {
    page,
    worklet: elementOf(page, "worklet"),
    data: JSON.parse(elementOf(page, "data")),
    kernel: bytes("kernel"),
    library: bytes("library"),
  };
}

// Names that a page's scripts declare, out of the text of the worklet.
export function declared(text, names) {
  const context = vm.createContext({
    WebAssembly,
    AudioWorkletProcessor: class {},
    registerProcessor() {},
    sampleRate: 48_000,
    currentFrame: 0,
    Date,
  });
  vm.runInContext(text, context);
  return vm.runInContext(`({ ${names.join(", ")} })`, context);
}

// A worklet that runs as fast as the computer can.
export class OfflineWorklet {
  constructor(parts, sampleRate) {
    this.messages = [];
    this.clock = 1_000_000;
    const outside = this;
    const context = vm.createContext({
      WebAssembly,
      sampleRate,
      currentFrame: 0,
      // The computer's clock, which goes with the audio's unless a test holds that back.
      Date: { now: () => outside.clock },
      AudioWorkletProcessor: class {
        constructor() {
          this.port = { postMessage: (message) => outside.messages.push(message) };
        }
      },
      registerProcessor: (_name, kind) => {
        this.kind = kind;
      },
    });
    vm.runInContext(parts.worklet, context);
    this.context = context;
    const { kernel, library } = parts;
    this.processor = new this.kind({ processorOptions: { kernel, library } });
    this.output = [];
  }

  tell(message) {
    this.processor.port.onmessage({ data: message });
  }

  hand(hand) {
    this.tell({ type: "hand", path: 0, along: hand.speed, stamp: null, contact: true, ...hand });
  }

  // Computes `seconds`, and tells the hand again every 4 ms as the page does, unless it is silent.
  run(seconds, hand = null) {
    const { context } = this;
    const end = context.currentFrame + seconds * context.sampleRate;
    const begin = this.output.length;
    let told = 0;
    while (context.currentFrame < end) {
      if (hand && context.currentFrame >= told) {
        this.hand(typeof hand === "function" ? hand(context.currentFrame / context.sampleRate) : hand);
        told = context.currentFrame + 0.004 * context.sampleRate;
      }
      const block = new Float32Array(128);
      this.processor.process([], [[block]]);
      this.output.push(...block);
      context.currentFrame += 128;
      this.clock += (128_000 / context.sampleRate);
    }
    return this.output.slice(begin);
  }

  // The messages of a kind, and forgets them.
  taken(type) {
    const found = this.messages.filter((message) => message.type === type);
    this.messages = this.messages.filter((message) => message.type !== type);
    return found;
  }
}
