// `vitreo sweep --slurm` on two nodes of a Slurm of the test's own, on this machine, as the
// user of the test; one node is killed half-way.
// SPDX-License-Identifier: Apache-2.0
#include "tests/program/program.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <arpa/inet.h>
#include <array>
#include <chrono>
#include <csignal>
#include <netdb.h>
#include <netinet/in.h>
#include <pwd.h>
#include <set>
#include <sstream>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <thread>
#include <vector>

namespace vitreo {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

constexpr const char* kChance = R"(
local units = require "units"
local mm, s = units.mm, units.s
return {
  title = "Chance",
  needs = { "coils" },
  parameters = { speed = { unit = "mm/s", default = 1 * mm / s, min = 0, max = 2 * mm / s } },
  run = function(rig, p, run)
    run:wait(0.1 * s)
    run:result("error", p.speed * (1 + math.random()), "m")
  end,
}
)";

/// The standard output of a shell's command, without the last line end.
std::string said(const std::string& command) {
  std::string text;
  FILE* const pipe = popen((command + " 2>&1").c_str(), "r");
  std::array<char, 4096> part{};
  for (std::size_t got = 0; (got = fread(part.data(), 1, part.size(), pipe)) > 0;)
    text.append(part.data(), got);
  pclose(pipe);
  while (text.ends_with('\n')) text.pop_back();
  return text;
}

std::vector<int> free_ports(int count) {
  std::vector<int> ports;
  std::vector<int> sockets;  // all open together, so that no port comes twice
  for (int i = 0; i < count; ++i) {
    sockets.push_back(::socket(AF_INET, SOCK_STREAM, 0));
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    ::bind(sockets.back(), reinterpret_cast<sockaddr*>(&address), size);
    ::getsockname(sockets.back(), reinterpret_cast<sockaddr*>(&address), &size);
    ports.push_back(ntohs(address.sin_port));
  }
  for (const int one : sockets) ::close(one);
  return ports;
}

std::vector<pid_t> children_of(pid_t parent) {
  std::vector<pid_t> all;
  for (const auto& entry : fs::directory_iterator("/proc")) {
    const std::string name = entry.path().filename();
    if (name.find_first_not_of("0123456789") != std::string::npos) continue;
    std::ifstream file(entry.path() / "stat");
    std::string line;
    std::getline(file, line);
    std::istringstream behind(line.substr(std::min(line.rfind(')'), line.size() - 1) + 1));
    std::string state;
    pid_t of = -1;
    if (behind >> state >> of && of == parent) all.push_back(std::stoi(name));
  }
  return all;
}

/// Everything below the process, the process last.
std::vector<pid_t> tree_of(pid_t root) {
  std::vector<pid_t> tree;
  for (const pid_t child : children_of(root))
    for (const pid_t one : tree_of(child)) tree.push_back(one);
  tree.push_back(root);
  return tree;
}

/// Slurm with two nodes, eye1 and eye2, of one processor each. It ends with the scope, and leaves
/// no process.
class TwoNodes {
 public:
  TwoNodes() {
    std::string name = "/tmp/vitreo_slurm_XXXXXX";  // munge refuses a socket whose path is long
    folder_ = mkdtemp(name.data());
    ::chmod(folder_.c_str(), 0755);  // and one in a folder that others may not enter
    for (const char* sub : {"state", "spool1", "spool2", "log", "run"})
      fs::create_directory(folder_ / sub);
    write_configuration();
    daemons_.push_back(
        start({"munged", "--foreground", "--force", "--key-file=" + at("munge.key"),
               "--socket=" + at("run/munge.socket"), "--pid-file=" + at("run/munged.pid"),
               "--log-file=" + at("log/munged.log"), "--seed-file=" + at("run/munged.seed"),
               "--num-threads=1"}));
    wait_for([this] { return fs::exists(at("run/munge.socket")); });
    setenv("SLURM_CONF", at("slurm.conf").c_str(), 1);
    daemons_.push_back(start({"slurmctld", "-D", "-c"}));
    for (const char* node : {"eye1", "eye2"})
      daemons_.push_back(start({"slurmd", "-D", "-c", "-N", node}));
    up_ = wait_for([] { return ::vitreo::said("timeout 5 sinfo -h -o '%D %t'") == "2 idle"; });
  }
  ~TwoNodes() {
    for (auto daemon = daemons_.rbegin(); daemon != daemons_.rend(); ++daemon) end(*daemon);
    unsetenv("SLURM_CONF");
    fs::remove_all(folder_);
  }
  TwoNodes(const TwoNodes&) = delete;
  TwoNodes& operator=(const TwoNodes&) = delete;
  bool up() const { return up_; }
  std::string logs() const { return said("tail -n 20 " + at("log") + "/*; timeout 5 sinfo"); }

