// The workbench as its users meet it: the real server by bytes of HTTP, killed in the midst, and
// headless Chromium with real clicks (tests/page/workbench.mjs).
// SPDX-License-Identifier: Apache-2.0
#include "tests/host/view/web_client.h"
#include "tests/program/program.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <chrono>
#include <csignal>
#include <functional>
#include <optional>
#include <regex>
#include <sys/stat.h>
#include <thread>

namespace vitreo {
namespace VITREO_TEST_FILE {

namespace fs = std::filesystem;
using nlohmann::json;
using std::chrono::steady_clock;

bool there(const std::string& what) {
  return std::system(("command -v " + what + " >/dev/null 2>&1").c_str()) == 0;
}

/// A place with protocols of its own beside the program's scripts, and a server in it.
class Bench {
 public:
  Bench() {
    fs::create_directory(place.folder() / "protocols");
    fs::create_directory_symlink(VITREO_SOURCE_DIR "/scripts", place.folder() / "scripts");
    for (const char* name : {"hello_rig.lua", "hold.lua", "servo_square.lua"})
      fs::copy_file(fs::path(VITREO_SOURCE_DIR "/protocols") / name,
                    place.folder() / "protocols" / name);
  }
  ~Bench() { stop(SIGKILL); }
  Bench(const Bench&) = delete;
  Bench& operator=(const Bench&) = delete;

  void protocol(const std::string& name, const std::string& text) const {
    place.write("protocols/" + name + ".lua", text);
  }

