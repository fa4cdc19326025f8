// SPDX-License-Identifier: Apache-2.0
#include "host/serve/routes.h"

#include "host/config/config.h"
#include "host/config/rights.h"
#include "host/serve/asked.h"
#include "host/text/error_words.h"

#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <optional>
#include <stdexcept>

namespace vitreo::serve {
namespace {

using nlohmann::json;
using view::WebReply;
using view::WebRequest;

constexpr std::size_t kEndedShown = 20;
// A viewer that is 1 MB behind is dropped: a thousand jobs would be as much.
constexpr std::size_t kWaitingShown = 200;
constexpr std::size_t kMostRuns = 500;  // in one answer
constexpr std::size_t kMessagesShown = 20;

/// Something that was asked for and is not there.
// 404 and not 400: a program may want to tell a wrong name from a wrong request.
class Missing : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// Texts of scripts need not be UTF-8; what is not is replaced, as on the control socket.
WebReply reply(const json& body, int status = 200) {
  return {status, body.dump(-1, ' ', false, json::error_handler_t::replace)};
}

/// A message without the channel's secrets.
json shown(const Message& message) {
  json one = to_json(message);
  one["channel"] = channel_text(json::parse(message.channel));
  return one;
}

json messages_json(Parts& parts) {
  json list = json::array();
  for (const Message& message : parts.queue.messages(kMessagesShown))
    list.push_back(shown(message));
  return list;
}

// An empty body is null and no object: a POST without one says what it lacks.
const json& body_of(const Asked& asked) {
  if (!asked.body.is_object()) throw ConfigError("the body: wants a JSON object");
  return asked.body;
}

std::int64_t id_of(const Asked& asked) { return whole("the job's number", asked.names.at(0)); }

// Found anew in each request: the queue may have changed since the page was drawn.
Job job_of(const Asked& asked, Parts& parts) {
  const auto job = parts.queue.find(id_of(asked));
  if (!job) throw Missing(fmt::format("there is no job {}", id_of(asked)));
  return *job;
}

// Taken out of the body: what is left is the job itself, whose unknown keys are refused.
std::optional<std::int64_t> before_of(json& body) {
  const auto found = body.find("before");
  if (found == body.end()) return std::nullopt;
  const json value = *found;
  body.erase(found);
  if (value.is_null()) return std::nullopt;
  if (!value.is_number_integer()) throw ConfigError("before: wants a job's number");
  return value.get<std::int64_t>();
}

bool take_flag(json& body, const char* key) {
  const auto found = body.find(key);
  if (found == body.end()) return false;
  if (!found->is_boolean()) throw ConfigError(std::string(key) + ": wants true or false");
  const bool value = found->get<bool>();
  body.erase(found);
  return value;
}

/// "values", as they were typed into a form, become arguments; more than one value a sweep.
JobRequest request_with_values(json body, Parts& parts) {
  // A form sends what was typed; a program may send the words of the command line instead.
  const json values = body.contains("values") ? body["values"] : json();
  body.erase("values");
  JobRequest request = request_of(body);
  if (values.is_null()) return request;
  if (!request.arguments.empty()) throw ConfigError("values, arguments: give one of them");
  const json checked = parts.forms.check(request.protocol, values, request.repeats);
  if (!checked["errors"].empty()) {
    const auto first = checked["errors"].items().begin();
    throw ConfigError((first.key().empty() ? "" : first.key() + ": ") +
                      first.value().get<std::string>());
  }
  request.arguments = checked["arguments"].get<std::vector<std::string>>();
  request.sweep = request.sweep || checked["sweep"].get<bool>();
  return request;
}

WebReply add_job(const Asked& asked, Parts& parts) {
  json body = body_of(asked);
  // A person pressed Start: without that a job that asks would wait for one.
  const bool attended = take_flag(body, "attended");
  const auto before = before_of(body);
  Job job;
  job.request = request_with_values(body, parts);
  job.title = parts.forms.check(job.request);
  job.added = seconds_now();
  if (attended) job.attended_until = job.added + Dispatcher::kAttended;
  const std::int64_t id = parts.queue.add(job, before);
  return reply(to_json(*parts.queue.find(id)), 201);
}

// Merged with what it has: a program changes the due time without repeating the rest.
WebReply edit_job(const Asked& asked, Parts& parts) {
  const Job job = job_of(asked, parts);
  json merged = to_json(job.request);
  if (body_of(asked).contains("values")) merged.erase("arguments");
  merged.update(body_of(asked));
  const JobRequest request = request_with_values(merged, parts);
  if (request.protocol != job.request.protocol)
    throw ConfigError("protocol: another one is another job; add that");
  parts.forms.check(request);
  parts.queue.set_request(job.id, request);
  return reply(to_json(*parts.queue.find(job.id)));
}

WebReply move_job(const Asked& asked, Parts& parts) {
  json body = body_of(asked);
  parts.queue.move(job_of(asked, parts).id, before_of(body));
  return reply({{"ok", true}});
}

// A person is there: it is next, at once.
WebReply start_job(const Asked& asked, Parts& parts) {
  const Job job = job_of(asked, parts);
  JobRequest request = job.request;
  if (request.due > seconds_now()) {
    request.due = 0;
    parts.queue.set_request(job.id, request);
  }
  // Moved, then attended: between the two the dispatcher may at most start the one that was first.
  const std::vector<Job> waiting = parts.queue.waiting();
  if (!waiting.empty() && waiting.front().id != job.id)
    parts.queue.move(job.id, waiting.front().id);
  parts.queue.attend(job.id, seconds_now() + Dispatcher::kAttended);
  return reply(to_json(*parts.queue.find(job.id)));
}

WebReply remove_job(const Asked& asked, Parts& parts) {
  parts.queue.remove(job_of(asked, parts).id);
  return reply({{"ok", true}});
}

WebReply show_job(const Asked& asked, Parts& parts) {
  const Job job = job_of(asked, parts);
  json shown = to_json(job);
  shown["said"] = parts.dispatcher.said(job.id);
  return reply(shown);
}

WebReply show_queue(const Asked&, Parts& parts) {
  json jobs = json::array();
  for (const Job& job : parts.queue.waiting()) jobs.push_back(to_json(job));
  return reply(
      {{"held", parts.queue.held()}, {"why_held", parts.queue.why_held()}, {"jobs", jobs}});
}

WebReply hold_queue(const Asked& asked, Parts& parts) {
  json body = body_of(asked);
  if (!body.contains("held")) throw ConfigError("held: is missing");
  const bool held = take_flag(body, "held");
  parts.queue.set_held(held, held ? "held by a person" : "");
  return reply({{"held", held}});
}

WebReply ended_jobs(const Asked& asked, Parts& parts) {
  const auto most = asked.count_or("most", "100");
  json jobs = json::array();
  for (const Job& job : parts.queue.ended(std::min(most, kMostRuns))) jobs.push_back(to_json(job));
  return reply({{"jobs", jobs}});
}

// The control socket's request and reply as they are; its own "by" is kept where it is given.
WebReply control(const Asked& asked, Parts& parts) {
  // The words and their meaning are the desk's: a new one there needs nothing here.
  json request = body_of(asked);
  if (!request.contains("do")) throw ConfigError("wants {\"do\": WORD}");
  if (!request.contains("by")) request["by"] = account_name() + " at the workbench";
  const json answered = parts.dispatcher.command(request);
  return reply(answered, answered.value("ok", false) ? 200 : 400);
}

WebReply run_now(const Asked&, Parts& parts) { return reply(parts.dispatcher.running()); }

WebReply list_runs(const Asked& asked, Parts& parts) {
  const auto most = asked.count_or("most", "100");
  const auto skip = asked.count_or("skip", "0");
  return reply(parts.shelf.runs(asked.value_or("find", ""),
                                split(asked.value_or("columns", ""), ','), skip,
                                std::min(most, kMostRuns)));
}

// Waits for the rehearsal, on a thread of the pool; a stop has another one.
WebReply rehearse(const Asked& asked, Parts& parts) {
  json body = body_of(asked);
  body["protocol"] = asked.names.at(0);
  const JobRequest request = request_with_values(body, parts);
  parts.forms.check(request);
  if (request.sweep) throw ConfigError("a sweep is not rehearsed; its first point is checked");
  return reply(parts.dispatcher.rehearse(request));
}

WebReply check_values(const Asked& asked, Parts& parts) {
  const json& body = body_of(asked);
  const json repeats = body.value("repeats", json(1));
  // Before it is a number: 1e99 would not be one.
  if (!repeats.is_number_integer() || repeats < 1 || repeats > 100'000)
    throw ConfigError("repeats: wants a whole number from 1 to 100000");
  return reply(parts.forms.check(asked.names.at(0), body.value("values", json::object()), repeats));
}

WebReply compare(const Asked& asked, Parts& parts) {
  return reply(parts.shelf.compare(split(asked.value_or("runs", ""), ',')));
}

WebReply compare_page(const Asked& asked, Parts& parts) {
  return sandboxed(parts.shelf.comparison_page(split(asked.value_or("runs", ""), ',')),
                   "text/html; charset=utf-8");
}

// The live view is a server of its own, of the run's process; its token goes to a browser that was
// admitted here, and to no other.
WebReply live_view(const Asked&, Parts& parts) {
  const std::string address = parts.dispatcher.live_view();
  if (address.empty()) throw Missing("there is no live view now: no run goes on");
  WebReply moved{303, "", "text/plain"};
  moved.headers.emplace_back("Location", address + "?token=" + parts.live_token);
  return moved;
}

// Through the queue, as a real one: it shows the retries as well.
WebReply tell_test(const Asked&, Parts& parts) {
  const MessageSettings settings = read_message_settings(parts.messages);
  if (settings.channels.empty())
    throw ConfigError("nothing is told: " + parts.messages.string() + " has no messages");
  parts.queue.add_messages(messages_for(settings, Occasion::failure, 0,
                                        "a test of the workbench's messages",
                                        "Nothing has happened.", seconds_now()));
  return reply({{"ok", true}}, 202);
}

WebReply show_messages(const Asked&, Parts& parts) {
  json channels = json::array();
  std::string error;
  try {
    for (const json& one : read_message_settings(parts.messages).channels)
      channels.push_back({{"to", channel_text(one)}, {"when", one.value("when", "failed")}});
  } catch (const ConfigError& wrong) {
    error = wrong.what();
  }
  return reply({{"channels", channels}, {"error", error}, {"messages", messages_json(parts)}});
}

// The table is the interface: docs/reference/openapi.json is compared with it by a test.
struct Route {
  const char* method;
  const char* path;
  WebReply (*answer)(const Asked&, Parts&);
};

const std::vector<Route>& routes() {
  static const std::vector<Route> kRoutes{
      {"GET", "/api/state", [](const Asked&, Parts& parts) { return reply(state_of(parts)); }},
      {"GET", "/api/protocols",
       [](const Asked&, Parts& parts) { return reply(parts.forms.protocols()); }},
      {"GET", "/api/protocols/{name}",
       [](const Asked& asked, Parts& parts) { return reply(parts.forms.form(asked.names.at(0))); }},
      {"POST", "/api/protocols/{name}/check", check_values},
      {"POST", "/api/protocols/{name}/rehearse", rehearse},
      {"GET", "/api/rigs", [](const Asked&, Parts& parts) { return reply(parts.forms.rigs()); }},
      {"GET", "/api/queue", show_queue},
      {"POST", "/api/queue", add_job},
      {"POST", "/api/queue/hold", hold_queue},
      {"PUT", "/api/queue/{id}", edit_job},
      {"DELETE", "/api/queue/{id}", remove_job},
      {"POST", "/api/queue/{id}/move", move_job},
      {"POST", "/api/queue/{id}/start", start_job},
      {"GET", "/api/jobs", ended_jobs},
      {"GET", "/api/jobs/{id}", show_job},
      {"GET", "/api/run", run_now},
      {"POST", "/api/run", control},
      {"GET", "/api/runs", list_runs},
      {"GET", "/api/runs/{name}",
       [](const Asked& asked, Parts& parts) { return reply(parts.shelf.run(asked.names.at(0))); }},
      {"GET", "/api/compare", compare},
      {"GET", "/api/sweeps",
       [](const Asked&, Parts& parts) { return reply(parts.shelf.sweeps()); }},
      {"GET", "/api/messages", show_messages},
      {"POST", "/api/messages/test", tell_test},
      {"GET", "/compare", compare_page},
      {"GET", "/live_view", live_view},
  };
  return kRoutes;
}

/// What stands for the names in braces; nothing where the path is another one.
std::optional<std::vector<std::string>> matched(const std::string& pattern,
                                                const std::vector<std::string>& parts) {
  const std::vector<std::string> wanted = split(pattern, '/');
  if (wanted.size() != parts.size()) return std::nullopt;
  std::vector<std::string> names;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    if (wanted[i].starts_with('{'))
      names.push_back(decoded(parts[i]));
    else if (wanted[i] != parts[i])
      return std::nullopt;
  }
  return names;
}

WebReply find_and_answer(const WebRequest& request, Parts& parts) {
  const std::size_t mark = request.target.find('?');
  const std::string path = request.target.substr(0, mark);
  const std::vector<std::string> words = split(path, '/');
  // 405 where another method would do, 404 where there is nothing at all.
  bool known = false;
  for (const Route& route : routes()) {
    auto names = matched(route.path, words);
    if (!names) continue;
    known = true;
    if (request.method != route.method) continue;
    Asked asked{request, {}, std::move(*names), nullptr};
    if (mark != std::string::npos) asked.query = query_of(request.target.substr(mark + 1));
    if (!request.body.empty()) {
      asked.body = json::parse(request.body, nullptr, false);
      if (asked.body.is_discarded()) throw ConfigError("the body: is no JSON");
    }
    return route.answer(asked, parts);
  }
  if (known)
    return reply({{"error", "this address does not take " + request.method.substr(0, 20)}}, 405);
  // Last: an address of the interface is never taken for a file.
  if (request.method == "GET" && (path.starts_with("/runs/") || path.starts_with("/sweeps/")))
    return parts.shelf.file(decoded(path));
  throw Missing("there is no such address; /openapi.json lists them");
}

}  // namespace

WebReply answer(const WebRequest& request, Parts& parts) {
  const auto failed = [](int status, const std::string& what) {
    return reply({{"error", what}}, status);
  };
  try {
    return find_and_answer(request, parts);
  } catch (const Missing& error) {
    return failed(404, error.what());
  } catch (const ConfigError& error) {
    return failed(400, error.what());
  } catch (const ScriptError& error) {
    return failed(400, error.what());
  } catch (const std::invalid_argument& error) {
    return failed(400, error.what());
  } catch (const json::exception& error) {  // a field of the body is missing, or of another kind
    return failed(400, "the body: " + error_words(error));
  } catch (const std::exception& error) {
    return failed(500, error.what());
  }
}

// Whole each time, some 20 kB: a page that missed one needs no history to be right again.
json state_of(Parts& parts) {
  json ended = json::array();
  for (const Job& job : parts.queue.ended(kEndedShown)) ended.push_back(to_json(job));
  json waiting = json::array();
  const std::vector<Job> jobs = parts.queue.waiting();
  for (const Job& job : jobs)
    if (waiting.size() < kWaitingShown) waiting.push_back(to_json(job));
  return {{"version", parts.version},
          {"operator", account_name()},
          {"time", seconds_now()},
          {"held", parts.queue.held()},
          {"why_held", parts.queue.why_held()},
          {"waiting", waiting},
          {"waiting_total", jobs.size()},
          {"running", parts.dispatcher.running()},
          {"ended", ended},
          {"messages", messages_json(parts)}};
}

std::vector<std::string> route_names() {
  std::vector<std::string> names;
  for (const Route& route : routes()) names.push_back(std::string(route.method) + " " + route.path);
  return names;
}

bool is_urgent(const WebRequest& request) {
  return request.method == "POST" && request.target.starts_with("/api/run") &&
         !request.target.starts_with("/api/runs");
}

}  // namespace vitreo::serve
