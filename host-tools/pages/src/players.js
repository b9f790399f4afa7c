"use strict";
// Sounds of pictures: a node of a map plays its recording and its synthesis, a spectrogram from where it is clicked.
(() => {
  const plots = globalThis.stylusPlots;
  const element = document.getElementById("nodes");
  const nodes = element === null ? { textures: {} } : JSON.parse(element.textContent);
  // Times the rate of the clips: a rate that every browser takes.
  const FACTOR = 4;
  const PAUSE_S = 0.12;
  const FADE_S = 0.01;

  // Samples at FACTOR times the rate: zeros between them, and a Hann-windowed sinc over them.
  const REACH = 12;
  const kernel = Float32Array.from({ length: 2 * REACH * FACTOR + 1 }, (_, index) => {
    const t = (index - REACH * FACTOR) / FACTOR;
    const sinc = t === 0 ? 1 : Math.sin(Math.PI * t) / (Math.PI * t);
    return sinc * (0.5 + 0.5 * Math.cos(Math.PI * t / (REACH + 1 / FACTOR)));
  });
  const resampled = (samples) => {
    const out = new Float32Array(samples.length * FACTOR);
    const middle = REACH * FACTOR;
    samples.forEach((sample, n) => {
      for (let index = 0; index < kernel.length; index += 1) {
        const at = n * FACTOR + index - middle;
        if (at >= 0 && at < out.length) out[at] += sample * kernel[index];
      }
    });
    const fade = Math.min(out.length >> 1, Math.round(FADE_S * FACTOR * nodes.rate_hz));
    for (let n = 0; n < fade; n += 1) {
      out[n] *= n / fade;
      out[out.length - 1 - n] *= n / fade;
    }
    return out;
  };
  const decoded = (text) => {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    const view = new DataView(bytes.buffer);
    return Float32Array.from({ length: bytes.length >> 1 }, (_, n) => view.getInt16(2 * n, true) / 32768);
  };

  let context = null;
  let source = null;
  const silence = () => {
    for (const audio of document.querySelectorAll("audio")) audio.pause();
    if (source !== null) {
      source.stop();
      source = null;
    }
  };
  const play = async (parts) => {
    context = context ?? new AudioContext();
    silence();
    if (context.state === "suspended") await context.resume();
    const rate = FACTOR * nodes.rate_hz;
    const pause = Math.round(PAUSE_S * rate);
    const length = parts.reduce((sum, part) => sum + part.length + pause, 0);
    const buffer = context.createBuffer(1, Math.max(1, length), rate);
    let at = 0;
    for (const part of parts) {
      buffer.getChannelData(0).set(part, at);
      at += part.length + pause;
    }
    source = context.createBufferSource();
    source.buffer = buffer;
    source.connect(context.destination);
    source.start();
  };
  // The node's clips as the page keeps them, or null.
  const clips = (texture, speed, force) => {
    const own = nodes.textures[texture];
    if (own === undefined) return null;
    const near = (a, b) => Math.abs(a - b) <= 1e-3 * Math.max(Math.abs(a), Math.abs(b));
    const index = own.nodes.findIndex(([v, f]) => near(v, speed) && near(f, force));
    return index < 0 ? null : own.clips[index];
  };
  plots.onplay = async (texture, speed, force) => {
    const own = clips(texture, speed, force);
    if (own === null) return "no sound of this node in the page";
    try {
      await play(own.map((text) => resampled(decoded(text))));
    } catch (failure) {
      return "cannot be played: " + failure.message;
    }
    globalThis.stylusPlayed = { texture, speed, force, context, source };
    return "recording, then synthesis, " + nodes.seconds.toFixed(1) + " s each";
  };
  plots.onseek = async (group, time) => {
    const audio = group.closest("figure")?.querySelector('audio[data-panel="' + CSS.escape(plots.axes(group).name) + '"]');
    if (!audio) return null;
    silence();
    try {
      audio.preload = "auto";
      if (!(audio.duration > 0)) {
        const loaded = new Promise((done, failed) => { audio.onloadedmetadata = done; audio.onerror = failed; });
        audio.load();
        await loaded;
      }
      if (time >= audio.duration) return "the page holds the first " + audio.duration.toFixed(1) + " s";
      audio.currentTime = Math.max(0, time);
      await audio.play();
    } catch (failure) {
      return "cannot be played: " + (failure.message ?? "no sound");
    }
    return "plays from here";
  };
  addEventListener("keydown", (event) => { if (event.key === "Escape") silence(); });
})();
