// The live view's page at six sizes and in every state of a run: the places of its parts, what its message line says, its tools,
// both themes. Prints one JSON object: "failed", sentences, empty when all is right. Arguments: the folder of the page's files,
// a folder for pictures ("-": none), the browser's program.
// SPDX-License-Identifier: Apache-2.0
import { chromium } from 'playwright-core';
import { drawn, kMotion, open, states, until } from './scene.mjs';

const [, , files, pictures, executablePath] = process.argv;
const failed = [];
const expect = (holds, sentence) => { if (!holds) failed.push(sentence); };
/** Holds soon: what the browser does next, or sends, comes a little later than the click that caused it. */
const soon = async (holds, sentence) => expect(await until(holds), sentence);
const sizes = [[390, 844], [768, 1024], [1024, 768], [1366, 768], [1920, 1080], [2560, 1440]];

// x, y, w, h in CSS px (docs/live_view.md, Layout); 2560x1440 is 1920x1080 times 4/3.
const kPlaces = {
  '390x844': { header: [6, 0, 378, 48], message: [6, 54, 378, 56], stop: [6, 770, 378, 68], eye: [0, 116, 390, 286], section: [144, 476, 170, 238] },
  '768x1024': { header: [8, 8, 612, 52], message: [8, 68, 612, 56], stop: [628, 8, 132, 116], eye: [8, 132, 752, 563], depth: [8, 703, 272, 213], section: [288, 703, 472, 213] },
  '1024x768': { header: [8, 8, 868, 52], message: [8, 68, 868, 56], stop: [884, 8, 132, 116], eye: [8, 132, 704, 527], depth: [720, 359, 296, 300], section: [720, 132, 296, 219] },
  '1366x768': { header: [8, 8, 1202, 52], message: [8, 68, 1202, 52], stop: [1218, 8, 140, 112], eye: [8, 128, 844, 632], depth: [860, 128, 160, 632], section: [1028, 128, 330, 254] },
  '1920x1080': { header: [8, 8, 1720, 60], message: [8, 76, 1720, 56], stop: [1736, 8, 176, 124], eye: [8, 140, 1244, 931], depth: [1260, 140, 208, 932], section: [1476, 140, 436, 335] },
};
kPlaces['2560x1440'] = Object.fromEntries(Object.entries(kPlaces['1920x1080']).map(([part, box]) => [part, box.map((v) => (v * 4) / 3)]));
const kSays = {
  idle: /Nothing runs yet/, question: /How long is this eye/, alarm: /!!!.*0\.31 mm from the retina/, medium: /!!.*Coil 3 is warm/, lost: /was not seen for/,
  ready: /The prompt waits for a statement/, left: /The prompt waits for a statement/, paused: /Paused.*Resume/, watching: /You watch.*Take control/, stopping: /Stopping.*STOP again: at once/, ended: /Coils 0 A, read back( 0\.18 s after STOP)?\./, closed: /Coils 0 A, read back\./,
  choices: /Is the eye fixed.*yes.*no/, margin: /Click a place to send the robot there/,
  hot: /The coils are not at zero: 1\.20 A\. Switch them off by hand/, retina: /Click a place to send the robot there/, running: /Click a place to send the robot there/,
};
const kParts = { header: 'header', message: '.message', stop: '#stop, #rested', eye: '.eye', depth: '.depth', section: '.section' };
const kTolerance = 2; // px

const boxes = (page) => page.evaluate((parts) => Object.fromEntries(Object.entries(parts).map(([name, query]) => {
  const { x, y, width, height } = document.querySelector(query).getBoundingClientRect();
  return [name, [x, y, width, height]];
})), kParts);
const text = (page, query) => page.evaluate((q) => document.querySelector(q)?.textContent ?? '', query);
/** Waits until the message line says what belongs to the state, and all of the page is drawn. */
async function stands(page, name) {
  if (!(await until(async () => kSays[name].test(await text(page, '.message'))))) failed.push(`${name}: the message line says "${await text(page, '.message')}"`);
  await drawn(page);
}
const near = (a, b) => a.every((value, i) => Math.abs(value - b[i]) <= kTolerance);

