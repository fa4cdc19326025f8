// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/serial_line/driver.h"

#include "devices/time/error.h"

#include <stdexcept>
#include <utility>

namespace vitreo::serial_line {
namespace {

class ControlLine final : public EnableLine {
 public:
  ControlLine(std::unique_ptr<ModemLines> lines, Settings settings)
      : lines_(std::move(lines)), settings_(std::move(settings)) {
    set(false);
  }
  ControlLine(const ControlLine&) = delete;
  ControlLine& operator=(const ControlLine&) = delete;
  ~ControlLine() override {
    try {
      set(false);
    } catch (...) {  // a destructor cannot report it; the kernel lowers the line with the close
    }
  }
  std::string identity() const override {
    return std::string(settings_.line == ModemLine::rts ? "RTS" : "DTR") + " of " +
           lines_->address();
  }
  void set(bool high) override {
    try {
      lines_->set(settings_.line, high);
    } catch (const DeviceError& error) {
      throw renamed(error, settings_.name);
    }
    high_ = high;
  }
  bool high() const override { return high_; }
  void make_safe() override { set(false); }

 private:
  const std::unique_ptr<ModemLines> lines_;
  const Settings settings_;
  bool high_ = false;
};

}  // namespace

void Settings::check() const {
  if (name.empty()) throw std::invalid_argument("name: must not be empty");
}

std::unique_ptr<EnableLine> open(std::unique_ptr<ModemLines> lines, const Settings& settings) {
  if (!lines) throw std::invalid_argument("lines: must not be null");
  settings.check();
  return std::make_unique<ControlLine>(std::move(lines), settings);
}

}  // namespace vitreo::serial_line
