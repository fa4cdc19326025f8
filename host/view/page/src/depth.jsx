// The depth bar of the thesis' figures 6.7 and 6.8: where the robot is between retina and lens, against a zero level that
// the operator sets, with its spread, and how far the retina is.
import { useEffect, useRef } from 'preact/hooks';
import { formatQuantity } from './format.js';
import { named, newest } from './link.js';

const kNear = 1.0e-3, kClose = 0.4e-3; // m from the retina: orange, red
const kSpread = 30; // rows: 2 s at 15 Hz
const kThinnest = 4; // px: a spread of micrometers is still seen

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

const mm = (meters) => (Math.round(meters * 1e5) / 100 + 0).toFixed(2); // never -0.00

export function DepthBar({ store, zero, setZero, depth, jog }) {
  const canvas = useRef(null);
  const row = newest(store, 'servo'), distance = store.status.retina_distance;
  const geometry = store.hello?.geometry, spread = spreadOf(store);
  const level = distance == null ? 'none' : distance < kClose ? 'close' : distance < kNear ? 'near' : 'free';
  const from = (geometry?.retina.z ?? -5e-3) - 0.6e-3, to = Math.min(geometry?.lens_z ?? 8e-3, from + 14e-3);

  useEffect(() => {
    const surface = canvas.current, pen = surface.getContext('2d');
    const { width, height } = surface;
    const y = (z) => height - ((z - from) / (to - from)) * height;
    const color = { none: '#555e68', free: '#009e73', near: '#e69f00', close: '#d55e00' }[level];
    pen.fillStyle = '#10151b';
    pen.fillRect(0, 0, width, height);
    pen.fillStyle = '#5a2626';
    pen.fillRect(0, y(geometry?.retina.z ?? from), width, height);
    pen.font = '11px system-ui';
    pen.fillStyle = '#ffc9bd';
    pen.fillText('retina', 64, height - 5);
    pen.strokeStyle = '#77828e';
    for (let k = Math.ceil((from - zero) * 1e3); zero + k / 1e3 <= to; k += 1) { // mm from the zero level, as the number below
      const at = y(zero + k / 1e3);
      pen.beginPath();
      pen.moveTo(68, at);
      pen.lineTo(k === 0 ? 80 : 76, at);
      pen.stroke();
      pen.fillStyle = k === 0 ? '#ffffff' : '#aeb8c4';
      pen.font = k === 0 ? 'bold 13px system-ui' : '13px system-ui';
      if (k % 2 === 0 && at < height - 22 && at > 12) pen.fillText(`${k}`, 84, at + 4);
    }
    if (row && row.z !== null) {
      const bottom = y(geometry?.retina.z ?? from);
      pen.fillStyle = color;
      pen.fillRect(12, y(row.z), 44, bottom - y(row.z));
      if (spread !== null) {
        const high = Math.max(kThinnest, Math.round(y(row.z - spread) - y(row.z + spread)));
        pen.fillStyle = inverse(color);
        pen.fillRect(12, Math.round(y(row.z) - high / 2), 44, high);
      }
    }
    // Both beside the bar: what is drawn over it would hide the spread.
    pen.strokeStyle = '#ffffff';
    pen.lineWidth = 2;
    for (const [left, right] of [[2, 12], [56, 80]]) {
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
      pen.moveTo(56, at);
      pen.lineTo(67, at - 6);
      pen.lineTo(67, at + 6);
      pen.fill();
    }
  });

  const mine = store.status.control === 'mine';
  return (
    <section class="depth">
      <h2>Depth</h2>
      <canvas ref={canvas} width="112" height="420" role="img" id="depth_bar"
        aria-label="depth bar, mm above the zero level; white: zero, orange triangle: target" />
      <p class="quiet">mm above zero</p>
      <p class="figure">{row && row.z !== null ? `${mm(row.z - zero)} mm` : 'no robot'}</p>
      <p class={`distance ${level}`} id="distance">
        {distance == null ? 'retina: –' : `retina ${mm(distance)} mm`}
        <br />
        {{ close: 'VERY CLOSE', near: 'near' }[level] ?? '\u00a0'}
      </p>
      <p class="quiet">spread {spread === null ? '–' : formatQuantity(spread, 'm', 2)}</p>
      <p class="quiet" id="aim">{row && row.target_z !== null ? `target ${mm((depth ?? row.target_z) - zero)} mm` : 'no target'}</p>
      <button id="zero" onClick={() => row && row.z !== null && setZero(row.z)}>zero here</button>
      <div class="pair">
        <button disabled={!mine} onClick={() => jog(0.1e-3)} title="target 0.1 mm up (arrow up)">▲</button>
        <button disabled={!mine} onClick={() => jog(-0.1e-3)} title="target 0.1 mm down (arrow down)">▼</button>
      </div>
    </section>
  );
}

function inverse(color) {
  const value = parseInt(color.slice(1), 16) ^ 0xffffff;
  return `#${value.toString(16).padStart(6, '0')}`;
}
