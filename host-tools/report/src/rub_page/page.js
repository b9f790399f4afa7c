// The page: what was chosen, what the hand does, and what is shown. Everything begins at the end of this file.

// Interval at which the hand is told to the worklet while it touches, ms.
const TELL_MS = 4;

// Largest number of surfaces without a list to search.
const MOST_CHIPS = 12;

// Pictures per second, and with reduced motion.
const PICTURES_PER_S = 30;
const STILL_PICTURES_PER_S = 4;

const byId = (id) => document.getElementById(id);

// A number with about three digits.
function shown(value, unit) {
  const digits = Math.abs(value) >= 100 ? 0 : Math.abs(value) >= 10 ? 1 : 2;
  return `${value.toFixed(digits)} ${unit}`;
}

function median(values) {
  const sorted = [...values].sort((a, b) => a - b);
  return sorted[Math.floor(sorted.length / 2)];
}

class RubPage {
  constructor(data) {
    this.data = data;
    this.textures = data.textures.map((_, index) => new PageTexture(data, index));
    this.surfaces = [
      ...this.textures.map((texture) => ({ name: texture.name, texture: texture.index })),
      ...data.scenes.map((scene, index) => ({ name: scene.name, scene: index })),
    ];
    this.seed = data.seed;
    this.kind = "synthesis";
    this.isMute = false;
    this.stroke = new KeyStroke();
    this.silence = new Silence(this);
    this.recent = new Float32Array(0);
    this.rate = 5000;
    this.filterMs = null;
    this.played = null;
    this.delays = [];
    this.clipped = 0;
    this.takes = [];
    // By texture: the kernel's digest, and the relief of the patch.
    this.digests = new Map();
    this.reliefs = new Map();
    this.isTaking = false;
    // Times since the page was opened, ms; null until it happens.
    this.times = { ready: null, touched: null, heard: null };
    this.patch = new Patch(byId("patch"), byId("patch-picture"));
    this.patch.onresize = () => this.showScale();
    this.pointer = new Pointer(byId("patch"), {
      onbegin: () => this.touch(),
      onmove: () => this.tellHand(),
      onend: () => this.tellHand(),
      onwheel: (steps) => this.stepForce(steps),
    });
    this.setUpControls();
    listenToKeys(this);
    stylusPlots.onplay = (_texture, speed, force) => this.playNode(speed, force);
    globalThis.addEventListener("blur", () => this.letGo());
    document.addEventListener("visibilitychange", () => document.hidden && this.letGo());
    this.waveform = new Waveform(byId("waveform-picture"));
    this.spectrumPicture = new SpectrumPicture(byId("spectrum-picture"), data.frequencies_hz);
    this.spectrum = new LiveSpectrum(this.rate, data.frequencies_hz);
    this.isStill = matchMedia("(prefers-reduced-motion: reduce)");
    this.chooseSurface(0);
    this.showFacts();
  }

  get surface() {
    return this.surfaces[this.surfaceIndex];
  }

  // The texture that is played, or the one under the tool of a scene; the first one on a smooth surface.
  get texture() {
    return this.textures[this.surface.texture ?? this.under ?? 0];
  }

  // ---- Sound ----

  // Takes over the worklet's node.
  connect(node) {
    this.node = node;
    this.node.port.onmessage = ({ data }) => this.hear(data);
    this.node.onprocessorerror = () => this.fail("the browser's audio worklet stopped: reload the page");
    if (this.end) this.chooseEnd(this.end);
    this.tellVolume();
    this.tellHand();
    this.play();
    embed(this);
  }

  hear(message) {
    if (message.type === "played") this.silence.end();
    if (message.type === "ready") this.times.ready = performance.now();
    else if (message.type === "fault") this.fail(message.text);
    else if (message.type === "heard") this.times.heard = message.at - performance.timeOrigin;
    else if (message.type === "chosen") this.takeOver(message);
    else if (message.type === "taken") this.keepTake(message);
    else if (message.type === "played") this.takeIn(message);
    if (message.type !== "played") this.showFacts();
  }

  fail(text) {
    const trouble = byId("trouble");
    trouble.textContent = `No sound: ${text}`;
    trouble.hidden = false;
  }

  // Tells the worklet what to play, from its beginning.
  play(take = false) {
    if (this.choice().recording) this.sendClips(this.texture);
    this.silence.choose();
    this.node?.port.postMessage({ type: "choose", choice: this.choice(), take });
  }

