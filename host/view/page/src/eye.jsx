// The eye: the top camera's picture with what the loop knows drawn on it. A click gives a target, a drag a path; zoom, pan,
// contrast (of the display alone), measuring and flags. Positions under the pointer come from the rig's model ("where").
import { useEffect, useRef, useState } from 'preact/hooks';
import { holding, known } from './held.js';
import { named, newest, present } from './link.js';
import { LightPanel, Tools } from './tools.jsx';
import { axes, cased, drawPicture, ellipse, kTrailSpan, label, penOf, polyline, scaleBar, sizeOf, target, toBox, toPicture, turnOf } from './overlay.js';

const kClick = 6; // px: a drag that is shorter is a click
const kAsk = 100; // ms between two questions for a position
const kRoom = 24; // px: radius of a circle that has room for two words
const kLate = 250, kOld = 1000; // ms

const mm = (meters, digits = 2) => (meters * 1e3).toFixed(digits).replace('-', '−');

function rowAt(held, time) {
  for (let i = held.rows.length - 1; i >= 0 && i > held.rows.length - 40; --i)
    if (Math.abs(held.rows[i][0] - time) < 1e-6) return named(held, held.rows[i]);
  return null;
}

/** Ellipse, trail and target of the loop; the robot's last ellipse dashed where it is lost. Where the retina is held still the
    trail is the way over it: each of its points by the frame of its own time. */
function drawLoop(pen, view, store, frame) {
  const held = store.streams.servo;
  if (!present(store, 'servo')) return;
  const recent = held.rows.filter((row) => row[0] > frame.time - kTrailSpan).map((row) => named(held, row)).filter((r) => r.u_px !== null);
  if (recent.length > 1) cased(pen, '#56b4e9', 2, () => polyline(pen, recent.map((r) => toBox(view.heldAt ? { ...view, held: view.heldAt(r.t) ?? view.held } : view, [r.u_px, r.v_px]))));
  const now = rowAt(held, frame.time) ?? newest(store, 'servo'), seen = now.u_px !== null ? now : recent[recent.length - 1];
  if (seen) {
    const place = toBox(view, [seen.u_px, seen.v_px]);
    ellipse(pen, place, seen.semi_major_px * sizeOf(view), seen.semi_minor_px * sizeOf(view), seen.angle + turnOf(view), { dash: seen === now ? [] : [6, 4] });
    const perMeter = view.perMeter * sizeOf(view), sigma = Math.max(seen.sigma_x ?? 0, seen.sigma_y ?? 0);
    if (2.45 * sigma * perMeter > 6)
      ellipse(pen, place, 2.45 * seen.sigma_x * perMeter, 2.45 * seen.sigma_y * perMeter, turnOf(view), { color: '#cc79a7', dash: [6, 4] });
    const near = newest(store, 'clearance');
    if (near?.bound != null && near.bound < 1e-3) label(pen, `${mm(Math.max(0, near.bound))} mm`, place[0] + 14, place[1] + 26, { color: '#f0e442', size: 15 });
  }
  const aimed = store.status.target_px;
  if (!aimed) return;
  const covers = seen && Math.hypot(seen.u_px - aimed[0], seen.v_px - aimed[1]) < seen.semi_major_px;
  target(pen, toBox(view, aimed), 'target', covers ? [0.6 * seen.semi_major_px * sizeOf(view), -seen.semi_major_px * sizeOf(view) * 0.75 - 4] : undefined);
}

/** Zones of the retina that the robot keeps out of, where the last frame showed them; dashed where that is a second ago. */
function drawZones(pen, view, store, frame) {
  const held = store.streams.no_go_zones;
  const zones = new Map((held?.rows ?? []).slice(-40).map((row) => named(held, row)).map((zone) => [zone.zone, zone]));
  for (const zone of zones.values()) {
    const place = toBox(view, [zone.u_px, zone.v_px]), radius = zone.radius_px * sizeOf(view);
    ellipse(pen, place, radius, radius, 0, { color: '#d55e00', dash: frame.time - zone.t < 1 ? [] : [6, 4] });
    label(pen, 'no go', place[0], place[1] + (radius > kRoom ? 4 : radius + 15), { color: '#ff9b57', align: 'center' });
  }
}