/** Elements whose words are cut, or that stick out of the window; buttons and words that another element covers. */
const flaws = (page) => page.evaluate(() => {
  const found = [], seen = (element) => element.getClientRects().length > 0 && getComputedStyle(element).visibility !== 'hidden';
  for (const element of document.querySelectorAll('header button, .state span, .message b, .message button, .word, .bound, .tiny, .jog button, .panel h2, .positions td, .coil span, #stop, .chip, .rested, .knob button, .knob b, .knob .value, .instruments h2 button')) {
    if (!seen(element)) continue;
    const box = element.getBoundingClientRect(), list = element.closest('.instruments ul')?.getBoundingClientRect(), name = `${element.className || element.id || element.tagName} "${element.textContent.slice(0, 30)}"`;
    if (list && (box.top < list.top || box.bottom > list.bottom)) continue; // to be scrolled to
    if (box.left < -1 || box.top < -1 || box.right > innerWidth + 1 || box.bottom > innerHeight + 1) found.push(`${name} is out of the window`);
    if (element.scrollWidth > element.clientWidth + 2 && getComputedStyle(element).display !== 'inline') found.push(`${name} is cut`);
    if (getComputedStyle(element.parentElement).position === 'fixed') continue; // the phone's sheet
    const panel = element.closest('.panel, header, .message')?.getBoundingClientRect();
    if (panel?.width && (box.right > panel.right + 1 || box.bottom > panel.bottom + 1)) found.push(`${name} leaves its panel`);
    if (element.tagName !== 'BUTTON') continue;
    const top = document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2);
    if (!element.contains(top)) found.push(`${name} is covered by ${top?.className || top?.tagName}`);
    if (box.height < 31.5) found.push(`${name} is ${box.height} px high`);
  }
  if (document.scrollingElement.scrollHeight > innerHeight + 1) found.push('the page scrolls');
  return found;
});

async function atEverySize(browser) {
  const shares = {};
  for (const [width, height] of sizes) {
    const size = `${width}x${height}`;
    let usual = null;
    const page = await open(browser, files, 'running', { width, height });
    page.on('pageerror', (error) => failed.push(`${size}: ${error}`));
    for (const name of ['running', 'question', 'choices', 'watching', 'alarm', 'ended']) {
      page.turn(name);
      await stands(page, name);
      const found = await boxes(page);
      usual ??= found;
      for (const [part, box] of Object.entries(kPlaces[size]))
        expect(near(found[part], box), `${size} ${name}: ${part} is at ${found[part].map((v) => v.toFixed(0))}, not ${box.map((v) => v.toFixed(0))}`);
      for (const part of ['eye', 'stop', 'message'])
        expect(JSON.stringify(found[part]) === JSON.stringify(usual[part]), `${size}: ${part} moves when the state is ${name}`);
      for (const flaw of await flaws(page)) failed.push(`${size} ${name}: ${flaw}`);
      if (name === 'running') shares[size] = (found.eye[2] * found.eye[3]) / (width * height);
      if (pictures !== '-') await page.screenshot({ path: `${pictures}/live_${name}_${size}.png` });
    }
    await page.close();
  }
  for (const size of ['1366x768', '1920x1080']) expect(shares[size] >= 0.45, `${size}: the eye takes ${(shares[size] * 100).toFixed(1)} %`);
  return shares;
}

async function everyState(browser) {
  for (const name of Object.keys(states)) {
    const page = await open(browser, files, name, { width: 1366, height: 768 });
    await stands(page, name);
    const state = await text(page, '#state');
    expect(!/[a-z]:[a-z]/.test(state), `${name}: the state is in a script's words: "${state}"`);
    if (name === 'running') await soon(async () => [1, 2, 3].includes(await page.locator('.log li').count()), 'fifty jogs are fifty lines of log');
    if (name === 'margin') {
      await soon(async () => (await page.locator('#distance').getAttribute('data-level')) === 'margin', 'at the margin the level is another');
      await soon(() => page.locator('.jog button').nth(1).isDisabled(), 'at the margin the robot can be sent down');
    }
    if (name === 'ready') await soon(async () => /Holding|Moving/.test(await text(page, '#state')), 'between two statements the loop that goes on is not told of');
    if (name === 'left') {
      await soon(async () => (await text(page, '#state')) === 'Ready', 'a loop that has ended seems to go on');
      await soon(async () => /^– –/.test(await text(page, '#distance .bound')), 'the clearance is one of four seconds ago');
      await soon(async () => /no loop looks for it/.test(await text(page, '#clearance')), 'why there is no clearance is not said');
      await soon(async () => /^–+$/.test((await page.locator('.positions .robot td').allTextContents()).join('')), 'the position is one of four seconds ago');
      if (pictures !== '-') await page.screenshot({ path: `${pictures}/live_left.png` });
    }
    if (name === 'alarm') {
      await page.click('#to-question');
      await soon(async () => /How long/.test(await text(page, '.message')), 'the question behind an alarm cannot be reached');
    }
    if (name === 'ended') {
      expect(/0\.18 s after STOP/.test(await text(page, '.message')), 'the end does not say how long after STOP the coils were read back');
      const acting = await page.locator('#stop, #take, #pause, .jog button, #abort, #seen').count();
      expect(acting === 0, `after the end ${acting} buttons act`);
      await soon(async () => (await page.locator('#report').getAttribute('href')) === '/report', 'after the end nothing leads to the report');
      expect((await page.locator('.coil .value').allTextContents()).every((value) => Math.abs(Number(value)) < 0.05), 'after the end currents are shown');
    }
    await page.close();
  }
}

