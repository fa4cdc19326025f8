// Runs: found by words or by a condition, read, and two or more of them compared.
// SPDX-License-Identifier: Apache-2.0
import { useEffect, useRef, useState } from 'preact/hooks';
import { when } from './words.js';
import { Outcome, Sheet, useFetched, Wrong } from './parts.jsx';
import { formAddress } from './job.jsx';

const MOST_COMPARED = 8;
const PAGE = 200; // rows in one answer
const CHIPS = [
  ['all', ''],
  ['failed', 'outcome = failed or outcome = aborted or outcome = lost'],
  ['today', () => `time >= ${new Date(Date.now() - 60000 * new Date().getTimezoneOffset()).toISOString().slice(0, 10)}`],
];

export function Runs({ state }) {
  const [typed, setTyped] = useState('');
  const [find, setFind] = useState('');
  const [most, setMost] = useState(PAGE);
  const [ticked, setTicked] = useState([]);
  const search = useRef();
  useEffect(() => search.current?.focus(), []);
  useEffect(() => {
    const timer = setTimeout(() => setFind(typed), 150);
    return () => clearTimeout(timer);
  }, [typed]);
  const [got, error] = useFetched(`/api/runs?most=${most}&find=${encodeURIComponent(find)}`, state.ended[0]?.id);
  const [shown, setShown] = useState(null);
  useEffect(() => {
    if (got) setShown(got);
  }, [got]);
  const tick = (run) => setTicked(ticked.includes(run) ? ticked.filter((one) => one !== run) : [...ticked, run].slice(-MOST_COMPARED));
  return (
    <section class="panel">
      <div class="head">
        <h1>Runs</h1>
        <input ref={search} type="search" id="find" aria-label="Find runs" placeholder="gel, or speed > 0.5mm/s" value={typed} onInput={(event) => setTyped(event.target.value)} />
        {CHIPS.map(([name, text]) => {
          const condition = typeof text === 'function' ? text() : text;
          return (
            <button key={name} class={typed === condition ? 'chip on' : 'chip'} onClick={() => setTyped(condition)}>
              {name}
            </button>
          );
        })}
        <span id="found">{shown ? `${shown.total} run${shown.total === 1 ? '' : 's'}` : ''}</span>
        <a class={`button primary ${ticked.length < 2 ? 'off' : ''}`} id="compare" aria-disabled={ticked.length < 2} href={ticked.length < 2 ? undefined : `#/compare/${ticked.join(',')}`}>
          Compare {ticked.length || ''}
        </a>
      </div>
      <Wrong text={error} />
      {shown && shown.total === 0 ? <p>{find ? 'Nothing found. Drop the filter.' : 'No runs yet. Start one from Protocols.'}</p> : null}
      <div class="wide">
        <table>
          <thead>
            <tr>
              <th />
              <th>When</th>
              <th>Protocol</th>
              <th>Outcome</th>
              {shown?.columns.map((name) => <th key={name} class="right">{name}</th>)}
              <th class="right">Takes</th>
              <th>By</th>
            </tr>
          </thead>
          <tbody>
            {shown?.runs.map((run) => (
              <tr key={run.run} class={ticked.includes(run.run) ? 'on' : ''}>
                <td>
                  <input type="checkbox" aria-label={`compare ${run.run}`} checked={ticked.includes(run.run)} onChange={() => tick(run.run)} />
                </td>
                <td>{when(run.time)}</td>
                <td>
                  <a href={`#/run/${run.run}`}>{run.title || run.run}</a>
                </td>
                <td title={run.reason}>
                  <Outcome outcome={run.outcome} />
                </td>
                {run.values.map((value, index) => <td key={index} class="right">{value}</td>)}
                <td class="right">{run.duration}</td>
                <td>{run.operator}</td>
              </tr>
            ))}
          </tbody>
        </table>
      </div>
      {shown && shown.total > shown.runs.length && most < 500 ? <button onClick={() => setMost(500)}>Show more</button> : null}
    </section>
  );
}

const Values = ({ title, values }) =>
  values.length ? (
    <section class="panel">
      <h2>{title}</h2>
      <dl>
        {values.map((one) => (
          <>
            <dt>{one.name}</dt>
            <dd>{one.shown}</dd>
          </>
        ))}
      </dl>
    </section>
  ) : null;

export function Run({ name }) {
  const [run, error] = useFetched(`/api/runs/${name}`);
  if (!run) return <section class="panel">{error ? <Wrong text={error} /> : 'Reading …'}</section>;
  const address = `/runs/${name}/report.html`;
  return (
    <>
      <section class="panel">
        <div class="head">
          <h1>{run.title}</h1>
          <Outcome outcome={run.outcome} />
          <span>{when(run.time)}</span>
          <a class="button" href={address} target="_blank" rel="noreferrer">In a tab of its own</a>
          <a class="button" href={formAddress(run.protocol, run.parameters.map((one) => `${one.name}=${one.typed}`))}>Run again</a>
        </div>
        {run.reason ? <p class="wrong">{run.reason}</p> : null}
      </section>
      {run.report ? <Sheet address={address} title={`Report of ${run.title}`} /> : <p class="panel">There is no report yet.</p>}
      <div class="columns">
        <Values title="Results" values={run.results} />
        <Values title="Parameters" values={run.parameters} />
        <Values title="Tags and sample" values={[...run.tags, ...run.sample]} />
      </div>
    </>
  );
}

export function Compare({ names }) {
  const path = `/api/compare?runs=${names}`;
  const [made, error] = useFetched(path);
  if (!made) return <section class="panel">{error ? <Wrong text={error} /> : 'Comparing …'}</section>;
  const head = (last) => (
    <tr>
      <th />
      {made.names.map((one) => <th key={one} class="right">{one}</th>)}
      {last ? <th class="right">{last}</th> : null}
    </tr>
  );
  const row = (line, last) => (
    <tr key={line.name}>
      <td>{line.name}</td>
      {line.cells.map((cell, index) => <td key={index} class="right">{cell}</td>)}
      {last ? <td class="right strong">{line.difference}</td> : null}
    </tr>
  );
  const two = made.names.length === 2;
  return (
    <>
      <section class="panel" id="comparison">
        <h1>Compare {made.names.length} runs</h1>
        <p class="sentence">{made.sentence}</p>
        <p class="hint">One run each: the difference is not yet shown to be more than chance. A sweep with repeats shows it.</p>
        <div class="chips">
          {made.runs.map((run, index) => (
            <a key={run.run} class="chip" href={`#/run/${run.run}`}>
              {made.names[index]} {run.title}, {when(run.time)}
            </a>
          ))}
        </div>
      </section>
      <div class="columns">
        <section class="panel">
          <h2>What differs</h2>
          <table>
            <thead>{head()}</thead>
            <tbody>{made.differing.map((line) => row(line))}</tbody>
          </table>
          <p class="hint">The same: {made.same.join(', ')}</p>
        </section>
        <section class="panel">
          <h2>Results</h2>
          <table>
            <thead>{head(two ? 'B − A' : '')}</thead>
            <tbody>{made.results.map((line) => row(line, two))}</tbody>
          </table>
        </section>
      </div>
      <Sheet address={`/compare?runs=${names}`} title="Streams over each other" />
    </>
  );
}
