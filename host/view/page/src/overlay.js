// Drawing over pictures: lines with a dark casing, so that they are seen on any ground; ellipse, trail, target, scale bar, axes.

import { apply, inverse } from './held.js';

export const kTrailSpan = 10; // s
const kFont = 'Inter, system-ui, sans-serif';

/** A view of a picture: its point (cu, cv) in the middle of a box of w x h px, `scale` box pixels a picture pixel; where the retina
    is held still, `held` takes the picture's pixels to where they are shown (held.js). */
export function toBox(view, place) {
  const [u, v] = view.held ? apply(view.held, place) : place;
  return [(u - view.cu) * view.scale + view.w / 2, (v - view.cv) * view.scale + view.h / 2];
}
export function toPicture(view, [x, y]) {
  const place = [(x - view.w / 2) / view.scale + view.cu, (y - view.h / 2) / view.scale + view.cv];
  return view.held ? apply(inverse(view.held), place) : place;
}

/** Box pixels a pixel of the picture, and the turn of the picture in the box, rad. */
export const sizeOf = (view) => view.scale * (view.held ? Math.hypot(view.held.a, view.held.b) : 1);
export const turnOf = (view) => (view.held ? Math.atan2(view.held.b, view.held.a) : 0);

/** Draws a picture of w x h px into its view. */
export function drawPicture(pen, view, bitmap, w, h) {
  const [x, y] = toBox(view, [0, 0]), size = sizeOf(view), turn = turnOf(view);
  pen.save();
  pen.translate(x, y);
  pen.rotate(turn);
  pen.drawImage(bitmap, -0.5 * size, -0.5 * size, w * size, h * size);
  pen.restore();
}

/** Strokes what `path` draws: black at 65 % below, the color above. */
export function cased(pen, color, width, path, dash = []) {
  for (const [style, wide, dashes] of [['#000000a6', width + 2, []], [color, width, dash]]) {
    pen.strokeStyle = style;
    pen.lineWidth = wide;
    pen.setLineDash(dashes);
    pen.beginPath();
    path();
    pen.stroke();
  }
  pen.setLineDash([]);
}

export function label(pen, text, x, y, { color = '#fff', align = 'left', size = 13, weight = 600 } = {}) {
  pen.font = `${weight} ${size}px ${kFont}`;
  pen.textAlign = align;
  pen.lineJoin = 'round';
  pen.strokeStyle = '#000000c0';
  pen.lineWidth = 3;
  pen.strokeText(text, x, y);
  pen.fillStyle = color;
  pen.fillText(text, x, y);
}

export function polyline(pen, points) {
  points.forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
}

export function ellipse(pen, [x, y], major, minor, angle, { color = '#f0e442', dash = [] } = {}) {
  cased(pen, color, 2, () => pen.ellipse(x, y, Math.max(1, major), Math.max(1, minor), angle, 0, 2 * Math.PI), dash);
}

/** A ring with an open middle: what is below it stays in sight; its name at `beside`, clear of the robot. */
export function target(pen, [x, y], name, beside = [14, -12]) {
  cased(pen, '#e69f00', 2, () => {
    pen.moveTo(x + 8, y);
    pen.arc(x, y, 8, 0, 2 * Math.PI);
    for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      pen.moveTo(x + 8 * dx, y + 8 * dy);
      pen.lineTo(x + 15 * dx, y + 15 * dy);
    }
  });
  if (name) label(pen, name, x + beside[0], y + beside[1], { color: '#ffb938' });
}

/** The largest of 1, 2, 5 x 10^n m that is at most `most` px long at `perMeter` px/m. */
export function barLength(perMeter, most) {
  const exact = most / perMeter, power = 10 ** Math.floor(Math.log10(exact));
  return [5, 2, 1].map((step) => step * power).find((length) => length <= exact * 1.0001);
}

export function barText(length) {
  return length >= 0.9999e-3 ? `${+(length * 1e3).toPrecision(1)} mm` : `${+(length * 1e6).toPrecision(1)} µm`;
}

export function scaleBar(pen, x, y, perMeter, most = 110) {
  const length = barLength(perMeter, most), px = length * perMeter;
  cased(pen, '#fff', 2, () => polyline(pen, [[x, y - 5], [x, y], [x + px, y], [x + px, y - 5]]));
  label(pen, barText(length), x + px + 8, y + 3, { size: 12 });
}

/** Two axes from (x, y), turned by `turn` (rad, from right to down). */
export function axes(pen, x, y, turn = 0, right = 'x', up = 'y') {
  pen.save();
  pen.translate(x, y);
  pen.rotate(turn);
  cased(pen, '#fff', 1.5, () => {
    polyline(pen, [[0, -26], [0, 0], [26, 0]]);
    polyline(pen, [[-4, -21], [0, -26], [4, -21]]);
    polyline(pen, [[21, -4], [26, 0], [21, 4]]);
  });
  label(pen, right, 22, -7, { size: 12 });
  label(pen, up, 6, -20, { size: 12 });
  pen.restore();
}

/** Fits the canvas to its box at the screen's own resolution; a pen in CSS px, its size in `box`. */
export function penOf(canvas) {
  const w = canvas.clientWidth, h = canvas.clientHeight, dense = window.devicePixelRatio || 1;
  const wide = Math.round(w * dense), high = Math.round(h * dense);
  if (canvas.width !== wide) canvas.width = wide;
  if (canvas.height !== high) canvas.height = high;
  const pen = canvas.getContext('2d');
  pen.setTransform(dense, 0, 0, dense, 0, 0);
  pen.clearRect(0, 0, w, h);
  return { pen, w, h };
}
