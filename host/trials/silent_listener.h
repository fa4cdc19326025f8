// Silent progress listener, and arguments written in one line: shared by runs of runs.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/session/progress_listener.h"

#include <sstream>
#include <string>
#include <vector>

namespace vitreo {

class SilentListener : public ProgressListener {
 public:
  void progress(double, const std::string&) override {}
  void message(const std::string&) override {}
};

/// "speed=5um hold=2s" as two words.
inline std::vector<std::string> words_of(const std::string& text) {
  std::istringstream in(text);
  std::vector<std::string> words;
  for (std::string word; in >> word;) words.push_back(word);
  return words;
}

}  // namespace vitreo
