// The audio worklet: takes the hand's motion from the page, lets a voice play it, and gives samples at the context's
// rate. Nothing is allocated while it plays but the reports to the page, 30 per second.

// Time over which a new motion is taken over, so that a pointer that reports 60 times per second makes no steps.
const RAMP_S = 0.008;

// Age of a motion from which on the hand is taken for lifted, as the stylus mutes when it hears no motion any more.
const STALE_S = 0.25;

// Crossfade from voice to voice.
const FADE_S = 0.012;

const REPORTS_PER_S = 30;

// Time that the audio clock may be behind the computer's before it counts as a gap: more than bursts of callbacks.
const GAP_MS = 60;

// The value from which to go on to `wanted`: that itself from nearby, so that a hand that stops is at rest.
function arrived(value, wanted) {
  return Math.abs(value - wanted) < 0.01 ? wanted : value;
}

// The hand as the page tells it, at the moment of `frame`.
class WorkletHand {
  constructor() {
    this.frame = 0;
    this.from = { speed: 0, along: 0, force: 0 };
    this.to = { speed: 0, along: 0, force: 0 };
    this.since = 0;
    this.touches = false;
    this.path = 0;
    this.stamp = null;
    this.delays = [];
  }

  // Takes over `told`: speed, mm/s; along, its part from left to right, mm/s; force, N; path, mm; contact; stamp, ms,
  // when the pointer moved, or null.
  tell(told, frame) {
    this.frame = Math.max(this.frame, frame);
    this.from.speed = arrived(this.speed(), told.speed);
    this.from.along = arrived(this.along(), told.along);
    // In the air there is no force to begin from.
    this.from.force = this.touches ? this.force() : told.force;
    this.to.speed = told.speed;
    this.to.along = told.along;
    this.to.force = told.force;
    this.touches = told.contact;
    this.path = told.path;
    this.since = frame;
    if (told.stamp !== null) this.stamp = told.stamp;
  }

  share() {
    return Math.min(1, (this.frame - this.since) / (RAMP_S * sampleRate));
  }

  now(name) {
    return this.from[name] + (this.to[name] - this.from[name]) * this.share();
  }

  speed() {
    return this.now("speed");
  }

  along() {
    return this.now("along");
  }

  force() {
    return this.now("force");
  }

  // Asked once per block: from here on the motion is in what sounds.
  contact() {
    if (this.stamp !== null) {
      if (this.delays.length < 64) this.delays.push(Date.now() - this.stamp);
      this.stamp = null;
    }
    return this.touches && this.frame - this.since < STALE_S * sampleRate;
  }
}

class RubbingProcessor extends AudioWorkletProcessor {
  constructor({ processorOptions }) {
    super();
    this.hand = new WorkletHand();
    this.gain = 0;
    this.targetGain = 0;
    this.active = null;
    this.fading = null;
    this.fade = 1;
    this.clips = [];
    this.filters = new Map();
    this.report = { samples: new Float32Array(4096), count: 0, due: 0, peak: 0, clipped: 0 };
    this.frames = 0;
    this.gaps = 0;
    this.lead = null;
    this.heard = false;
    this.fault = null;
    this.port.onmessage = ({ data }) => this.guarded(() => this.obey(data));
    this.guarded(() => {
      this.module = new WebAssembly.Module(processorOptions.kernel);
      const library = new Uint8Array(processorOptions.library);
      // One plays while the other fades.
      this.kernels = [new Kernel(this.module, library), new Kernel(this.module, library)];
      this.take = new Take();
      this.resamplerFor(5000);
      this.port.postMessage({ type: "ready" });
    });
  }

  // Does `action`; if it fails, the page is told and there is silence from then on.
  guarded(action) {
    try {
      action();
    } catch (fault) {
      this.fault = fault;
      this.active = null;
      this.fading = null;
      this.port.postMessage({ type: "fault", text: String(fault.message ?? fault) });
    }
  }

  obey(message) {
    if (this.fault) return;
    if (message.type === "hand") this.hand.tell(message, currentFrame);
    else if (message.type === "gain") this.targetGain = message.gain;
    else if (message.type === "clips") this.clips[message.texture] = message;
    else if (message.type === "choose") this.choose(message);
    else if (message.type === "take") this.giveTake();
  }

