// The role of an instrument that plays none of the others: a heater, a pump, a chiller's contact;
// named quantities that can be read or set, and commands, all declared with unit, bounds and help.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"
#include "devices/time/identity.h"

#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace vitreo {

enum class QuantityType { number, flag, text, numbers };

/// A number in the SI unit that is declared with it, as a list of numbers is.
using QuantityValue = std::variant<double, bool, std::string, std::vector<double>>;

/// What an instrument has and a script can read or set, or an argument of a command.
struct QuantityInfo {
  std::string name;
  QuantityType type = QuantityType::number;
  std::string unit{};  ///< SI; "" for plain numbers
  std::string help{};
  bool readable = false;
  bool settable = false;
  double min = -std::numeric_limits<double>::infinity();  ///< SI, inclusive; of what is set
  double max = std::numeric_limits<double>::infinity();
  std::vector<std::string> choices{};  ///< of a text that is set; empty: any
  Time every{};                        ///< it is asked for so often by itself; zero: only when read
};

struct CommandInfo {
  std::string name;
  std::string help{};
  std::vector<QuantityInfo> arguments{};
  Time longest{};  ///< it ends, or has failed, within this
};

/// What it means for a run that the instrument cannot be asked any more for what is asked for by
/// itself; each does what stands before it, too.
enum class OnSilence { note, alarm, stop, abort };

struct InstrumentInfo {
  Identity identity;
  std::string kind;      ///< a free one: "sensor", "actuator", "pump", "switch", ...
  std::string measures;  ///< of a sensor or an actuator: "temperature", "flow"; may be empty
  std::vector<QuantityInfo> quantities;
  std::vector<CommandInfo> commands;
  OnSilence on_silence = OnSilence::alarm;
};

/// A value that was read by itself or on demand.
struct QuantitySample {
  std::size_t quantity = 0;  ///< index in InstrumentInfo::quantities
  QuantityValue value;
  Time time{};    ///< the middle between question and answer
  Time within{};  ///< half the width between them
};

/// Every function that talks to the instrument throws DeviceError and Stopped.
class Instrument {
 public:
  virtual ~Instrument() = default;
  virtual const InstrumentInfo& info() const = 0;
  /// Asks for the quantity number `index`; std::invalid_argument for one that is not readable.
  virtual QuantitySample read(std::size_t index, Time timeout) = 0;
  /// Sets it: DeviceError{out_of_range} beyond its bounds, std::invalid_argument for another type
  /// or one that cannot be set; then nothing was sent.
  virtual void set(std::size_t index, const QuantityValue& value) = 0;
  /// Carries the command out, and returns when it has ended. Arguments as for set().
  virtual void command(std::size_t index, const std::vector<QuantityValue>& arguments) = 0;
  /// The newest sample of a quantity, and why there is no newer one; of one that is asked for by
  /// itself. Does not talk to the instrument.
  struct Latest {
    std::optional<QuantitySample> sample{};
    std::string fault{};  ///< why the last attempt failed; empty: it did not
  };
  virtual Latest latest(std::size_t index) const = 0;
  /// Called on the polling task, under the clock's baton, after each attempt to ask for a quantity
  /// by itself. One listener; it must not talk to the instrument.
  using PollListener = std::function<void(std::size_t index, const Latest&)>;
  virtual void on_poll(PollListener listener) = 0;
  /// Its declared safe state: a heater off, a pump stopped. Idempotent.
  virtual void make_safe() = 0;
};

}  // namespace vitreo
