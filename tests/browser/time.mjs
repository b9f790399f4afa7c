// Time that a page has only when its test gives it some, so that what a page does at which moment does not depend on the
// computer. An init script of a page, for all of its frames.

// Takes the place of the browser's clocks, timers and frames, and of the sound card: sound is rendered by an
// OfflineAudioContext, with the page's worklet in the browser's own sound thread, up to the moment that the page has
// reached. `stylusTime.advance(ms)` lets time pass, and `stylusTime.rub` a pointer too.
export function virtualTime() {
  const SAMPLE_RATE = 48_000;
  const QUANTUM = 128;
  const LONGEST_S = 120;
  const FRAMES_PER_S = 60;

  let now = 0;
  const date = () => performance.timeOrigin + now;
  performance.now = () => now;
  Date.now = date;
  Object.defineProperty(Event.prototype, "timeStamp", { get: () => now });

  // ---- Timers.
  let last = 0;
  const timers = new Map();
  const begun = (action, due, every = null) => {
    timers.set(++last, { id: last, action, due, every });
    return last;
  };
  const ended = (id) => timers.delete(id);
  const after = (ms) => now + Math.max(1, Number(ms) || 0);
  globalThis.setTimeout = (action, ms, ...list) => begun(() => action(...list), after(ms));
  globalThis.setInterval = (action, ms, ...list) => begun(() => action(...list), after(ms), Math.max(1, ms));
  globalThis.requestAnimationFrame = (action) =>
    begun(() => action(now), (1000 * (Math.floor((now * FRAMES_PER_S) / 1000 + 1e-6) + 1)) / FRAMES_PER_S);
  globalThis.clearTimeout = globalThis.clearInterval = globalThis.cancelAnimationFrame = ended;

  // ---- Sound.
  const contexts = [];
  const { postMessage } = MessagePort.prototype;
  globalThis.AudioContext = class extends OfflineAudioContext {
    constructor() {
      super(1, LONGEST_S * SAMPLE_RATE, SAMPLE_RATE);
      this.ports = [];
      this.rendered = 0;
      // Whether the page has told a worklet something that this may not have heard.
      this.isTold = false;
      // The moment at which it was begun, which a browser lets a touch do alone.
      this.since = null;
      contexts.push(this);
    }

    get state() {
      return this.since === null ? "suspended" : "running";
    }

    resume() {
      this.since ??= now;
      return Promise.resolve();
    }

    // Renders up to `time` and to the end of a block, between what the page has told the worklets and what they tell it.
    async render(time) {
      if (this.since === null) return;
      const frame = Math.ceil(((time - this.since) * SAMPLE_RATE) / 1000 / QUANTUM - 1e-6) * QUANTUM;
      if (frame <= this.rendered) return;
      if (this.isTold) await this.heard();
      if (this.rendered === 0) {
        const begun = super.suspend(0);
        super.startRendering();
        await begun;
      }
      const there = super.suspend(frame / SAMPLE_RATE);
      super.resume();
      await there;
      this.rendered = frame;
      await this.heard();
    }

    // Resolves when the worklets have heard all that they were told, and the page what they have told. The moment that
    // the sound has reached comes with it.
    heard() {
      const at = this.since + (1000 * this.rendered) / SAMPLE_RATE;
      this.isTold = false;
      const answered = (port) => new Promise((resolve) => {
        port.answered = resolve;
        postMessage.call(port, { type: "virtual time", date: performance.timeOrigin + at });
      });
      return Promise.all(this.ports.map(answered));
    }
  };

  // A page that came by plain http has none.
  if (globalThis.AudioWorklet) {
    globalThis.AudioWorkletNode = class extends AudioWorkletNode {
      constructor(context, ...list) {
        super(context, ...list);
        const { port } = this;
        // Before the page's own listener, which is to hear nothing of this.
        port.addEventListener("message", (event) => {
          if (event.data.type !== "virtual time") return;
          event.stopImmediatePropagation();
          port.answered();
        });
        port.postMessage = (...list) => {
          context.isTold = true;
          postMessage.apply(port, list);
        };
        context.ports.push(port);
      }
    };

    // In the worklet: its computer's clock goes with the sound.
    const prelude = `
      const virtual = { date: 0, frame: 0 };
      const Date = { now: () => virtual.date + (1000 * (currentFrame - virtual.frame)) / sampleRate };
      const registerProcessor = (name, kind) => globalThis.registerProcessor(name, class extends kind {
        constructor(options) {
          super(options);
          const hear = this.port.onmessage;
          this.port.onmessage = (event) => {
            if (event.data.type !== "virtual time") return hear(event);
            [virtual.date, virtual.frame] = [event.data.date, currentFrame];
            this.port.postMessage(event.data);
          };
        }
      });`;
    const { addModule } = AudioWorklet.prototype;
    AudioWorklet.prototype.addModule = function added(url) {
      // The page's policy lets nothing be fetched, and the text is in its address.
      const [head, text] = url.split(";base64,");
      return addModule.call(this, `${head};base64,${btoa(prelude + atob(text))}`);
    };
  }

  // ---- What a test does.
  const sounded = (time) => Promise.all(contexts.map((context) => context.render(time)));
  const advance = async (ms) => {
    const end = now + ms;
    for (;;) {
      const next = [...timers.values()].filter(({ due }) => due <= end).sort((a, b) => a.due - b.due || a.id - b.id)[0];
      const time = next?.due ?? end;
      await sounded(time);
      now = Math.max(now, time);
      if (!next) break;
      // What has ended it in the meantime counts.
      if (!timers.has(next.id)) continue;
      if (next.every === null) ended(next.id);
      else next.due += next.every;
      next.action();
    }
    await Promise.all(contexts.filter(({ isTold }) => isTold).map((context) => context.heard()));
  };

  // A mouse that is pressed on the patch and goes back and forth over `reach` to either side of its middle, with a move
  // every 7 ms, which is no multiple of a block of sound. Returns what `probe` found after each.
  const rub = async (seconds, { reach = 0.3, lifts = true, probe = () => null } = {}) => {
    const patch = document.getElementById("patch");
    const { left, top, width, height } = patch.getBoundingClientRect();
    const begin = now;
    const tell = (type) => {
      const time = (now - begin) / 1000;
      const clientX = left + width * (0.5 - reach * Math.cos(3 * time));
      const clientY = top + height * (0.5 + 0.1 * Math.sin(2 * time));
      const what = { clientX, clientY, pointerId: 1, pointerType: "mouse", pressure: 0.5, buttons: 1, bubbles: true };
      patch.dispatchEvent(new PointerEvent(type, what));
    };
    tell("pointerdown");
    const found = [];
    while (now < begin + 1000 * seconds) {
      await advance(7);
      tell(MOVES);
      found.push(probe());
    }
    if (lifts) tell("pointerup");
    return found;
  };

  globalThis.stylusTime = { advance, rub };
}
