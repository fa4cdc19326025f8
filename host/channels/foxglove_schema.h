// JSON Schemas of messages under the names by which Foxglove and its kin know them
// (docs.foxglove.dev/docs/sdk/schemas), and the parts that messages share.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"

#include <nlohmann/json.hpp>

#include <cstdint>
#include <string>

namespace vitreo {

/// The schema "foxglove.NAME". Throws std::invalid_argument for a name that is not in the table.
/// Every "type" is one word: readers refuse a list of types, and with it the whole topic.
nlohmann::json foxglove_schema(const std::string& name);

/// The run's clock on the wall: moments as UTC.
class UtcClock {
 public:
  /// `t0_utc_ns`: ns since 1970, UTC, of the run's zero.
  explicit UtcClock(std::int64_t t0_utc_ns) : t0_(t0_utc_ns) {}
  /// ns since 1970; what would lie before that is 0.
  std::uint64_t ns(Time time) const;
  nlohmann::json stamp(Time time) const;  // {"sec", "nsec"}

 private:
  std::int64_t t0_;
};

}  // namespace vitreo
