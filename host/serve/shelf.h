// Shelf of what is recorded: runs found, compared and read, sweeps, and the files of both for a
// browser.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/view/web_request.h"

#include <nlohmann/json.hpp>

#include <filesystem>
#include <map>
#include <mutex>
#include <string>
#include <vector>

namespace vitreo::serve {

/// Any thread.
class Shelf {
 public:
  Shelf(std::filesystem::path runs, std::filesystem::path sweeps);

  /// `find`: a condition as `vitreo runs --where` has it, where there is a sign of one (< > = ~),
  /// else words that stand somewhere in the run. The newest first, `most` of them after `skip`:
  /// {"total", "columns": [names], "runs": [...]}; the values of the columns that the condition
  /// names, and of `columns`, as people read them. Throws ConfigError for a wrong condition.
  nlohmann::json runs(const std::string& find, const std::vector<std::string>& columns,
                      std::size_t skip, std::size_t most);
  /// One run: head, values (parameters, results, tags, sample) by kind, files. Throws ConfigError
  /// where there is none of that name.
  nlohmann::json run(const std::string& name);
  /// {"names", "runs", "sentence", "differing", "same", "results"}, as `vitreo compare`.
  nlohmann::json compare(const std::vector<std::string>& names);
  /// Its page, with the streams over each other.
  std::string comparison_page(const std::vector<std::string>& names);
  /// [{"name", "protocol", "points", "report", "csv"}], the newest first.
  nlohmann::json sweeps() const;

  /// GET /runs/NAME/FILE and /sweeps/NAME/...: a plain file below those folders. A page of a record
  /// is shown without any right on ours (CSP sandbox): it may come from elsewhere.
  view::WebReply file(const std::string& path) const;

 private:
  std::filesystem::path run_folder(const std::string& name) const;

  const std::filesystem::path runs_, sweeps_;
  std::mutex mutex_;  // of the pages
  std::map<std::string, std::string> pages_;
};

/// A page or drawing that is no part of ours: inline styles and scripts, but no origin.
view::WebReply sandboxed(std::string html, const std::string& type);

}  // namespace vitreo::serve
