// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/sutter_mp285/identification.h"

#include "devices/instruments/sutter_mp285/wire.h"

#include <cstdio>

namespace vitreo::sutter_mp285 {
namespace {

/// um/s: no other instrument would return it. Neither byte of it is another one's command.
constexpr int kOddSpeed = 777;

/// A status is 32 bytes and CR, in which 25 microsteps are a micrometer. Before its first V after
/// power-up an MP-285 answers nothing: then the status after the V counts.
std::optional<Recognized> recognize_mp285(const std::vector<ByteString>& answers) {
  const auto is = decode_status(answers.back());
  if (!is || is->usteps_per_um != kUsteps_per_um) return std::nullopt;
  char version[16];
  std::snprintf(version, sizeof version, "%d.%02d", is->version / 100, is->version % 100);
  return Recognized{{"Sutter MP-285", "", version}, {{"stage"}}};
}

}  // namespace

// It has no command for its identity. Its letters that move, set its origin or its speed, reset it
// or belong to its stored programs: m, o, a, b, V, r, e, d, k, u. V is among them, for it changes
// what another host had set; here it is sent only where the status was not answered without.
Identification identification() {
  return {.words = {"Sutter"},
          .question =
              PortQuestion{.baud_rates = {9600, 19200},
                           .messages = {encode(Interrupt{}), encode(GetStatus{}),
                                        encode(SetVelocity{kOddSpeed, true}), encode(GetStatus{})},
                           .opening_pause = 1,
                           .patience = 1,
                           .may_begin_silent = true,
                           .recognize = recognize_mp285},
          .commands = "moabVredku",
          .caution =
              "any byte stops a Sutter MP-285 that moves, and hangs one whose rotary control "
              "is being turned"};
}

}  // namespace vitreo::sutter_mp285
