// What the reference reader of MCAP and the reference schemas say of a file, as JSON:
//   node mcap_check.mjs FILE
// SPDX-License-Identifier: Apache-2.0
import { open, readFile } from "node:fs/promises";
import { McapIndexedReader, McapStreamReader } from "@mcap/core";
import { judge, schema_faults } from "./schemas.mjs";

const text = new TextDecoder();

class File {
  constructor(handle) {
    this.handle = handle;
  }
  async size() {
    return BigInt((await this.handle.stat()).size);
  }
  async read(offset, length) {
    const buffer = Buffer.alloc(Number(length));
    await this.handle.read(buffer, 0, Number(length), Number(offset));
    return new Uint8Array(buffer.buffer, buffer.byteOffset, buffer.length);
  }
}

const seconds = (ns) => Number(ns) / 1e9;

/** By the index, in the order of time, as a player reads. */
async function indexed(handle) {
  const reader = await McapIndexedReader.Initialize({ readable: new File(handle) });
  const topics = {};
  const judges = new Map();
  for (const channel of reader.channelsById.values()) {
    const schema = reader.schemasById.get(channel.schemaId);
    const content = JSON.parse(text.decode(schema.data));
    topics[channel.topic] = {
      schema: schema.name,
      encodings: [schema.encoding, channel.messageEncoding],
      faults: schema_faults(schema.name, content),
      content: schema.name.startsWith("foxglove.") ? undefined : content,
      count: 0,
      invalid: [],
      stamp_off: 0,
    };
    judges.set(channel.id, judge(schema.name, content));
  }
  for await (const message of reader.readMessages({ validateCrcs: true })) {
    const channel = reader.channelsById.get(message.channelId);
    const topic = topics[channel.topic];
    const content = JSON.parse(text.decode(message.data));
    const wrong = judges.get(channel.id)(content);
    if (wrong && topic.invalid.length < 3) topic.invalid.push(wrong);
    if (content.timestamp) {
      const stamp = BigInt(content.timestamp.sec) * 1000000000n + BigInt(content.timestamp.nsec);
      topic.stamp_off = Math.max(topic.stamp_off, Math.abs(Number(stamp - message.logTime)));
    }
    topic.first ??= { time: seconds(message.logTime), content: brief(content) };
    topic.last = { time: seconds(message.logTime), content: brief(content) };
    if (content.format === "png" && topic.count === 0)
      topic.magic = Buffer.from(content.data, "base64").subarray(0, 8).toString("hex");
    ++topic.count;
  }
  const metadata = {};
  for await (const one of reader.readMetadata()) metadata[one.name] = Object.fromEntries(one.metadata);
  const attachments = {};
  for await (const one of reader.readAttachments())
    attachments[one.name] = { type: one.mediaType, bytes: one.data.byteLength };
  const s = reader.statistics;
  return {
    topics,
    metadata,
    attachments,
    chunks: reader.chunkIndexes.length,
    statistics: {
      messages: Number(s.messageCount),
      channels: s.channelCount,
      schemas: s.schemaCount,
      chunks: s.chunkCount,
      metadata: s.metadataCount,
      attachments: s.attachmentCount,
      first: seconds(s.messageStartTime),
      last: seconds(s.messageEndTime),
    },
  };
}

/** Without long texts. */
function brief(content) {
  return JSON.parse(
    JSON.stringify(content, (key, value) =>
      typeof value === "string" && value.length > 200 ? `${value.length} letters` : value,
    ),
  );
}

/** Front to back, as a pipe reads; every CRC is checked. */
async function streamed(path) {
  const reader = new McapStreamReader({ validateCrcs: true });
  reader.append(await readFile(path));
  let messages = 0;
  for (let record; (record = reader.nextRecord()); ) if (record.type === "Message") ++messages;
  return { messages, whole: reader.done() };
}

const path = process.argv[2];
const handle = await open(path);
const found = await indexed(handle);
if ((await handle.stat()).size < 1 << 30) found.streamed = await streamed(path);
await handle.close();
console.log(JSON.stringify(found));
