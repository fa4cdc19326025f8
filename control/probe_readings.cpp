// SPDX-License-Identifier: Apache-2.0
#include "control/probe_readings.h"

#include <Eigen/QR>

#include <cmath>
#include <stdexcept>
#include <string>

namespace vitreo::control {

// Rank of the readings' currents with a column of ones for the background: where it is short, a
// combination of coils cannot be told from another, and the fit would be singular.
// Throws std::invalid_argument naming the reading, or the coil that was never used.
void check_readings(const std::vector<ProbeReading>& readings, int coils, std::size_t needed) {
  Eigen::MatrixXd currents(static_cast<Eigen::Index>(readings.size()), coils + 1);
  for (std::size_t n = 0; n < readings.size(); ++n) {
    const ProbeReading& reading = readings[n];
    const std::string name = "reading " + std::to_string(n + 1);
    if (!reading.position.allFinite())
      throw std::invalid_argument(name + ": position is not finite");
    if (!reading.field.allFinite()) throw std::invalid_argument(name + ": field is not finite");
    if (reading.currents.size() != coils)
      throw std::invalid_argument(name + ": one current a coil is needed");
    if (!reading.currents.allFinite())
      throw std::invalid_argument(name + ": a current is not finite");
    currents.row(static_cast<Eigen::Index>(n)) << reading.currents.transpose(), 1;
  }
  if (readings.size() < needed) {
    throw std::invalid_argument("readings: " + std::to_string(readings.size()) +
                                " given, at least " + std::to_string(needed) + " needed");
  }
  for (int k = 0; k < coils; ++k) {
    if (!(currents.col(k).norm() > 0)) {
      throw std::invalid_argument("readings: coil " + std::to_string(k + 1) +
                                  " never had a current");
    }
    // Columns of unit length, so that one threshold does for all.
    currents.col(k) /= currents.col(k).norm();
  }
  currents.col(coils).normalize();
  // 1e-6 of the largest pivot: settings of an amplifier that differ by less are one setting.
  if (Eigen::ColPivHouseholderQR<Eigen::MatrixXd>(currents).setThreshold(1e-6).rank() <= coils) {
    throw std::invalid_argument("readings: the currents never vary independently");
  }
}

// rms over the 3 N components; the largest by the length of a reading's vector.
// In T, but for `relative`, which is over the rms of the measured fields.
ResidualReport residual_report(const std::vector<ProbeReading>& readings,
                               const std::function<Eigen::Vector3d(const ProbeReading&)>& model) {
  ResidualReport report;
  double misses = 0;
  double size = 0;
  for (std::size_t n = 0; n < readings.size(); ++n) {
    const double miss = (model(readings[n]) - readings[n].field).norm();
    misses += miss * miss;
    size += readings[n].field.squaredNorm();
    if (miss > report.largest) report.largest = miss, report.worst = n;
  }
  report.rms = std::sqrt(misses / (3 * static_cast<double>(readings.size())));
  report.relative = size > 0 ? std::sqrt(misses / size) : 0;
  return report;
}

}  // namespace vitreo::control
