// SPDX-License-Identifier: Apache-2.0
#include "host/files/mcap_file.h"

#include "host/files/digest.h"
#include "host/files/posix_file.h"

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <utility>
#include <vector>

namespace vitreo {
namespace {

constexpr std::string_view kMcapMagic("\x89MCAP0\r\n", 8);

// Opcodes of the records.
enum Opcode : unsigned char {
  kHeader = 0x01,
  kFooter = 0x02,
  kSchema = 0x03,
  kChannel = 0x04,
  kMessage = 0x05,
  kChunk = 0x06,
  kMessageIndex = 0x07,
  kChunkIndex = 0x08,
  kAttachment = 0x09,
  kAttachmentIndex = 0x0A,
  kStatistics = 0x0B,
  kMetadata = 0x0C,
  kMetadataIndex = 0x0D,
  kSummaryOffset = 0x0E,
  kDataEnd = 0x0F,
};

// A reader loads a chunk at a time: about 1 MiB, more only where a single image is larger.
constexpr std::size_t kChunkBytes = 1 << 20;
constexpr std::uint64_t kNever = std::numeric_limits<std::uint64_t>::max();

/// The fields of a record: little-endian numbers, length-prefixed texts.
class Fields {
 public:
  template <class Number>
  Fields& add(Number value) {
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof value);
    return *this;
  }
  // A string, and likewise an array or a map: the specification prefixes all of them with their
  // length in bytes, 32 bits.
  Fields& text(std::string_view value) {
    add(static_cast<std::uint32_t>(value.size()));
    bytes_ += value;
    return *this;
  }
  const std::string& str() const { return bytes_; }

 private:
  std::string bytes_;
};

/// Opcode and length: what stands before the fields. The length counts these alone.
std::string head(Opcode kind, std::uint64_t length) {
  return Fields().add(static_cast<unsigned char>(kind)).add(length).str();
}
std::string record(Opcode kind, const Fields& fields) {
  return head(kind, fields.str().size()) + fields.str();
}

/// First and last log time, and how many messages there are between them.
struct Span {
  std::uint64_t first = kNever;
  std::uint64_t last = 0;
  void take(std::uint64_t time) {
    first = std::min(first, time);
    last = std::max(last, time);
  }
};

}  // namespace

// The summary at the end repeats schemas and channels and lists chunks, attachments and metadata,
// so that a reader can seek without having read the data. Invariant: `size` is the file's length
// and `crc` the CRC-32 of all of it, as DataEnd wants them.
struct McapFile::State {
  explicit State(const std::filesystem::path& path)
      : file(path), descriptor(create_new_file(path)) {}
  const std::filesystem::path file;
  const Descriptor descriptor;
  std::uint64_t size = 0;
  std::uint32_t crc = 0;
  std::string chunk;  // the messages of the chunk that grows
  Span chunk_span;
  Span file_span;
  std::map<Opcode, std::string> summary;  // its records, grouped by opcode as it must have them
  std::uint32_t chunks = 0;
  std::uint32_t attachments = 0;
  std::uint32_t metadata = 0;
  std::map<std::pair<std::string, std::string>, std::uint16_t> schemas;
  // By channel: time and offset of each message in the chunk, messages in the file.
  std::map<std::uint16_t, std::vector<std::pair<std::uint64_t, std::uint64_t>>> offsets;
  std::map<std::uint16_t, std::uint64_t> counts;

  void put(std::string_view bytes) {
    write_at(descriptor.number(), size, bytes, file);
    size += bytes.size();
    crc = crc32(bytes.data(), bytes.size(), crc);
  }
  std::uint16_t schema(const std::string& name, const std::string& text);
  void end_chunk();
  std::string statistics() const;
};

McapFile::McapFile(const std::filesystem::path& file) : state_(std::make_unique<State>(file)) {
  state_->put(kMcapMagic);
  // No profile: neither ROS 1 nor ROS 2. The library is the program.
  state_->put(record(kHeader, Fields().text("").text("vitreo")));
}
McapFile::~McapFile() = default;

// From 1: schema 0 means "none".
std::uint16_t McapFile::State::schema(const std::string& name, const std::string& text) {
  const auto id = static_cast<std::uint16_t>(schemas.size() + 1);
  const auto [entry, is_new] = schemas.try_emplace({name, text}, id);
  if (is_new) {
    const std::string whole =
        record(kSchema, Fields().add(id).text(name).text("jsonschema").text(text));
    put(whole);
    // Once more in the summary, as a reader that seeks has not read this one.
    summary[kSchema] += whole;
  }
  return entry->second;
}

std::uint16_t McapFile::add_channel(const std::string& topic, const std::string& schema_name,
                                    const std::string& schema) {
  const std::uint16_t shape = state_->schema(schema_name, schema);
  const auto id = static_cast<std::uint16_t>(state_->counts.size());
  // The last field is the channel's own metadata: none.
  const std::string whole =
      record(kChannel, Fields().add(id).add(shape).text(topic).text("json").add(std::uint32_t{0}));
  state_->put(whole);
  state_->summary[kChannel] += whole;
  state_->counts[id] = 0;
  return id;
}

// Appended in parts: a message may be an image of megabytes, which is copied once.
void McapFile::message(std::uint16_t channel, std::uint64_t time, std::string_view data) {
  // The offset of a message is counted from the beginning of its chunk's records.
  const auto sequence = static_cast<std::uint32_t>(state_->counts[channel]++);
  state_->offsets[channel].emplace_back(time, state_->chunk.size());
  state_->chunk_span.take(time);
  const Fields fields = Fields().add(channel).add(sequence).add(time).add(time);
  state_->chunk += head(kMessage, fields.str().size() + data.size());
  state_->chunk += fields.str();
  state_->chunk += data;
  if (state_->chunk.size() >= kChunkBytes) state_->end_chunk();
}

