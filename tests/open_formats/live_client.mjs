// The reference client of the Foxglove WebSocket protocol at a run that goes on, as JSON:
//   node live_client.mjs ADDRESS watch SECONDS [SUBPROTOCOL]   subscribes to everything
//   node live_client.mjs ADDRESS slow SECONDS                  subscribes to everything, reads nothing
//   node live_client.mjs ADDRESS strangers                     tries to get in without being admitted
// SPDX-License-Identifier: Apache-2.0
import http from "node:http";
import protocol from "@foxglove/ws-protocol";
import WebSocket from "ws";
import { judge, schema_faults } from "./schemas.mjs";

const { FoxgloveClient } = protocol;
const text = new TextDecoder();
const [address, task, argument, wish] = process.argv.slice(2);
const pause = (seconds) => new Promise((done) => setTimeout(done, seconds * 1000));

async function watch(seconds, subprotocol) {
  const socket = new WebSocket(address, [subprotocol]);
  const client = new FoxgloveClient({ ws: socket });
  const seen = { topics: {}, statuses: [], times: [], infos: [], opened: false };
  const by_subscription = new Map();
  client.on("open", () => {
    seen.opened = true;
    seen.subprotocol = socket.protocol;
  });
  client.on("error", (error) => (seen.error = String(error)));
  client.on("serverInfo", (info) => seen.infos.push(info));
  client.on("status", (status) => seen.statuses.push(status));
  client.on("time", (time) => seen.times.push(Number(time.timestamp)));
  client.on("advertise", (channels) => {
    for (const channel of channels) {
      const schema = JSON.parse(channel.schema);
      const topic = (seen.topics[channel.topic] = {
        schema: channel.schemaName,
        encodings: [channel.schemaEncoding, channel.encoding],
        faults: schema_faults(channel.schemaName, schema),
        content: channel.schemaName.startsWith("foxglove.") ? undefined : schema,
        count: 0,
        invalid: [],
        backwards: 0,
        messages: [],
      });
      by_subscription.set(client.subscribe(channel.id), {
        topic,
        check: judge(channel.schemaName, schema),
      });
    }
  });
  client.on("message", ({ subscriptionId, timestamp, data }) => {
    const { topic, check } = by_subscription.get(subscriptionId);
    const content = JSON.parse(text.decode(data));
    const wrong = check(content);
    if (wrong && topic.invalid.length < 3) topic.invalid.push(wrong);
    const time = Number(timestamp) / 1e9;
    if (topic.last_time > time) ++topic.backwards;
    topic.first_time ??= time;
    topic.last_time = time;
    if (topic.count++ < 3) topic.messages.push(content.data ? { ...content, data: "" } : content);
    if (content.data) topic.magic = Buffer.from(content.data, "base64").subarray(0, 3).toString("hex");
  });
  let closed = false;
  client.on("close", () => (closed = true));
  await pause(seconds / 2);
  // What would change something is refused.
  if (!closed) client.advertise({ topic: "/target", encoding: "json", schemaName: "x" });
  if (!closed) client.setParameters([{ name: "speed", value: 1 }], "x");
  for (let i = 0; i < seconds * 5 && !closed; ++i) await pause(0.1);
  seen.closed = closed;
  if (!closed) client.close();
  return seen;
}

/** Its socket is never read, so that the system's buffers fill and stay full. */
async function slow(seconds) {
  const socket = new WebSocket(address, ["foxglove.websocket.v1"]);
  await new Promise((done, failed) => socket.on("open", done).on("error", failed));
  for (let id = 1; id <= 12; ++id)
    socket.send(JSON.stringify({ op: "subscribe", subscriptions: [{ id, channelId: id }] }));
  await pause(0.3);
  socket._socket.pause();
  await pause(seconds);
  socket.terminate();
  return { slow: true };
}

/** The HTTP status that an attempt ends with; 101: it was let in. */
function attempt(url, subprotocols, headers = {}) {
  return new Promise((done) => {
    const socket = new WebSocket(url, subprotocols, { headers });
    socket.on("unexpected-response", (_, response) => done(response.statusCode));
    socket.on("open", () => (socket.close(), done(101)));
    socket.on("error", () => done(-1));
  });
}

async function strangers() {
  const plain = address.replace(/\?.*/, "");
  const get = await new Promise((done) =>
    http.get(address.replace("ws:", "http:"), (response) => done(response.statusCode)),
  );
  const name = ["foxglove.websocket.v1"];
  return {
    without_token: await attempt(plain, name),
    wrong_token: await attempt(`${plain}?token=${"0".repeat(32)}`, name),
    token_of_another_length: await attempt(`${address}0`, name),
    other_subprotocol: await attempt(address, ["chat"]),
    rebound_name: await attempt(address, name, { Host: "evil.example:8765" }),
    page_of_another_site: await attempt(plain, name, { Origin: "https://evil.example" }),
    plain_get: get,
    admitted: await attempt(address, name),
    admitted_by_the_later_name: await attempt(address, ["foxglove.sdk.v1"]),
  };
}

const tasks = {
  watch: () => watch(Number(argument), wish ?? "foxglove.websocket.v1"),
  slow: () => slow(Number(argument)),
  strangers,
};
console.log(JSON.stringify(await tasks[task]()));
process.exit(0);
