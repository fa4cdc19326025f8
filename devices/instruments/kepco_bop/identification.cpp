// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/kepco_bop/identification.h"

#include "devices/instruments/kepco_bop/wire.h"
#include "devices/links/scpi_question.h"

namespace vitreo::kepco_bop {
namespace {

std::optional<Recognized> recognize_bop(const std::vector<ByteString>& answers) {
  const auto who = decode_identity(answer_in(scpi::last_line(text_of_bytes(answers.front()))));
  if (!who) return std::nullopt;
  return Recognized{
      *who, {{"coils", {}, "one address a coil, between commas; the rig octomag_bop makes eight"}}};
}

}  // namespace

Identification identification() {
  PortQuestion question = scpi::identity_question();
  question.recognize = recognize_bop;
  return {.words = {"Kepco", "KEPCO"}, .question = question};
}

}  // namespace vitreo::kepco_bop