/// The chunk, its message indexes (offset of each message within the chunk, by channel), and its
/// row in the summary.
void McapFile::State::end_chunk() {
  if (chunk.empty()) return;
  const std::uint64_t begin = size;
  // Fields: first and last log time, size and CRC-32 without compression, name of the compression
  // (empty: none), the records with their length in 64 bits.
  const Fields fields = Fields()
                            .add(chunk_span.first)
                            .add(chunk_span.last)
                            .add(std::uint64_t{chunk.size()})
                            .add(crc32(chunk.data(), chunk.size()))
                            .text("")
                            .add(std::uint64_t{chunk.size()});
  put(head(kChunk, fields.str().size() + chunk.size()) + fields.str());
  put(chunk);
  const std::uint64_t length = size - begin;
  Fields places;
  for (const auto& [channel, entries] : offsets) {
    places.add(channel).add(size);
    Fields list;
    for (const auto& [time, offset] : entries) list.add(time).add(offset);
    put(record(kMessageIndex, Fields().add(channel).text(list.str())));
  }
  // Fields: first and last log time, place and length of the chunk, place of each channel's
  // message index, their length together, compression, size with and without it.
  summary[kChunkIndex] += record(kChunkIndex, Fields()
                                                  .add(chunk_span.first)
                                                  .add(chunk_span.last)
                                                  .add(begin)
                                                  .add(length)
                                                  .text(places.str())
                                                  .add(size - begin - length)
                                                  .text("")
                                                  .add(std::uint64_t{chunk.size()})
                                                  .add(std::uint64_t{chunk.size()}));
  ++chunks;
  file_span.take(chunk_span.first);
  file_span.take(chunk_span.last);
  chunk.clear();
  offsets.clear();
  chunk_span = {};
}

// Index fields: place and length of the record, name.
void McapFile::metadata(const std::string& name, const std::map<std::string, std::string>& values) {
  state_->end_chunk();
  Fields map;
  for (const auto& [key, value] : values) map.text(key).text(value);
  const std::string whole = record(kMetadata, Fields().text(name).text(map.str()));
  state_->summary[kMetadataIndex] += record(
      kMetadataIndex, Fields().add(state_->size).add(std::uint64_t{whole.size()}).text(name));
  state_->put(whole);
  ++state_->metadata;
}

// Fields: log time, time of creation, name, media type, the bytes with their length in 64 bits,
// CRC-32 of all fields before it. Index fields: place and length of the record, both times, length
// of the bytes, name, media type.
void McapFile::attachment(const std::string& name, const std::string& media_type,
                          std::uint64_t time, std::string_view bytes) {
  state_->end_chunk();
  Fields before;
  before.add(time).add(time).text(name).text(media_type).add(std::uint64_t{bytes.size()});
  const std::uint32_t crc =
      crc32(bytes.data(), bytes.size(), crc32(before.str().data(), before.str().size()));
  const std::uint64_t begin = state_->size;
  state_->put(head(kAttachment, before.str().size() + bytes.size() + sizeof crc) + before.str());
  state_->put(bytes);
  state_->put(Fields().add(crc).str());
  state_->summary[kAttachmentIndex] +=
      record(kAttachmentIndex, Fields()
                                   .add(begin)
                                   .add(state_->size - begin)
                                   .add(time)
                                   .add(time)
                                   .add(std::uint64_t{bytes.size()})
                                   .text(name)
                                   .text(media_type));
  ++state_->attachments;
}

// Fields: messages, schemas (16 bits), channels, attachments, metadata, chunks, first and last log
// time, messages of each channel.
std::string McapFile::State::statistics() const {
  Fields per_channel;
  std::uint64_t all = 0;
  for (const auto& [channel, count] : counts) {
    per_channel.add(channel).add(count);
    all += count;
  }
  return record(kStatistics, Fields()
                                 .add(all)
                                 .add(static_cast<std::uint16_t>(schemas.size()))
                                 .add(static_cast<std::uint32_t>(counts.size()))
                                 .add(attachments)
                                 .add(metadata)
                                 .add(chunks)
                                 .add(all > 0 ? file_span.first : 0)
                                 .add(file_span.last)
                                 .text(per_channel.str()));
}

// Each group of the summary has its place in the offsets behind it. The CRC is that of the summary,
// its offsets and the footer up to the CRC itself.
void McapFile::finish() {
  State& state = *state_;
  state.end_chunk();
  state.put(record(kDataEnd, Fields().add(state.crc)));
  state.summary[kStatistics] = state.statistics();
  const std::uint64_t summary_at = state.size;
  std::string whole;
  std::string offsets;
  for (const auto& [kind, records] : state.summary) {
    offsets += record(kSummaryOffset, Fields()
                                          .add(static_cast<unsigned char>(kind))
                                          .add(summary_at + whole.size())
                                          .add(std::uint64_t{records.size()}));
    whole += records;
  }
  const std::uint64_t offsets_at = summary_at + whole.size();
  whole += offsets + head(kFooter, 20) + Fields().add(summary_at).add(offsets_at).str();
  state.put(whole + Fields().add(crc32(whole.data(), whole.size())).str());
  // Only now is it an MCAP file: readers look for the magic at both ends.
  state.put(kMcapMagic);
}

}  // namespace vitreo
