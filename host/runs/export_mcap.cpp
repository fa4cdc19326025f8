// MCAP export, by the published specification (mcap.dev/spec, version 0): chunks without
// compression, each with its index.
// SPDX-License-Identifier: Apache-2.0
#include "host/files/digest.h"
#include "host/files/posix_file.h"
#include "host/record/record_json.h"
#include "host/runs/export.h"
#include "host/runs/run_reader.h"
#include "host/text/markup.h"

#include <fmt/format.h>
#include <opencv2/imgcodecs.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <stdexcept>
#include <utility>

namespace vitreo {
namespace {

constexpr std::string_view kMagic("\x89MCAP0\r\n", 8);

// Opcodes of the records.
constexpr unsigned char kHeader = 0x01;
constexpr unsigned char kFooter = 0x02;
constexpr unsigned char kSchema = 0x03;
constexpr unsigned char kChannel = 0x04;
constexpr unsigned char kMessage = 0x05;
constexpr unsigned char kChunk = 0x06;
constexpr unsigned char kMessageIndex = 0x07;
constexpr unsigned char kChunkIndex = 0x08;
constexpr unsigned char kStatistics = 0x0B;
constexpr unsigned char kDataEnd = 0x0F;

// A reader loads a chunk at a time: about 1 MiB, more only where a single image is larger.
constexpr std::size_t kChunkBytes = 1 << 20;

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
  Fields& text(const std::string& value) {
    add(static_cast<std::uint32_t>(value.size()));
    bytes_ += value;
    return *this;
  }
  Fields& rest(const std::string& value) {
    bytes_ += value;
    return *this;
  }
  const std::string& str() const { return bytes_; }

 private:
  std::string bytes_;
};

/// Opcode, length, fields.
/// The length has 64 bits and counts the fields alone.
std::string record(unsigned char kind, const Fields& fields) {
  Fields whole;
  whole.add(kind).add(std::uint64_t{fields.str().size()}).rest(fields.str());
  return whole.str();
}

// Writes one file front to back; only finish() makes it a file of that name. The summary at the end
// repeats schemas and channels and lists the chunks, so that a reader can seek without having read
// the data. Invariant: `size_` is the file's length and `crc_` the CRC-32 of all of it, as DataEnd
// wants them.
class McapFile {
 public:
  explicit McapFile(const std::filesystem::path& file)
      : file_(file), part_(file.string() + ".part") {
    std::error_code ignored;  // of an export that was broken off
    std::filesystem::remove(part_, ignored);
    descriptor_ = create_new_file(part_);
    put(std::string(kMagic));
    put(record(kHeader, Fields().text("").text("vitreo")));
  }
  ~McapFile() { close_file(descriptor_); }
  McapFile(const McapFile&) = delete;
  McapFile& operator=(const McapFile&) = delete;

  /// A schema and a channel of the same number, in the data and again in the summary.
  std::uint16_t channel(const std::string& topic, const std::string& schema,
                        const nlohmann::json& content) {
    // From 1: schema 0 means "none".
    const auto id = static_cast<std::uint16_t>(counts_.size() + 1);
    const std::string both =
        record(kSchema, Fields().add(id).text(schema).text("jsonschema").text(dumped(content))) +
        record(kChannel, Fields().add(id).add(id).text(topic).text("json").add(std::uint32_t{0}));
    put(both);
    summary_ += both;
    counts_[id] = 0;
    return id;
  }

  /// `time`: ns, as log time and as publish time.
  void message(std::uint16_t channel, std::uint64_t time, const std::string& data) {
    // The offset of a message is counted from the beginning of its chunk's records.
    const auto sequence = static_cast<std::uint32_t>(counts_[channel]++);
    index_[channel].emplace_back(time, chunk_.size());
    first_ = std::min(first_, time);
    last_ = std::max(last_, time);
    chunk_ += record(kMessage, Fields().add(channel).add(sequence).add(time).add(time).rest(data));
    if (chunk_.size() >= kChunkBytes) end_chunk();
  }

