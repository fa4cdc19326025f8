// SPDX-License-Identifier: Apache-2.0
#include "host/engine/coil_report.h"

#include "host/record/meaning.h"

#include <fmt/format.h>

#include <chrono>
#include <ctime>
#include <string>

namespace vitreo {
namespace {

/// "12:03:11.250", as a clock on the wall has it: what an operator writes down.
std::string time_of_day(std::chrono::system_clock::time_point moment) {
  const auto whole = std::chrono::floor<std::chrono::seconds>(moment);
  const std::time_t seconds = std::chrono::system_clock::to_time_t(whole);
  std::tm parts{};
  localtime_r(&seconds, &parts);
  const auto rest = std::chrono::duration_cast<std::chrono::milliseconds>(moment - whole);
  return fmt::format("{:02}:{:02}:{:02}.{:03}", parts.tm_hour, parts.tm_min, parts.tm_sec,
                     rest.count());
}

// A simulated run's times are no wall clock's, and its record is the same at each repetition.
std::string moment_of(const RunStage& stage, Time at) {
  if (stage.rig->laboratory() != nullptr) return fmt::format("{:.3f} s", to_seconds(at));
  return time_of_day(
      std::chrono::system_clock::now() -
      std::chrono::duration_cast<std::chrono::system_clock::duration>(stage.clock->now() - at));
}

int stream_of(Recorder& recorder, std::size_t coils) {
  const std::vector<Stream>& streams = recorder.streams();
  for (std::size_t i = 0; i < streams.size(); ++i)
    if (streams[i].info.name == kCoilReadBack) return static_cast<int>(i);
  StreamInfo info{
      kCoilReadBack, "currents that were read back after the coils were made safe", {}, kReadBack};
  for (std::size_t coil = 1; coil <= coils; ++coil)
    info.channels.push_back({"i" + std::to_string(coil), "A", "current that was read back"});
  return recorder.add_stream(info);
}

}  // namespace

void record_rest(RunStage& stage, const CoilRest& rest) {
  Recorder& recorder = *stage.recorder;
  // The time at which it is recorded: the record's own times do not go back.
  const Time now = stage.clock->now();
  if (rest.measured)
    recorder.sample(stream_of(recorder, rest.measured->size()), now, *rest.measured);
  recorder.event(now, kCoilRest, to_text(rest, moment_of(stage, rest.at)));
}

}  // namespace vitreo