  // Gives the worklet the recordings of a texture, once.
  sendClips(texture) {
    if (!this.node || texture.isSent) return;
    const clips = texture.sounds();
    this.node.port.postMessage({ type: "clips", texture: texture.index, clips, rate: clips[0].rate });
    texture.isSent = true;
  }

  choice() {
    const { texture, scene } = this.surface;
    const kind = this.kinds().find(({ id }) => id === this.kind);
    return { texture, scene, seed: this.seed, without: kind.without ?? 0, recording: kind.recording ?? false };
  }

  // A page without sound resamples nothing.
  takeOver({ rate, filterMs = null }) {
    if (rate !== this.spectrum.rate) this.spectrum = new LiveSpectrum(rate, this.data.frequencies_hz);
    this.rate = rate;
    this.filterMs = filterMs;
    this.spectrum.clear();
    this.recent = new Float32Array(0);
  }

  takeIn(message) {
    this.played = message;
    this.clipped += message.clipped;
    this.delays.push(...message.delays);
    if (this.delays.length > 400) this.delays.splice(0, this.delays.length - 400);
    const isSounding = message.samples.some((sample) => sample !== 0);
    if (isSounding && this.spectrum.add(message.samples, this.beside())) this.hasNewSpectrum = true;
    const joined = new Float32Array(this.recent.length + message.samples.length);
    joined.set(this.recent);
    joined.set(message.samples, this.recent.length);
    this.recent = joined.slice(-Math.round(0.1 * this.rate));
    if (message.takeBlocks > 0) byId("take-text").textContent = `${(message.takeBlocks * BLOCK_S).toFixed(1)} s kept`;
    if (this.surface.scene !== undefined && message.state) {
      const under = Kernel.voices(message.state).findLast((voice) => voice.texture >= 0)?.texture ?? null;
      if (under !== this.under) this.spectrum.clear();
      this.under = under;
    }
  }

  tellVolume() {
    const decibels = Number(byId("volume").value);
    // Full scale of the output, m/s².
    this.fullScale = this.data.full_scale_m_s2 * 10 ** (-decibels / 20);
    this.node?.port.postMessage({ type: "gain", gain: this.isMute ? 0 : 1 / this.fullScale });
    byId("volume-text").textContent = `${decibels > 0 ? "+" : ""}${decibels} dB`;
  }

  // ---- The hand ----

  touch() {
    this.context?.resume();
    this.silence.watch();
    this.times.touched ??= performance.now();
    byId("patch").classList.add("touched");
    this.watch();
    this.tellHand();
  }

  // Tells the hand again and again while it touches: a pointer that rests reports nothing.
  watch() {
    if (this.timer) return;
    let before = performance.now();
    this.timer = setInterval(() => {
      const now = performance.now();
      if (this.stroke.moves && !this.pointer.touches) this.stroke.step(now - before, this.keySpeed, this.lengthMm());
      before = now;
      this.tellHand();
      if (!this.touches) {
        clearInterval(this.timer);
        this.timer = null;
      }
    }, TELL_MS);
  }

  letGo() {
    this.stroke.held = [];
    this.stroke.goesOn = false;
    this.pointer.lift();
    this.tellHand();
  }

  get touches() {
    return this.pointer.touches || this.stroke.moves;
  }

  tellHand() {
    const { pointer, stroke } = this;
    const isPointer = pointer.touches;
    const now = performance.now();
    const scale = this.mmPerPx();
    const keySpeed = stroke.moves ? this.keySpeed : 0;
    const speed = isPointer ? pointer.path.speed(now) * scale : keySpeed;
    const along = isPointer ? pointer.path.along(now) * scale : keySpeed * stroke.direction;
    const share = isPointer ? pointer.x : stroke.place;
    const force = isPointer && pointer.pressure !== null ? this.forceOf(pointer.pressure) : this.force;
    if (isPointer) stroke.place = share;
    this.hand = { speed, along, force, contact: this.touches, path: this.pathOf(share) };
    const stamp = isPointer && pointer.stamp !== null ? Date.now() - (now - pointer.stamp) : null;
    pointer.stamp = null;
    this.node?.port.postMessage({ type: "hand", ...this.hand, stamp });
    this.place = { x: share, y: isPointer ? pointer.y : 0.5 };
  }

  // Length of the patch, mm: that of a scene's path, or what the pointer's scale makes of it.
  lengthMm() {
    const path = this.scenePath();
    return path ? path.end - path.start : this.patch.width * Number(byId("scale").value);
  }

  mmPerPx() {
    return this.lengthMm() / Math.max(1, this.patch.width);
  }