export function Eye({ store, slot, hooks }) {
  const box = useRef(null), picture = useRef(null), over = useRef(null);
  const [tool, setTool] = useState('aim'), [hold, setHold] = useState(false), [look, setLook] = useState({ low: 0, high: 255, open: false });
  const state = useRef({ zoom: 1, center: null, path: null, given: null, ruler: null, flags: [], cursor: null, reference: null, pointers: new Map(), asked: 0, id: 0, waits: {} }).current;
  const frame = store.frames[slot], mine = store.status.control === 'mine' && store.status.takes_targets;
  const size = frame ? [frame.width, frame.height] : [1384, 1036];

  const viewNow = (w, h) => {
    const scale = Math.min(w / size[0], h / size[1]) * state.zoom;
    const [cu, cv] = state.center ?? [size[0] / 2 - 0.5, size[1] / 2 - 0.5];
    return { w, h, scale, cu, cv, perMeter: state.perMeter ?? store.hello?.geometry.top_px_per_m ?? null };
  };
  const depth = () => store.depth ?? newest(store, 'servo')?.target_z ?? newest(store, 'servo')?.z ?? 0;

  const draw = () => {
    if (!over.current || !picture.current) return;
    const now = store.frames[slot]; // the newest: the one of the rendering may have been let go since
    const { pen: ground, w, h } = penOf(picture.current), { pen } = penOf(over.current);
    const view = (state.view = viewNow(w, h));
    if (!now) return;
    if (hold) {
      const { reference, at } = holding(store, now.time, state.reference);
      Object.assign(state, { reference });
      Object.assign(view, { held: at(now.time), heldAt: at });
    }
    state.isHeld = !!view.held;
    ground.imageSmoothingEnabled = view.scale < 3;
    drawPicture(ground, view, now.bitmap, ...size);
    drawZones(pen, view, store, now);
    drawLoop(pen, view, store, now);
    if (store.note.startsWith('refused')) state.given = null;
    const drawn = state.path ?? state.given;
    if (drawn?.length > 1) cased(pen, state.path ? '#ffffff' : '#ffffff99', 2, () => polyline(pen, drawn.map((p) => toBox(view, p))));
    drawMarks(pen, view, state);
    axes(pen, 22, h - 20, turnOf(view));
    if (view.perMeter) scaleBar(pen, 72, h - 20, view.perMeter * sizeOf(view), Math.min(130, w / 4));
  };
  useEffect(draw);
  useEffect(() => {
    const fit = new ResizeObserver(draw);
    fit.observe(box.current);
    return () => fit.disconnect();
  }, [slot]);

  // Positions by the model: scale, cursor, ruler and flags. The answer carries the question's number.
  const ask = (points, then) => {
    if (store.ended !== null || !store.connected || !store.hello) return void then(points.map(() => null));
    const id = ++state.id;
    state.waits[id] = then;
    store.send({ do: 'where', id, camera: 'top_camera', points, z: depth() });
  };
  if (store.where && state.waits[store.where.id]) {
    const then = state.waits[store.where.id], { places } = store.where;
    state.waits = {};
    then(places);
  }
  useEffect(() => {
    if (!store.connected || !frame || store.ended !== null || !store.hello) return undefined;
    const timer = setInterval(() => {
      const [u, v] = [size[0] / 2, size[1] / 2];
      ask([[u - 50, v], [u + 50, v]], ([a, b]) => { if (a && b) state.perMeter = 100 / Math.hypot(b[0] - a[0], b[1] - a[1]); });
    }, 1000);
    return () => clearInterval(timer);
  }, [store.connected, !!frame, store.ended, !!store.hello]);

  const at = (event) => {
    const edge = over.current.getBoundingClientRect();
    return [event.clientX - edge.left, event.clientY - edge.top];
  };
  const clamp = () => { if (state.zoom <= 1.001) Object.assign(state, { zoom: 1, center: null }); };
  const zoomAt = ([x, y], factor) => {
    const shown = { ...state.view, held: null }, before = toPicture(shown, [x, y]);
    state.zoom = Math.min(16, Math.max(1, state.zoom * factor));
    const view = viewNow(state.view.w, state.view.h);
    state.center = [before[0] - (x - view.w / 2) / view.scale, before[1] - (y - view.h / 2) / view.scale];
    clamp();
    draw();
  };
  const panBy = (dx, dy) => {
    if (state.zoom <= 1) return;
    const { scale, cu, cv } = state.view;
    state.center = [cu - dx / scale, cv - dy / scale];
    draw();
  };

  const begin = (event) => {
    over.current.setPointerCapture(event.pointerId);
    state.pointers.set(event.pointerId, at(event));
    state.start = at(event);
    state.dragged = false;
    if (state.pointers.size > 1) return void (state.path = null);
    if (tool === 'aim' && mine) Object.assign(state, { path: [toPicture(state.view, state.start)], given: null });
    if (tool === 'measure') state.ruler = { ends: [toPicture(state.view, state.start), toPicture(state.view, state.start)], length: null };
  };
  const move = (event) => {
    const here = at(event), before = state.pointers.get(event.pointerId);
    ponder(here);
    if (!before) return;
    state.pointers.set(event.pointerId, here);
    if (Math.hypot(here[0] - state.start[0], here[1] - state.start[1]) > kClick) state.dragged = true;
    if (state.pointers.size === 2) return pinch(event.pointerId, before, here);
    if (tool === 'pan' || (tool === 'aim' && !mine && state.dragged)) return panBy(here[0] - before[0], here[1] - before[1]);
    if (state.path && state.dragged) {
      const place = toPicture(state.view, here), last = state.path[state.path.length - 1];
      if (Math.hypot(place[0] - last[0], place[1] - last[1]) * sizeOf(state.view) > 8) state.path.push(place);
    }
    if (tool === 'measure' && state.ruler) state.ruler.ends[1] = toPicture(state.view, here);
    draw(); // at once: the next frame may be a while
  };
  const pinch = (id, before, here) => {
    const other = [...state.pointers].find(([key]) => key !== id)[1];
    const span = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
    zoomAt([(here[0] + other[0]) / 2, (here[1] + other[1]) / 2], span(here) / Math.max(1, span(before)));
    panBy((here[0] - before[0]) / 2, (here[1] - before[1]) / 2);
  };
  const finish = (event) => {
    state.pointers.delete(event.pointerId);
    if (tool === 'mark' && !state.dragged) addFlag(at(event));
    if (tool === 'measure' && state.ruler) measure();
    if (tool !== 'aim') return draw();
    if (!mine && !state.dragged) store.say(refusal());
    if (!state.path) return store.tell();
    const points = (state.dragged ? state.path : state.path.slice(0, 1)).slice(0, 1000);
    Object.assign(state, { path: null, given: points });
    store.send({ do: 'target', camera: 'top_camera', points, z: depth() });
    return draw();
  };
  const refusal = () =>
    store.ended !== null ? 'refused: the run has ended' : store.status.control !== 'mine'
      ? 'refused: take control first; until then you watch' : 'refused: this protocol takes no targets from the page';
  const measure = () => {
    const { ruler } = state;
    ask(ruler.ends, ([a, b]) => { if (a && b) ruler.length = Math.hypot(a[0] - b[0], a[1] - b[1]); draw(); });
  };
  const addFlag = (place) => {
    const flag = { at: toPicture(state.view, place), name: String.fromCharCode(65 + (state.flags.length % 26)), place: null };
    state.flags.push(flag);
    ask([flag.at], ([found]) => { flag.place = found; draw(); });
  };
  const ponder = (here) => {
    if (performance.now() - state.asked < kAsk || !frame) return;
    state.asked = performance.now();
    ask([toPicture(state.view, here)], ([place]) => (state.cursor = place));
  };
  const snapshot = () => {
    const { width, height } = over.current, sheet = Object.assign(document.createElement('canvas'), { width, height }), pen = sheet.getContext('2d');
    pen.filter = filterOf(look);
    pen.drawImage(picture.current, 0, 0);
    pen.filter = 'none';
    pen.drawImage(over.current, 0, 0);
    const link = Object.assign(document.createElement('a'), { href: sheet.toDataURL('image/png'), download: `${store.hello?.run ?? 'vitreo'}_${store.time.toFixed(1)}s.png` });
    link.click();
    store.say(`Snapshot saved: ${link.download}`);
    store.tell();
  };
  const middle = () => [state.view.w / 2, state.view.h / 2];
  const acts = {
    zoom: (factor) => (factor === 0 ? (Object.assign(state, { zoom: 1, center: null }), draw()) : zoomAt(middle(), factor)),
    contrast: () => setLook({ ...look, open: !look.open }),
    hold: () => { if (known(store)) Object.assign(state, { reference: null }), setHold(!hold); },
    snapshot,
    clear: () => (Object.assign(state, { flags: [], ruler: null }), draw()),
  };
  hooks.current = { ...acts, setTool };
  const age = frame ? performance.now() - frame.arrived : 0, live = store.ended === null;
  return (
    <div class="eye" ref={box}>
      <canvas ref={picture} style={{ filter: filterOf(look) }} />
      <canvas ref={over} id="top_camera" class={`over ${tool === 'aim' ? (mine ? 'aim' : '') : tool}`} aria-label="through the eye" data-frame={frame?.number ?? ''}
        onPointerDown={begin} onPointerMove={move} onPointerUp={finish} onPointerCancel={(event) => (state.pointers.delete(event.pointerId), (state.path = null))}
        onPointerLeave={() => (state.cursor = null)} onWheel={(event) => (event.preventDefault(), zoomAt(at(event), event.deltaY < 0 ? 1.2 : 1 / 1.2))} />
      {frame ? null : <p class="nothing"><b>No camera</b><br />{store.hello ? 'No picture has come from a top camera.' : 'The run has not begun.'}</p>}
      <Tools tool={tool} setTool={setTool} acts={acts} look={look} hold={known(store) ? hold : null} />
      {look.open && frame ? <LightPanel look={look} setLook={setLook} frame={frame} /> : null}
      {frame ? <span class={`chip age ${live && age > kOld ? 'old' : live && age > kLate ? 'late' : ''}`}>
        {live ? `Through the eye · ${frame.rate ? `${frame.rate.toFixed(1)} /s · ` : ''}${age > kOld ? `${(age / 1000).toFixed(0)} s old` : `${Math.round(age / 10) * 10} ms old`}` : `Last picture, ${frame.time.toFixed(1)} s`}
      </span> : null}
      {frame && hold ? <span id="held" class={`chip held ${state.isHeld ? '' : 'late'}`}>{state.isHeld ? 'Retina held still' : 'Retina not found: not held'}</span> : null}
      {state.cursor ? <span class="chip cursor" id="cursor">x {mm(state.cursor[0])}  y {mm(state.cursor[1])} mm  at z {mm(state.cursor[2])}</span> : null}
    </div>
  );
}

