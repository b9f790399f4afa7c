// The page in a frame of an experiment's page, which begins and ends takes by messages and gets them the same way.

// Keys that stay a participant's: to stroke, and for force and speed.
const PARTICIPANT_KEYS = ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", " ", "+", "-", "Tab"];

// Tells the page around this one what happens, and does what it says. Without one, nothing.
function embed(page) {
  if (parent === globalThis) return;
  const tell = (message) => parent.postMessage({ stylus: "rub", ...message }, "*");
  const simulated = page.data.simulated;
  page.onTake = ({ choice, rate, words, csv }) => {
    const { name } = page.surfaces.find(({ texture, scene }) => texture === choice.texture && scene === choice.scene);
    const seconds = words.length / rate;
    tell({ type: "take", surface: name, seed: choice.seed, rate_hz: rate, seconds, simulated, csv });
  };
  const begin = ({ surface, kind, seed, whole_page: isWhole }) => {
    const index = page.surfaces.findIndex(({ name }) => name === surface);
    if (index < 0) throw new Error(`no texture and no scene '${surface}': ${page.surfaces.map(({ name }) => name)}`);
    document.body.classList.toggle("patch-alone", !isWhole);
    page.letGo();
    page.chooseSurface(index);
    if (!page.kinds().some(({ id, recording }) => id === kind && !recording)) {
      throw new Error(`'${surface}' has no kind '${kind}' that a take can be of`);
    }
    page.endTake();
    page.seed = seed;
    page.chooseKind(kind);
    // The sound itself begins with the first touch, because a browser lets none begin before.
    page.isTaking = true;
    page.play(true);
    tell({ type: "begun" });
  };
  addEventListener("message", ({ source, data }) => {
    if (source !== parent || data?.stylus !== "rub") return;
    try {
      if (data.type === "begin") begin(data);
      else if (data.type === "end") page.endTake();
    } catch (fault) {
      tell({ type: "fault", text: fault.message });
    }
  });
  const isBarred = ({ key }) => document.body.classList.contains("patch-alone") && !PARTICIPANT_KEYS.includes(key);
  addEventListener("keydown", (event) => isBarred(event) && event.stopImmediatePropagation(), true);
  tell({ type: "ready" });
}