  // Place on a scene's path, mm, or along the patch.
  pathOf(share) {
    return (this.scenePath()?.start ?? 0) + share * this.lengthMm();
  }

  scenePath() {
    const regions = this.surface.scene === undefined ? [] : this.data.scenes[this.surface.scene].regions;
    if (regions.length === 0) return null;
    const start = Math.min(...regions.map((region) => region.start_mm));
    const end = Math.max(...regions.map((region) => region.end_mm));
    return { start, end };
  }

  forceOf(pressure) {
    const { min, max } = byId("force");
    return Number(min) + pressure * (Number(max) - Number(min));
  }

  get force() {
    return Number(byId("force").value);
  }

  get keySpeed() {
    return Number(byId("speed").value);
  }

  // ---- Choices ----

  chooseSurface(index) {
    if (index >= this.surfaces.length || index === this.surfaceIndex) return;
    this.endTake();
    this.surfaceIndex = index;
    const surfaces = this.data.scenes[this.surface.scene]?.surfaces ?? [];
    this.under = this.surface.texture ?? surfaces.find(({ texture }) => texture !== null)?.texture;
    const input = document.getElementsByName("surface")[index];
    input.checked = true;
    const [list, chip] = [byId("surfaces"), input.parentElement];
    const above = chip.offsetTop - list.offsetTop - list.clientTop;
    if (above < list.scrollTop || above + chip.offsetHeight > list.scrollTop + list.clientHeight) list.scrollTop = above;
    if (!this.kinds().some(({ id }) => id === this.kind)) this.kind = "synthesis";
    this.setRanges();
    this.showKinds();
    this.showMap();
    this.showPatch();
    this.play();
    this.computeDigest();
    this.say(this.surface.name);
  }

  // Chips of the surfaces that the search has left.
  shownChips() {
    return [...byId("surfaces").querySelectorAll("label")].filter((label) => !label.hidden);
  }

  chooseShown(number) {
    const inputs = [...document.getElementsByName("surface")];
    const chip = this.shownChips()[number];
    if (chip) this.chooseSurface(inputs.indexOf(chip.firstChild));
  }

  search(words) {
    const wanted = words.toLowerCase().split(/\s+/);
    [...document.getElementsByName("surface")].forEach((input, index) => {
      const name = this.surfaces[index].name.toLowerCase();
      input.parentElement.hidden = !wanted.every((word) => name.includes(word));
    });
    byId("search-text").textContent = `${this.shownChips().length} of ${this.surfaces.length}`;
  }

  // Kinds of sound of the surface: a scene has its synthesis alone.
  kinds() {
    if (this.surface.scene === undefined) return this.texture.kinds();
    return [{ id: "synthesis", name: "Synthesis", look: "synthesis", without: 0 }];
  }

  chooseKind(id) {
    this.endTake();
    this.kind = id;
    this.play();
    this.showKinds();
    this.say(this.kinds().find((kind) => kind.id === id).name);
  }

  // Hears the pin, or the tip of the plant that the page has; its convolution begins with the first choice of the tip.
  chooseEnd(end) {
    this.end = end;
    if (this.node && (this.ends || end !== "pin")) {
      this.ends ??= new Ends(this.node, this.data.plant);
      this.ends.choose(end);
    }
    this.say(end === "calibrated" ? "at the tip, calibrated" : `at the ${end}`);
  }

  compare() {
    const kinds = this.kinds();
    const index = kinds.findIndex(({ id }) => id === this.kind);
    if (kinds.length > 1) this.chooseKind(kinds[(index + 1) % kinds.length].id);
    else this.say(`${this.surface.name} has nothing else to compare`);
  }

  stepSeed(step) {
    this.endTake();
    this.seed = Math.max(0, this.seed + step);
    this.play();
    this.showFacts();
    this.say(`seed ${this.seed}`);
  }

  toggleMute() {
    this.isMute = !this.isMute;
    byId("mute").setAttribute("aria-pressed", this.isMute);
    this.tellVolume();
    this.say(this.isMute ? "silence" : "sound");
  }

  stepForce(step) {
    this.stepRange("force", step);
    this.say(shown(this.force, "N"));
  }

  stepSpeed(step) {
    this.stepRange("speed", step);
    this.say(shown(this.keySpeed, "mm/s"));
  }

  stepRange(id, step) {
    const range = byId(id);
    const width = Number(range.max) - Number(range.min);
    range.value = Number(range.value) + (step * width) / 20;
    range.dispatchEvent(new Event("input"));
  }

