// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/instrument.h"

#include "devices/contract/examination.h"
#include "devices/time/error.h"

#include <cmath>
#include <set>
#include <stdexcept>

namespace vitreo::contract {
namespace {

constexpr Time kReading = std::chrono::seconds(10);

struct InstrumentSuite : Examination<InstrumentSuite> {
  explicit InstrumentSuite(Instrument& its) : instrument(its) {}
  Instrument& instrument;

  void leave_safe() { instrument.make_safe(); }

  void states_itself() {
    const InstrumentInfo& info = instrument.info();
    expect(!info.identity.name.empty(), "info: has no identity");
    expect(!info.kind.empty(), "info: has no kind");
    std::set<std::string> names;
    for (const QuantityInfo& one : info.quantities) {
      expect(names.insert(one.name).second, "info: has two quantities called " + one.name);
      expect(one.readable || one.settable, "info: " + one.name + " can neither be read nor set");
    }
  }

  static bool fits(const QuantityInfo& info, const QuantityValue& value) {
    switch (info.type) {
      case QuantityType::number:
        return std::holds_alternative<double>(value) && std::isfinite(std::get<double>(value));
      case QuantityType::flag:
        return std::holds_alternative<bool>(value);
      case QuantityType::text:
        return std::holds_alternative<std::string>(value);
      case QuantityType::numbers:
        return std::holds_alternative<std::vector<double>>(value);
    }
    return false;
  }

  void reads_what_it_declares() {
    const auto& all = instrument.info().quantities;
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (!all[i].readable) continue;
      const QuantitySample sample = instrument.read(i, kReading);
      expect(fits(all[i], sample.value), "read: " + all[i].name + " is of another type");
      expect(sample.quantity == i, "read: " + all[i].name + " comes back as another quantity");
      expect(sample.within >= Time::zero(), "read: the moment of " + all[i].name + " is not known");
    }
  }

  template <class Work>
  bool refuses(const Work& work) {
    try {
      work();
    } catch (const DeviceError& error) {
      return error.kind == DeviceErrorKind::out_of_range;
    } catch (const std::invalid_argument&) {
      return true;
    }
    return false;
  }

  void refuses_what_is_beyond() {
    const auto& all = instrument.info().quantities;
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (!all[i].settable) {
        expect(refuses([&] { instrument.set(i, 0.0); }),
               "set: " + all[i].name + " cannot be set, and was");
      } else if (all[i].type == QuantityType::number) {
        const double beyond = all[i].max + 1 + std::abs(all[i].max);
        expect(refuses([&] { instrument.set(i, beyond); }),
               "set: " + all[i].name + " was set beyond its bounds");
        expect(refuses([&] { instrument.set(i, std::nan("")); }),
               "set: " + all[i].name + " was set to what is no number");
      }
    }
  }

  void is_safe_twice() {
    instrument.make_safe();
    instrument.make_safe();
  }
};

}  // namespace

std::vector<std::string> check(Instrument& instrument) {
  InstrumentSuite suite(instrument);
  suite.duty("info", &InstrumentSuite::states_itself);
  suite.duty("read", &InstrumentSuite::reads_what_it_declares);
  suite.duty("set", &InstrumentSuite::refuses_what_is_beyond);
  suite.duty("make_safe", &InstrumentSuite::is_safe_twice);
  return suite.findings;
}

}  // namespace vitreo::contract
