// Three processes: the program that holds currents, its guardian, and this one with the emulated
// amplifiers. The program is killed, or frozen and later thawed, at random moments: the outputs go
// to zero and stay there. ctest starts this program under umockdev-wrapper; these tests wait for
// real.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/kepco_bop/emulator.h"
#include "devices/instruments/usb3103/emulator.h"
#include "devices/links/address.h"
#include "devices/testbed/usb_testbed.h"
#include "devices/time/error.h"
#include "host/safety/guardian/duty.h"
#include "tests/devices/doubles/double_process.h"
#include "tests/devices/links/echo_peer.h"
#include "tests/devices/links/real_end.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <functional>
#include <optional>
#include <random>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

extern char** environ;

namespace vitreo {
namespace {

using Steady = std::chrono::steady_clock;
using Milliseconds = std::chrono::duration<double, std::milli>;
using namespace std::chrono_literals;
const UsbIdentity kUsb3103{0x09DB,     0x009C, 0x0100, "01A2B3C4", "Measurement Computing Corp",
                           "USB-3103", ""};

/// Of each signal on each amplifier.
int trials() { return std::getenv("VITREO_LONG") != nullptr ? 200 : 5; }

/// Nothing is set again for a minute: only what watches can notice anything.
constexpr const char* kHeld = R"(
return { title = "A current and a light that are held", needs = {}, parameters = {},
  run = function(rig, p, run)
    if rig.lamp then rig.lamp:set_level(0.5) end
    if rig.coils then
      local currents = {}
      for i = 1, #rig.coils:currents() do currents[i] = 1 end
      rig.coils:set_currents(currents)
    end
    run:wait(60)
  end }
)";

constexpr const char* kProtocol = R"(
local s = require("units").s
return { title = "Currents that change all the time", needs = { "coils" }, parameters = {},
  run = function(rig, p, run)
    local channels = #rig.coils:currents()
    for k = 1, 6000 do -- a minute: the preflight rehearses all of it
      local currents = {}
      for i = 1, channels do currents[i] = 1 + 0.1 * (k % 5) end
      rig.coils:set_currents(currents)
      run:wait(0.01*s)
    end
  end }
)";

std::optional<Milliseconds> time_until(Steady::duration patience, const std::function<bool()>& so) {
  const auto began = Steady::now();
  while (Steady::now() - began < patience) {
    if (so()) return Steady::now() - began;
    std::this_thread::sleep_for(5ms);
  }
  return std::nullopt;
}

/// An amplifier that another process can open, and how strongly it is energized.
struct Amplifier {
  virtual ~Amplifier() = default;
  virtual std::string rig() const = 0;  // a role and its table
  virtual double output() = 0;          // V or A, the largest of a channel
  virtual bool enabled() = 0;
};

struct Usb : Amplifier {
  ~Usb() override { testbed.reset(); }
  std::string rig() const override {
    return R"(coils = { driver = "usb3103", address = "hid:09db:009c", enable_line = 0 })";
  }
  double output() override {
    double most = 0;
    testbed->with_emulators([&] {
      for (const double volts : emulator->outputs()) most = std::max(most, std::abs(volts));
    });
    return most;
  }
  bool enabled() override {
    bool high = false;
    testbed->with_emulators([&] { high = emulator->line_is_high(0); });
    return high;
  }
  std::unique_ptr<usb3103::Emulator> emulator = usb3103::make_emulator({}, nullptr);
  std::unique_ptr<UsbTestbed> testbed = make_usb_testbed();
  int plug = testbed->plug(*emulator, kUsb3103);
};

/// The same interface with an LED on its first output.
struct Lamp3103 : Usb {
  std::string rig() const override {
    return R"(lamp = { driver = "led", address = "hid:09db:009c", enable_line = 0 })";
  }
};

/// The same interface by another hand, with a one-shot of 70 ms and a relay on its digital line.
struct DoubledUsb : Amplifier {
  DoubledUsb(const std::string& line, const std::vector<std::string>& wired)
      : table(line), interface(DoubleProcess::on_socket("usb3103", wired)) {}
  ~DoubledUsb() override { testbed.reset(); }
  std::string rig() const override {
    return R"(coils = { driver = "usb3103", address = "hid:09db:009c", )" + table + " }";
  }
  /// V of which the amplifiers make a current.
  double output() override { return interface.number("driven"); }
  bool enabled() override { return interface.number("port_latch") != 0; }

