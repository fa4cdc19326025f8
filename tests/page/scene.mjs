// A made run for tests of the page's layout: the messages that the program would send (docs/live_view.md, Messages), with a
// robot that went to a target, and the page served from a folder of its files. No program runs, so every state can be had.
// SPDX-License-Identifier: Apache-2.0
import fs from 'node:fs';
import path from 'node:path';

const kChannels = ['x', 'y', 'z', 'target_x', 'target_y', 'target_z', 'u_px', 'v_px', 'semi_major_px', 'semi_minor_px', 'angle',
                   'sigma_x', 'sigma_y', 'sigma_z', 'headroom', 'limited'];
const kClearance = ['bound', 'distance', 'uncertainty', 'retina', 'lens', 'at_lens', 'margin', 'kept_out', 'axis_x', 'axis_y', 'axis_z'];
const kPixels = 71832; // px/m of the top camera
const kEnd = 60; // s of the run so far

export const hello = {
  title: 'Steering by hand', run: '2026-11-24T181927_steer_51e7', operator: 'Eve <b>Bold</b>', parameters: { within: 0.0003 }, units: {},
  geometry: { body: { semi_axis: 0.001, semi_radius: 0.0005 }, current_limit: 12, lens_z: 0.0105, margin: 0.0002,
              retina: { radius: 0.0115, z: -0.005 }, side_center: [327.5, 244.5], side_pixel: 20.4e-6, top_px_per_m: kPixels },
};

const instruments = [['stage x', 'm', -0.012, 0.012, 1e-6, 0], ['stage z', 'm', 0, 0.06, 1e-6, 0.0123], ['lens_mover', 'm', -0.005, 0.005, 1e-5, 0.0004], ['lamp', '%', 0, 1, 0.01, 0.4],
  ['top_camera exposure', 's', 1e-6, 0.0667, 1e-5, 0.012], ['top_camera gain', 'dB', 0, 24, 0.1, 6]]
  .map(([name, unit, min, max, step, value]) => ({ name, unit, min, max, step, value, busy: false, by: '', refused: '' }));
instruments[1].by = 'operator at the live view';
instruments[2].refused = 'lens mover: refused: it is not homed';

const status = {
  instruments,
  alarms: [], control: 'mine', doing: 'steering', note: '', phase: 'running', progress: 0.4, takes_targets: true, tier: 'none', viewers: 1,
  text: 'running, waiting for run:wait', waiting_for: 'run:wait', field: { direction: [1, 0, 0], tesla: 0.01 },
  target_px: [691.5 - 0.0024 * kPixels, 517.5 - 0.0007 * kPixels],
};

/** Rows of a minute: half of it at rest, then to the target; `lost` leaves the last 4 s unseen; `bound` is the last bound, m. */
function streams({ lost = false, bound = 2.74e-3 } = {}) {
  const servo = [], clearance = [], currents = [], half = 0.14e-3;
  for (let t = 0; t <= kEnd; t += 1 / 15) {
    const on = 1 - Math.exp(-Math.max(0, t - 30) / 1.2), noise = 8e-6 * Math.sin(37 * t), tail = Math.min(1, Math.max(0, t - 58) / 1.5);
    const x = -0.0024 * on + noise, y = 0.0007 * on - noise, seen = !(lost && t > kEnd - 4);
    const low = 4.3e-3 - 1.56e-3 * on + (bound - 2.74e-3) * tail, z = low + half + 0.5e-3 - 5e-3;
    const target = t < 30 ? [0, 0, -0.2e-3] : [-0.0024, 0.0007, -1.62e-3];
    servo.push(seen ? [t, x, y, z, ...target, 691.5 + x * kPixels, 517.5 - y * kPixels, 68, 34, 0, 5e-5, 5e-5, 7e-5, 0.81, 0]
                    : [t, null, null, null, ...target, null, null, null, null, null, null, null, null, 0.81, 0]);
    clearance.push(seen ? [t, low, low + half, half, low + half, 10e-3, 0, 2e-4, 0, 1, 0, 0] : [t, null, null, null, null, null, null, 2e-4, 0, 1, 0, 0]);
  }
  currents.push([kEnd, 2.1, -2.2, 0.18, 2.3, -1.96, 2.11, 0.2, -1.99]);
  return {
    servo: { channels: kChannels, rows: servo },
    clearance: { channels: kClearance, rows: clearance },
    currents: { channels: ['i1', 'i2', 'i3', 'i4', 'i5', 'i6', 'i7', 'i8'], rows: currents },
    coil_temperature: { channels: ['t1', 't2', 't3', 't4', 't5', 't6', 't7', 't8'], rows: [[kEnd, ...new Array(8).fill(304.2)]] },
  };
}

