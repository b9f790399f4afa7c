// Two plugins for jsPsych 8 around pages that the command `stylus` writes, which stand in a frame: jsPsychStylusRub
// around the page of `stylus page`, and jsPsychStylusCompare around that of `stylus compare`. Load it after jsPsych.
//
// Pages and experiment talk by messages, so that files from a folder do, without a server and without a network.

const [jsPsychStylusRub, jsPsychStylusCompare] = (() => {
  const { BOOL, COMPLEX, FLOAT, HTML_STRING, INT, STRING } = jsPsychModule.ParameterType;

  // Time to wait for a take after its end, ms. Who never touched the patch leaves none.
  const LAST_MS = 1000;

  function framed(page) {
    const frame = document.createElement("iframe");
    frame.src = page;
    frame.title = "Stylus";
    // The sound may begin by what is pressed around the frame, too.
    frame.allow = "autoplay";
    frame.style.border = "0";
    return frame;
  }

  // Calls `hear` with each message of this kind of page in `frame`, until the function that is returned is called.
  function listening(frame, kind, hear) {
    const listener = ({ source, data }) => {
      if (source === frame.contentWindow && data?.stylus === kind) hear(data);
    };
    addEventListener("message", listener);
    return () => removeEventListener("message", listener);
  }

  // A trial in which one texture or scene is rubbed. Its data is a take: what `stylus render --motion` plays again.
  class Rub {
    static info = {
      name: "stylus-rub",
      version: "1.0.0",
      parameters: {
        // Address of the page that `stylus page` has written.
        page: { type: STRING, default: undefined },
        // Name of the texture or scene.
        texture: { type: STRING, default: undefined },
        // What it is played as: synthesis, gaussian or no-lines.
        kind: { type: STRING, default: "synthesis" },
        seed: { type: INT, default: 1 },
        // Shows the whole page; else the patch alone, which names nothing.
        whole_page: { type: BOOL, default: false },
        prompt: { type: HTML_STRING, default: "" },
        button_label: { type: STRING, default: "Continue" },
        // Longest time from the moment at which the patch can be rubbed, s; null: until the button is pressed.
        duration_s: { type: FLOAT, default: null },
        height: { type: STRING, default: "24rem" },
      },
      data: {
        texture: { type: STRING },
        kind: { type: STRING },
        seed: { type: INT },
        // Time from the trial's begin until the patch could be rubbed, and from then to the trial's end, ms.
        ready_ms: { type: INT },
        rt: { type: INT },
        // Of the take: sample rate, Hz; length, s; the motion, a table of time_s, speed_mm_s, force_n, position_mm and
        // contact every 2 ms, as text; and whether the texture is of simulated recordings. Null without a take.
        rate_hz: { type: INT },
        take_s: { type: FLOAT },
        motion_csv: { type: STRING },
        simulated: { type: BOOL },
      },
    };

    constructor(jsPsych) {
      this.jsPsych = jsPsych;
    }

    trial(display, { page, texture, kind, seed, whole_page, prompt, button_label, duration_s, height }) {
      const begin = performance.now();
      const frame = framed(page);
      Object.assign(frame.style, { display: "block", width: "min(92vw, 60rem)", height });
      const words = document.createElement("div");
      words.innerHTML = prompt;
      const button = Object.assign(document.createElement("button"), { className: "jspsych-btn", disabled: true });
      button.textContent = button_label;
      display.append(words, frame, button);
      const say = (message) => frame.contentWindow.postMessage({ stylus: "rub", ...message }, "*");
      let ready = null;
      let end = null;
      const finish = (take) => {
        stopListening();
        this.jsPsych.pluginAPI.clearAllTimeouts();
        const { rate_hz = null, seconds: take_s = null, csv: motion_csv = null, simulated = null } = take ?? {};
        const times = { ready_ms: Math.round(ready - begin), rt: Math.round(end - ready) };
        this.jsPsych.finishTrial({ texture, kind, seed, ...times, rate_hz, take_s, motion_csv, simulated });
      };
      const stop = () => {
        if (end !== null) return;
        end = performance.now();
        button.disabled = true;
        say({ type: "end" });
        this.jsPsych.pluginAPI.setTimeout(() => finish(null), LAST_MS);
      };
      const stopListening = listening(frame, "rub", (message) => {
        if (message.type === "ready") {
          say({ type: "begin", surface: texture, kind, seed, whole_page });
        } else if (message.type === "begun") {
          ready = performance.now();
          button.disabled = false;
          if (duration_s !== null) this.jsPsych.pluginAPI.setTimeout(stop, 1000 * duration_s);
        } else if (message.type === "take" && ready !== null) {
          // A take that is as long as a page keeps ends by itself.
          end ??= performance.now();
          finish(message);
        } else if (message.type === "fault") {
          words.textContent = `This trial cannot begin: ${message.text}`;
        }
      });
      button.addEventListener("click", stop);
    }
  }

  // Frames of listening tests that go on, by address: one trial is one answer, and the page keeps its place.
  const frames = new Map();

  // A trial of a listening test. Its data is a row of the page's own table. `timeline` below is the whole test.
  class Compare {
    static info = {
      name: "stylus-compare",
      version: "1.0.0",
      parameters: {
        // Address of the page that `stylus compare` has written.
        page: { type: STRING, default: undefined },
      },
      data: {
        // The columns of the page's table, and whether the page has no further trial.
        answer: { type: COMPLEX },
        is_last: { type: BOOL },
        rt: { type: INT },
      },
    };

    // All trials of the page.
    static timeline(page) {
      return { timeline: [{ type: Compare, page }], loop_function: (data) => !data.values().at(-1).is_last };
    }

    constructor(jsPsych) {
      this.jsPsych = jsPsych;
    }

    trial(_display, { page }) {
      const begin = performance.now();
      if (!frames.has(page)) {
        const frame = framed(page);
        // Outside of what jsPsych clears between trials, because a frame that is moved begins anew.
        frame.style.cssText += "position: fixed; inset: 0; width: 100%; height: 100%; background: Canvas";
        document.body.append(frame);
        frames.set(page, frame);
      }
      const frame = frames.get(page);
      frame.hidden = false;
      frame.focus();
      const stopListening = listening(frame, "compare", ({ csv, is_last }) => {
        stopListening();
        frame.hidden = true;
        if (is_last) {
          frame.remove();
          frames.delete(page);
        }
        const rt = Math.round(performance.now() - begin);
        this.jsPsych.finishTrial({ ...lastRow(csv), is_last, rt });
      });
    }
  }

  // The last row of a table, by the names of its columns.
  function lastRow(csv) {
    const lines = csv.trim().split("\n");
    const cells = [...lines.at(-1).matchAll(/(?:^|,)(?:"((?:[^"]|"")*)"|([^,]*))/g)];
    const values = cells.map(([, quoted, plain]) => quoted?.replaceAll('""', '"') ?? numberOr(plain));
    return Object.fromEntries(lines[0].split(",").map((name, index) => [name, values[index]]));
  }

  function numberOr(text) {
    return String(Number(text)) === text ? Number(text) : text;
  }

  return [Rub, Compare];
})();
