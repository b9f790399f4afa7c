// The laboratory: what a person does, from recordings to what is kept.

const NOTHING = () => ({ folder: "recordings", rows: [], looked: {}, name: "textures", fitted: null, judged: null });

class Page {
  constructor(module) {
    this.lab = new Laboratory(module, (progress) => this.progress(progress));
    this.store = new Store();
    this.state = NOTHING();
    this.table = new Table((row, key) => this.changed(row, key));
    for (const [key, heading] of COLUMNS) byId("column").append(element("option", { value: key }, heading));
    this.listen();
  }

  async begin() {
    try {
      await this.store.open();
      const kept = await this.store.all();
      if (kept.has("state")) this.state = kept.get("state");
      kept.delete("state");
      for (const [path, blob] of kept) this.lab.files.set(path, blob);
      if (kept.size > 0) this.lab.end();
    } catch {
      this.store = null;
      addEventListener("beforeunload", (event) => this.lab.files.size > 0 && event.preventDefault());
    }
    byId("name").value = this.state.name;
    this.show();
    await this.lookAtAll();
    if (this.state.judged) await this.showJudged();
  }

  listen() {
    const on = (id, act) => byId(id).addEventListener("click", () => this.does(act));
    on("demo", () => this.demo());
    on("fill-empty", () => this.fill((row, key) => row[key] === ""));
    on("fill-used", () => this.fill((row) => row.use));
    on("by-pattern", () => this.byPattern());
    on("fit", () => this.fit());
    byId("cancel").addEventListener("click", () => this.lab.end());
    byId("take").addEventListener("click", () => (this.ends ? this.ends() : this.does(() => this.take())));
    on("open-report", () => this.frame("report-frame", this.state.judged.report));
    on("blind", () => this.blind());
    on("clear", () => this.clear());
    byId("whole").addEventListener("change", ({ target }) => byId("table").classList.toggle("whole", target.checked));
    byId("name").addEventListener("change", ({ target }) => (this.state.name = safeName(target.value)));
    for (const id of ["files", "folder"]) {
      byId(id).addEventListener("change", ({ target }) => {
        const files = [...target.files].map((file) => ({ path: file.webkitRelativePath || file.name, file }));
        target.value = "";
        this.does(() => this.add(files));
      });
    }
    const drop = byId("drop");
    addEventListener("dragover", (event) => {
      event.preventDefault();
      drop.classList.add("over");
    });
    addEventListener("dragleave", () => drop.classList.remove("over"));
    addEventListener("drop", (event) => {
      event.preventDefault();
      drop.classList.remove("over");
      // The items are gone once the event is over.
      const items = [...event.dataTransfer.items].filter(({ kind }) => kind === "file");
      const dropped = items.map((item) => filesOf(item));
      this.does(async () => this.add((await Promise.all(dropped)).flat()));
    });
  }

  // Does one thing after the other, and tells what goes wrong.
  does(act) {
    const one = async () => {
      show("trouble", "");
      try {
        await act();
      } catch (fault) {
        const isCancelled = fault instanceof Cancelled;
        show("trouble", isCancelled ? "Cancelled. Nothing that was entered is lost." : inColumns(fault.message));
      }
      this.progress(null);
      await this.save();
      this.show();
    };
    this.last = (this.last ?? Promise.resolve()).then(one);
    return this.last;
  }

  progress(progress) {
    byId("progress-row").hidden = byId("cancel").hidden = !progress;
    if (!progress) return;
    byId("progress-text").textContent = progress.action;
    byId("progress").max = Math.max(1, progress.total);
    byId("progress").value = progress.done;
  }

  note(text) {
    byId("notes").append(element("li", {}, inColumns(text)));
  }

  // Keeps a file in the module and in the browser.
  async keep(path, blob) {
    await this.lab.keep(path, blob);
    await this.store?.put(path, blob);
  }

  async add(files) {
    byId("notes").replaceChildren();
    const seen = files.filter(({ path }) => !path.split("/").some((part) => part.startsWith(".")));
    const [top] = seen[0]?.path.split("/") ?? [];
    const isFolder = seen.length > 0 && seen.every(({ path }) => path.startsWith(`${top}/`));
    const takesItsName = isFolder && this.state.rows.length === 0;
    if (takesItsName) this.state.folder = top;
    for (const [at, { path, file }] of seen.entries()) {
      this.progress({ action: "reading", done: at, total: seen.length });
      try {
        const within = takesItsName ? path.slice(top.length + 1) : path;
        await this.keep(`${this.state.folder}/${within}`, file);
        // One of the same name is in the place of another.
        delete this.state.looked[within];
      } catch (fault) {
        this.note(fault.message);
      }
    }
    await this.rowsOfNew("");
  }

