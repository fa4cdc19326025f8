// The live view of a run.
import { render } from 'preact';
import { useEffect, useReducer, useState } from 'preact/hooks';
import { CameraView } from './camera.jsx';
import { DepthBar } from './depth.jsx';
import { connect, createStore, named, newest } from './link.js';
import { Alarms, Asked, Coils, Head, Log } from './panels.jsx';
import { Plot } from './plot.jsx';
import './style.css';

const store = createStore();
connect(store);

const difference = (a, b) => (a === null || b === null ? null : (a - b) * 1e6);
const kErrors = [
  { name: 'x', color: '#56b4e9', of: (r) => difference(r.x, r.target_x) },
  { name: 'y', color: '#f0e442', of: (r) => difference(r.y, r.target_y) },
  { name: 'z', color: '#d55e00', of: (r) => difference(r.z, r.target_z) },
];
const kDepth = [
  { name: 'z', color: '#56b4e9', of: (r) => (r.z === null ? null : r.z * 1e3) },
  { name: 'target', color: '#e69f00', dash: [6, 4], of: (r) => (r.target_z === null ? null : r.target_z * 1e3) },
];

function Page() {
  const [, again] = useReducer((n) => n + 1, 0);
  const [zero, setZero] = useState(0);
  useEffect(() => {
    let due = false;
    return store.listen(() => {
      if (due) return;
      due = true;
      requestAnimationFrame(() => ((due = false), again()));
    });
  }, []);

  // The depth that was asked for here is shown until the loop has it: from then on it follows the loop's, which a SpaceMouse or
  // the script may move, too.
  const aimed = newest(store, 'servo')?.target_z ?? null;
  // It is the store's, not the page's state: a key that repeats is faster than what is drawn.
  if (store.depth !== null && aimed !== null && Math.abs(aimed - store.depth) < 1e-6) store.depth = null;
  const { depth } = store;

  const setDepth = (z) => {
    store.depth = z;
    again();
    const row = newest(store, 'servo');
    if (row) store.send({ do: 'target', place: [row.target_x, row.target_y, z] });
  };
  const jog = (by) => setDepth((store.depth ?? newest(store, 'servo')?.target_z ?? 0) + by);
  useEffect(() => {
    const press = (event) => {
      if (event.target instanceof HTMLInputElement) return;
      if (event.code === 'Space') {
        event.preventDefault();
        store.send({ do: 'stop' });
      } else if ((event.key === 'ArrowUp' || event.key === 'ArrowDown') && store.status.control === 'mine') {
        event.preventDefault();
        jog(event.key === 'ArrowUp' ? 0.1e-3 : -0.1e-3);
      }
    };
    addEventListener('keydown', press, true);
    return () => removeEventListener('keydown', press, true);
  });

  const held = store.streams.servo;
  const rows = held ? held.rows.map((row) => named(held, row)) : [];
  const slots = store.cameras.map((camera, slot) => ({ camera, slot })).sort((a, b) => (a.camera === 'top_camera' ? -1 : b.camera === 'top_camera' ? 1 : 0));
  return (
    <main class={store.connected ? '' : 'stale'}>
      <Head store={store} />
      <div class="pictures">
        {slots.map(({ camera, slot }) => <CameraView key={camera} store={store} camera={camera} slot={slot} depth={depth} />)}
        {slots.length === 0 ? <p class="quiet">no camera yet</p> : null}
      </div>
      <DepthBar store={store} zero={zero} setZero={setZero} depth={depth} jog={jog} />
      <aside>
        <Alarms store={store} />
        <Asked store={store} />
        {store.note ? <p class="note" id="note">{store.note}</p> : null}
        <Coils store={store} />
        <Plot title="Error" unit="µm" series={kErrors} rows={rows} />
        <Plot title="Depth" unit="mm" series={kDepth} rows={rows} />
        <Log store={store} />
      </aside>
    </main>
  );
}

render(<Page />, document.getElementById('page'));
