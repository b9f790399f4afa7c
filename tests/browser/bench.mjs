// A browser, and a folder for files, for as long as the tests of one file run: each of these runs in its own process.

import fs from "node:fs";
import os from "node:os";
import path from "node:path";
import { after, before } from "node:test";

import { launched } from "./chromium.mjs";

export const folder = fs.mkdtempSync(path.join(os.tmpdir(), "stylus-browser-"));
export let browser;

before(async () => {
  browser = await launched();
});

after(async () => {
  await browser.close();
  fs.rmSync(folder, { recursive: true });
});
