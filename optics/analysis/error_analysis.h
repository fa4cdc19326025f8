// Error analysis of uncertain eyes: one parameter at a time, all at once, and attribution of the
// error's variance to parameters (thesis 4.2, 4.3).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/calibration/calibration.h"
#include "optics/system/tolerance.h"

#include <functional>
#include <optional>
#include <random>
#include <string>
#include <vector>

namespace vitreo::optics {

/// The error (m) of a method that assumes one eye while another, `truth`, forms the image. Nothing
/// where it has no answer.
using EyeError = std::function<std::optional<double>(const Prescription& truth)>;

/// Where the image of an object on the axis, `depth` (m) before the retina, is in focus, m from the
/// last vertex.
using AxialFocus = std::function<std::optional<double>(const System& system, double depth)>;
AxialFocus paraxial_focus();
/// Least rms radius of the traced bundle that fills the stop.
AxialFocus traced_focus();

struct AxisErrorOptions {
  double depth_to = 8e-3;          // m; depths from the retina to here
  int depths = 9;                  // at least 3
  bool calibrated = false;         // biometrically, on the eye's own retina
  double retinal_depth_error = 0;  // m, of that calibration; the worse of both signs counts
  BiometricMethod method = BiometricMethod::sensor_shift;
  void check() const;  // throws std::invalid_argument naming the option
};

/// Largest error of depth on the axis, by focus, with the eye assumed to be `believed`: its law
/// (4.10) to (4.12) refined to its own foci. This is the on-axis part of figures 4.2 (not
/// calibrated), 4.5 and 4.6 (calibrated).
EyeError axis_error(const Prescription& believed, const AxialFocus& focus,
                    const AxisErrorOptions& options = {});

struct Sensitivity {
  std::string parameter;
  // error with the parameter one sigma less, one more; nothing: no answer there
  std::optional<double> minus;
  std::optional<double> plus;
  double worst() const;  // the larger one; infinite when one has no answer
};

/// One parameter at a time, the worst first.
std::vector<Sensitivity> one_at_a_time(const Prescription& prescription,
                                       const std::vector<Uncertainty>& uncertainties,
                                       const EyeError& error);

struct ErrorStatistics {
  int count = 0;   // eyes with an answer
  int failed = 0;  // and without
  // m, of those with one; 0 when there is none
  double mean = 0;
  double rms = 0;
  double median = 0;
  double percentile_95 = 0;
  double max = 0;
};
ErrorStatistics statistics(const std::vector<PerturbedEye>& eyes, const EyeError& error);

struct MeasurementValue {
  std::string parameter;
  ErrorStatistics known;  // when this parameter of the patient is measured exactly and used
  double reduction = 0;   // of the rms, relative: 0.2 is 20 % less
};

/// Which measurement of the patient would reduce the error most, the best first: all parameters
/// uncertain but one, on the same samples, the method assuming the prescription with that one put
/// right. `make_error` builds the method for the assumed eye. Throws as monte_carlo.
std::vector<MeasurementValue> variance_attribution(
    const Prescription& prescription, const std::vector<Uncertainty>& uncertainties,
    const std::function<EyeError(const Prescription& believed)>& make_error, int count,
    std::mt19937_64& random);

}  // namespace vitreo::optics
