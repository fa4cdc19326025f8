// SpaceMouse and foot pedal: their reports, their quirks, and the dead-man. Bad days end at zero
// and at released.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/foot_pedal/driver.h"
#include "devices/instruments/foot_pedal/emulator.h"
#include "devices/instruments/spacemouse/driver.h"
#include "devices/instruments/spacemouse/emulator.h"
#include "devices/time/error.h"

#include <gtest/gtest.h>

#include <stdexcept>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using Report = std::vector<std::uint8_t>;

/// A link that can be pulled.
struct LooseHidLink final : HidLink {
  LooseHidLink(std::unique_ptr<HidLink> its_link, const bool& its_pulled)
      : link(std::move(its_link)), pulled(its_pulled) {}
  void write(std::span<const std::uint8_t> report) override { link->write(report); }
  std::optional<Report> read(Time timeout) override {
    if (pulled) throw DeviceError(DeviceErrorKind::lost, "hid", "no such device");
    return link->read(timeout);
  }
  std::unique_ptr<HidLink> link;
  const bool& pulled;
};

template <class Emulator>
struct Input : ::testing::Test {
  std::unique_ptr<HidLink> link(Emulator& emulator) {
    return std::make_unique<LooseHidLink>(memory_hid_link(emulator, *clock, Time(0)), pulled);
  }
  std::unique_ptr<Clock> clock = virtual_clock();
  bool pulled = false;
};
struct SpaceMouse : Input<spacemouse::Emulator> {
  spacemouse::Emulator emulator;
  std::unique_ptr<OperatorInput> mouse = spacemouse::open(link(emulator), {}, *clock);
};
struct FootPedal : Input<foot_pedal::Emulator> {
  foot_pedal::Emulator emulator;
  std::unique_ptr<OperatorInput> pedal = foot_pedal::open(link(emulator), {});
};

TEST(SpaceMouseWire, EncodesAndDecodesItsReports) {
  using namespace spacemouse;
  EXPECT_EQ(encode(Translation{{350, -350, 1}}), (Report{1, 0x5E, 0x01, 0xA2, 0xFE, 0x01, 0x00}));
  EXPECT_EQ(encode(Buttons{2}), (Report{3, 2, 0}));
  const auto both = decode(encode(Both{{1, 2, 3}, {-4, -5, -6}}));
  ASSERT_TRUE(both);
  EXPECT_EQ(std::get<Both>(*both).rotation, (Axes{-4, -5, -6}));
  for (const Report& nonsense :
       {Report{}, Report{1, 2, 3}, Report{2, 0, 0, 0, 0, 0}, Report{3}, Report{0x17, 90, 0}})
    EXPECT_FALSE(decode(nonsense));
}

TEST_F(SpaceMouse, GivesDeflectionsInOurAxes) {
  emulator.deflect({350, 350, 350}, {-350, 0, 175});
  const OperatorState state = mouse->state();
  EXPECT_EQ(state.translation, Eigen::Vector3d(1, -1, -1));
  EXPECT_DOUBLE_EQ(state.rotation.x(), -1);
  EXPECT_DOUBLE_EQ(state.rotation.y(), 0);
  EXPECT_NEAR(state.rotation.z(), -(0.5 - 0.03) / 0.97, 1e-12);
}

TEST_F(SpaceMouse, UnderstandsTheWirelessFamilysSingleReport) {
  spacemouse::Emulator wireless(true);
  const auto other = spacemouse::open(link(wireless), {}, *clock);
  wireless.deflect({0, 0, -350}, {0, 350, 0});
  EXPECT_EQ(other->state().translation, Eigen::Vector3d(0, 0, 1));
  EXPECT_EQ(other->state().rotation, Eigen::Vector3d(0, -1, 0));
}

TEST_F(SpaceMouse, HasADeadZoneAndStaysWithinFullDeflection) {
  emulator.deflect({10, -10, 32767}, {0, 0, 0});
  EXPECT_EQ(mouse->state().translation, Eigen::Vector3d(0, 0, -1));
}

