// Positions, coils and log.
import { formatNumber, formatQuantity, showColumn } from './format.js';
import { newest, present } from './link.js';
import { mm } from './depth.jsx';
import { gathered, restWords } from './words.js';

export function Positions({ store, zero }) {
  const row = present(store, 'servo');
  const cells = (of) => ['x', 'y', 'z'].map((axis) => <td>{row ? of(axis) ?? '–' : '–'}</td>);
  const off = { x: 0, y: 0, z: zero };
  const micrometers = (a, b) => (a === null || b === null ? null : String(Math.round((a - b) * 1e6) + 0).replace('-', '−'));
  return (
    <section class="panel positions">
      <table>
        <thead><tr><th>{zero === 0 ? 'mm' : 'mm, z from zero'}</th><th scope="col">x</th><th scope="col">y</th><th scope="col">z</th></tr></thead>
        <tbody>
          <tr class="robot"><th scope="row">Robot</th>{cells((axis) => (row[axis] === null ? null : mm(row[axis] - off[axis])))}</tr>
          <tr><th scope="row">Target</th>{cells((axis) => (row[`target_${axis}`] === null ? null : mm(row[`target_${axis}`] - off[axis])))}</tr>
          <tr><th scope="row">Error, µm</th>{cells((axis) => micrometers(row[axis], row[`target_${axis}`]))}</tr>
        </tbody>
      </table>
    </section>
  );
}

export function Coils({ store }) {
  const currents = newest(store, 'currents'), warm = newest(store, 'coil_temperature'), servo = newest(store, 'servo');
  const limit = store.hello?.geometry.current_limit ?? 20, { field } = store.status;
  // What was sent last no longer flows once the coils were made safe.
  const rest = store.rest && store.rest.t >= (currents?.t ?? 0) ? store.rest : null;
  const names = currents ? Object.keys(currents).filter((name) => name !== 't') : [];
  const hottest = warm ? showColumn([Math.max(...Object.values(warm).slice(1))], 'K', 2) : null;
  const room = servo?.headroom != null ? `headroom ${(servo.headroom * 100).toFixed(0)} % of ${limit} A${servo.limited ? ', LIMITED' : ''}` : `limit ${limit} A`;
  const said = rest ? (restWords(store)?.zero ? (rest.amperes ? '0 A, read back' : '0 A, set') : 'NOT at zero') : names.length ? room : 'no currents yet';
  return (
    <section class="panel coils">
      <h2>Coils <span class="quiet">{said}</span>
        <span class="quiet right number">{field && !rest ? `${formatQuantity(field.tesla, 'T')} ` : ''}{hottest ? `${field && !rest ? '· ' : ''}${hottest.numbers[0]} ${hottest.unit}` : ''}</span>
        {field && !rest ? <Field direction={field.direction} /> : null}</h2>
      <div class="row">
        {names.map((name, i) => {
          const current = rest ? (rest.amperes?.[i] ?? null) : currents[name], share = Math.max(-1, Math.min(1, (current ?? 0) / limit));
          return (
            <div class="coil">
              <svg viewBox="0 0 12 100" preserveAspectRatio="none" aria-hidden="true"><rect width="12" height="100" fill="var(--control)" />
                <rect y={share > 0 ? 50 - 50 * share : 50} width="12" height={Math.max(2, Math.abs(share) * 50)} fill={Math.abs(share) > 0.9 ? 'var(--high)' : 'var(--accent)'} /></svg>
              <span class="value">{current == null ? '–' : (Math.abs(current) < 0.005 ? '0' : current.toFixed(2)).replace('-', '−')}</span>
              <span class="quiet">{i + 1}</span>
            </div>
          );
        })}
      </div>
    </section>
  );
}

/** The field's direction from above; the tip is filled where it points up. */
function Field({ direction: [x, y, z] }) {
  return (
    <svg viewBox="-10 -10 20 20" width="20" height="20" role="img" aria-label="field direction from above">
      <circle r="9" fill="none" stroke="var(--edge)" /><line x2={x * 8} y2={-y * 8} stroke="var(--medium)" stroke-width="2" />
      <circle cx={x * 8} cy={-y * 8} r="2" fill={z >= 0 ? 'var(--medium)' : 'var(--panel)'} stroke="var(--medium)" />
    </svg>
  );
}

/** What devices and the loop said as JSON, as people read it. */
function plain(text) {
  if (!/^[[{]/.test(text)) return text;
  const said = (value) => {
    if (typeof value === 'number') return formatNumber(value, 4);
    if (value === null || typeof value !== 'object') return String(value);
    if (Array.isArray(value)) return `(${value.map(said).join(', ')})`;
    return Object.entries(value).map(([key, inner]) => `${key.replaceAll('_', ' ')} ${said(inner)}`).join(', ');
  };
  try {
    return said(JSON.parse(text));
  } catch {
    return text;
  }
}

export function Log({ store }) {
  const groups = gathered(store.lines);
  return (
    <section class="panel log">
      <h2>Log <span class="quiet right">{groups.length} lines</span></h2>
      <ol>
        {groups.slice(-80).reverse().map((line) => (
          <li class={line.kind}><time>{line.t.toFixed(1)} s</time><span>{line.kind === 'message' || line.kind === 'note' ? '' : `${line.kind.replaceAll('_', ' ')}: `}{plain(line.text)}{line.times > 1 ? <span class="quiet"> × {line.times}</span> : null}</span></li>
        ))}
      </ol>
    </section>
  );
}
