// Which cameras the robot's place is by, for those who compare a place with the ones before.
// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace vitreo {

/// One camera alone has another depth than both: what the place leaps by when one falls out is no
/// motion. A place of the other kind is passed over; where it stays so for kOtherView places in a
/// row all begins anew with it. So a camera that comes and goes takes no listener its sight.
class PairedView {
 public:
  enum class Place { taken, passed_over, begins_anew };
  static constexpr int kOtherView = 5;

  /// `paired`: the place is by both cameras.
  Place hear(bool paired) {
    if (paired == paired_) return others_ = 0, Place::taken;
    if (++others_ < kOtherView) return Place::passed_over;
    paired_ = paired;
    others_ = 0;
    return Place::begins_anew;
  }

 private:
  bool paired_ = false;
  int others_ = 0;  // of the other kind, in a row
};

}  // namespace vitreo
