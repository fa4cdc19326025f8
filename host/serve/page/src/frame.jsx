// Frame of all pages: navigation, the run that goes on with STOP, and the line in which it asks and warns.
// SPDX-License-Identifier: Apache-2.0
import { useEffect, useState } from 'preact/hooks';
import { post } from './api.js';
import { duration, when } from './words.js';
import { useAction, Wrong } from './parts.jsx';

const ICONS = {
  protocols: 'M6 4l12 8-12 8z',
  queue: 'M4 6h16M4 12h16M4 18h10',
  runs: 'M4 4v16h16M7 15l4-5 3 3 5-7',
  sweeps: 'M4 4h7v7H4zM13 4h7v7h-7zM4 13h7v7H4zM13 13h7v7h-7z',
  messages: 'M12 4l9 16H3zM12 10v5M12 17.5v.5',
};

export const command = (body) => post('/api/run', body);

export function Navigation({ page, state }) {
  const entry = (name, title, count) => (
    <a href={`#/${name}`} class={page === name ? 'here' : ''} aria-current={page === name ? 'page' : undefined}>
      <svg viewBox="0 0 24 24" aria-hidden="true">
        <path d={ICONS[name]} />
      </svg>
      <span>{title}</span>
      {count ? <b>{count}</b> : null}
    </a>
  );
  const untold = state?.messages.filter((one) => !one.told && one.tries > 0).length;
  return (
    <nav aria-label="Pages">
      <strong class="brand">Vitreo</strong>
      {entry('protocols', 'Protocols')}
      {entry('queue', 'Queue', state?.waiting_total)}
      {entry('runs', 'Runs')}
      {entry('sweeps', 'Sweeps')}
      {entry('messages', 'Messages', untold)}
      <small>
        {state?.operator}
        <br />
        {state?.version.split(' ')[0]}
      </small>
    </nav>
  );
}

/** The desk's words for a run: what it does, not what it waits for. */
export function phase(running) {
  if (!running) return '';
  const status = running.status;
  if (running.job.request.sweep) return `Sweep, ${running.done ?? 0} points done`;
  if (!status) return 'Getting ready';
  if (status.question) return 'Waiting for you';
  if (status.phase === 'running') return status.doing || 'Running';
  return status.phase.charAt(0).toUpperCase() + status.phase.slice(1);
}

export function Bar({ state, connected }) {
  const running = state?.running;
  const last = state?.ended[0];
  const status = running?.status;
  const fraction = status?.progress ?? 0;
  return (
    <header>
      <i class={`lamp ${running ? (status?.question ? 'asks' : 'on') : ''}`} aria-hidden="true" />
      <div class="doing">
        {running ? (
          <a href={`#/job/${running.job.id}`}>
            <b>{running.job.title}</b> <span>{phase(running)}</span>
          </a>
        ) : (
          <span>{last ? `Rig free since ${when(last.ended)}` : 'Rig free'}</span>
        )}
      </div>
      {running && fraction > 0 ? (
        <div class="progress">
          <progress value={fraction} aria-label="Progress" />
          <span>{status.remaining >= 0 ? `${duration(status.remaining)} left` : `${Math.round(100 * fraction)} %`}</span>
        </div>
      ) : null}
      {running?.live ? (
        <a class="button" href="/live_view" target="vitreo_live">
          Live view
        </a>
      ) : null}
      <Stop running={running} connected={connected} />
    </header>
  );
}

/** STOP, and abort at the second press. */
function Stop({ running, connected }) {
  const [run, , error] = useAction(command);
  const [pressed, setPressed] = useState(0);
  const job = running?.job.id;
  useEffect(() => setPressed(0), [job]);
  const press = () => {
    run({ do: pressed ? 'abort' : 'stop' });
    setPressed(pressed + 1);
  };
  return (
    <>
      <button id="stop" class="stop" disabled={!running || !connected} onClick={press} title={pressed ? 'again: at once' : undefined}>
        STOP
      </button>
      {error ? <span class="wrong" role="alert">{error}</span> : null}
    </>
  );
}

function Question({ question }) {
  const [text, setText] = useState('');
  const [answer, busy, error] = useAction((word) => command({ do: 'answer', text: word }));
  useEffect(() => setText(''), [question.number]);
  const choices = question.choices ?? [];
  const words = choices.length ? question.text.replace(/ \([^()]*\)$/, '') : question.text;
  return (
    <div class="line question" id="question" role="status">
      <b>{words}</b>
      {choices.length > 0 && choices.length <= 4 ? (
        choices.map((one) => (
          <button key={one} class="primary" disabled={busy} onClick={() => answer(one)}>
            {one}
          </button>
        ))
      ) : (
        <form
          onSubmit={(event) => {
            event.preventDefault();
            answer(text);
          }}
        >
          {choices.length ? (
            <select aria-label="Answer" value={text} onChange={(event) => setText(event.target.value)}>
              <option value="" />
              {choices.map((one) => (
                <option key={one}>{one}</option>
              ))}
            </select>
          ) : (
            <input aria-label="Answer" value={text} onInput={(event) => setText(event.target.value)} />
          )}
          <button class="primary" disabled={busy}>
            Answer
          </button>
        </form>
      )}
      <Wrong text={error} />
    </div>
  );
}

/** One line: no connection, else the most urgent alarm, else the question, else why the queue is held. */
export function MessageLine({ state, connected }) {
  const [acknowledge, , error] = useAction((name) => command({ do: 'ack', alarm: name }));
  const [resume, , refused] = useAction(() => post('/api/queue/hold', { held: false }));
  if (!connected)
    return (
      <div class="line high" role="alert">
        <b>Not connected: all that is shown is old.</b> STOP cannot be sent from here. Use the switch at the coils.
      </div>
    );
  const status = state?.running?.status;
  const alarms = (status?.alarms ?? []).filter((alarm) => !alarm.acknowledged_by);
  if (alarms.length)
    return (
      <>
        <div class={`line ${alarms[0].priority === 'high' ? 'high' : 'medium'}`} role="alert">
          <b>
            {alarms[0].priority === 'high' ? '!!!' : alarms[0].priority === 'medium' ? '!!' : '!'} {alarms[0].text}
          </b>
          {alarms.length > 1 ? <span>{alarms.length - 1} more</span> : null}
          <button onClick={() => acknowledge(alarms[0].name)}>Silence</button>
          <Wrong text={error} />
        </div>
        {status.question ? <Question question={status.question} /> : null}
      </>
    );
  if (status?.question) return <Question question={status.question} />;
  if (state?.held)
    return (
      <div class="line medium" role="status">
        <b>The queue is held</b> <span>{state.why_held}</span>
        <button onClick={resume}>Let it go on</button>
        <Wrong text={refused} />
      </div>
    );
  return null;
}