function drawMarks(pen, view, { flags, ruler }) {
  for (const flag of flags) {
    const [x, y] = toBox(view, flag.at);
    cased(pen, '#fff', 2, () => polyline(pen, [[x, y], [x, y - 18], [x + 12, y - 14], [x, y - 9]]));
    label(pen, flag.place ? `${flag.name}  ${mm(flag.place[0])}, ${mm(flag.place[1])} mm` : flag.name, x + 15, y - 9, { size: 12 });
  }
  if (!ruler) return;
  const [a, b] = ruler.ends.map((end) => toBox(view, end));
  cased(pen, '#fff', 2, () => polyline(pen, [a, b]), [5, 3]);
  const px = Math.hypot(ruler.ends[0][0] - ruler.ends[1][0], ruler.ends[0][1] - ruler.ends[1][1]);
  const length = ruler.length ?? (view.perMeter ? px / view.perMeter : null);
  if (length !== null && px > 2) label(pen, length < 1e-3 ? `${(length * 1e6).toFixed(0)} µm` : `${mm(length, 3)} mm`, b[0] + 10, b[1] - 6, { size: 14 });
}

/** low and high of 0 to 255 become black and white: (in - low) / (high - low) by the two filters that there are. */
function filterOf({ low, high }) {
  if (low === 0 && high === 255) return 'none';
  const gain = 255 / Math.max(4, high - low), contrast = 1 + 2 * (low / 255) * gain;
  return `brightness(${gain / contrast}) contrast(${contrast})`;
}
