// What sounds: the kernel, or the recording of the nearest node. A voice gives samples in m/s² one by one, and decides
// on each block of 2 ms by the hand of that moment.

// Share of its distance from the pointer that the tool makes up per block along a scene's path, beside the way of the
// hand's speed: within 0.2 s, so that the steps in which a pointer reports its place are no changes of speed.
const FOLLOWS = 0.01;

// Distance that a tool at rest leaves, mm.
const NEAR_MM = 0.5;

// Blocks of silence after which a tool in the air is taken to rest.
const QUIET_BLOCKS = 100;

// Speed beyond which no hand goes, mm/s: what a pointer says beyond it is a jump.
const FASTEST_MM_S = 5000;

function clamped(value, most) {
  return Math.max(-most, Math.min(most, value));
}

// The kernel playing a texture or a scene.
class KernelVoice {
  constructor(kernel) {
    this.kernel = kernel;
    this.left = 0;
    this.at = 0;
  }

  // Begins `choice` anew. With `take`, what is played from now on is kept in it.
  begin(choice, hand, take) {
    const { kernel } = this;
    kernel.choose(choice);
    this.hand = hand;
    this.take = take;
    this.isScene = choice.scene !== undefined;
    this.position = this.isScene ? Math.fround(hand.path) : 0;
    this.rate = kernel.rate;
    this.left = 0;
    // What sounded in this instance fades within a block, which is not heard any more.
    kernel.motion.fill(0, 0, 5);
    this.isFading = kernel.exports.digest_words() !== 0;
    this.quiet = 0;
    this.touched = false;
    if (take) take.begin(choice, kernel.rate, this.position);
  }

  next() {
    if (this.left === 0) this.block();
    this.left -= 1;
    return this.kernel.samples[this.at++];
  }

  block() {
    const { kernel, hand } = this;
    if (this.isFading) {
      kernel.run(1);
      this.isFading = false;
    }
    // Along a scene's path the tool comes to its place in the air, a block before it touches.
    const touches = hand.contact();
    const contact = touches && (this.touched || !this.isScene) ? 1 : 0;
    this.touched = touches;
    // Single precision, as a table of a motion has it, so that a take is played to the bit by `stylus render`.
    const force = Math.fround(hand.force());
    const way = this.isScene ? this.wayAlongPath(contact) : clamped(hand.speed(), FASTEST_MM_S) * BLOCK_S;
    const speed = contact === 0 && this.isScene ? 0 : Math.fround(way / BLOCK_S);
    const after = Math.fround(this.position + way);
    const { motion, blockSamples, rate } = kernel;
    this.at = 0;
    this.left = blockSamples;
    if (this.rests(contact)) {
      this.position = after;
      return;
    }
    const blocks = this.take ? this.take.blocks : 0;
    motion[0] = speed;
    motion[1] = force;
    motion[2] = this.position;
    motion[3] = between(this.position, after, blocks, blockSamples, rate);
    motion[4] = contact;
    kernel.run(1);
    if (this.take && !this.take.add(speed, force, after, contact, kernel.words, blockSamples)) this.take = null;
    this.position = after;
  }

  // The way of a block towards the pointer, mm, so that speed and position tell the same; in the air all of it.
  wayAlongPath(contact) {
    const { hand } = this;
    const left = hand.path - this.position;
    if (contact === 0) return left;
    const along = hand.along();
    if (along === 0 && Math.abs(left) < NEAR_MM) return 0;
    return clamped(along * BLOCK_S + left * FOLLOWS, FASTEST_MM_S * BLOCK_S);
  }

  // True while a tool in the air sounds no more, so that nothing has to be computed. A take is played whole.
  rests(contact) {
    if (contact === 1 || this.take) {
      this.quiet = 0;
      return false;
    }
    const { samples, blockSamples } = this.kernel;
    for (let n = 0; n < blockSamples; n++) {
      if (samples[n] !== 0) {
        this.quiet = 0;
        return false;
      }
    }
    this.quiet += 1;
    return this.quiet > QUIET_BLOCKS;
  }
}

// The position at a block's last sample, as it is between two rows of a table: the same operations in the same order.
function between(before, after, block, blockSamples, rate) {
  const from = (block * blockSamples) / rate;
  const to = ((block + 1) * blockSamples) / rate;
  const time = from + (blockSamples - 1) / rate;
  return before + (after - before) * ((time - from) / (to - from));
}

// The recording of the node that is nearest to the hand, in a loop; from node to node with a short crossfade.
class ClipVoice {
  // `clips` have { speed, force, samples }, all at `rate`.
  constructor(clips, rate) {
    this.clips = clips;
    this.rate = rate;
    this.current = null;
    this.before = null;
    this.level = 0;
    this.left = 0;
  }

  begin(_choice, hand) {
    this.hand = hand;
    this.level = 0;
    this.left = 0;
  }

  next() {
    if (this.left === 0) this.block();
    this.left -= 1;
    // 10 ms from silence to all.
    const step = 1 / (0.01 * this.rate);
    this.level += Math.max(-step, Math.min(step, this.target - this.level));
    let sample = this.sampleOf(this.current);
    if (this.mix < 1) {
      this.mix = Math.min(1, this.mix + step / 2);
      const angle = (Math.PI / 2) * this.mix;
      sample = Math.sin(angle) * sample + Math.cos(angle) * this.sampleOf(this.before);
    }
    return this.level * sample;
  }

  sampleOf(playing) {
    const { samples } = playing.clip;
    if (playing.at >= samples.length) playing.at = 0;
    return samples[playing.at++];
  }

  block() {
    const { hand } = this;
    const speed = Math.abs(hand.speed());
    this.target = hand.contact() && speed > 0 ? 1 : 0;
    const clip = nearest(this.clips, speed, hand.force());
    if (this.current === null) {
      this.current = { clip, at: 0 };
      this.mix = 1;
    } else if (clip !== this.current.clip && this.mix >= 1) {
      this.before = this.current;
      this.current = { clip, at: Math.floor(Math.random() * clip.samples.length) };
      this.mix = 0;
    }
    this.left = Math.round(this.rate * BLOCK_S);
  }
}

// The clip whose speed and force are nearest by ratio.
function nearest(clips, speed, force) {
  let best = clips[0];
  let least = Infinity;
  for (const clip of clips) {
    const faster = Math.log((speed + 1) / (clip.speed + 1));
    const harder = Math.log((force + 0.01) / (clip.force + 0.01));
    const apart = Math.abs(faster) + Math.abs(harder);
    if (apart < least) {
      least = apart;
      best = clip;
    }
  }
  return best;
}

// What a voice has played from its beginning: the motion of each block and the words, up to a minute.
class Take {
  static MOST_S = 60;

  constructor() {
    const blocks = Take.MOST_S / BLOCK_S;
    this.motion = new Float64Array(4 * (blocks + 1));
    this.words = new Int32Array(20 * blocks);
    this.most = blocks;
    this.blocks = 0;
    this.count = 0;
  }

  begin(choice, rate, position) {
    this.choice = choice;
    this.rate = rate;
    this.blocks = 0;
    this.count = 0;
    this.start = position;
  }

  // Keeps a block: the hand at its beginning and the position at its end. Returns false when a minute is full.
  add(speed, force, after, contact, words, samples) {
    const at = 4 * this.blocks;
    this.motion[at] = speed;
    this.motion[at + 1] = force;
    this.motion[at + 2] = after;
    this.motion[at + 3] = contact;
    for (let n = 0; n < samples; n++) this.words[this.count + n] = words[n];
    this.count += samples;
    this.blocks += 1;
    return this.blocks < this.most;
  }
}
