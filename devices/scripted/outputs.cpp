// Coil amplifiers and lamps from one Lua file.
// SPDX-License-Identifier: Apache-2.0
#include "devices/scripted/connection.h"
#include "devices/scripted/instrument.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace vitreo::scripted {
namespace {

/// A set-point for one that is gone is refused: only make_safe() opens it again, so that nothing is
/// energized because a cable was put back.
void must_be_there(Connection& connection) {
  if (connection.dialogue().lost()) connection.dialogue().fail(DeviceErrorKind::lost, "it is gone");
}

class ScriptedCoils final : public CoilAmplifier {
 public:
  explicit ScriptedCoils(Opening opening)
      : connection_(std::move(opening.loaded), std::move(opening.link), opening.name,
                    opening.clock),
        currents_(static_cast<std::size_t>(number("channels")), 0) {
    // What flows at opening is not known: it is made zero, so that currents_ holds from then on.
    make_safe();
  }
  // A program that ends leaves no current behind that would go on heating the coils.
  ~ScriptedCoils() override {
    try {
      if (!connection_.dialogue().lost()) make_safe();
    } catch (...) {  // a destructor cannot report it
    }
  }
  ScriptedCoils(const ScriptedCoils&) = delete;
  ScriptedCoils& operator=(const ScriptedCoils&) = delete;

  std::string identity() const override { return to_string(connection_.identity()); }
  int channels() const override { return static_cast<int>(currents_.size()); }
  LinkState link_state() const override { return connection_.link_state(); }
  double current_limit() const override { return number("current_limit"); }
  std::vector<double> currents() const override { return currents_; }

  void set_currents(std::span<const double> currents) override {
    if (currents.size() != currents_.size())
      throw std::invalid_argument("currents: must be " + std::to_string(currents_.size()));
    std::vector<double> declared;
    for (const double current : currents) {
      if (!std::isfinite(current)) throw std::invalid_argument("currents: must be finite");
      // Refused and not clipped: with one current cut the field would point elsewhere.
      if (std::abs(current) > current_limit())
        connection_.dialogue().fail(DeviceErrorKind::refused, "a current is beyond its limit");
      // The file speaks the unit that it declares; everything on this side of it is in A.
      declared.push_back(unit().from_si(current));
    }
    // Everything is checked before the turn: a set-point is sent whole, or not at all.
    const Dialogue::Turn turn(connection_.dialogue());
    must_be_there(connection_);
    call("set_currents", {declared});
    currents_.assign(currents.begin(), currents.end());
  }

  // An instrument that measures nothing is asked who it is: one that is gone shows by that.
  std::optional<std::vector<double>> measured_currents() override {
    const Dialogue::Turn turn(connection_.dialogue());
    must_be_there(connection_);
    Exchange& exchange = connection_.exchange();
    const auto& functions = connection_.declaration().functions;
    if (!functions.contains("measured_currents")) {
      exchange.perform(connection_.declaration().identity, {}, true);
      return std::nullopt;
    }
    const auto said = call("measured_currents", {});
    const auto* const list = said ? std::get_if<std::vector<double>>(&*said) : nullptr;
    if (list == nullptr || list->size() != currents_.size())
      connection_.dialogue().fail(
          DeviceErrorKind::protocol,
          "its driver gave no " + std::to_string(currents_.size()) + " measured currents");
    std::vector<double> measured;
    for (const double current : *list) measured.push_back(unit().to_si(current));
    return measured;
  }

  void make_safe() override {
    const Dialogue::Turn turn(connection_.dialogue());
    connection_.be_open();
    connection_.exchange().make_safe();
    std::fill(currents_.begin(), currents_.end(), 0);
  }

 private:
  double number(const char* name) const { return connection_.declaration().numbers.at(name); }
  const DeclaredUnit& unit() const { return connection_.declaration().unit; }
  /// One whose file fails is made safe by that.
  std::optional<QuantityValue> call(const char* name, const std::vector<QuantityValue>& arguments) {
    try {
      return connection_.exchange().call(connection_.declaration().functions.at(name), arguments);
    } catch (const DeviceError&) {
      if (!connection_.exchange().fault().empty()) std::fill(currents_.begin(), currents_.end(), 0);
      throw;
    }
  }

  Connection connection_;
  std::vector<double> currents_;
};

class ScriptedLamp final : public Lamp {
 public:
  // How bright it is at opening is not known: it is made dark, so that level_ holds from then on.
  explicit ScriptedLamp(Opening opening)
      : connection_(std::move(opening.loaded), std::move(opening.link), opening.name,
                    opening.clock) {
    make_safe();
  }
  ~ScriptedLamp() override {
    try {
      if (!connection_.dialogue().lost()) make_safe();
    } catch (...) {  // a destructor cannot report it
    }
  }
  ScriptedLamp(const ScriptedLamp&) = delete;
  ScriptedLamp& operator=(const ScriptedLamp&) = delete;

  std::string identity() const override { return to_string(connection_.identity()); }
  double level() const override { return level_; }
  LinkState link_state() const override { return connection_.link_state(); }
  void set_level(double level) override {
    // A share of its full level; this form refuses NaN too.
    if (!(level >= 0 && level <= 1)) throw std::invalid_argument("level: must be 0 to 1");
    const Dialogue::Turn turn(connection_.dialogue());
    must_be_there(connection_);
    try {
      connection_.exchange().call(connection_.declaration().functions.at("set_level"), {level});
    } catch (const DeviceError&) {
      // A file that failed has made the lamp safe by that: it is dark.
      if (!connection_.exchange().fault().empty()) level_ = 0;
      throw;
    }
    level_ = level;
  }
  void ask() override {
    const Dialogue::Turn turn(connection_.dialogue());
    must_be_there(connection_);
    connection_.exchange().perform(connection_.declaration().identity, {}, true);
  }
  void make_safe() override {
    const Dialogue::Turn turn(connection_.dialogue());
    connection_.be_open();
    connection_.exchange().make_safe();
    level_ = 0;
  }

 private:
  Connection connection_;
  double level_ = 0;
};

}  // namespace

std::unique_ptr<CoilAmplifier> open_coils(Opening opening) {
  return std::make_unique<ScriptedCoils>(std::move(opening));
}

std::unique_ptr<Lamp> open_lamp(Opening opening) {
  return std::make_unique<ScriptedLamp>(std::move(opening));
}

}  // namespace vitreo::scripted
