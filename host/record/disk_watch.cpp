// SPDX-License-Identifier: Apache-2.0
#include "host/record/disk_watch.h"

#include "host/config/config.h"
#include "host/files/posix_file.h"

#include <fmt/format.h>

#include <fcntl.h>
#include <limits>
#include <stdexcept>

namespace vitreo {
namespace {

// The manifest passes this name over (host/files/manifest.cpp).
constexpr const char* kReserve = "reserve.room";
constexpr auto kSpan = std::chrono::seconds(10);  // over which the rate is taken
constexpr auto kLeast = std::chrono::seconds(2);  // less says nothing yet

}  // namespace

// Decimal units, as disks are sold by.
std::string size_text(std::uint64_t space) {
  const double bytes = static_cast<double>(space);
  if (bytes >= 1e9) return fmt::format("{:.1f} GB", bytes / 1e9);
  if (bytes >= 1e6) return fmt::format("{:.0f} MB", bytes / 1e6);
  return fmt::format("{:.0f} kB", bytes / 1e3);
}

std::uint64_t free_bytes(const std::filesystem::path& path) {
  std::error_code error;
  const auto space = std::filesystem::space(path, error);
  // What cannot be asked is not held against the run: a write will say.
  return error ? std::numeric_limits<std::uint64_t>::max() : space.available;
}

DiskWatch::DiskWatch(std::filesystem::path folder, DiskLimits limits)
    : folder_(std::move(folder)), limits_(std::move(limits)) {
  if (!limits_.free_bytes) limits_.free_bytes = free_bytes;
}

std::uint64_t DiskWatch::free() const { return limits_.free_bytes(folder_); }

// The parent is named, which the operator chose: the run's own folder is removed again
// (Recorder::Recorder).
void DiskWatch::check_start() const {
  const std::uint64_t wanted = limits_.stop_bytes + limits_.reserve_bytes;
  if (const std::uint64_t left = free(); left < wanted)
    throw ConfigError(
        fmt::format("{}: only {} are free on this disk; a run is not begun with less than {}",
                    folder_.parent_path().string(), size_text(left), size_text(wanted)));
}

/// fallocate sets blocks aside without writing them.
/// It is given back before the end record is written (RecordWriter::finish): so a full disk takes
/// that all the same.
void DiskWatch::make_reserve() {
  if (limits_.reserve_bytes == 0) return;
  int file = create_new_file(folder_ / kReserve);
  const bool kept = ::fallocate(file, 0, 0, static_cast<off_t>(limits_.reserve_bytes)) == 0;
  close_file(file);
  // A file without blocks would be a reserve in name only.
  if (!kept) give_up_reserve();
}

void DiskWatch::give_up_reserve() noexcept {
  std::error_code ignored;  // it may never have been there
  std::filesystem::remove(folder_ / kReserve, ignored);
}

/// Bytes per second over the last kSpan; 0 as long as less than kLeast is known.
/// The mean over some seconds, because frames may come in bursts, and a burst is no trend.
double DiskWatch::rate(std::uint64_t written, Instant now) {
  history_.emplace_back(now, written);
  while (history_.size() > 1 && now - history_.front().first > kSpan) history_.pop_front();
  const auto span = now - history_.front().first;
  if (span < kLeast) return 0;
  return static_cast<double>(written - history_.front().second) /
         std::chrono::duration<double>(span).count();
}

DiskWatch::Verdict DiskWatch::look(std::uint64_t written, bool frames, Instant now) {
  const double bytes_per_second = rate(written, now);
  const std::uint64_t left = free();
  // 1e9 s stand for ever; below 1e6 s the rate is worth a sentence.
  const double seconds = bytes_per_second > 0 ? static_cast<double>(left) / bytes_per_second : 1e9;
  // Frames fill a disk far faster than samples: then more must be left.
  const std::uint64_t least = frames ? limits_.stop_bytes_with_frames : limits_.stop_bytes;
  Verdict verdict;
  const std::string state =
      seconds < 1e6 ? fmt::format("{} are left on the disk, {:.0f} s at {}/s", size_text(left),
                                  seconds, size_text(static_cast<std::uint64_t>(bytes_per_second)))
                    : size_text(left) + " are left on the disk";
  if (left < least || seconds < limits_.stop_seconds) {
    // Begins with the folder, the warning below with "the disk": by that the alarm gets its name
    // and priority (DiskAlarm).
    verdict.stop = folder_.string() + ": the disk is nearly full: " + state;
  } else if (seconds < limits_.warn_seconds && !warned_) {
    warned_ = true;
    verdict.warning = "the disk fills: " + state;
  }
  return verdict;
}

}  // namespace vitreo
