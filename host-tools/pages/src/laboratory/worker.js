// The laboratory's module in a thread of its own: one request after the other.

const NO_MEMORY = "the browser has no memory left: leave out some recordings, or use the command";

let exports;

const bytesAt = (at, length) => new Uint8Array(exports.memory.buffer, at, length);
const textAt = (at, length) => new TextDecoder().decode(bytesAt(at, length));

// Answers { ask, bytes }: { told, bytes }. Throws the module's words.
function answered({ ask, bytes = new Uint8Array() }) {
  const asked = new TextEncoder().encode(JSON.stringify(ask));
  const at = exports.reserve(asked.length + bytes.length) >>> 0;
  if (at === 0) throw new Error(NO_MEMORY);
  bytesAt(at, asked.length).set(asked);
  bytesAt(at + asked.length, bytes.length).set(bytes);
  const isRefused = exports.ask(asked.length) !== 0;
  const text = textAt(exports.text() >>> 0, exports.text_length());
  if (isRefused) throw new Error(text);
  return { told: JSON.parse(text), bytes: bytesAt(exports.bytes() >>> 0, exports.bytes_length()).slice() };
}

async function begin(module) {
  const progress = (at, length, done, total) =>
    postMessage({ progress: { action: textAt(at >>> 0, length), done, total } });
  const imports = { page: { progress } };
  // The pictures' library declares calls of a browser's window for letters, which pictures here do not need.
  for (const { module: from, name } of WebAssembly.Module.imports(module)) {
    imports[from] ??= {};
    imports[from][name] ??= () => {
      throw new Error(`the module calls ${name}`);
    };
  }
  ({ exports } = await WebAssembly.instantiate(module, imports));
  exports.begin();
}

let begun;
onmessage = async ({ data }) => {
  if (data.module) {
    begun = begin(data.module);
    return;
  }
  const { id } = data;
  try {
    await begun;
    const { told, bytes } = answered(data);
    postMessage({ id, told, bytes }, [bytes.buffer]);
  } catch (fault) {
    // A panic has left its words, and a lack of memory none. The module must not be called again.
    const hasStopped = fault instanceof WebAssembly.RuntimeError || fault instanceof RangeError;
    const words = hasStopped ? textAt(exports.text() >>> 0, exports.text_length()) || NO_MEMORY : fault.message;
    postMessage({ id, fault: words, hasStopped });
  }
};
