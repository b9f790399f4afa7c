// The kernel's digest of a fixed motion, which is the same on every processor; computed here in pieces, between frames.

// Blocks per piece: 100 ms of sound, some milliseconds of work.
const DIGEST_BLOCKS = 50;

// Plays the digest's motion with `texture` on `kernel`, which has played nothing yet. Resolves to the digest, the
// number of its words, and how fast that was.
async function digestOf(kernel, texture) {
  const { exports } = kernel;
  kernel.choose({ texture, seed: exports.digest_seed() });
  const blocks = Math.floor(exports.digest_length() / kernel.blockSamples);
  let busy = 0;
  for (let first = 0; first < blocks; first += DIGEST_BLOCKS) {
    const count = Math.min(DIGEST_BLOCKS, blocks - first);
    await pause();
    const begin = performance.now();
    kernel.check(exports.digest_motion(first, count));
    kernel.run(count);
    busy += performance.now() - begin;
  }
  const words = exports.digest_words();
  return {
    digest: (exports.digest() >>> 0).toString(16).padStart(8, "0"),
    words,
    timesRealTime: (1000 * words) / kernel.rate / busy,
  };
}

// Lets the page do what is due.
function pause() {
  return new Promise((resolve) => {
    setTimeout(resolve, 4);
  });
}