const alarm = { name: 'clearance', priority: 'high', text: 'The robot is 0.31 mm from the retina', time: 58, active: true, times: 1, acknowledged_by: '' };
const ask = { number: 1, name: 'length', text: 'How long is this eye? Ultrasound length (14 mm to 18 mm)', choices: [], task: null };
const kRead = { t: 60.18, text: 'coils 0.01 A, read back at 12:03:11.250', amperes: [0.01, 0, 0, 0, 0, 0, 0, 0] };

/** A frame's place on the map of the retina, of which the first frame's is another than the map's own; and two zones of it. The
    retina of a frame that is moved by m lies at m^-1 in the frame before it. */
function retinaStreams(time, motion) {
  const c = Math.cos(motion.angle) / motion.scale, s = -Math.sin(motion.angle) / motion.scale;
  const x = -(c * motion.x - s * motion.y), y = -(s * motion.x + c * motion.y);
  const turn = 0.2, grow = 1.1, seen = (u, v) => [motion.x + motion.scale * (Math.cos(motion.angle) * u - Math.sin(motion.angle) * v), motion.y + motion.scale * (Math.sin(motion.angle) * u + Math.cos(motion.angle) * v)];
  const place = [grow * (Math.cos(turn) * x - Math.sin(turn) * y) + 31, grow * (Math.sin(turn) * x + Math.cos(turn) * y) - 12];
  return {
    retina: { channels: ['exposed', 'x_px', 'y_px', 'angle', 'scale', 'sigma_px'], rows: [[time + 0.02, time, ...place, turn - motion.angle, grow / motion.scale, 0.06]] },
    no_go_zones: { channels: ['zone', 'u_px', 'v_px', 'radius_px', 'clearance'], rows: [[time, 1, ...seen(900, 480), 80, 1e-3], [time, 2, ...seen(560, 760), 50, 2e-3]] },
  };
}

/** Each state: status over the usual one, the phase before it, streams' options, and what else the program would send. */
export const states = {
  running: {},
  idle: { quiet: true },
  question: { status: { question: ask, waiting_for: 'run:ask' } },
  choices: { status: { question: { ...ask, text: 'Is the eye fixed? (yes or no)', choices: ['yes', 'no'] } } },
  alarm: { status: { alarms: [alarm], question: ask }, streams: { bound: 0.31e-3 } },
  medium: { status: { alarms: [{ ...alarm, priority: 'medium', text: 'Coil 3 is warm: 61 °C' }] } },
  margin: { streams: { bound: 0.15e-3 } },
  lost: { streams: { lost: true } },
  paused: { status: { phase: 'paused', waiting_for: 'resume' } },
  watching: { status: { control: 'free' } },
  retina: { retina: true },
  stopping: { status: { phase: 'stopping' } },
  ready: { status: { phase: 'ready' } },
  left: { status: { phase: 'ready' }, later: 4 }, // s after the loop has told something for the last time
  ended: { before: 'stop requested', status: { phase: 'stopping' }, end: { ended: 'stopped: stopped by the operator', rest: kRead, report: '/report' } },
  closed: { before: 'stop requested', status: { phase: 'ready' }, end: { ended: 'completed', rest: kRead } }, // a prompt's session, long after a stop in it
  hot: { end: { ended: 'aborted: the amplifier did not answer', rest: { t: 61, text: 'coils NOT at zero: coil 3 carries 1.2 A, read back at 12:03:11.250', amperes: [0, 0, 1.2, 0, 0, 0, 0, 0] } } },
};

