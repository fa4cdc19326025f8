// Pictures of the live view for the docs, of a run that goes on: takes control, steers, draws, measures, pauses, stops, and takes
// a picture of each. Arguments: the invitation's address, the folder of the pictures, the browser's program
// (cmake/live_pictures.py starts both).
// SPDX-License-Identifier: Apache-2.0
import { chromium } from 'playwright-core';

const [, , address, folder, executablePath] = process.argv;
const browser = await chromium.launch({ executablePath, args: ['--no-sandbox'] });
const context = await browser.newContext({ viewport: { width: 1366, height: 768 } });
const page = await context.newPage();
const patience = { timeout: 120000 };
const made = [];

async function picture(name, size = [1366, 768]) {
  await page.setViewportSize({ width: size[0], height: size[1] });
  await page.waitForTimeout(1200); // two pictures of the camera at the new size
  await page.screenshot({ path: `${folder}/live_view_${name}.jpg`, type: 'jpeg', quality: 82 });
  made.push(name);
  await page.setViewportSize({ width: 1366, height: 768 });
}
const at = async (u, v) => {
  const box = await page.locator('#top_camera').boundingBox();
  return [box.x + box.width * u, box.y + box.height * v];
};
const state = (kind) => page.waitForSelector(`#state[data-kind='${kind}']`, patience);
const says = (words) => page.waitForFunction((text) => document.body.textContent.includes(text), words, patience);

async function begin(words) {
  await page.waitForSelector('#top_camera[data-frame]', patience);
  await says(words);
}

async function steer() {
  await begin('point at a place');
  await page.waitForTimeout(3000);
  await picture('watching');
  await page.click('#take');
  await page.waitForSelector('.who', { state: 'attached' });
  await page.mouse.click(...(await at(0.62, 0.42)));
  await page.waitForTimeout(6000);
  await picture('running', [1920, 1080]);
  await picture('tablet', [768, 1024]);
  await picture('phone', [390, 844]);
  await page.mouse.move(...(await at(0.62, 0.42)));
  await page.mouse.down();
  for (let i = 1; i <= 24; ++i) await page.mouse.move(...(await at(0.62 - 0.22 * Math.sin(i / 8), 0.42 + 0.006 * i)));
  await page.mouse.up();
  await page.waitForTimeout(5000);
  await picture('path');
  await page.keyboard.press('i');
  await page.waitForSelector('#instruments .knob', patience);
  await page.waitForTimeout(2500);
  await picture('instruments');
  await page.keyboard.press('i');
  await page.keyboard.press('m');
  await page.mouse.move(...(await at(0.35, 0.65)));
  await page.mouse.down();
  await page.mouse.move(...(await at(0.55, 0.6)), { steps: 5 });
  await page.mouse.up();
  await page.mouse.move(...(await at(0.7, 0.7)));
  await page.waitForTimeout(500);
  await picture('ruler');
  await page.keyboard.press('0');
  await page.keyboard.press('t');
  await page.keyboard.press('c');
  await page.waitForSelector('#light-panel rect', patience);
  await page.click('#light-panel button');
  await picture('contrast');
  await page.locator('#light-panel button').nth(1).click();
  await page.keyboard.press('c');
  await page.click('#more');
  await page.click('#theme');
  await picture('light');
  await page.click('#more');
  await picture('menu');
  await page.click('#theme');
  await page.keyboard.press('p');
  await state('paused');
  await picture('paused');
  await page.keyboard.press('p');
  await state('running');
  await page.keyboard.press('Space');
  await state('ended');
  await page.waitForSelector('#report', patience);
  await picture('ended');
}

try {
  await page.goto(address);
  await steer();
} catch (error) {
  await page.screenshot({ path: `${folder}/failed.png` }).catch(() => {});
  console.log(String(error));
} finally {
  await browser.close();
}
console.log(made.join(', '));