async function tools(browser) {
  const page = await open(browser, files, 'watching', { width: 1366, height: 768 });
  const eye = await page.locator('#top_camera').boundingBox(), at = (u, v) => [eye.x + eye.width * u, eye.y + eye.height * v];
  const targets = () => page.sent.filter((message) => message.do === 'target').length;
  await page.mouse.click(...at(0.6, 0.4));
  await page.waitForSelector('#note');
  expect(/take control first/.test(await text(page, '#note')) && targets() === 0, 'a click without control says nothing');
  await page.click('.message button');
  await soon(() => page.sent.some((message) => message.do === 'take'), 'the refusal offers no way out');
  await page.close();

  const other = await open(browser, files, 'running', { width: 1366, height: 768 });
  const sentBy = (word) => other.sent.filter((message) => message.do === word);
  await other.mouse.click(...at(0.6, 0.4));
  await soon(() => sentBy('target').length === 1, 'a click sends no target');
  const [first] = sentBy('target'), u = 0.6 * 1384 - 0.5, v = 0.4 * 1036 - 0.5;
  expect(first && Math.abs(first.points[0][0] - u) < 3 && Math.abs(first.points[0][1] - v) < 3 && first.points.length === 1, `a click is ${JSON.stringify(first)}`);
  await other.mouse.move(...at(0.5, 0.5)), await other.mouse.wheel(0, -300);
  await other.mouse.move(...at(0.7, 0.7)), await other.mouse.down(), await other.mouse.move(...at(0.8, 0.8), { steps: 8 }), await other.mouse.up();
  await soon(() => sentBy('target').length === 2, 'a drag sends no path');
  const path = sentBy('target')[1];
  expect(path?.points.length > 4 && path.points[0][0] < 0.7 * 1384 - 20, `zoomed in, a drag is the path ${JSON.stringify(path?.points.slice(0, 2))}`);
  await other.waitForSelector('#cursor');
  await soon(async () => /x −?\d+\.\d\d {2}y −?\d+\.\d\d mm {2}at z −1\.62/.test(await text(other, '#cursor')), 'the cursor does not say x, y and z');
  await other.keyboard.press('0'), await other.keyboard.press('c');
  await other.waitForSelector('#light-panel rect');
  await other.click('#light-panel button');
  await soon(() => other.evaluate(() => document.querySelector('.eye canvas').style.filter !== 'none'), 'contrast changes nothing');
  await other.keyboard.press('c'), await other.keyboard.press('m');
  await other.mouse.move(...at(0.3, 0.3)), await other.mouse.down(), await other.mouse.move(...at(0.4, 0.3), { steps: 4 }), await other.mouse.up();
  await soon(() => sentBy('where').some(({ points }) => points.length === 2 && points[0][0] < 430), 'a ruler asks for no positions');
  const [download] = await Promise.all([other.waitForEvent('download'), other.keyboard.press('s')]);
  expect(/steer.*\.png$/.test(download.suggestedFilename()), `a snapshot is ${download.suggestedFilename()}`);
  await other.keyboard.press('ArrowUp');
  await soon(() => Math.abs((sentBy('target').at(-1).place?.[2] ?? 0) + 1.52e-3) < 1e-9, 'an arrow does not raise the target by 0.1 mm');
  await other.focus('#more'), await other.keyboard.press('Space');
  await soon(() => sentBy('stop').length === 1, 'the space bar does not stop while a button has the focus');
  other.drop();
  await other.waitForFunction(() => /STOP cannot be sent/.test(document.querySelector('.message').textContent), null, { timeout: 60000 });
  await other.close();
}