  /// As when its power fails: nothing of it gets another instruction.
  void kill_node(int number) {
    const pid_t daemon = daemons_.at(static_cast<std::size_t>(number) + 1);
    std::vector<pid_t> all = tree_of(daemon);
    // Its steps run on when slurmd dies, as processes of their own.
    for (const std::string& line : steps_of(number))
      for (const pid_t one : tree_of(std::stoi(line))) all.push_back(one);
    for (const pid_t one : all) ::kill(one, SIGSTOP);
    for (const pid_t one : all) ::kill(one, SIGKILL);
    waitpid(daemon, nullptr, 0);
    daemons_.at(static_cast<std::size_t>(number) + 1) = -1;
    said("timeout 10 scontrol update nodename=eye" + std::to_string(number) +
         " state=down reason=test");
  }

 private:
  std::string at(const std::string& below) const { return (folder_ / below).string(); }

  /// slurmstepd of that node: their parent is init, their environment names the node's spool.
  std::vector<std::string> steps_of(int number) const {
    std::vector<std::string> steps;
    for (const auto& entry : fs::directory_iterator("/proc")) {
      const std::string name = entry.path().filename();
      if (name.find_first_not_of("0123456789") != std::string::npos) continue;
      std::ifstream environment(entry.path() / "environ", std::ios::binary);
      std::ostringstream text;
      text << environment.rdbuf();
      if (text.str().find("SLURMD_NODENAME=eye" + std::to_string(number)) != std::string::npos &&
          text.str().find(folder_.string()) != std::string::npos)
        steps.push_back(name);
    }
    return steps;
  }

  static pid_t start(const std::vector<std::string>& words) {
    const pid_t process = fork();
    if (process != 0) return process;
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    std::vector<char*> arguments;
    for (const std::string& word : words) arguments.push_back(const_cast<char*>(word.c_str()));
    arguments.push_back(nullptr);
    setenv("PATH", (std::string(getenv("PATH")) + ":/usr/sbin:/sbin").c_str(), 1);
    freopen("/dev/null", "w", stdout);
    freopen("/dev/null", "w", stderr);
    execvp(arguments[0], arguments.data());
    _exit(127);
  }

  static void end(pid_t process) {
    if (process <= 0) return;
    const std::vector<pid_t> tree = tree_of(process);
    ::kill(process, SIGTERM);
    for (int i = 0; i < 500 && waitpid(process, nullptr, WNOHANG) == 0; ++i)
      std::this_thread::sleep_for(10ms);
    for (const pid_t one : tree) ::kill(one, SIGKILL);
    waitpid(process, nullptr, 0);
  }

  template <class Condition>
  static bool wait_for(Condition condition) {
    const auto until = std::chrono::steady_clock::now() + 30s;
    while (std::chrono::steady_clock::now() < until) {
      if (condition()) return true;
      std::this_thread::sleep_for(50ms);
    }
    return false;
  }

