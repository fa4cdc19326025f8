// Times, names and outcomes as people read them.
// SPDX-License-Identifier: Apache-2.0

const DAY = 86400;
const two = (number) => String(number).padStart(2, '0');

/** A Date of s since 1970, or of a record's "2026-11-24T18:21:03+0000". */
export const date = (time) =>
  typeof time === 'number' ? new Date(1000 * time) : new Date(time.replace(/([+-]\d\d)(\d\d)$/, '$1:$2'));

/** "today 14:28", "yesterday 16:02", "20 Nov 11:40". */
export function when(time) {
  if (!time) return '';
  const day = date(time);
  if (Number.isNaN(day.getTime())) return String(time);
  const clock = `${two(day.getHours())}:${two(day.getMinutes())}`;
  const midnight = new Date().setHours(0, 0, 0, 0);
  const days = Math.floor((midnight - new Date(day).setHours(0, 0, 0, 0)) / (1000 * DAY) + 0.5);
  if (days === 0) return `today ${clock}`;
  if (days === 1) return `yesterday ${clock}`;
  if (days === -1) return `tomorrow ${clock}`;
  const month = day.toLocaleString('en', { month: 'short' });
  return `${day.getDate()} ${month}${day.getFullYear() === new Date().getFullYear() ? '' : ` ${day.getFullYear()}`} ${clock}`;
}

/** "2 min 31 s". */
export function duration(seconds) {
  if (!(seconds >= 0)) return '';
  if (seconds < 10) return `${seconds.toFixed(1)} s`;
  const whole = Math.round(seconds);
  if (whole < 60) return `${whole} s`;
  if (whole < 3600) return `${Math.floor(whole / 60)} min ${two(whole % 60)} s`;
  return `${Math.floor(whole / 3600)} h ${two(Math.floor((whole % 3600) / 60))} min`;
}

/** "servo_square": "Servo square". */
export function label(name) {
  const text = name.replace(/_/g, ' ');
  return text.charAt(0).toUpperCase() + text.slice(1);
}

/** "servo_square speed=1mm/s" without the protocol: what differs from the defaults. */
export const changed = (request) => request.arguments.map((word) => word.replace('=', ' ')).join(', ') || 'defaults';

export const bytes = (count) =>
  count > 1e9 ? `${(count / 1e9).toFixed(1)} GB` : count > 1e6 ? `${(count / 1e6).toFixed(1)} MB` : `${Math.ceil(count / 1e3)} kB`;

const MARKS = { completed: '✓', stopped: '■', running: '●', waiting: '·' };
export const mark = (outcome) => MARKS[outcome] ?? '✕';
export const tone = (outcome) =>
  outcome === 'completed' ? 'good' : outcome === 'stopped' || outcome === 'waiting' ? 'calm' : outcome === 'running' ? 'busy' : 'bad';