/** The panel of the instruments at every size: whole, with room beside it for the picture; what its buttons send. */
async function instruments(browser) {
  for (const [width, height] of sizes) {
    const size = `${width}x${height}`, page = await open(browser, files, 'running', { width, height });
    await stands(page, 'running');
    const before = await boxes(page);
    if (width < 600) await page.click('.tabs button:last-child');
    else await page.keyboard.press('i');
    await page.waitForSelector('#instruments .knob');
    await drawn(page);
    for (const flaw of await flaws(page)) failed.push(`${size} instruments: ${flaw}`);
    const after = await boxes(page), panel = await page.locator('#instruments').boundingBox();
    for (const part of ['eye', 'stop', 'message']) expect(JSON.stringify(before[part]) === JSON.stringify(after[part]), `${size}: ${part} moves when the instruments are shown`);
    const [x, y, w, h] = after.eye, cover = Math.max(0, Math.min(x + w, panel.x + panel.width) - Math.max(x, panel.x)) * Math.max(0, Math.min(y + h, panel.y + panel.height) - Math.max(y, panel.y));
    expect(cover / (w * h) <= 0.47, `${size}: the instruments cover ${((100 * cover) / (w * h)).toFixed(0)} % of the eye`);
    if (pictures !== '-') await page.screenshot({ path: `${pictures}/live_instruments_${size}.png` });
    await page.close();
  }
  const page = await open(browser, files, 'running', { width: 1366, height: 768 }), sent = () => page.sent.filter((message) => message.do === 'adjust' && 'to' in message);
  await page.keyboard.press('i');
  await soon(() => page.sent.some((message) => message.do === 'adjust' && !('to' in message)), 'the instruments are not read when they are shown');
  await page.click(".knob[data-name='stage z'] .steps button:nth-child(4)");
  await soon(async () => /→/.test(await text(page, ".knob[data-name='stage z'] .value")), 'where an instrument is sent to is not shown');
  await page.click(".knob[data-name='stage z'] .steps button:nth-child(4)"); // quicker than the program answers: from where it is sent to
  await soon(() => sent().length === 2 && Math.abs(sent()[1].to - 0.01232) < 1e-9 && sent()[1].instrument === 'stage z', 'two steps of 0.01 mm are not 0.02 mm');
  await page.fill(".knob[data-name='lamp'] input", '55');
  await page.press(".knob[data-name='lamp'] input", 'Enter');
  await soon(() => Math.abs((sent().at(-1)?.to ?? 0) - 0.55) < 1e-9, 'a level that is typed is not sent');
  await page.click(".knob[data-name='top_camera exposure'] .steps button:nth-child(5)");
  await soon(() => Math.abs((sent().at(-1)?.to ?? 0) - 0.015) < 1e-9, 'an exposure is not raised by a quarter');
  expect(/not homed/.test(await text(page, ".knob[data-name='lens_mover'] small")), 'a refusal does not stand at its instrument');
  page.turn('watching');
  await soon(async () => (await page.locator('.knob button:enabled').count()) === 0, 'who looks on can adjust instruments');
  await page.close();
}

/** Remembers the camera's picture where vessels are, without what is drawn on it; change() is the mean difference of gray levels
    from it. */
const remember = (page) => page.evaluate(() => {
  const levels = () => {
    const canvas = document.querySelector('.eye canvas'), { width, height } = canvas;
    return canvas.getContext('2d').getImageData(width * 0.5, height * 0.2, width * 0.35, height * 0.5).data.filter((_, i) => i % 4 === 1);
  };
  const before = levels();
  window.change = () => levels().reduce((sum, value, i) => sum + Math.abs(value - before[i]), 0) / before.length;
});

/** The retina held still: after it has moved, vessels are where they were, and the robot, which stayed, is not; what is pointed
    at is sent as the pixel of the frame. Where nothing follows the retina there is no such button. */
