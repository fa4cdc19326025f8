// Protocols: the list, the form of one, made of what it declares, and what will happen.
// SPDX-License-Identifier: Apache-2.0
import { useEffect, useState } from 'preact/hooks';
import { post } from './api.js';
import { bytes, duration, label, when } from './words.js';
import { useAction, useFetched, useKept, Wrong } from './parts.jsx';

const MOST_BUTTONS = 4; // choices beyond them are a list
const MOST_LETTERS = 32; // of all of them: more do not stand side by side at 390 px

export function ProtocolList({ chosen, state }) {
  const [all, error] = useFetched('/api/protocols');
  const [find, setFind] = useState('');
  const [last] = useKept('last_used', []);
  if (!all) return <section class="list panel">{error ? <Wrong text={error} /> : 'Reading the protocols …'}</section>;
  const fits = (one) => `${one.name} ${one.title ?? ''} ${one.about ?? ''}`.toLowerCase().includes(find.toLowerCase());
  const ended = (name) => state?.ended.find((job) => job.request.protocol === name);
  const row = (one) => (
    <a key={one.name} href={`#/protocol/${one.name}`} class={one.name === chosen ? 'here' : ''}>
      <span>{one.title ?? one.name}</span>
      <small>
        {one.error ? 'does not load' : state?.running?.job.request.protocol === one.name ? 'running now' : ended(one.name) ? when(ended(one.name).ended) : one.name}
      </small>
    </a>
  );
  const used = last.map((name) => all.find((one) => one.name === name)).filter((one) => one && fits(one));
  const others = all.filter((one) => fits(one) && !used.includes(one));
  return (
    <section class="list panel" aria-label="Protocols">
      <input type="search" placeholder={`Search ${all.length} protocols`} aria-label="Search protocols" value={find} onInput={(event) => setFind(event.target.value)} />
      {used.length ? <h3>Last used</h3> : null}
      {used.map(row)}
      {used.length ? <h3>All</h3> : null}
      {others.map(row)}
      {used.length + others.length === 0 ? <p>Nothing found. Take a word away.</p> : null}
    </section>
  );
}

function Choice({ parameter, value, onChange }) {
  const choices = parameter.kind === 'flag' ? ['true', 'false'] : parameter.choices;
  const taken = value.split(',');
  if (choices.length > MOST_BUTTONS || choices.join('').length > MOST_LETTERS)
    return (
      <select id={`p_${parameter.name}`} value={value} onChange={(event) => onChange(event.target.value)}>
        {choices.map((one) => (
          <option key={one}>{one}</option>
        ))}
      </select>
    );
  // With Ctrl or Shift a second one is added: a sweep over both.
  const press = (event, one) => {
    if (!event.ctrlKey && !event.shiftKey) return onChange(one);
    const more = taken.includes(one) ? taken.filter((other) => other !== one) : [...taken, one];
    return onChange(choices.filter((each) => more.includes(each)).join(',') || one);
  };
  return (
    <div class="segments" role="group" aria-label={label(parameter.name)}>
      {choices.map((one) => (
        <button type="button" key={one} aria-pressed={taken.includes(one)} onClick={(event) => press(event, one)}>
          {one}
        </button>
      ))}
    </div>
  );
}

function Field({ parameter, typed, error, onChange }) {
  const value = typed ?? parameter.default_text;
  const choice = parameter.kind === 'choice' || parameter.kind === 'flag';
  const range = parameter.range_text ? `${parameter.range_text}${parameter.print_unit ? ` ${parameter.print_unit}` : ''}` : '';
  const usual = parameter.required ? 'needed' : typed !== undefined && !choice ? `default ${parameter.default_text}` : '';
  return (
    <div class={`field ${error ? 'bad' : typed !== undefined ? 'changed' : ''}`}>
      <label for={`p_${parameter.name}`}>{label(parameter.name)}</label>
      {choice ? (
        <Choice parameter={parameter} value={value} onChange={onChange} />
      ) : (
        <div class="entry">
          <input id={`p_${parameter.name}`} value={value} aria-invalid={!!error} onInput={(event) => onChange(event.target.value)} autocomplete="off" />
          <span>{/[a-zµ°%]/i.test(value.replace(/e/gi, '')) ? '' : parameter.print_unit}</span>
        </div>
      )}
      <p class={error ? 'wrong' : ''}>{error ? error : [parameter.help, range, usual].filter(Boolean).join('; ')}</p>
    </div>
  );
}