  const std::string table;
  DoubleProcess interface;
  std::unique_ptr<HidPeer> peer = double_hid_peer(interface.address(), {0x44, 0x30});
  std::unique_ptr<UsbTestbed> testbed = make_usb_testbed();
  int plug = testbed->plug(*peer, kUsb3103);
};

const std::vector<std::string> kWired{"one_shot=0.07", "one_shot_line=0", "relay_release=0.015"};

struct HeartbeatUsb : DoubledUsb {
  HeartbeatUsb() : DoubledUsb("enable_line = 0, heartbeat = 50, one_shot = 0.07", kWired) {}
};

struct Kepco : Amplifier {
  std::string rig() const override {
    return "coils = { driver = \"kepco_bop\", address = \"" + end.address() +
           "\", max_slope = 1000 }";
  }
  double output() override {
    return end.look([&] { return std::abs(emulator->current()); });
  }
  bool enabled() override {
    return end.look([&] { return emulator->output(); });
  }
  /// As a host would have left it.
  void switch_on(Clock& clock) {
    open_byte_link(end.address(), {}, clock)
        ->write(bytes("SYST:REM 1;:FUNC:MODE CURR;:CURR:LIM 2;:CURR 1.5;:OUTP ON\n"), 1s);
    ASSERT_TRUE(time_until(2s, [&] { return enabled() && output() > 1; }));
  }
  std::unique_ptr<kepco_bop::Emulator> emulator = kepco_bop::make_emulator({});
  RealEnd end{*emulator, open_pty_end()};
};

pid_t child_of(pid_t parent, const std::string& name) {
  for (const auto& entry : std::filesystem::directory_iterator("/proc")) {
    std::ifstream stat(entry.path() / "stat");
    std::string id, called, state;
    pid_t its_parent = -1;
    if (stat >> id >> called >> state >> its_parent && its_parent == parent &&
        called == "(" + name + ")")
      return static_cast<pid_t>(std::stol(id));
  }
  return -1;
}

/// The program, holding currents.
class Host {
 public:
  Host(const std::filesystem::path& folder, const std::string& role, const char* script) {
    std::ofstream(folder / "p.lua") << script;
    std::ofstream(folder / "rig.lua") << "return { title = 'amplifier', " << role << " }";
    const std::string log = (folder / "err").string(), protocol = (folder / "p.lua").string(),
                      rig = (folder / "rig.lua").string(), out = (folder / "runs").string();
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    for (const int descriptor : {1, 2})
      posix_spawn_file_actions_addopen(&actions, descriptor, log.c_str(),
                                       O_WRONLY | O_CREAT | O_APPEND, 0666);
    std::vector<const char*> words{VITREO_PROGRAM, "run",   protocol.c_str(), "--rig",
                                   rig.c_str(),    "--out", out.c_str(),      nullptr};
    if (posix_spawn(&pid_, words[0], &actions, nullptr, const_cast<char**>(words.data()),
                    environ) != 0)
      pid_ = -1;
    posix_spawn_file_actions_destroy(&actions);
  }
  /// Its guardian first: without the amplifier, which is taken down next, it would go on for ten
  /// minutes.
  ~Host() {
    if (pid_ < 0) return;
    if (const pid_t its = guardian(); its > 0) kill(its, SIGKILL);
    kill(pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
  }
  Host(const Host&) = delete;
  Host& operator=(const Host&) = delete;
  pid_t guardian() const { return child_of(pid_, "vitreo_guardian"); }
  void signal(int number) const { kill(pid_, number); }
  /// Nothing while it lives.
  std::optional<int> status() {
    int status = 0;
    if (pid_ < 0 || waitpid(pid_, &status, WNOHANG) != pid_) return std::nullopt;
    pid_ = -1;
    return status;
  }

 private:
  pid_t pid_ = -1;
};

class GuardianTest : public ::testing::Test {
 protected:
  GuardianTest() {
    std::string name = (std::filesystem::temp_directory_path() / "vitreo_guardian_XXXXXX").string();
    folder = mkdtemp(name.data());
  }
  ~GuardianTest() override { std::filesystem::remove_all(folder); }
  std::string log() const {
    std::ostringstream text;
    text << std::ifstream(folder / "err").rdbuf();
    return text.str();
  }
  bool guardian_says(const std::string& what) const {
    return log().find(what) != std::string::npos;
  }

