// The report's look, on screen and on paper.
// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace vitreo {

extern const char* const kReportStyle;  // the text of a <style> element

}  // namespace vitreo
