// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/scpi_probe/driver.h"

#include "devices/instruments/scpi_probe/wire.h"
#include "devices/links/dialogue.h"
#include "devices/time/error.h"

#include <cmath>
#include <stdexcept>
#include <utility>

namespace vitreo::scpi_probe {
namespace {

/// Of everything but a measurement, whose deadline is the caller's.
constexpr Time kReplyTimeout = std::chrono::seconds(1);
/// After which nothing more of an older answer comes.
constexpr Time kSilence = std::chrono::milliseconds(30);

// Commands beyond *IDN?, *CLS and SYST:ERR? come from the rig file, so one driver serves many
// makers.
class Probe final : public FieldProbe {
 public:
  Probe(std::unique_ptr<ByteLink> link, const Settings& settings, Clock& clock)
      : settings_(settings), dialogue_(std::move(link), settings.name, clock) {
    const Dialogue::Turn turn(dialogue_);
    info_ = {dialogue_.opening([this] { return configure(); }), settings.axes, settings.range};
  }
  const FieldProbeInfo& info() const override { return info_; }
  FieldReading measure(Time timeout) override;

 private:
  std::string ask(const std::string& question, Time timeout);
  void send(const std::string& line);
  Identity configure();

  const Settings settings_;
  Dialogue dialogue_;
  FieldProbeInfo info_;
  bool unsure_ = true;  // an older answer may still come
  Time sent_{};         // when the last line left
  Time asked_{};        // when the last question was with the kernel
  Time answered_{};     // when the first byte of its answer came
};

/// One line, one answer. Where the last answer did not come in time it may come now, and would be
/// taken for that of this question: so the line must be silent first. Empty lines are skipped.
std::string Probe::ask(const std::string& question, Time timeout) {
  const Time deadline = later(dialogue_.clock().now(), timeout);
  if (unsure_) dialogue_.settle(kSilence);
  dialogue_.discard();
  unsure_ = true;
  send(question);
  asked_ = dialogue_.clock().now();
  dialogue_.await(deadline);
  answered_ = dialogue_.clock().now();
  for (;;) {
    std::string line = scpi::trimmed(dialogue_.line('\n', kMaxAnswer, deadline));
    if (line.empty()) continue;
    unsure_ = false;
    return line;
  }
}

void Probe::send(const std::string& line) {
  Clock& clock = dialogue_.clock();
  if (settings_.pause > 0 && sent_ != Time{})
    clock.sleep_until(later(sent_, from_seconds(settings_.pause)));
  dialogue_.send(line + "\n");
  sent_ = clock.now();
}

/// Identity, then a clean error queue, the rig file's setup, and whether that was accepted: set
/// commands have no answers of their own.
Identity Probe::configure() {
  unsure_ = true;
  const std::string said = ask("*IDN?", kReplyTimeout);
  const auto who = scpi::identity(said);
  if (!who || who->name.find(settings_.model) == std::string::npos)
    dialogue_.fail(DeviceErrorKind::not_found,
                   "this is no " + (settings_.model.empty() ? "probe" : settings_.model) + ": " +
                       printable(said));
  dialogue_.identified();
  if (!settings_.error_question.empty()) send("*CLS");
  for (const std::string& line : scpi::parts(settings_.setup, '|'))
    if (!line.empty()) send(line);
  if (settings_.error_question.empty()) return *who;
  const auto error = scpi::error(ask(settings_.error_question, kReplyTimeout));
  if (!error) dialogue_.fail(DeviceErrorKind::protocol, "its error queue cannot be read");
  if (error->code != 0)
    dialogue_.fail(DeviceErrorKind::refused,
                   "it does not take its setup: " + printable(error->text));
  return *who;
}

/// The instrument measures between the question's end and the answer's first byte; when in between
/// it does not say, so the reading is of the middle, within half of that.
/// Overload is told by a number of its own (kOverload), before the unit is applied to it.
FieldReading Probe::measure(Time timeout) {
  const Dialogue::Turn turn(dialogue_);
  dialogue_.be_open(info_.identity, [this] { return configure(); });
  const std::string said = ask(settings_.question, timeout);
  const auto field = decode_field(said, static_cast<std::size_t>(settings_.axes));
  if (!field)
    dialogue_.fail(DeviceErrorKind::protocol,
                   "not " + std::to_string(settings_.axes) + " numbers: " + printable(said));
  FieldReading reading{{}, asked_ + (answered_ - asked_) / 2, (answered_ - asked_) / 2};
  for (const double component : *field) {
    if (std::abs(component) >= kOverload || std::abs(component * settings_.unit) > settings_.range)
      dialogue_.fail(DeviceErrorKind::refused, "the field is beyond its range: " + printable(said));
    reading.field.push_back(component * settings_.unit);
  }
  return reading;
}

}  // namespace

void Settings::check() const {
  if (name.empty()) throw std::invalid_argument("name: must not be empty");
  if (question.empty() || question.size() > 80)
    throw std::invalid_argument("question: must have 1 to 80 characters");
  if (!std::isfinite(pause) || pause < 0 || pause > 10)
    throw std::invalid_argument("pause: must be 0 to 10 s");
  if (axes != 1 && axes != 3) throw std::invalid_argument("axes: must be 1 or 3");
  if (!std::isfinite(unit) || unit == 0)
    throw std::invalid_argument("unit: must be a number other than zero");
  if (!std::isfinite(range) || range <= 0) throw std::invalid_argument("range: must be positive");
}

std::unique_ptr<FieldProbe> open(std::unique_ptr<ByteLink> link, const Settings& settings,
                                 Clock& clock) {
  settings.check();
  return std::make_unique<Probe>(std::move(link), settings, clock);
}

}  // namespace vitreo::scpi_probe
