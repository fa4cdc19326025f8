// Works the live view as an operator does, in headless Chromium: takes control, points, answers, stops. Prints one JSON object
// with what it saw. Arguments: the invitation's address, a folder for screenshots, the browser's program.
// SPDX-License-Identifier: Apache-2.0
import { chromium } from 'playwright-core';

const [, , address, folder, executablePath] = process.argv;
const browser = await chromium.launch({ executablePath, args: ['--no-sandbox'] });
const seen = { errors: [] };
try {
  const page = await browser.newPage({ viewport: { width: 1440, height: 960 } });
  page.on('pageerror', (error) => seen.errors.push(String(error)));
  page.on('console', (line) => line.type() === 'error' && seen.errors.push(line.text()));
  await page.goto(address);
  seen.addressAfter = page.url();
  await page.waitForFunction(() => document.querySelector('#top_camera')?.nextSibling.textContent.includes('frame'), null, { timeout: 60000 });
  await page.waitForFunction(() => document.body.textContent.includes('point at a place'), null, { timeout: 60000 });
  await page.waitForTimeout(3000);
  const clickAt = async (u, v) => {
    const box = await page.locator('#top_camera').boundingBox();
    await page.mouse.click(box.x + box.width * u, box.y + box.height * v);
  };
  await clickAt(0.6, 0.45); // without control: nothing happens
  await page.waitForTimeout(500);
  seen.withoutControl = await page.locator('#note').count();
  await page.click('#take');
  await page.waitForFunction(() => document.querySelector('#take').textContent === 'release control');
  await clickAt(0.6, 0.45);
  await page.waitForSelector('#note', { timeout: 10000 });
  seen.note = await page.textContent('#note');
  await page.waitForTimeout(4000);
  seen.distance = await page.textContent('#distance');
  await page.click('#zero');
  await page.keyboard.press('ArrowUp');
  await page.waitForTimeout(1500);
  await page.screenshot({ path: `${folder}/live_view.png` });
  await page.setViewportSize({ width: 820, height: 1180 });
  await page.waitForTimeout(700);
  await page.screenshot({ path: `${folder}/live_view_tablet.png` });
  const second = await browser.newPage(); // the invitation was used up
  seen.secondVisit = (await second.goto(address)).status();
  await page.bringToFront();
  await page.keyboard.press('Space');
  await page.waitForFunction(() => document.querySelector('#state').textContent.startsWith('ended:'), null, { timeout: 20000 });
  seen.state = await page.textContent('#state');
} catch (error) {
  seen.failed = String(error);
  seen.errors = seen.errors.slice(0, 3);
} finally {
  await browser.close();
}
console.log(JSON.stringify(seen));
