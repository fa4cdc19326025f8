// Report of a run: one self-contained page that reads on screen, on paper, and without a network.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/recorder.h"

#include <string>

namespace vitreo {

std::string report_html(const RunData& data);
inline std::string report_html(const Recorder& recorder) { return report_html(recorder.data()); }

}  // namespace vitreo
