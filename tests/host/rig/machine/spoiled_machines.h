// Machines of the laboratory with one thing spoiled each, by subject: what the doctor has to say of
// it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/rig/machine/checks.h"
#include "tests/host/rig/machine/fake_machine.h"

#include <functional>
#include <string>
#include <vector>

namespace vitreo::machine {

inline const std::string kRules = "60-vitreo.rules";

struct Spoiled {
  std::string name;
  std::function<void(FakeMachine&)> spoil;
  std::string check;
  State state;
  std::string found;  // a part of the sentence
  std::string mend;   // a part of the commands; empty: there is none
};

/// Each is wrong with the laboratory's rig.
std::vector<Spoiled> access_and_rivals();
std::vector<Spoiled> usb_and_network();
std::vector<Spoiled> instruments();
std::vector<Spoiled> computer();

}  // namespace vitreo::machine
