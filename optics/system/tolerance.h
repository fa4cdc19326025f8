// Tolerances of an eye's parameters (thesis 4.2, table 5.1), and eyes sampled from them.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/system/prescriptions.h"

#include <random>
#include <string>
#include <vector>

namespace vitreo::optics {

/// One sigma of one parameter, relative to its value.
struct Uncertainty {
  std::string parameter;  // its name in a prescription: "lens.index"
  double relative = 0;    // 0.04: 4 %
  std::string source;     // what the thesis cites for it
};

/// Table 5.1 with its rows put right (docs/optics.md) and the thickness of the lens, which only the
/// text has; the index of the lens is taken as 4 %, the range 1.363 to 1.476 of section 4.2, not as
/// the table's 8 %, its whole span. The condensing lens counts as exact (4.2).
std::vector<Uncertainty> table_5_1();

/// Those of them that the prescription has: an eye without a cornea has no uncertain cornea, air no
/// uncertain index, a flat surface no uncertain radius.
std::vector<Uncertainty> applicable(const std::vector<Uncertainty>& uncertainties,
                                    const Prescription& prescription);

/// The prescription with one parameter off by `sigmas` times its uncertainty. Throws
/// std::invalid_argument naming the parameter when it is not there or the system becomes unsound.
Prescription perturbed(const Prescription& prescription, const Uncertainty& uncertainty,
                       double sigmas);

struct PerturbedEye {
  Prescription prescription;
  std::vector<double> sigmas;  // how far each uncertainty's parameter is off, in its own sigmas
};

/// `count` eyes in which all parameters are off at once, independent and Gaussian. A sample that is
/// no eye (surfaces that cross) is rejected and sampled again; the generator alone decides, so the
/// same seed gives the same eyes on every machine. Throws std::invalid_argument for a negative
/// count, or when hardly any sample is an eye.
std::vector<PerturbedEye> monte_carlo(const Prescription& prescription,
                                      const std::vector<Uncertainty>& uncertainties, int count,
                                      std::mt19937_64& random);

}  // namespace vitreo::optics