  async demo() {
    byId("notes").replaceChildren();
    if (this.state.rows.length > 0) throw new Error("clear all first: simulated and other recordings do not mix");
    for (const path of await this.lab.ask({ ask: "demo", folder: this.state.folder })) {
      await this.keep(path, await this.lab.made(path));
    }
    await this.rowsOfNew("");
  }

  // Adds rows for recordings that have none.
  async rowsOfNew(pattern) {
    const { folder, rows } = this.state;
    if (this.lab.files.size === 0) return;
    const known = rows.map(({ file }) => file);
    const { rows: added, notes, left_out: leftOut } = await this.lab.ask({ ask: "rows", folder, pattern, known });
    notes.forEach((text) => this.note(text));
    leftOut.forEach((path) => this.lab.files.delete(path));
    await this.store?.remove(leftOut);
    rows.push(...added.map((row) => ({ use: true, ...row })));
    this.state.isStale = true;
    this.show();
    this.table.show(rows, this.state.looked);
    await this.lookAtAll();
  }

  async byPattern() {
    byId("notes").replaceChildren();
    const { folder, rows } = this.state;
    const asked = { ask: "rows", folder, pattern: byId("pattern").value.trim(), known: [] };
    const { rows: told, notes } = await this.lab.ask(asked);
    notes.forEach((text) => this.note(text));
    const byFile = new Map(told.map((row) => [row.file, row]));
    for (const row of rows) {
      for (const key of NEEDED) if (byFile.get(row.file)?.[key]) this.table.fill(row, key, byFile.get(row.file)[key]);
    }
  }

  async lookAtAll() {
    const { rows, looked } = this.state;
    this.table.show(rows, looked);
    // The browser lays out the whole table for what is shown of a row, so that many rows are shown in 16 steps.
    const unseen = rows.filter(({ file }) => !looked[file]);
    const step = Math.ceil(unseen.length / 16);
    for (let at = 0; at < unseen.length; at += step) {
      this.progress({ action: "looking", done: at, total: unseen.length });
      const some = unseen.slice(at, at + step);
      for (const row of some) await this.look(row);
      some.forEach((row) => this.table.look(row, looked[row.file]));
    }
    this.progress(null);
  }

  async look(row) {
    const { folder, looked } = this.state;
    const { use: _, ...plain } = row;
    try {
      looked[row.file] = await this.lab.ask({ ask: "look", folder, row: plain });
    } catch (fault) {
      if (fault instanceof Cancelled) throw fault;
      looked[row.file] = { fault: fault.message };
    }
  }

  changed(row, key) {
    this.state.isStale = true;
    this.does(async () => {
      // What is used of a recording, and in which unit, changes what is in it.
      if (["use", ...NEEDED].includes(key)) return;
      await this.look(row);
      this.table.look(row, this.state.looked[row.file]);
    });
  }

  fill(isMeant) {
    const key = byId("column").value;
    const rows = this.state.rows.filter((row) => isMeant(row, key));
    rows.forEach((row) => this.table.fill(row, key, byId("value").value.trim()));
    this.state.isStale = true;
    if (!NEEDED.includes(key)) rows.forEach((row) => delete this.state.looked[row.file]);
    return this.lookAtAll();
  }

  async take() {
    const [texture, speed, force, scale, seconds] = ["texture", "speed", "force", "scale", "seconds"]
      .map((name) => byId(`take-${name}`).value.trim());
    const take = new Take();
    const text = byId("take-text");
    await take.begin(({ seconds: now, peak, clipped }) => {
      byId("level").value = peak;
      text.textContent = `${now.toFixed(1)} s at ${take.rate} Hz${clipped > 0 ? ", CLIPPED" : ""}`;
      if (now >= Number(seconds)) this.ends?.();
    });
    const button = byId("take");
    button.textContent = "Stop";
    button.setAttribute("aria-pressed", "true");
    // By the button, too, which must not wait for what is under way: this.
    await new Promise((resolve) => (this.ends = resolve));
    this.ends = null;
    button.textContent = "Record";
    button.setAttribute("aria-pressed", "false");
    const { samples, rate, said } = await take.end();
    // The samples go to the module, and are gone from here.
    const length = (samples.length / rate).toFixed(1);
    const { folder, rows } = this.state;
    const name = safeName(`${texture}_${speed}mms_${force}N`);
    let number = 1;
    while (rows.some(({ file }) => file === `${name}_${number}.wav`)) number += 1;
    const file = `${name}_${number}.wav`;
    await this.lab.ask({ ask: "wave", path: `${folder}/${file}`, rate_hz: rate }, new Uint8Array(samples.buffer));
    await this.keep(`${folder}/${file}`, await this.lab.made(`${folder}/${file}`));
    const empty = Object.fromEntries(COLUMNS.map(([key]) => [key, ""]));
    rows.push({ use: true, ...empty, file, texture, speed_mm_s: speed, force_n: force, scale_m_s2: scale });
    text.textContent = [`${file}: ${length} s at ${rate} Hz.`, ...said].join(" ");
    await this.lookAtAll();
  }