  holdKey(direction) {
    this.stroke.hold(direction);
    this.touch();
  }

  releaseKey(direction) {
    this.stroke.release(direction);
    this.tellHand();
  }

  // Strokes at a node of the map for two seconds. Returns what the map's box says of it.
  playNode(speed, force) {
    byId("speed").value = speed;
    byId("force").value = force;
    this.showRanges();
    this.stroke.goesOn = true;
    this.touch();
    clearTimeout(this.lifting);
    this.lifting = setTimeout(() => this.letGo(), 2000);
    return "strokes here for two seconds";
  }

  toggleStroke() {
    clearTimeout(this.lifting);
    this.stroke.goesOn = !this.stroke.goesOn;
    this.touch();
    this.say(this.stroke.goesOn ? "a stroke that goes on" : "lifted");
  }

  // ---- Takes ----

  toggleTake() {
    if (this.isTaking) {
      this.endTake();
    } else if (this.choice().recording) {
      byId("take-text").textContent = "A take is of the synthesis: choose it first.";
    } else {
      this.isTaking = true;
      this.context?.resume();
      this.play(true);
    }
    byId("take").setAttribute("aria-pressed", this.isTaking);
  }

  endTake() {
    if (this.isTaking) this.node?.port.postMessage({ type: "take" });
    this.isTaking = false;
    byId("take").setAttribute("aria-pressed", false);
  }

  keepTake(take) {
    const name = this.surface.name.replaceAll(/[^\p{L}\p{N}]+/gu, "-");
    const csv = motionCsv(take);
    this.takes.push({ ...take, csv });
    this.onTake?.(this.takes.at(-1));
    const text = byId("take-text");
    text.replaceChildren(`${(take.words.length / take.rate).toFixed(1)} s, seed ${take.choice.seed}: `);
    const file = (label, action) => {
      const button = document.createElement("button");
      button.type = "button";
      button.className = "small";
      button.textContent = label;
      button.addEventListener("click", action);
      text.append(button, " ");
    };
    file("Motion, CSV", () => saveFile(`${name}.csv`, csv, "text/csv"));
    file("Sound, WAV", () => saveFile(`${name}.wav`, wavBytes(take), "audio/wav"));
    const isWhole = take.choice.without === 0;
    text.append(isWhole ? "stylus render plays the same samples along this motion." : "");
    this.isTaking = false;
    byId("take").setAttribute("aria-pressed", false);
  }

  // ---- Controls ----

  setUpControls() {
    const surfaces = byId("surfaces");
    this.surfaces.forEach(({ name, scene }, index) => {
      const text = scene === undefined ? name : `${name} (scene)`;
      surfaces.append(this.chip("surface", text, () => this.chooseSurface(index)));
    });
    if (this.surfaces.length > MOST_CHIPS) {
      surfaces.classList.add("many");
      byId("search-row").hidden = false;
      byId("search").addEventListener("input", ({ target }) => this.search(target.value));
      byId("search").addEventListener("keydown", ({ key }) => key === "Enter" && this.chooseShown(0));
      this.search("");
    }
    const keys = Math.min(9, this.surfaces.length);
    byId("surface-keys").hidden = keys < 2;
    for (const last of document.querySelectorAll(".last-surface")) last.textContent = keys;
    if (this.data.plant) this.setUpEnds(this.data.plant);
    for (const id of ["force", "speed", "volume", "scale"]) {
      byId(id).addEventListener("input", () => this.showRanges());
    }
    byId("seed").addEventListener("click", (event) => this.stepSeed(event.shiftKey ? -1 : 1));
    byId("mute").addEventListener("click", () => this.toggleMute());
    byId("take").addEventListener("click", () => this.toggleTake());
    byId("zoom").addEventListener("click", () => this.zoom());
    byId("clip-note").textContent = this.data.clip_note ?? "";
    byId("title").textContent = this.data.title;
  }

  setUpEnds({ name }) {
    const ends = { pin: "Pin", tip: `Tip of ${name}`, calibrated: "Tip, calibrated" };
    const chips = Object.entries(ends).map(([id, text]) => this.chip("end", text, () => this.chooseEnd(id)));
    chips[0].firstChild.checked = true;
    byId("ends").append(...chips);
    byId("ends-row").hidden = false;
  }

  chip(group, text, action) {
    const label = document.createElement("label");
    const input = document.createElement("input");
    input.type = "radio";
    input.name = group;
    input.addEventListener("change", action);
    label.append(input, text);
    return label;
  }

