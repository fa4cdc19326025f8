// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/sutter_mpc200/identification.h"

#include "devices/instruments/sutter_mpc200/wire.h"

namespace vitreo::sutter_mpc200 {
namespace {

/// The answer to the second message; the first only ends a motion, in which it would not answer.
/// After an interrupted motion a mark stands before it.
std::optional<Recognized> recognize_mpc200(const std::vector<ByteString>& answers) {
  if (answers.size() < 2) return std::nullopt;
  ByteString reply = answers[1];
  if (!reply.empty() && reply.front() == kInterrupted) reply.erase(reply.begin());
  const auto is = decode_drive(reply);
  if (!is) return std::nullopt;
  const std::string minor = std::to_string(is->version % 100);
  return Recognized{{"Sutter MPC-200", "",
                     std::to_string(is->version / 100) + (minor.size() < 2 ? ".0" : ".") + minor},
                    {{"stage", {{"drive", std::to_string(is->drive)}}}}};
}

}  // namespace

// Its single letters: two motions, calibration, home and work position, the choice of a drive, its
// panel's mode, and streaming.
Identification identification() {
  return {.usb = {{0x1342, {0x0001}}},
          .words = {"Sutter"},
          .question = PortQuestion{.baud_rates = {128000},
                                   .messages = {encode(Interrupt{}), encode(GetDrive{})},
                                   .patience = 0.5,
                                   .may_begin_silent = true,
                                   .recognize = recognize_mpc200},
          .commands = "MSNHYILOF",
          .caution = "a Sutter MPC-200 that moves is stopped"};
}

}  // namespace vitreo::sutter_mpc200
