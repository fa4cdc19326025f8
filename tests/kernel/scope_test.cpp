// Where systemd is the first process the guardian is in a scope of its own, so that what stops or
// kills the unit of its host (a logout, systemctl, the unit's own memory limit) leaves it alive.
// SPDX-License-Identifier: Apache-2.0
#include "tests/kernel/guest.h"

#include <gtest/gtest.h>

#include <csignal>

namespace vitreo::kernel_guest {
namespace {

class ScopeGuest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    load_gadgets();
    load({"usb_f_hid", "usbhid", "hid-generic"});
  }
  void SetUp() override { amplifier = usb3103_gadget(); }
  /// In a scope of systemd's, as a session or a desktop's application is.
  void energize(const std::vector<std::string>& limits = {}) {
    std::vector<std::string> by{"systemd-run", "--scope", "--quiet", "--collect", "--unit=held"};
    by.insert(by.end(), limits.begin(), limits.end());
    host = std::make_unique<Host>(
        *amplifier, [] {}, by);
    host->energize();
  }
  static std::string group_of(pid_t process) {
    return text_of("/proc/" + std::to_string(process) + "/cgroup");
  }
  void expect_zero(const char* what) {
    const auto zero = time_until(3s, [&] { return amplifier->at_zero(); });
    ASSERT_TRUE(zero) << what << ": stays on; " << host->said();
    row("%s: at zero after %.0f ms", what, zero->count());
    EXPECT_TRUE(time_until(2s, [&] {
      return host->said().find("is at zero") != std::string::npos;
    })) << host->said();
  }

  std::unique_ptr<Amplifier> amplifier;
  std::unique_ptr<Host> host;
};

TEST_F(ScopeGuest, IsTheGuardiansOwn) {
  energize();
  const std::string its = group_of(host->guardian()), hosts = group_of(host->process());
  row("host in %s, guardian in %s", hosts.substr(0, hosts.find('\n')).c_str(),
      its.substr(0, its.find('\n')).c_str());
  EXPECT_NE(hosts.find("held.scope"), std::string::npos) << hosts;
  EXPECT_NE(its.find(".scope"), std::string::npos) << its;
  EXPECT_NE(its, hosts);
  ::kill(host->process(), SIGINT);
  EXPECT_TRUE(time_until(20s, [&] { return !host->lives(); })) << host->said();
  EXPECT_EQ(host->code().value_or(-1), 3) << host->said();
  EXPECT_TRUE(time_until(5s, [] {
    return run({"systemctl", "list-units", "--type=scope", "--no-legend"}).said.find("run-") ==
           std::string::npos;
  })) << "the scope is left";
}

TEST_F(ScopeGuest, OutlivesTheUnitOfItsHostThatIsKilled) {
  energize();
  const Ended killed = run({"systemctl", "kill", "--signal=KILL", "held.scope"});
  ASSERT_EQ(killed.code, 0) << killed.said;
  expect_zero("unit killed");
}

// SIGTERM to all of it, as at a logout: the host ends the run, in order.
TEST_F(ScopeGuest, AStoppedUnitEndsTheRunAtZero) {
  energize();
  const Ended stopped = run({"systemctl", "stop", "held.scope"});
  ASSERT_EQ(stopped.code, 0) << stopped.said;
  const auto zero = time_until(3s, [&] { return amplifier->at_zero(); });
  ASSERT_TRUE(zero) << host->said();
  row("unit stopped: at zero by the time systemctl is back, and %.0f ms", zero->count());
  EXPECT_TRUE(time_until(20s, [&] { return !host->lives(); })) << host->said();
}

TEST_F(ScopeGuest, OutlivesTheMemoryLimitOfItsHostsUnit) {
  energize();
  const Ended limited =
      run({"systemctl", "set-property", "--runtime", "held.scope", "MemoryMax=2M"});
  ASSERT_EQ(limited.code, 0) << limited.said;
  expect_zero("unit out of memory");
}

}  // namespace
}  // namespace vitreo::kernel_guest