/** Where the retina has gone in the frame after the first: pixels of the picture, a turn, a scale. */
export const kMotion = { x: 46, y: -28, angle: 0.04, scale: 1.02 };
const kStill = { x: 0, y: 0, angle: 0, scale: 1 };

/** A fundus with vessels, moved, and a gray side view, as the program's frames; the robot stays. */
async function frames(browser, moved = kStill, number = 900, time = kEnd) {
  const page = await browser.newPage();
  const jpegs = await page.evaluate((moved) => {
    const draw = (w, h, paint) => {
      const canvas = Object.assign(document.createElement('canvas'), { width: w, height: h }), pen = canvas.getContext('2d');
      paint(pen, w, h);
      return canvas.toDataURL('image/jpeg', 0.8).split(',')[1];
    };
    const fundus = (pen, w, h) => {
      const light = pen.createRadialGradient(w / 2, h / 2, 50, w / 2, h / 2, w * 0.62);
      light.addColorStop(0, '#8a8a8a'), light.addColorStop(0.9, '#5a5a5a'), light.addColorStop(1, '#000');
      pen.fillStyle = light, pen.fillRect(0, 0, w, h);
      pen.save(), pen.translate(moved.x, moved.y), pen.rotate(moved.angle), pen.scale(moved.scale, moved.scale);
      pen.fillStyle = '#c8c8c8', pen.beginPath(), pen.arc(900, 480, 45, 0, 7), pen.fill();
      pen.strokeStyle = '#3c3c3c';
      for (let i = 0; i < 14; ++i) {
        pen.lineWidth = 3 + (i % 4), pen.beginPath(), pen.moveTo(900, 480);
        const turn = (i / 14) * 6.283;
        pen.bezierCurveTo(900 + 250 * Math.cos(turn), 480 + 250 * Math.sin(turn), 900 + 420 * Math.cos(turn + 0.4), 480 + 420 * Math.sin(turn + 0.4), 900 + 800 * Math.cos(turn + 0.3), 480 + 800 * Math.sin(turn + 0.3));
        pen.stroke();
      }
      pen.restore();
      pen.fillStyle = '#222', pen.beginPath(), pen.ellipse(691.5 - 172, 517.5 - 50, 66, 32, 0, 0, 7), pen.fill();
    };
    return [draw(656, 490, (pen, w, h) => { pen.fillStyle = '#4d545b', pen.fillRect(0, 0, w, h); }), draw(1384, 1036, fundus)];
  }, moved);
  await page.close();
  return jpegs.map((text, slot) => {
    const jpeg = Buffer.from(text, 'base64'), head = Buffer.alloc(24), [w, h] = slot ? [1384, 1036] : [656, 490];
    head.writeUInt32LE(slot, 0), head.writeUInt32LE(number, 4), head.writeDoubleLE(time, 8), head.writeUInt32LE(w, 16), head.writeUInt32LE(h, 20);
    return Buffer.concat([head, jpeg]);
  });
}

const kPatience = 30000; // ms: far more than a busy machine takes, so that what does not come by then is wrong and not late

/** Waits until `holds()`; false where it does not within the patience. What a click causes passes through two programs. */
export async function until(holds) {
  for (const end = Date.now() + kPatience; !(await holds()); await new Promise((done) => setTimeout(done, 20)))
    if (Date.now() > end) return false;
  return true;
}

/** Waits until the page has drawn what it knows. */
export const drawn = (page) => page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));

/** Opens the page from the files in `folder`, in one state; `sent` collects what the page sent. VITREO_SLOW_BROWSER=N: with a
    processor that is N times slower, as on a machine that has other work. */
