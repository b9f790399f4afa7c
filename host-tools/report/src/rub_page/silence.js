// Where the browser starts no sound, the page plays to itself, so that it draws from the hand all the same.

// Time after a touch within which the sound has to run, ms.
const SOUND_DUE_MS = 700;

// Time between two pieces of what the page plays to itself, ms.
const PIECE_MS = 30;

class Silence {
  constructor(page) {
    this.page = page;
    // The moment at which the sound's thread last told of itself.
    this.heardAt = -Infinity;
    const told = (name) => () => page.hand[name];
    this.hand = { speed: told("speed"), along: told("along"), force: told("force"), contact: told("contact") };
    Object.defineProperty(this.hand, "path", { get: told("path") });
  }

  // Begins when no sound has run for a while after a touch.
  watch() {
    this.due ??= setTimeout(() => {
      this.due = null;
      if (performance.now() - this.heardAt > SOUND_DUE_MS && !this.timer) this.begin();
    }, SOUND_DUE_MS);
  }

  begin() {
    // A reason that is known is the reason.
    if (byId("trouble").hidden) {
      this.page.fail(
        "the browser has not started it. There may be no output device, or a setting forbids it. The pictures " +
          "follow your hand all the same.",
      );
    }
    this.before = performance.now();
    this.timer = setInterval(() => this.piece(), PIECE_MS);
  }

  // The sound runs after all.
  end() {
    this.heardAt = performance.now();
    if (!this.timer) return;
    clearInterval(this.timer);
    this.timer = null;
    this.voice = null;
    byId("trouble").hidden = true;
  }

  // Takes over the page's choice, with the next piece.
  choose() {
    this.voice = null;
  }

  voiceOf(choice) {
    const { newKernel, texture } = this.page;
    const clips = choice.recording ? texture.sounds() : null;
    if (!clips) this.kernel ??= newKernel();
    const voice = clips ? new ClipVoice(clips, clips[0].rate) : new KernelVoice(this.kernel);
    voice.begin(choice, this.hand, null);
    this.page.takeOver({ rate: voice.rate });
    return voice;
  }

  piece() {
    const { page } = this;
    if (!page.newKernel) return;
    this.voice ??= this.voiceOf(page.choice());
    const { voice } = this;
    const now = performance.now();
    const count = Math.round((voice.rate * Math.min(100, now - this.before)) / 1000);
    this.before = now;
    const { speed, force, contact } = page.hand;
    page.takeIn({
      samples: Float32Array.from({ length: count }, () => voice.next()),
      state: voice.kernel ? voice.kernel.state.slice() : null,
      clip: voice.current ? voice.current.clip.node : null,
      speed, force, contact,
      delays: [], clipped: 0, gaps: 0, frames: 0, takeBlocks: 0,
    });
  }
}