  /// Data end, summary section, footer. The summary's CRC covers the footer up to the CRC itself.
  void finish() {
    end_chunk();
    put(record(kDataEnd, Fields().add(crc_)));
    const std::uint64_t summary_at = size_;
    summary_ += chunk_indexes_ + statistics();
    Fields footer;  // no summary offset section: 0
    footer.add(summary_at).add(std::uint64_t{0});
    Fields begin;
    begin.add(kFooter).add(std::uint64_t{20}).rest(footer.str());
    const std::uint32_t crc =
        crc32(begin.str().data(), begin.str().size(), crc32(summary_.data(), summary_.size()));
    put(summary_ + begin.str() + Fields().add(crc).str() + std::string(kMagic));
    sync_file(descriptor_, part_);
    std::filesystem::rename(part_, file_);
  }

 private:
  void put(const std::string& bytes) {
    write_at(descriptor_, size_, bytes, part_);
    size_ += bytes.size();
    crc_ = crc32(bytes.data(), bytes.size(), crc_);
  }

  /// The chunk, its message indexes (offset of each message within the chunk, by channel), and its
  /// row in the summary.
  void end_chunk() {
    if (chunk_.empty()) return;
    const std::uint64_t begin = size_;
    // Fields: first and last log time, size and CRC-32 without compression, name of the compression
    // (empty: none), the records with their length in 64 bits.
    put(record(kChunk, Fields()
                           .add(first_)
                           .add(last_)
                           .add(std::uint64_t{chunk_.size()})
                           .add(crc32(chunk_.data(), chunk_.size()))
                           .text("")
                           .add(std::uint64_t{chunk_.size()})
                           .rest(chunk_)));
    const std::uint64_t length = size_ - begin;
    Fields offsets;
    for (const auto& [channel, entries] : index_) {
      offsets.add(channel).add(size_);
      Fields list;
      for (const auto& [time, offset] : entries) list.add(time).add(offset);
      put(record(kMessageIndex, Fields().add(channel).text(list.str())));
    }
    // Fields: first and last log time, place and length of the chunk, place of each channel's
    // message index, their length together, compression, size with and without it.
    chunk_indexes_ += record(kChunkIndex, Fields()
                                              .add(first_)
                                              .add(last_)
                                              .add(begin)
                                              .add(length)
                                              .text(offsets.str())
                                              .add(size_ - begin - length)
                                              .text("")
                                              .add(std::uint64_t{chunk_.size()})
                                              .add(std::uint64_t{chunk_.size()}));
    ++chunks_;
    run_first_ = std::min(run_first_, first_);
    run_last_ = std::max(run_last_, last_);
    chunk_.clear();
    index_.clear();
    first_ = std::numeric_limits<std::uint64_t>::max();
    last_ = 0;
  }

  // Fields: messages, schemas (16 bits), channels, attachments, metadata, chunks, first and last
  // log time, messages of each channel.
  std::string statistics() const {
    Fields per_channel;
    std::uint64_t all = 0;
    for (const auto& [channel, count] : counts_) {
      per_channel.add(channel).add(count);
      all += count;
    }
    const auto channels = static_cast<std::uint16_t>(counts_.size());
    return record(kStatistics, Fields()
                                   .add(all)
                                   .add(channels)
                                   .add(std::uint32_t{channels})
                                   .add(std::uint32_t{0})
                                   .add(std::uint32_t{0})
                                   .add(chunks_)
                                   .add(all > 0 ? run_first_ : 0)
                                   .add(run_last_)
                                   .text(per_channel.str()));
  }

