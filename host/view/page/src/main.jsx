// The live view of a run.
import { render } from 'preact';
import { useEffect, useReducer, useRef, useState } from 'preact/hooks';
import { Depth, clearanceOf, levelOf } from './depth.jsx';
import { Eye } from './eye.jsx';
import { Head, Stop } from './head.jsx';
import { connect, createStore, newest } from './link.js';
import { Instruments } from './instruments.jsx';
import { Message } from './message.jsx';
import { Coils, Log, Positions } from './panels.jsx';
import { ClearancePlot, ErrorPlot } from './plots.jsx';
import { Section } from './section.jsx';
import { sound, tone } from './sound.js';
import { openAlarms, stateOf } from './words.js';
import './style.css';

const store = createStore();
connect(store);
const kTabs = [['depth', 'Depth'], ['plots', 'Plots'], ['coils', 'Coils'], ['log', 'Log'], ['instruments', 'Tools']];

const themeNow = () => document.documentElement.dataset.theme ?? 'dark';
function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  try { localStorage.setItem('vitreo-theme', theme); } catch { /* private window: for this page only */ }
}
try { setTheme(localStorage.getItem('vitreo-theme') ?? 'dark'); } catch { setTheme('dark'); }

/** Announces questions and alarms: the window's title, a tone. */
function useNotice(alarms, question) {
  const worst = alarms.find((alarm) => !alarm.acknowledged_by);
  useEffect(() => { if (worst) tone(worst.priority === 'high' ? 880 : 660, worst.priority === 'high' ? 3 : 2); }, [worst?.name]);
  useEffect(() => { if (question) tone(523); }, [question?.number]);
  document.title = `${worst ? '(!) ' : question ? '(?) ' : ''}${store.hello?.title ?? 'Vitreo live view'}`;
}

function Page() {
  const [, again] = useReducer((n) => n + 1, 0), [zero, setZero] = useState(0), [tab, setTab] = useState('depth'), [bench, setBench] = useState(false), hooks = useRef({});
  useEffect(() => {
    let due = false;
    const draw = () => {
      if (due) return;
      due = true;
      requestAnimationFrame(() => ((due = false), again()));
    };
    const clock = setInterval(draw, 500); // ages grow, notes go, though nothing comes
    const deaf = store.listen(draw);
    return () => (clearInterval(clock), deaf());
  }, []);

  // The depth that was asked for here is shown until the loop has it: from then on it follows the loop's, which a SpaceMouse or
  // the script may move, too. It is the store's, not the page's state: a key that repeats is faster than what is drawn.
  const row = newest(store, 'servo');
  if (store.depth !== null && row?.target_z != null && Math.abs(row.target_z - store.depth) < 1e-6) store.depth = null;
  const jog = (by) => {
    if (!row) return;
    store.depth = (store.depth ?? row.target_z ?? 0) + by;
    again();
    store.send({ do: 'target', place: [row.target_x, row.target_y, store.depth] });
  };
  const acts = {
    zero: () => row?.z != null && setZero(row.z),
    theme: () => setTheme(themeNow() === 'dark' ? 'light' : 'dark'),
    instruments: () => setBench(!bench),
    sound: { on: sound.on, toggle: () => (sound.toggle(), again()) },
  };
  const pause = () => store.send({ do: ['paused', 'suspended'].includes(store.status.phase) ? 'resume' : 'pause' });
  const seen = () => { const [alarm] = openAlarms(store); if (alarm) store.send({ do: 'ack', alarm: alarm.name }); };
  const keys = {
    t: () => hooks.current.setTool('aim'), h: () => hooks.current.setTool('pan'), m: () => hooks.current.setTool('measure'), f: () => hooks.current.setTool('mark'),
    '+': () => hooks.current.zoom(1.5), '-': () => hooks.current.zoom(1 / 1.5), 0: () => hooks.current.zoom(0), c: () => hooks.current.contrast(), r: () => hooks.current.hold(), s: () => hooks.current.snapshot(),
    z: acts.zero, i: acts.instruments, p: pause, a: seen, q: () => (document.querySelector('#to-question')?.click(), document.querySelector('#question input, #question button')?.focus()),
    '?': () => document.querySelector('#more').click(), Escape: () => (setBench(false), hooks.current.setTool('aim')),
  };
  useEffect(() => {
    const press = (event) => {
      const typing = event.target instanceof HTMLInputElement && event.target.type !== 'range';
      if (event.code === 'Space' && (!typing || event.shiftKey)) {
        event.preventDefault();
        if (store.ended === null) store.send({ do: stateOf(store).kind === 'stopping' ? 'abort' : 'stop' });
        return;
      }
      if (typing || event.ctrlKey || event.metaKey || event.altKey || event.target instanceof HTMLSelectElement) return;
      const steers = store.status.control === 'mine' && store.ended === null;
      const step = { ArrowUp: 1, ArrowDown: -1 }[event.key], call = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
      if (step && steers) jog(step * (event.shiftKey ? 0.01e-3 : 0.1e-3));
      else if (!call || (event.key === 'p' && !steers)) return;
      else call();
      event.preventDefault();
    };
    addEventListener('keydown', press, true);
    return () => removeEventListener('keydown', press, true);
  });

  const top = store.cameras.indexOf('top_camera'), side = store.cameras.indexOf('side_camera');
  const slot = top >= 0 ? top : store.cameras.findIndex((name) => name !== 'side_camera'), frame = store.frames[slot];
  const level = levelOf(clearanceOf(store), store.hello?.geometry.margin ?? 0), stale = !store.connected && store.ended === null && store.hello;
  useNotice(openAlarms(store), store.status.question);
  return (
    <main class={`${stale ? 'stale' : ''} ${store.ended !== null ? 'ended' : ''} ${level === 'margin' && store.ended === null ? 'margin' : ''} ${bench ? 'bench' : ''}`} data-tab={tab}
      style={frame ? { '--aspect': frame.width / frame.height } : undefined}>
      <Head store={store} acts={acts} />
      <Message store={store} />
      <Stop store={store} />
      <Eye store={store} slot={slot} hooks={hooks} />
      <Depth store={store} zero={zero} jog={jog} />
      <div class="sidebar">
        <Section store={store} slot={side} />
        <div class="rest-area">
          <Positions store={store} zero={zero} />
          <ClearancePlot store={store} />
          <ErrorPlot store={store} />
          <Coils store={store} />
          <Log store={store} />
        </div>
      </div>
      {bench || tab === 'instruments' ? <Instruments store={store} close={() => (setBench(false), setTab('depth'))} /> : null}
      <nav class="tabs" role="tablist">
        {kTabs.map(([name, title]) => <button role="tab" aria-selected={tab === name} onClick={() => setTab(name)}>{title}</button>)}
      </nav>
    </main>
  );
}

render(<Page />, document.getElementById('page'));
