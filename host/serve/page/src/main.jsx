// Workbench: pages by the address behind '#', over the state that the server sends.
// SPDX-License-Identifier: Apache-2.0
import { render } from 'preact';
import { useEffect, useState } from 'preact/hooks';
import './style.css';
import { follow } from './api.js';
import { Bar, MessageLine, Navigation } from './frame.jsx';
import { ProtocolForm, ProtocolList } from './protocols.jsx';
import { Queue } from './queue.jsx';
import { Job } from './job.jsx';
import { Compare, Run, Runs } from './runs.jsx';
import { Messages, Sweep, Sweeps } from './others.jsx';

/** "#/protocol/hold?speed=1": ["protocol", "hold", {speed: "1"}]. */
function addressNow() {
  const [path, query] = location.hash.slice(2).split('?');
  const [page, ...rest] = path.split('/');
  return [page || 'protocols', decodeURIComponent(rest.join('/')), Object.fromEntries(new URLSearchParams(query ?? ''))];
}

const IN_NAVIGATION = { protocol: 'protocols', job: 'queue', run: 'runs', compare: 'runs', sweep: 'sweeps' };

function Page({ page, name, given, state }) {
  if (page === 'protocols' || page === 'protocol')
    return (
      <div class={`protocols ${name ? 'chosen' : ''}`}>
        <ProtocolList chosen={name} state={state} />
        {name ? (
          <ProtocolForm key={location.hash} name={name} given={given} state={state} />
        ) : (
          <section class="panel form empty">
            <p>Choose a protocol.</p>
          </section>
        )}
      </div>
    );
  if (!state) return <p class="panel">Reading …</p>;
  if (page === 'queue') return <Queue state={state} />;
  if (page === 'job') return <Job key={name} id={name} state={state} />;
  if (page === 'runs') return <Runs state={state} />;
  if (page === 'run') return <Run key={name} name={name} />;
  if (page === 'compare') return <Compare key={name} names={name} />;
  if (page === 'sweeps') return <Sweeps state={state} />;
  if (page === 'sweep') return <Sweep key={name} name={name} />;
  if (page === 'messages') return <Messages state={state} />;
  return <p class="panel">There is no such page.</p>;
}

function Workbench() {
  const [address, setAddress] = useState(addressNow());
  const [state, setState] = useState(null);
  const [connected, setConnected] = useState(true);
  useEffect(() => {
    const change = () => setAddress(addressNow());
    addEventListener('hashchange', change);
    change(); // it may have changed between the first picture and now
    follow((next) => {
      setConnected(next !== null);
      if (next) setState(next);
    });
    return () => removeEventListener('hashchange', change);
  }, []);
  useEffect(() => {
    document.title = `${state?.running?.status?.question ? '(?) ' : ''}Vitreo`;
  }, [!!state?.running?.status?.question]);
  const [page, name, given] = address;
  return (
    <div class="bench">
      <Navigation page={IN_NAVIGATION[page] ?? page} state={state} />
      <Bar state={state} connected={connected} />
      <div class="lines">
        <MessageLine state={state} connected={connected} />
      </div>
      <main>
        <Page page={page} name={name} given={given} state={state} />
      </main>
    </div>
  );
}

render(<Workbench />, document.getElementById('page'));
