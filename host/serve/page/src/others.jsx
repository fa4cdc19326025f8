// Sweeps and messages.
// SPDX-License-Identifier: Apache-2.0
import { post } from './api.js';
import { when } from './words.js';
import { Sheet, useAction, useFetched, Wrong } from './parts.jsx';

export function Sweeps({ state }) {
  const [list, error] = useFetched('/api/sweeps', state.ended[0]?.id);
  return (
    <section class="panel">
      <div class="head">
        <h1>Sweeps</h1>
        <span>{list ? list.length : ''}</span>
      </div>
      <Wrong text={error} />
      {list?.length === 0 ? <p>No sweeps yet. A list or a range in a protocol’s form makes one: 0.1..2:5.</p> : null}
      <ol class="table">
        {list?.map((one) => (
          <li key={one.name}>
            <b>{one.protocol}</b>
            <span>{one.name}</span>
            <span>{one.points} runs</span>
            {one.report ? <a href={`#/sweep/${one.name}`}>Report</a> : <span>no report yet</span>}
            {one.csv ? <a href={`/sweeps/${one.name}/sweep.csv`} download>CSV</a> : <span />}
          </li>
        ))}
      </ol>
    </section>
  );
}

export const Sweep = ({ name }) => (
  <>
    <section class="panel">
      <div class="head">
        <h1>Sweep</h1>
        <span>{name}</span>
        <a class="button" href={`/sweeps/${name}/sweep.csv`} download>CSV</a>
        <a class="button" href={`/sweeps/${name}/report.html`} target="_blank" rel="noreferrer">In a tab of its own</a>
      </div>
    </section>
    <Sheet address={`/sweeps/${name}/report.html`} title={`Report of the sweep ${name}`} />
  </>
);

export function Messages({ state }) {
  const [got, error, again] = useFetched('/api/messages', JSON.stringify(state.messages[0]));
  const [test, busy, refused] = useAction(async () => {
    await post('/api/messages/test');
    again();
  });
  return (
    <section class="panel">
      <div class="head">
        <h1>Messages</h1>
        <button disabled={busy} onClick={test}>Send a test</button>
      </div>
      <Wrong text={error ?? got?.error} />
      <Wrong text={refused} />
      {got?.channels.length === 0 && !got.error ? (
        <p>No message is sent when a job fails. The file ~/.config/vitreo/messages.json says to whom: vitreo docs how-to/workbench.</p>
      ) : null}
      <ul>
        {got?.channels.map((one) => (
          <li key={one.to}>
            {one.to}, {one.when === 'ended' ? 'of every end' : 'when something failed'}
          </li>
        ))}
      </ul>
      <ol class="table">
        {got?.messages.map((one) => (
          <li key={`${one.added}${one.channel}${one.subject}`}>
            <span>{when(one.added)}</span>
            <b>{one.subject}</b>
            <span>{one.channel}</span>
            <span class={one.told ? '' : one.tries ? 'bad' : ''}>
              {one.told ? `told after ${one.told - one.added} s` : one.tries ? `not taken: ${one.error}` : 'on its way'}
            </span>
          </li>
        ))}
      </ol>
    </section>
  );
}
