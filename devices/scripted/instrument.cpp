// SPDX-License-Identifier: Apache-2.0
#include "devices/scripted/instrument.h"

#include "devices/links/printable.h"
#include "devices/scripted/connection.h"
#include "devices/scripted/conversion.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace vitreo::scripted {
namespace {

/// Between two attempts to ask for what cannot be had now.
constexpr Time kRetry = std::chrono::seconds(1);
/// Between two questions whether a command has ended.
constexpr Time kLook = std::chrono::milliseconds(50);

class ScriptedInstrument final : public Instrument {
 public:
  explicit ScriptedInstrument(Opening opening)
      : clock_(opening.clock),
        connection_(std::move(opening.loaded), std::move(opening.link), opening.name,
                    opening.clock),
        info_(info_of(connection_.declaration())),
        latest_(info_.quantities.size()) {
    info_.identity = connection_.identity();
    const bool polls =
        std::any_of(info_.quantities.begin(), info_.quantities.end(),
                    [](const QuantityInfo& one) { return one.every > Time::zero(); });
    if (polls) poll_ = clock_.spawn("poll " + opening.name, [this] { poll(); });
  }
  ~ScriptedInstrument() override {
    // First: a poll in the middle of a question would hold the turn that make_safe() needs.
    poll_.reset();
    try {
      if (!connection_.dialogue().lost()) make_safe();
    } catch (...) {  // a destructor cannot report it
    }
  }
  ScriptedInstrument(const ScriptedInstrument&) = delete;
  ScriptedInstrument& operator=(const ScriptedInstrument&) = delete;

  const InstrumentInfo& info() const override { return info_; }
  Latest latest(std::size_t index) const override { return latest_.at(index); }
  void on_poll(PollListener listener) override { listener_ = std::move(listener); }
  QuantitySample read(std::size_t index, Time timeout) override;
  void set(std::size_t index, const QuantityValue& value) override;
  void command(std::size_t index, const std::vector<QuantityValue>& arguments) override;
  void make_safe() override;

 private:
  void poll();
  Exchange& exchange() { return connection_.exchange(); }
  const std::string& name() { return connection_.dialogue().device(); }
  void confirm(const std::string& expects);
  QuantityValue converted(const PropertyDeclaration& property, const QuantityValue& said);

