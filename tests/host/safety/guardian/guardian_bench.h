// Bench of the guardian's tests: the program that holds currents, its guardian, and amplifiers
// whose far end is in this process or in a double's.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/kepco_bop/emulator.h"
#include "devices/instruments/usb3103/emulator.h"
#include "devices/testbed/usb_testbed.h"
#include "tests/devices/doubles/double_process.h"
#include "tests/devices/links/real_end.h"
#include "tests/host/safety/guardian/frozen.h"
#include "tests/host/safety/held_protocol.h"

#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <sys/types.h>
#include <thread>
#include <vector>

namespace vitreo {

using Steady = std::chrono::steady_clock;
using Milliseconds = std::chrono::duration<double, std::milli>;
using namespace std::chrono_literals;

/// Of each signal on each amplifier: 5, or 200 in the long form.
int trials();

/// Sets currents all the time, for a minute.
extern const char* const kProtocol;

/// Nothing when `so` has not become true within `patience`; else the time that it took.
std::optional<Milliseconds> time_until(Steady::duration patience, const std::function<bool()>& so);

/// An amplifier that another process can open, and how strongly it is energized.
struct Amplifier {
  virtual ~Amplifier() = default;
  virtual std::string rig() const = 0;  // a role and its table
  virtual double output() = 0;          // V or A, the largest of a channel
  virtual bool enabled() = 0;
  virtual void unplug() {}
  virtual void plug() {}
};

/// A USB-3103 by its emulator, behind the system's own HID path.
struct Usb : Amplifier {
  ~Usb() override { testbed.reset(); }
  std::string rig() const override {
    return R"(coils = { driver = "usb3103", address = "hid:09db:009c", enable_line = 0 })";
  }
  double output() override;
  bool enabled() override;
  std::unique_ptr<usb3103::Emulator> emulator = usb3103::make_emulator({}, nullptr);
  std::unique_ptr<UsbTestbed> testbed = make_usb_testbed();
  int plugged;
  Usb();
};

/// The same interface with an LED on its first output.
struct Lamp3103 : Usb {
  std::string rig() const override {
    return R"(lamp = { driver = "led", address = "hid:09db:009c", enable_line = 0 })";
  }
};

/// The same interface by another hand. `table`: more keys of the role's table; `wired`: options of
/// the double.
struct DoubledUsb : Amplifier {
  explicit DoubledUsb(std::string table = "enable_line = 0",
                      const std::vector<std::string>& wired = {}, std::string role = "coils");
  ~DoubledUsb() override { testbed.reset(); }
  std::string rig() const override;
  /// V of which the amplifiers make a current.
  double output() override { return interface.number("driven"); }
  bool enabled() override { return interface.number("port_latch") != 0; }
  void unplug() override { testbed->unplug(plugged); }
  void plug() override;

  const std::string role, table;
  DoubleProcess interface;
  std::unique_ptr<HidPeer> peer = double_hid_peer(interface.address(), {0x44, 0x30});
  std::unique_ptr<UsbTestbed> testbed = make_usb_testbed();
  int plugged;
};

/// With a one-shot of 70 ms on its digital line, and a relay whose on-delay is longer than that.
struct HeartbeatUsb : DoubledUsb {
  explicit HeartbeatUsb(const std::string& its_role = "coils");
};

/// A BOP by its emulator, on a pseudo-terminal.
struct Kepco : Amplifier {
  std::string rig() const override {
    return "coils = { driver = \"kepco_bop\", address = \"" + end.address() +
           "\", max_slope = 1000 }";
  }
  double output() override;
  bool enabled() override;
  /// As a host would have left it.
  void switch_on(Clock& clock);
  std::unique_ptr<kepco_bop::Emulator> emulator = kepco_bop::make_emulator({});
  RealEnd end{*emulator, open_pty_end()};
};

/// The program, holding currents.
class Host {
 public:
  Host(const std::filesystem::path& folder, const std::string& role, const char* script);
  /// Its guardian first: without the amplifier, which is taken down next, it would go on for ten
  /// minutes.
  ~Host();
  Host(const Host&) = delete;
  Host& operator=(const Host&) = delete;
  pid_t guardian() const;
  void signal(int number) const;
  /// To its guardian; a failure where there is none.
  void signal_guardian(int number) const;
  /// Nothing while it lives.
  std::optional<int> status();

 private:
  pid_t pid_ = -1;
};

class GuardianTest : public ::testing::Test {
 protected:
  GuardianTest();
  ~GuardianTest() override { std::filesystem::remove_all(folder); }
  std::string log() const;
  bool guardian_says(const std::string& what) const {
    return log().find(what) != std::string::npos;
  }
  /// A host that holds currents; null where it ends first.
  std::unique_ptr<Host> try_energize(Amplifier& amplifier, const char* script);
  /// The same; null after a failure.
  std::unique_ptr<Host> energize(Amplifier& amplifier, const char* script = kProtocol);
  /// From the signal until the output is at zero, ms; then a while in which it stays there.
  double trial(Amplifier& amplifier, int first_signal, const char* script = kProtocol);
  /// Trials of that signal; prints how long they took.
  void trials_of(Amplifier& amplifier, const char* name, int first_signal);
  /// The same, of another kind.
  void trials_of(const std::string& name, const std::function<double()>& one);
  /// From the freezing of the guardian until the output is at zero, ms; then the host ends by
  /// itself.
  double trial_of_frozen(Amplifier& amplifier, const char* script);
  /// How it ended: by itself, within `patience`; else a failure, and -1.
  int exit_code(Host& host, Steady::duration patience);
  Steady::duration drawn(double least, double most);  // s

  std::filesystem::path folder;
  std::mt19937 random{20261121};
};

/// What a test has frozen, or its host left behind, is ended with the test.
struct EndedAtLast {
  ~EndedAtLast();
  const pid_t process;
};

/// A control group (version 2) in which this process, and what it starts, is while it lives.
class ControlGroup {
 public:
  ControlGroup();
  ~ControlGroup();
  ControlGroup(const ControlGroup&) = delete;
  ControlGroup& operator=(const ControlGroup&) = delete;
  bool there() const { return there_; }
  void enter(pid_t process) const;
  void leave() const;
  void kill() const;

 private:
  std::filesystem::path root_, group_;
  bool there_ = false;
};

}  // namespace vitreo
