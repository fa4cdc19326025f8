// Coil amplifiers against doubles by another hand: opening, the contract, and the guardian's
// rescue. On the wall clock, over real lines.
// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/coil_amplifier.h"
#include "devices/instruments/kepco_bop/driver.h"
#include "devices/instruments/kepco_bop/rescue.h"
#include "devices/instruments/usb3103/driver.h"
#include "devices/instruments/usb3103/rescue.h"
#include "devices/links/address.h"
#include "tests/devices/doubles/double_process.h"

#include <gtest/gtest.h>

#include <string>
#include <thread>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using Findings = std::vector<std::string>;
using Options = std::vector<std::string>;

std::vector<std::unique_ptr<ByteLink>> line_to(const DoubleProcess& supply, Clock& clock) {
  std::vector<std::unique_ptr<ByteLink>> links;
  links.push_back(open_byte_link(supply.address(), {.baud_rate = 9600, .xon_xoff = true}, clock));
  return links;
}

/// Ways in which real supplies differ; each is of the manual.
class KepcoDouble : public testing::TestWithParam<Options> {};

TEST_P(KepcoDouble, KeepsTheContractOfAnAmplifier) {
  const auto clock = wall_clock();
  DoubleProcess supply("kepco_bop", GetParam());
  const auto coils = kepco_bop::open(line_to(supply, *clock), {}, *clock);
  contract::CoilAmplifierCheck how;
  how.measured = [&] { return std::vector{supply.number("current")}; };
  how.tolerance = 0.02;
  EXPECT_EQ(contract::check(*coils, how), Findings{});
}

TEST_P(KepcoDouble, IsBroughtToZeroByTheRescue) {
  const auto clock = wall_clock();
  DoubleProcess supply("kepco_bop", GetParam());
  {
    const auto coils = kepco_bop::open(line_to(supply, *clock), {}, *clock);
    coils->set_currents(std::vector{3.0});
    EXPECT_NEAR(supply.number("current"), 3, 0.05);
    // The host dies here: nothing of its is sent any more.
  }
  supply.order(R"({"set": {}})");
  auto links = line_to(supply, *clock);
  const auto say = [&](const std::string& text) {
    links.front()->write({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()},
                         std::chrono::seconds(1));
  };
  say("SYST:REM 1;:FUNC:MODE CURR;:CURR 3;:OUTP ON\n");
  for (int i = 0; i < 200 && supply.number("current") < 2.9; ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  ASSERT_NEAR(supply.number("current"), 3, 0.1);
  EXPECT_NO_THROW(kepco_bop::rescue(links));
  EXPECT_NEAR(supply.number("current"), 0, 0.01);
}

INSTANTIATE_TEST_SUITE_P(Ways, KepcoDouble,
                         testing::Values(Options{}, Options{"identity=bit232"}, Options{"link=lan"},
                                         Options{"prompt=True"}, Options{"echo=True"},
                                         Options{"late=0.05"}),
                         [](const auto& made) {
                           std::string name = made.param.empty() ? "plain" : made.param.front();
                           for (char& c : name)
                             if (!std::isalnum(static_cast<unsigned char>(c))) c = '_';
                           return name;
                         });

TEST(Usb3103Double, KeepsTheContractOfAnAmplifier) {
  const auto clock = wall_clock();
  DoubleProcess interface = DoubleProcess::on_socket("usb3103");
  const usb3103::Settings settings;
  const auto coils = usb3103::open(open_double_hid(interface.address(), *clock), settings, *clock);
  EXPECT_EQ(contract::check(*coils), Findings{});
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
