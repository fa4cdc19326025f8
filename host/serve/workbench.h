// Workbench: the server behind `vitreo serve`, which holds no instrument: queue, dispatcher, web
// server and their threads, in the order of their lives.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/serve/forms.h"
#include "host/view/admission.h"

#include <filesystem>
#include <memory>
#include <string>

namespace vitreo::serve {

struct WorkbenchSettings {
  view::ViewRequest web;           // where it listens; without a token file: one in `state`
  int live_port = 0;               // of the live views; 0: any that is free
  std::filesystem::path state;     // queue, jobs, token
  std::filesystem::path runs;      // absolute
  std::filesystem::path sweeps;    // absolute
  std::filesystem::path messages;  // the settings file
  std::string program;             // the path of this program
  std::string version;
};

class Workbench {
 public:
  /// Serves until it is destroyed; jobs that go on then go on by themselves. Throws ConfigError:
  /// another workbench uses the same folder, an address at which it cannot listen, wrong settings
  /// of the messages.
  Workbench(WorkbenchSettings settings, ScriptEngine& engine, FormSources sources);
  ~Workbench();
  Workbench(const Workbench&) = delete;
  Workbench& operator=(const Workbench&) = delete;

  std::string address() const;  // "http://127.0.0.1:7600/"
  /// An address with a token in it that admits one browser, once.
  std::string invitation();
  /// A page of one's own (mode 0600) that leads a browser to the workbench: what a desktop opens.
  /// The token in it is on no command line, which others could read.
  std::filesystem::path door() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// The door of the workbench that serves from this folder now; empty where none does.
std::filesystem::path open_door(const std::filesystem::path& state);

}  // namespace vitreo::serve
