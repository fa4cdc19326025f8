// Request for a run of a script that a test writes: its body, and its rig as a text or a file.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/engine/request.h"

#include <filesystem>
#include <fstream>
#include <string>

namespace vitreo {

/// Writes `body` as the function run(rig, p, run) of p.lua in `folder`, with the units s, mm and ms
/// at hand; `rig` is the text of a rig file where it begins with a line of its own, else the path
/// of one. The record goes to runs/ in the same folder.
inline RunRequest written_run(const std::filesystem::path& folder, const std::string& rig,
                              const std::string& body) {
  const auto write = [&folder](const char* name, const std::string& text) {
    std::ofstream(folder / name) << text;
    return (folder / name).string();
  };
  RunRequest request;
  request.what.protocol_file =
      write("p.lua",
            "local units = require 'units'\nlocal s, mm, ms = units.s, units.mm, units.ms\n"
            "return { title = 'test', needs = { 'coils' }, run = function(rig, p, run)\n" +
                body + "\nend }");
  request.where.rig_file = rig.starts_with("\n") ? write("rig.lua", rig) : rig;
  request.where.out = (folder / "runs").string();
  return request;
}

}  // namespace vitreo
