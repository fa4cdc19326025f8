// The retina held still: the similarity that takes a frame's pixels to those of the frame in which the retina was taken hold of,
// by the stream `retina` (each frame's place on a map of the retina).
// SPDX-License-Identifier: Apache-2.0
import { named } from './link.js';

const kSame = 1e-4; // s: exposures of one frame
const kGap = 0.3; // s for which a place is carried on: a frame comes before its place on the map
const kLook = 600; // rows that are looked through: the trail's ten seconds at 60 frames/s

/** (u, v) -> (a u - b v + x, b u + a v + y). */
export const apply = ({ a, b, x, y }, [u, v]) => [a * u - b * v + x, b * u + a * v + y];

export function inverse({ a, b, x, y }) {
  const n = a * a + b * b;
  return { a: a / n, b: -b / n, x: -(a * x + b * y) / n, y: (b * x - a * y) / n };
}

/** `first`, then `second`. */
function compose(second, first) {
  const [x, y] = apply(second, [first.x, first.y]);
  return { a: second.a * first.a - second.b * first.b, b: second.a * first.b + second.b * first.a, x, y };
}

const poseOf = (row) => ({ a: row.scale * Math.cos(row.angle), b: row.scale * Math.sin(row.angle), x: row.x_px, y: row.y_px });

/** Places of the newest frames on the map, the newest first; those that were not found are left out. */
function places(store) {
  const held = store.streams.retina;
  if (!held || held.channels.scale === undefined) return [];
  const rows = held.rows.slice(-kLook).map((row) => named(held, row)).filter((row) => row.scale > 0 && row.x_px !== null);
  return rows.reverse().map((row) => ({ time: row.exposed ?? row.t, pose: poseOf(row) }));
}

/** The map's place of the frame of `time`; of the nearest one where it is not there yet, null where that is long ago. */
function placeAt(all, time) {
  let best = null;
  for (const one of all) {
    const away = Math.abs(one.time - time);
    if (away < kSame) return one.pose;
    if (away < kGap && (!best || away < Math.abs(best.time - time))) best = one;
    if (one.time < time - kGap) break;
  }
  return best?.pose ?? null;
}

/** What holds the retina where `reference` (map from pixels) had it: at(time) is the similarity of a frame, null where the retina
    was not found then. Without a reference the frame of `time` is one. */
export function holding(store, time, reference) {
  const all = places(store), now = placeAt(all, time), hold = reference ?? now;
  if (!hold) return { reference: null, at: () => null };
  const back = inverse(hold);
  return { reference: hold, at: (when) => { const place = placeAt(all, when); return place && compose(back, place); } };
}

export const known = (store) => (store.streams.retina?.rows.length ?? 0) > 0;
