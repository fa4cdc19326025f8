// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/usb3103/driver.h"

#include "devices/instruments/usb3103/wire.h"
#include "devices/links/printable.h"
#include "devices/time/error.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <stdexcept>
#include <utility>

namespace vitreo::usb3103 {
namespace {

/// V, of either sign.
constexpr double kFullScale = 10;
/// How many reports that are not the answer may come before it.
constexpr int kForeignReports = 32;
constexpr double kLongestReply = 60;  // s

std::string in_short(double number) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%g", number);
  return text.data();
}

class Usb3103 final : public CoilAmplifier {
 public:
  Usb3103(std::unique_ptr<HidLink> link, const Settings& settings, Clock& clock)
      : link_(std::move(link)), settings_(settings), clock_(clock) {
    try {
      configure();
    } catch (const DeviceError& error) {
      fail(error.kind, error.text + "; " + zero_text());
    }
  }
  Usb3103(const Usb3103&) = delete;
  Usb3103& operator=(const Usb3103&) = delete;
  ~Usb3103() override {
    try {
      make_safe();
    } catch (...) {  // a destructor cannot report it; the guardian and the enable line remain
    }
  }

  std::string identity() const override { return "Measurement Computing USB-3103, 8 x +-10 V"; }
  int channels() const override { return kChannels; }
  double current_limit() const override { return settings_.current_limit; }
  std::vector<double> currents() const override { return {currents_.begin(), currents_.end()}; }
  void set_currents(std::span<const double> currents) override;
  // Its outputs cannot be read back: that it still answers is all that can be known.
  std::optional<std::vector<double>> measured_currents() override {
    ask_status();
    return std::nullopt;
  }
  LinkState link_state() const override {
    return {link_->hung_up() ? "the USB-3103" : "", asked_ ? clock_.now() - *asked_ : Time::zero()};
  }
  void make_safe() override;
  EnableLine* enable_line() override { return settings_.heartbeat ? &line_ : nullptr; }

 private:
  /// The enable line on its own; the outputs keep what they have.
  class Line final : public EnableLine {
   public:
    explicit Line(Usb3103& device) : device_(device) {}
    std::string identity() const override {
      return "digital line " + std::to_string(*device_.settings_.enable_line) + " of " +
             device_.identity();
    }
    void set(bool high) override { device_.set_enabled(high); }
    bool high() const override { return device_.enabled_; }
    void make_safe() override { device_.set_enabled(false); }

   private:
    Usb3103& device_;
  };
  void configure();
  std::string zero_text() const;
  void check_identity();
  void become_master();
  void read_calibration();
  void check(std::span<const double> currents) const;
  /// DAC counts for a current: the amplifier's gain is in A/V.
  std::uint16_t counts(int channel, double current) const {
    return counts_from_volts(current / settings_.amperes_per_volt, calibration_[channel]);
  }
  void set_enabled(bool enabled);
  void send(const Command& command);
  Report ask(const Command& command);
  std::optional<Report> read(Time timeout);
  Status ask_status();
  [[noreturn]] void fail(DeviceErrorKind kind, const std::string& what) const {
    throw DeviceError(kind, settings_.name, what);
  }

  /// Throws DeviceError{refused} where make_safe() was called since the set point `order` began.
  void check_order(std::uint64_t order) const {
    if (order != orders_)
      fail(DeviceErrorKind::refused, "was made safe while a set point was on its way");
  }