  choose({ choice, take }) {
    this.giveTake();
    const voice = this.voiceFor(choice);
    voice.begin(choice, this.hand, take ? this.take : null);
    const { rate } = voice;
    if (this.active) {
      this.fading = this.active;
      this.fade = 0;
    }
    const resampler = this.resamplerFor(rate);
    this.active = { voice, resampler, source: new Tap(this, voice) };
    this.report.count = 0;
    this.port.postMessage({ type: "chosen", rate, filterMs: 1000 * resampler.filter.delay, choice });
  }

  // A resampler from `rate`. Its filter is made once.
  resamplerFor(rate) {
    if (!this.filters.has(rate)) this.filters.set(rate, Kernel.filter(this.module, rate, sampleRate));
    return new Resampler(this.filters.get(rate));
  }

  voiceFor(choice) {
    if (choice.recording) {
      const { clips, rate } = this.clips[choice.texture];
      return new ClipVoice(clips, rate);
    }
    const busy = this.active?.voice.kernel;
    const kernel = this.kernels[0] === busy ? this.kernels[1] : this.kernels[0];
    // If it is still fading, it goes on as the new voice.
    if (this.fading?.voice.kernel === kernel) this.fading = null;
    return new KernelVoice(kernel);
  }

  // Gives the page what was kept of a take, if anything was, and ends the take.
  giveTake() {
    const { take } = this;
    if (take.blocks === 0) return;
    if (this.active.voice.take) this.active.voice.take = null;
    this.port.postMessage({
      type: "taken",
      choice: take.choice,
      rate: take.rate,
      start: take.start,
      motion: take.motion.slice(0, 4 * take.blocks),
      words: take.words.slice(0, take.count),
    });
    take.blocks = 0;
  }

  process(_inputs, [[output]]) {
    if (this.active) this.guarded(() => this.fill(output));
    this.frames += output.length;
    this.watchClock(output.length);
    this.tellPage(output.length);
    return true;
  }

  fill(output) {
    const { hand, report } = this;
    const gainStep = 1 / (0.01 * sampleRate);
    for (let n = 0; n < output.length; n++) {
      hand.frame = currentFrame + n;
      let sample = this.active.resampler.next(this.active.source);
      if (this.fading) {
        this.fade += 1 / (FADE_S * sampleRate);
        if (this.fade >= 1) {
          this.fading = null;
        } else {
          const angle = (Math.PI / 2) * this.fade;
          sample = Math.sin(angle) * sample + Math.cos(angle) * this.fading.resampler.next(this.fading.voice);
        }
      }
      // A change of volume is smoothed with a time constant of 10 ms.
      this.gain += (this.targetGain - this.gain) * gainStep;
      sample *= this.gain;
      const magnitude = Math.abs(sample);
      if (magnitude > report.peak) report.peak = magnitude;
      if (magnitude > 1) report.clipped += 1;
      output[n] = Math.max(-1, Math.min(1, sample));
    }
    if (!this.heard && report.peak > 0) {
      this.heard = true;
      this.port.postMessage({ type: "heard", at: Date.now() });
    }
  }

  // Counts moments in which the audio clock lost time against the computer's.
  watchClock(length) {
    const lead = Date.now() - (1000 * (currentFrame + length)) / sampleRate;
    if (this.lead === null || lead < this.lead) {
      this.lead = lead;
    } else if (lead - this.lead > GAP_MS) {
      this.gaps += 1;
      this.lead = lead;
    } else {
      // The clocks' rates differ by some 10⁻⁵.
      this.lead += (0.1 * length) / sampleRate;
    }
  }

  tellPage(length) {
    const { report } = this;
    report.due += length * REPORTS_PER_S;
    if (report.due < sampleRate) return;
    report.due %= sampleRate;
    const voice = this.active?.voice;
    this.port.postMessage({
      type: "played",
      samples: report.samples.slice(0, report.count),
      state: voice?.kernel ? voice.kernel.state.slice() : null,
      clip: voice?.current ? voice.current.clip.node : null,
      speed: this.hand.speed(),
      force: this.hand.force(),
      contact: this.hand.touches,
      delays: this.hand.delays.splice(0),
      clipped: report.clipped,
      gaps: this.gaps,
      frames: this.frames,
      takeBlocks: voice?.take ? this.take.blocks : 0,
    });
    report.count = 0;
    report.peak = 0;
    report.clipped = 0;
  }
}

// A voice's samples on their way, kept for the page's pictures.
class Tap {
  constructor(processor, voice) {
    this.processor = processor;
    this.voice = voice;
  }

  next() {
    const { report } = this.processor;
    const sample = this.voice.next();
    if (report.count < report.samples.length) report.samples[report.count++] = sample;
    return sample;
  }
}

registerProcessor("rubbing", RubbingProcessor);
