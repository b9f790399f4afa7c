// A page in a headless Chromium without a network, by playwright-core.

import { spawnSync } from "node:child_process";
import { createRequire } from "node:module";
import path from "node:path";

import { virtualTime } from "./time.mjs";

// What only a fault needs, on however busy a computer.
const PATIENCE_MS = 600_000;

const { chromium } = createRequire(path.join(process.env.STYLUS_NODE_MODULES, "package.json"))("playwright-core");

// The first of these programs that is there, unless STYLUS_BROWSER names one.
function program() {
  if (process.env.STYLUS_BROWSER) return process.env.STYLUS_BROWSER;
  for (const name of ["chromium", "chromium-browser", "google-chrome"]) {
    const found = spawnSync("sh", ["-c", `command -v ${name}`], { encoding: "utf8" });
    if (found.status === 0) return found.stdout.trim();
  }
  throw new Error("install Chromium, or name a browser in STYLUS_BROWSER");
}

export function launched(more = []) {
  return chromium.launch({
    executablePath: program(),
    timeout: PATIENCE_MS,
    args: ["--no-sandbox", "--autoplay-policy=user-gesture-required", "--disable-dev-shm-usage", ...more],
  });
}

// A telephone, as options of a page.
export const PHONE = { viewport: { width: 400, height: 800 }, hasTouch: true, isMobile: true };

export class Opened {
  // Opens the file at `place`, as if it came from `address` if that is given, in virtual time unless `isReal`. Nothing
  // but that file can be reached.
  static async open(browser, place, options = {}, { waits = true, isReal = false, init, address } = {}) {
    const context = await browser.newContext({ offline: true, viewport: { width: 1240, height: 1000 }, ...options });
    context.setDefaultTimeout(PATIENCE_MS);
    const page = await context.newPage();
    if (!isReal) await page.addInitScript(virtualTime);
    if (init) await page.addInitScript(init);
    const opened = new Opened(context, page, isReal);
    const own = address ?? `file://${place}`;
    if (address) await context.route(address, (route) => route.fulfill({ path: place, contentType: "text/html" }));
    // Data of the page itself is no request of the network.
    page.on("request", (request) => {
      const [url] = request.url().split("#");
      if (url !== own && !url.startsWith("data:")) opened.requests.push(url);
    });
    page.on("console", (message) => {
      if (["error", "warning"].includes(message.type())) opened.complaints.push(message.text());
    });
    page.on("pageerror", (fault) => opened.complaints.push(String(fault)));
    await page.goto(own);
    if (waits) await opened.loaded(() => globalThis.rubPage?.newKernel && rubPage.node && rubPage.times.ready !== null);
    return opened;
  }

  constructor(context, page, isReal) {
    this.context = context;
    this.page = page;
    this.isReal = isReal;
    this.requests = [];
    this.complaints = [];
  }

  close() {
    return this.context.close();
  }

  value(action, argument) {
    return this.page.evaluate(action, argument);
  }

  // Waits for what takes no time of the page: work that the browser does beside it.
  async loaded(condition, argument) {
    const begin = Date.now();
    while (!(await this.value(condition, argument))) {
      if (Date.now() > begin + PATIENCE_MS) throw new Error(`never: ${condition}`);
      await new Promise((resolve) => setTimeout(resolve, 20));
    }
  }

  // Waits for what the page does in its time: in virtual time for a minute at most.
  async wait(condition, argument) {
    if (this.isReal) return this.loaded(condition, argument);
    for (let ms = 0; !(await this.value(condition, argument)); ms += 10) {
      if (ms > 60_000) throw new Error(`not within a minute: ${condition}`);
      await this.advance(10);
    }
  }

  // Lets virtual time pass, in all frames.
  async advance(ms) {
    for (const frame of this.page.frames()) {
      await frame.evaluate((ms) => stylusTime.advance(ms), ms).catch((fault) => {
        // A frame that comes or goes meanwhile has no time.
        if (frame === this.page.mainFrame() || !/destroyed|detached/.test(fault.message)) throw fault;
      });
    }
  }

  press(key) {
    return this.page.keyboard.press(key);
  }

  down(key) {
    return this.page.keyboard.down(key);
  }

  up(key) {
    return this.page.keyboard.up(key);
  }

  move(x, y) {
    return this.page.mouse.move(x, y);
  }

  click(x, y) {
    return this.page.mouse.click(x, y);
  }

  box(selector) {
    return this.page.locator(selector).boundingBox();
  }

  async devtools(method, parameters) {
    this.session ??= await this.context.newCDPSession(this.page);
    return this.session.send(method, parameters);
  }

