// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/scpi_probe/identification.h"

#include "devices/instruments/scpi_probe/driver.h"
#include "devices/links/scpi.h"
#include "devices/links/scpi_question.h"

#include <cctype>

namespace vitreo::scpi_probe {
namespace {

/// Any instrument with SCPI answers so; whether it measures a field, its name tells people.
std::optional<Recognized> recognize_scpi(const std::vector<ByteString>& answers) {
  const auto who = scpi::identity(scpi::last_line(text_of_bytes(answers.front())));
  if (!who) return std::nullopt;
  return Recognized{
      *who,
      {{"field_probe",
        {{"question", "\"" + Settings{}.question + "\""}},
        "if it is a teslameter: question asks for the field, unit and range are those "
        "of its numbers, axes is 1 or 3"}}};
}

}  // namespace

Identification identification() {
  PortQuestion question = scpi::identity_question();
  question.recognize = recognize_scpi;
  return {.question = question};
}

}  // namespace vitreo::scpi_probe
