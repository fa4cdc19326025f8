// Plots of the last minute: clearance with its 99 % band over the zones, error of the loop at a fixed scale. Axes have names,
// units and "now" at the right; what leaves the scale is marked at the edge with its largest value.
import { useState } from 'preact/hooks';
import { named } from './link.js';
import { useSize } from './depth.jsx';

const kSpan = 60; // s
const kError = 300; // µm: the scale of the error's plot where the protocol says no `within`; else three times that
const kGap = 0.5; // s: a longer gap stays a gap

const kDashes = ['', '6 4', '2 3'];
const kColors = ['var(--accent)', 'var(--second)', 'var(--third)'];

/** Points as the pieces of a path, broken at gaps. */
function pathOf(points, x, y) {
  let text = '', before = null;
  for (const [t, value] of points) {
    if (value === null || !Number.isFinite(value)) { before = null; continue; }
    text += `${before !== null && t - before < kGap ? 'L' : 'M'}${x(t).toFixed(1)} ${y(value).toFixed(1)}`;
    before = t;
  }
  return text;
}

function Frame({ title, unit, keys, w, h, ticks, y, children, onHover }) {
  const left = 38, right = w - 10, top = 6, foot = h - 18, x = (age) => right - (age / kSpan) * (right - left);
  return h < 30 ? null : (
    <>
      {ticks.map((value) => <><line x1={left} x2={right} y1={y(value)} y2={y(value)} stroke="var(--hair)" /><text x={left - 5} y={y(value) + 4} text-anchor="end">{String(value).replace('-', '−')}</text></>)}
      {[60, 45, 30, 15, 0].map((age) => <text x={x(age)} y={h - 4} text-anchor={age === 0 ? 'end' : age === 60 ? 'start' : 'middle'}>{age === 0 ? 'now' : `−${age}${age === 60 ? ' s' : ''}`}</text>)}
      {children}
      <rect x={left} y={top} width={Math.max(0, right - left)} height={Math.max(0, foot - top)} fill="transparent" onPointerMove={onHover} onPointerLeave={() => onHover(null)} />
    </>
  );
}

const Key = ({ name, color, dash, band }) => (
  <span class="key"><svg viewBox="0 0 18 8">{band ? <rect width="18" height="8" fill={color} /> : <path d="M0 4H18" stroke={color} stroke-width="2" stroke-dasharray={dash} />}</svg>{name}</span>
);

function rowsOf(store, stream) {
  const held = store.streams[stream];
  if (!held || held.rows.length === 0) return [[], 0];
  const last = Math.max(store.ended === null ? store.time : 0, held.rows[held.rows.length - 1][0]);
  return [held.rows.filter((row) => row[0] > last - kSpan).map((row) => named(held, row)), last];
}

function useHover() {
  const [at, setAt] = useState(null);
  return [at, (event) => setAt(event ? event.offsetX : null)];
}

export function ClearancePlot({ store }) {
  const [place, w, h] = useSize(), [rows, last] = rowsOf(store, 'clearance'), [hover, onHover] = useHover();
  const known = rows.filter((r) => r.distance !== null);
  const most = Math.max(2, ...known.map((r) => (r.distance + r.uncertainty) * 1e3)), top = most > 8 ? 14 : Math.ceil(most);
  const left = 38, right = w - 10, foot = h - 18, x = (t) => right - ((last - t) / kSpan) * (right - left), y = (v) => foot - (Math.max(0, v) / top) * (foot - 6);
  const step = top > 8 ? 4 : top > 4 || h < 90 ? 2 : 1, ticks = [];
  for (let v = 0; v <= top; v += step) ticks.push(v);
  const upper = known.map((r) => `${x(r.t).toFixed(1)} ${y((r.distance + r.uncertainty) * 1e3).toFixed(1)}`);
  const lower = known.map((r) => `${x(r.t).toFixed(1)} ${y(Math.max(0, r.bound) * 1e3).toFixed(1)}`).reverse();
  const near = hover === null || !known.length ? null : known.reduce((a, b) => (Math.abs(x(b.t) - hover) < Math.abs(x(a.t) - hover) ? b : a));
  return (
    <section class="panel plot clearance-plot">
      <h2>Clearance <span class="quiet">mm</span><span class="right" /><Key name="estimate" color="var(--accent)" /><Key name="99 %" color="var(--band)" band /></h2>
      <svg ref={place} role="img" aria-label="clearance over the last minute, mm">
        <Frame w={w} h={h} ticks={ticks} y={y} onHover={onHover}>
          <rect x={left} width={Math.max(0, right - left)} y={y(0.4)} height={Math.max(0, y(0) - y(0.4))} fill="var(--zone-close)" />
          <rect x={left} width={Math.max(0, right - left)} y={y(1)} height={Math.max(0, y(0.4) - y(1))} fill="var(--zone-near)" />
          {upper.length > 1 ? <path d={`M${upper.join('L')}L${lower.join('L')}Z`} fill="var(--band)" opacity="0.8" /> : null}
          <path d={pathOf(rows.map((r) => [r.t, r.distance === null ? null : r.distance * 1e3]), x, y)} fill="none" stroke="var(--accent)" stroke-width="2" />
          {near ? <><line x1={x(near.t)} x2={x(near.t)} y1="6" y2={foot} stroke="var(--text3)" />
            <text x={x(near.t) < w / 2 ? x(near.t) + 5 : x(near.t) - 5} y="16" text-anchor={x(near.t) < w / 2 ? 'start' : 'end'} style={{ fill: 'var(--text)' }}>
              {`${(near.distance * 1e3).toFixed(2)} ± ${(near.uncertainty * 1e3).toFixed(2)} mm, ${(last - near.t).toFixed(1)} s ago`}</text></> : null}
        </Frame>
      </svg>
    </section>
  );
}

