// The enable line on a serial adapter. A pseudo-terminal has no lines RTS and DTR, so a port is put
// in its place; on a pseudo-terminal the driver says so.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/serial_line/driver.h"
#include "devices/links/peer_end.h"
#include "devices/time/error.h"

#include <gtest/gtest.h>

#include <string>
#include <utility>
#include <vector>

namespace vitreo::serial_line {
namespace VITREO_TEST_FILE {

using Levels = std::vector<std::pair<ModemLine, bool>>;

class Port final : public ModemLines {
 public:
  explicit Port(Levels& seen) : seen_(seen) {}
  const std::string& address() const override { return address_; }
  void set(ModemLine line, bool asserted) override {
    if (gone) throw DeviceError(DeviceErrorKind::lost, address_, "No such device");
    seen_.emplace_back(line, asserted);
  }
  static bool gone;

 private:
  Levels& seen_;
  const std::string address_ = "serial:/dev/ttyUSB3";
};
bool Port::gone = false;

TEST(SerialLine, IsLowFromItsOpeningToItsEndButWhenItIsSet) {
  Levels seen;
  {
    const auto line = open(std::make_unique<Port>(seen), {.line = ModemLine::dtr});
    EXPECT_FALSE(line->high());
    line->set(true);
    EXPECT_TRUE(line->high());
    EXPECT_EQ(line->identity(), "DTR of serial:/dev/ttyUSB3");
  }
  EXPECT_EQ(seen,
            (Levels{{ModemLine::dtr, false}, {ModemLine::dtr, true}, {ModemLine::dtr, false}}));
}

TEST(SerialLine, ThatIsGoneIsReportedUnderItsRole) {
  Levels seen;
  const auto line = open(std::make_unique<Port>(seen), {});
  Port::gone = true;
  try {
    line->set(true);
    ADD_FAILURE() << "taken";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.kind, DeviceErrorKind::lost);
    EXPECT_EQ(error.device, "enable_line");
  }
  EXPECT_FALSE(line->high());
  Port::gone = false;
}

TEST(SerialLine, OnAPortWithoutControlLinesIsRefusedByName) {
  const auto clock = wall_clock();
  const auto end = open_pty_end();
  const std::string path = end->address().substr(std::string("serial:").size());
  try {
    open_modem_lines(path, *clock);
    FAIL() << "opened";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.kind, DeviceErrorKind::refused);
    EXPECT_NE(std::string(error.what()).find("has no lines RTS and DTR"), std::string::npos)
        << error.what();
  }
  EXPECT_THROW(open_modem_lines("/dev/there_is_none", *clock), DeviceError);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::serial_line