const clean = (values, form) => {
  const left = {};
  for (const parameter of form.parameters) {
    const typed = values[parameter.name];
    if (typed !== undefined && typed !== parameter.default_text) left[parameter.name] = typed;
  }
  return left;
};

/** The server's opinion of what is typed: {errors, command, sweep, points, for: the values it is about}. */
function useChecked(name, values, repeats) {
  const [checked, setChecked] = useState(null);
  const key = JSON.stringify([name, values, repeats]);
  useEffect(() => {
    let wanted = true;
    const timer = setTimeout(async () => {
      try {
        const said = await post(`/api/protocols/${name}/check`, { values, repeats });
        if (wanted) setChecked({ ...said, key });
      } catch (problem) {
        if (wanted) setChecked({ errors: { '': problem.message }, command: '', key });
      }
    }, 120);
    return () => {
      wanted = false;
      clearTimeout(timer);
    };
  }, [key]);
  return [checked, checked?.key === key];
}

/** A rehearsal on the rig's twin, once the values are right and have rested. */
function useRehearsal(name, request, ready) {
  const [rehearsal, setRehearsal] = useState(null);
  const key = JSON.stringify([name, request]);
  useEffect(() => {
    setRehearsal(null);
    if (!ready) return undefined;
    let wanted = true;
    const timer = setTimeout(async () => {
      try {
        const said = await post(`/api/protocols/${name}/rehearse`, request);
        if (wanted) setRehearsal(said);
      } catch (problem) {
        if (wanted) setRehearsal({ problems: [problem.message], warnings: [], asks: [], passed: false });
      }
    }, 700);
    return () => {
      wanted = false;
      clearTimeout(timer);
    };
  }, [key, ready]);
  return rehearsal;
}

function WhatWillHappen({ rehearsal, checked, sweep, right }) {
  const row = (name, value) => (
    <>
      <dt>{name}</dt>
      <dd>{value}</dd>
    </>
  );
  if (sweep)
    return (
      <section class="panel">
        <h2>What will happen</h2>
        <dl>{row('Runs', checked?.points)}</dl>
        <p class="hint">A sweep: each combination of the values, each run under a machine of its own.</p>
      </section>
    );
  return (
    <section class="panel" id="rehearsal">
      <h2>What will happen</h2>
      {rehearsal ? (
        <>
          <p class="hint">Rehearsed on the rig’s twin</p>
          <dl>
            {row('Takes at least', duration(rehearsal.duration))}
            {rehearsal.peak ? row('Largest current', `${rehearsal.peak.toFixed(1)} A`) : null}
            {rehearsal.disk_bytes ? row('Record', bytes(rehearsal.disk_bytes)) : null}
            {row('Asks you', rehearsal.asks?.length ? `${rehearsal.asks.length} question${rehearsal.asks.length > 1 ? 's' : ''}` : 'nothing')}
          </dl>
          {rehearsal.problems.map((text) => (
            <p key={text} class="wrong">{text}</p>
          ))}
          {rehearsal.warnings?.map((text) => (
            <p key={text} class="hint">{text}</p>
          ))}
        </>
      ) : (
        <p class="hint">{right ? 'Rehearsing on the rig’s twin …' : 'Is rehearsed once the values are right.'}</p>
      )}
    </section>
  );
}

const dueOf = (text) => (text ? Math.round(new Date(text).getTime() / 1000) : 0);

