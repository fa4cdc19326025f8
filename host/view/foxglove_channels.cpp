// SPDX-License-Identifier: Apache-2.0
#include "host/view/foxglove_channels.h"

#include <algorithm>
#include <utility>

namespace vitreo::view {
namespace {

using nlohmann::json;

// A turn comes each 10 ms, so only a stream of more than 100 kHz would lose rows by it.
constexpr std::size_t kMostNewRows = 1000;  // of a stream in one turn
constexpr const char* kSceneTopic = "/scene";

}  // namespace

// Three topics are there from the begin: a layout can be made before the first row comes.
FoxgloveChannels::FoxgloveChannels(const Board& board, const RunTopics& topics)
    : board_(board), topics_(topics) {
  // A client that comes later asks for all().
  json ignored = json::array();
  add({RunTopics::log()}, ignored);
  add({RunTopics::transforms()}, ignored);
  add({RunTopics::scene()}, ignored);
}

std::size_t FoxgloveChannels::add(LiveChannel channel, json& added) {
  channels_.push_back(std::move(channel));
  added.push_back(described(channels_.size() - 1));
  return channels_.size() - 1;
}

// Numbers of channels begin at 1; "schema" is a text, also where it is JSON.
json FoxgloveChannels::described(std::size_t channel) const {
  const Topic& topic = channels_[channel].topic;
  return {{"id", channel + 1},
          {"topic", topic.name},
          {"encoding", "json"},
          {"schemaName", topic.schema_name},
          {"schemaEncoding", "jsonschema"},
          {"schema", json_text(topic.schema)}};
}

json FoxgloveChannels::all() const {
  json list = json::array();
  for (std::size_t i = 0; i < channels_.size(); ++i) list.push_back(described(i));
  return list;
}

/// No channel is taken away while the run goes on: its number is its place for good.
json FoxgloveChannels::discover() {
  json added = json::array();
  for (const StreamInfo& stream : board_.streams()) {
    if (std::any_of(streams_.begin(), streams_.end(),
                    [&](const Progress& known) { return known.stream == stream.name; }))
      continue;
    streams_.push_back({stream.name});
    for (RowTopic& one : topics_.of_stream(stream)) {
      // The scene is one channel, which rows of the servo move: it is there already.
      const auto known =
          std::find_if(channels_.begin(), channels_.end(),
                       [&](const LiveChannel& c) { return c.topic.name == one.topic.name; });
      if (known == channels_.end()) {
        add({std::move(one.topic), stream.name, std::move(one.message)}, added);
      } else {
        known->stream = stream.name;
        known->message = std::move(one.message);
      }
    }
  }
  for (const std::string& camera : board_.cameras()) {
    if (std::any_of(channels_.begin(), channels_.end(),
                    [&](const LiveChannel& known) { return known.camera == camera; }))
      continue;
    // Live pictures have 8 bits, whatever the record has.
    add({RunTopics::image(camera, false), "", {}, camera}, added);
  }
  return added;
}

std::optional<ChannelMessage> FoxgloveChannels::of_row(const LiveChannel& channel,
                                                       const Sample& row) const {
  auto text = channel.message(row.time, row.values);
  if (!text) return {};
  return ChannelMessage{topics_.clock().ns(row.time), std::move(*text)};
}

ChannelMessage FoxgloveChannels::of_line(const Line& line) const {
  const Time time = from_seconds(line.time);
  return {topics_.clock().ns(time), topics_.log_message(time, line.kind, line.text)};
}

std::vector<ChannelMessage> FoxgloveChannels::first(std::size_t number) const {
  const LiveChannel& channel = channels_.at(number);
  const Time now = board_.now();
  std::vector<ChannelMessage> messages;
  if (channel.topic.name == "/log")
    // Up to what news() has sent: the rest is still to come from there.
    for (const Line& line : board_.lines(0))
      if (line.number <= last_line_) messages.push_back(of_line(line));
  // Stamped with the present, where a client looks that joins late.
  if (channel.topic.name == "/tf")
    messages.push_back({topics_.clock().ns(now), topics_.transforms_message(now)});
  if (channel.topic.name == kSceneTopic)
    if (auto text = topics_.scene_message(now))
      messages.push_back({topics_.clock().ns(now), std::move(*text)});
  if (channel.message)
    for (const Sample& row : board_.samples(channel.stream, {}, 1))
      if (auto message = of_row(channel, row)) messages.push_back(std::move(*message));
  return messages;
}

void FoxgloveChannels::news(const std::function<bool(std::size_t)>& wanted, const Send& send) {
  for (Progress& stream : streams_) {
    const std::vector<Sample> rows = board_.samples(stream.stream, stream.last, kMostNewRows);
    if (rows.empty()) continue;
    // Also of a stream without a subscription: a client that joins later begins with the newest
    // row.
    stream.last = rows.back().time;
    for (std::size_t i = 0; i < channels_.size(); ++i) {
      if (!channels_[i].message || channels_[i].stream != stream.stream || !wanted(i)) continue;
      for (const Sample& row : rows)
        if (const auto message = of_row(channels_[i], row)) send(i, *message);
    }
  }
  // The constructor adds it first.
  constexpr std::size_t kLog = 0;
  const bool reads_log = wanted(kLog);
  for (const Line& line : board_.lines(last_line_)) {
    last_line_ = line.number;
    if (reads_log) send(kLog, of_line(line));
  }
}

bool FoxgloveChannels::is_picture(std::size_t channel) const {
  return !channels_.at(channel).camera.empty();
}

std::optional<ChannelMessage> FoxgloveChannels::picture(std::size_t channel,
                                                        std::optional<std::uint64_t>& after) const {
  const std::string& camera = channels_.at(channel).camera;
  const std::optional<Frame> frame = board_.frame(camera, after);
  if (!frame) return {};
  auto& [number, message] = pictures_[camera];
  // Of the same frame: encoded for another client already.
  if (message.text.empty() || number != frame->number) {
    number = frame->number;
    message = {topics_.clock().ns(frame->exposed),
               topics_.image_message(camera, frame->exposed, frame->image, ImageCoding::jpeg)};
  }
  after = frame->number;
  return message;
}

}  // namespace vitreo::view