async function heldRetina(browser) {
  const without = await open(browser, files, 'running', { width: 1366, height: 768 });
  expect((await without.locator("[data-tool='hold']").count()) === 0, 'the retina can be held where nothing follows it');
  await without.close();
  const page = await open(browser, files, 'retina', { width: 1366, height: 768 });
  await stands(page, 'retina');
  const shot = async (name) => { await drawn(page); if (pictures !== '-') await page.screenshot({ path: `${pictures}/live_retina_${name}.png` }); };
  await remember(page);
  await shot('still');
  await page.move();
  await shot('moved');
  const moved = await page.evaluate(() => window.change());
  await page.close();

  const held = await open(browser, files, 'retina', { width: 1366, height: 768 });
  await stands(held, 'retina');
  await held.click("[data-tool='hold']");
  await drawn(held);
  await remember(held);
  await held.move();
  await soon(async () => (await held.evaluate(() => window.change())) < 0.4 * moved, `held still the retina moves: ${await held.evaluate(() => window.change())} gray levels, ${moved} where it is not held`);
  expect(moved > 3, `the made retina does not move: ${moved} gray levels`);
  await soon(async () => /Retina held still/.test(await text(held, '#held')), 'nothing says that the retina is held');
  if (pictures !== '-') { await drawn(held); await held.screenshot({ path: `${pictures}/live_retina_held.png` }); }
  for (const flaw of await flaws(held)) failed.push(`retina held: ${flaw}`);
  // The pixel of the new frame at which the first frame's point (900, 300) of the retina is.
  const eye = await held.locator('#top_camera').boundingBox(), { x, y, angle, scale } = kMotion;
  await held.mouse.click(eye.x + (eye.width * 900.5) / 1384, eye.y + (eye.height * 300.5) / 1036);
  await soon(() => held.sent.some((message) => message.do === 'target'), 'a click on the held retina sends no target');
  const [u, v] = held.sent.find((message) => message.do === 'target').points[0];
  const wanted = [x + scale * (Math.cos(angle) * 900 - Math.sin(angle) * 300), y + scale * (Math.sin(angle) * 900 + Math.cos(angle) * 300)];
  expect(Math.hypot(u - wanted[0], v - wanted[1]) < 1.5, `a click on the held retina is sent as ${u}, ${v}, not ${wanted}`);
  await held.close();
}

/** Contrast of two colors by WCAG 2. */
function contrast(a, b) {
  const light = (color) => color.map((c) => (c / 255 <= 0.04045 ? c / 255 / 12.92 : ((c / 255 + 0.055) / 1.055) ** 2.4)).reduce((sum, c, i) => sum + c * [0.2126, 0.7152, 0.0722][i], 0);
  const [high, low] = [light(a), light(b)].sort((p, q) => q - p);
  return (high + 0.05) / (low + 0.05);
}

async function themes(browser) {
  const page = await open(browser, files, 'running', { width: 1920, height: 1080 });
  for (const theme of ['dark', 'light']) {
    expect((await page.evaluate(() => document.documentElement.dataset.theme)) === theme, `the theme is not ${theme}`);
    const colors = await page.evaluate(() => Object.fromEntries(['panel', 'text', 'text2', 'text3', 'accent', 'good', 'second', 'third', 'red-words', 'control', 'stop', 'primary', 'high', 'medium', 'medium-ink', 'edge'].map((name) => {
      const hex = getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
      return [name, [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16))];
    })));
    for (const name of ['text', 'text2', 'text3', 'accent', 'good', 'second', 'third', 'red-words'])
      expect(contrast(colors[name], colors.panel) >= 4.5, `${theme}: ${name} on a panel has ${contrast(colors[name], colors.panel).toFixed(2)}`);
    for (const [ink, ground] of [[[255, 255, 255], 'stop'], [[255, 255, 255], 'primary'], [[255, 255, 255], 'high'], [colors['medium-ink'], 'medium'], [colors.text, 'control']])
      expect(contrast(ink, colors[ground]) >= 4.5, `${theme}: words on ${ground} have ${contrast(ink, colors[ground]).toFixed(2)}`);
    expect(contrast(colors.edge, colors.panel) >= 3, `${theme}: edges have ${contrast(colors.edge, colors.panel).toFixed(2)}`);
    if (pictures !== '-') await page.screenshot({ path: `${pictures}/live_${theme}.png` });
    await page.keyboard.press('i');
    await page.waitForSelector('#instruments .knob');
    if (pictures !== '-') await page.screenshot({ path: `${pictures}/live_instruments_${theme}.png` });
    await page.keyboard.press('i');
    await page.click('#more'), await page.click('#theme');
  }
  await page.close();
}

const browser = await chromium.launch({ executablePath, args: ['--no-sandbox'] });
let shares = {};
try {
  shares = await atEverySize(browser);
  await everyState(browser);
  await tools(browser);
  await instruments(browser);
  await themes(browser);
  await heldRetina(browser);
} catch (error) {
  failed.push(String(error));
} finally {
  await browser.close();
}
console.log(JSON.stringify({ failed, shares }));