  // slurm.conf(5); no accounting, no cgroups, no root: everything runs as the user of the test.
  void write_configuration() const {
    std::ofstream key(at("munge.key"), std::ios::binary);
    std::ifstream random("/dev/urandom", std::ios::binary);
    std::array<char, 128> bytes{};
    random.read(bytes.data(), bytes.size());
    key.write(bytes.data(), bytes.size());
    key.close();
    ::chmod(at("munge.key").c_str(), 0600);
    const std::vector<int> ports = free_ports(3);
    const std::string user = getpwuid(getuid())->pw_name;
    const std::string host = said("hostname -s");
    std::ofstream(at("slurm.conf"))
        << "ClusterName=vitreo_test\nSlurmctldHost=" << host << "(127.0.0.1)\nSlurmUser=" << user
        << "\nSlurmdUser=" << user
        << "\nAuthType=auth/munge\nAuthInfo=socket=" << at("run/munge.socket")
        << "\nCredType=cred/munge\nSlurmctldPort=" << ports[0]
        << "\nStateSaveLocation=" << at("state") << "\nSlurmdSpoolDir=" << folder_.string()
        << "/spool_%n\nSlurmctldPidFile=" << at("run/slurmctld.pid")
        << "\nSlurmdPidFile=" << folder_.string()
        << "/run/%n.pid\nSlurmctldLogFile=" << at("log/slurmctld.log")
        << "\nSlurmdLogFile=" << folder_.string() << "/log/%n.log\n"
        << "PlugStackConfig=/dev/"
           "null\nProctrackType=proctrack/linuxproc\nTaskPlugin=task/none\n"
           "JobAcctGatherType=jobacct_gather/none\nAccountingStorageType=accounting_storage/none\n"
           "JobCompType=jobcomp/none\nSwitchType=switch/none\nMpiDefault=none\n"
           "SchedulerType=sched/builtin\nSchedulerParameters=batch_sched_delay=0,sched_interval=1\n"
           "SelectType=select/cons_tres\nSelectTypeParameters=CR_Core\nReturnToService=2\n"
           "KillWait=2\nSlurmdParameters=config_overrides\nMaxArraySize=10001\n"
        << "NodeName=eye[1-2] NodeHostname=" << host << " NodeAddr=127.0.0.1 Port=" << ports[1]
        << "," << ports[2] << " CPUs=1 RealMemory=2000 State=UNKNOWN\n"
        << "PartitionName=all Nodes=eye[1-2] Default=YES MaxTime=INFINITE State=UP\n";
  }

  fs::path folder_;
  std::vector<pid_t> daemons_;  // munged, slurmctld, eye1, eye2
  bool up_ = false;
};

std::vector<fs::path> marks_below(const fs::path& sweep) {
  std::vector<fs::path> marks;
  std::error_code none;
  for (const auto& entry : fs::recursive_directory_iterator(sweep / "done", none))
    if (entry.path().extension() == ".json") marks.push_back(entry.path());
  return marks;
}

bool is_installed(const std::string& program) {
  return std::system(
             ("PATH=$PATH:/usr/sbin:/sbin command -v " + program + " >/dev/null").c_str()) == 0;
}

/// Slurm 22.05 asks the resolver for nothing else (AI_ADDRCONFIG), and does not start without.
bool has_network() {
  addrinfo wanted{};
  wanted.ai_family = AF_INET;
  wanted.ai_flags = AI_PASSIVE | AI_ADDRCONFIG;
  wanted.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  if (::getaddrinfo(nullptr, "1", &wanted, &found) != 0) return false;
  ::freeaddrinfo(found);
  return true;
}

/// Why there can be no Slurm here; "" where there can.
std::string no_slurm() {
  for (const char* program : {"munged", "slurmctld", "slurmd", "sbatch"})
    if (!is_installed(program))
      return std::string(program) + " is missing: make setup installs it (slurm-wlm, munge)";
  return has_network() ? "" : "no address but the loopback's, and Slurm wants another";
}