  Clock& clock_;
  Connection connection_;
  InstrumentInfo info_;
  std::vector<Latest> latest_;
  PollListener listener_;
  std::unique_ptr<Task> poll_;  // last: it uses the others
};

/// An answer's text, or what a function of the file returned in the declared unit.
QuantityValue ScriptedInstrument::converted(const PropertyDeclaration& property,
                                            const QuantityValue& said) {
  const auto* const text = std::get_if<std::string>(&said);
  const bool from_function = std::holds_alternative<Reference>(property.ask);
  // Registers have their number from the bits; texts from a pattern, or from what looks like a
  // number in it; functions of the file give values in the declared unit.
  if (property.held && !from_function) {
    const auto value = text == nullptr ? std::nullopt : value_in(*property.held, *text);
    if (!value)
      connection_.dialogue().fail(DeviceErrorKind::protocol,
                                  property.info.name + ": is no answer to its register");
    const auto* const number = std::get_if<double>(&*value);
    return number == nullptr ? *value : property.unit.to_si(*number);
  }
  if (text != nullptr &&
      (!from_function || property.info.type != QuantityType::text || !property.choices.empty())) {
    std::string part = *text;
    if (!property.answer.empty()) {
      const auto found = exchange().found(*text, property.answer);
      if (!found)
        connection_.dialogue().fail(DeviceErrorKind::protocol,
                                    property.info.name + ": not understood: " + printable(*text));
      part = found->front();
    }
    const auto value = value_of(property, part);
    if (!value)
      connection_.dialogue().fail(DeviceErrorKind::protocol,
                                  property.info.name + ": not understood: " + printable(*text));
    return *value;
  }
  if (const auto* number = std::get_if<double>(&said);
      number != nullptr && property.info.type == QuantityType::number)
    return property.unit.to_si(*number);
  if (const auto* list = std::get_if<std::vector<double>>(&said);
      list != nullptr && property.info.type == QuantityType::numbers) {
    std::vector<double> all = *list;
    for (double& one : all) one = property.unit.to_si(one);
    return all;
  }
  if (std::holds_alternative<bool>(said) && property.info.type == QuantityType::flag) return said;
  if (text != nullptr && property.info.type == QuantityType::text) return said;
  connection_.dialogue().fail(DeviceErrorKind::protocol,
                              property.info.name + ": its driver gave a value of another type");
}

QuantitySample ScriptedInstrument::read(std::size_t index, Time timeout) {
  const PropertyDeclaration& property = connection_.declaration().properties.at(index);
  if (!property.info.readable)
    throw std::invalid_argument(property.info.name + ": can only be set");
  // Asked before the turn, which defers every stop.
  const bool hears = Exchange::hears(clock_);
  const Dialogue::Turn turn(connection_.dialogue());
  // Reading leaves nothing half done, so a stop may break it off while the file's function sleeps.
  const Exchange::Breakable breakable(exchange(), hears);
  connection_.be_open();
  const Time began = clock_.now();
  const Exchange::Deadline limit(exchange(), later(began, timeout));
  const auto said = exchange().perform(property.ask, {}, true,
                                       std::min(timeout, connection_.declaration().link.timeout));
  if (!said)
    connection_.dialogue().fail(DeviceErrorKind::protocol,
                                property.info.name + ": its driver gave no value");
  const Time ended = clock_.now();
  return {index, converted(property, *said), began + (ended - began) / 2, (ended - began) / 2};
}

/// The answer to a command, where the file says that there is one.
void ScriptedInstrument::confirm(const std::string& expects) {
  if (!expects.empty()) {
    const std::string said =
        exchange().receive(later(clock_.now(), connection_.declaration().link.timeout));
    if (!exchange().found(said, expects))
      connection_.dialogue().fail(DeviceErrorKind::refused, "it answers " + printable(said));
  }
  exchange().check_errors();
}

void ScriptedInstrument::set(std::size_t index, const QuantityValue& value) {
  const PropertyDeclaration& property = connection_.declaration().properties.at(index);
  if (!property.info.settable)
    throw std::invalid_argument(property.info.name + ": can only be read");
  check_value(property.info, value, name());
  const Dialogue::Turn turn(connection_.dialogue());
  connection_.be_open();
  exchange().set(property, to_declared(value, property.unit, property.choices));
  confirm(property.expects);
}

void ScriptedInstrument::command(std::size_t index, const std::vector<QuantityValue>& arguments) {
  const CommandDeclaration& command = connection_.declaration().commands.at(index);
  if (arguments.size() != command.info.arguments.size())
    throw std::invalid_argument(command.info.name + ": wants " +
                                std::to_string(command.info.arguments.size()) + " arguments");
  // All arguments are checked before the first byte is sent.
  std::vector<QuantityValue> declared;
  for (std::size_t i = 0; i < arguments.size(); ++i) {
    check_value(command.info.arguments[i], arguments[i], name());
    declared.push_back(to_declared(arguments[i], command.units[i], command.choices[i]));
  }
  const Time deadline = later(clock_.now(), command.info.longest);
  {
    const Dialogue::Turn turn(connection_.dialogue());
    connection_.be_open();
    exchange().perform(command.send, declared, false);
    confirm(command.expects);
  }
  // Between the questions others have their turn, and a stop is felt.
  while (command.done) {
    {
      const Dialogue::Turn turn(connection_.dialogue());
      const auto done = exchange().call(command.done, {});
      if (done && std::holds_alternative<bool>(*done) && std::get<bool>(*done)) return;
    }
    if (clock_.now() >= deadline)
      connection_.dialogue().fail(DeviceErrorKind::timeout,
                                  command.info.name + " has not ended in time");
    clock_.sleep_for(kLook);
  }
}

// One that has no safe state need not be there for it.
void ScriptedInstrument::make_safe() {
  if (!has_safe_state(connection_.declaration())) return;
  const Dialogue::Turn turn(connection_.dialogue());
  connection_.be_open();
  exchange().make_safe();
}

/// One question at a time, each at its own pace; what was missed is not made up for.
void ScriptedInstrument::poll() {
  std::vector<Time> due(info_.quantities.size(), kForever);
  for (std::size_t i = 0; i < due.size(); ++i)
    if (info_.quantities[i].every > Time::zero()) due[i] = clock_.now();
  for (;;) {
    const auto next = std::min_element(due.begin(), due.end());
    const std::size_t index = static_cast<std::size_t>(next - due.begin());
    clock_.sleep_until(*next);
    Time pause = info_.quantities[index].every;
    try {
      const QuantitySample sample = read(index, connection_.declaration().link.timeout);
      latest_[index] = {sample, ""};
    } catch (const DeviceError& error) {
      latest_[index].fault = error.text;
      pause = std::max(pause, kRetry);
    } catch (const std::runtime_error& error) {  // of the host: the poll goes on
      latest_[index].fault = error.what();
      pause = std::max(pause, kRetry);
    }
    if (listener_) listener_(index, latest_[index]);
    // A pace that is kept on the mean, without a burst after a stall.
    *next = std::max(later(*next, pause), clock_.now());
  }
}

}  // namespace

InstrumentInfo info_of(const Declaration& declaration) {
  InstrumentInfo info;
  info.kind = declaration.kind;
  info.measures = declaration.measures;
  info.on_silence = declaration.on_silence;
  for (const PropertyDeclaration& one : declaration.properties) info.quantities.push_back(one.info);
  for (const CommandDeclaration& one : declaration.commands) info.commands.push_back(one.info);
  return info;
}

std::unique_ptr<Instrument> open_instrument(Opening opening) {
  return std::make_unique<ScriptedInstrument>(std::move(opening));
}

}  // namespace vitreo::scripted
