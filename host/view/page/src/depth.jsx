// The depth bar of the thesis' figures 6.7 and 6.8: where the robot is between retina and lens, against a zero level that
// the operator sets, with its spread; beside it the last 2 mm, always at one scale. What is written large, and what colors,
// words and bars follow, is the lower end of the clearance's 95 % interval: how near the robot's surface is at worst.
import { useEffect, useRef } from 'preact/hooks';
import { formatQuantity } from './format.js';
import { named, newest } from './link.js';

const kNear = 1.0e-3, kClose = 0.4e-3; // m, of the bound: near, very close
const kHysteresis = 0.05e-3; // m, upwards
const kDoubtful = 0.5e-3; // m: an uncertainty above it asks for a calibration; the level stays that of the bound, or red might come late
const kLast = 2e-3; // m, of the bar beside the bar
const kSpread = 30; // rows: 2 s at 15 Hz
const kThinnest = 4; // px: a spread of micrometers is still seen
const kStale = 1; // s without a clearance
const kColors = { unknown: '#555e68', free: '#009e73', near: '#e69f00', close: '#d55e00', margin: '#d55e00' };
const kWords = { unknown: 'not known', free: 'clear', near: '▲ near', close: '▲▲ VERY CLOSE', margin: '▲▲ AT THE MARGIN' };

/** Standard deviation of the last places' depth about their steady motion, m: a robot that moves is not thereby uncertain. */
export function spreadOf(store) {
  const held = store.streams.servo;
  if (!held) return null;
  const rows = held.rows.slice(-kSpread).map((r) => named(held, r)).filter((r) => r.z !== null);
  if (rows.length < 4) return null;
  const mean = (of) => rows.reduce((sum, r) => sum + of(r), 0) / rows.length;
  const t = mean((r) => r.t), z = mean((r) => r.z);
  const slope = mean((r) => (r.t - t) * (r.z - z)) / Math.max(mean((r) => (r.t - t) ** 2), 1e-12);
  return Math.sqrt((mean((r) => (r.z - z - slope * (r.t - t)) ** 2) * rows.length) / (rows.length - 2));
}

/** The level of a bound, m; it is left upwards only with some distance. */
export function levelOf(clearance, margin, before = 'free') {
  if (!clearance || clearance.bound == null) return 'unknown';
  const order = ['margin', 'close', 'near'], limits = [margin, kClose, kNear];
  for (let i = 0; i < order.length; ++i) {
    const from = order.indexOf(before);
    const held = from >= 0 && from <= i ? kHysteresis : 0;
    if (clearance.bound <= limits[i] + held) return order[i];
  }
  return 'free';
}

const mm = (meters) => (Math.round(meters * 1e5) / 100 + 0).toFixed(2); // never -0.00
const least = (meters) => (Math.floor(Math.max(0, meters) * 1e5) / 100).toFixed(2); // "at least": rounded down

/** The newest clearance that is one; null when the robot was not seen for a second. */
function clearanceOf(store) {
  const held = store.streams.clearance;
  if (!held || held.rows.length === 0) return null;
  const last = held.rows[held.rows.length - 1][0];
  for (let i = held.rows.length - 1; i >= 0 && held.rows[i][0] > last - kStale; --i) {
    const row = named(held, held.rows[i]);
    if (row.bound !== null) return row;
  }
  return null;
}

/** How far the body reaches up and down, m, by the outline of its ellipsoid. */
function reachOf(geometry, clearance) {
  const body = geometry?.body;
  if (!body || !clearance) return 0;
  return Math.hypot(body.semi_axis * clearance.axis_z, body.semi_radius * Math.sqrt(Math.max(0, 1 - clearance.axis_z ** 2)));
}

function hatch(pen, x, y, width, height) {
  pen.save();
  pen.beginPath();
  pen.rect(x, y, width, height);
  pen.clip();
  pen.strokeStyle = '#0b0f14';
  pen.lineWidth = 2;
  pen.beginPath();
  for (let k = -height; k < width; k += 7) {
    pen.moveTo(x + k, y + height);
    pen.lineTo(x + k + height, y);
  }
  pen.stroke();
  pen.restore();
}