export function ProtocolForm({ name, given, state }) {
  const [form, problem] = useFetched(`/api/protocols/${name}`);
  const [rigs] = useFetched('/api/rigs');
  const [values, setValues] = useState(given);
  const [options, setOptions] = useState({ rig: '', seed: '1', repeats: '1', real_time: false, person: false, due: '' });
  const [operator, setOperator] = useKept('operator', '');
  const [last, setLast] = useKept('last_used', []);
  const typed = form ? clean(values, form) : {};
  const repeats = Math.max(1, Math.round(Number(options.repeats)) || 1);
  const [checked, fresh] = useChecked(name, typed, repeats);
  const seed = Math.max(0, Math.round(Number(options.seed)) || 0);
  const errors = checked?.errors ?? {};
  const right = fresh && Object.keys(errors).length === 0;
  const rehearsal = useRehearsal(name, { values: typed, rig: options.rig, seed }, right && !checked.sweep);
  const request = { protocol: name, values: typed, rig: options.rig, seed, repeats, operator: operator || state?.operator || '', real_time: options.real_time };
  const add = async (more) => {
    const job = await post('/api/queue', { ...request, ...more });
    setLast([name, ...last.filter((one) => one !== name)].slice(0, 5));
    return job;
  };
  const [start, starting, refused] = useAction(async () => {
    const job = await add({ attended: true, before: state?.waiting[0]?.id ?? null });
    location.hash = `#/job/${job.id}`;
  });
  const [enqueue, adding, notAdded] = useAction(async () => {
    await add({ due: dueOf(options.due), person: options.person });
    location.hash = '#/queue';
  });
  if (!form) return <section class="panel form">{problem ? <Wrong text={problem} /> : 'Reading the protocol …'}</section>;
  const set = (key, value) => setOptions({ ...options, [key]: value });
  const first = Object.keys(errors)[0];
  const count = Object.keys(typed).length;
  return (
    <>
      <section class="panel form" aria-label={form.title}>
        <h1>{form.title}</h1>
        <p>{form.about}</p>
        <div class="chips">
          <span class={count ? 'chip on' : 'chip'}>{count ? `${count} changed` : 'defaults'}</span>
          <button type="button" class="chip" onClick={() => setValues({})}>
            Defaults
          </button>
          <small>A list (0.1, 0.5) or a range (0.1..2:5) makes a sweep</small>
        </div>
        {form.parameters.map((parameter) => (
          <Field key={parameter.name} parameter={parameter} typed={typed[parameter.name]} error={errors[parameter.name]} onChange={(text) => setValues({ ...values, [parameter.name]: text })} />
        ))}
        <details>
          <summary>Rig, seed, pace, operator</summary>
          <div class="field">
            <label for="o_rig">Rig</label>
            <select id="o_rig" value={options.rig} onChange={(event) => set('rig', event.target.value)}>
              <option value="">{form.rig || 'simulated'} (the protocol’s own)</option>
              {rigs?.map((one) => (
                <option key={one}>{one}</option>
              ))}
            </select>
            <p />
          </div>
          <div class="field">
            <label for="o_seed">Seed</label>
            <div class="entry"><input id="o_seed" inputmode="numeric" value={options.seed} onInput={(event) => set('seed', event.target.value)} /></div>
            <p>of all that is drawn by chance</p>
          </div>
          <div class="field">
            <label for="o_repeats">Repeats</label>
            <div class="entry"><input id="o_repeats" inputmode="numeric" value={options.repeats} onInput={(event) => set('repeats', event.target.value)} /></div>
            <p>more than one makes a sweep, each run under a machine of its own</p>
          </div>
          <div class="field">
            <label for="o_operator">Operator</label>
            <div class="entry"><input id="o_operator" value={operator} placeholder={state?.operator} onInput={(event) => setOperator(event.target.value)} /></div>
            <p>for the record</p>
          </div>
          <div class="field">
            <label for="o_pace">At the clock’s pace</label>
            <input type="checkbox" id="o_pace" checked={options.real_time} onChange={(event) => set('real_time', event.target.checked)} />
            <p>a simulated rig as slow as a real one, to be watched</p>
          </div>
        </details>
        <footer>
          <code>{checked?.command}</code>
          <button type="button" onClick={() => navigator.clipboard?.writeText(checked?.command ?? '')}>
            Copy
          </button>
        </footer>
      </section>
      <aside>
        <section class="panel start">
          <button id="start" class="primary big" disabled={!right || starting} onClick={start}>
            {state?.running ? 'Start when the rig is free' : checked?.sweep ? 'Start the sweep' : 'Start'}
          </button>
          {first !== undefined ? <p class="hint">Correct {first === '' ? `this first: ${errors['']}` : label(first)}</p> : null}
          <Wrong text={refused} />
          <details>
            <summary>Later, from the queue</summary>
            <label for="o_due">Not before</label>
            <input type="datetime-local" id="o_due" value={options.due} onInput={(event) => set('due', event.target.value)} />
            <label class="tick">
              <input type="checkbox" checked={options.person} onChange={(event) => set('person', event.target.checked)} /> needs a person
            </label>
            <button id="enqueue" disabled={!right || adding} onClick={enqueue}>
              Add to the queue
            </button>
            <Wrong text={notAdded} />
          </details>
        </section>
        <WhatWillHappen rehearsal={rehearsal} checked={checked} sweep={checked?.sweep} right={right} />
      </aside>
    </>
  );
}
