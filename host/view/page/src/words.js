// The run's state in people's words: what it does, what it waits for, what the coils were read back as.
import { present } from './link.js';

const kLost = 1; // s without the robot's ellipse
const kArrived = 150e-6; // m

/** What a call of a script does while it is waited for. Others: "stage:move_to" is said as "stage: move to". */
const kWaits = {
  'run:wait': 'Waiting',
  'run:ask': 'Waiting for you',
  'run:confirm': 'Waiting for you',
  'servo:go_to': 'Moving to the target',
  'servo:follow': 'Following the path',
  'servo:hold': 'Holding',
  'servo:wait_until_tracked': 'Looking for the robot',
  'servo:trim': 'Trimming',
  'camera:grab': 'Taking pictures',
  'camera:learn_background': 'Learning the background',
  'stage:move_to': 'Moving the stage',
  'stage:move_by': 'Moving the stage',
  'stage:home': 'Homing the stage',
  resume: 'Paused',
};

export function waitWords(what) {
  if (!what) return '';
  const first = what.split(', ')[0];
  if (kWaits[first]) return kWaits[first];
  const [object, call] = first.split(':');
  return call ? `Busy: ${object.replaceAll('_', ' ')}, ${call.replaceAll('_', ' ')}` : `Busy: ${first.replaceAll('_', ' ')}`;
}

/** Seconds of the experiment since the robot was seen or measured; 0 while it is, null where no loop looks for it. */
export function lostFor(store) {
  if (!present(store, 'servo')) return null;
  const held = store.streams.servo, last = held.rows[held.rows.length - 1][0];
  // By a sensor without an image it is seen where it is measured.
  const columns = [held.channels.u_px + 1, held.channels.x + 1];
  for (let i = held.rows.length - 1; i >= 0; --i)
    if (columns.some((column) => held.rows[i][column] !== null)) return store.time - held.rows[i][0];
  return last - held.rows[0][0];
}

function loopWords(store) {
  const row = present(store, 'servo');
  if (!row || row.target_x === null || row.x === null) return '';
  const off = Math.hypot(row.x - row.target_x, row.y - row.target_y, row.z - row.target_z);
  return off > kArrived ? 'Moving to the target' : 'Holding';
}

/** { kind, word, mark }: one of running, waiting, question, pausing, paused, lost, stopping, ready, ended, offline, idle. */
export function stateOf(store) {
  const { status, ended } = store, phase = status.phase;
  if (ended !== null) return { kind: 'ended', word: endWord(ended), mark: 'ring' };
  if (!store.hello && store.lostAt === null) return { kind: 'idle', word: 'No run yet', mark: 'ring' };
  if (!store.connected) return { kind: 'offline', word: 'Not connected', mark: 'cross' };
  if (!store.hello) return { kind: 'idle', word: 'No run yet', mark: 'ring' };
  if (phase === 'stop_requested' || phase === 'stop requested' || phase === 'stopping')
    return { kind: 'stopping', word: 'Stopping', mark: 'square' };
  if (phase === 'not responding') return { kind: 'stopping', word: 'Not answering', mark: 'cross' };
  if (status.question) return { kind: 'question', word: 'Waiting for you', mark: 'dot' };
  if (phase === 'paused' || phase === 'suspended')
    return { kind: 'paused', word: phase === 'paused' ? 'Paused' : 'Interrupted', mark: 'square' };
  if (phase === 'pause requested') return { kind: 'pausing', word: 'Pausing at the next step', mark: 'square' };
  const lost = lostFor(store);
  if (lost !== null && lost > kLost) return { kind: 'lost', word: 'Robot lost', mark: 'cross' };
  if (phase === 'ready') return { kind: 'ready', word: loopWords(store) || 'Ready', mark: 'ring' };
  const word = loopWords(store) || waitWords(status.waiting_for) || 'Working';
  return { kind: 'running', word, mark: 'dot' };
}

export function endWord(ended) {
  const word = ended.split(':')[0];
  return word ? word[0].toUpperCase() + word.slice(1) : 'Ended';
}

/** { zero, text, short }: what is known of the coils after the run; null while nothing is. */
export function restWords(store) {
  const { rest } = store;
  if (!rest) return null;
  const read = rest.amperes?.filter((value) => value !== null) ?? [];
  const most = read.reduce((largest, value) => Math.max(largest, Math.abs(value)), 0);
  const after = rest.after != null ? ` ${rest.after.toFixed(2)} s after STOP` : '';
  if (/NOT at zero/i.test(rest.text))
    return { zero: false, text: `The coils are not at zero: ${most.toFixed(2)} A. Switch them off by hand.`, detail: rest.text, short: `${most.toFixed(2)} A` };
  if (read.length === 0) return { zero: true, text: `Coils set to 0 A${after}.`, detail: rest.text, short: '0 A', how: 'coils, set; no read-back' };
  return { zero: true, text: `Coils ${most < 0.05 ? '0' : most.toFixed(2)} A, read back${after}.`, detail: rest.text,
           short: `${most < 0.05 ? '0' : most.toFixed(2)} A`, how: 'coils, read back' };
}

/** Alarms that are not dealt with, the worst first. */
export function openAlarms(store) {
  const rank = { high: 3, medium: 2, low: 1 };
  return (store.status.alarms ?? []).filter((alarm) => alarm.active || !alarm.acknowledged_by)
    .sort((a, b) => (a.acknowledged_by ? 1 : 0) - (b.acknowledged_by ? 1 : 0) || (rank[b.priority] ?? 0) - (rank[a.priority] ?? 0));
}

/** What a click would do now. */
export function invitationOf(store) {
  const { control, takes_targets: targets } = store.status;
  if (control === 'taken') return ['Another viewer steers.', 'You watch; STOP works from here.'];
  if (control !== 'mine') return ['You watch.', targets ? 'Take control to send the robot somewhere.' : 'STOP works from here.'];
  if (!targets) return ['You steer.', 'This protocol takes no targets from here.'];
  return ['You steer.', 'Click a place to send the robot there, or draw a path.'];
}

/** Lines of the log, those of one kind that follow within 2 s as one: a jog held down is not fifty lines. */
export function gathered(lines) {
  const groups = [];
  const shape = (text) => text.replace(/[-−]?\d+([.,]\d+)*( ?(nm|µm|mm|m))?/g, '#');
  for (const line of lines) {
    const last = groups[groups.length - 1];
    if (last && last.kind === line.kind && line.t - last.t <= 2 && shape(last.text) === shape(line.text)) {
      Object.assign(last, { t: line.t, text: line.text, times: last.times + 1 });
    } else {
      groups.push({ ...line, times: 1 });
    }
  }
  return groups;
}

/** Seconds of the experiment as a clock: "2 min 31 s", "41.3 s". */
export function clockText(seconds) {
  if (seconds < 60) return `${seconds.toFixed(1)} s`;
  const whole = Math.floor(seconds);
  const two = (n) => String(n).padStart(2, '0');
  return whole < 3600 ? `${Math.floor(whole / 60)} min ${two(whole % 60)} s` : `${Math.floor(whole / 3600)} h ${two(Math.floor((whole % 3600) / 60))} min`;
}

