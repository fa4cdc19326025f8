// SPDX-License-Identifier: Apache-2.0
#include "host/serve/workbench.h"

#include "devices/time/quiet_thread.h"
#include "host/config/config.h"
#include "host/files/posix_file.h"
#include "host/serve/assets.h"
#include "host/serve/dispatcher.h"
#include "host/serve/job_queue.h"
#include "host/serve/messages.h"
#include "host/serve/routes.h"
#include "host/serve/shelf.h"
#include "host/serve/task_pool.h"
#include "host/view/web_server.h"

#include <fmt/format.h>

#include <cerrno>
#include <condition_variable>
#include <cstring>
#include <fcntl.h>
#include <mutex>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

namespace vitreo::serve {

namespace fs = std::filesystem;

namespace {

constexpr std::size_t kThreads = 3;
constexpr std::size_t kMostWaiting = 64;  // requests; beyond them 503
constexpr auto kStatePeriod = std::chrono::milliseconds(150);
constexpr const char* kDoor = "open.html";

/// For this user alone.
// As the live view's folder of sockets: a link, or a folder of another user, is refused.
void make_state_folder(const fs::path& folder) {
  fs::create_directories(folder.parent_path());
  if (::mkdir(folder.c_str(), 0700) != 0 && errno != EEXIST)
    throw ConfigError(folder.string() + ": cannot be made: " + std::strerror(errno));
  struct stat about = {};
  if (::lstat(folder.c_str(), &about) != 0 || !S_ISDIR(about.st_mode) ||
      about.st_uid != ::geteuid() || (about.st_mode & 077) != 0)
    throw ConfigError(folder.string() +
                      ": wants to be a folder that only you can enter; chmod 700 it");
}

/// Held while a workbench serves from the folder.
// flock goes with the process: a server that was killed leaves no lock behind.
class OnlyOne {
 public:
  explicit OnlyOne(const fs::path& state)
      : file_(::open((state / "serving").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600)) {
    if (file_.number() < 0)
      throw ConfigError(state.string() + ": cannot be written: " + std::strerror(errno));
    if (::flock(file_.number(), LOCK_EX | LOCK_NB) != 0)
      throw ConfigError(state.string() +
                        ": another workbench serves from it; vitreo serve --open opens that");
  }

 private:
  const Descriptor file_;
};

// Renamed into place: a browser never reads half of it.
void write_private(const fs::path& file, const std::string& text) {
  const fs::path beside = file.string() + ".new";
  {
    const Descriptor out(
        ::open(beside.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOFOLLOW, 0600));
    if (out.number() < 0 ||
        ::write(out.number(), text.data(), text.size()) != static_cast<ssize_t>(text.size()))
      throw ConfigError(beside.string() + ": cannot be written: " + std::strerror(errno));
  }
  fs::rename(beside, file);
}

// Said at once by the server's own thread, which never waits for the pools.
view::WebReply busy() {
  return {503, R"({"error":"too many requests wait; try again in a moment"})"};
}

}  // namespace

// What is destroyed last stands first; the threads that use the others stand after them.
struct Workbench::State {
  State(WorkbenchSettings given, ScriptEngine& engine, FormSources sources)
      : settings(prepared(std::move(given))),
        only_one(settings.state),
        token(view::shared_token(settings.web.token_file)),
        queue(settings.state / "queue.sqlite"),
        dispatcher(queue, {settings.program, settings.state, settings.runs, settings.sweeps,
                           settings.messages, settings.web.token_file, settings.web.address,
                           settings.live_port}),
        messenger(queue),
        forms(engine, std::move(sources)),
        shelf(settings.runs, settings.sweeps),
        parts{queue, dispatcher, forms, shelf, settings.messages, token, settings.version},
        server(server_settings(),
               {[this](int viewer) { greet(viewer); }, [this](int viewer) { sent.erase(viewer); },
                [](int, const std::string&) {}, [this] { push(); }}),
        common(std::make_unique<TaskPool>(kThreads, kMostWaiting)),
        urgent(std::make_unique<TaskPool>(1, kMostWaiting)),
        observer(quiet_thread([this] { observe(); })) {
    const std::lock_guard lock(mutex);
    ready = true;
  }

  // From the outside in: no new tasks, no new texts, then the pools, whose tasks reply to the
  // server.
  ~State() {
    {
      const std::lock_guard lock(mutex);
      ended = true;
      ready = false;
    }
    wake.notify_all();
    observer.join();
    // Before the server, to which their tasks reply.
    urgent.reset();
    common.reset();
  }

