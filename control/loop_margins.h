// Margins of a servo loop on an estimate: by how much gain and delay may be other than believed
// until it oscillates.
// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace vitreo::control {

/// The sampled linear loop of one coordinate, gains frozen. Plant: p' = g u behind delay and lag, g
/// = 1 as believed. Observer: p^ and d^, predicted through the commands and corrected by its gains
/// at each measurement. Law: u = -Kp p^ - d^, for the moment `horizon` after the command is given.
struct SampledLoop {
  double period = 1.0 / 15;     // s, between measurements
  double latency = 0.08;        // s, from a measurement to the command that knows of it
  double command_delay = 0.05;  // s
  double command_lag = 0.0106;  // s
  double horizon = 0.0606;      // s: how far ahead of the command the estimate is taken
  double proportional = 2.5;    // 1/s
  double position_gain = 0.3;   // of the observer: m per m of innovation
  double velocity_gain = 0.4;   // 1/s: m/s per m of innovation
  void check() const;           // throws std::invalid_argument naming the parameter
};

/// The largest magnitude of the loop's eigenvalues from one measurement to the next, where the true
/// response is `gain` times the believed one and comes `delay` s later: below 1 it is stable.
/// Throws std::invalid_argument where that makes the whole delay negative.
double spectral_radius(const SampledLoop& loop, double gain, double delay);

struct LoopMargins {
  bool stable = false;    // as believed
  double gain_up = 1;     // factor of the response at which it becomes unstable
  double gain_down = 1;   // the same below 1; 0: none
  double delay_more = 0;  // s, later than believed; longest_searched where it is stable there
  double delay_less = 0;  // s, sooner than believed; the whole delay where it is stable without one
  double longest_searched = 0;  // s
};

/// Each by bisection to a thousandth, all else as believed.
LoopMargins loop_margins(const SampledLoop& loop);

}  // namespace vitreo::control