export function ErrorPlot({ store }) {
  const [place, w, h] = useSize(), [rows, last] = rowsOf(store, 'servo'), [hover, onHover] = useHover();
  const within = store.hello?.parameters?.within, scale = within > 0 ? Math.min(1200, Math.max(100, 3e6 * within)) : kError;
  const left = 38, right = w - 10, foot = h - 18, middle = (6 + foot) / 2;
  const x = (t) => right - ((last - t) / kSpan) * (right - left), y = (v) => middle - (Math.max(-scale, Math.min(scale, v)) / scale) * (foot - 6) / 2;
  const series = ['x', 'y', 'z'].map((axis) => rows.map((r) => [r.t, r[axis] === null || r[`target_${axis}`] === null ? null : (r[axis] - r[`target_${axis}`]) * 1e6]));
  const all = series.flat().filter(([, v]) => v !== null && Math.abs(v) > scale);
  const worst = all.length ? all.reduce((a, b) => (Math.abs(b[1]) > Math.abs(a[1]) ? b : a)) : null;
  const at = hover === null || !rows.length ? null : rows.reduce((best, r, i) => (Math.abs(x(r.t) - hover) < Math.abs(x(rows[best].t) - hover) ? i : best), 0);
  return (
    <section class="panel plot error-plot">
      <h2>Error <span class="quiet">µm</span><span class="right" />{['x', 'y', 'z'].map((name, i) => <Key name={name} color={kColors[i]} dash={kDashes[i]} />)}</h2>
      <svg ref={place} role="img" aria-label="error of the loop over the last minute, µm">
        <Frame w={w} h={h} ticks={[-scale, 0, scale].map(Math.round)} y={y} onHover={onHover}>
          {series.map((points, i) => <path d={pathOf(points, x, y)} fill="none" stroke={kColors[i]} stroke-width="1.5" stroke-dasharray={kDashes[i]} />)}
          {worst ? <><path d={`M${x(worst[0])} ${worst[1] > 0 ? 6 : foot}l-4 ${worst[1] > 0 ? 7 : -7}h8z`} fill="var(--accent)" />
            <text x={x(worst[0]) - 8} y={worst[1] > 0 ? 14 : foot - 2} text-anchor={x(worst[0]) > 90 ? 'end' : 'start'} style={{ fill: 'var(--accent)' }}>{`${(worst[1] / 1000).toFixed(1).replace('-', '−')} mm`}</text></> : null}
          {at !== null ? <><line x1={x(rows[at].t)} x2={x(rows[at].t)} y1="6" y2={foot} stroke="var(--text3)" />
            <text x={left + 5} y={foot - 4} style={{ fill: 'var(--text)' }}>{series.map((s, i) => `${'xyz'[i]} ${s[at][1] === null ? '–' : s[at][1].toFixed(0).replace('-', '−')}`).join('  ')} µm</text></> : null}
        </Frame>
      </svg>
    </section>
  );
}
