// Forwarding stages: bases of decorators and adapters that pass every call on to another stage.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/rotation_stage.h"
#include "devices/roles/stage.h"

#include <span>
#include <vector>

namespace vitreo {

/// What Stage and RotationStage have in common, forwarded from `Role` to an `Inner` that outlives
/// this object.
template <class Role, class Inner = Role>
class ForwardingMotion : public Role {
 public:
  explicit ForwardingMotion(Inner& inner) : inner_(inner) {}
  bool moving() override { return inner_.moving(); }
  void wait(Time timeout) override { inner_.wait(timeout); }
  void home(Time timeout) override { inner_.home(timeout); }
  void stop() override { inner_.stop(); }
  void make_safe() override { inner_.make_safe(); }

 protected:
  Inner& inner() const { return inner_; }

 private:
  Inner& inner_;
};

/// A decorator overrides what it changes.
class ForwardingStage : public ForwardingMotion<Stage> {
 public:
  using ForwardingMotion::ForwardingMotion;
  const StageInfo& info() const override { return inner().info(); }
  std::vector<double> position() override { return inner().position(); }
  void start(std::span<const double> target, double speed) override {
    inner().start(target, speed);
  }
};

/// Likewise.
class ForwardingRotationStage : public ForwardingMotion<RotationStage> {
 public:
  using ForwardingMotion::ForwardingMotion;
  const RotationStageInfo& info() const override { return inner().info(); }
  double position() override { return inner().position(); }
  void start(double target, double speed) override { inner().start(target, speed); }
};

}  // namespace vitreo