  // The library that was fitted, which keeps its name when the next one is to have another.
  get library() {
    return this.state.fitted.library;
  }

  async fit() {
    const { folder, rows } = this.state;
    const used = rows.filter(({ use }) => use);
    Object.assign(this.state, { fitted: null, judged: null, isStale: false });
    byId("report-frame").hidden = true;
    this.show();
    this.table.point(null);
    const plain = used.map(({ use: _, ...row }) => row);
    const library = `${this.state.name}.lib`;
    try {
      this.state.fitted = { library, ...(await this.lab.ask({ ask: "fit", folder, rows: plain, library })) };
    } catch (fault) {
      // The list's first line is its header.
      const line = /trials\.csv, line (\d+): /.exec(fault.message);
      if (!line) throw fault;
      const row = used[Number(line[1]) - 2];
      this.table.point(row);
      throw new Error(fault.message.replace(/^.*?line \d+/, row.file));
    }
    for (const path of [library, `${library}.fit.json`, `${folder}/trials.csv`]) {
      await this.keep(path, await this.lab.made(path));
    }
    const { trials } = this.state.fitted;
    used.forEach((row, at) => Object.assign(this.state.looked[row.file] ?? {}, { verdicts: trials[at] }));
    this.table.show(rows, this.state.looked);
    this.show();
    const kept = { folder, library, page: "rub.html", report: "report" };
    this.state.judged = await this.lab.ask({ ask: "judge", ...kept });
    for (const path of ["rub.html", this.state.judged.report]) await this.store?.put(path, await this.html(path));
    await this.showJudged();
  }

  // A page that the module made.
  async html(path) {
    const blob = await this.lab.made(path, "text/html");
    this.lab.files.set(path, blob);
    return blob;
  }

  async showJudged() {
    const { verdicts, held_out: heldOut } = this.state.judged;
    byId("verdicts").replaceChildren(...verdicts.map((text) => element("p", { className: "verdict" }, text)));
    byId("held-out").textContent = `Held out: ${heldOut}`;
    byId("keeps").replaceChildren(...this.keeps().map(([text, act]) => {
      const button = element("button", { type: "button" }, text);
      button.addEventListener("click", () => this.does(act));
      return button;
    }));
    this.show();
    // As a text, because a page under an address of its own gets no worklet where this page is a file.
    byId("rub-frame").srcdoc = await this.lab.files.get("rub.html").text();
  }

  // Shows a page that the module made in a frame.
  async frame(id, path) {
    URL.revokeObjectURL(byId(id).src);
    // A page is kept as a file, and loses its kind with that.
    byId(id).src = URL.createObjectURL(new Blob([this.lab.files.get(path)], { type: "text/html" }));
    byId(id).hidden = false;
  }

  async blind() {
    const { folder } = this.state;
    await this.lab.ask({ ask: "blind", folder, library: this.library, page: "listening.html" });
    await this.html("listening.html");
    await this.frame("report-frame", "listening.html");
  }