  void start(const std::string& words = "") {
    process_ = fork();
    if (process_ == 0) {
      const std::string folder = place.folder().string();
      if (chdir(folder.c_str()) != 0) _exit(1);
      setenv("XDG_RUNTIME_DIR", folder.c_str(), 1);
      setenv("XDG_CACHE_HOME", (folder + "/cache").c_str(), 1);
      setenv("VITREO_LOG", (folder + "/host.log").c_str(), 1);
      const std::string line = "exec '" VITREO_PROGRAM
                               "' serve --port 0 --state state --messages messages.json " +
                               words + " >serve.out 2>serve.err";
      execl("/bin/sh", "sh", "-c", line.c_str(), nullptr);
      _exit(1);
    }
    std::smatch found;
    const std::regex address("workbench: http://127.0.0.1:([0-9]+)/");
    for (int i = 0; i < 400; ++i) {
      const std::string said = place.read("serve.out");
      if (std::regex_search(said, found, address)) {
        port_ = static_cast<unsigned short>(std::stoi(found[1]));
        token_ = place.read("state/token").substr(0, 32);
        return;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
    ADD_FAILURE() << "no server: " << place.read("serve.err");
  }
  void stop(int signal) {
    if (process_ <= 0) return;
    kill(process_, signal);
    waitpid(process_, nullptr, 0);
    process_ = -1;
    fs::remove(place.folder() / "serve.out");
  }

  /// The whole reply to these bytes.
  std::string say(const std::string& bytes) const {
    view::Wire wire(port_);
    wire.say(bytes);
    return wire.hear();
  }
  std::string request(const std::string& method, const std::string& path,
                      const std::string& body = "", std::string more = "") const {
    if (more.empty()) more = "Authorization: Bearer " + token_ + "\r\n";
    return say(method + " " + path + " HTTP/1.1\r\nHost: 127.0.0.1:" + std::to_string(port_) +
               "\r\nConnection: close\r\nContent-Length: " + std::to_string(body.size()) + "\r\n" +
               more + "\r\n" + body);
  }
  static int status(const std::string& reply) {
    return reply.size() > 12 ? std::stoi(reply.substr(9, 3)) : 0;
  }
  json ask(const std::string& method, const std::string& path, const json& body = nullptr) const {
    const std::string reply = request(method, path, body.is_null() ? "" : body.dump());
    const std::size_t begin = reply.find("\r\n\r\n");
    json answer =
        begin == std::string::npos ? json() : json::parse(reply.substr(begin + 4), nullptr, false);
    return answer.is_discarded() ? json(reply) : answer;
  }
  json get(const std::string& path) const { return ask("GET", path); }
  json add(const json& job) const { return ask("POST", "/api/queue", job); }

  /// The job once it has ended, within so many seconds.
  json ended(std::int64_t job, int patience = 120) const {
    json shown;
    until(patience, [&] {
      shown = get("/api/jobs/" + std::to_string(job));
      return shown.value("state", "") == "ended";
    });
    EXPECT_EQ(shown.value("state", ""), "ended") << shown;
    return shown;
  }
  static bool until(int patience, const std::function<bool()>& done) {
    const auto end = steady_clock::now() + std::chrono::seconds(patience);
    while (!done()) {
      if (steady_clock::now() > end) return false;
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
    return true;
  }
  unsigned short port() const { return port_; }
  const std::string& token() const { return token_; }

  const Workplace place;

 private:
  pid_t process_ = -1;
  unsigned short port_ = 0;
  std::string token_;
};

constexpr const char* kAsks =
    "local units = require 'units'\n"
    "return { title = 'Asks', parameters = { speed = { default = 0.5 * units.mm / units.s, min = "
    "0.1 * units.mm / units.s, max = 2 * units.mm / units.s, unit = 'mm/s', help = 'how fast' } "
    "},\n"
    "run = function(rig, p, run)\n"
    "  run:note('fixed: ' .. tostring(run:confirm('Is the eye fixed?')))\n"
    "  run:note('eye: ' .. run:ask('Which eye?', { choices = { 'left', 'right' }, name = 'eye' "
    "}))\n"
    "end }\n";

constexpr const char* kWaits =
    "local units = require 'units'\n"
    "return { title = 'Waits', run = function(rig, p, run)\n"
    "  for step = 1, 600 do run:checkpoint('step') run:wait(0.1) end\nend }\n";

TEST(Workbench, RunsAJobAndAsksAPersonWhoIsThere) {
  Bench bench;
  bench.protocol("asks", kAsks);
  bench.start();
  const json form = bench.get("/api/protocols/asks");
  EXPECT_EQ(form.at("parameters").at(0).at("default_text"), "0.5");
  EXPECT_EQ(form.at("parameters").at(0).at("range_text"), "0.1 to 2");
  const json job =
      bench.add({{"protocol", "asks"}, {"values", {{"speed", "1"}}}, {"attended", true}});
  ASSERT_TRUE(job.contains("id")) << job;
  EXPECT_EQ(job.at("command"), "vitreo run asks speed=1mm/s");
  for (const auto& [text, answer] :
       {std::pair<const char*, const char*>{"Is the eye fixed?", "yes"}, {"Which eye?", "left"}}) {
    json running;
    ASSERT_TRUE(Bench::until(60, [&] {
      running = bench.get("/api/run");
      return running.is_object() && running.at("status").is_object() &&
             running["status"].contains("question") &&
             running["status"]["question"]["text"].get<std::string>().find(text) == 0;
    })) << running;
    const json reply = bench.ask("POST", "/api/run", {{"do", "answer"}, {"text", answer}});
    EXPECT_EQ(reply.value("ok", false), true) << reply;
  }
  const json ended = bench.ended(job["id"]);
  EXPECT_EQ(ended.at("outcome"), "completed") << ended;
  const std::string run = ended.at("run");
  EXPECT_EQ(Bench::status(bench.request("GET", "/runs/" + run + "/report.html")), 200);
  const json found = bench.get("/api/runs?find=speed+%3E+0.9mm%2Fs");
  ASSERT_EQ(found.at("total"), 1) << found;
  EXPECT_EQ(found["runs"][0]["values"], json({"1 mm/s"}));
  EXPECT_EQ(bench.get("/api/runs?find=speed+%3E+1.1mm%2Fs").at("total"), 0);
  EXPECT_EQ(bench.get("/api/runs/" + run).at("outcome"), "completed");
}

TEST(Workbench, AQueueOfTwentySurvivesAKilledServer) {
  Bench bench;
  bench.start();
  bench.ask("POST", "/api/queue/hold", {{"held", true}});
  std::vector<std::int64_t> ids;
  for (int i = 0; i < 20; ++i)
    ids.push_back(bench.add({{"protocol", "hello_rig"}, {"seed", i + 1}}).at("id"));
  bench.ask("POST", "/api/queue/" + std::to_string(ids[19]) + "/move", {{"before", ids[0]}});
  bench.stop(SIGKILL);
  bench.start();
  const json queue = bench.get("/api/queue");
  EXPECT_EQ(queue.at("held"), true);
  ASSERT_EQ(queue.at("jobs").size(), 20U);
  EXPECT_EQ(queue["jobs"][0]["id"], ids[19]);
  EXPECT_EQ(queue["jobs"][0]["request"]["seed"], 20);
  for (int i = 0; i < 19; ++i)
    EXPECT_EQ(queue["jobs"][static_cast<std::size_t>(i) + 1]["id"],
              ids[static_cast<std::size_t>(i)]);
  // And it goes on, killed twice more in the midst: each runs once.
  bench.ask("POST", "/api/queue/hold", {{"held", false}});
  for (int kills = 0; kills < 2; ++kills) {
    const std::size_t before = bench.get("/api/jobs").at("jobs").size();
    Bench::until(120, [&] { return bench.get("/api/jobs").at("jobs").size() > before; });
    bench.stop(SIGKILL);
    bench.start();
  }
  constexpr std::size_t kEnough = 5;
  Bench::until(120, [&] { return bench.get("/api/jobs").at("jobs").size() >= kEnough; });
  bench.ask("POST", "/api/queue/hold", {{"held", true}});
  ASSERT_TRUE(Bench::until(60, [&] { return bench.get("/api/run").is_null(); }));
  const json ended = bench.get("/api/jobs").at("jobs");
  ASSERT_GE(ended.size(), kEnough);
  for (const json& job : ended) EXPECT_EQ(job.at("outcome"), "completed") << job;
  EXPECT_EQ(bench.place.runs(), static_cast<int>(ended.size())) << "none ran twice";
  const json left = bench.get("/api/queue").at("jobs");
  EXPECT_EQ(left.size() + ended.size(), 20U) << "none is lost";
}

TEST(Workbench, ARunGoesOnWhenTheServerIsKilledAndIsFoundAgain) {
  Bench bench;
  bench.protocol("waits", kWaits);
  bench.start();
  const std::int64_t id = bench.add({{"protocol", "waits"}, {"real_time", true}}).at("id");
  const auto steered = [&] {
    const json running = bench.get("/api/run");
    return running.is_object() && running.at("status").is_object() && running.value("live", false);
  };
  ASSERT_TRUE(Bench::until(90, steered));
  const json before = bench.get("/api/run");
  bench.stop(SIGKILL);
  bench.start();
  ASSERT_TRUE(Bench::until(30, steered)) << "the next server finds it";
  const json after = bench.get("/api/run");
  EXPECT_EQ(after.at("job").at("run"), before.at("job").at("run"));
  // The live view's own server, with a token that was never on a command line.
  const std::string moved = bench.request("GET", "/live_view");
  EXPECT_EQ(Bench::status(moved), 303) << moved;
  EXPECT_TRUE(std::regex_search(
      moved, std::regex("Location: http://127.0.0.1:[0-9]+/\\?token=" + bench.token())))
      << moved;
  EXPECT_EQ(bench.ask("POST", "/api/run", {{"do", "stop"}}).value("ok", false), true);
  const json ended = bench.ended(id);
  EXPECT_EQ(ended.at("outcome"), "stopped") << ended;
  EXPECT_NE(ended.at("reason").get<std::string>().find("at the workbench"), std::string::npos)
      << ended;
}

TEST(Workbench, AFailedNightJobIsToldWithinAMinuteAlsoAfterAKill) {
  Bench bench;
  bench.protocol(
      "fails",
      "return { title = 'Eye length overnight', run = function(rig, p, run) run:wait(0.1) "
      "error('the camera is silent') end }\n");
  bench.place.write("tell.sh", "#!/bin/sh\ncat > told\n");
  bench.place.write(
      "messages.json",
      R"({"name": "Room 3", "messages": [{"to": "command", "words": ["sh", "tell.sh"]}]})");
  fs::permissions(bench.place.folder() / "messages.json", fs::perms(0600));
  bench.start();
  bench.ask("POST", "/api/queue/hold", {{"held", true}});
  const std::int64_t id = bench.add({{"protocol", "fails"}}).at("id");
  bench.stop(SIGKILL);
  bench.start();
  bench.ask("POST", "/api/queue/hold", {{"held", false}});
  const json ended = bench.ended(id);
  const auto since = steady_clock::now();
  ASSERT_TRUE(Bench::until(60, [&] { return !bench.place.read("told").empty(); }));
  const double seconds = std::chrono::duration<double>(steady_clock::now() - since).count();
  RecordProperty("told_after_s", std::to_string(seconds));
  EXPECT_EQ(ended.at("outcome"), "failed");
  const std::string told = bench.place.read("told");
  EXPECT_EQ(told.rfind("Room 3: Eye length overnight failed at ", 0), 0U) << told;
  EXPECT_NE(told.find("the camera is silent"), std::string::npos) << told;
  EXPECT_NE(told.find("coils"), std::string::npos) << "safe or not: " << told;
  Bench::until(5, [&] { return bench.get("/api/messages").at("messages")[0]["told"] != 0; });
  EXPECT_NE(bench.get("/api/messages").at("messages").at(0).at("told"), 0);
}

TEST(Workbench, AJobThatNeedsAPersonWaitsForOneWhileOthersRun) {
  Bench bench;
  bench.protocol("asks", kAsks);
  bench.start();
  const std::int64_t asks = bench.add({{"protocol", "asks"}}).at("id");
  const std::int64_t free = bench.add({{"protocol", "hello_rig"}}).at("id");
  EXPECT_EQ(bench.ended(free).at("outcome"), "completed");
  const json waiting = bench.get("/api/jobs/" + std::to_string(asks));
  EXPECT_EQ(waiting.at("state"), "waiting");
  EXPECT_EQ(waiting.at("needs_person"), true);
  EXPECT_EQ(waiting.at("rehearsal").at("asks").size(), 2U) << waiting;
  // Answered in advance, it needs none.
  bench.ask("PUT", "/api/queue/" + std::to_string(asks), {{"answers", {"yes", "eye=left"}}});
  EXPECT_EQ(bench.ended(asks).at("outcome"), "completed");
}

TEST(Workbench, ASweepOfAFormIsRunAndRead) {
  Bench bench;
  bench.start();
  const json checked = bench.ask("POST", "/api/protocols/hold/check",
                                 {{"values", {{"hold", "1, 2"}, {"feedback", "pose_sensor"}}}});
  EXPECT_EQ(checked.at("sweep"), true) << checked;
  EXPECT_EQ(checked.at("points"), 2);
  const json job = bench.add(
      {{"protocol", "hold"},
       {"values", {{"hold", "1, 2"}, {"feedback", "pose_sensor"}, {"compare", "false"}}}});
  ASSERT_TRUE(job.contains("id")) << job;
  const json ended = bench.ended(job["id"], 240);
  EXPECT_EQ(ended.at("outcome"), "completed") << ended;
  const json sweeps = bench.get("/api/sweeps");
  ASSERT_EQ(sweeps.size(), 1U) << sweeps;
  EXPECT_EQ(sweeps[0].at("points"), 2);
  const std::string at = "/sweeps/" + sweeps[0].at("name").get<std::string>();
  EXPECT_EQ(Bench::status(bench.request("GET", at + "/report.html")), 200);
  EXPECT_EQ(Bench::status(bench.request("GET", at + "/sweep.csv")), 200);
}

TEST(Workbench, StrangersJunkAndFloodsAreRefused) {
  Bench bench;
  bench.start();
  const std::string host = "127.0.0.1:" + std::to_string(bench.port());
  const auto status = [&](const std::string& method, const std::string& path,
                          const std::string& body, const std::string& more) {
    return Bench::status(bench.request(method, path, body, more));
  };
  const std::string bearer = "Authorization: Bearer " + bench.token() + "\r\n";
  // Without a token, with a wrong one, with the token as a cookie.
  EXPECT_EQ(status("GET", "/api/state", "", "X: y\r\n"), 403);
  EXPECT_EQ(
      status("GET", "/api/state", "", "Authorization: Bearer " + std::string(32, '0') + "\r\n"),
      403);
  EXPECT_EQ(status("GET", "/api/state", "", "Cookie: vitreo_workbench=" + bench.token() + "\r\n"),
            403);
  EXPECT_EQ(status("GET", "/?token=" + std::string(32, '0'), "", "X: y\r\n"), 403);
  // A browser with the cookie: only from our own page.
  const std::string welcome = bench.request("GET", "/?token=" + bench.token(), "", "X: y\r\n");
  EXPECT_EQ(Bench::status(welcome), 303);
  const std::size_t begin = welcome.find("vitreo_workbench=");
  ASSERT_NE(begin, std::string::npos) << welcome;
  const std::string cookie =
      "Cookie: " + welcome.substr(begin, welcome.find(';', begin) - begin) + "\r\n";
  EXPECT_NE(welcome.find("HttpOnly; SameSite=Lax"), std::string::npos);
  const std::string stop = R"({"do":"stop"})";
  EXPECT_EQ(status("GET", "/api/state", "", cookie), 200);
  EXPECT_EQ(status("POST", "/api/run", stop, cookie), 403) << "no origin, no token";
  EXPECT_EQ(status("POST", "/api/run", stop, cookie + "Origin: http://evil.example\r\n"), 403);
  EXPECT_EQ(status("POST", "/api/run", stop, cookie + "Origin: http://" + host + "\r\n"), 400)
      << "ours: there is just no run";
  EXPECT_EQ(status("POST", "/api/run", stop, bearer + "Origin: http://evil.example\r\n"), 403);
  // DNS rebinding.
  EXPECT_EQ(Bench::status(bench.say("GET /api/state HTTP/1.1\r\nHost: evil.example\r\n" + bearer +
                                    "Connection: close\r\n\r\n")),
            403);
  // Junk.
  for (const char* body : {"junk", "[]", "{", "{\"protocol\":\"../../etc/passwd\"}",
                           "{\"protocol\":\"hold\",\"arguments\":[\"--rig=/x\"]}",
                           "{\"protocol\":\"hold\",\"rig\":\"/etc/passwd\"}",
                           "{\"protocol\":\"hold\",\"values\":{\"hold\":\"1e999\"}}",
                           "{\"protocol\":\"hold\",\"before\":\"x\"}", "\xff\xfe"})
    EXPECT_EQ(status("POST", "/api/queue", body, bearer), 400) << body;
  EXPECT_EQ(status("POST", "/api/run", R"({"do":7})", bearer), 400);
  EXPECT_EQ(status("GET", "/api/runs?find=%ZZ", "", bearer), 400);
  EXPECT_EQ(status("GET", "/api/runs?most=-1", "", bearer), 400);
  EXPECT_EQ(status("GET", "/api/none", "", bearer), 404);
  EXPECT_EQ(status("GET", "/api/jobs/999", "", bearer), 404);
  EXPECT_EQ(status("PUT", "/api/state", "{}", bearer), 405);
  EXPECT_EQ(status("GET", "/runs/..%2f..%2fetc%2fpasswd", "", bearer), 404);
  EXPECT_EQ(Bench::status(bench.request("POST", "/api/queue", std::string(100000, ' '), bearer)), 0)
      << "a body of more than 64 kB ends the connection";
  // A flood: some of it is refused, and STOP is answered all the while.
  std::vector<std::unique_ptr<view::Wire>> wires;
  for (int i = 0; i < 100; ++i) {
    wires.push_back(std::make_unique<view::Wire>(bench.port()));
    wires.back()->say("GET /api/protocols HTTP/1.1\r\nHost: " + host + "\r\n" + bearer + "\r\n");
  }
  const auto since = steady_clock::now();
  EXPECT_EQ(status("POST", "/api/run", stop, bearer), 400);
  EXPECT_LT(std::chrono::duration<double>(steady_clock::now() - since).count(), 2.0);
  wires.clear();
  // What was accepted is still worked off, and until then one more may be refused too.
  json queue;
  EXPECT_TRUE(Bench::until(30, [&] {
    queue = bench.get("/api/queue");
    return queue.contains("jobs");
  })) << queue;
  EXPECT_EQ(queue.value("jobs", json::array({1})).size(), 0U) << queue;
}

TEST(Workbench, TwoDoNotShareAQueue) {
  Bench bench;
  bench.start();
  const Spoken second = bench.place.vitreo("serve --port 0 --state state");
  EXPECT_EQ(second.exit_code, 2);
  EXPECT_NE(second.err.find("another workbench serves from it"), std::string::npos) << second.err;
  struct stat about = {};
  for (const char* file : {"state/token", "state/open.html"}) {
    ASSERT_EQ(stat((bench.place.folder() / file).c_str(), &about), 0) << file;
    EXPECT_EQ(about.st_mode & 0777, 0600U) << file;
  }
  EXPECT_EQ(bench.place.vitreo("serve --listen 0.0.0.0").exit_code, 2);
  EXPECT_EQ(bench.place.vitreo("serve --listen 192.168.7.7 --state other").exit_code, 2);
}

bool browser_there() {
  const bool has_page = !fs::exists(VITREO_PAGE_TEST "/../../page/notice");
  return has_page && there("node") && there("chromium") &&
         fs::exists(VITREO_PAGE_TEST "/node_modules");
}

/// What the browser saw while it did `task`.
json seen_by_browser(const Bench& bench, const std::string& task) {
  const std::string address =
      "http://127.0.0.1:" + std::to_string(bench.port()) + "/?token=" + bench.token();
  bench.place.write("browse.sh", "timeout 200 node " VITREO_PAGE_TEST "/workbench.mjs '" + address +
                                     "' . \"$(command -v chromium)\" " + task +
                                     " >seen 2>seen.err\n");
  EXPECT_EQ(std::system(("cd '" + bench.place.folder().string() + "' && sh browse.sh").c_str()), 0);
  if (const char* keep = std::getenv("VITREO_KEEP_PICTURES"))
    std::system(("cp '" + bench.place.folder().string() + "'/*.png '" + keep + "'").c_str());
  json seen = json::parse(bench.place.read("seen"), nullptr, false);
  EXPECT_TRUE(seen.is_object()) << bench.place.read("seen") << bench.place.read("seen.err");
  if (!seen.is_object()) return json::object();
  EXPECT_FALSE(seen.contains("failed")) << seen;
  EXPECT_TRUE(seen["errors"].empty()) << seen["errors"];
  return seen;
}

// The goal of the issue: servo_square at another speed, its questions answered, its report open, in
// six clicks and no terminal. The rig's own checklist asks: the protocol is wrapped by one that
// does.
TEST(Workbench, ATechnicianRunsServoSquareAtAnotherSpeedInSixClicks) {
  if (!browser_there()) GTEST_SKIP() << "wants node, chromium, and npm when this was built";
  Bench bench;
  std::string square = bench.place.read("protocols/servo_square.lua");
  const std::string begin = "run = function(rig, p, run)";
  const std::size_t at = square.find(begin);
  ASSERT_NE(at, std::string::npos);
  square.insert(at + begin.size(),
                " assert(run:confirm('Is the robot in the eye?', { name = 'robot_in' })) ");
  bench.protocol("servo_square", square);
  bench.start();
  const json seen = seen_by_browser(bench, "technician");
  EXPECT_LE(seen.value("clicks", 99), 6) << seen;
  EXPECT_EQ(seen.value("reportTitle", "").find("Path followed to") != std::string::npos, true)
      << seen;
  const json jobs = bench.get("/api/jobs").at("jobs");
  ASSERT_EQ(jobs.size(), 1U);
  EXPECT_EQ(jobs[0].at("outcome"), "completed");
  EXPECT_EQ(jobs[0].at("command"), "vitreo run servo_square speed=1mm/s");
  EXPECT_EQ(seen.value("cut", json::array()), json::array()) << "texts that are cut";
  EXPECT_EQ(seen.value("stopInSight", false), true);
}

TEST(Workbench, TwoOfTwoHundredRunsAreComparedInThreeClicks) {
  if (!browser_there()) GTEST_SKIP() << "wants node, chromium, and npm when this was built";
  Bench bench;
  ASSERT_EQ(bench.place.vitreo("run hold hold=1s compare=false feedback=pose_sensor -q").exit_code,
            0);
  // Two hundred records of one run, each with a field of its own.
  bench.place.write(
      "copies.sh",
      "cd runs && one=$(ls) && for i in $(seq 1 199); do\n"
      "  cp -r $one 2026-01-01T00$(printf %04d $i)_hold_$(printf %04x $i)\n"
      "  sqlite3 2026-01-01T00$(printf %04d $i)_hold_*/run.sqlite \"UPDATE run SET "
      "parameters = json_set(parameters, '\\$.field', $i * 1e-4), seed = $i\"\ndone\n");
  ASSERT_EQ(std::system(("cd '" + bench.place.folder().string() + "' && sh copies.sh").c_str()), 0);
  bench.start();
  bench.get("/api/runs");  // the index is made when the first one looks
  const json seen = seen_by_browser(bench, "compare");
  EXPECT_EQ(seen.value("total", ""), "200 runs") << seen;
  EXPECT_EQ(seen.value("found", ""), "2 runs") << seen;
  EXPECT_LE(seen.value("clicks", 99), 3) << seen;
  RecordProperty("find_ms", std::to_string(seen.value("findMs", 0.0)));
  RecordProperty("compare_ms", std::to_string(seen.value("compareMs", 0.0)));
  EXPECT_LT(seen.value("serverFindMs", 1e9), 3000.0) << "the goal of 300 ms is of an idle machine";
  EXPECT_NE(seen.value("sentence", "").find(" in A, "), std::string::npos) << seen;
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