  std::unique_ptr<HidLink> link_;
  const Settings settings_;
  Clock& clock_;
  std::uint64_t orders_ = 0;   // calls of make_safe(), which overtake a set point
  std::optional<Time> asked_;  // an answer is waited for: another question would take it
  Signal answered_;
  std::array<Calibration, kChannels> calibration_{};
  std::array<double, kChannels> currents_{};  // A
  Line line_{*this};
  bool enabled_ = false;
  int zeroed_ = 0;  // outputs to which a zero was written when it was opened
};

/// Outputs to 0 V and amplifiers off come first, whatever else fails; then what lets all coils step
/// together and exactly.
void Usb3103::configure() {
  check_identity();
  // First of all, for it may still hold the voltages of a host that died: AOutConfig sets the
  // channel to 0 V in its new range.
  for (; zeroed_ < kChannels; ++zeroed_)
    send(AnalogOutConfig{static_cast<std::uint8_t>(zeroed_), Range::plus_minus_10_v});
  if (settings_.enable_line) {
    set_enabled(false);
    send(DigitalConfig{static_cast<std::uint8_t>(*settings_.enable_line), false});
  }
  become_master();
  read_calibration();
  make_safe();
}

/// What is known of its outputs after an opening that failed, and no more.
std::string Usb3103::zero_text() const {
  if (zeroed_ == 0)
    return "no zero was sent to its outputs, so a current that was set before may still flow";
  if (zeroed_ < kChannels)
    return "a zero was sent to " + std::to_string(zeroed_) +
           " of its 8 outputs, so a current may still flow";
  return "zeros were sent to its outputs, and it has no read-back to confirm them";
}

void Usb3103::send(const Command& command) {
  try {
    link_->write(encode(command));
  } catch (const DeviceError& error) {
    throw renamed(error, settings_.name);
  }
}

// Nothing in time is no error here: ask() decides.
std::optional<Report> Usb3103::read(Time timeout) {
  try {
    return link_->read(std::max(timeout, Time::zero()));
  } catch (const DeviceError& error) {
    throw renamed(error, settings_.name);
  }
}

/// Answers carry nothing of the question but its id, so answers to earlier questions are read and
/// dropped first, and another task's question waits until this one has its own.
Report Usb3103::ask(const Command& command) {
  clock_.wait(
      answered_, [this] { return !asked_; }, kForever);
  asked_ = clock_.now();
  struct Answered {
    Usb3103& device;
    ~Answered() {
      device.asked_.reset();
      device.clock_.notify(device.answered_);
    }
  } const answered{*this};
  for (int i = 0; i < kForeignReports && read(Time::zero()); ++i) {
  }
  send(command);
  const std::uint8_t id = encode(command).front();
  const Time deadline = later(clock_.now(), from_seconds(settings_.reply_timeout));
  int foreign = 0;
  Report last;
  for (; foreign < kForeignReports; ++foreign) {
    auto report = read(deadline - clock_.now());
    if (!report) break;
    if (!report->empty() && report->front() == id) return *std::move(report);
    last = *std::move(report);
  }
  const std::string within = " within " + in_short(settings_.reply_timeout) + " s";
  if (foreign == 0) fail(DeviceErrorKind::timeout, "no answer" + within);
  fail(DeviceErrorKind::protocol,
       "only answers to something else" + within + ": \"" + printable(last) + '"');
}

Status Usb3103::ask_status() {
  const Report report = ask(GetStatus{});
  const auto status = decode_status(report);
  if (!status)
    fail(DeviceErrorKind::protocol, "its status is cut short: \"" + printable(report) + '"');
  return *status;
}

/// There is no report for the identity (that of the USB was checked by the link): an answer to
/// GetStatus must do.
void Usb3103::check_identity() {
  try {
    ask_status();
  } catch (const DeviceError& error) {
    if (error.kind != DeviceErrorKind::protocol) throw;
    fail(DeviceErrorKind::not_found, "this is no USB-3103: " + error.text);
  }
}

/// AOutSync has no effect while the sync pin is an input, as it is in a slave
/// (wjasper/Linux_Drivers, usb-3100).
/// In a slave the latched values would never come out.
void Usb3103::become_master() {
  send(SetSync{.master = true});
  if (!ask_status().master)
    fail(DeviceErrorKind::refused, "stays a slave of its sync pin, so coils cannot step together");
}

/// Per channel two little-endian floats in flash: counts = slope k + offset.
void Usb3103::read_calibration() {
  for (int channel = 0; channel < kChannels; ++channel) {
    const Report report = ask(MemoryRead{calibration_address(channel), kCalibrationSize});
    const auto calibration = decode_calibration(report);
    if (!calibration)
      fail(DeviceErrorKind::protocol, "its calibration is cut short: \"" + printable(report) + '"');
    // An erased flash reads as NaN (all bits set): such a device is used as if it were ideal.
    calibration_[channel] = calibration->plausible() ? *calibration : Calibration{};
  }
}

/// Before anything is sent: a refused set-point changes no channel.
void Usb3103::check(std::span<const double> currents) const {
  if (currents.size() != kChannels)
    throw std::invalid_argument("currents: " + settings_.name + " has 8 channels, not " +
                                std::to_string(currents.size()));
  for (std::size_t i = 0; i < currents.size(); ++i)
    if (!std::isfinite(currents[i]))
      throw std::invalid_argument("currents: channel " + std::to_string(i) +
                                  " is not a finite number");
  for (std::size_t i = 0; i < currents.size(); ++i)
    if (std::abs(currents[i]) > settings_.current_limit)
      fail(DeviceErrorKind::refused, in_short(currents[i]) + " A on channel " + std::to_string(i) +
                                         " is beyond the limit of " +
                                         in_short(settings_.current_limit) + " A");
}

// Without a line in the settings there is nothing to switch.
void Usb3103::set_enabled(bool enabled) {
  if (!settings_.enable_line) return;
  enabled_ = enabled_ || enabled;  // from here on it may be
  send(DigitalOut{static_cast<std::uint8_t>(*settings_.enable_line), enabled});
  enabled_ = enabled;
}

/// The eight values are latched one by one (update = 1) and take effect together at AOutSync. A
/// failure in between leaves the old currents flowing. On its frames this takes 11 ms, in which
/// another task may make the device safe: what is latched then never comes out.
void Usb3103::set_currents(std::span<const double> currents) {
  check(currents);
  const std::uint64_t order = orders_;
  if (!enabled_ && !settings_.heartbeat) set_enabled(true);  // at zero, before the step
  for (int channel = 0; channel < kChannels; ++channel) {
    check_order(order);
    send(AnalogOut{static_cast<std::uint8_t>(channel), counts(channel, currents[channel]), true});
  }
  check_order(order);
  std::copy(currents.begin(), currents.end(), currents_.begin());  // from here on they may be out
  send(AnalogOutSync{});
  // Writes are not answered, and outputs cannot be read back: that it still answers is all that can
  // be known. After the sync, so that the coils do not wait for it.
  ask_status();
}

/// Unlatched and channel by channel: each zero that gets through counts. A second round for those
/// that did not. A stop is thrown only when all is done, for the link throws it after the report
/// has left.
void Usb3103::make_safe() {
  ++orders_;
  std::exception_ptr stopped;
  std::exception_ptr failure;
  std::array<bool, kChannels> zeroed{};
  for (int round = 0; round < 2; ++round) {
    failure = nullptr;
    for (int channel = 0; channel < kChannels; ++channel) {
      if (zeroed[channel]) continue;
      try {
        zeroed[channel] = true;
        send(AnalogOut{static_cast<std::uint8_t>(channel), counts(channel, 0), false});
      } catch (const Stopped&) {
        stopped = std::current_exception();
      } catch (...) {
        zeroed[channel] = false;
        failure = std::current_exception();
      }
    }
  }
  // Whatever became of the zeros: without the amplifiers they do not matter.
  try {
    set_enabled(false);
  } catch (const Stopped&) {
    stopped = std::current_exception();
    enabled_ = false;
  } catch (...) {
    failure = std::current_exception();
  }
  if (failure) std::rethrow_exception(failure);
  currents_.fill(0);
  if (stopped) std::rethrow_exception(stopped);
  ask_status();
}

}  // namespace

