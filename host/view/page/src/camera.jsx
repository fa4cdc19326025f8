// One camera's picture with what the loop knows drawn on it; a click gives a target, a drag a path.
import { useEffect, useRef } from 'preact/hooks';
import { named, newest } from './link.js';

const kTrail = 150;

function rowAt(held, time) {
  for (let i = held.rows.length - 1; i >= 0 && i > held.rows.length - 40; --i)
    if (Math.abs(held.rows[i][0] - time) < 1e-6) return named(held, held.rows[i]);
  return null;
}

function drawTop(pen, store, frame, scale) {
  const held = store.streams.servo;
  if (!held) return;
  const row = rowAt(held, frame.time) ?? newest(store, 'servo');
  const trail = held.rows.slice(-kTrail).map((r) => named(held, r)).filter((r) => r.u_px !== null);
  pen.lineWidth = 1.5 * scale;
  pen.strokeStyle = '#56b4e9';
  pen.beginPath();
  trail.forEach((r, i) => (i ? pen.lineTo(r.u_px, r.v_px) : pen.moveTo(r.u_px, r.v_px)));
  pen.stroke();
  const target = store.status.target_px;
  if (target) {
    pen.strokeStyle = '#e69f00';
    pen.lineWidth = 2 * scale;
    pen.beginPath();
    pen.arc(target[0], target[1], 9 * scale, 0, 2 * Math.PI);
    pen.moveTo(target[0] - 14 * scale, target[1]);
    pen.lineTo(target[0] + 14 * scale, target[1]);
    pen.moveTo(target[0], target[1] - 14 * scale);
    pen.lineTo(target[0], target[1] + 14 * scale);
    pen.stroke();
  }
  if (!row || row.u_px === null) return;
  pen.strokeStyle = '#f0e442';
  pen.lineWidth = 2 * scale;
  pen.beginPath();
  pen.ellipse(row.u_px, row.v_px, row.semi_major_px, row.semi_minor_px, row.angle, 0, 2 * Math.PI);
  pen.stroke();
  const perMeter = store.hello?.geometry.top_px_per_m;
  if (perMeter && row.sigma_x !== null) {
    pen.strokeStyle = '#cc79a7'; // ten times the 95 % ellipse, or nobody would see it
    pen.setLineDash([6 * scale, 4 * scale]);
    pen.beginPath();
    pen.ellipse(row.u_px, row.v_px, 24.5 * row.sigma_x * perMeter, 24.5 * row.sigma_y * perMeter, 0, 0, 2 * Math.PI);
    pen.stroke();
    pen.setLineDash([]);
  }
}

function drawSide(pen, store, scale) {
  const row = newest(store, 'servo'), geometry = store.hello?.geometry;
  if (!row || !geometry || row.target_x === null) return;
  const u = geometry.side_center[0] + row.target_x / geometry.side_pixel;
  const v = geometry.side_center[1] - row.target_z / geometry.side_pixel;
  pen.strokeStyle = '#e69f00';
  pen.lineWidth = 2 * scale;
  pen.beginPath();
  pen.arc(u, v, 9 * scale, 0, 2 * Math.PI);
  pen.stroke();
}

const kNames = { top_camera: 'Through the eye', side_camera: 'From the side' };

export function CameraView({ store, camera, slot, depth }) {
  const canvas = useRef(null), path = useRef(null), given = useRef(null); // what is being drawn, and what was, until the next
  const frame = store.frames[slot];
  const mine = store.status.control === 'mine' && store.status.takes_targets;

  const draw = () => {
    const frame = store.frames[slot]; // the newest: the one of the rendering may have been let go since
    if (!frame || !canvas.current) return;
    const surface = canvas.current;
    if (surface.width !== frame.width) surface.width = frame.width;
    if (surface.height !== frame.height) surface.height = frame.height;
    const pen = surface.getContext('2d');
    const scale = Math.max(1, frame.width / 640);
    pen.drawImage(frame.bitmap, 0, 0);
    if (camera === 'top_camera') drawTop(pen, store, frame, scale);
    else drawSide(pen, store, scale);
    if (store.note.startsWith('refused')) given.current = null;
    const drawn = path.current ?? given.current;
    if (drawn?.length > 1) {
      pen.strokeStyle = path.current ? '#ffffff' : '#ffffff99';
      pen.lineWidth = 2 * scale;
      pen.beginPath();
      drawn.forEach(([u, v], i) => (i ? pen.lineTo(u, v) : pen.moveTo(u, v)));
      pen.stroke();
    }
  };
  useEffect(draw);

  const place = (event) => {
    const box = canvas.current.getBoundingClientRect(), { width, height } = canvas.current;
    const scale = Math.min(box.width / width, box.height / height); // the picture stands in the middle of its box
    return [(event.clientX - box.left - (box.width - width * scale) / 2) / scale,
            (event.clientY - box.top - (box.height - height * scale) / 2) / scale];
  };
  const begin = (event) => {
    if (!mine) return;
    canvas.current.setPointerCapture(event.pointerId);
    path.current = [place(event)];
    given.current = null;
  };
  const move = (event) => {
    if (!path.current) return;
    const [u, v] = place(event), [lu, lv] = path.current[path.current.length - 1];
    if (Math.hypot(u - lu, v - lv) <= canvas.current.width / 80) return;
    path.current.push([u, v]);
    draw(); // at once: the next frame may be a while
  };
  const finish = () => {
    if (!path.current) return;
    const points = path.current.slice(0, 1000);
    path.current = null;
    given.current = points;
    const row = newest(store, 'servo');
    if (camera === 'top_camera') store.send({ do: 'target', camera, points, z: depth ?? row?.target_z ?? 0 });
    else store.send({ do: 'target', camera, points, y: row?.target_y ?? 0 });
  };

  return (
    <figure class={`camera ${mine ? 'aim' : ''}`}>
      <canvas ref={canvas} id={camera} width="640" height="480" aria-label={kNames[camera] ?? camera}
        onPointerDown={begin} onPointerMove={move} onPointerUp={finish} onPointerCancel={() => (path.current = null)} />
      <figcaption>
        <b>{kNames[camera] ?? camera}</b>
        {frame ? ` frame ${frame.number}, ${frame.time.toFixed(2)} s` : ' no picture yet'}
        {mine ? ' · click: target, drag: path' : ''}
      </figcaption>
    </figure>
  );
}
