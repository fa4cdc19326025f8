// SPDX-License-Identifier: Apache-2.0
#include "host/view/foxglove_protocol.h"

#include "host/channels/run_topics.h"

#include <stdexcept>

namespace vitreo::view {
namespace {

using nlohmann::json;

template <class Number>
void append(std::string& bytes, Number value) {
  // The machine's own byte order: x86 and ARM are little-endian.
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

}  // namespace

std::vector<std::string> foxglove_subprotocols() {
  return {"foxglove.sdk.v1", "foxglove.websocket.v1"};
}

std::string status_text(int level, const std::string& text) {
  return json_text({{"op", "status"}, {"level", level}, {"message", text}});
}

/// [1][u32 subscription][u64 ns][payload], little-endian.
std::shared_ptr<const std::string> message_data(std::uint32_t subscription,
                                                const ChannelMessage& message) {
  const auto bytes = std::make_shared<std::string>();
  // 1 + 4 + 8 bytes before the text, which is copied once.
  bytes->reserve(13 + message.text.size());
  append(*bytes, std::uint8_t{1});
  append(*bytes, subscription);
  append(*bytes, message.time);
  *bytes += message.text;
  return bytes;
}

/// [2][u64 ns]: the run's own time, which a simulated run has, too.
std::shared_ptr<const std::string> time_data(std::uint64_t ns) {
  const auto bytes = std::make_shared<std::string>();
  append(*bytes, std::uint8_t{2});
  append(*bytes, ns);
  return bytes;
}

/// The text is a client's and may hold anything; the protocol has 32 bits without a sign.
std::uint32_t number_in(const json& object, const char* name) {
  const auto found = object.is_object() ? object.find(name) : object.end();
  if (!object.is_object() || found == object.end() || !found->is_number_unsigned() ||
      found->get<std::uint64_t>() > 0xFFFFFFFF)
    throw std::invalid_argument(std::string(name) + " wants a whole number");
  return found->get<std::uint32_t>();
}

}  // namespace vitreo::view
