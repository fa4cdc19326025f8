// SPDX-License-Identifier: Apache-2.0
#include "host/view/live_view.h"

#include "host/config/config.h"
#include "host/text/error_words.h"
#include "host/view/assets.h"
#include "host/view/board.h"
#include "host/view/instrument_panel.h"
#include "host/view/pointing.h"
#include "host/view/web_server.h"

#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>

#include <cmath>
#include <fstream>
#include <iterator>
#include <thread>

namespace vitreo::view {
namespace {

using nlohmann::json;
// A multiple of the server's tick of 10 ms: 30 frames a second pass.
constexpr auto kFramePeriod = std::chrono::milliseconds(30);
constexpr auto kStatePeriod = std::chrono::milliseconds(100);
constexpr std::size_t kHistory = 600;   // rows of a stream for a viewer that joins
constexpr std::size_t kMostRows = 200;  // rows of a stream in one message
constexpr int kJpegQuality = 80;
constexpr std::string_view kReport = "/report";

std::string text_of(const json& message) {
  return message.dump(-1, ' ', false, json::error_handler_t::replace);
}

// JSON has no NaN: what is not known is null.
json number(double value) { return std::isfinite(value) ? json(value) : json(nullptr); }

// [[t, value, ...], ...], t in s of the experiment, in time's order.
json rows_of(const std::vector<Sample>& samples) {
  json rows = json::array();
  for (const Sample& sample : samples) {
    json row = {to_seconds(sample.time)};
    for (const double value : sample.values) row.push_back(number(value));
    rows.push_back(std::move(row));
  }
  return rows;
}

/// [u32 slot][u32 number][f64 s of exposure][u32 width][u32 height][JPEG], little-endian.
std::shared_ptr<const std::string> packed(int slot, const Frame& frame) {
  std::vector<unsigned char> jpeg;
  cv::imencode(".jpg", frame.image, jpeg, {cv::IMWRITE_JPEG_QUALITY, kJpegQuality});
  const auto bytes = std::make_shared<std::string>();
  // The machine's own byte order: x86 and ARM are little-endian.
  const auto add = [&bytes](auto value) {
    bytes->append(reinterpret_cast<const char*>(&value), sizeof value);
  };
  add(static_cast<std::uint32_t>(slot));
  add(static_cast<std::uint32_t>(frame.number));
  add(to_seconds(frame.exposed));
  add(static_cast<std::uint32_t>(frame.image.cols));
  add(static_cast<std::uint32_t>(frame.image.rows));
  bytes->append(reinterpret_cast<const char*>(jpeg.data()), jpeg.size());
  return bytes;
}

/// Newest items that were sent to one viewer, so that it gets each once.
/// A viewer that reloads the page is a new viewer and gets the history again.
struct Sent {
  std::map<std::string, std::uint64_t> frames;
  std::map<std::string, Time> streams;
  std::uint64_t lines = 0;
  std::string status;
  bool greeted = false;
};

/// What is known of the coils after they were made safe; null while nothing is.
json rest_of(const Board& board) {
  const std::optional<Rest> rest = board.rest();
  if (!rest) return nullptr;
  json amperes;
  if (rest->amperes) {
    amperes = json::array();
    for (const double current : *rest->amperes)
      amperes.push_back(std::isfinite(current) ? json(current) : json());
  }
  return {{"t", rest->time}, {"text", rest->text}, {"amperes", amperes}};
}

}  // namespace

struct LiveView::State {
  State(const ViewRequest& request, ProgressListener& terminal)
      : board(terminal),
        token_file(request.token_file),
        linger(request.linger),
        server(settings(request),
               {[this](int viewer) { sent[viewer] = {}; }, [this](int viewer) { leave(viewer); },
                [this](int viewer, const std::string& message) { receive(viewer, message); },
                [this] { tick(); }, [this](std::string_view path) { return document(path); }}) {}

  /// Checked before anything listens.
  static ServerSettings settings(const ViewRequest& request) {
    check(request);
    return {.address = request.address,
            .port = request.port,
            .assets = page_assets(),
            .shared_token = request.token_file.empty() ? "" : shared_token(request.token_file)};
  }

  Board board;
  const std::filesystem::path token_file;
  // end() runs on the script's thread, tick() and receive() on the server's.
  std::mutex mutex;  // of what end() takes away
  Session* session = nullptr;
  std::string title, outcome;
  bool end_sent = true;
  bool report_sent = false;
  std::size_t watching = 0;  // viewers after the end
  std::optional<Pointing> pointing;
  // The server's thread only.
  std::map<int, Sent> sent;
  int operator_viewer = 0;  // the viewer that has control; 0: none
  std::chrono::steady_clock::time_point framed{}, stated{};
  std::map<std::pair<std::string, std::uint64_t>, std::shared_ptr<const std::string>> encoded;
  std::filesystem::path folder;  // of the run
  std::string report;            // its HTML, once it is written
  const double linger;           // s
  WebServer server;              // last: its thread uses all the others

