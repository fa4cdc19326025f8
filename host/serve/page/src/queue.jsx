// Queue: what waits and in which order, and how the last jobs ended.
// SPDX-License-Identifier: Apache-2.0
import { useState } from 'preact/hooks';
import { call, post } from './api.js';
import { changed, duration, when } from './words.js';
import { Outcome, useAction, Wrong } from './parts.jsx';

function starts(job, index, state) {
  if (job.needs_person && job.attended_until < state.time) return 'waits for a person';
  if (job.request.due > state.time) return when(job.request.due);
  if (state.held) return 'held';
  if (job.rehearsal === null && !job.request.sweep) return 'being rehearsed';
  return index === 0 && !state.running ? 'now' : 'in its turn';
}

export function Queue({ state }) {
  const [dragged, setDragged] = useState(0);
  const [removed, setRemoved] = useState(null);
  const jobs = state.waiting;
  const [act, , error] = useAction((method, path, body) => call(method, path, body));
  const move = (job, before) => act('POST', `/api/queue/${job}/move`, { before });
  const remove = async (job) => {
    if (await act('DELETE', `/api/queue/${job.id}`)) setRemoved(job);
  };
  const undo = async () => {
    if (await act('POST', '/api/queue', removed.request)) setRemoved(null);
  };
  const keys = (event, index) => {
    if (!event.altKey) return;
    if (event.key === 'ArrowUp' && index > 0) move(jobs[index].id, jobs[index - 1].id);
    if (event.key === 'ArrowDown' && index + 1 < jobs.length) move(jobs[index].id, jobs[index + 2]?.id ?? null);
  };
  return (
    <>
      <section class="panel">
        <div class="head">
          <h1>Queue</h1>
          <span>{jobs.length ? `${state.waiting_total} waiting${state.waiting_total > jobs.length ? `, the first ${jobs.length} of them here` : ''}` : 'Nothing waits.'}</span>
          <button id="hold" onClick={() => act('POST', '/api/queue/hold', { held: !state.held })}>
            {state.held ? 'Let the queue go on' : 'Hold the queue'}
          </button>
          <a class="button" href="#/protocols">Add a protocol</a>
        </div>
        <Wrong text={error} />
        {removed ? (
          <p class="hint">
            {removed.title} was removed. <button onClick={undo}>Undo</button>
          </p>
        ) : null}
        <ol class="table queue">
          {jobs.map((job, index) => (
            <li
              key={job.id}
              tabIndex={0}
              draggable
              aria-label={`${index + 1}: ${job.title}; Alt and arrows move it`}
              onKeyDown={(event) => keys(event, index)}
              onDragStart={() => setDragged(job.id)}
              onDragOver={(event) => event.preventDefault()}
              onDrop={() => dragged && dragged !== job.id && move(dragged, job.id)}
            >
              <span class="number">{index + 1}</span>
              <a href={`#/job/${job.id}`}><b>{job.request.sweep ? `Sweep: ${job.title}` : job.title}</b></a>
              <span>{changed(job.request)}</span>
              <span>{starts(job, index, state)}</span>
              <span>{job.rehearsal?.passed === false ? <i class="bad">would be refused</i> : duration(job.rehearsal?.duration)}</span>
              <span>{job.needs_person ? <i class="person">! {job.rehearsal?.asks?.length ? `answers ${job.rehearsal.asks.length}` : 'a person'}</i> : 'no person'}</span>
              <span class="acts">
                <button title="up" aria-label="up" disabled={index === 0} onClick={() => move(job.id, jobs[index - 1].id)}>↑</button>
                <button title="down" aria-label="down" disabled={index + 1 === jobs.length} onClick={() => move(job.id, jobs[index + 2]?.id ?? null)}>↓</button>
                <button onClick={() => post(`/api/queue/${job.id}/start`)}>Start now</button>
                <button onClick={() => remove(job)}>Remove</button>
              </span>
            </li>
          ))}
        </ol>
      </section>
      <section class="panel">
        <h2>Ended</h2>
        {state.ended.length === 0 ? <p>Nothing has run yet. Start something from Protocols.</p> : null}
        <ol class="table ended">
          {state.ended.map((job) => (
            <li key={job.id}>
              <span>{when(job.ended)}</span>
              <a href={`#/job/${job.id}`}><b>{job.title}</b></a>
              <span>{changed(job.request)}</span>
              <Outcome outcome={job.outcome} />
              <span class="reason">{job.reason}</span>
            </li>
          ))}
        </ol>
      </section>
    </>
  );
}
