// SPDX-License-Identifier: Apache-2.0
#include "devices/links/dialogue.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <stdexcept>
#include <utility>

namespace vitreo {
namespace {

/// A command of 80 bytes takes 83 ms at 9600 baud; only a far end that takes nothing is later.
constexpr Time kWriteTimeout = std::chrono::seconds(1);
constexpr std::size_t kChunk = 256;
/// To discard at once: a broken instrument may send without end.
constexpr int kMostChunks = 256;

std::span<const std::uint8_t> bytes_of(std::string_view text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

}  // namespace

Dialogue::Dialogue(std::unique_ptr<ByteLink> link, std::string device, Clock& clock)
    : link_(std::move(link)), device_(std::move(device)), clock_(clock) {
  if (!link_) throw std::invalid_argument("link: must not be null");
}

/// The shield is made first: a stop that comes while this task waits for its turn is deferred too,
/// so a task that is stopped can still stop its instrument.
Dialogue::Turn::Turn(Dialogue& dialogue) : dialogue_(dialogue), shield_(dialogue.clock_) {
  dialogue.clock_.wait(
      dialogue.free_, [&dialogue] { return !dialogue.taken_; }, kForever);
  dialogue.taken_ = true;
}
Dialogue::Turn::~Turn() {
  dialogue_.taken_ = false;
  dialogue_.clock_.notify(dialogue_.free_);
}

void Dialogue::fail(DeviceErrorKind kind, const std::string& what) const {
  throw DeviceError(kind, device_, what);
}

/// Errors of the link are thrown again under the device's name; a lost link is noted.
template <class Work>
auto Dialogue::guarded(const Work& work) {
  if (lost_) fail(DeviceErrorKind::lost, link_->address() + " was lost");
  try {
    return work();
  } catch (const DeviceError& error) {
    lost_ = lost_ || error.kind == DeviceErrorKind::lost;
    throw DeviceError(error.kind, device_, error.what());
  }
}

// The bytes are with the kernel when it returns; whether the instrument took them only an answer
// shows.
void Dialogue::send(std::span<const std::uint8_t> bytes) {
  guarded([&] { link_->write(bytes, kWriteTimeout); });
}
void Dialogue::send(std::string_view text) { send(bytes_of(text)); }

/// Whether a byte is there by `deadline`; what has arrived is kept for next().
bool Dialogue::fill(Time deadline) {
  if (!arrived_.empty()) return true;
  const Time left = std::max(deadline - clock_.now(), Time::zero());
  const ByteString bytes = guarded([&] { return link_->read(kChunk, left); });
  arrived_.insert(arrived_.end(), bytes.begin(), bytes.end());
  return !arrived_.empty();
}

std::optional<std::uint8_t> Dialogue::next(Time deadline) {
  if (!fill(deadline)) return std::nullopt;
  const std::uint8_t byte = arrived_.front();
  arrived_.pop_front();
  return byte;
}

/// Bytes of a reply that is cut short are gone: the next exchange begins anew.
ByteString Dialogue::take(std::size_t count, Time deadline) {
  ByteString bytes;
  while (bytes.size() < count) {
    const auto byte = next(deadline);
    if (!byte && bytes.empty()) fail(DeviceErrorKind::timeout, "no answer in time");
    if (!byte)
      fail(DeviceErrorKind::timeout, "only " + std::to_string(bytes.size()) + " of " +
                                         std::to_string(count) +
                                         " bytes came in time: " + printable(bytes));
    bytes.push_back(*byte);
  }
  return bytes;
}

std::string Dialogue::line(char terminator, std::size_t most, Time deadline) {
  std::string text;
  while (const auto byte = next(deadline)) {
    if (static_cast<char>(*byte) == terminator) return text;
    text.push_back(static_cast<char>(*byte));
    if (text.size() > most)
      fail(DeviceErrorKind::protocol, "a reply without an end: " + printable(text));
  }
  fail(DeviceErrorKind::timeout,
       text.empty() ? "no answer in time"
                    : "only the beginning of an answer came in time: " + printable(text));
}

// A deadline of now reads only what has arrived already.
void Dialogue::discard() {
  for (int i = 0; i < kMostChunks && fill(clock_.now()); ++i) arrived_.clear();
}

void Dialogue::settle(Time silence) {
  const Time end = later(clock_.now(), 50 * silence);
  // Each byte begins the silence anew; the end bounds an instrument that never falls silent.
  while (clock_.now() < end && fill(later(clock_.now(), silence))) arrived_.clear();
}

// Only the link is opened: the driver configures the instrument anew, for it may have lost its
// power.
void Dialogue::reopen() {
  lost_ = false;  // or guarded() would refuse the attempt
  arrived_.clear();
  try {
    guarded([&] { link_->reopen(); });
  } catch (const DeviceError&) {
    lost_ = true;
    throw;
  }
}

// Replies in messages come from a device: control characters must not reach a terminal.
std::string printable(std::span<const std::uint8_t> bytes) {
  constexpr std::size_t kMost = 40;
  std::string text;
  for (const std::uint8_t byte : bytes.first(std::min(bytes.size(), kMost))) {
    if (byte >= 0x20 && byte < 0x7F) {
      text.push_back(static_cast<char>(byte));
      continue;
    }
    std::array<char, 5> hex{};
    std::snprintf(hex.data(), hex.size(), "\\x%02X", byte);
    text += hex.data();
  }
  return bytes.size() > kMost ? text + "..." : text;
}
std::string printable(std::string_view text) { return printable(bytes_of(text)); }

}  // namespace vitreo
