// SPDX-License-Identifier: Apache-2.0
#include "devices/links/modbus_emulator.h"

#include <algorithm>
#include <deque>
#include <stdexcept>
#include <utility>

namespace vitreo::modbus {
namespace {

constexpr std::uint8_t kIllegalFunction = 1;
constexpr std::uint8_t kIllegalAddress = 2;
constexpr std::uint8_t kIllegalValue = 3;

Table table_of(std::uint8_t function) {
  switch (function) {
    case 1:
    case 5:
    case 15:
      return Table::coils;
    case 2:
      return Table::discrete_inputs;
    case 4:
      return Table::input_registers;
    default:
      return Table::holding_registers;
  }
}

ByteString exception(std::uint8_t function, std::uint8_t code) {
  return {static_cast<std::uint8_t>(function | kException), code};
}

class LineEmulator final : public BytePeer {
 public:
  LineEmulator(Store& store, const EmulatorSettings& settings)
      : store_(store), settings_(settings) {
    if (settings.delay < Time::zero() || settings.character < Time::zero())
      throw std::invalid_argument("settings: no time may be negative");
  }

  void receive(std::span<const std::uint8_t> bytes, Time now) override {
    if (settings_.framing == Framing::rtu && settings_.character > Time::zero() &&
        now - heard_ > settings_.character * 7 / 2)
      come_.clear();
    heard_ = now;
    come_.insert(come_.end(), bytes.begin(), bytes.end());
    while (settings_.framing == Framing::rtu ? serve_rtu(now) : serve_tcp(now)) {
    }
  }
  std::vector<TimedBytes> say(Time now) override {
    std::vector<TimedBytes> said;
    for (; !answers_.empty() && answers_.front().at <= now; answers_.pop_front())
      said.push_back(std::move(answers_.front()));
    return said;
  }
  Time next() const override { return answers_.empty() ? kForever : answers_.front().at; }
  void power_cycle(Time) override {
    come_.clear();
    answers_.clear();
  }

 private:
  ByteString taken(std::size_t count) {
    ByteString bytes(come_.begin(), come_.begin() + static_cast<std::ptrdiff_t>(count));
    come_.erase(come_.begin(), come_.begin() + static_cast<std::ptrdiff_t>(count));
    return bytes;
  }
  void put(ByteString frame, Time now) {
    answers_.push_back({later(now, settings_.delay), std::move(frame)});
  }

  // Where the function tells no length, a CRC that fits is the end; where the CRC is wrong, or does
  // not come, only a silence helps: all is dropped.
  bool serve_rtu(Time now) {
    constexpr std::size_t kLargest = 256;  // MSL 2.5.1
    auto size = rtu_request_size(come_);
    if (!size && has_right_crc(come_)) size = come_.size();
    if (!size && come_.size() > kLargest) come_.clear();
    if (!size || come_.size() < *size) return false;
    const ByteString frame = taken(*size);
    if (!has_right_crc(frame)) {
      come_.clear();
      return false;
    }
    if (frame[0] != settings_.unit && frame[0] != 0) return true;
    const ByteString answer = answered({frame.begin() + 1, frame.end() - 2}, now);
    if (frame[0] != 0) put(rtu_frame(settings_.unit, answer), now);
    return true;
  }
  bool serve_tcp(Time now) {
    if (come_.size() < kMbap) return false;
    const auto header = parse_mbap(come_);
    if (!header) come_.clear();
    if (!header || come_.size() < kMbap + header->pdu_size) return false;
    const ByteString frame = taken(kMbap + header->pdu_size);
    put(tcp_frame(header->transaction, header->unit,
                  answered({frame.begin() + kMbap, frame.end()}, now)),
        now);
    return true;
  }

  /// The PDU that answers one.
  ByteString answered(const ByteString& pdu, Time now) {
    const std::uint8_t function = pdu[0];
    if ((function < 1 || function > 6) && function != 15 && function != 16)
      return exception(function, kIllegalFunction);
    if (pdu.size() < 5) return exception(function, kIllegalValue);
    const std::uint16_t first = word_at(pdu, 1);
    const std::uint16_t second = word_at(pdu, 3);  // the count, or the value
    if (function <= 4) return read(function, first, second, now);
    std::vector<std::uint16_t> values{second};
    if (function == 5) {
      if (second != 0 && second != 0xFF00) return exception(function, kIllegalValue);
      values = {static_cast<std::uint16_t>(second != 0)};
    } else if (function >= 15) {
      const bool bits = function == 15;
      const std::size_t bytes = bits ? (std::size_t{second} + 7) / 8 : 2 * std::size_t{second};
      if (second < 1 || second > (bits ? 1968 : 123) || pdu.size() != 6 + bytes || pdu[5] != bytes)
        return exception(function, kIllegalValue);
      values = values_in({pdu.begin() + 6, pdu.end()}, bits, second);
    }
    return write(function, first, values, pdu, now);
  }
  static std::vector<std::uint16_t> values_in(const ByteString& data, bool bits, int count) {
    std::vector<std::uint16_t> values;
    if (bits)
      for (const bool bit : unpack_bits(data, count)) values.push_back(bit ? 1 : 0);
    else
      for (std::size_t at = 0; at < data.size(); at += 2) values.push_back(word_at(data, at));
    return values;
  }

  ByteString read(std::uint8_t function, std::uint16_t first, int count, Time now) {
    const bool bits = function <= 2;
    if (count < 1 || count > (bits ? 2000 : 125)) return exception(function, kIllegalValue);
    ByteString data;
    std::vector<bool> flags;
    for (int i = 0; i < count; ++i) {
      const auto value =
          first + i > 0xFFFF
              ? std::nullopt
              : store_.read(table_of(function), static_cast<std::uint16_t>(first + i), now);
      if (!value) return exception(function, kIllegalAddress);
      if (bits)
        flags.push_back(*value != 0);
      else
        put_word(data, *value);
    }
    if (bits) data = pack_bits(flags);
    ByteString answer{function, static_cast<std::uint8_t>(data.size())};
    answer.insert(answer.end(), data.begin(), data.end());
    return answer;
  }
  ByteString write(std::uint8_t function, std::uint16_t first,
                   const std::vector<std::uint16_t>& values, const ByteString& pdu, Time now) {
    if (first + values.size() > 0x10000) return exception(function, kIllegalAddress);
    for (std::size_t i = 0; i < values.size(); ++i)
      if (const std::uint8_t code = store_.write(
              table_of(function), static_cast<std::uint16_t>(first + i), values[i], now);
          code != 0)
        return exception(function, code);
    return {pdu.begin(), pdu.begin() + 5};
  }

  Store& store_;
  const EmulatorSettings settings_;
  ByteString come_;
  Time heard_{};
  std::deque<TimedBytes> answers_;
};

}  // namespace

std::unique_ptr<BytePeer> make_emulator(Store& store, const EmulatorSettings& settings) {
  return std::make_unique<LineEmulator>(store, settings);
}

}  // namespace vitreo::modbus
