// The connection to the run, and what came through it: one store that the parts of the page read.
const kHistory = 1200; // rows of a stream that are kept

export function createStore() {
  const listeners = new Set();
  const store = {
    connected: false,
    ended: null,
    hello: null,
    time: 0,
    status: {},
    rest: null, // what is known of the coils after they were made safe: { t, text, amperes: [..] or null, after: s since STOP or null }
    cameras: [],
    streams: {}, // name: { channels: {name: index}, rows: [[t, ...], ...] }
    lines: [],
    depth: null, // that was asked for here, m, until the loop has it
    note: '', // what was refused, or done, last
    noted: 0, // when, ms of performance.now()
    stopAsked: null, // s of the experiment; of the stop that goes on, or that ended the run
    lostAt: null, // when the connection was lost, ms of performance.now()
    where: null, // the newest answer to "where": { id, places: [[x, y, z] or null, ...] }
    report: null, // where the report is served after the end
    frames: {}, // slot: { number, time, width, height, bitmap, arrived, rate }
    say(note) {
      store.note = note;
      store.noted = performance.now();
    },
    listen(call) {
      listeners.add(call);
      return () => listeners.delete(call);
    },
    tell() {
      for (const call of listeners) call();
    },
  };
  return store;
}

/** The newest row of a stream as {channel: value}; null where there is none. */
export function newest(store, stream) {
  const held = store.streams[stream];
  if (!held || held.rows.length === 0) return null;
  return named(held, held.rows[held.rows.length - 1]);
}

const kFresh = 1.5; // s: a row that is older is not of now

/** The same where it is of now; null where nothing was told for a while, as when a loop has ended. Of a run that has ended: the last. */
export function present(store, stream) {
  const row = newest(store, stream);
  return row && (store.ended !== null || store.time - row.t <= kFresh) ? row : null;
}

export function named(held, row) {
  const values = { t: row[0] };
  for (const [name, index] of Object.entries(held.channels)) values[name] = row[index + 1];
  return values;
}

function take(store, message) {
  if (message.hello) store.hello = message.hello;
  if (message.ended !== undefined) store.ended = message.ended;
  if (message.time !== undefined) store.time = message.time;
  if (message.cameras) store.cameras = message.cameras;
  if (message.status) store.status = message.status;
  const stopping = /stop/.test(store.status.phase ?? '');
  if (stopping) store.stopAsked ??= store.time;
  if (message.where) store.where = { id: message.id, places: message.where };
  if (message.report) store.report = message.report;
  if (message.rest) {
    const after = store.stopAsked === null ? null : message.rest.t - store.stopAsked;
    store.rest = { ...message.rest, after: message.rest.t === store.rest?.t ? store.rest.after : after >= 0 ? after : null };
  }
  if (!stopping && store.ended === null) store.stopAsked = null; // a session goes on behind a stop
  for (const [name, part] of Object.entries(message.streams ?? {})) {
    const held = (store.streams[name] ??= { channels: {}, rows: [] });
    part.channels.forEach((channel, index) => (held.channels[channel] = index));
    held.rows.push(...part.rows);
    if (held.rows.length > kHistory) held.rows.splice(0, held.rows.length - kHistory);
  }
  for (const line of message.lines ?? []) { // a note comes twice: as an event and as what was said
    const twin = store.lines[store.lines.length - 1];
    if (line.kind !== 'checkpoint' && !(twin?.text === line.text && twin.t === line.t)) store.lines.push(line);
  }
  if (store.lines.length > 300) store.lines.splice(0, store.lines.length - 300);
  if (message.refused) {
    store.say(`refused: ${message.refused}`);
    store.depth = null;
  }
  if (message.target) store.say(`target ${message.target.map((v) => (Math.round(v * 1e5) / 100 + 0).toFixed(2)).join(', ')} mm`);
  if (message.invitation) store.say(message.invitation);
  if (message.done && message.done !== 'adjust') store.say(''); // readings of instruments come by themselves
}

async function takeFrame(store, buffer) {
  const view = new DataView(buffer);
  const frame = {
    slot: view.getUint32(0, true),
    number: view.getUint32(4, true),
    time: view.getFloat64(8, true),
    width: view.getUint32(16, true),
    height: view.getUint32(20, true),
  };
  frame.bitmap = await createImageBitmap(new Blob([buffer.slice(24)], { type: 'image/jpeg' }));
  const before = store.frames[frame.slot];
  frame.arrived = performance.now();
  const period = before ? (frame.time - before.time) / Math.max(1, frame.number - before.number) : null;
  frame.rate = period > 0 ? (before.rate ? 0.9 * before.rate + 0.1 / period : 1 / period) : null;
  before?.bitmap.close();
  store.frames[frame.slot] = frame;
  store.tell();
}

/** Connects, and again after a second whenever the connection is lost while the run goes on. */
export function connect(store) {
  const socket = new WebSocket(`ws://${location.host}/live`);
  socket.binaryType = 'arraybuffer';
  socket.onopen = () => {
    store.streams = {};
    store.lines = [];
  };
  socket.onmessage = (event) => {
    store.connected = true; // by what comes, not by a door that opens and shuts
    store.lostAt = null;
    if (typeof event.data !== 'string') return takeFrame(store, event.data);
    take(store, JSON.parse(event.data));
    store.tell();
  };
  socket.onclose = () => {
    store.connected = false;
    store.lostAt ??= performance.now();
    store.tell();
    if (store.ended === null) setTimeout(() => connect(store), 1000);
  };
  store.send = (message) => {
    if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
    else store.say('refused: not connected, nothing was sent');
  };
}
