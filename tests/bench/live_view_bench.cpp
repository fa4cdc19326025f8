// Bench of the live view: a camera of 640x480 at 30 frames a second in real time, every frame
// through the chain to currents and into the record, shown to none, one or two viewers, each a
// process of its own that reads all it gets, or to browsers that do not: one that never reads and
// comes again every 2 s, one whose line carries 64 kB/s. Printed: the share of a core that the
// threads beside the chain's took (the server, its encoding, the recorder's writing), the chain's
// median and 99 % quantile, and how many frames a second a viewer got. Goals: 25 % of a core for
// two, and a chain that is as it was.
// SPDX-License-Identifier: Apache-2.0
#include "host/record/recorder.h"
#include "host/rig/open_rig.h"
#include "host/servo/servo_record.h"
#include "host/session/progress_listener.h"
#include "host/session/session.h"
#include "host/view/live_view.h"

#include <benchmark/benchmark.h>

#include <algorithm>
#include <arpa/inet.h>
#include <chrono>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <netinet/in.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

namespace {

using namespace vitreo;

constexpr int kFrames = 600, kRate = 30;  // 20 s

double cpu_seconds(clockid_t clock) {
  timespec time{};
  clock_gettime(clock, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

class Deaf final : public ProgressListener {
 public:
  void progress(double, const std::string&) override {}
  void message(const std::string&) override {}
};

/// Reads exactly so many bytes; false at the end.
bool read_all(int socket, void* into, std::size_t bytes) {
  return ::recv(socket, into, bytes, MSG_WAITALL) == static_cast<ssize_t>(bytes);
}

std::string until_empty_line(int socket) {
  std::string text;
  for (char c = 0; !text.ends_with("\r\n\r\n") && ::recv(socket, &c, 1, 0) == 1;) text += c;
  return text;
}

enum class Habit { reads, slow, never_reads };
constexpr std::size_t kSlowRate = 64000;  // B/s
constexpr unsigned kComesAgain = 2;       // s

/// Counts the pictures that come until the server closes; a slow one pauses for each byte.
void read_pictures(int live, int report, Habit habit) {
  int pictures = 0;
  std::vector<char> payload;
  for (unsigned char head[2]; read_all(live, head, 2);) {
    std::uint64_t length = head[1] & 0x7f;
    unsigned char more[8];
    if (length >= 126) {
      const std::size_t bytes = length == 126 ? 2 : 8;
      if (!read_all(live, more, bytes)) return;
      length = 0;
      for (std::size_t i = 0; i < bytes; ++i) length = length << 8 | more[i];
    }
    payload.resize(length);
    if (length > 0 && !read_all(live, payload.data(), length)) return;
    if (habit == Habit::slow) usleep(static_cast<useconds_t>(1000000 * length / kSlowRate));
    if ((head[0] & 0x0f) == 2) ++pictures;
    const std::string pong("\x8a\x80\0\0\0\0", 6);  // the viewer is there
    if (pictures % 50 == 49 || habit == Habit::slow)
      ::send(live, pong.data(), pong.size(), MSG_NOSIGNAL);
    [[maybe_unused]] const auto written = ::pwrite(report, &pictures, sizeof pictures, 0);
  }
}

/// One viewer: lets itself in, opens the socket, and counts the pictures until it is closed. Never
/// returns.
[[noreturn]] void watch(const std::string& invitation, int report, Habit habit) {
  const std::size_t port_at = invitation.find(':', 7) + 1, path_at = invitation.find('/', 7);
  const std::string host = invitation.substr(7, path_at - 7);
  sockaddr_in address = {};
  address.sin_family = AF_INET;
  address.sin_port =
      htons(static_cast<std::uint16_t>(std::stoi(invitation.substr(port_at, path_at - port_at))));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  const auto open = [&] {
    const int socket = ::socket(AF_INET, SOCK_STREAM, 0);
    const int small = 4096;  // B: what the kernel takes for one that does not read
    if (habit != Habit::reads) setsockopt(socket, SOL_SOCKET, SO_RCVBUF, &small, sizeof small);
    if (connect(socket, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) _exit(1);
    return socket;
  };
  const auto say = [](int socket, const std::string& text) {
    ::send(socket, text.data(), text.size(), MSG_NOSIGNAL);
  };
  const int first = open();
  say(first, "GET " + invitation.substr(path_at) + " HTTP/1.1\r\nHost: " + host +
                 "\r\nConnection: close\r\n\r\n");
  const std::string reply = until_empty_line(first);
  const std::size_t begin = reply.find("vitreo=");
  if (begin == std::string::npos) _exit(2);
  const std::string upgrade =
      "GET /live HTTP/1.1\r\nHost: " + host + "\r\nOrigin: http://" + host +
      "\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
      "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nCookie: " +
      reply.substr(begin, reply.find(';', begin) - begin) + "\r\n\r\n";
  do {
    const int live = open();
    say(live, upgrade);
    if (until_empty_line(live).find(" 101 ") == std::string::npos) _exit(3);
    if (habit == Habit::never_reads)
      sleep(kComesAgain);
    else
      read_pictures(live, report, habit);
    close(live);
  } while (habit != Habit::reads);  // one that was dropped comes again
  _exit(0);
}

class Viewer {
 public:
  explicit Viewer(const std::string& invitation, Habit habit = Habit::reads) {
    char name[] = "/tmp/vitreo_viewer_XXXXXX";
    report_ = mkstemp(name);
    unlink(name);
    pid_ = fork();
    if (pid_ == 0) watch(invitation, report_, habit);
  }
  ~Viewer() {
    kill(pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
    close(report_);
  }
  Viewer(const Viewer&) = delete;
  Viewer& operator=(const Viewer&) = delete;
  int pictures() const {
    int count = 0;
    return pread(report_, &count, sizeof count, 0) == sizeof count ? count : 0;
  }

 private:
  int report_ = -1;
  pid_t pid_ = -1;
};

double quantile(std::vector<double> values, double part) {
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(part * static_cast<double>(values.size() - 1))];
}

/// The rig, its session and record, and the chain of one camera.
class Laboratory {
 public:
  Laboratory()
      : clock_(virtual_clock(Pace::real_time)),
        rig_(open_rig(description(), *clock_, 1)),
        recorder_(folder(), start()),
        session_(*clock_, rig_->rig(), recorder_, deaf_, 1),
        view_({.on = true}, deaf_) {
    session_.real_time = true;
    view_.begin(session_);
    localizer_.emplace(rig_->rig().model, session_.learn_background(15), Eigen::Vector3d::UnitX());
    ControllerSettings settings;
    settings.law = ControlLaw::estimator;
    chain_.emplace(rig_->rig().model, settings);
    record_.emplace(recorder_, rig_->rig(), Eigen::Vector3d::UnitX(), "benchmark", true);
  }
  ~Laboratory() {
    view_.end("completed");
    rig_->make_safe();
    std::filesystem::remove_all(folder_);
  }
  Laboratory(const Laboratory&) = delete;
  Laboratory& operator=(const Laboratory&) = delete;

  std::string invitation() { return view_.invitation(); }

  struct Took {
    double chain = -1;  // s of wall time, from the frame to currents; -1: the robot is not seen
    double whole = 0;   // with what goes to the record and to those who watch it
  };
  /// One frame.
  Took tick(int number) {
    if (number % 15 == 0)
      rig_->rig().sample->insert_robot({-1e-3 + 2e-3 * (number % 300) / 300, 0, 0});
    const Frame frame = rig_->rig().top_camera->grab(kForever);
    const auto begin = std::chrono::steady_clock::now();
    const Observation seen = localizer_->look(frame.image);
    std::optional<control::PositionMeasurement> measured;
    if (seen.position) measured = {to_seconds(frame.exposed), *seen.position, seen.noise()};
    const Time decided = clock_->now();
    const ControlStep step = chain_->step(to_seconds(decided), measured, {}, ControlMode::follow);
    const auto since = [begin] {
      return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    };
    Took took;
    if (seen.position) took.chain = since();
    record_->sample(frame.exposed, decided, clock_->now(), seen, {}, step);
    took.whole = since();
    return took;
  }

 private:
  static RigDescription description() {
    RigDescription made;
    made.file = "benchmark";
    made.table["top_camera"] =
        ConfigValue{ConfigTable{{"width_px", {640.0}},
                                {"height_px", {480.0}},
                                {"frame_rate", {static_cast<double>(kRate)}}}};
    for (const char* role : {"coils", "sample"}) made.table[role] = ConfigValue{ConfigTable{}};
    return made;
  }
  static RunStart start() {
    RunStart made;
    made.parameters = made.parameter_units = made.rig = made.versions = nlohmann::json::object();
    made.devices = made.files = nlohmann::json::object();
    return made;
  }
  const std::filesystem::path& folder() {
    std::string name =
        (std::filesystem::temp_directory_path() / "vitreo_view_bench_XXXXXX").string();
    return folder_ = mkdtemp(name.data());
  }

  Deaf deaf_;
  std::filesystem::path folder_;
  std::unique_ptr<Clock> clock_;
  std::unique_ptr<OpenRig> rig_;
  Recorder recorder_;
  Session session_;
  view::LiveView view_;
  std::optional<Localizer> localizer_;
  std::optional<ServoController> chain_;
  std::optional<ServoRecord> record_;
};

void show_to(benchmark::State& state, const std::vector<Habit>& habits) {
  Laboratory laboratory;
  std::vector<std::unique_ptr<Viewer>> watching;
  for (const Habit habit : habits)
    watching.push_back(std::make_unique<Viewer>(laboratory.invitation(), habit));
  std::vector<double> took, whole;
  for (int i = 0; i < kRate; ++i) laboratory.tick(i);  // until everybody is there
  for (auto _ : state) {
    const auto pictures = [&] { return watching.empty() ? 0 : watching.back()->pictures(); };
    const int before = pictures();
    const auto begin = std::chrono::steady_clock::now();
    const double all = cpu_seconds(CLOCK_PROCESS_CPUTIME_ID),
                 own = cpu_seconds(CLOCK_THREAD_CPUTIME_ID);
    for (int i = 0; i < kFrames; ++i) {
      const auto one = laboratory.tick(i);
      if (one.chain > 0) took.push_back(one.chain * 1e6), whole.push_back(one.whole * 1e6);
    }
    const double others =
        cpu_seconds(CLOCK_PROCESS_CPUTIME_ID) - all - (cpu_seconds(CLOCK_THREAD_CPUTIME_ID) - own);
    const double wall =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    state.counters["others_%"] = 100 * others / wall;
    state.counters["shown_per_s"] = (pictures() - before) / wall;
  }
  if (took.empty()) return state.SkipWithError("the robot was never seen");
  state.counters["median_us"] = quantile(took, 0.5);
  state.counters["p99_us"] = quantile(took, 0.99);
  state.counters["recorded_p99_us"] = quantile(whole, 0.99);
  state.counters["recorded_max_us"] = quantile(whole, 1);
  state.counters["seen"] = static_cast<double>(took.size());
}

void viewers(benchmark::State& state) {
  show_to(state, std::vector<Habit>(static_cast<std::size_t>(state.range(0)), Habit::reads));
}
BENCHMARK(viewers)
    ->Name("live_view/viewers")
    ->Arg(0)
    ->Arg(1)
    ->Arg(2)
    ->Iterations(1)
    ->UseRealTime()
    ->Unit(benchmark::kSecond);

// The chain must be as it is without them.
void slow_browsers(benchmark::State& state) {
  static const std::vector<std::vector<Habit>> kHabits = {
      {},
      {Habit::never_reads},
      {Habit::slow},
      {Habit::never_reads, Habit::never_reads, Habit::never_reads, Habit::slow, Habit::slow,
       Habit::reads}};
  static const char* const kLabels[] = {"none", "never reads", "64 kB/s", "3 + 2 of these, 1 good"};
  state.SetLabel(kLabels[state.range(0)]);
  show_to(state, kHabits.at(static_cast<std::size_t>(state.range(0))));
}
BENCHMARK(slow_browsers)
    ->Name("live_view/slow_browsers")
    ->DenseRange(0, 3)
    ->Iterations(1)
    ->UseRealTime()
    ->Unit(benchmark::kSecond);

}  // namespace
