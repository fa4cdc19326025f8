// SPDX-License-Identifier: Apache-2.0
#include "host/trials/soak_script.h"

#include <algorithm>
#include <array>
#include <stdexcept>

namespace vitreo {
namespace {

struct Misbehavior {
  const char* name;
  const char* lua;  // `go` carries out the protocol; rig, p and run are its own
};

// None of them commands a current within the limits beside a loop: that is another experiment. None
// ends the run itself, and each ends: what does not is for the stop's own tests.
// New ones at the end, so that old seeds mean what they meant.
constexpr std::array kMisbehaviors{
    Misbehavior{"computes", "for i = 1, 3000000 do local x = i * i end go()"},
    Misbehavior{"swallows errors", "pcall(go) run:wait(0.2) pcall(function() error {} end)"},
    Misbehavior{"fails in a task", "run:together(go, function() run:wait(0.7) error(nil) end)"},
    Misbehavior{"closes by yielding",
                "coroutine.wrap(function() local held <close> = setmetatable({}, { __close = "
                "function() coroutine.yield() end }) go() end)()"},
    Misbehavior{"waits where it cannot",
                "pcall(table.sort, { 3, 2, 1 }, function() run:wait(1) end) go()"},
    Misbehavior{
        "defers what fails and waits",
        "run:defer(function() error('late') end) run:defer(function() run:wait(2) end) go()"},
    Misbehavior{"empties its libraries",
                "string, table, math, coroutine, pcall = {}, {}, {}, {}, print go()"},
    Misbehavior{"recurses", "pcall(function() local function f() return 1 + f() end f() end) go()"},
    Misbehavior{"raises alarms in a loop",
                "run:together(go, function() for i = 1, 300 do "
                "run:alarm { name = 'unruly', priority = 'low', text = 'turn ' .. i } "
                "run:wait(0.01) end end)"},
    Misbehavior{
        "asks beyond the limits beside the loop",
        "run:together(go, function() run:wait(0.6) pcall(rig.coils.set_currents, rig.coils, "
        "{ 99, 0, 0, 0, 0, 0, 0, 0 }) run:wait(0.3) end)"},
    Misbehavior{
        "takes all the memory",
        "pcall(function() local all = {} for i = 1, 1e9 do all[i] = ('x'):rep(1e6) .. i end "
        "end) go()"},
    Misbehavior{"begins again after a stop",
                "local ok = pcall(go) if not ok then pcall(go) end go()"},
    Misbehavior{
        "makes a thousand tasks",
        "local many = {} for i = 1, 1000 do many[i] = function() run:wait(0.001 * i) end end "
        "run:together(go, table.unpack(many, 1, 200))"},
};

}  // namespace

std::vector<std::string> misbehaviors() {
  std::vector<std::string> names;
  for (const Misbehavior& one : kMisbehaviors) names.emplace_back(one.name);
  return names;
}

// The protocol's text becomes a function: whatever it returns beside `run` stays as it is.
std::string misbehaving(const std::string& text, const std::string& misbehavior) {
  const auto* const found =
      std::find_if(kMisbehaviors.begin(), kMisbehaviors.end(),
                   [&](const Misbehavior& one) { return one.name == misbehavior; });
  if (found == kMisbehaviors.end())
    throw std::invalid_argument("misbehavior: there is no '" + misbehavior + "'");
  return "local protocol = (function(...) " + text +
         "\nend)(...)\nlocal own = protocol.run\nprotocol.run = function(rig, p, run)\n"
         "  local function go() return own(rig, p, run) end\n  " +
         found->lua + "\nend\nreturn protocol\n";
}

}  // namespace vitreo