  // Sliders over what the grid has, a little below it and above.
  setRanges() {
    const { speeds_mm_s: speeds, forces_n: forces } = this.texture.data;
    const set = (id, values, digits) => {
      const range = byId(id);
      const value = Number(range.value);
      const isNew = !range.dataset.isSet;
      const [least, most] = [values[0], values.at(-1)];
      range.min = (0.5 * least).toFixed(digits);
      range.max = (1.2 * most).toFixed(digits);
      range.step = 10 ** -digits;
      range.value = isNew ? (least + most) / 2 : value;
      range.dataset.isSet = true;
    };
    set("force", forces, 2);
    set("speed", speeds, 0);
    this.showRanges();
  }

  showRanges() {
    byId("force-text").textContent = `${this.force.toFixed(2)} N`;
    byId("speed-text").textContent = `${this.keySpeed} mm/s`;
    this.tellVolume();
    this.showScale();
    this.tellHand();
  }

  showScale() {
    const scale = this.mmPerPx();
    const isScene = this.scenePath() !== null;
    byId("scale").disabled = isScene;
    byId("scale-text").textContent = `${scale.toFixed(3)} mm/px${isScene ? " (path)" : ""}`;
    const length = [100, 50, 20, 10, 5, 2].find((mm) => mm / scale < 0.4 * this.patch.width) ?? 1;
    byId("patch-bar").style.width = `${length / scale}px`;
    byId("patch-length").textContent = `${length} mm`;
  }

  showKinds() {
    const kinds = byId("kinds");
    for (const label of kinds.querySelectorAll("label")) label.remove();
    for (const { id, name } of this.kinds()) {
      const chip = this.chip("kind", name, () => this.chooseKind(id));
      chip.firstChild.checked = id === this.kind;
      kinds.append(chip);
    }
    const { look, name } = this.kinds().find(({ id }) => id === this.kind);
    this.waveform?.look(look);
    this.spectrumPicture?.look(look);
    for (const id of ["waveform-key", "spectrum-key"]) {
      byId(id).className = `key ${look}`;
      byId(id).textContent = name.toLowerCase();
    }
  }

  zoom() {
    const button = byId("zoom");
    const isOn = button.getAttribute("aria-pressed") !== "true";
    button.setAttribute("aria-pressed", isOn);
    byId("zoom-text").textContent = isOn ? "four times as high as the axis says" : "";
    this.waveform.gain = isOn ? 4 : 1;
  }

  say(text) {
    byId("said").textContent = text;
  }

  // ---- Pictures ----

  showMap() {
    const index = this.texture.index;
    if (this.mapOf === index) return;
    this.mapOf = index;
    this.map = new MapPicture(byId("map-picture"), this.texture);
    const { name, verdict, level_is_known: isKnown } = this.texture.data;
    for (const { axes } of [this.waveform, this.spectrumPicture, this.map]) showUnit(axes, isKnown);
    byId("verdict").textContent = verdict ? `${name}, beside its recordings: ${verdict}.` : "";
    // One node alone is no map.
    byId("map-picture").parentElement.hidden = this.texture.nodes.length === 1;
    const marks = [...this.map.marks].map((words) => ` A node with ${words}.`).join("");
    byId("map-text").textContent = `Click or tap a node for a stroke there. The ring is your speed and force of the
      moment; the frames are around the nodes whose models are mixed, at most four, thicker with more
      weight.${marks}`;
  }

  showPatch() {
    const path = this.scenePath();
    const scene = this.data.scenes[this.surface.scene];
    const bands = (path ? scene.regions : []).map(({ start_mm: start, end_mm: end, surface }) => ({
      from: (start - path.start) / (path.end - path.start),
      to: (end - path.start) / (path.end - path.start),
      surface,
    }));
    const { texture } = this.surface;
    if (texture === undefined) {
      this.patch.show(null, bands, false);
    } else {
      const { lines, codebooks } = this.textures[texture].data.can_leave_out;
      const whole = { from: 0, to: 1, surface: texture };
      this.patch.show(this.reliefs.get(texture) ?? null, [whole], codebooks || lines.length > 0);
    }
    const list = byId("regions");
    list.hidden = !path;
    list.replaceChildren(
      ...(path ? scene.regions : []).map((region) => {
        const item = document.createElement("li");
        const swatch = document.createElement("span");
        swatch.className = "swatch";
        swatch.style.background = `var(${SURFACE_COLOURS[region.surface % SURFACE_COLOURS.length]})`;
        const { texture } = scene.surfaces[region.surface];
        const name = texture === null ? "smooth" : this.textures[texture].name;
        item.append(swatch, `${name}, ${region.start_mm} to ${region.end_mm} mm`);
        return item;
      }),
    );
    this.showScale();
  }

