// Clearance: how far the robot's surface is from retina or lens at least (the lower end of the 99 % interval), in large figures;
// the thesis' depth bar (figures 6.7 and 6.8) over the whole eye, and the last 2 mm always at one scale. Colors, words and
// bars follow the lower end, never the estimate.
import { useEffect, useRef, useState } from 'preact/hooks';
import { named, newest, present } from './link.js';

const kNear = 1.0e-3, kClose = 0.4e-3; // m, of the bound: near, very close
const kHysteresis = 0.05e-3; // m, upwards
const kDoubtful = 0.5e-3; // m: an uncertainty above it asks for a calibration; the level stays that of the bound, or red might come late
const kLast = 2e-3; // m, of the bar beside the bar
const kEye = 14e-3; // m, of the whole eye
const kSpread = 30; // rows: 2 s at 15 Hz
const kStale = 1; // s without a clearance
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

export const mm = (meters) => (Math.round(meters * 1e5) / 100 + 0).toFixed(2).replace('-', '−'); // never -0.00
const least = (meters) => (Math.floor(Math.max(0, meters) * 1e5) / 100).toFixed(2); // "at least": rounded down

/** The newest clearance that is one; null when the robot was not seen for a second, or no loop looks for it. */
export function clearanceOf(store) {
  const held = store.streams.clearance;
  if (!present(store, 'clearance')) return null;
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

/** Size of an element in CSS px, kept up to date. */
export function useSize() {
  const place = useRef(null), [size, setSize] = useState([0, 0]);
  useEffect(() => {
    const fit = new ResizeObserver(([entry]) => setSize([entry.contentRect.width, entry.contentRect.height]));
    fit.observe(place.current);
    return () => fit.disconnect();
  }, []);
  return [place, ...size];
}

/** Left the whole eye, right the last 2 mm; heights over the wall in m. */
function Bars({ store, clearance, level, depth }) {
  const [place, w, h] = useSize(), geometry = store.hello?.geometry, row = present(store, 'servo');
  const top = 22, foot = h - 24, y = (height, span) => foot - (height / span) * (foot - top);
  const begin = Math.max(w * 0.44, 54), left = { x: 24, w: Math.max(12, w * 0.13) }, right = { x: begin, w: Math.max(24, w - begin - 28) };
  const wall = clearance?.at_lens ? 'lens' : 'retina', z0 = geometry?.retina.z ?? 0;
  const body = row?.z != null ? { low: row.z - z0 - reachOf(geometry, clearance), high: row.z - z0 + reachOf(geometry, clearance) } : null;
  const aim = depth ?? row?.target_z ?? null, spread = spreadOf(store);
  const { bound, distance, uncertainty } = clearance ?? {};
  const zone = (from, to, color) => <rect x={right.x} width={right.w} y={y(to, kLast)} height={Math.max(0, y(from, kLast) - y(to, kLast))} fill={color} />;
  const far = bound > kLast, block = clearance && !far ? y(Math.max(bound, 0), kLast) : null;
  const hatchTop = clearance && !far ? Math.max(top, y(Math.min(kLast, distance + uncertainty), kLast)) : null;
  return (
    <svg class="bars" ref={place} role="img" id="depth_bar" data-level={level} aria-label="left: the whole eye, right: the last 2 mm over the wall">
      {h > 60 ? <>
        <defs><pattern id="hatch" width="7" height="7" patternUnits="userSpaceOnUse" patternTransform="rotate(45)"><rect width="7" height="7" fill="var(--body)" /><rect width="3" height="7" fill="#0a0d11" /></pattern></defs>
        <text x={left.x + left.w / 2} y="12" text-anchor="middle">eye</text><text x={right.x + right.w / 2} y="12" text-anchor="middle">{w > 150 ? 'last 2 mm' : '2 mm'}</text>
        <rect x={left.x} y={top} width={left.w} height={foot - top} fill="var(--control)" />
        {[0, 4, 8, 12, 14].map((mark) => <><line x1={left.x - 5} x2={left.x} y1={y(mark / 1e3, kEye)} y2={y(mark / 1e3, kEye)} stroke="var(--text3)" />
          <text x={left.x - 7} y={y(mark / 1e3, kEye) + (mark === 12 ? 8 : 4)} text-anchor="end">{mark === 12 && foot - top < 200 ? '' : mark}</text></>)}
        <path d={`M${left.x + left.w} ${y(kLast, kEye)}L${right.x} ${top}M${left.x + left.w} ${foot}L${right.x} ${foot}`} stroke="var(--hair)" />
        {body ? <rect class="body" x={left.x + 1} width={left.w - 2} y={y(body.high, kEye)} height={Math.max(4, y(body.low, kEye) - y(body.high, kEye))} fill="var(--body)" /> : null}
        {body && spread !== null ? <rect class="spread" x={left.x + 1} width={left.w - 2} height={Math.max(3, y(0, kEye) - y(2 * spread, kEye))}
          y={y((body.low + body.high) / 2, kEye) - Math.max(3, y(0, kEye) - y(2 * spread, kEye)) / 2} fill="var(--accent)" /> : null}
        {body && bound != null ? <rect x={left.x - 3} width={left.w + 6} height="2" y={y(Math.max(0, bound), kEye) - 1} fill="var(--text)" /> : null}
        {aim !== null ? <path class="aim" d={`M${left.x + left.w + 1} ${y(aim - z0, kEye)}l9 -6v12z`} fill="var(--second)" /> : null}
        {zone(0, kClose, 'var(--zone-close)')}{zone(kClose, kNear, 'var(--zone-near)')}{zone(kNear, kLast, 'var(--zone-clear)')}
        {[0.5, 1, 1.5, 2].map((mark) => <><line x1={right.x + right.w} x2={right.x + right.w + 5} y1={y(mark / 1e3, kLast)} y2={y(mark / 1e3, kLast)} stroke="var(--text3)" />
          <text x={right.x + right.w + 7} y={y(mark / 1e3, kLast) + 4}>{mark}</text></>)}
        {block !== null ? <>
          <rect class="block" x={right.x + 6} width={right.w - 12} y={top} height={Math.max(0, hatchTop - top)} fill="var(--body)" />
          <rect class="doubt" x={right.x + 6} width={right.w - 12} y={hatchTop} height={Math.max(0, block - hatchTop)} fill="url(#hatch)" />
          <rect class="at-least" x={right.x + 1} width={right.w - 2} y={block - 2} height="4" fill="var(--text)" /></> : null}
        {far ? <path d={`M${right.x + right.w / 2} ${top + 8}l8 11h-16z`} fill="var(--text)" /> : null}
        {geometry ? <line x1={right.x} x2={right.x + right.w} y1={y(geometry.margin, kLast)} y2={y(geometry.margin, kLast)} stroke="var(--stop-edge)" stroke-dasharray="4 3" /> : null}
        <rect x={left.x - 2} width={right.x + right.w - left.x + 4} y={foot} height="18" fill="var(--wall)" />
        <line x1={left.x - 2} x2={right.x + right.w + 2} y1={foot} y2={foot} stroke="var(--wall-edge)" stroke-width="2" />
        <text x={(left.x + right.x + right.w) / 2} y={foot + 13} text-anchor="middle" style={{ fill: 'var(--wall-edge)' }}>{wall}</text>
      </> : null}
    </svg>
  );
}

export function Depth({ store, zero, jog }) {
  const before = useRef('free');
  const row = present(store, 'servo'), clearance = clearanceOf(store), geometry = store.hello?.geometry;
  const level = levelOf(clearance, geometry?.margin ?? 0, before.current), { depth } = store;
  before.current = level;
  const live = store.ended === null, mine = live && store.status.control === 'mine', wall = clearance?.at_lens ? 'lens' : 'retina';
  const stay = level === 'margin' && wall === 'retina';
  const said = !live ? 'not held' : level === 'unknown' && !row ? (newest(store, 'servo') ? 'not watched' : 'no robot yet') : kWords[level];
  return (
    <section class={`depth panel ${live ? level : 'unknown'}`}>
      <div class="numbers" id="distance" data-level={level} role="status">
        <h2>{live ? `Clearance${level === 'unknown' ? '' : ', at least'}` : 'Last clearance'}</h2>
        <b class={`bound ${clearance?.bound >= 9.995e-3 ? 'long' : ''}`}>{level === 'unknown' ? '– –' : least(clearance.bound)}<small> mm</small></b>
        <span class="word">{said}</span>
        <span class="tiny estimate" id="clearance" title="estimate and its 99 % half width">
          {clearance ? `${mm(clearance.distance)} ± ${mm(clearance.uncertainty)} mm${clearance.kept_out ? ', held off' : ''}` : present(store, 'clearance') ? 'the robot is not seen' : 'no loop looks for it'}
        </span>
        {clearance?.uncertainty > kDoubtful && !clearance.kept_out ? <span class="tiny aim-line">calibrate on the {wall}</span> : null}
        <span class="tiny aim-line" id="aim">{row && row.target_z !== null ? `target z ${mm((depth ?? row.target_z) - zero)} mm` : 'no target'}</span>
      </div>
      <Bars store={store} clearance={clearance} level={level} depth={depth} />
      {live ? <div class="jog">
        <button disabled={!mine} onClick={() => jog(0.1e-3)} title="target 0.1 mm up (arrow up)">▲<span class="step"> 0.1</span></button>
        <button disabled={!mine || stay} onClick={() => jog(-0.1e-3)}
          title={stay ? 'the robot is at the keep-out margin' : 'target 0.1 mm down (arrow down)'}>▼<span class="step"> 0.1</span></button>
      </div> : null}
    </section>
  );
}
