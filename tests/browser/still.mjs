// A still of the page to rub while its last texture is rubbed, for the README.
//
//   STYLUS_NODE_MODULES=MODULES node tests/browser/still.mjs PAGE.html OUT.png

import path from "node:path";

import { Opened, launched } from "./chromium.mjs";

const [page, out] = process.argv.slice(2);
if (!page || !out) {
  console.error("usage: node tests/browser/still.mjs PAGE.html OUT.png");
  process.exit(2);
}
const browser = await launched();
const opened = await Opened.open(browser, path.resolve(page), { viewport: { width: 1000, height: 1145 } });
await opened.press(String(await opened.value(() => rubPage.textures.length)));
await opened.rub(3, { lifts: false });
await opened.page.screenshot({ path: out });
await browser.close();
