// Question for the identity of a SCPI instrument, for `vitreo devices --ask`.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/dialogue.h"
#include "devices/links/identification.h"
#include "devices/links/scpi.h"

#include <string>
#include <string_view>

namespace vitreo::scpi {

/// The question for it, to a port on which it is not known what is there; the line's end before it
/// ends what a host that died may have begun. `recognize` is the instrument's.
inline PortQuestion identity_question() {
  return {.baud_rates = {9600, 19200, 38400, 57600, 115200, 4800},
          .messages = {bytes_of_text("\n*IDN?\n")},
          .patience = 2};
}
/// Of an answer of several lines the last that holds something: an instrument may answer what was
/// begun before with a line of its own.
inline std::string last_line(std::string_view answer) {
  std::string last;
  for (const std::string& line : parts(answer, '\n'))
    if (!line.empty()) last = line;
  return last;
}

}  // namespace vitreo::scpi
