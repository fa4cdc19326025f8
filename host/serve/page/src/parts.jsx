// Parts of several pages: outcomes, errors, pages of records, what was fetched.
// SPDX-License-Identifier: Apache-2.0
import { useEffect, useState } from 'preact/hooks';
import { get } from './api.js';
import { mark, tone } from './words.js';

export const Outcome = ({ outcome }) => (
  <span class={`outcome ${tone(outcome)}`}>
    <i aria-hidden="true">{mark(outcome)}</i>
    {outcome}
  </span>
);

export const Wrong = ({ text }) => (text ? <p class="wrong" role="alert">{text}</p> : null);

/** A page of a record: it has no right on ours (the server sends it sandboxed). */
export const Sheet = ({ address, title }) => (
  <iframe class="sheet" src={address} title={title} sandbox="allow-scripts allow-popups allow-downloads" />
);

/** [what a GET gives, its error, fetch again]; anew when the path or `key` changes. */
export function useFetched(path, key) {
  const [got, set] = useState({});
  const [again, setAgain] = useState(0);
  useEffect(() => {
    let wanted = true;
    get(path).then(
      (value) => wanted && set({ path, value }),
      (error) => wanted && set({ path, error: error.message }),
    );
    return () => {
      wanted = false;
    };
  }, [path, key, again]);
  return [got.path === path ? got.value : undefined, got.path === path ? got.error : undefined, () => setAgain(again + 1)];
}

/** An action of a button: [run, busy, error]. */
export function useAction(action) {
  const [busy, setBusy] = useState(false);
  const [error, setError] = useState('');
  const run = async (...words) => {
    setBusy(true);
    setError('');
    try {
      return await action(...words);
    } catch (problem) {
      setError(problem.message);
      return undefined;
    } finally {
      setBusy(false);
    }
  };
  return [run, busy, error];
}

/** State that this browser keeps. */
export function useKept(name, otherwise) {
  const [value, setValue] = useState(() => {
    try {
      return JSON.parse(localStorage.getItem(name)) ?? otherwise;
    } catch {
      return otherwise;
    }
  });
  const keep = (next) => {
    setValue(next);
    localStorage.setItem(name, JSON.stringify(next));
  };
  return [value, keep];
}
