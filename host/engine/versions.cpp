// SPDX-License-Identifier: Apache-2.0
#include "host/engine/versions.h"

#include <Eigen/Core>
#include <ceres/version.h>
#include <fmt/core.h>
#include <opencv2/core/version.hpp>
#include <sqlite3.h>

namespace vitreo {

nlohmann::json versions() {
  return {{"vitreo", VITREO_VERSION},
          {"commit", VITREO_COMMIT},
          {"compiler", __VERSION__},
          {"eigen",
           fmt::format("{}.{}.{}", EIGEN_WORLD_VERSION, EIGEN_MAJOR_VERSION, EIGEN_MINOR_VERSION)},
          {"ceres", CERES_VERSION_STRING},
          {"opencv", CV_VERSION},
          {"sqlite", sqlite3_libversion()}};
}

}  // namespace vitreo
