// BOP behind the kernel's own /dev/ttyACM0: line settings, who owns it, what a hang-up is.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/kepco_bop/driver.h"
#include "devices/links/node_lock.h"
#include "devices/links/serial_link.h"
#include "tests/kernel/guest.h"

#include <gtest/gtest.h>

#include <cerrno>
#include <fcntl.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <thread>
#include <unistd.h>

namespace vitreo::kernel_guest {
namespace {

constexpr const char* kNode = "/dev/ttyACM0";

class SerialGuest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    load_gadgets();
    load({"usb_f_acm", "cdc-acm"});
    device = std::make_unique<Gadget>(std::vector<std::string>{"acm", "kepco_bop"});
    wait_for_node(kNode);
  }
  static void TearDownTestSuite() { device.reset(); }
  void SetUp() override {
    device->order({{"mode", {{"late", 0.0}}}});
    device->order({{"power_cycle", true}});
  }
  std::unique_ptr<ByteLink> line(int baud_rate) {
    SerialSettings settings;
    settings.baud_rate = baud_rate;
    settings.xon_xoff = true;
    return open_serial(kNode, settings, *clock);
  }
  std::unique_ptr<CoilAmplifier> supply() {
    std::vector<std::unique_ptr<ByteLink>> links;
    links.push_back(line(19200));
    return kepco_bop::open(std::move(links), {}, *clock);
  }
  static std::unique_ptr<Gadget> device;
  const std::unique_ptr<Clock> clock = wall_clock();
};
std::unique_ptr<Gadget> SerialGuest::device;

/// As the kernel has them; root may open what TIOCEXCL has closed to others.
termios present() {
  termios now{};
  const int node = ::open(kNode, O_RDONLY | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  EXPECT_EQ(::tcgetattr(node, &now), 0);
  ::close(node);
  return now;
}

TEST_F(SerialGuest, TheLineIsAsItWasAskedFor) {
  SerialSettings settings{
      .baud_rate = 19200, .data_bits = 7, .parity = Parity::odd, .xon_xoff = true};
  const auto link = open_serial(kNode, settings, *clock);
  const termios now = present();
  EXPECT_EQ(::cfgetospeed(&now), static_cast<speed_t>(B19200));
  EXPECT_EQ(now.c_cflag & CSIZE, static_cast<tcflag_t>(CS7));
  EXPECT_EQ(now.c_cflag & (PARENB | PARODD | CSTOPB | CRTSCTS),
            static_cast<tcflag_t>(PARENB | PARODD));
  EXPECT_EQ(now.c_iflag & (IXON | IXOFF), static_cast<tcflag_t>(IXON | IXOFF));
  EXPECT_EQ(now.c_lflag & (ICANON | ECHO | ISIG), 0U);
}

TEST_F(SerialGuest, ACurrentIsSetAndMeasured) {
  const auto coils = supply();
  for (const double current : {1.0, -2.5, 0.0}) {
    coils->set_currents(std::vector{current});
    EXPECT_NEAR(device->state("current").get<double>(), current, 2e-3);
    EXPECT_NEAR(coils->measured_currents()->at(0), current, 0.05);
  }
}

/// What a second opener is told; "opened" would be wrong.
std::string try_line(Clock& clock) {
  SerialSettings fast;
  fast.baud_rate = 115200;
  try {
    open_serial(kNode, fast, clock);
  } catch (const OwnedError& error) {
    return std::string("OWNED ") + error.what();
  }
  return "opened";
}

// The answer is on its way while the others come: it must arrive whole, at the rate that it had.
TEST_F(SerialGuest, ASecondOpenerIsRefusedBeforeItTouchesTheLine) {
  const auto first = line(19200);
  device->order({{"mode", {{"late", 0.3}}}});
  const std::string question = "*IDN?\n";
  first->write({reinterpret_cast<const std::uint8_t*>(question.data()), question.size()},
               from_seconds(1));
  for (const uid_t user : {uid_t{0}, kOperator}) {
    const std::string said = elsewhere(user, [&] { return try_line(*clock); });
    EXPECT_EQ(said.substr(0, 5), "OWNED") << said;
    row("second opener at 115200 baud, uid %u: %s", user, said.c_str());
  }
  const std::string foreign = elsewhere(kOperator, [] {
    const int node = ::open(kNode, O_RDWR | O_NOCTTY | O_NONBLOCK);
    return node >= 0 ? std::string("opened") : std::string(std::strerror(errno));
  });
  EXPECT_EQ(foreign, "Device or resource busy");
  row("a program that asks for no lock: %s", foreign.c_str());
  std::this_thread::sleep_for(600ms);
  std::string answer;
  for (std::vector<std::uint8_t> some; !(some = first->read(64, from_seconds(0.2))).empty();)
    answer.append(some.begin(), some.end());
  EXPECT_NE(answer.find("KEPCO,BOP1KW 50-20 ,E156884, 2.01"), std::string::npos) << answer;
  const termios now = present();
  EXPECT_EQ(::cfgetospeed(&now), static_cast<speed_t>(B19200));
}

TEST_F(SerialGuest, APulledCableIsANamedErrorAndOpensAnewAtZero) {
  auto coils = supply();
  coils->set_currents(std::vector{1.0});
  const auto began = Steady::now();
  device->unplug();
  std::string said;
  while (said.empty() && Steady::now() - began < 5s) try {
      coils->measured_currents();
    } catch (const DeviceError& error) {
      said = error.what();
      EXPECT_EQ(error.kind, DeviceErrorKind::lost) << said;
    }
  const double took = Milliseconds(Steady::now() - began).count();
  row("cable out: \"%s\" after %.1f ms", said.c_str(), took);
  EXPECT_LT(took, 100);
  EXPECT_NE(said.find(kNode), std::string::npos) << said;
  EXPECT_NEAR(device->state("current").get<double>(), 1, 2e-3);  // it has no watchdog
  coils.reset();
  device->plug();
  wait_for_node(kNode);
  coils = supply();
  EXPECT_NEAR(device->state("current").get<double>(), 0, 2e-3);
}

}  // namespace
}  // namespace vitreo::kernel_guest
