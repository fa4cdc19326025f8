// SPDX-License-Identifier: Apache-2.0
#include "tests/host/safety/guardian/guardian_bench.h"

#include "devices/links/address.h"
#include "tests/devices/links/echo_peer.h"
#include "tests/long_form.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <fcntl.h>
#include <fstream>
#include <spawn.h>
#include <sstream>
#include <sys/wait.h>
#include <unistd.h>
#include <utility>

extern char** environ;

namespace vitreo {
namespace {

const UsbIdentity kUsb3103{0x09DB,     0x009C, 0x0100, "01A2B3C4", "Measurement Computing Corp",
                           "USB-3103", ""};

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

void write(const std::filesystem::path& file, const std::string& text) {
  std::ofstream(file) << text << std::flush;
}

}  // namespace

int trials() { return long_or_short(200, 5); }

const char* const kProtocol = R"(
local s = require("units").s
return { title = "Currents that change all the time", needs = { "coils" }, parameters = {},
  run = function(rig, p, run)
    local channels = #rig.coils:currents()
    for k = 1, 800 do -- 8 s, beyond every kill: the preflight rehearses all of it each time
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

Usb::Usb() : plugged(testbed->plug(*emulator, kUsb3103)) {}

double Usb::output() {
  double most = 0;
  testbed->with_emulators([&] {
    for (const double volts : emulator->outputs()) most = std::max(most, std::abs(volts));
  });
  return most;
}

bool Usb::enabled() {
  bool high = false;
  testbed->with_emulators([&] { high = emulator->line_is_high(0); });
  return high;
}

DoubledUsb::DoubledUsb(std::string keys, const std::vector<std::string>& wired, std::string its)
    : role(std::move(its)),
      table(std::move(keys)),
      interface(DoubleProcess::on_socket("usb3103", wired)),
      plugged(testbed->plug(*peer, kUsb3103)) {}

std::string DoubledUsb::rig() const {
  return role + " = { driver = \"" + (role == "lamp" ? "led" : "usb3103") +
         "\", address = \"hid:09db:009c\", " + table + " }";
}

void DoubledUsb::plug() { plugged = testbed->plug(*peer, kUsb3103); }

HeartbeatUsb::HeartbeatUsb(const std::string& its_role)
    : DoubledUsb("enable_line = 0, heartbeat = 50, one_shot = 0.07, pick_up = 0.15",
                 {"one_shot=0.07", "one_shot_line=0", "relay_release=0.015", "relay_operate=0.1"},
                 its_role) {}

double Kepco::output() {
  return end.look([&] { return std::abs(emulator->current()); });
}

bool Kepco::enabled() {
  return end.look([&] { return emulator->output(); });
}

void Kepco::switch_on(Clock& clock) {
  open_byte_link(end.address(), {}, clock)
      ->write(bytes("SYST:REM 1;:FUNC:MODE CURR;:CURR:LIM 2;:CURR 1.5;:OUTP ON\n"), 1s);
  ASSERT_TRUE(time_until(2s, [&] { return enabled() && output() > 1; }));
}

Host::Host(const std::filesystem::path& folder, const std::string& role, const char* script) {
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
  if (posix_spawn(&pid_, words[0], &actions, nullptr, const_cast<char**>(words.data()), environ) !=
      0)
    pid_ = -1;
  posix_spawn_file_actions_destroy(&actions);
}

Host::~Host() {
  if (pid_ < 0) return;
  if (const pid_t its = guardian(); its > 0) kill(its, SIGKILL);
  kill(pid_, SIGKILL);
  waitpid(pid_, nullptr, 0);
}

pid_t Host::guardian() const { return child_of(pid_, "vitreo_guardian"); }

// kill() takes -1 for everybody.
void Host::signal(int number) const {
  if (pid_ > 0) kill(pid_, number);
}

void Host::signal_guardian(int number) const {
  const pid_t its = guardian();
  ASSERT_GT(its, 0) << "there is no guardian";
  kill(its, number);
}

std::optional<int> Host::status() {
  int status = 0;
  if (pid_ < 0 || waitpid(pid_, &status, WNOHANG) != pid_) return std::nullopt;
  pid_ = -1;
  return status;
}

GuardianTest::GuardianTest() {
  std::string name = (std::filesystem::temp_directory_path() / "vitreo_guardian_XXXXXX").string();
  folder = mkdtemp(name.data());
}

std::string GuardianTest::log() const {
  std::ostringstream text;
  text << std::ifstream(folder / "err").rdbuf();
  return text.str();
}

Steady::duration GuardianTest::drawn(double least, double most) {
  return std::chrono::duration_cast<Steady::duration>(
      std::chrono::duration<double>(std::uniform_real_distribution(least, most)(random)));
}

std::unique_ptr<Host> GuardianTest::try_energize(Amplifier& amplifier, const char* script) {
  std::filesystem::remove(folder / "err");
  std::filesystem::remove_all(folder / "runs");  // each keeps room for its end record
  auto host = std::make_unique<Host>(folder, amplifier.rig(), script);
  bool energized = false;
  time_until(20s,
             [&] { return (energized = amplifier.output() > 0.4) || host->status().has_value(); });
  return energized ? std::move(host) : nullptr;
}

std::unique_ptr<Host> GuardianTest::energize(Amplifier& amplifier, const char* script) {
  std::unique_ptr<Host> host = try_energize(amplifier, script);
  if (host == nullptr) ADD_FAILURE() << "no current flows: " << log();
  return host;
}

double GuardianTest::trial(Amplifier& amplifier, int first_signal, const char* script) {
  const std::unique_ptr<Host> begun = energize(amplifier, script);
  if (begun == nullptr) return 1e9;
  Host& host = *begun;
  std::this_thread::sleep_for(drawn(0, 0.05));
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

int GuardianTest::exit_code(Host& host, Steady::duration patience) {
  std::optional<int> status;
  if (!time_until(patience, [&] { return (status = host.status()).has_value(); })) {
    ADD_FAILURE() << "the host does not end: " << log();
    return -1;
  }
  EXPECT_TRUE(WIFEXITED(*status)) << "signal " << WTERMSIG(*status) << ": " << log();
  return WIFEXITED(*status) ? WEXITSTATUS(*status) : -1;
}

double GuardianTest::trial_of_frozen(Amplifier& amplifier, const char* script) {
  const std::unique_ptr<Host> host = energize(amplifier, script);
  if (host == nullptr) return 1e9;
  const EndedAtLast guardian{host->guardian()};
  std::this_thread::sleep_for(drawn(0, 0.05));
  host->signal_guardian(SIGSTOP);
  const auto zero = time_until(10s, [&] { return amplifier.output() < 1e-3; });
  EXPECT_TRUE(zero) << log();
  if (!zero) return 1e9;
  EXPECT_FALSE(time_until(100ms, [&] { return amplifier.output() > 1e-3; })) << "energized again";
  EXPECT_EQ(exit_code(*host, 5s), 4) << log();
  EXPECT_FALSE(amplifier.enabled());
  EXPECT_TRUE(time_until(1s, [&] { return has_ended(guardian.process); })) << "it is left behind";
  return zero->count();
}

void GuardianTest::trials_of(Amplifier& amplifier, const char* name, int first_signal) {
  trials_of(std::string(name) + ", " + (first_signal == SIGKILL ? "SIGKILL" : "SIGSTOP"),
            [&] { return trial(amplifier, first_signal); });
}

void GuardianTest::trials_of(const std::string& name, const std::function<double()>& one) {
  std::vector<double> took;
  for (int i = 0; i < trials() && !HasFailure(); ++i) took.push_back(one());
  std::sort(took.begin(), took.end());
  if (took.empty()) return;
  const auto at = [&](double part) {
    return took[std::min(took.size() - 1,
                         static_cast<std::size_t>(part * static_cast<double>(took.size())))];
  };
  const auto late = std::count_if(took.begin(), took.end(), [](double ms) { return ms > 300; });
  std::printf(
      "%s: %zu; at zero after median %.0f ms, p90 %.0f, p99 %.0f, largest %.0f ms; %ld beyond "
      "300 ms\n",
      name.c_str(), took.size(), at(0.5), at(0.9), at(0.99), took.back(), static_cast<long>(late));
}

EndedAtLast::~EndedAtLast() {
  if (process > 0 && !has_ended(process)) kill(process, SIGKILL);
}

ControlGroup::ControlGroup() {
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

ControlGroup::~ControlGroup() {
  leave();
  for (int i = 0; i < 100 && ::rmdir(group_.c_str()) != 0 && errno == EBUSY; ++i)
    std::this_thread::sleep_for(10ms);
}

void ControlGroup::enter(pid_t process) const {
  write(group_ / "cgroup.procs", std::to_string(process));
}
void ControlGroup::leave() const { write(root_ / "cgroup.procs", std::to_string(getpid())); }
void ControlGroup::kill() const { write(group_ / "cgroup.kill", "1"); }

}  // namespace vitreo
