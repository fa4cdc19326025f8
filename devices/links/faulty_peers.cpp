// SPDX-License-Identifier: Apache-2.0
#include "devices/links/faulty_peers.h"

#include <algorithm>
#include <utility>

namespace vitreo {

void spoil(const LinkFaults& faults, std::vector<std::uint8_t>& bytes) {
  if (faults.keep >= 0 && bytes.size() > static_cast<std::size_t>(faults.keep))
    bytes.resize(static_cast<std::size_t>(faults.keep));
  if (faults.garble >= 0 && bytes.size() > static_cast<std::size_t>(faults.garble))
    bytes[static_cast<std::size_t>(faults.garble)] ^= faults.flip;
}

// What it said before is not changed by what it hears now, and comes before the echo.
void FaultyBytePeer::receive(std::span<const std::uint8_t> bytes, Time now) {
  touched_ = true;
  collect(now);
  if (faults_.off) return;
  if (faults_.echo) put(now, {bytes.begin(), bytes.end()});
  if (faults_.deaf) return;
  answered_ = 0;
  instrument_->receive(bytes, now);
}

std::vector<TimedBytes> FaultyBytePeer::say(Time now) {
  collect(now);
  std::vector<TimedBytes> said;
  while (!coming_.empty() && coming_.front().at <= now) {
    said.push_back(std::move(coming_.front()));
    coming_.pop_front();
  }
  return said;
}

Time FaultyBytePeer::next() const {
  const Time due = instrument_->next();
  return coming_.empty() ? due : std::min(due, coming_.front().at);
}

void FaultyBytePeer::collect(Time now) {
  for (const TimedBytes& said : instrument_->say(now)) {
    if (faults_.silent || faults_.off) continue;
    ByteString bytes;
    for (std::uint8_t byte : said.bytes) {
      const int number = answered_++;
      if (faults_.keep >= 0 && number >= faults_.keep) continue;
      if (number == faults_.garble) byte ^= faults_.flip;
      bytes.push_back(byte);
    }
    if (!bytes.empty()) put(later(said.at, faults_.late), std::move(bytes));
  }
}

/// A wire keeps the order, also when what was late is late no more.
void FaultyBytePeer::put(Time at, ByteString bytes) {
  if (!coming_.empty()) at = std::max(at, coming_.back().at);
  coming_.push_back({at, std::move(bytes)});
}

void FaultyHidPeer::serve() {
  while (!late_.empty() && late_.front().due <= clock_.now()) {
    if (send_) send_(std::move(late_.front().report));
    late_.pop_front();
  }
}

std::vector<std::vector<std::uint8_t>> FaultyHidPeer::receive(
    std::span<const std::uint8_t> report) {
  touched_ = true;
  if (faults_.deaf) return {};
  std::vector<std::vector<std::uint8_t>> now;
  for (auto& reply : instrument_.receive(report))
    if (auto left = passed(std::move(reply))) now.push_back(std::move(*left));
  return now;
}

void FaultyHidPeer::connect(const Send& send) {
  send_ = send;
  late_.clear();
  if (!send) return instrument_.connect(nullptr);
  instrument_.connect([this](std::vector<std::uint8_t> report) {
    if (auto left = passed(std::move(report))) send_(std::move(*left));
  });
}

/// What of a report comes now. Reports keep their order: behind a late one all wait.
std::optional<std::vector<std::uint8_t>> FaultyHidPeer::passed(std::vector<std::uint8_t> report) {
  if (faults_.silent) return std::nullopt;
  spoil(faults_, report);
  if (faults_.late == Time::zero() && late_.empty()) return report;
  Time due = later(clock_.now(), faults_.late);
  if (!late_.empty()) due = std::max(due, late_.back().due);
  late_.push_back({due, std::move(report)});
  return std::nullopt;
}

std::optional<std::vector<std::uint8_t>> FaultyUsbPeer::control(const UsbSetup& setup,
                                                                std::span<const std::uint8_t> data,
                                                                std::uint16_t length) {
  touched_ = true;
  auto answer = instrument_.control(setup, data, length);
  if (answer) spoil(faults_, *answer);
  return answer;
}

}  // namespace vitreo