  /// A host that holds currents; null after a failure.
  std::unique_ptr<Host> energize(Amplifier& amplifier, const char* script = kProtocol) {
    std::filesystem::remove(folder / "err");
    std::filesystem::remove_all(folder / "runs");  // each keeps room for its end record
    auto host = std::make_unique<Host>(folder, amplifier.rig(), script);
    bool energized = false;
    time_until(
        20s, [&] { return (energized = amplifier.output() > 0.4) || host->status().has_value(); });
    if (energized) return host;
    ADD_FAILURE() << "no current flows: " << log();
    return nullptr;
  }

  /// From the signal until the output is at zero, ms; then a while in which it stays there.
  double trial(Amplifier& amplifier, int first_signal, const char* script = kProtocol) {
    const std::unique_ptr<Host> begun = energize(amplifier, script);
    if (begun == nullptr) return 1e9;
    Host& host = *begun;
    std::this_thread::sleep_for(
        std::chrono::duration<double>(std::uniform_real_distribution(0.0, 0.05)(random)));
    host.signal(first_signal);
    const auto zero = time_until(10s, [&] { return amplifier.output() < 1e-3; });
    EXPECT_TRUE(zero) << log();
    EXPECT_TRUE(time_until(5s, [&] { return guardian_says("is at zero"); })) << log();
    EXPECT_FALSE(amplifier.enabled());
    if (first_signal == SIGSTOP) host.signal(SIGCONT);  // into a process that is gone
    EXPECT_FALSE(time_until(100ms, [&] { return amplifier.output() > 1e-3; })) << "energized again";
    const auto status = host.status();
    EXPECT_TRUE(status && WIFSIGNALED(*status) && WTERMSIG(*status) == SIGKILL);
    return zero ? zero->count() : 1e9;
  }

  void trials_of(Amplifier& amplifier, const char* name, int first_signal, int count) {
    std::vector<double> took;
    for (int i = 0; i < count && !HasFailure(); ++i) took.push_back(trial(amplifier, first_signal));
    std::sort(took.begin(), took.end());
    if (took.empty()) return;
    const auto at = [&](double part) {
      return took[std::min(took.size() - 1,
                           static_cast<std::size_t>(part * static_cast<double>(took.size())))];
    };
    const auto late = std::count_if(took.begin(), took.end(), [](double ms) { return ms > 300; });
    std::printf(
        "%s, %s: %zu; at zero after median %.0f ms, p90 %.0f, p99 %.0f, largest %.0f ms; %ld "
        "beyond 300 ms\n",
        name, first_signal == SIGKILL ? "SIGKILL" : "SIGSTOP", took.size(), at(0.5), at(0.9),
        at(0.99), took.back(), static_cast<long>(late));
  }

