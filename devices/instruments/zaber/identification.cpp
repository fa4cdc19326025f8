// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/zaber/identification.h"

#include "devices/instruments/zaber/wire.h"

#include <array>
#include <map>

namespace vitreo::zaber {
namespace {

/// What all devices of the chain are asked, each with the id of its place; the model is device.id
/// since firmware 7, and deviceid before.
constexpr std::array<const char*, 5> kSettings{"version", "device.id", "deviceid", "system.serial",
                                               "system.axiscount"};

/// Of each device that has answered, by its number: what, by setting.
using AnsweredChain = std::map<int, std::map<std::string, std::string>>;

AnsweredChain chain_of(const std::vector<ByteString>& answers) {
  AnsweredChain chain;
  for (const ByteString& answer : answers) {
    std::string_view rest(reinterpret_cast<const char*>(answer.data()), answer.size());
    for (; !rest.empty(); rest.remove_prefix(std::min(rest.find('\n'), rest.size() - 1) + 1)) {
      const auto reply = decode_message(rest.substr(0, rest.find('\n')));
      if (!reply || reply->kind != Kind::reply || !reply->accepted || !reply->id) continue;
      const auto place = static_cast<std::size_t>(*reply->id);
      if (place < kSettings.size()) chain[reply->device][kSettings.at(place)] = reply->data;
    }
  }
  return chain;
}

/// "{ device = 1, axis = 2 }" of every axis of the chain, in its order.
std::vector<std::string> axes_of(const AnsweredChain& chain) {
  std::vector<std::string> axes;
  for (const auto& [device, said] : chain) {
    const auto found = said.find("system.axiscount");
    const auto numbers = found == said.end() ? std::nullopt : decode_numbers(found->second);
    const int count = numbers && numbers->size() == 1 && numbers->front() <= 9
                          ? static_cast<int>(numbers->front())
                          : 1;
    for (int axis = 1; axis <= std::max(count, 1); ++axis)
      axes.push_back("{ device = " + std::to_string(device) + ", axis = " + std::to_string(axis) +
                     " }");
  }
  return axes;
}

std::string said_or(const std::map<std::string, std::string>& said, const char* setting,
                    const std::string& otherwise) {
  const auto found = said.find(setting);
  return found == said.end() ? otherwise : found->second;
}

/// Whether an axis goes straight or turns, its number of a model alone tells: both are proposed.
std::vector<ProposedRole> roles_of(const AnsweredChain& chain) {
  const std::vector<std::string> axes = axes_of(chain);
  ProposedRole stage{"stage", {}, "which axis is x, y or z, and `step` of its data sheet (m)"};
  const std::array<const char*, 3> names = axes.size() == 1
                                               ? std::array<const char*, 3>{"z", "", ""}
                                               : std::array<const char*, 3>{"x", "y", "z"};
  for (std::size_t i = 0; i < std::min(axes.size(), names.size()); ++i)
    stage.settings.push_back({names.at(i), axes[i]});
  const ProposedRole turntable{"rotation_stage",
                               {{"device", std::to_string(chain.begin()->first)}, {"axis", "1"}},
                               "for a turntable; `step` of its data sheet (rad)"};
  return {stage, turntable};
}

std::optional<Recognized> recognize_chain(const std::vector<ByteString>& answers) {
  const AnsweredChain chain = chain_of(answers);
  if (answers.size() < kSettings.size() || chain.empty()) return std::nullopt;
  const auto& first = chain.begin()->second;
  if (!first.contains("version")) return std::nullopt;
  const std::string model = said_or(first, "device.id", said_or(first, "deviceid", "unknown"));
  const std::string others =
      chain.size() > 1 ? " and " + std::to_string(chain.size() - 1) + " more of the chain" : "";
  return Recognized{
      {"Zaber device " + model + others, said_or(first, "system.serial", ""), first.at("version")},
      roles_of(chain)};
}

}  // namespace

// The line's end before the first command ends what a host that died may have begun.
Identification identification() {
  PortQuestion question{
      .baud_rates = {115200, 9600}, .patience = 0.5, .recognize = recognize_chain};
  for (std::size_t place = 0; place < kSettings.size(); ++place)
    question.messages.push_back(bytes_of_text(
        (place == 0 ? "\n" : "") +
        encode(Command{0, 0, static_cast<int>(place), std::string("get ") + kSettings.at(place)})));
  return {.words = {"Zaber"}, .question = question};
}

}  // namespace vitreo::zaber