  drawPictures() {
    const { played } = this;
    if (this.place) this.patch.move(this.place.x, this.place.y, this.touches);
    if (!played) return;
    byId("now-speed").textContent = `${Math.round(Math.abs(played.contact ? played.speed : 0))} mm/s`;
    byId("now-force").textContent = `${(played.contact ? played.force : 0).toFixed(2)} N`;
    const power = this.recent.reduce((sum, value) => sum + value * value, 0) / Math.max(1, this.recent.length);
    const level = this.texture.data.level_is_known ? shown(Math.sqrt(power), "m/s²") : "not known";
    byId("now-level").textContent = power > 0 ? level : "silent";
    this.waveform.draw(this.recent, this.rate);
    const voice = this.voice();
    this.drawSpectrum(voice);
    this.drawPlace(voice);
    if (played.clip !== null) {
      const node = this.texture.nodes[played.clip];
      byId("place-text").textContent = `The recording at ${short(node.speed_mm_s)} mm/s and ${short(node.force_n)} N,
        the nearest one.`;
    }
  }

  // The voice of the tool's texture. A recording has none, so its place on the grid stands for it.
  voice() {
    const { played, texture } = this;
    if (!played.contact) return null;
    if (!played.state) return placeOnGrid(texture.data, Math.abs(played.speed), played.force);
    return Kernel.voices(played.state).findLast((voice) => voice.texture >= 0) ?? null;
  }

  // What the model and the recording have at the place of the moment, to be compared with what sounds.
  beside() {
    const voice = this.voice();
    if (!voice) return {};
    const texture = this.textures[voice.texture] ?? this.texture;
    const gain = (this.data.scenes[this.surface.scene]?.surfaces[voice.surface]?.gain ?? 1) * voice.fade;
    const { clip } = this.played;
    const nodes = clip === null ? distinctNodes(voice) : [[clip, 1]];
    const heard = (kind) => texture.density(kind, nodes)?.map((density) => density * gain ** 2) ?? null;
    // A recording that sounds is its own spectrum.
    return { model: heard("model"), recorded: clip === null ? heard("recorded") : null };
  }

  drawSpectrum(voice) {
    // Until there is a first estimate, the place of the moment stands for itself.
    const isFirst = this.spectrum.density === null;
    if (!this.hasNewSpectrum && !(isFirst && voice)) return;
    const compared = isFirst ? this.beside() : this.spectrum.compared;
    const levels = (densities) => densities?.map((density) => 10 * Math.log10(density)) ?? null;
    this.spectrumPicture.draw("live", isFirst ? null : this.spectrum.levels());
    this.spectrumPicture.draw("model", levels(compared.model));
    this.spectrumPicture.draw("recorded", levels(compared.recorded));
    this.hasNewSpectrum = false;
    byId("recorded-key").hidden = this.played.clip !== null || this.texture.all("recorded") === null;
    byId("recorded-at").textContent = compared.recorded ? "" : " (of no node near)";
    byId("model-at").textContent = compared.model ? "" : " (silent)";
  }

  drawPlace(voice) {
    if (this.surface.scene !== undefined && this.under !== null && this.under !== undefined) this.showMap();
    const hasLines = this.texture.data.can_leave_out.lines.length > 0;
    const beyond = voice ? beyondGrid(this.texture.nodes, Math.abs(voice.speed), voice.force, hasLines) : "";
    const label = byId("patch-beyond");
    if (label.textContent !== beyond) {
      label.textContent = beyond;
      label.hidden = beyond === "";
      if (beyond) this.say(beyond);
    }
    if (!voice) {
      this.map.hide();
      byId("place-text").textContent = this.played.contact ? "A smooth surface." : "Nothing is touched.";
      return;
    }
    this.map.draw(voice);
    const fade = voice.fade < 1 ? ` Below the grid the level fades: ${Math.round(100 * voice.fade)} % are left.` : "";
    byId("place-text").textContent = `${this.texture.name} at ${Math.round(Math.abs(voice.speed))} mm/s and
      ${voice.force.toFixed(2)} N.${fade} ${beyond}`;
    const key = voice.nodes.join() + voice.weights.map((weight) => weight.toFixed(2)).join();
    if (key === this.shownNodes) return;
    this.shownNodes = key;
    const rows = distinctNodes(voice).map(([index, weight]) => {
      const node = this.texture.nodes[index];
      const cost = node.cost === null ? "–" : (100 * node.cost).toFixed(1);
      return [short(node.speed_mm_s), short(node.force_n), weight.toFixed(2), node.silent ? "silent" : node.order, cost];
    });
    byId("nodes").replaceChildren(
      ...rows.map((cells) => {
        const row = document.createElement("tr");
        cells.forEach((cell) => {
          const data = document.createElement("td");
          data.textContent = cell;
          data.className = "number";
          row.append(data);
        });
        return row;
      }),
    );
  }

