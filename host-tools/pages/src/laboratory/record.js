// Takes by a microphone, or a contact microphone at the tool, without what browsers do to voices.

const RAW = { echoCancellation: false, noiseSuppression: false, autoGainControl: false, channelCount: 1 };

// Magnitude from which a sample counts as clipped, and below which a take counts as silent.
const CLIPPED = 0.999;
const SILENT = 1e-3;

class Take {
  // Begins a take. `onBlock` is told { seconds, peak, clipped } after each tenth of a second.
  async begin(onBlock) {
    if (!navigator.mediaDevices) {
      throw new Error("this browser gives a page from here no microphone: record with another program");
    }
    this.stream = await navigator.mediaDevices.getUserMedia({ audio: RAW });
    const [track] = this.stream.getAudioTracks();
    const settings = track.getSettings();
    // At the device's own rate, so that nothing is resampled.
    this.context = new AudioContext(settings.sampleRate ? { sampleRate: settings.sampleRate } : {});
    const source = byId("taker").textContent;
    await this.context.audioWorklet.addModule(`data:text/javascript,${encodeURIComponent(source)}`);
    const node = new AudioWorkletNode(this.context, "taker", { numberOfOutputs: 0 });
    this.rate = this.context.sampleRate;
    this.kept = Object.keys(RAW).filter((name) => name !== "channelCount" && settings[name] === true);
    this.blocks = [];
    this.samples = 0;
    this.clipped = 0;
    let [peak, told] = [0, 0];
    node.port.onmessage = ({ data }) => {
      this.blocks.push(data);
      this.samples += data.length;
      for (const x of data) {
        peak = Math.max(peak, Math.abs(x));
        if (Math.abs(x) >= CLIPPED) this.clipped += 1;
      }
      if (this.samples - told < this.rate / 10) return;
      onBlock({ seconds: this.samples / this.rate, peak, clipped: this.clipped });
      [peak, told] = [0, this.samples];
    };
    this.context.createMediaStreamSource(this.stream).connect(node);
    await this.context.resume();
  }

  // Ends the take: its samples, and what is to be said of it.
  async end() {
    this.stream.getTracks().forEach((track) => track.stop());
    await this.context.close();
    const samples = new Float32Array(this.samples);
    this.blocks.reduce((at, block) => (samples.set(block, at), at + block.length), 0);
    const peak = samples.reduce((most, x) => Math.max(most, Math.abs(x)), 0);
    const said = [];
    if (this.clipped > 0) said.push(`${countOf(this.clipped, "sample")} at full scale: record again with less gain.`);
    if (peak < SILENT) said.push("Silent: is the right input chosen, and not muted?");
    if (this.kept.length > 0) said.push(`This browser keeps on: ${this.kept.join(", ")}, which change the sound.`);
    return { samples, rate: this.rate, said };
  }
}