export async function open(browser, folder, name, viewport, more = {}) {
  const state = states[name], page = await browser.newPage({ viewport, ...more }), sent = [];
  if (process.env.VITREO_SLOW_BROWSER)
    await (await page.context().newCDPSession(page)).send('Emulation.setCPUThrottlingRate', { rate: Number(process.env.VITREO_SLOW_BROWSER) });
  const pictures = (browser.pictures ??= await frames(browser));
  await page.route('http://vitreo.test/**', (route) => {
    const file = new URL(route.request().url()).pathname;
    const type = { '.html': 'text/html', '.js': 'text/javascript', '.css': 'text/css' };
    const full = path.join(folder, file === '/' ? 'index.html' : file);
    return fs.existsSync(full) ? route.fulfill({ contentType: type[path.extname(full)], body: fs.readFileSync(full) }) : route.fulfill({ status: 404, body: '' });
  });
  const sockets = [];
  await page.routeWebSocket('ws://vitreo.test/live', (socket) => {
    if (page.gone) return void socket.close();
    sockets.push(socket);
    socket.onMessage((text) => {
      const message = JSON.parse(text);
      sent.push(message);
      if (message.do === 'adjust' && 'to' in message) // and does not get there
        socket.send(JSON.stringify({ time: kEnd, rest: null, status: { ...status, ...state.status, instruments: instruments.map((knob) => ({ ...knob, busy: knob.name === message.instrument })) } }));
      if (message.do === 'where') // the made eye is flat
        socket.send(JSON.stringify({ where: message.points.map(([u, v]) => [(u - 691.5) / kPixels, (517.5 - v) / kPixels, message.z]), id: message.id }));
    });
    if (state.quiet) return;
    const send = (message) => socket.send(JSON.stringify(message));
    send({ hello });
    const lines = [];
    for (let i = 0; i < 50; ++i) lines.push({ kind: 'note', t: 40 + i * 0.3, text: `target ${i + 4}: -2.4 mm, 716 µm, ${-100 * i} µm` });
    lines.unshift({ kind: 'feedback', t: 2.1, text: 'law pd, feedback one_camera (top camera through the eye)' });
    if (state.before) send({ time: kEnd, status: { ...status, phase: state.before } });
    send({ time: kEnd, cameras: ['side_camera', 'top_camera'], streams: streams(state.streams), lines, status: { ...status, ...state.status }, rest: null });
    if (state.retina) send({ time: kEnd, streams: retinaStreams(kEnd, kStill) });
    for (const bytes of pictures) socket.send(bytes);
    if (state.later) send({ time: kEnd + state.later, status: { ...status, ...state.status } });
    if (state.end) send(state.end);
  });
  page.sent = sent;
  // Another state of the same run: what the program would send next. What the loop measured stays.
  page.turn = (next) => {
    const to = states[next];
    for (const socket of sockets) {
      socket.send(JSON.stringify({ time: kEnd, status: { ...status, ...to.status }, rest: null }));
      if (to.end) socket.send(JSON.stringify(to.end));
    }
  };
  // The next frame, in which the retina has moved; a frame comes before its place on the map.
  page.move = async () => {
    const time = kEnd + 1 / 15;
    for (const bytes of await frames(browser, kMotion, 901, time)) for (const socket of sockets) socket.send(bytes);
    for (const socket of sockets) socket.send(JSON.stringify({ time, streams: retinaStreams(time, kMotion) }));
    await page.waitForFunction(() => document.querySelector('#top_camera')?.dataset.frame === '901', null, { timeout: kPatience });
  };
  page.drop = () => { page.gone = true; sockets.forEach((socket) => socket.close()); };
  await page.goto('http://vitreo.test/');
  if (!state.quiet) await page.waitForFunction(() => document.querySelector('#top_camera')?.dataset.frame === '900', null, { timeout: kPatience });
  return page;
}
