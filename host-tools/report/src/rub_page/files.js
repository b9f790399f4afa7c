// A take as files: its motion as `stylus render --motion` reads it, and its samples as a WAV file.

// Rows of a take's motion. Row n has the hand at the beginning of block n, and its position there; the last one ends
// the last block.
function motionCsv({ motion, start, rate }) {
  const blocks = motion.length / 4;
  const samples = rate / 500;
  const rows = ["time_s,speed_mm_s,force_n,position_mm,contact"];
  for (let block = 0; block <= blocks; block++) {
    const at = 4 * Math.min(block, blocks - 1);
    const position = block === 0 ? start : motion[4 * (block - 1) + 2];
    rows.push([(block * samples) / rate, motion[at], motion[at + 1], position, motion[at + 3]].join(","));
  }
  return `${rows.join("\n")}\n`;
}

// The bytes of a WAV file: 32-bit float, m/s², one channel, as `stylus render` writes it.
function wavBytes({ words, rate }) {
  const bytes = new Uint8Array(44 + 4 * words.length);
  const view = new DataView(bytes.buffer);
  const text = (at, letters) => bytes.set([...letters].map((letter) => letter.charCodeAt(0)), at);
  text(0, "RIFF");
  view.setUint32(4, bytes.length - 8, true);
  text(8, "WAVEfmt ");
  view.setUint32(16, 16, true);
  view.setUint16(20, 3, true);
  view.setUint16(22, 1, true);
  view.setUint32(24, rate, true);
  view.setUint32(28, 4 * rate, true);
  view.setUint16(32, 4, true);
  view.setUint16(34, 32, true);
  text(36, "data");
  view.setUint32(40, 4 * words.length, true);
  words.forEach((word, n) => view.setFloat32(44 + 4 * n, word / 2 ** 20, true));
  return bytes;
}

function saveFile(name, content, type) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([content], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
