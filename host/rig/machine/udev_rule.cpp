// SPDX-License-Identifier: Apache-2.0
#include "host/rig/machine/udev_rule.h"

#include <fnmatch.h>
#include <regex>
#include <sstream>

namespace vitreo::machine {

std::vector<std::vector<RuleTerm>> read_rules(const std::string& text) {
  static const std::regex kTerm(R"re(([A-Z_]+)(\{([^}]*)\})?\s*(==|!=|\+=|-=|:=|=)\s*"([^"]*)")re");
  std::vector<std::vector<RuleTerm>> rules;
  std::istringstream lines(text);
  std::string whole;
  for (std::string line; std::getline(lines, line);) {
    if (whole.empty() && line.find_first_not_of(" \t") == line.find('#')) continue;
    whole += line;
    if (whole.ends_with('\\')) {
      whole.pop_back();
      continue;
    }
    std::vector<RuleTerm> terms;
    for (std::sregex_iterator term(whole.begin(), whole.end(), kTerm), end; term != end; ++term)
      terms.push_back({(*term)[1], (*term)[3], (*term)[4], (*term)[5]});
    if (!terms.empty()) rules.push_back(terms);
    whole.clear();
  }
  return rules;
}

bool fits(const std::string& patterns, const std::string& text) {
  std::istringstream all(patterns);
  for (std::string one; std::getline(all, one, '|');)
    if (fnmatch(one.c_str(), text.c_str(), 0) == 0) return true;
  return patterns.empty() && text.empty();
}

}  // namespace vitreo::machine
