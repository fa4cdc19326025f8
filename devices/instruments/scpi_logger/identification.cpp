// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/scpi_logger/identification.h"

#include "devices/links/scpi.h"
#include "devices/links/scpi_question.h"

namespace vitreo::scpi_logger {
namespace {

std::optional<Recognized> recognize_logger(const std::vector<ByteString>& answers) {
  const auto who = scpi::identity(scpi::last_line(text_of_bytes(answers.front())));
  if (!who) return std::nullopt;
  bool known = false;
  for (const char* model : {"34970A", "34972A", "DAQ970A", "DAQ973A"})
    known = known || who->name.find(model) != std::string::npos;
  if (!known) return std::nullopt;
  return Recognized{*who,
                    {{"current_sensor",
                      {{"channels", "{ 101, 102, 103, 104, 105, 106, 107, 108 }"}},
                      "one channel a coil; amperes_per_volt is that of its shunt or transducer"}}};
}

}  // namespace

Identification identification() {
  PortQuestion question = scpi::identity_question();
  question.recognize = recognize_logger;
  return {.question = question};
}

}  // namespace vitreo::scpi_logger