// The current limit must be within what +-10 V can ask for, so that no set-point below it is out of
// range.
void Settings::check() const {
  const auto positive = [](double value) { return std::isfinite(value) && value > 0; };
  if (name.empty()) throw std::invalid_argument("name: must not be empty");
  if (!positive(amperes_per_volt))
    throw std::invalid_argument("amperes_per_volt: must be positive");
  if (!positive(current_limit)) throw std::invalid_argument("current_limit: must be positive");
  if (current_limit > kFullScale * amperes_per_volt)
    throw std::invalid_argument("current_limit: " + in_short(current_limit) +
                                " A is more than +-10 V can ask for");
  if (!positive(reply_timeout)) throw std::invalid_argument("reply_timeout: must be positive");
  if (reply_timeout > kLongestReply)
    throw std::invalid_argument("reply_timeout: must be at most 60 s");
  if (enable_line && (*enable_line < 0 || *enable_line >= kDigitalLines))
    throw std::invalid_argument("enable_line: must be 0 to 7");
  if (heartbeat && !enable_line)
    throw std::invalid_argument("heartbeat: wants the line that it toggles, enable_line");
}

std::unique_ptr<CoilAmplifier> open(std::unique_ptr<HidLink> link, const Settings& settings,
                                    Clock& clock) {
  if (!link) throw std::invalid_argument("link: must not be null");
  settings.check();
  return std::make_unique<Usb3103>(std::move(link), settings, clock);
}

}  // namespace vitreo::usb3103
