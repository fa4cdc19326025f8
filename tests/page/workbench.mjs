// Works the workbench as a technician does, in headless Chromium, and counts the clicks. Prints one JSON object with what it saw.
// Arguments: the address with its token, a folder for screenshots, the browser's program, and what to do: technician, compare or
// pictures.
// SPDX-License-Identifier: Apache-2.0
import { chromium } from 'playwright-core';

const [, , address, folder, executablePath, task] = process.argv;
const browser = await chromium.launch({ executablePath, args: ['--no-sandbox'] });
const seen = { errors: [], clicks: 0 };
const patience = { timeout: 120000 };
const SIZES = [[390, 844], [1024, 768], [1366, 768], [1920, 1080]];

async function click(locator) {
  await locator.click(patience);
  ++seen.clicks;
}

const settled = (page) => page.waitForTimeout(600);

/** Elements with text that is cut, and buttons that lie over each other, at this size. */
const cut = (page) =>
  page.evaluate(() => {
    const bad = [];
    if (document.documentElement.scrollWidth > innerWidth + 1) bad.push(`page is ${document.documentElement.scrollWidth} wide at ${innerWidth}`);
    for (const one of document.querySelectorAll('button, .button, label, h1, h2, th, dt, dd')) {
      const box = one.getBoundingClientRect();
      if (box.width === 0) continue;
      if (one.scrollWidth > one.clientWidth + 1 && getComputedStyle(one).display !== 'inline') bad.push(`cut at ${innerWidth}: ${one.textContent.slice(0, 40)}`);
    }
    return bad;
  });

async function pictures(page, name) {
  seen.cut ??= [];
  for (const [width, height] of SIZES) {
    await page.setViewportSize({ width, height });
    await settled(page);
    seen.cut.push(...(await cut(page)));
    await page.screenshot({ path: `${folder}/workbench_${name}_${width}x${height}.png` });
  }
  await page.setViewportSize({ width: 1366, height: 768 });
}

async function technician(page) {
  await click(page.getByRole('link', { name: /Servo round a square/ }));
  const speed = page.locator('#p_speed');
  await click(speed);
  await speed.press('Control+a');
  await speed.pressSequentially('7');
  await page.waitForSelector('.field.bad', patience);
  seen.wrong = await page.textContent('.field.bad p');
  seen.startOff = await page.isDisabled('#start');
  await pictures(page, 'refused');
  await speed.press('Control+a');
  await speed.pressSequentially('1');
  await page.waitForFunction(() => !document.querySelector('#start').disabled, null, patience);
  await page.waitForFunction(() => document.querySelector('#rehearsal')?.textContent.includes('Takes at least'), null, patience);
  seen.rehearsal = await page.textContent('#rehearsal');
  await pictures(page, 'form');
  await click(page.locator('#start'));
  await page.waitForSelector('#question', patience);
  await pictures(page, 'question');
  seen.stopInSight = await page.evaluate(() => {
    const box = document.querySelector('#stop').getBoundingClientRect();
    return document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2)?.id === 'stop';
  });
  await click(page.locator('#question button', { hasText: 'yes' }));
  await page.waitForSelector('#report', patience);
  await click(page.locator('#report'));
  const frame = page.frameLocator('iframe.sheet');
  seen.reportTitle = await frame.locator('h1').first().textContent(patience);
  const clicks = seen.clicks;
  await pictures(page, 'report');
  for (const name of ['queue', 'runs', 'messages', 'sweeps', 'protocols']) {
    await page.goto(`${new URL(address).origin}/#/${name}`);
    await settled(page);
    await pictures(page, name);
  }
  seen.clicks = clicks;
}

async function compare(page) {
  await page.goto(`${new URL(address).origin}/#/runs`);
  await page.waitForFunction(() => document.querySelector('#found')?.textContent.endsWith('runs'), null, patience);
  seen.total = await page.textContent('#found');
  await pictures(page, 'runs200');
  // The field has the focus: nothing is clicked to search.
  await page.locator('#find').focus();
  let began = performance.now();
  await page.keyboard.type('field > 6.95mT and field < 7.15mT');
  await page.waitForFunction(() => document.querySelector('#found').textContent === '2 runs', null, patience);
  seen.findMs = performance.now() - began;
  seen.found = await page.textContent('#found');
  seen.serverFindMs = await page.evaluate(async () => {
    const times = [];
    for (let i = 0; i < 9; ++i) {
      const from = performance.now();
      await (await fetch('/api/runs?find=field%3E6.95mT%20and%20field%3C7.15mT')).json();
      times.push(performance.now() - from);
    }
    return times.sort((a, b) => a - b)[4];
  });
  const ticks = page.locator('tbody input[type=checkbox]');
  await click(ticks.nth(0));
  await click(ticks.nth(1));
  began = performance.now();
  await click(page.locator('#compare'));
  await page.waitForSelector('#comparison .sentence', patience);
  seen.compareMs = performance.now() - began;
  seen.sentence = await page.textContent('#comparison .sentence');
  seen.serverCompareMs = await page.evaluate(async () => {
    const times = [];
    const runs = location.hash.split('/')[2];
    for (let i = 0; i < 5; ++i) {
      const from = performance.now();
      await (await fetch(`/api/compare?runs=${runs}`)).json();
      times.push(performance.now() - from);
    }
    return times.sort((a, b) => a - b)[2];
  });
  await page.frameLocator('iframe.sheet').locator('svg').first().waitFor(patience);
  const clicks = seen.clicks;
  await pictures(page, 'compare');
  seen.clicks = clicks;
}

try {
  const page = await browser.newPage({ viewport: { width: 1366, height: 768 }, colorScheme: process.env.VITREO_LIGHT ? 'light' : 'dark' });
  page.on('pageerror', (error) => seen.errors.push(String(error)));
  page.on('console', (line) => line.type() === 'error' && !line.text().includes('sandboxed') && seen.errors.push(line.text()));
  await page.goto(address);
  seen.addressAfter = page.url();
  await { technician, compare }[task](page);
} catch (error) {
  seen.failed = String(error);
  seen.errors = seen.errors.slice(0, 3);
} finally {
  await browser.close();
}
console.log(JSON.stringify(seen));
