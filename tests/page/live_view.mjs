// Works the live view as an operator does, in headless Chromium: takes control, points, draws, answers, pauses, stops. Prints
// one JSON object with what it saw. Arguments: the invitation's address, a folder for screenshots, the browser's program, and
// what to do: steer, answer or supervise.
// SPDX-License-Identifier: Apache-2.0
import { chromium } from 'playwright-core';

const [, , address, folder, executablePath, task] = process.argv;
const browser = await chromium.launch({ executablePath, args: ['--no-sandbox'] });
const seen = { errors: [] };
const patience = { timeout: 60000 };

const says = (page, words) => page.waitForFunction((text) => document.body.textContent.includes(text), words, patience);
const state = (page, kind) => page.waitForSelector(`#state[data-kind='${kind}']`, patience);
const frames = (page) => page.waitForFunction(() => document.querySelector('#top_camera')?.dataset.frame, null, patience);
const plainMinus = (text) => text.replaceAll('\u2212', '-');

async function takeControl(page) {
  await page.click('#take');
  await page.waitForSelector('.who', { state: 'attached' });
}

/** How many pixels of the drawing about a place of it are as white as a path that is drawn. */
const white = (page, u, v) =>
  page.evaluate(([u, v]) => {
    const canvas = document.querySelector('#top_camera');
    const side = 8;
    const { data } = canvas.getContext('2d').getImageData(u * canvas.width - side / 2, v * canvas.height - side / 2, side, side);
    let count = 0;
    for (let i = 0; i < data.length; i += 4) if (Math.min(data[i], data[i + 1], data[i + 2]) > 240) ++count;
    return count;
  }, [u, v]);

async function steer(page) {
  await frames(page);
  await says(page, 'point at a place');
  const at = async (u, v) => {
    const box = await page.locator('#top_camera').boundingBox();
    return [box.x + box.width * u, box.y + box.height * v];
  };
  await page.mouse.click(...(await at(0.6, 0.45))); // without control: it is said why nothing happens
  seen.withoutControl = await page.textContent('#note', { timeout: 10000 });
  await takeControl(page);
  // The hand on the SpaceMouse (the rig file's) pushes up now and then, and nobody touches the page: the depth that is aimed at rises.
  const aim = async () => plainMinus(await page.textContent('#aim'));
  seen.aimBefore = await aim();
  await page.waitForFunction((before) => document.querySelector('#aim').textContent.replaceAll('\u2212', '-') !== before, seen.aimBefore, patience);
  await page.waitForTimeout(2500); // a push takes 1 s
  seen.aimAfter = await aim();
  await page.mouse.click(...(await at(0.6, 0.45)));
  await page.waitForFunction(() => document.querySelector('#note')?.textContent.startsWith('target '), null, { timeout: 10000 });
  seen.note = await page.textContent('#note');
  seen.whiteBefore = await white(page, 0.5, 0.5);
  await page.mouse.move(...(await at(0.4, 0.5)));
  await page.mouse.down();
  await page.mouse.move(...(await at(0.5, 0.5)), { steps: 12 });
  await page.mouse.move(...(await at(0.55, 0.6)), { steps: 12 });
  for (let i = 0; i < 100 && !((seen.whiteDrawing = await white(page, 0.5, 0.5)) > 2); ++i) await page.waitForTimeout(100);
  await page.screenshot({ path: `${folder}/live_view_path.png` });
  await page.mouse.up();
  await says(page, 'the first of ');
  seen.distance = await page.textContent('#distance');
  seen.markup = await page.evaluate(() => [...document.querySelectorAll('b')].some((b) => b.textContent === 'Bold'));
  await page.keyboard.press('z');
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
  await state(page, 'ended');
  seen.state = await page.textContent('#state');
  seen.rest = await page.textContent('.message .rest');
  seen.coils = await page.locator('.coil .value').allTextContents();
  seen.acting = await page.locator('#stop, #take, #pause, .jog button').count();
  const path = await page.getAttribute('#report', 'href', patience);
  const report = await page.context().newPage();
  await report.goto(new URL(path, page.url()).href);
  seen.report = await report.textContent('h1');
  await page.screenshot({ path: `${folder}/live_view_ended.png` });
}

