// SPDX-License-Identifier: Apache-2.0
#include "host/runs/run_clock.h"

#include "host/files/run_folder.h"
#include "host/runs/run_reader.h"

#include <chrono>
#include <cstdio>
#include <ctime>

namespace vitreo {
namespace {

// 64 bits of ns reach from 1677 to 2262.
constexpr std::int64_t kNsPerSecond = 1000000000;  // ns

/// The moment in "0 s is 2026-11-21T13:30:00.123456Z, and ...", as the engine notes it.
std::optional<std::int64_t> noted(const RunData& data) {
  constexpr std::string_view kBegin = "0 s is ";
  for (const Event& event : data.events) {
    if (event.kind != "clock" || !event.text.starts_with(kBegin)) continue;
    // Old records have the moment in this event alone.
    const std::string text = event.text.substr(kBegin.size());
    return parse_time_stamp(text.substr(0, text.find(',')));
  }
  return {};
}

}  // namespace

std::optional<std::int64_t> parse_time_stamp(const std::string& text) {
  // ISO 8601 as records write it; not std::get_time, which is late in GCC 12 with fractions.
  std::tm parts{};
  int used = 0;
  if (std::sscanf(text.c_str(), "%4d-%2d-%2dT%2d:%2d:%2d%n", &parts.tm_year, &parts.tm_mon,
                  &parts.tm_mday, &parts.tm_hour, &parts.tm_min, &parts.tm_sec, &used) != 6)
    return {};
  parts.tm_year -= 1900;
  parts.tm_mon -= 1;
  // timegm() and not mktime(): the zone of the machine that reads must not matter.
  std::int64_t ns = std::int64_t{timegm(&parts)} * kNsPerSecond;
  std::string rest = text.substr(static_cast<std::size_t>(used));
  if (rest.starts_with('.')) {
    const std::size_t end = rest.find_first_not_of("0123456789", 1);
    std::string digits = rest.substr(1, end == std::string::npos ? end : end - 1);
    // Finer than a nanosecond is no stamp of ours.
    if (digits.empty() || digits.size() > 9) return {};
    // Nine digits are nanoseconds.
    digits.resize(9, '0');
    ns += std::stoll(digits);
    rest = end == std::string::npos ? "" : rest.substr(end);
  }
  if (rest == "Z") return ns;
  // An offset as +0100, of time stamps that the start record has in local time.
  int hours = 0;
  int minutes = 0;
  char sign = 0;
  if (rest.size() != 5 || std::sscanf(rest.c_str(), "%c%2d%2d", &sign, &hours, &minutes) != 3 ||
      (sign != '+' && sign != '-'))
    return {};
  // Local time is UTC plus the offset, so it is taken off.
  return ns - (sign == '+' ? 1 : -1) * (hours * 3600 + minutes * 60) * kNsPerSecond;
}

/// From the most exact source to the least: the start record (since version 5), the note of a run
/// on real instruments, and the begin of the record to a second.
std::int64_t t0_utc_ns(const RunData& data) {
  if (data.start.t0_utc_ns) return *data.start.t0_utc_ns;
  if (const auto exact = noted(data)) return *exact;
  if (const auto begun = parse_time_stamp(read_head(data.folder).time)) return *begun;
  throw RecordError(data.folder.string() + ": does not say when it was recorded");
}

std::string t0_utc_text(const RunData& data) {
  return utc_text(std::chrono::system_clock::time_point(
      std::chrono::duration_cast<std::chrono::system_clock::duration>(
          std::chrono::nanoseconds(t0_utc_ns(data)))));
}

/// `clock` is empty in records before version 5; of those the note tells that the clock was real.
std::string clock_text(const RunData& data) {
  if (data.start.clock == "real" || noted(data))
    return "the host's clock; UTC is t0_utc plus t, to a microsecond";
  return data.start.t0_utc_ns ? "a simulated run's clock; t0_utc is when the simulation began"
                              : "the run's clock; its zero is the begin of the record, to a second";
}

}  // namespace vitreo
