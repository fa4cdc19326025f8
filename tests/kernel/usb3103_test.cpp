// USB-3103 on the kernel's own hidraw: what it refuses, who owns it, what a pulled cable is.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/usb3103/driver.h"
#include "devices/links/node_lock.h"
#include "devices/time/error.h"
#include "tests/kernel/guest.h"

#include <gtest/gtest.h>

#include <thread>

namespace vitreo::kernel_guest {
namespace {

class Usb3103Guest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    load_gadgets();
    load({"usb_f_hid", "usbhid", "hid-generic"});
  }
  std::unique_ptr<CoilAmplifier> open(const std::string& address = "hid:09db:009c") {
    return usb3103::open(open_hid_link(parse_usb_address("hid", address), *clock), {}, *clock);
  }
  /// As soon as the kernel has its node.
  std::unique_ptr<CoilAmplifier> open_when_there(const std::string& address = "hid:09db:009c") {
    std::unique_ptr<CoilAmplifier> coils;
    std::string why;
    time_until(5s, [&] {
      try {
        coils = open(address);
      } catch (const DeviceError& error) {
        if (error.kind != DeviceErrorKind::not_found) throw;
        why = error.what();
      }
      return coils != nullptr;
    });
    if (coils == nullptr) throw std::runtime_error(why);
    return coils;
  }
  const std::unique_ptr<Clock> clock = wall_clock();
};

/// Reports that the double refused, and what the kernel said of reports.
void expect_clean(Instrument& double_) {
  const nlohmann::json history = double_.order({{"history", true}});
  for (const nlohmann::json& line : history.at("history"))
    EXPECT_EQ(line[1].get<std::string>().find("refused"), std::string::npos) << line.dump();
  EXPECT_EQ(kernel_log_lines("passed too short report"), 0);
}

void expect_volts(Instrument& double_, const std::vector<double>& wanted) {
  const nlohmann::json volts = double_.state("volts");
  for (std::size_t i = 0; i < wanted.size(); ++i)
    EXPECT_NEAR(volts[i].get<double>(), wanted[i], 4e-4) << "channel " << i;  // a step is 305 uV
}

void set_and_read_back(CoilAmplifier& coils, Instrument& double_) {
  const std::vector<double> currents{1, -2, 3, -4, 0.5, 0, 6, -12};
  coils.set_currents(currents);
  std::vector<double> volts;
  for (const double current : currents) volts.push_back(current / 2);  // amperes_per_volt
  expect_volts(double_, volts);
  EXPECT_EQ(coils.currents(), currents);
}

TEST_F(Usb3103Guest, OpensAndSetsEightVoltagesThroughReportsWithIds) {
  Gadget device({"hid", "usb3103", "--numbered"});
  const auto coils = open_when_there();
  set_and_read_back(*coils, device);
  const auto began = Steady::now();
  constexpr int kUpdates = 50;
  for (int i = 0; i < kUpdates; ++i) coils->set_currents(std::vector<double>(8, 0.01 * i));
  row("update of 8 channels with its status: %.1f ms each",
      Milliseconds(Steady::now() - began).count() / kUpdates);
  coils->make_safe();
  expect_volts(device, std::vector<double>(8, 0.0));
  expect_clean(device);
}

TEST_F(Usb3103Guest, OpensAndSetsEightVoltagesThroughReportsWithoutIds) {
  Gadget device({"hid", "usb3103", "--option", "reply_size=64"});
  const auto coils = open_when_there();
  set_and_read_back(*coils, device);
  expect_clean(device);
}

TEST_F(Usb3103Guest, APulledCableIsANamedErrorWithinATenthOfASecond) {
  Gadget device({"hid", "usb3103", "--numbered"});
  auto coils = open_when_there();
  const std::vector<double> one(8, 1.0);
  coils->set_currents(one);
  std::thread puller([&] {
    std::this_thread::sleep_for(200ms);
    device.unplug();
  });
  Steady::time_point last = Steady::now();
  std::string said;
  while (said.empty() && Steady::now() - last < 5s) try {
      coils->set_currents(one);
      last = Steady::now();
    } catch (const DeviceError& error) {
      said = error.what();
      EXPECT_EQ(error.kind, DeviceErrorKind::lost) << said;
    }
  const double took = Milliseconds(Steady::now() - last).count();
  puller.join();
  row("cable out: \"%s\" %.0f ms after the last good update", said.c_str(), took);
  EXPECT_LT(took, 100);
  EXPECT_NE(said.find("coils"), std::string::npos) << said;
  expect_volts(device, std::vector<double>(8, 0.5));  // it has no watchdog: docs/instruments.md
  coils.reset();
  device.plug();
  coils = open_when_there();
  expect_volts(device, std::vector<double>(8, 0.0));
  coils->set_currents(one);
  expect_volts(device, std::vector<double>(8, 0.5));
}

TEST_F(Usb3103Guest, HasOneOwnerWhicheverTheUser) {
  Gadget device({"hid", "usb3103", "--numbered"});
  const auto coils = open_when_there();
  coils->set_currents(std::vector<double>(8, 1.0));
  run({"sh", "-c", "chmod 0666 /dev/hidraw*"});
  for (const uid_t user : {uid_t{0}, kOperator}) {
    const std::string said = elsewhere(user, [&]() -> std::string {
      try {
        open();
      } catch (const OwnedError& error) {
        return std::string("OWNED ") + error.what();
      }
      return "opened";
    });
    EXPECT_EQ(said.substr(0, 5), "OWNED") << said;
    EXPECT_NE(said.find("another program"), std::string::npos) << said;
    row("second opener, uid %u: %s", user, said.c_str());
  }
  expect_volts(device, std::vector<double>(8, 0.5));
}

TEST_F(Usb3103Guest, WhoMayNotOpenTheNodeIsToldSo) {
  Gadget device({"hid", "usb3103", "--numbered"});
  open_when_there();
  run({"sh", "-c", "chmod 0600 /dev/hidraw*"});
  const std::string said = elsewhere(kOperator, [&]() -> std::string {
    open();
    return "opened";
  });
  row("without the right: %s", said.c_str());
  EXPECT_NE(said.find("refused"), std::string::npos) << said;
}

TEST_F(Usb3103Guest, OfTwoTheOneThatIsNamedIsOpened) {
  Gadget first({"hid", "usb3103", "--numbered", "--option", "serial=01A2B3C4"});
  Gadget second(
      {"hid", "usb3103", "--numbered", "--option", "serial=01A2B3C5", "--udc", "dummy_udc.1"});
  const auto coils = open_when_there("hid:09db:009c:01A2B3C5");
  coils->set_currents(std::vector<double>(8, 1.0));
  expect_volts(second, std::vector<double>(8, 0.5));
  expect_volts(first, std::vector<double>(8, 0.0));
  try {
    open();
    ADD_FAILURE() << "one of two was chosen";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.kind, DeviceErrorKind::not_found);
    row("two without a serial number: %s", error.what());
  }
}

}  // namespace
}  // namespace vitreo::kernel_guest