  // Control falls free with the connection: a browser that crashed must not keep it.
  void leave(int viewer) {
    sent.erase(viewer);
    if (operator_viewer == viewer) operator_viewer = 0;
  }
  std::string document(std::string_view path) {
    const std::lock_guard lock(mutex);
    return path == kReport ? report : "";
  }
  void serve_report();
  void tick();
  void show_frames();
  void show_state(int viewer, Sent& known);
  void greet(int viewer, Sent& known);
  json status(int viewer);
  void receive(int viewer, const std::string& message);
  json perform(int viewer, const json& message);
  void give(const json& message);
};

// Called by the server each 10 ms; frames and states have periods of their own. The lock is held
// throughout, so end() waits until no message about the session is being made.
void LiveView::State::tick() {
  const auto now = std::chrono::steady_clock::now();
  const std::lock_guard lock(mutex);
  if (session == nullptr) {
    // After the run: its outcome, once.
    if (!std::exchange(end_sent, true))
      for (const int viewer : server.viewers())
        server.send(viewer, text_of({{"ended", outcome}, {"rest", rest_of(board)}}));
    if (!report.empty() && !std::exchange(report_sent, true))
      for (const int viewer : server.viewers()) server.send(viewer, text_of({{"report", kReport}}));
    watching = server.viewers().size();
    return;
  }
  if (now - framed >= kFramePeriod) framed = now, show_frames();
  const bool due = now - stated >= kStatePeriod;
  if (due) stated = now;
  for (const int viewer : server.viewers()) {
    Sent& known = sent[viewer];
    // A viewer that joined before the run began is greeted when it begins.
    if (!known.greeted) greet(viewer, known);
    if (due) show_state(viewer, known);
  }
}

void LiveView::State::show_frames() {
  // Slots number the cameras in the order of board.cameras(), which each state message repeats.
  int slot = 0;
  for (const std::string& camera : board.cameras()) {
    // A viewer whose last frame is still on its way is skipped: it gets the newest one later.
    std::shared_ptr<const std::string> bytes;  // encoded once for all
    for (const int viewer : server.viewers()) {
      if (server.busy(viewer, slot)) continue;
      auto& last = sent[viewer].frames;
      const auto known = last.find(camera);
      const auto frame = board.frame(
          camera, known == last.end() ? std::nullopt : std::optional<std::uint64_t>(known->second));
      if (!frame) continue;
      auto& kept = encoded[{camera, frame->number}];
      if (!kept) {
        // A new frame of this camera: its older encoding is of no use any more.
        std::erase_if(encoded, [&](const auto& one) {
          return one.first.first == camera && one.first.second != frame->number;
        });
        encoded[{camera, frame->number}] = bytes = packed(slot, *frame);
      } else {
        bytes = kept;
      }
      last[camera] = frame->number;
      server.send_frame(viewer, slot, bytes);
    }
    ++slot;
  }
}

/// Constants of the run: title, parameters, geometry.
void LiveView::State::greet(int viewer, Sent& known) {
  known.greeted = true;
  const RunStart& start = session->recorder.start();
  json geometry = pointing->to_json();
  if (session->rig.coils != nullptr)
    geometry["current_limit"] = session->rig.coils->current_limit();
  server.send(viewer, text_of({{"hello",
                                {{"title", title},
                                 {"run", session->recorder.folder().filename().string()},
                                 {"operator", start.operator_name},
                                 {"parameters", start.parameters},
                                 {"units", start.parameter_units},
                                 {"geometry", geometry}}}}));
}

/// News for this viewer: rows of streams, lines, and the status.
void LiveView::State::show_state(int viewer, Sent& known) {
  json message = {
      {"time", to_seconds(board.now())}, {"cameras", board.cameras()}, {"rest", rest_of(board)}};
  for (const StreamInfo& info : board.streams()) {
    const auto last = known.streams.find(info.name);
    const auto samples = board.samples(
        info.name, last == known.streams.end() ? std::nullopt : std::optional<Time>(last->second),
        last == known.streams.end() ? kHistory : kMostRows);
    if (samples.empty()) continue;
    known.streams[info.name] = samples.back().time;
    // Names go with each message, so that the page needs no schema.
    json channels = json::array();
    for (const Channel& channel : info.channels) channels.push_back(channel.name);
    message["streams"][info.name] = {{"channels", channels}, {"rows", rows_of(samples)}};
  }
  for (const Line& line : board.lines(known.lines)) {
    known.lines = line.number;
    message["lines"].push_back({{"t", line.time}, {"kind", line.kind}, {"text", line.text}});
  }
  message["status"] = status(viewer);
  server.send(viewer, text_of(message));
}

// The desk's status, which all faces share, and what differs from viewer to viewer: who has
// control.
json LiveView::State::status(int viewer) {
  json state = session->desk.status();
  state["control"] = operator_viewer == viewer ? "mine" : operator_viewer == 0 ? "free" : "taken";
  state["takes_targets"] = session->targets.wanted();
  state["viewers"] = sent.size();
  const auto servo = board.samples("servo", {}, 1);
  const auto command = board.samples("command", {}, 1);
  // The robot's marks and the field at it, from the newest rows.
  if (!servo.empty()) state.update(pointing->marks(servo[0].values));
  if (!command.empty()) state["field"] = Pointing::field(command[0].values);
  return state;
}

/// Message of a viewer; a request that cannot be carried out is answered with {"refused": why}.
void LiveView::State::receive(int viewer, const std::string& message) {
  const std::lock_guard lock(mutex);
  json reply;
  try {
    const json request = json::parse(message);
    if (!request.is_object() || !request.contains("do") || !request["do"].is_string())
      throw std::invalid_argument("wants {\"do\": WORD}");
    reply = perform(viewer, request);
  } catch (const std::exception& error) {
    reply = {{"refused", error_words(error)}};
  }
  if (!reply.is_null()) server.send(viewer, text_of(reply));
}

/// A command of the operator at the page; targets are pointed at in an image.
OperatorCommand command_of(const std::string& word, const json& message, const Pointing& pointing,
                           const ClearanceBelief& belief) {
  OperatorCommand command;
  command.word = word;
  command.source = "the live view";
  if (word == "answer") command.text = message.at("text");
  if (word == "ack") command.text = message.value("alarm", "");
  if (word == "target") command.targets = pointing.positions(message, belief);
  if (word == "adjust") read_adjustment(message, command);
  return command;
}

/// Ending the run is open to every viewer; all else to the one who has taken control.
json LiveView::State::perform(int viewer, const json& message) {
  const std::string word = message["do"];
  if (session == nullptr) throw std::invalid_argument("the run has ended");
  if (word == "where") return {{"where", pointing->where(message)}, {"id", message.value("id", 0)}};
  if (word == "take") {
    // Control is taken from another viewer only with "force".
    if (operator_viewer != 0 && operator_viewer != viewer && !message.value("force", false))
      throw std::invalid_argument("another viewer has control");
    operator_viewer = viewer;
    return {{"done", word}};
  }
  if (!OperatorDesk::ends_run(word) && operator_viewer != viewer)
    throw std::invalid_argument("take control first: you are looking on");
  if (word == "release") return operator_viewer = 0, json{{"done", word}};
  if (word == "invite") return {{"invitation", server.invitation()}};
  const auto near = board.samples("clearance", {}, 1);
  const ClearanceBelief belief =
      near.empty() ? ClearanceBelief{} : Pointing::belief(near[0].values);
  const OperatorCommand command = command_of(word, message, *pointing, belief);
  session->desk.perform(command);
  if (command.targets.empty()) return {{"done", word}};
  // The page marks where the path ends.
  const Eigen::Vector3d& last = command.targets.back();
  return {{"target", {last.x(), last.y(), last.z()}}};
}

// The server listens from here on, without a session: viewers that come early wait for the
// greeting.
LiveView::LiveView(const ViewRequest& request, ProgressListener& terminal)
    : state_(std::make_unique<State>(request, terminal)) {}
LiveView::~LiveView() {
  end("");
  // The server's thread sends the outcome at its next tick.
  // At most 0.2 s: a server that does not send any more must not hold up the end of the program.
  for (int wait = 0; wait < 10; ++wait) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    const std::lock_guard lock(state_->mutex);
    if (state_->end_sent) break;
  }
  state_->serve_report();
}