/** Retina at the foot, 2 mm at the top: the body's block, its lower end hatched over the uncertainty, a line at the bound. */
function drawLast(surface, clearance, margin, level) {
  const pen = surface.getContext('2d'), { width, height } = surface;
  const y = (gap) => height - 16 - (gap / kLast) * (height - 30);
  pen.fillStyle = '#10151b';
  pen.fillRect(0, 0, width, height);
  pen.fillStyle = '#5a2626';
  pen.fillRect(0, y(0), width, height);
  pen.fillStyle = '#3b1d10';
  pen.fillRect(0, y(kClose), width, y(0) - y(kClose));
  pen.font = '11px system-ui';
  pen.textAlign = 'left';
  for (const gap of [0, 0.5e-3, 1e-3, 1.5e-3, 2e-3]) {
    pen.fillStyle = '#aeb8c4';
    pen.fillText((gap * 1e3).toFixed(1), width - 20, y(gap) + (gap === 0 ? -3 : 4));
    pen.fillRect(width - 28, y(gap), 5, 1);
  }
  pen.strokeStyle = '#ff8a80';
  pen.setLineDash([4, 3]);
  pen.beginPath();
  pen.moveTo(0, y(margin));
  pen.lineTo(width - 28, y(margin));
  pen.stroke();
  pen.setLineDash([]);
  pen.fillStyle = '#ffc9bd';
  pen.textAlign = 'center';
  pen.fillText(clearance?.at_lens ? 'lens' : 'retina', width / 2, height - 4);
  pen.textAlign = 'left';
  if (!clearance) return;
  const { bound, distance, uncertainty } = clearance;
  pen.fillStyle = kColors[level];
  if (bound > kLast) {
    pen.beginPath();
    pen.moveTo(18, 4);
    pen.lineTo(28, 18);
    pen.lineTo(8, 18);
    pen.fill();
    return;
  }
  const foot = y(Math.max(bound, 0)), top = Math.max(2, y(distance + uncertainty));
  pen.fillRect(6, 0, 26, foot);
  hatch(pen, 6, top, 26, foot - top);
  pen.fillStyle = '#ffffff';
  pen.fillRect(2, foot - 2, 34, 4);
}

