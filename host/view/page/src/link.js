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
    rest: null, // what is known of the coils after they were made safe: { t, text, amperes: [..] or null }
    cameras: [],
    streams: {}, // name: { channels: {name: index}, rows: [[t, ...], ...] }
    lines: [],
    depth: null, // that was asked for here, m, until the loop has it
    note: '', // what was refused, or done, last
    frames: {}, // slot: { number, time, width, height, bitmap }
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
  if (message.rest) store.rest = message.rest;
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
    store.note = `refused: ${message.refused}`;
    store.depth = null;
  }
  if (message.target) store.note = `target ${message.target.map((v) => (Math.round(v * 1e5) / 100 + 0).toFixed(2)).join(', ')} mm`;
  if (message.invitation) store.note = message.invitation;
  if (message.done) store.note = '';
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
  store.frames[frame.slot]?.bitmap.close();
  store.frames[frame.slot] = frame;
  store.tell();
}

/** Connects, and again after a second whenever the connection is lost while the run goes on. */
export function connect(store) {
  const socket = new WebSocket(`ws://${location.host}/live`);
  socket.binaryType = 'arraybuffer';
  socket.onopen = () => {
    store.connected = true;
    store.streams = {};
    store.lines = [];
    store.tell();
  };
  socket.onmessage = (event) => {
    if (typeof event.data !== 'string') return takeFrame(store, event.data);
    take(store, JSON.parse(event.data));
    store.tell();
  };
  socket.onclose = () => {
    store.connected = false;
    store.tell();
    if (store.ended === null) setTimeout(() => connect(store), 1000);
  };
  store.send = (message) => {
    if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
    else store.note = 'not connected: nothing was sent';
  };
}
