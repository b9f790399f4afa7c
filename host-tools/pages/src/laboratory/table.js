// The table of recordings: a row for each, which is a row of the list that the command reads.

// Columns that can be filled in: key, heading, width in letters, and whether it is shown only on request.
const COLUMNS = [
  ["texture", "texture", 11],
  ["speed_mm_s", "speed, mm/s", 6],
  ["force_n", "force, N", 6],
  ["scale_m_s2", "unit", 7],
  ["start_s", "start, s", 5, true],
  ["duration_s", "length used, s", 5, true],
  ["sample_rate_hz", "sample rate, Hz", 6, true],
  ["time_unit", "unit of times", 5, true],
  ["even_times", "even times", 5, true],
  ["simulated", "simulated", 5, true],
];

const NEEDED = ["texture", "speed_mm_s", "force_n"];

// The command's words with this table's columns in place of its options and of its list's columns.
function inColumns(text) {
  const found = text.replace(/--([a-z-]+)|\b[a-z]+(_[a-z0-9]+)+\b/g, (word, option) => {
    const named = (key) => (option ? key.startsWith(option.replaceAll("-", "_")) : key === word);
    const heading = COLUMNS.find(([key]) => named(key))?.[1];
    return heading ? `"${heading}"` : word;
  });
  return found.replace(/, or (give )?"[^"]*" in the list/, "");
}

class Table {
  // `onChange` is told the row, and the column that was changed.
  constructor(onChange) {
    this.onChange = onChange;
    this.rows = new Map();
    const heads = [["use"], ["file"], ...COLUMNS.map(([, heading, , isMore]) => [heading, isMore])];
    const tail = [["length, s"], ["RMS, m/s²"], ["waveform"], ["verdicts"]];
    for (const [text, isMore] of [...heads, ...tail]) {
      byId("heads").append(element("th", { scope: "col", className: isMore ? "more" : "" }, text));
    }
  }

  show(rows, looked) {
    this.rows.clear();
    byId("rows").replaceChildren(...rows.map((row) => this.made(row)));
    rows.forEach((row) => this.look(row, looked[row.file]));
    byId("table").hidden = rows.length === 0;
  }

  made(row) {
    const use = element("input", { type: "checkbox", checked: row.use, "aria-label": `use ${row.file}` });
    use.addEventListener("change", () => {
      row.use = use.checked;
      this.onChange(row, "use");
    });
    // Names are broken behind signs rather than within words.
    const name = row.file.split(/(?<=[/_])/).flatMap((part) => [part, element("wbr")]);
    const line = element("tr", {}, element("td", {}, use), element("td", { className: "file" }, ...name));
    const inputs = {};
    for (const [key, heading, size, isMore] of COLUMNS) {
      const input = element("input", { value: row[key], size, "aria-label": `${heading} of ${row.file}` });
      if (NEEDED.includes(key)) input.required = true;
      input.addEventListener("change", () => {
        row[key] = input.value.trim();
        this.onChange(row, key);
      });
      inputs[key] = input;
      line.append(element("td", { className: isMore ? "more" : "" }, input));
    }
    const [length, level, picture, words] = [0, 1, 2, 3].map(() => element("td"));
    line.append(length, level, picture, words);
    this.rows.set(row.file, { line, inputs, length, level, picture, words });
    return line;
  }

  // Shows what is in the recording of a row: { seconds, … }, { fault }, or nothing yet.
  look(row, looked) {
    const own = this.rows.get(row.file);
    if (!own || !looked) return;
    own.length.textContent = looked.fault ? "" : looked.seconds.toFixed(2);
    own.level.textContent = looked.fault ? "" : (looked.rms_m_s2?.toPrecision(3) ?? "not known");
    own.picture.replaceChildren(...(looked.fault ? [] : [waveform(looked.waveform)]));
    const words = looked.fault ? [looked.fault] : looked.verdicts;
    own.words.replaceChildren(...words.map((text) => element("p", {}, inColumns(text))));
    own.line.classList.toggle("faulty", Boolean(looked.fault));
  }

  // Marks the row at this index of those that are used, because the list cannot have it.
  point(row) {
    for (const { line } of this.rows.values()) line.classList.remove("refused");
    if (!row) return;
    const { line, inputs } = this.rows.get(row.file);
    line.classList.add("refused");
    (NEEDED.map((key) => inputs[key]).find(({ value }) => value === "") ?? inputs.texture).focus();
  }

  fill(row, key, value) {
    row[key] = value;
    this.rows.get(row.file).inputs[key].value = value;
  }
}

function waveform(columns) {
  const canvas = element("canvas", { width: 2 * columns.length, height: 40, "aria-hidden": "true" });
  const pen = canvas.getContext("2d");
  pen.fillStyle = getComputedStyle(document.documentElement).getPropertyValue("--blue");
  columns.forEach(([low, high], at) => pen.fillRect(2 * at, 20 - 20 * high, 2, Math.max(1, 20 * (high - low))));
  return canvas;
}
