// SPDX-License-Identifier: Apache-2.0
#include "host/rig/calibrations.h"

#include "host/files/run_folder.h"

#include <fmt/format.h>

#include <chrono>
#include <cstdio>
#include <limits>
#include <optional>

namespace vitreo {
namespace {

/// "2026-10-01" as a day; none for another text or a day that the calendar has not.
/// %n makes sure that nothing follows: "2026-10-01T12:00" is another format, and not silently cut.
std::optional<std::chrono::sys_days> day_of(const std::string& text) {
  int year = 0;
  int month = 0;
  int day = 0;
  int read = 0;
  if (std::sscanf(text.c_str(), "%4d-%2d-%2d%n", &year, &month, &day, &read) != 3 ||
      static_cast<std::size_t>(read) != text.size())
    return std::nullopt;
  const std::chrono::year_month_day date(std::chrono::year{year},
                                         std::chrono::month(static_cast<unsigned>(month)),
                                         std::chrono::day(static_cast<unsigned>(day)));
  return date.ok() ? std::optional(std::chrono::sys_days(date)) : std::nullopt;
}

Calibration read_one(ConfigReader& rig, ConfigReader reader, const std::string& name) {
  Calibration one;
  one.name = name;
  one.file = reader.text("file", "");
  one.date = reader.text("date", "");
  const auto day = day_of(one.date);
  if (!day) reader.fail("date", "wants the day on which it was made, such as \"2026-10-01\"");
  // One day ahead is allowed: it may have been made in a time zone farther east.
  if (*day > *day_of(today_text()) + std::chrono::days(1))
    reader.fail("date", "is in the future: " + one.date);
  one.valid_days = reader.integer("valid_days", one.valid_days, 1, 36500);
  // A role that the rig has not would never be compared: a misspelt one is an error.
  ConfigReader devices = reader.table("devices");
  for (const std::string& role : devices.keys()) {
    if (!rig.has(role)) devices.fail(role, "is no role of this rig");
    one.devices[role] = devices.text(role, "");
  }
  devices.finish();
  if (reader.has("instead_of"))
    // Without bounds: it is whatever the rig file had there, in that key's unit.
    one.instead_of = reader.number(
        "instead_of", 0,
        {-std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity(), ""});
  reader.finish();
  return one;
}

InstalledCalibration read_installed(ConfigReader reader) {
  InstalledCalibration installed;
  installed.file = reader.text("file", "");
  if (!installed.file.ends_with(".json"))
    reader.fail("file", "wants the name of a file, such as \"octomag.json\"");
  installed.valid_days = reader.integer("valid_days", installed.valid_days, 1, 36500);
  reader.finish();
  return installed;
}

}  // namespace

// The operator's day, as calibrations are dated; days and not times, since validity is counted in
// days.
std::string today_text() { return wall_time_text().substr(0, 10); }

Calibrations Calibrations::read(ConfigReader& rig) {
  Calibrations calibrations;
  if (!rig.has("calibrations")) return calibrations;
  ConfigReader reader = rig.table("calibrations");
  calibrations.refuse_stale = reader.choice("when_stale", "warn", {"warn", "refuse"}) == "refuse";
  // Every other key is a calibration's name, which the file chooses.
  for (const std::string& name : reader.keys())
    if (name == "installed")
      calibrations.installed = read_installed(reader.table(name));
    else if (name != "when_stale")
      calibrations.list.push_back(read_one(rig, reader.table(name), name));
  reader.finish();
  return calibrations;
}

Calibrations Calibrations::of(const RigDescription& rig) {
  ConfigReader reader(rig);
  return read(reader);
}

std::vector<std::string> Calibrations::out_of_date(const std::string& today) const {
  std::vector<std::string> lines;
  const auto now = day_of(today);
  for (const Calibration& one : list) {
    const auto made = day_of(one.date);
    if (!now || !made) continue;
    const auto age = (*now - *made).count();
    if (age > one.valid_days)
      lines.push_back(fmt::format("the calibration '{}' is of {}: {} days old, and valid for {}",
                                  one.name, one.date, age, one.valid_days));
  }
  return lines;
}

// Part of the identity is enough, such as a serial number: firmware and address in it may change.
// An instrument that is missing counts as another one.
std::vector<std::string> Calibrations::of_others(const nlohmann::json& identities) const {
  std::vector<std::string> lines;
  for (const Calibration& one : list)
    for (const auto& [role, wanted] : one.devices) {
      const std::string there =
          identities.contains(role) ? identities[role].get<std::string>() : "nothing";
      if (there.find(wanted) == std::string::npos)
        lines.push_back(
            fmt::format("the calibration '{}' was made with {} = '{}', and there is '{}'", one.name,
                        role, wanted, there));
    }
  return lines;
}

}  // namespace vitreo