  // ---- Facts ----

  latency() {
    const { context, node } = this;
    // On the page's own thread what is computed waits for the buffer before it.
    const bufferS = node?.bufferSize ? node.bufferSize / context.sampleRate : 0;
    return {
      pointerMs: this.delays.length > 0 ? median(this.delays) : null,
      longestMs: this.delays.length > 0 ? Math.max(...this.delays) : null,
      filterMs: this.filterMs,
      baseMs: 1000 * ((context?.baseLatency ?? 0) + bufferS),
      outputMs: 1000 * (context?.outputLatency ?? 0),
    };
  }

  // Times that the sound broke off: the browser's own count where it has one, and the worklet's.
  dropouts() {
    const stats = this.context?.playbackStats ?? this.context?.playoutStats;
    return { browser: stats?.underrunEvents ?? stats?.fallbackFramesEvents ?? null, gaps: this.played?.gaps ?? 0 };
  }

  showFacts() {
    const milliseconds = (value) => (value === null ? "not yet" : `${value.toFixed(value < 10 ? 1 : 0)} ms`);
    const latency = this.latency();
    const { ready, touched, heard } = this.times;
    const first = heard === null || touched === null ? null : heard - touched;
    const total = latency.filterMs + latency.baseMs + latency.outputMs;
    list("latency", [
      ["pointer to its first sample, median", milliseconds(latency.pointerMs)],
      ["longest of the last 400", milliseconds(latency.longestMs)],
      ["resampling to the output's rate", milliseconds(latency.filterMs)],
      ["browser's audio: processing", milliseconds(latency.baseMs)],
      ["browser's audio: output", milliseconds(latency.outputMs)],
      ["pointer to ear", latency.pointerMs === null ? "not yet" : milliseconds(latency.pointerMs + total), true],
      ["speed, its mean over 20 ms", "10 ms"],
      ["kernel ready after opening", milliseconds(ready)],
      ["first sample after the first touch", milliseconds(first)],
    ]);
    const { browser, gaps } = this.dropouts();
    const isKnown = this.data.textures.every((texture) => texture.level_is_known);
    list("level", [
      ["loudest without distortion", isKnown ? shown(this.fullScale, "m/s²") : "not known", true],
      ["samples beyond full scale, cut", String(this.clipped)],
      ["rate of the kernel", `${this.rate} Hz`],
      ["rate of the output", this.context ? `${this.context.sampleRate} Hz` : "not yet"],
      ["dropouts, by the browser", browser === null ? "not told" : String(browser)],
      ["gaps of the audio clock", String(gaps)],
    ]);
    const found = this.digests.get(this.surface.texture);
    const expected = this.data.digest.of_textures[this.surface.texture];
    const same = found && (found.digest === expected ? "the same" : `DIFFERENT: ${expected}`);
    list("bits", [
      ["seed", String(this.seed)],
      ["excitation", this.surface.scene === undefined ? this.texture.excitation() : "that of each surface"],
      ["samples of a fixed motion", this.data.digest.words.toLocaleString("en").replace(",", " ")],
      ["their digest on this page", found?.digest ?? (this.surface.scene === undefined ? "computing" : "of textures")],
      ["on the host that made it", found ? same : (expected ?? "–"), true],
      ["kernel", `${Math.round(this.data.kernel.bytes / 1000)} KB of WebAssembly`],
      ["built by", this.data.kernel.built_by],
      ["speed", found ? `${Math.round(found.timesRealTime)} times real time` : "computing"],
    ]);
  }

  // Computes the digest of the chosen texture, once, while nothing else is to do; and what the patch shows of it.
  async computeDigest() {
    const { texture } = this.surface;
    if (!this.newKernel || texture === undefined) return;
    // One after the other.
    this.computing = (this.computing ?? Promise.resolve()).then(async () => {
      const { digests, reliefs } = this;
      if (!reliefs.has(texture)) reliefs.set(texture, await reliefOf(this.newKernel(), this.textures[texture]));
      if (this.surface.texture === texture) this.showPatch();
      if (!digests.has(texture)) digests.set(texture, await digestOf(this.newKernel(), texture));
      this.showFacts();
    });
    await this.computing.catch((fault) => this.fail(fault.message));
  }

