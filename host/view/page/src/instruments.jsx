// Instruments that a hand may adjust while the run goes on: stages, focus, lamp, cameras; within the limits of the rig, which the
// program holds. A value is what the instrument said when it was read; it is read anew while the panel is open.
import { useEffect, useRef } from 'preact/hooks';

const kRead = 2000; // ms between two readings
const kSettled = 600; // ms: by then the program has said that it is busy with what was asked for

// Of a unit: [in print, factor, decimals, small step, large step], steps in print; of a time they are shares of the value.
const kUnits = { m: ['mm', 1e3, 3, 0.01, 0.1], rad: ['°', 180 / Math.PI, 2, 0.5, 5], '%': ['%', 100, 0, 1, 10], s: ['ms', 1e3, 2, 0.05, 0.25], dB: ['dB', 1, 1, 0.5, 3] };
const kNames = { lens_mover: 'BIOM lens', lamp: 'Lamp' };

const unitOf = (knob) => kUnits[knob.unit] ?? [knob.unit, 1, 3, knob.step, 10 * knob.step];
const nameOf = (name) => kNames[name] ?? `${name[0].toUpperCase()}${name.slice(1).replaceAll('_', ' ')}`;
const clamp = (knob, value) => Math.min(knob.max ?? Infinity, Math.max(knob.min ?? -Infinity, value));
const text = (knob, value) => (value === null ? '–' : ((value * unitOf(knob)[1]).toFixed(unitOf(knob)[2]).replace(/^-(0\.?0*)$/, '$1')).replace('-', '−'));

const plain = (knob, value) => text(knob, value).replace(/\.0+$/, ''); // ends of a range

function Knob({ knob, mine, aims, send }) {
  const field = useRef(null), [unit, factor, , small, large] = unitOf(knob);
  const aim = aims[knob.name], from = aim ? aim.value : knob.value;
  const go = (value) => {
    aims[knob.name] = { value: clamp(knob, value), at: performance.now() };
    send({ do: 'adjust', instrument: knob.name, to: aims[knob.name].value });
  };
  const by = (step) => go(knob.unit === 's' ? from * (step > 0 ? 1 + step : 1 / (1 - step)) : from + step / factor);
  const type = (event) => {
    if (event.key !== 'Enter') return;
    const value = Number(field.current.value.trim().replace('−', '-').replace(',', '.'));
    if (field.current.value.trim() !== '' && Number.isFinite(value)) send({ do: 'adjust', instrument: knob.name, to: value / factor }); // out of range: the program refuses, and says why
    field.current.value = '';
    field.current.blur();
  };
  const off = !mine || from === null, bounded = knob.min !== null && knob.max !== null;
  const at = bounded && knob.value !== null ? ((knob.value - knob.min) / (knob.max - knob.min)) * 100 : null;
  const step = (amount, sign) => (
    <button disabled={off} onClick={() => by(amount)} title={knob.unit === 's' ? `${Math.round(Math.abs(amount) * 100)} %` : `${Math.abs(amount)} ${unit}`}
      aria-label={`${nameOf(knob.name)} ${sign}`}>{sign}</button>
  );
  return (
    <li class="knob" data-name={knob.name}>
      <p><b>{nameOf(knob.name)}</b><span class="number value">{text(knob, knob.value)} {unit}{aim || knob.busy ? <span class="quiet"> → {text(knob, from)}</span> : null}</span></p>
      <svg viewBox="0 0 100 4" preserveAspectRatio="none" aria-hidden="true"><rect width="100" height="4" fill="var(--control)" />
        {at !== null ? <rect x={Math.max(0, at - 1)} width="2" height="4" fill="var(--accent)" /> : null}</svg>
      <div class="steps">
        {step(-large, '−−')}{step(-small, '−')}
        <input ref={field} disabled={!mine} placeholder={unit} aria-label={`${nameOf(knob.name)}, ${unit}`} onKeyDown={type} />
        {step(small, '+')}{step(large, '++')}
      </div>
      <small class={knob.refused ? 'red' : 'quiet'}>{knob.refused ? `Not done: ${knob.refused}` :
        `${bounded ? `${plain(knob, knob.min)} to ${plain(knob, knob.max)} ${unit}` : 'endless'}${knob.by ? ` · last by ${knob.by}` : ''}`}</small>
    </li>
  );
}

export function Instruments({ store, close }) {
  const aims = useRef({}).current, knobs = store.status.instruments ?? [];
  const live = store.ended === null, mine = live && store.status.control === 'mine', there = knobs.length > 0;
  useEffect(() => {
    if (!mine || !there) return undefined;
    store.send({ do: 'adjust' });
    const timer = setInterval(() => store.send({ do: 'adjust' }), kRead);
    return () => clearInterval(timer);
  }, [mine, there]);
  for (const knob of knobs) // what was asked for is shown until it is there, or was refused
    if (aims[knob.name] && !knob.busy && performance.now() - aims[knob.name].at > kSettled) delete aims[knob.name];
  const why = !live ? 'The run has ended.' : !there ? 'This run has no instruments that can be adjusted by hand.' : !mine ? 'Take control to adjust them.' : '';
  return (
    <section class="panel instruments" id="instruments" aria-label="Instruments">
      <h2>Instruments <span class="quiet">{why}</span><button class="right" id="close-instruments" aria-label="close" onClick={close}>✕</button></h2>
      <ul>{knobs.map((knob) => <Knob key={knob.name} knob={knob} mine={mine} aims={aims} send={store.send} />)}</ul>
    </section>
  );
}
