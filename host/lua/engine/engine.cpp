// SPDX-License-Identifier: Apache-2.0
#include "host/lua/engine/engine.h"

#include "host/lua/engine/library.h"
#include "host/lua/interpreter/errors.h"
#include "host/lua/interpreter/stop.h"
#include "host/lua/prompt/prompt.h"
#include "host/lua/script/reading.h"
#include "host/lua/script/running.h"
#include "host/session/session.h"

#include <pthread.h>

namespace vitreo {
namespace {

/// "file:line" where the script was stopped, or failed.
std::string place_of(const lua::Context& context) {
  std::string place = context.stopped_at.empty() ? context.where : context.stopped_at;
  if (place.ends_with(": ")) place.erase(place.size() - 2);
  return place;
}

class LuaEngine final : public ScriptEngine {
 public:
  LuaEngine(const std::vector<std::string>& folders, const std::vector<std::string>& protocols)
      : folders_(folders), protocols_(protocols) {}

  ProtocolDescription describe(const std::string& file) override {
    return lua::describe_protocol(lua::library(), file, folders_);
  }
  RigDescription load_rig(const std::string& file) override {
    return lua::read_rig_file(lua::library(), file, folders_);
  }
  RigDescription recorded_rig(const RigSource& rig, const std::vector<RigSource>& bases) override {
    return lua::read_recorded_rig(lua::library(), rig, bases);
  }

  /// The first failure decides how the run ends. The clean-up follows in any case, with less time
  /// after a failure; what fails in it then is an event of the record.
  void run(const ProtocolDescription& protocol,
           const std::map<std::string, ArgumentValue>& arguments, Session& session) override {
    lua::ScriptRun script(lua::library(), running_, session, folders_);
    std::exception_ptr failure;
    try {
      lua::run_protocol(script, protocol, arguments);
    } catch (const std::exception&) {
      failure = std::current_exception();
      session.control.set_location(place_of(script.context()));
      lua::limit_clean_up(script.context());
    }
    try {
      script.clean_up();
    } catch (const std::exception& error) {
      if (!failure) throw;
      session.recorder.event(session.clock.now(), "error",
                             std::string("clean-up: ") + error.what());
    }
    if (failure) std::rethrow_exception(failure);
  }

  /// Statements that fail do not end the prompt. Where nobody reads the errors as they come (a
  /// pipe) they fail the run at its end.
  void prompt(Session& session, LineEditor& in, std::ostream& out, std::ostream& err) override {
    lua::ScriptRun script(lua::library(), running_, session, folders_);
    script.context().protocol_folders = protocols_;
    const lua::PromptEnd end = lua::run_prompt(script, in, out, err);
    script.clean_up();
    if (!end.stopped.empty()) {
      session.control.request(StopTier::stop, end.stopped, end.stopped_by);
      throw Stopped();
    }
    if (in.interactive() || end.failed == 0) return;
    throw ScriptError(std::to_string(end.failed) +
                      " statement(s) failed, the first: " + end.first_error);
  }

  /// May be called by a signal handler: lock-free atomics and a hook of the running state, nothing
  /// else.
  void interrupt() noexcept override {
    lua::Context* const context = running_.context;
    if (!context) return;
    context->interrupted = true;
    // Only the thread that runs Lua may touch its hook; elsewhere the flag is seen at the next call
    // into the host.
    if (!pthread_equal(static_cast<pthread_t>(running_.thread.load()), pthread_self())) return;
    if (lua_State* const L = context->running) lua::arm_stop(L);
  }

 private:
  const std::vector<std::string> folders_, protocols_;
  lua::Running running_;
};

}  // namespace

std::unique_ptr<ScriptEngine> make_lua_engine(const std::vector<std::string>& library_folders,
                                              const std::vector<std::string>& protocol_folders) {
  return std::make_unique<LuaEngine>(library_folders, protocol_folders);
}

}  // namespace vitreo