  // Draws on and on, as often as the reader wants to see things move.
  animate() {
    let due = 0;
    const frame = (now) => {
      if (now >= due) {
        due = now + 1000 / (this.isStill.matches ? STILL_PICTURES_PER_S : PICTURES_PER_S) - 4;
        this.drawPictures();
      }
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
    setInterval(() => this.showFacts(), 500);
  }
}

// Fills a list of facts: name, value, and true if it is the one to look at.
function list(id, facts) {
  const holder = byId(id);
  facts.forEach(([name, value, isStrong], index) => {
    let row = holder.children[index];
    if (!row) {
      row = document.createElement("div");
      row.append(document.createElement("dt"), document.createElement("dd"));
      holder.append(row);
    }
    const [term, text] = row.children;
    if (term.textContent !== name) term.textContent = name;
    if (text.textContent !== value) text.textContent = value;
    text.className = isStrong ? "strong" : "";
  });
}

// The four nodes around a speed and force with their bilinear weights, as the kernel finds them; for recordings, which
// the kernel does not play.
function placeOnGrid({ speeds_mm_s: speeds, forces_n: forces }, speed, force) {
  const along = (values, value) => {
    const after = values.findIndex((other) => other > value);
    if (after === 0 || values.length === 1) return [0, 0, 0];
    if (after === -1) return [values.length - 1, values.length - 1, 0];
    return [after - 1, after, (value - values[after - 1]) / (values[after] - values[after - 1])];
  };
  const [slow, fast, speedShare] = along(speeds, speed);
  const [light, hard, forceShare] = along(forces, force);
  const corners = [[slow, light], [slow, hard], [fast, light], [fast, hard]];
  const weights = [
    (1 - speedShare) * (1 - forceShare),
    (1 - speedShare) * forceShare,
    speedShare * (1 - forceShare),
    speedShare * forceShare,
  ];
  const nodes = corners.map(([s, f]) => s * forces.length + f);
  return { texture: -1, nodes, weights, speed, force, fade: 1 };
}

// What a texture plays along 100 mm, or for 3 s, at its middle speed and force, over twice its RMS: the patch's
// picture.
async function reliefOf(kernel, texture) {
  const { speeds_mm_s: speeds, forces_n: forces } = texture.data;
  const middle = (values) => (values[0] + values.at(-1)) / 2;
  const speed = middle(speeds);
  kernel.choose({ texture: texture.index, seed: 1 });
  const relief = [];
  const blocks = Math.min(1500, Math.round(100 / speed / BLOCK_S));
  for (let block = 0; block < blocks; block += 1) {
    if (block % DIGEST_BLOCKS === 0) await pause();
    kernel.motion.set([speed, middle(forces), NaN, NaN, 1]);
    kernel.run(1);
    relief.push(...kernel.samples.subarray(0, kernel.blockSamples));
  }
  const rms = Math.sqrt(relief.reduce((sum, value) => sum + value * value, 0) / relief.length);
  return Float32Array.from(relief, (value) => value / (2 * Math.max(rms, 1e-9)));
}

async function main() {
  if (!globalThis.AudioContext || !globalThis.WebAssembly) {
    const trouble = byId("trouble");
    trouble.textContent = "No sound: this browser has no audio or no WebAssembly. Open the page in a newer one.";
    trouble.hidden = false;
    return;
  }
  // The sound first, because it is made beside all else.
  const kernelBytes = bytesOfElement("kernel");
  const libraryBytes = bytesOfElement("library");
  const context = new AudioContext({ latencyHint: "interactive" });
  const sound = soundOf(context, kernelBytes, libraryBytes);
  const page = new RubPage(JSON.parse(byId("data").textContent));
  globalThis.rubPage = page;
  page.context = context;
  page.animate();
  const connected = sound.then((node) => page.connect(node)).catch((fault) => page.fail(fault.message ?? String(fault)));
  try {
    // On the page itself for digests and patches, when the sound is ready or does not come.
    const module = await WebAssembly.compile(kernelBytes);
    page.newKernel = () => new Kernel(module, libraryBytes);
    await Promise.race([connected, new Promise((resolve) => setTimeout(resolve, SOUND_DUE_MS))]);
    await page.computeDigest();
  } catch (fault) {
    page.fail(fault.message ?? String(fault));
    throw fault;
  }
}

main();