  keeps() {
    const { folder, fitted } = this.state;
    const save = (path, name) => async () => saveFile(name ?? path, await this.lab.made(path));
    const zip = async () => {
      const paths = [folder, this.library, `${this.library}.fit.json`];
      await this.lab.ask({ ask: "zip", paths, path: "all.zip" });
      saveFile(`${this.state.name}.zip`, await this.lab.made("all.zip", "application/zip"));
      await this.lab.remove("all.zip");
    };
    const stroke = (texture, name) => async () => {
      await this.lab.ask({ ask: "stroke", library: this.library, texture, path: "stroke.wav" });
      saveFile(`${safeName(name)}_stroke.wav`, await this.lab.made("stroke.wav", "audio/wav"));
    };
    return [
      ["Library", save(this.library)],
      ["Its record", save(`${this.library}.fit.json`)],
      ["List and recordings, zip", zip],
      ["Page to rub", save("rub.html", `${this.state.name}-rub.html`)],
      ["Report", save(this.state.judged.report, `${this.state.name}-report.html`)],
      ...fitted.textures.map(({ name }, at) => [`Stroke over ${name}, WAV`, stroke(at, name)]),
    ];
  }

  show() {
    const { rows, fitted, judged, isStale } = this.state;
    byId("fill").hidden = rows.length === 0;
    byId("simulated").hidden = !rows.some(({ simulated }) => simulated === "true");
    byId("fit").disabled = !rows.some(({ use }) => use);
    byId("judged").hidden = !judged;
    byId("fit-notes").replaceChildren(...(fitted?.notes ?? []).map((text) => element("li", {}, inColumns(text))));
    if (fitted) {
      const plays = fitted.textures.map(({ name, plays: parts }) => `${name}: ${parts}`).join("; ");
      const made = `${countOf(fitted.trials.length, "trial")} -> ${this.library}, ${fitted.bytes} bytes. ${plays}.`;
      const stale = isStale ? " The table has changed since: fit again." : "";
      byId("fit-text").textContent = made + stale;
    }
    const held = `${countOf(this.lab.files.size, "file")}, ${megabytes(this.lab.bytes())}`;
    byId("stored").textContent = this.store
      ? `${held}, in its own storage on this computer: a reload loses nothing.`
      : `${held}, in memory alone: this browser lets the page store nothing. A reload loses all: save what you need.`;
  }

  async save() {
    try {
      await this.store?.put("state", this.state);
    } catch (fault) {
      show("trouble", `The browser does not store this (${fault.message}): save what you need before you leave.`);
    }
  }

  async clear() {
    await this.store?.clear();
    const tops = new Set([...this.lab.files.keys()].map((path) => path.split("/")[0]));
    for (const path of tops) await this.lab.remove(path);
    this.state = NOTHING();
    byId("notes").replaceChildren();
    byId("fit-text").textContent = "";
    byId("report-frame").removeAttribute("src");
    byId("report-frame").hidden = true;
    byId("rub-frame").srcdoc = "";
    this.table.show([], {});
  }
}

// A name that files can have on every system.
function safeName(text) {
  return text.replace(/[^\p{L}\p{N}._-]+/gu, "_").replace(/^[.-]+/, "_") || "textures";
}

// The files of an item that was dropped, with their paths.
function filesOf(item) {
  const [file, entry] = [item.getAsFile(), item.webkitGetAsEntry?.()];
  if (!entry?.isDirectory) return Promise.resolve([{ path: file.name, file }]);
  // Chromium reads no entries of a folder for a page from a file, but handles.
  if (item.getAsFileSystemHandle) return item.getAsFileSystemHandle().then((handle) => filesInHandle(handle));
  return filesInEntry(entry);
}

async function filesInHandle(handle, above = "") {
  const path = above + handle.name;
  if (handle.kind === "file") return [{ path, file: await handle.getFile() }];
  const all = [];
  for await (const inside of handle.values()) all.push(...(await filesInHandle(inside, `${path}/`)));
  return all;
}

async function filesInEntry(entry) {
  const asked = (act) => new Promise(act);
  const path = entry.fullPath.replace(/^\//, "");
  if (entry.isFile) return [{ path, file: await asked((resolve, reject) => entry.file(resolve, reject)) }];
  const [reader, all] = [entry.createReader(), []];
  for (;;) {
    const some = await asked((resolve, reject) => reader.readEntries(resolve, reject));
    if (some.length === 0) return all;
    for (const inside of some) all.push(...(await filesInEntry(inside)));
  }
}

async function main() {
  const text = byId("module").textContent;
  byId("module").remove();
  const packed = new Blob([Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0))]);
  const stream = packed.stream().pipeThrough(new DecompressionStream("gzip"));
  const page = new Page(await WebAssembly.compile(await new Response(stream).arrayBuffer()));
  globalThis.laboratory = page;
  await page.does(() => page.begin());
  globalThis.laboratoryIsReady = true;
}

main().catch((fault) => show("trouble", `This browser cannot run the laboratory: ${fault.message}`));