async function answer(page) {
  await says(page, 'Is the eye fixed?');
  seen.lookingOn = await page.locator('#question button').first().isDisabled();
  await takeControl(page);
  await page.screenshot({ path: `${folder}/live_view_question.png` });
  await page.locator('#question button', { hasText: 'yes' }).click();
  await says(page, 'How high?');
  await page.fill('#question input', '5 A'); // of the wrong kind: the question stays
  await page.locator('#question button').click();
  await page.waitForSelector('#note', { timeout: 10000 });
  seen.wrong = await page.textContent('#note');
  await page.fill('#question input', '1.5 mm');
  await page.locator('#question button').click();
  await says(page, 'Which eye?');
  await page.locator('#question button', { hasText: 'left' }).click();
  await says(page, 'step 3');
  await page.click('#pause');
  await state(page, 'paused');
  const newestStep = () => Math.max(0, ...[...document.querySelectorAll('.log li')].map((li) => Number(/step (\d+)/.exec(li.textContent)?.[1] ?? 0)));
  const count = () => page.evaluate(newestStep); // steps that follow closely are one line
  const before = await count();
  await page.waitForTimeout(1000);
  seen.whilePaused = (await count()) - before;
  await page.screenshot({ path: `${folder}/live_view_paused.png` });
  await page.click('#pause');
  for (let i = 0; i < 300 && (await count()) <= before + 2; ++i) await page.waitForTimeout(100);
  seen.afterPause = (await count()) - before;
  await state(page, 'ended');
}

/** The depth bar: its level, the height of the body's block, of the band of its spread, and of what the last 2 mm show, px. */
const bar = (page) =>
  page.evaluate(() => {
    const high = (query) => document.querySelector(`#depth_bar ${query}`)?.getBoundingClientRect().height ?? 0;
    return { level: document.querySelector('#depth_bar').dataset.level, body: high('.body'), spread: high('.spread'), near: high('.block') + high('.doubt') }; // where the body surely is, and where it may be
  });

/** Points at places for a protocol that waits for them, and says when it is enough. */
async function supervise(page) {
  await says(page, 'point at places in the live view');
  await takeControl(page);
  const point = async (u, v) => {
    const box = await page.locator('#top_camera').boundingBox();
    const before = await page.locator('#note').allTextContents();
    await page.mouse.click(box.x + box.width * u, box.y + box.height * v);
    await page.waitForFunction((old) => {
      const note = document.querySelector('#note')?.textContent ?? '';
      return note !== '' && note !== old;
    }, before[0] ?? '', patience);
    return page.textContent('#note');
  };
  seen.places = [];
  for (const [u, v] of [[0.56, 0.47], [0.5, 0.56]]) {
    await page.waitForSelector('#top_camera.aim', patience);
    seen.places.push(await point(u, v));
    await says(page, `point ${seen.places.length} at `);
    await page.screenshot({ path: `${folder}/live_view_point_${seen.places.length}.png` });
  }
  seen.distance = await page.textContent('#distance');
  seen.bar = await bar(page);
  for (let i = 0; i < 30; ++i) await page.keyboard.press('ArrowDown'); // the surface 1.5 mm from the retina, 0.9 at least
  await page.waitForFunction(() => document.querySelector('#distance').dataset.level === 'near', null, patience);
  seen.near = {
    text: await page.textContent('#distance'),
    clearance: await page.textContent('#clearance'),
    bar: await bar(page),
  };
  await page.screenshot({ path: `${folder}/live_view_near.png` });
  // Far below what is left: the margin refuses, and says in mm what would be left.
  // The note is read where it is found: it goes away by itself while a busy machine fetches it.
  const refusal = () =>
    page.evaluate(() => {
      const note = document.querySelector('#note')?.textContent ?? '';
      return note.includes('keep_out.margin') ? note : undefined;
    });
  for (const since = Date.now(); Date.now() - since < patience.timeout && !(seen.refused = await refusal()); ) {
    await page.keyboard.press('ArrowDown');
    await page.waitForTimeout(100);
  }
  await page.setViewportSize({ width: 820, height: 1180 });
  await page.waitForTimeout(300);
  seen.stopInSight = await page.evaluate(() => {
    const box = document.querySelector('#stop').getBoundingClientRect();
    return document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2)?.closest('button')?.id === 'stop';
  });
  await page.screenshot({ path: `${folder}/live_view_supervised_tablet.png` });
  await page.locator('#question button', { hasText: 'done' }).click();
  await state(page, 'ended');
}

try {
  const context = await browser.newContext({ viewport: { width: 1440, height: 960 } }); // of several pages
  const page = await context.newPage();
  page.on('pageerror', (error) => seen.errors.push(String(error)));
  page.on('console', (line) => line.type() === 'error' && seen.errors.push(line.text()));
  await page.goto(address);
  seen.addressAfter = page.url();
  await { steer, answer, supervise }[task](page);
} catch (error) {
  seen.failed = String(error);
  seen.errors = seen.errors.slice(0, 3);
} finally {
  await browser.close();
}
console.log(JSON.stringify(seen));
