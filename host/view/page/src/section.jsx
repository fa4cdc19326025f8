// The section: the eye from the side in mm, from the rig's model: retina, keep-out margin, lens, the robot's body, its trail and
// target; over the side camera's picture where there is one. A click there is a target at the present y.
import { useEffect, useRef } from 'preact/hooks';
import { named, newest, present } from './link.js';
import { cased, ellipse, kTrailSpan, label, penOf, polyline, scaleBar, target } from './overlay.js';

const kHeight = 10e-3; // m, of the section
const kBelow = 0.7e-3; // m, below the retina

/** Circle of the retina as a polyline at `inside` m within it; m. */
function retinaAt(geometry, inside) {
  const { z, radius } = geometry.retina, center = z + radius, r = radius - inside, points = [];
  for (let i = -40; i <= 40; ++i) {
    const x = (i / 40) * r * 0.98;
    points.push([x, center - Math.sqrt(r * r - x * x)]);
  }
  return points;
}

/** In a narrow section the robot is kept in sight: how far its middle is moved, m. */
function shiftOf(store, width) {
  const x = newest(store, 'servo')?.x ?? 0, room = Math.max(0, width / 2 - 1.6e-3);
  return Math.sign(x) * Math.max(0, Math.abs(x) - room);
}

export function Section({ store, slot }) {
  const canvas = useRef(null), view = useRef(null), frame = store.frames[slot], geometry = store.hello?.geometry;
  const lens = geometry?.lens_z ?? null;
  const draw = () => {
    if (!canvas.current || !geometry) return;
    const { pen, w, h } = penOf(canvas.current), scale = h / kHeight, foot = geometry.retina.z - kBelow;
    const shift = shiftOf(store, w / scale), place = ([x, z]) => [w / 2 + (x - shift) * scale, h - (z - foot) * scale];
    view.current = { w, h, scale, foot, shift };
    pen.fillStyle = '#2a3037';
    pen.fillRect(0, 0, w, h);
    const now = store.frames[slot];
    if (now) { // orthographic along y: one scale
      const px = geometry.side_pixel, [u0, v0] = geometry.side_center;
      pen.drawImage(now.bitmap, ...place([(-0.5 - u0) * px, (v0 + 0.5) * px]), now.width * px * scale, now.height * px * scale);
    }
    const wall = retinaAt(geometry, 0), reach = wall.map(place);
    pen.fillStyle = '#6d2b27d0';
    pen.beginPath();
    polyline(pen, reach);
    pen.lineTo(w + 999, h + 9);
    pen.lineTo(-999, h + 9);
    pen.fill();
    cased(pen, '#ffc9bd', 2, () => polyline(pen, reach));
    cased(pen, '#ffc9bd', 1, () => polyline(pen, retinaAt(geometry, geometry.margin).map(place)), [4, 3]);
    if (lens !== null && lens < foot + kHeight) {
      cased(pen, '#aeb8c4', 2, () => polyline(pen, [[-4e-3, lens], [4e-3, lens]].map(place)));
      label(pen, 'lens', ...place([0, lens + 0.1e-3]), { align: 'center', size: 12 });
    }
    drawRobot(pen, store, geometry, place, scale);
    scaleBar(pen, 12, h - 12, scale, w / 4);
  };
  useEffect(draw);

  const click = (event) => {
    const row = newest(store, 'servo'), edge = canvas.current.getBoundingClientRect(), { w, h, scale, foot, shift } = view.current ?? {};
    if (!row || !scale) return;
    if (store.status.control !== 'mine') return void (store.say('refused: take control first; until then you watch'), store.tell());
    const x = (event.clientX - edge.left - w / 2) / scale + shift, z = foot + (h - (event.clientY - edge.top)) / scale;
    store.depth = z;
    store.send({ do: 'target', place: [x, row.target_y ?? row.y ?? 0, z] });
  };
  return (
    <div class="section">
      <canvas ref={canvas} id="section" class="over" aria-label="section from the side: retina, margin, robot, target" onClick={click} data-frame={frame?.number ?? ''} />
      <span class="chip title" title={frame ? 'x to the right, z up' : 'there is no side camera'}>{frame ? 'From the side' : 'From the model'}</span>
      {lens !== null && geometry && lens >= geometry.retina.z - kBelow + kHeight ? <span class="chip lens">lens {(lens * 1e3).toFixed(1)} mm ↑</span> : null}
      <span class="chip where">retina</span>
    </div>
  );
}

function drawRobot(pen, store, geometry, place, scale) {
  const held = store.streams.servo, row = present(store, 'servo');
  if (!row) return;
  const trail = held.rows.filter((r) => r[0] > row.t - kTrailSpan).map((r) => named(held, r)).filter((r) => r.x !== null);
  if (trail.length > 1) cased(pen, '#56b4e9', 2, () => polyline(pen, trail.map((r) => place([r.x, r.z]))));
  const seen = row.x !== null ? row : trail[trail.length - 1];
  if (seen) {
    // Outline of the body seen along y: an ellipsoid of revolution about its axis.
    const near = newest(store, 'clearance'), { semi_axis: a = 1e-3, semi_radius: b = 0.5e-3 } = geometry.body ?? {};
    const [ax, az] = [near?.axis_x ?? 1, near?.axis_z ?? 0], across = Math.hypot(ax, az);
    const long = Math.sqrt(Math.max(b * b, a * a * across * across + b * b * (1 - across * across)));
    ellipse(pen, place([seen.x, seen.z]), long * scale, b * scale, across > 1e-6 ? Math.atan2(-az, ax) : 0, { dash: seen === row ? [] : [6, 4] });
    if (seen.sigma_z !== null && 2.45 * seen.sigma_z * scale > 6)
      ellipse(pen, place([seen.x, seen.z]), 2.45 * seen.sigma_x * scale, 2.45 * seen.sigma_z * scale, 0, { color: '#cc79a7', dash: [6, 4] });
  }
  if (row.target_x !== null) target(pen, place([row.target_x, row.target_z]));
}
