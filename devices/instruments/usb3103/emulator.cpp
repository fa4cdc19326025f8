// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/usb3103/emulator.h"

#include "devices/instruments/usb3103/wire.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <utility>

namespace vitreo::usb3103 {
namespace {

// `latched`: counts that wait for the sync.
struct Channel {
  Range range = Range::zero_to_10_v;
  Calibration calibration;
  std::optional<std::uint16_t> latched;
};

/// Outputs change at unlatched writes, at the sync and at a change of range; never by themselves,
/// for the device has no watchdog.
class EmulatedUsb3103 final : public Emulator {
 public:
  EmulatedUsb3103(const EmulatorSettings& settings, std::function<void(const Voltages&)> on_output,
                  std::function<void(int, bool)> on_line)
      : on_output_(std::move(on_output)),
        on_line_(std::move(on_line)),
        master_(settings.master),
        master_at_first_(settings.master) {
    for (std::size_t i = 0; i < channels_.size(); ++i) {
      // As the flash holds it, in single precision: what the driver reads and what the DAC does are
      // the same number.
      const Calibration calibration{static_cast<float>(settings.slope[i]),
                                    static_cast<float>(settings.offset[i])};
      if (!std::isnormal(calibration.slope) || !std::isfinite(calibration.offset))
        throw std::invalid_argument("slope, offset: channel " + std::to_string(i) +
                                    " has no usable calibration");
      channels_[i].calibration = calibration;
      const auto bytes = encode_calibration(calibration);
      std::copy(bytes.begin(), bytes.end(),
                memory_.begin() + calibration_address(static_cast<int>(i)));
    }
  }

  /// What the device would not understand changes nothing and has no answer.
  std::vector<Report> receive(Bytes report) override {
    const auto command = decode_command(report);
    if (!command) return {};
    return std::visit([this](const auto& what) { return handle(what); }, *command);
  }
  const Voltages& outputs() const override { return outputs_; }
  bool line_is_high(int line) const override {
    return (directions_out_ & levels_ & 1U << line) != 0;
  }
  /// The calibration is in its flash.
  void power_cycle() override {
    for (Channel& channel : channels_)
      channel = {.calibration = channel.calibration, .latched = {}};
    set_lines(0, 0);
    master_ = master_at_first_;
    set({});
  }

 private:
  // Outputs change as a whole, so that the listener never sees half a step.
  std::vector<Report> handle(const AnalogOut& command) {
    Channel& channel = channels_[command.channel];
    if (command.latched) {
      channel.latched = command.counts;
      return {};
    }
    Voltages wanted = outputs_;
    wanted[command.channel] = volts(channel, command.counts);
    set(wanted);
    return {};
  }
  /// All latched values in one step; a slave waits for its sync pin, which nothing drives here.
  std::vector<Report> handle(const AnalogOutSync&) {
    if (!master_) return {};
    Voltages wanted = outputs_;
    for (std::size_t i = 0; i < channels_.size(); ++i)
      if (const auto latched = std::exchange(channels_[i].latched, {}))
        wanted[i] = volts(channels_[i], *latched);
    set(wanted);
    return {};
  }
  /// A new range sets the channel to 0 V, and drops what was latched in the old one.
  std::vector<Report> handle(const AnalogOutConfig& command) {
    channels_[command.channel].range = command.range;
    channels_[command.channel].latched.reset();
    Voltages wanted = outputs_;
    wanted[command.channel] = 0;
    set(wanted);
    return {};
  }
  // What is latched stays: the role decides only whether a sync takes it.
  std::vector<Report> handle(const SetSync& command) {
    master_ = command.master;
    return {};
  }
  /// Beyond the memory it reads zeros.
  std::vector<Report> handle(const MemoryRead& command) {
    Report bytes(command.count, 0);
    for (std::size_t i = 0; i < bytes.size(); ++i)
      if (command.address + i < memory_.size()) bytes[i] = memory_[command.address + i];
    return {encode_memory(bytes)};
  }
  std::vector<Report> handle(const GetStatus&) { return {encode_status({master_})}; }

  std::vector<Report> handle(const DigitalConfig& command) {
    set_lines(with_bit(directions_out_, command.line, !command.input), levels_);
    return {};
  }
  std::vector<Report> handle(const DigitalOut& command) {
    set_lines(directions_out_, with_bit(levels_, command.line, command.high));
    return {};
  }

  static unsigned with_bit(unsigned bits, int bit, bool on) {
    return on ? bits | 1U << bit : bits & ~(1U << bit);
  }
  /// Reports what changes at the terminals.
  void set_lines(unsigned directions_out, unsigned levels) {
    const unsigned changed = (directions_out & levels) ^ (directions_out_ & levels_);
    directions_out_ = directions_out;
    levels_ = levels;
    for (int line = 0; on_line_ && line < kDigitalLines; ++line)
      if ((changed & 1U << line) != 0) on_line_(line, line_is_high(line));
  }
  static double volts(const Channel& channel, std::uint16_t counts) {
    return volts_from_counts(counts, channel.range, channel.calibration);
  }
  /// Reports a change at the terminals, and only a change.
  void set(const Voltages& wanted) {
    if (wanted == outputs_) return;
    outputs_ = wanted;
    if (on_output_) on_output_(outputs_);
  }

  std::function<void(const Voltages&)> on_output_;
  std::function<void(int, bool)> on_line_;
  bool master_;
  const bool master_at_first_;
  std::array<Channel, kChannels> channels_;
  std::array<std::uint8_t, 0x300> memory_{};
  Voltages outputs_{};
  unsigned directions_out_ = 0;  // a bit a digital line that is an output
  unsigned levels_ = 0;
};

}  // namespace

std::unique_ptr<Emulator> make_emulator(const EmulatorSettings& settings,
                                        std::function<void(const Voltages&)> on_output,
                                        std::function<void(int, bool)> on_line) {
  return std::make_unique<EmulatedUsb3103>(settings, std::move(on_output), std::move(on_line));
}

}  // namespace vitreo::usb3103
