// Can an output stay on? Each amplifier, with and without a heartbeat line, by doubles of another
// hand; and whatever may befall host, guardian, terminal and cable while it is energized.
// SPDX-License-Identifier: Apache-2.0
#include "tests/host/safety/guardian/guardian_bench.h"

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <map>

namespace vitreo {
namespace VITREO_TEST_FILE {

/// A BOP on a pseudo-terminal, which has another path each time that it is plugged in: the rig file
/// has a lasting name, as those in /dev/serial/by-id.
struct DoubledBop : Amplifier {
  explicit DoubledBop(const std::filesystem::path& folder) : name(folder / "bop") {
    lead(supply.address());
  }
  std::string rig() const override {
    return "coils = { driver = \"kepco_bop\", address = \"serial:" + name.string() +
           "\", max_slope = 1000 }";
  }
  double output() override { return std::abs(supply.number("current")); }
  bool enabled() override { return output() > 1e-3; }
  void unplug() override {
    supply.order(R"({"unplug": true})");
    std::filesystem::remove(name);
  }
  void plug() override {
    const std::string said = supply.order(R"({"plug": true})");
    const std::size_t begin = said.find("/dev/");
    lead(said.substr(begin, said.find('"', begin) - begin));
  }
  void lead(const std::string& address) {
    std::filesystem::remove(name);
    std::filesystem::create_symlink(address.substr(address.find('/')), name);
  }
  const std::filesystem::path name;
  DoubleProcess supply{"kepco_bop"};
};

constexpr double kBeatGoal = 100;  // ms

/// What happens, and within which time, ms, the output is then off.
struct BadDay {
  const char* name;
  std::function<void(Host& host, pid_t guardian, Amplifier& amplifier)> begin;
  double goal;            // without a heartbeat line; 0: then nothing helps
  bool out = false;       // a cable: without a heartbeat line counted from when it is in again
  bool changing = false;  // set-points come all the time
  double beat_goal = kBeatGoal;  // with a heartbeat line
  bool ends = false;             // the host by itself, aborted: its guardian is of no help in that
};

void kill_both(Host& host, pid_t guardian, int signal) {
  if (guardian > 0) kill(guardian, signal);  // which takes -1 for everybody
  host.signal(signal);
}

const std::vector<BadDay>& bad_days() {
  static const std::vector<BadDay> all{
      {"host killed", [](Host& host, pid_t, Amplifier&) { host.signal(SIGKILL); }, 300, false,
       true},
      {"host frozen", [](Host& host, pid_t, Amplifier&) { host.signal(SIGSTOP); }, 300, false,
       true},
      {"guardian killed", [](Host&, pid_t guardian, Amplifier&) { kill(guardian, SIGKILL); }, 300},
      // A host that is well feeds the line meanwhile: it is the host that ends it.
      {"guardian frozen", [](Host&, pid_t guardian, Amplifier&) { kill(guardian, SIGSTOP); }, 300,
       false, false, 300, true},
      {"terminal hung up", [](Host& host, pid_t, Amplifier&) { host.signal(SIGHUP); }, 300},
      {"cable out, and in", [](Host&, pid_t, Amplifier& its) { its.unplug(); }, 3000, true},
      {"both killed at once",
       [](Host& host, pid_t guardian, Amplifier&) { kill_both(host, guardian, SIGKILL); }, 0},
      {"both frozen, as in a suspend or a panic",
       [](Host& host, pid_t guardian, Amplifier&) { kill_both(host, guardian, SIGSTOP); }, 0},
  };
  return all;
}

struct Bench {
  const char* name;
  bool beats;
  std::function<std::unique_ptr<Amplifier>(const std::filesystem::path& folder)> make;
};

const std::vector<Bench>& benches() {
  using Folder = const std::filesystem::path&;
  static const std::vector<Bench> all{
      {"USB-3103", false, [](Folder) { return std::make_unique<DoubledUsb>(); }},
      {"USB-3103, heartbeat line", true, [](Folder) { return std::make_unique<HeartbeatUsb>(); }},
      {"BOP", false, [](Folder folder) { return std::make_unique<DoubledBop>(folder); }},
      {"lamp", false,
       [](Folder) {
         return std::make_unique<DoubledUsb>("enable_line = 0", std::vector<std::string>{}, "lamp");
       }},
      {"lamp, heartbeat line", true, [](Folder) { return std::make_unique<HeartbeatUsb>("lamp"); }},
  };
  return all;
}

class OutputsTest : public GuardianTest {
 protected:
  /// On, and for a while. A machine that is busy otherwise may not keep a beat of 50 Hz, which is a
  /// trip: then once more.
  std::unique_ptr<Host> holding(Amplifier& amplifier, const BadDay& day) {
    const bool changing = day.changing && amplifier.rig().rfind("coils", 0) == 0;
    for (int i = 0; i < 5; ++i) {
      std::unique_ptr<Host> host = try_energize(amplifier, changing ? kProtocol : kHeld);
      std::this_thread::sleep_for(drawn(0.1, 0.15));
      if (host != nullptr && amplifier.output() > 0.4) return host;
    }
    return nullptr;
  }
  /// ms until it is off, and that it stays so; nothing where it stays on.
  std::optional<double> off_after(const Bench& bench, const BadDay& day) {
    const std::unique_ptr<Amplifier> amplifier = bench.make(folder);
    const std::unique_ptr<Host> host = holding(*amplifier, day);
    if (host == nullptr) {
      ADD_FAILURE() << bench.name << ", " << day.name << ": nothing is held: " << log();
      return std::nullopt;
    }
    const pid_t guardian = host->guardian();
    if (guardian <= 0) {
      ADD_FAILURE() << bench.name << ", " << day.name << ": there is no guardian: " << log();
      return std::nullopt;
    }
    const EndedAtLast ended{guardian};
    auto began = Steady::now();
    day.begin(*host, guardian, *amplifier);
    if (day.out && !bench.beats) {
      // The end of the run tries to zero it; nothing reaches it while the cable is out.
      EXPECT_TRUE(time_until(20s, [&] { return host->status().has_value(); })) << log();
      began = Steady::now();
      amplifier->plug();
    }
    const bool off = time_until(5s, [&] { return amplifier->output() < 1e-3; }).has_value();
    const double took = Milliseconds(Steady::now() - began).count();
    if (day.out && bench.beats) amplifier->plug();
    if (off && day.ends) {
      EXPECT_EQ(exit_code(*host, 5s), 4) << bench.name << ", " << day.name << ": " << log();
      EXPECT_TRUE(time_until(1s, [&] { return has_ended(guardian); }))
          << bench.name << ", " << day.name << ": it is left behind";
    }
    host->signal(SIGCONT);
    EXPECT_FALSE(off && time_until(300ms, [&] { return amplifier->output() > 1e-3; }))
        << bench.name << ", " << day.name << ": on again";
    if (off) return took;
    ADD_FAILURE() << bench.name << ", " << day.name << ": stays on; " << log();
    return std::nullopt;
  }
};

// 34 rows: once each, or six times in the long form.
TEST_F(OutputsTest, NoneStaysOnWhateverBefallsHostGuardianTerminalAndCable) {
  std::map<std::pair<const Bench*, const BadDay*>, std::vector<double>> rows;
  int tried = 0;
  int off = 0;
  for (int round = 0; round < (trials() + 33) / 34; ++round)
    for (const Bench& bench : benches())
      for (const BadDay& day : bad_days()) {
        if (!bench.beats && day.goal == 0) continue;
        ++tried;
        const auto took = off_after(bench, day);
        if (!took) continue;
        ++off;
        rows[{&bench, &day}].push_back(*took);
      }
  for (auto& [row, took] : rows) {
    std::sort(took.begin(), took.end());
    const double goal = row.first->beats ? row.second->beat_goal : row.second->goal;
    std::printf("%-26s %-40s %zu: median %.0f ms, largest %.0f ms (goal %.0f)\n", row.first->name,
                row.second->name, took.size(), took[took.size() / 2], took.back(), goal);
    EXPECT_LT(took.back(), goal) << row.first->name << ", " << row.second->name;
  }
  std::printf("outputs off: %d of %d\n", off, tried);
  EXPECT_EQ(off, tried);
}

// What the table can see: the same without the heartbeat.
TEST_F(OutputsTest, WithAStaticLineTheyStayOnWhenHostAndGuardianAreKilledAtOnce) {
  DoubledUsb coils;
  const std::unique_ptr<Host> host = energize(coils);
  ASSERT_NE(host, nullptr);
  kill_both(*host, host->guardian(), SIGKILL);
  EXPECT_FALSE(time_until(1s, [&] { return coils.output() < 0.4; }));
  EXPECT_EQ(coils.interface.number("port_latch"), 1) << "and the line is high";
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
