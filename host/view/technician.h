// Emulated technician: does in the emulated laboratory what a run asks a person for, and answers.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>

#include <functional>
#include <memory>

namespace vitreo {

/// Follows, by their control sockets, the runs of this process and of those that it started, and no
/// others: a laboratory's run on the same machine keeps its own operator. A question that has a
/// task (Question::task) is answered with yes once `hands` has done it, with no where it throws;
/// other questions are left to whoever ran the command.
class Technician {
 public:
  using Hands = std::function<void(const nlohmann::json& task)>;
  explicit Technician(Hands hands);
  ~Technician();
  Technician(const Technician&) = delete;
  Technician& operator=(const Technician&) = delete;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace vitreo