  // Rubs the patch for `seconds` of virtual time. Returns what `probe` found after each move.
  rub(seconds, { reach = 0.3, lifts = true, probe = () => null } = {}) {
    const how = `{ reach: ${reach}, lifts: ${lifts}, probe: ${probe} }`;
    return this.value(`stylusTime.rub(${seconds}, ${how})`);
  }

  // Pairs of texts whose boxes overlap, in the page and in each of its pictures.
  overlaps() {
    return this.value(() => {
      const isText = (node) => node.nodeType === 3 && node.textContent.trim() !== "";
      const own = (element) => [...element.childNodes].some(isText);
      const unseen = ".hidden-text, [aria-hidden=true], script, style, noscript, template";
      const hidden = (element) => element.closest(unseen);
      const texts = [...document.body.querySelectorAll("*")].filter((e) => own(e) && e.checkVisibility() && !hidden(e));
      const boxes = texts.flatMap((element) => {
        const range = document.createRange();
        return [...element.childNodes]
          .filter(isText)
          .flatMap((node) => {
            range.selectNodeContents(node);
            return [...range.getClientRects()].map((box) => ({ box, text: node.textContent.trim(), element }));
          });
      });
      const found = [];
      boxes.forEach((a, index) => {
        for (const b of boxes.slice(index + 1)) {
          const wide = Math.min(a.box.right, b.box.right) - Math.max(a.box.left, b.box.left);
          const high = Math.min(a.box.bottom, b.box.bottom) - Math.max(a.box.top, b.box.top);
          // Line boxes are higher than their letters.
          if (wide > 1.5 && high > 0.35 * Math.min(a.box.height, b.box.height) && a.text !== b.text) {
            found.push(`'${a.text.slice(0, 40)}' and '${b.text.slice(0, 40)}'`);
          }
        }
      });
      return found;
    });
  }

  // The least contrast of visible texts with their ground (WCAG 2.1, 1.4.3), and that text.
  leastContrast() {
    return this.value(() => {
      const rgb = (text) => text.match(/[\d.]+/g).map(Number);
      const linear = (v) => (v / 255 <= 0.03928 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4);
      const luminance = (c) => 0.2126 * linear(c[0]) + 0.7152 * linear(c[1]) + 0.0722 * linear(c[2]);
      const ground = (element) => {
        for (let e = element; e; e = e.parentElement) {
          const c = rgb(getComputedStyle(e).backgroundColor);
          if (c.length === 3 || c[3] === 1) return c;
        }
        return [255, 255, 255];
      };
      let least = [100, ""];
      for (const e of document.body.querySelectorAll("*")) {
        const own = [...e.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim() !== "");
        const unseen = e.closest("script, style, noscript, template, defs, .hidden-text");
        if (!own || !e.checkVisibility() || unseen) continue;
        // Text on a cell of a map has the cell for its ground.
        if (e instanceof SVGElement && ["#FFFFFF", "#292929"].includes(e.getAttribute("fill"))) continue;
        const style = getComputedStyle(e);
        const [a, b] = [luminance(rgb(e instanceof SVGElement ? style.fill : style.color)), luminance(ground(e))];
        const contrast = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
        if (contrast < least[0]) least = [contrast, e.textContent.trim().slice(0, 60)];
      }
      return least;
    });
  }

  // What does not suit a finger: controls less than 44 pixels high, and keys, which it has not.
  unfitForFingers() {
    return this.value(() => {
      const seen = (what) => [...document.querySelectorAll(what)].filter((e) => e.checkVisibility());
      const high = (e) => (e.closest(".chips label") ?? e).getBoundingClientRect().height;
      const low = seen("button, input, summary, nav a, audio").filter((e) => high(e) < 44);
      return [...low, ...seen("kbd, .keys-hint")].map((e) => e.outerHTML.slice(0, 100));
    });
  }

  // Controls that a screen reader could not name.
  unnamed() {
    return this.value(() =>
      [...document.querySelectorAll("button, input, select, [tabindex], [role]")]
        .filter((e) => e.checkVisibility())
        .filter((e) => {
          const labelled = e.getAttribute("aria-labelledby");
          const name = e.getAttribute("aria-label") ?? (labelled && document.getElementById(labelled)?.textContent) ??
            e.labels?.[0]?.textContent ?? e.textContent;
          return !name?.trim() && !["status", "alert"].includes(e.getAttribute("role"));
        })
        .map((e) => e.outerHTML.slice(0, 100)),
    );
  }
}
