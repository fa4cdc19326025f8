// Foxglove channels: the topics of a running run with their numbers, and what is new of each since
// it was last asked for.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/channels/run_topics.h"
#include "host/view/board.h"

#include <nlohmann/json.hpp>

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace vitreo::view {

/// One message: JSON text, and ns since 1970.
struct ChannelMessage {
  std::uint64_t time = 0;
  std::string text;
};

/// Reads the board, whose run never waits for it. Used by one thread.
class FoxgloveChannels {
 public:
  FoxgloveChannels(const Board& board, const RunTopics& topics);

  /// Makes the channels of the streams and cameras that have appeared; the list of those, as the
  /// protocol's "advertise" has it.
  nlohmann::json discover();
  nlohmann::json all() const;
  std::size_t count() const { return channels_.size(); }

  /// What a client gets first that has just subscribed: the newest row, all that is kept of the
  /// log, what stands still.
  std::vector<ChannelMessage> first(std::size_t channel) const;
  /// What is new since the last call; of a channel that is not `wanted` nothing is encoded.
  using Send = std::function<void(std::size_t channel, const ChannelMessage&)>;
  void news(const std::function<bool(std::size_t channel)>& wanted, const Send& send);

  /// Whether it is a camera's: of pictures only the newest is of use.
  bool is_picture(std::size_t channel) const;
  /// The camera's newest frame after number `after`, encoded; the number is set to its own.
  std::optional<ChannelMessage> picture(std::size_t channel,
                                        std::optional<std::uint64_t>& after) const;

 private:
  /// Of a channel just one of them: its function of a stream's rows; a camera; else log, scene or
  /// transforms, by the topic's name.
  struct LiveChannel {
    Topic topic;
    std::string stream{};
    decltype(RowTopic::message) message{};
    std::string camera{};
  };
  struct Progress {
    std::string stream;
    std::optional<Time> last{};
  };

  std::size_t add(LiveChannel channel, nlohmann::json& added);
  nlohmann::json described(std::size_t channel) const;
  std::optional<ChannelMessage> of_row(const LiveChannel& channel, const Sample& row) const;
  ChannelMessage of_line(const Line& line) const;

  const Board& board_;
  const RunTopics topics_;
  std::vector<LiveChannel> channels_;  // their numbers are their places
  std::vector<Progress> streams_;
  std::uint64_t last_line_ = 0;
  /// The last encoded picture of each camera: encoded once for all clients.
  mutable std::map<std::string, std::pair<std::uint64_t, ChannelMessage>> pictures_;
};

}  // namespace vitreo::view