// The run is over and recorded: nothing waits for this but the program's own end.
void LiveView::State::serve_report() {
  using namespace std::chrono;
  std::ifstream file(folder / "report.html", std::ios::binary);
  if (folder.empty() || linger <= 0 || !file) return;
  {
    const std::lock_guard lock(mutex);
    report.assign(std::istreambuf_iterator<char>(file), {});
    watching = 1;  // until the server's thread has counted them
  }
  const auto until = steady_clock::now() + duration<double>(linger);
  for (bool said = false; steady_clock::now() < until;) {
    std::this_thread::sleep_for(milliseconds(30));
    const std::lock_guard lock(mutex);
    if (report_sent && watching == 0) return;
    if (report_sent && !std::exchange(said, true))
      board.message("the live view shows the report until its page is closed; Ctrl-C ends it now");
  }
}

ProgressListener& LiveView::listener() { return state_->board; }

void LiveView::begin(Session& session) {
  {
    const std::lock_guard lock(state_->mutex);
    state_->title = session.recorder.start().protocol_title;
    state_->pointing.emplace(session.rig.model);
    state_->session = &session;
    state_->folder = session.recorder.folder();
  }
  // The board listens to the record, and frames come also while the script grabs none.
  session.recorder.watch(&state_->board);
  session.frames.watch();
  state_->board.message("live view: " + invitation());
}

// Also called by the destructor, and for a run that never began: then there is no session to
// forget.
void LiveView::end(const std::string& outcome) {
  const std::lock_guard lock(state_->mutex);
  if (state_->session == nullptr) return;
  state_->session->recorder.watch(nullptr);
  state_->session = nullptr;
  state_->outcome = outcome;
  state_->end_sent = false;
}

std::string LiveView::invitation() {
  if (state_->token_file.empty()) return state_->server.invitation();
  // Not the token itself: a screen is read by more people than the file is.
  return state_->server.address() + "?token=TOKEN, with what stands in " +
         state_->token_file.string() + " for TOKEN";
}

}  // namespace vitreo::view
