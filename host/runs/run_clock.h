// Clock of a run on the wall: where the zero of its times lies.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/run_data.h"

#include <cstdint>
#include <optional>
#include <string>

namespace vitreo {

/// ns since 1970, UTC, of the zero of the record's times, RunStart::t0_utc_ns. Of records before
/// version 5 the event "clock" of a run on real instruments; else the moment at which the record
/// was begun, to a second. Throws RecordError where the record says none of it.
std::int64_t t0_utc_ns(const RunData& data);
/// The same as text: "2026-11-21T13:30:00.123456Z".
std::string t0_utc_text(const RunData& data);
/// A time stamp as this program writes them, "2026-11-21T14:30:00+0100" or "...:00.123456Z", in ns
/// since 1970; nothing for another text.
std::optional<std::int64_t> parse_time_stamp(const std::string& text);
/// Which clock it is, in one sentence.
std::string clock_text(const RunData& data);

}  // namespace vitreo
