// Summary of a run for lists and the catalog: its head, and its parameters, results, tags and
// sample by name; quick, without samples and pictures.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace vitreo {

struct RunHead {
  std::string folder;
  std::string time;
  std::string protocol;
  std::string title;
  std::string operator_name;
  std::string seed;
  std::string state;  // the outcome, or "running", "lost" (killed, not recovered yet), "unreadable"
  std::string reason;          // of the end, or why it cannot be read
  double experiment_time = 0;  // s
  std::string rig{};           // its file
  std::string ended_by{};      // "person", "scheduler" ...; empty: not known
};

struct NamedValue {
  char kind = 'p';  // p: parameter, r: result, t: tag, s: field of the sample
  std::string name;
  std::optional<double> number;  // SI; 1 or 0 of a flag
  std::string text{};            // of a text or flag, or a list as JSON
  std::string unit{};            // SI
};

struct RunSummary {
  RunHead head;
  std::optional<std::int64_t> t0_utc_ns{};
  double wall_time = 0;  // s
  int version = 0;       // of the record's schema
  std::string words{};   // all of its texts, for a search; notes among them
  std::vector<NamedValue> values{};
  bool lasting = false;  // closed: it stays as it is
};

/// Never throws for what is in the folder: head.state says it.
RunSummary read_summary(const std::filesystem::path& folder);
RunHead read_head(const std::filesystem::path& folder);

}  // namespace vitreo
