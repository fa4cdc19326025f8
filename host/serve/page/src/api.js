// The server: requests to its REST interface, and its state, which it sends at each change.
// SPDX-License-Identifier: Apache-2.0

/** The answer's JSON; throws an Error with the server's own words. */
export async function call(method, path, body) {
  let response;
  try {
    response = await fetch(path, {
      method,
      headers: body === undefined ? {} : { 'Content-Type': 'application/json' },
      body: body === undefined ? undefined : JSON.stringify(body),
    });
  } catch {
    throw new Error('The workbench does not answer: is it still running?');
  }
  const answer = await response.json().catch(() => ({}));
  if (!response.ok) throw new Error(answer.error ?? `the workbench answered ${response.status}`);
  return answer;
}

export const get = (path) => call('GET', path);
export const post = (path, body) => call('POST', path, body);

/** Calls back with each state, and with null when the connection is gone; tries again for ever. */
export function follow(take) {
  const open = () => {
    const socket = new WebSocket(`ws://${location.host}/live`);
    socket.onmessage = (event) => {
      const { state } = JSON.parse(event.data);
      if (state) take(state);
    };
    socket.onclose = () => {
      take(null);
      setTimeout(open, 500);
    };
  };
  open();
}