  static WorkbenchSettings prepared(WorkbenchSettings settings) {
    make_state_folder(settings.state);
    if (settings.web.token_file.empty()) settings.web.token_file = settings.state / "token";
    view::check(settings.web);
    // Now, rather than when a job has failed at night.
    read_message_settings(settings.messages);
    return settings;
  }

  view::ServerSettings server_settings() {
    view::ServerSettings web;
    web.address = settings.web.address;
    web.port = settings.web.port;
    web.assets = workbench_assets();
    web.shared_token = token;
    // The live views of the same host have another one: browsers keep the cookies of all ports
    // together.
    web.cookie = "vitreo_workbench";
    web.opened_by_links = true;
    web.handler = [this](view::WebRequest request, view::SendReply reply) {
      hand(std::move(request), std::move(reply));
    };
    return web;
  }

  /// On the server's thread: to a pool, or refused at once.
  void hand(view::WebRequest request, view::SendReply reply) {
    const std::lock_guard lock(mutex);
    if (!ready) return reply(busy());
    // STOP has a thread of its own: a comparison of large runs may hold all others.
    TaskPool& pool = is_urgent(request) ? *urgent : *common;
    const auto task = [this, request = std::move(request), reply] {
      reply(answer(request, parts));
    };
    if (!pool.add(task)) reply(busy());
  }

  /// The state as a text, made by a thread of its own: it reads the disk.
  void observe() {
    unsigned long known = 0;
    for (;;) {
      {
        std::unique_lock lock(mutex);
        if (wake.wait_for(lock, kStatePeriod, [this] { return ended; })) return;
      }
      try {
        const unsigned long changes = dispatcher.changes();
        // Plus one, so that the first text is made although nothing has changed yet.
        if (known == changes + 1) continue;
        known = changes + 1;
        std::string text = nlohmann::json{{"state", state_of(parts)}}.dump(
            -1, ' ', false, nlohmann::json::error_handler_t::replace);
        const std::lock_guard lock(mutex);
        text_now = std::move(text);
        ++text_number;
      } catch (const std::exception&) {
        // The queue is being written: at the next turn.
        known = 0;
      }
    }
  }

  void greet(int viewer) { sent[viewer] = 0; }

  /// Each 10 ms, on the server's thread.
  void push() {
    std::string text;
    unsigned long number = 0;
    {
      const std::lock_guard lock(mutex);
      number = text_number;
      if (number != 0) text = text_now;
    }
    // A viewer that joined gets the present text at the next tick.
    for (auto& [viewer, last] : sent) {
      if (last == number) continue;
      last = number;
      server.send(viewer, text);
    }
  }

  const WorkbenchSettings settings;
  const OnlyOne only_one;
  const std::string token;
  JobQueue queue;
  Dispatcher dispatcher;
  Messenger messenger;
  Forms forms;
  Shelf shelf;
  Parts parts;
  std::mutex mutex;
  std::condition_variable wake;
  bool ended = false;
  bool ready = false;  // the pools are there
  std::string text_now;
  unsigned long text_number = 0;
  std::map<int, unsigned long> sent;  // the server's thread only
  view::WebServer server;
  std::unique_ptr<TaskPool> common, urgent;
  std::thread observer;
};

Workbench::Workbench(WorkbenchSettings settings, ScriptEngine& engine, FormSources sources)
    : state_(std::make_unique<State>(std::move(settings), engine, std::move(sources))) {
  write_private(door(), fmt::format("<!doctype html><meta charset=\"utf-8\"><title>Vitreo</title>"
                                    "<meta http-equiv=\"refresh\" content=\"0;url={0}?token={1}\">"
                                    "<p><a href=\"{0}?token={1}\">Vitreo's workbench</a></p>\n",
                                    address(), state_->token));
}

Workbench::~Workbench() {
  std::error_code ignored;
  fs::remove(door(), ignored);
}

std::string Workbench::address() const { return state_->server.address(); }

std::string Workbench::invitation() { return state_->server.invitation(); }

fs::path Workbench::door() const { return state_->settings.state / kDoor; }

// The lock is asked before the file: a server that was killed leaves its page behind.
fs::path open_door(const fs::path& state) {
  const Descriptor file(::open((state / "serving").c_str(), O_RDONLY | O_CLOEXEC));
  std::error_code none;
  const bool serves = file.number() >= 0 && ::flock(file.number(), LOCK_SH | LOCK_NB) != 0;
  return serves && fs::exists(state / kDoor, none) ? state / kDoor : fs::path();
}

}  // namespace vitreo::serve
