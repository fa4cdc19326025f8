// Colors that all plots share.
// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace vitreo {

constexpr const char* kInk = "#1F252B";
constexpr const char* kSoftInk = "#59626B";
constexpr const char* kSpine = "#7D868F";

}  // namespace vitreo
