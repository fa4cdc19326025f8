// State and ending, questions, coils, log.
import { useState } from 'preact/hooks';
import { formatNumber, formatQuantity, showColumn } from './format.js';
import { newest } from './link.js';

export function Head({ store }) {
  const { hello, status, connected, ended } = store;
  const known = status.progress > 0;
  const state = ended !== null ? `ended: ${ended}` : connected ? status.text ?? '…' : 'not connected';
  return (
    <header>
      <div class="name">
        <h1>{hello?.title ?? 'Vitreo'}</h1>
        <p class="quiet">{hello ? `${hello.run}${hello.operator ? ` · ${hello.operator}` : ''}` : ''}</p>
      </div>
      <div class="state" id="state" role="status" title={state}>{state}</div>
      <div class="progress">
        <progress value={status.progress ?? 0} max="1" aria-label="progress" />
        <span>{known ? `${(status.progress * 100).toFixed(0)} % · ` : ''}{status.doing ?? ''} {store.time.toFixed(1)} s{remaining(status)}</span>
      </div>
      <Control store={store} />
      <button id="stop" class="stop" onClick={() => store.send({ do: 'stop' })} disabled={ended !== null}>STOP <kbd>space</kbd></button>
    </header>
  );
}

function remaining({ remaining: left }) {
  if (left == null || left < 0) return '';
  return `, ${formatQuantity(left, 's', 2)} left`;
}

function Control({ store }) {
  const { control, phase } = store.status;
  const mine = control === 'mine';
  return (
    <div class="control">
      <button id="take" onClick={() => store.send({ do: mine ? 'release' : 'take' })} disabled={control === 'taken'}>
        {mine ? 'release control' : control === 'taken' ? 'another has control' : 'take control'}
      </button>
      <button disabled={!mine} onClick={() => store.send({ do: phase === 'paused' ? 'resume' : 'pause' })}>
        {phase === 'paused' ? 'resume' : 'pause'}
      </button>
      <button disabled={!mine} onClick={() => store.send({ do: 'invite' })} title="an address for one more viewer">invite</button>
      <button class="abort" onClick={() => store.send({ do: 'abort' })}>abort</button>
    </div>
  );
}

export function Alarms({ store }) {
  const alarms = store.status.alarms ?? [];
  if (alarms.length === 0) return null;
  const mine = store.status.control === 'mine';
  return (
    <section class="alarms" role="alert">
      {alarms.map((alarm) => (
        <p class={alarm.priority}>
          <b>{alarm.priority}</b> {alarm.name}: {alarm.text}{alarm.active ? '' : ' (over)'}
          {alarm.acknowledged_by
            ? <span class="quiet"> seen by {alarm.acknowledged_by}</span>
            : <button disabled={!mine} onClick={() => store.send({ do: 'ack', alarm: alarm.name })}>seen</button>}
        </p>
      ))}
    </section>
  );
}

export function Asked({ store }) {
  const [text, setText] = useState('');
  const question = store.status.question;
  if (!question) return null;
  const answer = (value) => {
    store.send({ do: 'answer', text: value });
    setText('');
  };
  const mine = store.status.control === 'mine';
  const words = question.choices?.length ? question.choices : null;
  return (
    <section class="asked" id="question">
      <p>{question.text}</p>
      {words
        ? words.map((word) => <button disabled={!mine} onClick={() => answer(word)}>{word}</button>)
        : <form onSubmit={(event) => (event.preventDefault(), answer(text))}>
            <input value={text} disabled={!mine} onInput={(event) => setText(event.target.value)} aria-label="answer" />
            <button disabled={!mine}>answer</button>
          </form>}
      {mine ? null : <p class="quiet">take control to answer</p>}
    </section>
  );
}

export function Coils({ store }) {
  const currents = newest(store, 'currents'), warm = newest(store, 'coil_temperature'), servo = newest(store, 'servo');
  const limit = store.hello?.geometry.current_limit ?? 20;
  const field = store.status.field;
  // What was sent last no longer flows once the coils were made safe.
  const rest = store.rest && store.rest.t >= (currents?.t ?? 0) ? store.rest : null;
  const names = currents ? Object.keys(currents).filter((name) => name !== 't') : [];
  const temperatures = warm ? showColumn(Object.values(warm).slice(1), 'K', 2) : null;
  return (
    <section class="coils">
      <h2>Coils</h2>
      {names.map((name, i) => {
        const current = rest ? (rest.amperes?.[i] ?? null) : currents[name];
        const share = Math.max(-1, Math.min(1, (current ?? 0) / limit));
        return (
          <div class="coil">
            <span>{i + 1}</span>
            <svg viewBox="-100 0 200 12" preserveAspectRatio="none" aria-hidden="true">
              <rect x="-100" width="200" height="12" class="trough" />
              <rect x={Math.min(0, share * 100)} width={Math.abs(share) * 100} height="12" class={Math.abs(share) > 0.9 ? 'full' : 'part'} />
              <line x1="0" x2="0" y1="0" y2="12" class="middle" />
            </svg>
            <span class="value">{current == null ? '–' : `${current.toFixed(2)} A`}</span>
            <span class="value">{temperatures ? `${temperatures.numbers[i]} ${temperatures.unit}` : ''}</span>
          </div>
        );
      })}
      {rest ? <p class="rest">{rest.text}</p> : null}
      <p class="quiet">
        {names.length ? `headroom ${servo?.headroom != null ? (servo.headroom * 100).toFixed(0) : '–'} % of ${limit} A${servo?.limited ? ' · LIMITED' : ''}` : 'no currents yet'}
      </p>
      {field ? <Field field={field} /> : null}
    </section>
  );
}

/** The field's direction from above (x, y) and its tilt (z). */
function Field({ field }) {
  const [x, y, z] = field.direction;
  return (
    <div class="field">
      <svg viewBox="-50 -50 100 100" role="img" aria-label="field direction">
        <circle r="46" class="trough" />
        <line x1="0" y1="0" x2={x * 42} y2={-y * 42} class="arrow" />
        <circle cx={x * 42} cy={-y * 42} r="5" class={z >= 0 ? 'tip up' : 'tip'} />
      </svg>
      <p>{formatQuantity(field.tesla, 'T')}<br /><span class="quiet">tilt {Math.round((Math.asin(z) * 180) / Math.PI) + 0}°</span></p>
    </div>
  );
}

/** What devices and the loop said as JSON, as people read it. */
function plain(text) {
  if (!/^[[{]/.test(text)) return text;
  const said = (value) => {
    if (typeof value === 'number') return formatNumber(value, 4);
    if (value === null || typeof value !== 'object') return String(value);
    if (Array.isArray(value)) return `(${value.map(said).join(', ')})`;
    return Object.entries(value).map(([key, inner]) => `${key} = ${said(inner)}`).join(', ');
  };
  try {
    return said(JSON.parse(text));
  } catch {
    return text;
  }
}

export function Log({ store }) {
  return (
    <section class="log">
      <h2>Log</h2>
      <ol>
        {store.lines.slice(-80).reverse().map((line) => (
          <li class={line.kind}><time>{line.t.toFixed(1)} s</time> {line.kind === 'message' ? '' : `${line.kind}: `}{plain(line.text)}</li>
        ))}
      </ol>
    </section>
  );
}
