// The module by promises, and the files that it holds, from which a new one is filled if it stops or is ended.

// What all files together may have, bytes.
const MOST_BYTES = 1e9;

class Cancelled extends Error {}

class Laboratory {
  // `module` is a WebAssembly.Module. `onProgress` is told { action, done, total }.
  constructor(module, onProgress) {
    this.module = module;
    this.onProgress = onProgress;
    this.files = new Map();
    this.waiting = new Map();
    this.last = 0;
    this.source = URL.createObjectURL(new Blob([byId("worker").textContent], { type: "text/javascript" }));
    this.begin();
  }

  begin() {
    this.worker = new Worker(this.source);
    this.worker.onmessage = ({ data }) => this.told(data);
    // Without another try, which would end in the same way.
    this.worker.onerror = (fault) => this.fail(new Error(`the module cannot begin here: ${fault.message}`));
    this.worker.postMessage({ module: this.module });
    // Whatever is asked next comes after these.
    this.filled = Promise.all([...this.files].map(([path, blob]) => this.put(path, blob))).catch(() => null);
  }

  told({ id, told, bytes, fault, hasStopped, progress }) {
    if (progress) {
      this.onProgress(progress);
      return;
    }
    const { resolve, reject } = this.waiting.get(id);
    this.waiting.delete(id);
    if (fault === undefined) resolve({ told, bytes });
    else reject(new Error(hasStopped ? `The module stopped, and a new one took its place: ${fault}` : fault));
    if (hasStopped) this.end(new Error("the module stopped before this was done: try again"));
  }

  send(ask, bytes) {
    const id = ++this.last;
    return new Promise((resolve, reject) => {
      this.waiting.set(id, { resolve, reject });
      this.worker.postMessage({ id, ask, bytes }, bytes ? [bytes.buffer] : []);
    });
  }

  async put(path, blob) {
    await this.send({ ask: "put", path }, new Uint8Array(await blob.arrayBuffer()));
  }

  // What the module tells.
  async ask(ask, bytes) {
    await this.filled;
    return (await this.send(ask, bytes)).told;
  }

  // Keeps a file. Throws why it may not be read, before it is.
  async keep(path, blob) {
    await this.ask({ ask: "admits", path, size: blob.size });
    if (this.bytes() + blob.size > MOST_BYTES) {
      throw new Error(`${path}: all files together would have more than ${megabytes(MOST_BYTES)}: use the command`);
    }
    await this.put(path, blob);
    this.files.set(path, blob);
  }

  // A file that the module made, as a blob.
  async made(path, type = "application/octet-stream") {
    await this.filled;
    return new Blob([(await this.send({ ask: "get", path })).bytes], { type });
  }

  async remove(path) {
    for (const name of this.files.keys()) if (name === path || name.startsWith(`${path}/`)) this.files.delete(name);
    await this.ask({ ask: "remove", path });
  }

  bytes() {
    return [...this.files.values()].reduce((sum, { size }) => sum + size, 0);
  }

  // Ends what is under way, with `reason`, and begins again with the same files.
  end(reason = new Cancelled("cancelled")) {
    this.worker.terminate();
    this.fail(reason);
    this.begin();
  }

  fail(reason) {
    const waiting = [...this.waiting.values()];
    this.waiting.clear();
    waiting.forEach(({ reject }) => reject(reason));
  }
}
