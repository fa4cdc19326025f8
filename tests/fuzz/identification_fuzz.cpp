// libFuzzer target of the instruments' identifications: whatever answers a question, it is
// recognized or not, without an exception, and what goes into a rig file is text that Lua reads as
// it is meant. The first byte chooses the driver; a 0xFF ends one answer and begins the next.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/kepco_bop/identification.h"
#include "devices/instruments/scpi_probe/identification.h"
#include "devices/instruments/sutter_mp285/identification.h"
#include "devices/instruments/sutter_mpc200/identification.h"
#include "devices/instruments/zaber/identification.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <span>
#include <string>
#include <vector>

namespace {

using namespace vitreo;

constexpr Identification (*kAll[])() = {kepco_bop::identification, scpi_probe::identification,
                                        sutter_mp285::identification, sutter_mpc200::identification,
                                        zaber::identification};

/// As many as there are messages: the asking stops after the last one. 0xFF twice is the byte.
std::vector<ByteString> answers_in(std::span<const std::uint8_t> bytes, std::size_t most) {
  std::vector<ByteString> answers(1);
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    if (bytes[i] != 0xFF) {
      answers.back().push_back(bytes[i]);
    } else if (i + 1 < bytes.size() && bytes[i + 1] == 0xFF) {
      answers.back().push_back(bytes[i++]);
    } else if (answers.size() < most) {
      answers.emplace_back();
    }
  }
  return answers;
}

/// A setting stands in a rig file as it is: numbers, words, one text in quotes, or a flat table.
void check(const ProposedSetting& setting) {
  const std::string allowed =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789 _.,:?={}\"";
  if (setting.value.empty() || setting.value.size() > 100 ||
      setting.value.find_first_not_of(allowed) != std::string::npos)
    std::abort();
}

void check(const Recognized& recognized) {
  if (recognized.roles.empty() || recognized.identity.name.size() > 4096) std::abort();
  for (const ProposedRole& role : recognized.roles)
    for (const ProposedSetting& setting : role.settings) check(setting);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const Identification identification = kAll[data[0] % std::size(kAll)]();
  const PortQuestion& question = *identification.question;
  const std::vector<ByteString> all = answers_in({data + 1, size - 1}, question.messages.size());
  // As ask_port() does: after each answer, with those before it.
  for (std::size_t count = 1; count <= all.size(); ++count)
    if (const auto is = question.recognize({all.begin(), all.begin() + static_cast<long>(count)}))
      check(*is);
  return 0;
}
