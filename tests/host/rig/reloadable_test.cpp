// Exchange of a driver under those who hold it: what fails on the way, and where it leaves them.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/drivers/reloadable.h"

#include "devices/time/error.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

/// A lamp that tells what becomes of it.
class ToldLamp final : public Lamp {
 public:
  ToldLamp(std::string name, std::vector<std::string>& told, bool breaks)
      : name_(std::move(name)), told_(told), breaks_(breaks) {
    told_.push_back("open " + name_);
  }
  ~ToldLamp() override { told_.push_back("close " + name_); }
  ToldLamp(const ToldLamp&) = delete;
  ToldLamp& operator=(const ToldLamp&) = delete;
  std::string identity() const override { return name_; }
  void set_level(double level) override { level_ = level; }
  double level() const override { return level_; }
  void ask() override {}
  void make_safe() override {
    if (breaks_) throw DeviceError(DeviceErrorKind::protocol, "lamp", "its driver failed");
    told_.push_back("safe " + name_);
    level_ = 0;
  }

 private:
  const std::string name_;
  std::vector<std::string>& told_;
  const bool breaks_;
  double level_ = 0;
};

struct ReloadedLamp : testing::Test {
  std::unique_ptr<Clock> clock = virtual_clock();
  std::vector<std::string> told;
  std::string now = "a";         // the lamp of the file as it is now
  std::string breaks;            // the one whose make_safe fails
  std::vector<std::string> shy;  // those that do not open
  std::map<std::string, Reloadable*> reloadable;
  std::unique_ptr<Lamp> lamp;

  DriverReading<Lamp> reading() {
    return {[this, name = now](const RigContext&) {
              for (const std::string& one : shy)
                if (one == name)
                  throw DeviceError(DeviceErrorKind::not_found, "lamp", "there is no " + name);
              return Opened<Lamp>{nullptr, std::make_unique<ToldLamp>(name, told, breaks == name)};
            },
            {"lamp.lua", now}};
  }
  void open() {
    RigContext where{*clock, nullptr};
    where.reloadable = &reloadable;
    lamp = open_reloadable<Lamp>({"lamp", reading(), [this] { return reading(); }}, where).device;
    told.clear();
  }
  std::string reload() {
    try {
      return reloadable.at("lamp")->reload().text;
    } catch (const DeviceError& error) {
      return error.what();
    }
  }
};

using Steps = std::vector<std::string>;

TEST_F(ReloadedLamp, TheOldOneIsSafeAndClosedBeforeTheNewOneOpens) {
  open();
  now = "b";
  EXPECT_EQ(reload(), "b");
  EXPECT_EQ(told, (Steps{"safe a", "close a", "open b"}));
  EXPECT_EQ(lamp->identity(), "b");
}

TEST_F(ReloadedLamp, WhereTheOldDriverCannotMakeItSafeTheNewOneDoes) {
  breaks = "a";
  open();
  now = "b";
  EXPECT_EQ(reload(), "b");
  EXPECT_EQ(told, (Steps{"close a", "open b", "safe b"}));
}

TEST_F(ReloadedLamp, OneThatDoesNotOpenLeavesTheOldOne) {
  open();
  now = "b";
  shy = {"b"};
  EXPECT_NE(reload().find("there is no b; as it was before it is open again"), std::string::npos);
  EXPECT_EQ(told, (Steps{"safe a", "close a", "open a"}));
  EXPECT_EQ(lamp->identity(), "a");
}

TEST_F(ReloadedLamp, WhereNeitherOpensEachCallSaysSoUntilOneDoes) {
  open();
  now = "b";
  shy = {"a", "b"};
  EXPECT_NE(reload().find("as it was before it does not open either"), std::string::npos);
  EXPECT_EQ(lamp->level(), 0);
  try {
    lamp->set_level(1);
    FAIL() << "nothing was thrown";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.kind, DeviceErrorKind::lost);
    EXPECT_NE(error.text.find("rig:reload(\"lamp\") opens it again"), std::string::npos);
  }
  EXPECT_THROW(lamp->make_safe(), DeviceError) << "that it is dark nobody knows";
  shy.clear();
  EXPECT_EQ(reload(), "b");
  lamp->set_level(1);
  EXPECT_TRUE(reloadable.at("lamp")->in_use());
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
