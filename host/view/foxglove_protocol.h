// Messages of the Foxglove WebSocket protocol (github.com/foxglove/ws-protocol, version 1) as bytes
// and texts.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/view/foxglove_channels.h"

#include <nlohmann/json.hpp>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace vitreo::view {

/// The protocol under its present name and under that of Foxglove's later SDK: the messages used
/// here are the same.
std::vector<std::string> foxglove_subprotocols();

// Levels of status_text().
inline constexpr int kFoxgloveInfo = 0;
inline constexpr int kFoxgloveWarning = 1;
inline constexpr int kFoxgloveError = 2;
std::string status_text(int level, const std::string& text);

/// A message of the channel to which this number of the client's subscribes.
std::shared_ptr<const std::string> message_data(std::uint32_t subscription,
                                                const ChannelMessage& message);
/// The run's own time, ns since 1970.
std::shared_ptr<const std::string> time_data(std::uint64_t ns);

/// A field of a client's message as a number of 32 bits. Throws std::invalid_argument.
std::uint32_t number_in(const nlohmann::json& object, const char* name);

}  // namespace vitreo::view
