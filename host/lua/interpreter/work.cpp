// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/work.h"

#include "devices/time/error.h"
#include "host/lua/interpreter/context.h"
#include "host/text/units.h"

#include <memory>
#include <stdexcept>
#include <utility>

namespace vitreo::lua {
namespace {

struct Job {
  bool done = false;
  std::exception_ptr error;
  Signal finished;
  std::unique_ptr<Task> task;  // last: it ends before what it uses
};

std::string reading_of(const WaitInfo& about) {
  if (!about.reading) return "";
  try {
    return about.reading();
  } catch (const Stopped&) {
    throw;
  } catch (const std::exception& error) {
    return std::string("none (") + error.what() + ")";
  }
}

/// The device's own words, and what only the caller knows.
std::exception_ptr with_details(const DeviceError& error, const WaitInfo& about, double elapsed) {
  return std::make_exception_ptr(
      DeviceError(error.kind, error.device,
                  error.text + "; " + waited_text(about.target, reading_of(about), elapsed)));
}

void run_job(Job& job, Clock& clock, const std::function<void()>& blocking, const WaitInfo& about) {
  const Time began = clock.now();
  try {
    blocking();
  } catch (const Stopped&) {
    throw;
  } catch (const DeviceError& error) {
    const bool late = error.kind == DeviceErrorKind::timeout;
    job.error = late ? with_details(error, about, to_seconds(clock.now() - began))
                     : std::current_exception();
  } catch (const std::exception&) {
    job.error = std::current_exception();
  }
  job.done = true;
  clock.notify(job.finished);
}

}  // namespace

std::string waited_text(const std::string& target, const std::string& reading, double elapsed) {
  return (target.empty() ? "" : "wanted " + target + "; ") +
         (reading.empty() ? "" : "last reading " + reading + "; ") + "after " +
         format_quantity(elapsed, "s");
}

Wait work(const Call& call, const std::string& name, std::function<void()> blocking, Time timeout,
          std::function<int(Call&)> finish, WaitInfo about) {
  call.check_can_wait();
  Clock& clock = session_of(call.L).clock;
  auto job = std::make_shared<Job>();
  job->task = clock.spawn("script: " + name, [&clock, job = job.get(), run = std::move(blocking),
                                              about] { run_job(*job, clock, run, about); });
  Wait wait;
  wait.signal = &job->finished;
  wait.ready = [job] { return job->done; };
  wait.deadline = later(clock.now(), timeout);
  wait.finish = [job, name, timeout, target = about.target, then = std::move(finish)](
                    Call& done, bool in_time) {
    if (!in_time)  // who hangs cannot be asked where it is
      throw std::runtime_error(name + " did not answer; " +
                               waited_text(target, "none: it hangs", to_seconds(timeout)));
    job->task->join();
    if (job->error) std::rethrow_exception(job->error);
    return then(done);
  };
  return wait;
}

}  // namespace vitreo::lua