TEST(SweepSlurm, OnTwoNodesOfWhichOneIsKilledTheTableIsThatOfOneCoreByteForByte) {
  if (const std::string why = no_slurm(); !why.empty()) GTEST_SKIP() << why;
  const Workplace place;
  place.write("chance.lua", kChance);
  const std::string words = "sweep chance.lua speed=0.1..2mm/s:40 --repeat 4 --rig fast ";
  const Spoken alone = place.vitreo(words + "--jobs 1 --out alone");
  ASSERT_EQ(alone.exit_code, 0) << alone.err;
  TwoNodes nodes;
  ASSERT_TRUE(nodes.up()) << nodes.logs();
  Spoken swept;
  std::thread sweep([&] { swept = place.vitreo(words + "--slurm --tasks 2 --out swept --json"); });
  const auto until = std::chrono::steady_clock::now() + 120s;
  while (marks_below(place.folder() / "swept").size() < 60 &&
         std::chrono::steady_clock::now() < until)
    std::this_thread::sleep_for(10ms);
  const std::size_t at_kill = marks_below(place.folder() / "swept").size();
  nodes.kill_node(2);
  sweep.join();
  EXPECT_GE(at_kill, 60U) << nodes.logs();
  EXPECT_LT(at_kill, 150U) << "it must be killed half-way";
  if (swept.exit_code != 0)  // where the other node's task had ended before it could take over
    swept = place.vitreo("sweep --resume swept --slurm --json");
  EXPECT_EQ(swept.exit_code, 0) << swept.out << swept.err << nodes.logs();
  EXPECT_EQ(place.read("swept/sweep.csv"), place.read("alone/sweep.csv"));
  EXPECT_EQ(place.read("swept/sweep.sqlite"), place.read("alone/sweep.sqlite"));
  std::set<std::string> runs;  // that count
  for (const fs::path& mark : marks_below(place.folder() / "swept")) {
    const auto result = nlohmann::json::parse(std::ifstream(mark));
    EXPECT_TRUE(runs.insert(result["run"]).second) << "a run counts twice";
  }
  EXPECT_EQ(runs.size(), 160U);
  std::set<std::string> owners;
  for (const auto& entry : fs::recursive_directory_iterator(place.folder() / "swept/claims"))
    if (entry.is_regular_file())
      owners.insert(nlohmann::json::parse(std::ifstream(entry.path())).value("node", ""));
  EXPECT_EQ(owners, (std::set<std::string>{"eye1", "eye2"})) << "both nodes must have worked";
}

// The seeds of a soak go the same way as the points of a sweep.
TEST(SweepSlurm, ASoakSaysThereWhatItSaysHere) {
  if (const std::string why = no_slurm(); !why.empty()) GTEST_SKIP() << why;
  const Workplace place;
  const std::string soak = "soak hello_rig --seeds 24 --json ";
  const Spoken alone = place.vitreo(soak + "--jobs 1");
  ASSERT_EQ(alone.exit_code, 0) << alone.out << alone.err;
  TwoNodes nodes;
  ASSERT_TRUE(nodes.up()) << nodes.logs();
  const Spoken there = place.vitreo(soak + "--slurm --tasks 2");
  EXPECT_EQ(there.exit_code, 0) << there.out << there.err << nodes.logs();
  // What follows the seeds has its own wall time, and an emergency stop comes from a thread that
  // keeps none but the wall clock's.
  const auto seeds_of = [](const std::string& text) {
    std::string seeds;
    std::istringstream lines(text);
    for (std::string line; std::getline(lines, line);)
      if (line.find("\"digest\"") != std::string::npos &&
          line.find("emergency stop") == std::string::npos)
        seeds += line + "\n";
    return seeds;
  };
  EXPECT_EQ(std::count(there.out.begin(), there.out.end(), '\n'), 25);
  EXPECT_EQ(seeds_of(there.out), seeds_of(alone.out));
  EXPECT_NE(there.err.find("Slurm job "), std::string::npos) << there.err;
}

}  // namespace
}  // namespace vitreo