TEST_F(SpaceMouse, TakesSilenceWhileDeflectedForZero) {
  emulator.deflect({350, 0, 0}, {0, 0, 0});
  EXPECT_EQ(mouse->state().translation.x(), 1);
  clock->sleep_for(90ms);
  EXPECT_EQ(mouse->state().translation.x(), 1);
  clock->sleep_for(20ms);  // the three zero reports of a release got lost
  EXPECT_EQ(mouse->state().translation, Eigen::Vector3d::Zero());
}

TEST_F(SpaceMouse, KeepsItsButtonsWithoutRepeatingThem) {
  emulator.press(3);
  EXPECT_EQ(mouse->state().pressed, 3U);
  clock->sleep_for(10s);
  EXPECT_EQ(mouse->state().pressed, 3U);
  emulator.press(0);
  EXPECT_EQ(mouse->state().pressed, 0U);
}

TEST_F(SpaceMouse, IsLostForGoodWhenItIsUnplugged) {
  emulator.deflect({350, 0, 0}, {0, 0, 0});
  mouse->state();
  pulled = true;
  for (int i = 0; i < 2; ++i) {
    try {
      mouse->state();
      FAIL() << "no error";
    } catch (const DeviceError& error) {
      EXPECT_EQ(error.kind, DeviceErrorKind::lost);
      EXPECT_EQ(error.device, "joystick");
    }
    pulled = false;  // re-plugged: it must be opened again
  }
}

TEST_F(FootPedal, GivesABitAPedal) {
  EXPECT_EQ(pedal->state().pressed, 0U);
  for (const std::uint32_t down : {1U, 2U, 4U, 5U, 0U}) {
    emulator.press(down);
    EXPECT_EQ(pedal->state().pressed, down);
  }
}

TEST_F(FootPedal, IsADeadMan) {
  EXPECT_FALSE(is_held(pedal.get(), 2));
  emulator.press(2);
  clock->sleep_for(1h);  // it says only what changes
  EXPECT_TRUE(is_held(pedal.get(), 2));
  EXPECT_FALSE(is_held(pedal.get(), 3));
  EXPECT_FALSE(is_held(pedal.get(), 0));
  EXPECT_FALSE(is_held(nullptr, 2));
  emulator.press(0);
  EXPECT_FALSE(is_held(pedal.get(), 2));
}

TEST_F(FootPedal, CountsAsReleasedWhenItIsUnpluggedAndStaysSo) {
  emulator.press(2);
  EXPECT_TRUE(is_held(pedal.get(), 2));
  pulled = true;
  EXPECT_FALSE(is_held(pedal.get(), 2));
  pulled = false;
  EXPECT_FALSE(is_held(pedal.get(), 2));
}

TEST(FootPedalWire, FindsThePedalsOfEachMaker) {
  using namespace foot_pedal;
  // With its constant first byte (and one more, as Windows counts), and without it.
  for (const std::size_t size : {19U, 20U}) {
    Report report(size, 0);
    report[1] = 0x04;
    EXPECT_EQ(decode(report, xkeys_xk3()), 2U) << size;
  }
  Report shorter(18, 0);
  shorter[0] = 0x04;
  EXPECT_EQ(decode(shorter, xkeys_xk3()), 2U);
  Report newer(32, 0);
  newer[2] = 0x08;
  EXPECT_EQ(decode(newer, xkeys_xk3_0438()), 4U);
  EXPECT_EQ(decode(Report{5, 0}, infinity()), 5U);
  EXPECT_FALSE(decode(Report{5}, infinity()));
  EXPECT_FALSE(decode(Report(17, 0xFF), xkeys_xk3()));
}

TEST(OperatorInputSettings, AreCheckedByName) {
  EXPECT_THROW((spacemouse::Settings{.dead_zone = 1}.check()), std::invalid_argument);
  EXPECT_THROW((spacemouse::Settings{.watchdog = 0}.check()), std::invalid_argument);
  EXPECT_THROW((foot_pedal::Settings{.layout = {2, {}}}.check()), std::invalid_argument);
  EXPECT_THROW((foot_pedal::Settings{.layout = {2, {{2, 1}}}}.check()), std::invalid_argument);
  EXPECT_NO_THROW(foot_pedal::Settings{}.check());
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
