// Job: one run or sweep from its start to its report.
// SPDX-License-Identifier: Apache-2.0
import { post } from './api.js';
import { changed, duration, when } from './words.js';
import { Outcome, Sheet, useAction, useFetched, Wrong } from './parts.jsx';
import { command, phase } from './frame.jsx';

/** The form of the same protocol with these arguments. */
export const formAddress = (protocol, words) =>
  `#/protocol/${protocol}?${words.map((word) => { const at = word.indexOf('='); return `${encodeURIComponent(word.slice(0, at))}=${encodeURIComponent(word.slice(at + 1))}`; }).join('&')}`;

function Running({ running }) {
  const status = running.status;
  const [act, , error] = useAction(command);
  const paused = status?.phase === 'paused' || status?.phase === 'suspended';
  return (
    <section class="panel" id="running">
      <h2>{phase(running)}</h2>
      {status?.question ? <p>The question stands in the line above.</p> : null}
      {status?.progress > 0 ? <progress value={status.progress} aria-label="Progress" /> : null}
      {status?.remaining >= 0 ? <p>{duration(status.remaining)} left</p> : null}
      {status?.note ? <p class="hint">{status.note}</p> : null}
      <div class="row">
      {status && !running.job.request.sweep ? (
        <button onClick={() => act({ do: paused || status.phase === 'pause requested' ? 'resume' : 'pause' })}>{paused || status.phase === 'pause requested' ? 'Resume' : 'Pause'}</button>
      ) : null}
      {running.live ? <a class="button" href="/live_view" target="vitreo_live">Live view</a> : null}
      </div>
      <Wrong text={error} />
    </section>
  );
}

export function Job({ id, state }) {
  const [job, error] = useFetched(`/api/jobs/${id}`, `${state.running?.job.id}/${state.ended[0]?.id}/${state.waiting.length}`);
  const [start, , refused] = useAction(() => post(`/api/queue/${id}/start`));
  if (!job) return <section class="panel">{error ? <Wrong text={error} /> : 'Reading …'}</section>;
  const running = state.running?.job.id === job.id ? state.running : null;
  const waits = state.waiting.some((one) => one.id === job.id);
  const address = job.request.sweep ? `/sweeps/${job.run}/report.html` : `/runs/${job.run}/report.html`;
  const ended = job.state === 'ended';
  return (
    <>
      <section class="panel">
        <div class="head">
          <h1>{job.title}</h1>
          <Outcome outcome={ended ? job.outcome : running ? 'running' : job.state} />
          <span>{changed(job.request)}</span>
          {ended && job.run ? <a class="button primary" id="report" href={job.request.sweep ? `#/sweep/${job.run}` : `#/run/${job.run}`}>Open the report</a> : null}
          {ended ? <a class="button" href={formAddress(job.request.protocol, job.request.arguments)}>Run again</a> : null}
        </div>
        {ended ? <p>{when(job.ended)}{job.started ? `, after ${duration(job.ended - job.started)}` : ''}</p> : null}
        {job.reason ? <p class={job.outcome === 'completed' ? '' : 'wrong'}>{job.reason}</p> : null}
        {waits ? (
          <p>
            {job.needs_person ? 'It waits for a person. ' : 'It waits for its turn. '}
            <button onClick={start}>Start now</button>
          </p>
        ) : null}
        {job.rehearsal?.asks?.length ? (
          <ul class="hint">{job.rehearsal.asks.map((text) => <li key={text}>asks: {text}</li>)}</ul>
        ) : null}
        <Wrong text={refused} />
        <p><code>{job.command}</code></p>
      </section>
      {running ? <Running running={running} /> : null}
      {ended && job.run ? <Sheet address={address} title={`Report of ${job.title}`} /> : null}
      {job.said ? (
        <details class="panel" open={ended && !job.run}>
          <summary>What it said</summary>
          <pre>{job.said}</pre>
        </details>
      ) : null}
    </>
  );
}
