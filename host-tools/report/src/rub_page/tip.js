// What the tip of a plant makes of the sound at the pin: a convolution. It is linear, so that nothing clips or rattles.

// Share of the response's frequencies from which on it fades, because its end would ring.
const FADES_FROM = 0.8;

// Delay of the impulse response, s: its fade rings before its beginning, too.
const IMPULSE_DELAY_S = 0.002;

// Time constant of the change from pin to tip and back, s.
const END_CHANGE_S = 0.01;

// The impulse response of an end at a rate, by the inverse transform of the frequency response.
function impulseOf({ step_hz: step, ...ends }, end, rate) {
  const response = new Float32Array(bytesOf(ends[end]).buffer);
  const bins = response.length / 2;
  const impulse = new Float64Array(Math.round(rate / step));
  for (let bin = 1; bin < Math.min(bins, impulse.length / 2); bin += 1) {
    const beyond = Math.max(0, (bin / bins - FADES_FROM) / (1 - FADES_FROM));
    const weight = (1 + Math.cos(Math.PI * beyond)) / impulse.length;
    const angle = (2 * Math.PI * bin) / impulse.length;
    const [cos, sin] = [Math.cos(angle), Math.sin(angle)];
    let re = weight * response[2 * bin];
    let im = weight * response[2 * bin + 1];
    for (let n = 0; n < impulse.length; n += 1) {
      impulse[n] += re;
      const turned = re * cos - im * sin;
      im = re * sin + im * cos;
      re = turned;
    }
  }
  const delay = Math.round(rate * IMPULSE_DELAY_S);
  return Float32Array.from(impulse, (_, n) => impulse.at(n - delay));
}

// The ways from the sound to the output: as it is at the pin, and through the plant to the tip, with and without the
// equaliser of a calibration.
class Ends {
  constructor(sound, plant) {
    [this.sound, this.plant] = [sound, plant];
    this.gains = { pin: new GainNode(sound.context) };
    sound.disconnect();
    sound.connect(this.gains.pin).connect(sound.context.destination);
  }

  // Computed when it is first chosen, because an impulse response takes a moment.
  through(end) {
    const { context } = this.sound;
    const impulse = impulseOf(this.plant, end, context.sampleRate);
    const buffer = new AudioBuffer({ length: impulse.length, sampleRate: context.sampleRate });
    buffer.copyToChannel(impulse, 0);
    const gain = new GainNode(context, { gain: 0 });
    const convolver = new ConvolverNode(context, { buffer, disableNormalization: true });
    this.sound.connect(convolver).connect(gain).connect(context.destination);
    return gain;
  }

  choose(end) {
    this.gains[end] ??= this.through(end);
    for (const [id, { gain, context }] of Object.entries(this.gains)) {
      gain.setTargetAtTime(id === end ? 1 : 0, context.currentTime, END_CHANGE_S);
    }
  }
}
