// A first look at the live view: points at a place beside the robot and ends when the robot is seen to have moved there, by the
// page's own table. Arguments: the invitation's address, the browser's program, a picture's file.
// SPDX-License-Identifier: Apache-2.0
import { chromium } from 'playwright-core';

const [, , address, executablePath, picture] = process.argv;
const patience = { timeout: 60000 };
const kMoved = 0.5; // mm; the place pointed at is 2 mm aside
const browser = await chromium.launch({ executablePath, args: ['--no-sandbox'] });
const page = await browser.newPage({ viewport: { width: 1366, height: 768 } });
await page.goto(address);
await page.waitForFunction(() => document.querySelector('#top_camera')?.dataset.frame, null, patience);
await page.waitForFunction(() => document.body.textContent.includes('point at a place'), null, patience);

/** Where the page says that the robot is, mm: x and y of the table's row. */
const robot = async () => {
  const row = await page.locator('tr.robot').first().innerText(patience);
  return row.replaceAll('\u2212', '-').match(/-?\d+\.\d+/g).slice(0, 2).map(Number);
};
const way = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);

const before = await robot();
await page.click('#take');
await page.waitForSelector('.who', { state: 'attached' });
const box = await page.locator('#top_camera').boundingBox();
await page.mouse.click(box.x + box.width * 0.6, box.y + box.height * 0.45);
let now = before;
for (let i = 0; i < 150 && way(before, now) < kMoved; ++i) {
  await page.waitForTimeout(200);
  now = await robot();
}
console.log(JSON.stringify({ before, now, moved: way(before, now) }));
if (picture) await page.screenshot({ path: picture });
await page.keyboard.press('Space'); // STOP
await browser.close();
process.exit(way(before, now) < kMoved ? 1 : 0);