  std::filesystem::path folder;
  std::mt19937 random{20261121};
};

TEST_F(GuardianTest, ZeroesAnAmplifierOnUsbWhenTheHostIsKilled) {
  Usb amplifier;
  trials_of(amplifier, "USB-3103", SIGKILL, trials());
}

TEST_F(GuardianTest, ZeroesAnAmplifierOnUsbWhenTheHostIsFrozenAndThenThawed) {
  Usb amplifier;
  trials_of(amplifier, "USB-3103", SIGSTOP, trials());
}

TEST_F(GuardianTest, ZeroesAnAmplifierOnASerialLineWhenTheHostIsKilled) {
  Kepco amplifier;
  trials_of(amplifier, "BOP", SIGKILL, trials());
}

TEST_F(GuardianTest, ZeroesAnAmplifierOnASerialLineWhenTheHostIsFrozenAndThenThawed) {
  Kepco amplifier;
  trials_of(amplifier, "BOP", SIGSTOP, trials());
}

bool is_refused(const std::function<void()>& open) {
  try {
    open();
  } catch (const DeviceError& error) {
    return error.kind == DeviceErrorKind::refused;
  }
  return false;
}

TEST_F(GuardianTest, FindsAUsbDeviceThatIsTheHostsAloneAsLongAsThatLives) {
  Usb amplifier;
  const auto clock = wall_clock();
  const std::unique_ptr<Host> begun = energize(amplifier);
  ASSERT_NE(begun, nullptr);
  EXPECT_TRUE(
      is_refused([&] { open_hid_link(parse_usb_address("hid", "hid:09db:009c"), *clock); }));
}

TEST_F(GuardianTest, FindsASerialLineThatIsTheHostsAloneAsLongAsThatLives) {
  Kepco amplifier;
  const auto clock = wall_clock();
  const std::unique_ptr<Host> begun = energize(amplifier);
  ASSERT_NE(begun, nullptr);
  EXPECT_TRUE(is_refused([&] { open_byte_link(amplifier.end.address(), {}, *clock); }));
}

TEST_F(GuardianTest, GoesQuietlyWithAHostThatEndsInOrder) {
  Usb amplifier;
  const std::unique_ptr<Host> begun = energize(amplifier);
  ASSERT_NE(begun, nullptr);
  Host& host = *begun;
  host.signal(SIGINT);
  std::optional<int> status;
  ASSERT_TRUE(time_until(20s, [&] { return (status = host.status()).has_value(); })) << log();
  EXPECT_TRUE(WIFEXITED(*status));
  EXPECT_EQ(WEXITSTATUS(*status), 3);
  EXPECT_LT(amplifier.output(), 1e-3);
  EXPECT_FALSE(guardian_says("vitreo guardian: ")) << log();
}

TEST_F(GuardianTest, IsMissedByItsHostWhichThenEndsTheRunAtZero) {
  Usb amplifier;
  const std::unique_ptr<Host> begun = energize(amplifier);
  ASSERT_NE(begun, nullptr);
  Host& host = *begun;
  const pid_t guardian = host.guardian();
  ASSERT_GT(guardian, 0);
  kill(guardian, SIGTERM);  // which it does not obey
  std::this_thread::sleep_for(50ms);
  EXPECT_FALSE(host.status());
  kill(guardian, SIGKILL);
  std::optional<int> status;
  ASSERT_TRUE(time_until(20s, [&] { return (status = host.status()).has_value(); })) << log();
  EXPECT_EQ(WEXITSTATUS(*status), 4) << log();
  EXPECT_LT(amplifier.output(), 1e-3);
  EXPECT_TRUE(guardian_says("the process that guards the outputs is gone")) << log();
}

TEST_F(GuardianTest, DarkensALampWhenTheHostIsKilledAndWhenItIsFrozen) {
  Lamp3103 lamp;
  std::printf("lamp, SIGKILL: dark after %.0f ms\n", trial(lamp, SIGKILL, kHeld));
  std::printf("lamp, SIGSTOP: dark after %.0f ms\n", trial(lamp, SIGSTOP, kHeld));
}

// Before, a run that held a current noticed it at its next set-point only: after a minute here.
void expect_end_at_zero(Host& host, Amplifier& amplifier, const std::function<std::string()>& log) {
  const auto began = Steady::now();
  const auto zero = time_until(20s, [&] { return amplifier.output() < 1e-3; });
  ASSERT_TRUE(zero) << log();
  std::printf("at zero after %.0f ms\n", zero->count());
  std::optional<int> status;
  ASSERT_TRUE(time_until(20s, [&] { return (status = host.status()).has_value(); })) << log();
  EXPECT_LT(Steady::now() - began, 20s) << "the script would have gone on for a minute";
  EXPECT_EQ(WEXITSTATUS(*status), 4) << log();
}

TEST_F(GuardianTest, IsMissedWhileACurrentIsHeld) {
  Usb amplifier;
  const std::unique_ptr<Host> host = energize(amplifier, kHeld);
  ASSERT_NE(host, nullptr);
  kill(host->guardian(), SIGKILL);
  expect_end_at_zero(*host, amplifier, [this] { return log(); });
  EXPECT_TRUE(guardian_says("the process that guards the outputs is gone")) << log();
}

TEST_F(GuardianTest, IsMissedWhileALightIsHeld) {
  Lamp3103 lamp;
  const std::unique_ptr<Host> host = energize(lamp, kHeld);
  ASSERT_NE(host, nullptr);
  kill(host->guardian(), SIGKILL);
  expect_end_at_zero(*host, lamp, [this] { return log(); });
}

// A supply that somebody switches off, or another program sets, while its current is held.
TEST_F(GuardianTest, ASupplyThatIsCutOffWhileItsCurrentIsHeldEndsTheRun) {
  Kepco amplifier;
  const std::unique_ptr<Host> host = energize(amplifier, kHeld);
  ASSERT_NE(host, nullptr);
  amplifier.end.look([&] { return amplifier.emulator->power_cycle(Time{}), 0; });
  expect_end_at_zero(*host, amplifier, [this] { return log(); });
  EXPECT_TRUE(guardian_says("A flow where 1 A were set")) << log();
}

/// A name like /dev/serial/by-id/..., which leads to what is plugged in.
void lead(const std::filesystem::path& name, const std::string& address) {
  std::filesystem::remove(name);
  std::filesystem::create_symlink(address.substr(std::string("serial:").size()), name);
}

TEST_F(GuardianTest, LeavesAloneWhoeverElseHasTheNameOfItsTerminalByNow) {
  const auto clock = wall_clock();
  const auto name = folder / "line";
  Kepco own;
  lead(name, own.end.address());
  guardian::Duty duty({"kepco_bop", "serial:" + name.string()});
  EchoPeer somebody;
  RealEnd elsewhere(somebody, open_pty_end());
  lead(name, elsewhere.address());
  for (int i = 0; i < 3; ++i) EXPECT_THROW(duty.bring_to_zero(*clock), DeviceError);
  EXPECT_EQ(elsewhere.look([&] { return somebody.heard; }), bytes("*IDN?\n")) << "asked once";
  Kepco replugged;
  lead(name, replugged.end.address());
  replugged.switch_on(*clock);
  EXPECT_NO_THROW(duty.bring_to_zero(*clock));
  EXPECT_FALSE(replugged.enabled());
  EXPECT_EQ(replugged.output(), 0);
}

TEST_F(GuardianTest, ZeroesTheUnitsThatItReachesWhenOneIsGone) {
  const auto clock = wall_clock();
  Kepco here;
  here.switch_on(*clock);
  guardian::Duty duty(
      {"kepco_bop", "serial:" + (folder / "gone").string() + ", " + here.end.address()});
  EXPECT_THROW(duty.bring_to_zero(*clock), DeviceError);
  EXPECT_FALSE(here.enabled());
  EXPECT_EQ(here.output(), 0);
}

/// What happens to host, guardian and cable; and within which time, ms, the amplifiers are off.
struct BadDay {
  const char* name;
  std::function<void(Host& host, pid_t guardian, HeartbeatUsb& coils)> begin;
  bool held = false;  // nothing is set again: only the beat can stop
};

/// What a guardian can do nothing about, among the rest.
const std::vector<BadDay>& bad_days() {
  static const std::vector<BadDay> all{
      {"host killed", [](Host& host, pid_t, HeartbeatUsb&) { host.signal(SIGKILL); }},
      {"host frozen", [](Host& host, pid_t, HeartbeatUsb&) { host.signal(SIGSTOP); }},
      {"guardian killed", [](Host&, pid_t guardian, HeartbeatUsb&) { kill(guardian, SIGKILL); },
       true},
      {"both killed at once",
       [](Host& host, pid_t guardian, HeartbeatUsb&) {
         kill(guardian, SIGKILL);
         host.signal(SIGKILL);
       }},
      {"both frozen, as in a suspend or a panic",
       [](Host& host, pid_t guardian, HeartbeatUsb&) {
         kill(guardian, SIGSTOP);
         host.signal(SIGSTOP);
       },
       true},
      {"cable out", [](Host&, pid_t, HeartbeatUsb& coils) { coils.testbed->unplug(coils.plug); },
       true},
  };
  return all;
}

TEST_F(GuardianTest, WithAHeartbeatLineTheAmplifiersAreOffWithin100MsOfAnything) {
  for (const BadDay& day : bad_days()) {
    std::vector<double> took;
    // Each begins a host: two of each day, 50 in the long form.
    for (int i = 0; i < std::max(2, trials() / 4) && !HasFailure(); ++i) {
      HeartbeatUsb coils;
      const std::unique_ptr<Host> host = energize(coils, day.held ? kHeld : kProtocol);
      ASSERT_NE(host, nullptr);
      const pid_t guardian = host->guardian();
      ASSERT_GT(guardian, 0);
      std::this_thread::sleep_for(
          std::chrono::duration<double>(std::uniform_real_distribution(0.1, 0.15)(random)));
      const auto began = Steady::now();
      day.begin(*host, guardian, coils);
      const auto off = time_until(3s, [&] { return coils.output() < 1e-3; });
      ASSERT_TRUE(off) << day.name << ": " << log();
      took.push_back(Milliseconds(Steady::now() - began).count());
      EXPECT_FALSE(time_until(300ms, [&] { return coils.output() > 1e-3; })) << "on again";
      kill(guardian, SIGKILL);
    }
    std::sort(took.begin(), took.end());
    if (took.empty()) return;
    std::printf("heartbeat line, %s: %zu; off after median %.0f ms, largest %.0f ms\n", day.name,
                took.size(), took[took.size() / 2], took.back());
    EXPECT_LT(took.back(), 100) << day.name;
  }
}

// What the tests above can see: the same without the heartbeat.
TEST_F(GuardianTest, WithAStaticLineTheAmplifiersStayOnWhenHostAndGuardianAreKilledAtOnce) {
  DoubledUsb coils("enable_line = 0", {});
  const std::unique_ptr<Host> host = energize(coils);
  ASSERT_NE(host, nullptr);
  kill(host->guardian(), SIGKILL);
  host->signal(SIGKILL);
  EXPECT_FALSE(time_until(1s, [&] { return coils.output() < 0.4; }));
  EXPECT_EQ(coils.interface.number("port_latch"), 1) << "and the line is high";
}

// D2's sister: the interface by another hand, on the system's own path, and the guardian's rescue.
TEST_F(GuardianTest, ZeroesTheDoubleOfAUsb3103WhenTheHostIsKilledAndWhenItIsFrozen) {
  for (const int signal : {SIGKILL, SIGSTOP}) {
    DoubledUsb coils("enable_line = 0", {});
    const double took = trial(coils, signal);
    std::printf("USB-3103 by another hand, %s: at zero after %.0f ms\n",
                signal == SIGKILL ? "SIGKILL" : "SIGSTOP", took);
    EXPECT_EQ(coils.interface.number("port_latch"), 0);
  }
}

TEST_F(GuardianTest, DarkensTheDoubleOfALampWhenTheHostIsKilled) {
  struct DoubledLamp : DoubledUsb {
    DoubledLamp() : DoubledUsb("", {}) {}
    std::string rig() const override {
      return R"(lamp = { driver = "led", address = "hid:09db:009c", enable_line = 0 })";
    }
  } lamp;
  std::printf("lamp by another hand, SIGKILL: dark after %.0f ms\n", trial(lamp, SIGKILL, kHeld));
}

/// The interface by another hand, with shunts on a data logger by another hand: 0.5 V/A.
struct SensedUsb : DoubledUsb {
  SensedUsb() : DoubledUsb("enable_line = 0", {}) {
    testbed->add_node("/dev/ttyLogger", logger.address().substr(std::string("serial:").size()));
  }
  std::string rig() const override {
    return DoubledUsb::rig() + R"(, current_sensor = { driver = "scpi_logger",
              address = "serial:/dev/ttyLogger", line_cycles = 0.02, period = 0.02, amperes_per_volt = { 2 },
              channels = { 101, 102, 103, 104, 105, 106, 107, 108 } })";
  }
  /// What the shunts carry follows what the interface puts out.
  double output() override {
    const std::string said = interface.order(R"({"get": "volts"})");
    std::string volts;
    std::istringstream numbers(said.substr(said.find('[') + 1));
    int channel = 101;
    for (std::string one; std::getline(numbers, one, ',') && channel <= 108; ++channel)
      volts += (volts.empty() ? "\"" : ", \"") + std::to_string(channel) +
               "\": " + one.substr(0, one.find(']'));
    logger.order(R"({"set": {"volts": {)" + volts + "}}}");
    return DoubledUsb::output();
  }
  /// ms in the double's own history, from the zeroing to the first zero of the host's.
  double noticed_after() {
    const std::string history = interface.order(R"({"history": true})");
    const std::size_t zeroed = history.rfind("\"counts\", [32768, 32768, 32768");
    const std::size_t noticed = history.find("\"report\", \"14 ", zeroed);
    const auto time_at = [&](std::size_t place) {
      return std::strtod(history.c_str() + history.rfind('[', place) + 1, nullptr);
    };
    EXPECT_NE(zeroed, std::string::npos);
    EXPECT_NE(noticed, std::string::npos);
    if (zeroed == std::string::npos || noticed == std::string::npos) return 1e9;
    return (time_at(noticed) - time_at(zeroed)) * 1e3;
  }
  DoubleProcess logger{"scpi_logger", {}};
};