  static constexpr std::uint64_t kNever = std::numeric_limits<std::uint64_t>::max();
  const std::filesystem::path file_;
  const std::filesystem::path part_;
  int descriptor_ = -1;
  std::uint64_t size_ = 0;
  std::uint32_t crc_ = 0;  // of all written so far
  std::uint32_t chunks_ = 0;
  std::string chunk_;
  std::string summary_;
  std::string chunk_indexes_;
  std::map<std::uint16_t, std::vector<std::pair<std::uint64_t, std::uint64_t>>> index_;
  std::map<std::uint16_t, std::uint64_t> counts_;
  // Least and greatest time of the chunk, and of the file.
  std::uint64_t first_ = kNever;
  std::uint64_t last_ = 0;
  std::uint64_t run_first_ = kNever;
  std::uint64_t run_last_ = 0;
};

/// ns, unsigned in MCAP: what lies before the run's beginning is at 0.
std::uint64_t log_time(Time time) {
  return static_cast<std::uint64_t>(std::max<std::int64_t>(0, time.count()));
}

// JSON Schema has no units: they are the descriptions. A value may be null, which stands for NaN.
nlohmann::json schema_of(const StreamInfo& info) {
  nlohmann::json properties = nlohmann::json::object();
  for (const Channel& channel : info.channels)
    properties[channel.name] = {{"type", {"number", "null"}}, {"description", channel.unit}};
  return {{"type", "object"},
          {"title", info.name},
          {"description", info.source},
          {"properties", properties}};
}

nlohmann::json event_schema() {
  const nlohmann::json text = {{"type", "string"}};
  return {{"type", "object"}, {"properties", {{"kind", text}, {"text", text}}}};
}

/// https://docs.foxglove.dev/docs/visualization/message-schemas/compressed-image
nlohmann::json image_schema() {
  const nlohmann::json integer = {{"type", "integer"}};
  const nlohmann::json text = {{"type", "string"}};
  return {{"type", "object"},
          {"title", "foxglove.CompressedImage"},
          {"properties",
           {{"timestamp",
             {{"type", "object"},
              {"title", "time"},
              {"properties", {{"sec", integer}, {"nsec", integer}}}}},
            {"frame_id", text},
            {"data", {{"type", "string"}, {"contentEncoding", "base64"}}},
            {"format", text}}}};
}

std::string sample_text(const Stream& stream, std::size_t row) {
  nlohmann::json json = nlohmann::json::object();
  for (std::size_t i = 0; i < stream.info.channels.size(); ++i) {
    const double value = stream.at(row, i);
    json[stream.info.channels[i].name] =
        std::isfinite(value) ? nlohmann::json(value) : nlohmann::json();
  }
  return dumped(json);
}

std::string image_text(const RunData& data, const FrameRow& row) {
  std::vector<unsigned char> png;
  // Lossless, as the record is. Level 1: a camera's noise hardly compresses better at the slower
  // ones.
  cv::imencode(".png", read_frame(data, row), png, {cv::IMWRITE_PNG_COMPRESSION, 1});
  const std::int64_t ns = row.exposed.count();
  return dumped({{"timestamp", {{"sec", ns / 1000000000}, {"nsec", ns % 1000000000}}},
                 {"frame_id", row.camera},
                 {"format", "png"},
                 {"data", base64(png)}});
}

/// One thing to write: all of them are sorted by time.
struct Item {
  std::uint64_t time;
  std::uint16_t channel;
  std::size_t kind;  // the stream's number, then events, then frames
  std::size_t row;
};

}  // namespace

Files export_mcap(const RunData& data, const std::filesystem::path& folder) {
  const std::filesystem::path path = folder / "run.mcap";
  McapFile file(path);
  // Only numbers are sorted: the texts, and above all the images, are made one by one when they are
  // written.
  std::vector<Item> items;
  const std::size_t events = data.streams.size();
  const std::size_t frames = events + 1;
  for (std::size_t i = 0; i < data.streams.size(); ++i) {
    const Stream& stream = data.streams[i];
    const std::uint16_t channel =
        file.channel("/" + stream.info.name, "vitreo." + stream.info.name, schema_of(stream.info));
    for (std::size_t row = 0; row < stream.times.size(); ++row)
      items.push_back({log_time(stream.times[row]), channel, i, row});
  }
  const std::uint16_t of_events = file.channel("/events", "vitreo.event", event_schema());
  for (std::size_t row = 0; row < data.events.size(); ++row)
    items.push_back({log_time(data.events[row].time), of_events, events, row});
  for (const RecordedCameraInfo& camera : data.cameras) {
    const std::uint16_t channel =
        file.channel("/" + camera.camera + "/image", "foxglove.CompressedImage", image_schema());
    for (std::size_t row = 0; row < data.frames.size(); ++row)
      if (data.frames[row].camera == camera.camera)
        items.push_back({log_time(data.frames[row].exposed), channel, frames, row});
  }
  // Stable: of one moment streams come before events, events before frames.
  std::stable_sort(items.begin(), items.end(),
                   [](const Item& a, const Item& b) { return a.time < b.time; });
  for (const Item& item : items) {
    if (item.kind < events)
      file.message(item.channel, item.time, sample_text(data.streams[item.kind], item.row));
    else if (item.kind == events)
      file.message(
          item.channel, item.time,
          dumped({{"kind", data.events[item.row].kind}, {"text", data.events[item.row].text}}));
    else
      file.message(item.channel, item.time, image_text(data, data.frames[item.row]));
  }
  file.finish();
  return {path};
}

}  // namespace vitreo
