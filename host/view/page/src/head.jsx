// Header: which run, its state in one word, time, who steers, pause, and a menu of what is wanted seldom.
import { useState } from 'preact/hooks';
import { formatQuantity } from './format.js';
import { clockText, restWords, stateOf } from './words.js';

const kColors = { running: 'var(--good)', question: 'var(--accent)', lost: 'var(--high)', offline: 'var(--high)' };
const kMarks = {
  dot: <circle cx="8" cy="8" r="7" />,
  ring: <circle cx="8" cy="8" r="5.5" fill="none" stroke="currentColor" stroke-width="3" />,
  square: <rect x="2" y="2" width="12" height="12" />,
  cross: <path d="M3 3l10 10M13 3L3 13" fill="none" stroke="currentColor" stroke-width="3" />,
};

export function Head({ store, acts }) {
  const [open, setOpen] = useState(false);
  const { hello, status } = store;
  const state = stateOf(store), control = status.control, mine = control === 'mine';
  const live = store.connected && store.ended === null && hello;
  const paused = status.phase === 'paused' || status.phase === 'suspended';
  const share = status.progress > 0 ? `${(status.progress * 100).toFixed(0)} % · ` : '';
  const left = status.remaining > 0 ? `, ${formatQuantity(status.remaining, 's', 2)} left` : '';
  return (
    <header>
      <div class="name">
        <h1>{hello?.title ?? 'Vitreo'}</h1>
        <p class="quiet">{hello ? `${hello.run}${hello.operator ? ` · ${hello.operator}` : ''}` : ''}</p>
      </div>
      <div class="state" id="state" role="status" data-kind={state.kind} title={store.ended ?? status.text ?? ''}>
        <svg viewBox="0 0 16 16" style={{ color: kColors[state.kind] ?? 'var(--text2)', fill: 'currentColor' }} aria-hidden="true">{kMarks[state.mark]}</svg>
        <span>{state.word}</span>
      </div>
      <span class="clock number" title={status.doing}>
        {store.ended !== null ? 'ran ' : share}{status.doing && live ? `${status.doing} · ` : ''}{clockText(store.time)}{live ? left : ''}
      </span>
      {live && mine ? <span class="who" title="you have control">you steer</span> : null}
      {live && !mine
        ? <button id="take" class="primary" disabled={control === 'taken'} onClick={() => store.send({ do: 'take' })}>
            {control === 'taken' ? 'Another steers' : 'Take control'}
          </button> : null}
      {live && mine
        ? <button id="pause" onClick={() => store.send({ do: paused ? 'resume' : 'pause' })} title="P">{paused ? 'Resume' : 'Pause'}</button> : null}
      {store.report ? <a id="report" href={store.report} target="_blank" rel="noopener"><button class="primary" tabIndex={-1}>Open report</button></a> : null}
      <button id="more" aria-expanded={open} onClick={() => setOpen(!open)}>More</button>
      {open ? <Menu store={store} acts={acts} live={live} mine={mine} close={() => setOpen(false)} /> : null}
    </header>
  );
}

const kKeys = [
  ['Space', 'STOP'], ['P', 'pause, resume'], ['T H M F', 'target, pan, measure, flag'], ['↑ ↓', '0.1 mm; Shift 0.01'], ['+ − 0', 'zoom'],
  ['C', 'contrast'], ['R', 'hold the retina still'], ['S', 'snapshot'], ['Q', 'to the question'], ['A', 'alarm seen'], ['I', 'instruments'], ['Z', 'zero of z here'], ['?', 'this list'],
];

function Menu({ store, acts, live, mine, close }) {
  const act = (call) => () => (call(), close());
  const item = (label, key, call, more = {}) => <button {...more} onClick={act(call)}>{label}<kbd>{key}</kbd></button>;
  return (
    <div class="menu" role="menu">
      {live && mine ? item('Release control', '', () => store.send({ do: 'release' }), { id: 'release' }) : null}
      {live && mine ? item('Invite another viewer', '', () => store.send({ do: 'invite' }), { id: 'invite' }) : null}
      {item('Instruments', 'I', acts.instruments, { id: 'to-instruments' })}
      {item('Zero of z here', 'Z', acts.zero, { id: 'zero' })}
      {item('Light or dark', '', acts.theme, { id: 'theme' })}
      {item(acts.sound.on ? 'Sound off' : 'Sound on', '', acts.sound.toggle)}
      {live ? item('Abort the run', '', () => store.send({ do: 'abort' }), { class: 'danger', id: 'abort' }) : null}
      {live ? item('Emergency: coils off at once', '', () => store.send({ do: 'emergency' }), { class: 'danger', id: 'emergency' }) : null}
      <dl>{kKeys.map(([key, what]) => [<dt>{key}</dt>, <dd>{what}</dd>])}</dl>
    </div>
  );
}

/** STOP; after the end what the coils were read back as, in the same place. */
export function Stop({ store }) {
  if (store.ended !== null) {
    const rest = restWords(store);
    return (
      <div class={`rested ${rest && !rest.zero ? 'bad' : ''}`} id="rested">
        <b class="number">{rest ? rest.short : '–'}</b>{rest ? rest.zero ? rest.how : 'still flows' : 'the coils said nothing'}
      </div>
    );
  }
  const stopping = stateOf(store).kind === 'stopping';
  return (
    <button id="stop" class="stop" onClick={() => store.send({ do: stopping ? 'abort' : 'stop' })}>
      STOP<small>{stopping ? 'again: at once' : 'space bar'}</small>
    </button>
  );
}