// Another program, or a reset, sets the outputs of a device that cannot tell: they are read back
// elsewhere.
TEST_F(GuardianTest, AForeignZeroingOfAUsb3103IsNoticedWithin200MsByACurrentSensor) {
  std::vector<double> took;
  for (int i = 0; i < std::max(3, trials() / 4) && !HasFailure(); ++i) {
    SensedUsb coils;
    const std::unique_ptr<Host> host = energize(coils, kHeld);
    ASSERT_NE(host, nullptr);
    const double settled = std::uniform_real_distribution(0.3, 0.4)(random);
    time_until(std::chrono::duration_cast<Steady::duration>(std::chrono::duration<double>(settled)),
               [&] { return coils.output() < 0; });
    ASSERT_TRUE(coils.enabled()) << "noticed before it happened: " << log();
    coils.interface.order(
        R"({"set": {"counts": [32768, 32768, 32768, 32768, 32768, 32768, 32768, 32768]}})");
    ASSERT_TRUE(time_until(5s, [&] { return coils.output() < 0 || !coils.enabled(); })) << log();
    took.push_back(coils.noticed_after());
    std::optional<int> status;
    ASSERT_TRUE(time_until(20s, [&] {
      coils.output();
      return (status = host->status()).has_value();
    })) << log();
    EXPECT_EQ(WEXITSTATUS(*status), 4) << log();
    EXPECT_TRUE(guardian_says("by the current sensor")) << log();
  }
  std::sort(took.begin(), took.end());
  if (took.empty()) return;
  std::printf(
      "foreign zeroing, by a current sensor: %zu; noticed after median %.0f ms, largest %.0f ms\n",
      took.size(), took[took.size() / 2], took.back());
  EXPECT_LT(took.back(), 200);
}

