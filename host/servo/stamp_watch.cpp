// SPDX-License-Identifier: Apache-2.0
#include "host/servo/stamp_watch.h"

#include "host/text/units.h"

#include <cmath>

namespace vitreo {
namespace {

// s: a robot at 3 mm/s goes 30 um meanwhile.
constexpr double kStampLeap = 10e-3;
// s, and s/s: of a stamp since the first, with crystals 500 ppm apart.
constexpr double kStampDrift = 30e-3;
constexpr double kStampCrystals = 5e-4;
// Between two anchors: in it, a drift of 2 ms/s shows.
constexpr Time kStampRenewed = std::chrono::seconds(5);

}  // namespace

// With E, R and N what exposure, arrival and number times period have gone on by:
// the stamps have leapt where E - R and E - N are both beyond what is allowed, and the arrivals
// keep nearer to the numbers than the stamps do: |R - N| < |E - N|, by which both are to the same
// side.
double StampWatch::moved(const Stamp& then, const Stamp& now, double allowed) const {
  const double exposed = to_seconds(now.exposed - then.exposed);
  const double received = to_seconds(now.received - then.received);
  const double numbered = static_cast<double>(now.number - then.number) * period_;
  const double by_arrival = exposed - received;
  const double by_number = exposed - numbered;
  const bool leapt = std::abs(by_arrival) > allowed && std::abs(by_number) > allowed &&
                     std::abs(received - numbered) < std::abs(by_number);
  return leapt ? by_number : 0;
}

std::string StampWatch::fault(const Frame& frame, Time now) {
  if (frame.exposed > now)
    return "its time stamps are " + format_quantity(to_seconds(frame.exposed - now), "s") +
           " in the future: its clock is wrong";
  if (!(period_ > 0)) return {};
  const Stamp stamp{frame.exposed, frame.received, frame.number};
  if (!first_) first_ = anchor_ = next_ = stamp;
  if (stamp.number < first_->number) return {};  // out of order, which is another fault
  double leap = stamp.number < anchor_->number ? 0 : moved(*anchor_, stamp, kStampLeap);
  if (leap == 0) {
    const double since = std::abs(to_seconds(stamp.received - first_->received));
    leap = moved(*first_, stamp, kStampDrift + kStampCrystals * since);
  }
  if (leap != 0)
    return "its time stamps have moved by " + format_quantity(leap, "s") +
           " while its frames came as before: its clock was set, or drifts";
  if (stamp.received - next_->received > kStampRenewed) {
    anchor_ = next_;
    next_ = stamp;
  }
  return {};
}

}  // namespace vitreo
