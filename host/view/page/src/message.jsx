// The message line: state, question, alarm and refusal share one place of fixed height, so that nothing moves under the pointer
// and none of them is ever below the fold.
import { useEffect, useRef, useState } from 'preact/hooks';
import { clockText, invitationOf, lostFor, openAlarms, restWords, stateOf } from './words.js';

const kNote = 8000; // ms that a note stays
const kFewChoices = 3; // up to so many are buttons

/** What the line says: the first that applies. */
export function messageOf(store, wantsQuestion = false) {
  const alarms = openAlarms(store), { question } = store.status, kind = stateOf(store).kind;
  const noted = store.note && performance.now() - store.noted < kNote;
  if (kind === 'ended') return { kind: 'ended' };
  if (kind === 'offline' && performance.now() - (store.lostAt ?? 0) > 1000) return { kind: 'offline' };
  if (alarms.length && !alarms[0].acknowledged_by && !(question && wantsQuestion)) return { kind: 'alarm', alarms };
  if (question && kind !== 'stopping') return { kind: 'question', question };
  if (noted) return { kind: 'note' };
  if (alarms.length) return { kind: 'alarm', alarms };
  return { kind };
}

export function Message({ store }) {
  const [wants, setWants] = useState(false); // to see the question, though an alarm stands
  const said = messageOf(store, wants), { question } = store.status;
  useEffect(() => { if (!question) setWants(false); }, [question?.number]);
  if (said.kind === 'ended') return <Ended store={store} />;
  if (said.kind === 'offline') return <Line kind="high" mark="!!!" first="All that is shown is old." then="STOP cannot be sent from here. Use the switch at the coils." alert />;
  if (said.kind === 'alarm') return <Alarm store={store} alarms={said.alarms} question={question} toQuestion={() => setWants(true)} />;
  if (said.kind === 'question') return <Question store={store} question={question} />;
  if (said.kind === 'note') return <Note store={store} />;
  if (said.kind === 'stopping') return <Line kind="medium" mark="■" first="Stopping: coils to 0 A." then="STOP again: at once." />;
  if (said.kind === 'lost')
    return <Line kind="medium" mark="!!" first={`The robot was not seen for ${clockText(lostFor(store) ?? 0)}.`} then="The last currents are held until the loop gives up." />;
  if (said.kind === 'paused')
    return <Line first="Paused." then={store.status.note || 'The robot is held.'}>
      <button class="primary" disabled={store.status.control !== 'mine'} onClick={() => store.send({ do: 'resume' })}>Resume</button>
    </Line>;
  if (said.kind === 'ready') return <Line first="The prompt waits for a statement." then="A loop that holds goes on holding; STOP makes the devices safe." />;
  if (said.kind === 'idle') return <Line first="Nothing runs yet." then="The page shows the run when it begins." />;
  const [first, then] = invitationOf(store);
  return <Line first={first} then={then} />;
}

function Line({ kind = '', mark, first, then, alert, children }) {
  return (
    <section class={`message ${kind}`} role={alert ? 'alert' : 'status'} id="message">
      {mark ? <span class="mark" aria-hidden="true">{mark}</span> : null}
      <p class="words"><b>{first}</b> {then}</p>
      {children ? <div class="acts">{children}</div> : null}
    </section>
  );
}

function Note({ store }) {
  const refused = store.note.startsWith('refused: ');
  const free = refused && /control/.test(store.note) && store.status.control === 'free';
  return (
    <section class={`message ${refused ? 'refused' : ''}`} role={refused ? 'alert' : 'status'} id="message">
      <p class="words" id="note">{refused ? <b>Refused: </b> : null}{refused ? store.note.slice(9) : store.note}</p>
      {free ? <div class="acts"><button class="primary" onClick={() => store.send({ do: 'take' })}>Take control</button></div> : null}
    </section>
  );
}

const kSigns = { high: '!!!', medium: '!!', low: '!' };

function Alarm({ store, alarms, question, toQuestion }) {
  const [alarm] = alarms, mine = store.status.control === 'mine';
  return (
    <section class={`message ${alarm.priority}`} role="alert" id="message">
      <span class="mark">{kSigns[alarm.priority] ?? '!'}</span>
      <p class="words"><b>{alarm.text}</b>
        <small>{alarm.name}{alarm.active ? '' : ', over'}{alarm.acknowledged_by ? `, seen by ${alarm.acknowledged_by}` : ''}{alarms.length > 1 ? ` · ${alarms.length - 1} more` : ''}</small>
      </p>
      <div class="acts">
        {alarm.acknowledged_by ? null : <button id="seen" disabled={!mine} onClick={() => store.send({ do: 'ack', alarm: alarm.name })}>Seen</button>}
        {question ? <button id="to-question" class="primary" onClick={toQuestion}>Question</button> : null}
      </div>
    </section>
  );
}

function Question({ store, question }) {
  const [text, setText] = useState(''), field = useRef(null);
  const mine = store.status.control === 'mine', choices = question.choices ?? [];
  // What was done or refused shows here too: a protocol may ask whether it is enough while places are pointed at.
  const noted = performance.now() - store.noted < kNote ? store.note : '';
  const refused = noted.startsWith('refused: ') ? noted.slice(9) : '';
  useEffect(() => { setText(''); field.current?.focus(); }, [question.number, mine]);
  const answer = (value) => {
    store.say('');
    store.send({ do: 'answer', text: value });
  };
  const few = choices.length > 0 && choices.length <= kFewChoices;
  return (
    <section class="message question" role="status" aria-live="polite" id="question">
      <span class="mark">?</span>
      <p class="words"><b>{question.text}</b>
        <small>{refused ? <b id="note">Refused: {refused}</b> : noted ? <span id="note">{noted}</span> : mine ? 'The run waits for the answer.' : 'Take control to answer.'}</small></p>
      <div class="acts sheet">
        {few ? choices.map((word) => <button class="primary" disabled={!mine} onClick={() => answer(word)}>{word}</button>) : null}
        {choices.length > kFewChoices
          ? <select disabled={!mine} aria-label="answer" onChange={(event) => setText(event.target.value)}>
              <option value="">choose …</option>{choices.map((word) => <option value={word} selected={word === text}>{word}</option>)}
            </select> : null}
        {choices.length === 0
          ? <input ref={field} value={text} disabled={!mine} aria-label="answer" onInput={(event) => setText(event.target.value)}
              onKeyDown={(event) => event.key === 'Enter' && answer(text)} /> : null}
        {few ? null : <button class="primary" disabled={!mine || (choices.length > 0 && !text)} onClick={() => answer(text)}>Answer</button>}
      </div>
    </section>
  );
}

function Ended({ store }) {
  const rest = restWords(store);
  const why = store.ended.includes(': ') ? store.ended.slice(store.ended.indexOf(': ') + 2) : '';
  const sentence = why ? `${why[0].toUpperCase()}${why.slice(1)}.` : 'The run is complete.';
  return (
    <section class={`message ${rest && !rest.zero ? 'high' : 'good'}`} role="status" id="message">
      <span class="mark" style={{ color: rest && !rest.zero ? 'inherit' : 'var(--good)' }}>{rest && !rest.zero ? '!!!' : '✔'}</span>
      <p class="words"><b class="rest">{rest ? rest.text : 'What the coils carry is not known: switch them off by hand.'}</b> {sentence}
        <small>{rest?.detail ?? ''}{store.report ? '' : ' The robot is not held.'}</small></p>
    </section>
  );
}