/// A control group (version 2) in which this process, and what it starts, is while it lives.
class ControlGroup {
 public:
  ControlGroup() {
    std::ifstream mounts("/proc/self/mounts");
    for (std::string line; std::getline(mounts, line);) {
      std::istringstream words(line);
      std::string device, place, type;
      words >> device >> place >> type;
      if (type == "cgroup2") root_ = place;
    }
    std::error_code error;
    group_ = root_ / ("vitreo_test-" + std::to_string(getpid()));
    there_ = !root_.empty() && std::filesystem::create_directory(group_, error) && !error &&
             std::filesystem::exists(group_ / "cgroup.kill");
  }
  ~ControlGroup() {
    leave();
    for (int i = 0; i < 100 && ::rmdir(group_.c_str()) != 0 && errno == EBUSY; ++i)
      std::this_thread::sleep_for(10ms);
  }
  ControlGroup(const ControlGroup&) = delete;
  ControlGroup& operator=(const ControlGroup&) = delete;
  bool there() const { return there_; }
  void enter(pid_t process) const { write(group_ / "cgroup.procs", std::to_string(process)); }
  void leave() const { write(root_ / "cgroup.procs", std::to_string(getpid())); }
  void kill() const { write(group_ / "cgroup.kill", "1"); }

 private:
  static void write(const std::filesystem::path& file, const std::string& text) {
    std::ofstream(file) << text << std::flush;
  }
  std::filesystem::path root_, group_;
  bool there_ = false;
};

TEST_F(GuardianTest, OutlivesTheControlGroupOfItsHost) {
  const ControlGroup group;
  if (!group.there()) GTEST_SKIP() << "wants cgroup v2 and the right to make a group";
  for (const bool shared : {false, true}) {
    Kepco amplifier;  // a testbed would put its own files in the place of /sys
    group.enter(getpid());
    const std::unique_ptr<Host> host = energize(amplifier, kHeld);
    group.leave();
    ASSERT_NE(host, nullptr);
    const pid_t guardian = host->guardian();
    ASSERT_GT(guardian, 0);
    // What the test can see: a guardian that is in the group dies with it.
    if (shared) group.enter(guardian);
    group.kill();
    const auto zero = time_until(2s, [&] { return amplifier.output() < 1e-3; });
    if (shared) {
      EXPECT_FALSE(zero) << "so a current flows on";
      continue;
    }
    ASSERT_TRUE(zero) << log();
    std::printf("control group killed: at zero after %.0f ms\n", zero->count());
    EXPECT_TRUE(time_until(5s, [&] { return guardian_says("is at zero"); })) << log();
  }
}

}  // namespace
}  // namespace vitreo