export function DepthBar({ store, zero, setZero, depth, jog }) {
  const canvas = useRef(null), last = useRef(null), before = useRef('free');
  const row = newest(store, 'servo'), clearance = clearanceOf(store);
  const geometry = store.hello?.geometry, spread = spreadOf(store), margin = geometry?.margin ?? 0;
  const level = levelOf(clearance, margin, before.current);
  before.current = level;
  const from = (geometry?.retina.z ?? -5e-3) - 0.6e-3, to = Math.min(geometry?.lens_z ?? 8e-3, from + 14e-3);
  const reach = reachOf(geometry, clearance);

  useEffect(() => {
    if (last.current) drawLast(last.current, clearance, margin, level);
    const surface = canvas.current, pen = surface.getContext('2d');
    const { width, height } = surface;
    const y = (z) => height - ((z - from) / (to - from)) * height;
    const color = kColors[level];
    pen.fillStyle = '#10151b';
    pen.fillRect(0, 0, width, height);
    pen.fillStyle = '#5a2626';
    pen.fillRect(0, y(geometry?.retina.z ?? from), width, height);
    pen.font = '11px system-ui';
    pen.fillStyle = '#ffc9bd';
    pen.fillText('retina', 44, height - 5);
    pen.strokeStyle = '#77828e';
    for (let k = Math.ceil((from - zero) * 1e3); zero + k / 1e3 <= to; k += 1) { // mm from the zero level, as the number below
      const at = y(zero + k / 1e3);
      pen.beginPath();
      pen.moveTo(50, at);
      pen.lineTo(k === 0 ? 60 : 56, at);
      pen.stroke();
      pen.fillStyle = k === 0 ? '#ffffff' : '#aeb8c4';
      pen.font = k === 0 ? 'bold 13px system-ui' : '13px system-ui';
      if (k % 2 === 0 && at < height - 22 && at > 12) pen.fillText(`${k}`, 63, at + 4);
    }
    if (row && row.z !== null) {
      // The room under the body, then the body itself as high as it is.
      const bottom = y(geometry?.retina.z ?? from), foot = row.z - reach;
      pen.fillStyle = color;
      pen.fillRect(8, y(foot), 30, bottom - y(foot));
      pen.fillStyle = '#aeb8c4';
      pen.fillRect(8, y(row.z + reach), 30, y(foot) - y(row.z + reach));
      if (spread !== null) {
        const high = Math.max(kThinnest, Math.round(y(row.z - spread) - y(row.z + spread)));
        pen.fillStyle = inverse(color);
        pen.fillRect(8, Math.round(y(row.z) - high / 2), 30, high);
      }
    }
    // Both beside the bar: what is drawn over it would hide the spread.
    pen.strokeStyle = '#ffffff';
    pen.lineWidth = 2;
    for (const [left, right] of [[0, 8], [38, 60]]) {
      pen.beginPath();
      pen.moveTo(left, y(zero));
      pen.lineTo(right, y(zero));
      pen.stroke();
    }
    pen.lineWidth = 1;
    if (row && row.target_z !== null) {
      const at = y(depth ?? row.target_z);
      pen.fillStyle = '#e69f00';
      pen.beginPath();
      pen.moveTo(38, at);
      pen.lineTo(49, at - 6);
      pen.lineTo(49, at + 6);
      pen.fill();
    }
  });

  const mine = store.status.control === 'mine', wall = clearance?.at_lens ? 'lens' : 'retina';
  return (
    <section class={`depth ${level}`}>
      <h2>Clearance</h2>
      <p class={`distance ${level}`} id="distance" role="status">
        <span class="quiet">{level === 'unknown' ? wall : `${wall}, at least`}</span>
        <b class="bound">{level === 'unknown' ? '–' : least(clearance.bound)}<small> mm</small></b>
        <span class="word">{kWords[level]}</span>
      </p>
      <p class="quiet two" id="clearance">
        {clearance ? `${mm(clearance.distance)} ± ${mm(clearance.uncertainty)} mm` : 'the robot is not seen'}
        {clearance?.kept_out ? <b class="kept"> · held at the margin</b>
          : clearance?.uncertainty > kDoubtful ? <b class="kept"> · calibrate on the retina</b> : null}
      </p>
      <div class="bars">
        <canvas ref={canvas} width="84" height="262" role="img" id="depth_bar"
          aria-label="depth bar, mm above the zero level; white: zero, orange triangle: target" />
        <canvas ref={last} width="66" height="262" role="img" id="near_bar"
          aria-label="the last 2 mm: block: the robot, hatched: uncertainty, white line: at least so far from the wall, dashed: margin" />
      </div>
      <p class="quiet">mm over zero · last 2</p>
      <p class="figure">{row && row.z !== null ? `${mm(row.z - zero)} mm` : 'no robot'}</p>
      <p class="quiet">spread {spread === null ? '–' : formatQuantity(spread, 'm', 2)}</p>
      <p class="quiet" id="aim">{row && row.target_z !== null ? `target ${mm((depth ?? row.target_z) - zero)} mm` : 'no target'}</p>
      <button id="zero" onClick={() => row && row.z !== null && setZero(row.z)}>zero here</button>
      <div class="pair">
        <button disabled={!mine} onClick={() => jog(0.1e-3)} title="target 0.1 mm up (arrow up)">▲</button>
        <button disabled={!mine || (level === 'margin' && wall === 'retina')} onClick={() => jog(-0.1e-3)}
          title={level === 'margin' ? 'the robot is at the keep-out margin' : 'target 0.1 mm down (arrow down)'}>▼</button>
      </div>
    </section>
  );
}

function inverse(color) {
  const value = parseInt(color.slice(1), 16) ^ 0xffffff;
  return `#${value.toString(16).padStart(6, '0')}`;
}
