// Identification of a camera that discovery has found: the size of its images and its rate.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/genicam/driver.h"
#include "devices/links/identification.h"

#include <vector>

namespace vitreo::genicam {

/// The roles of a camera, with its largest image and the rate that it has now. It is opened for
/// that and closed again; nothing is set, nothing is started. Without size and rate where another
/// program controls it.
std::vector<ProposedRole> proposed_roles(const Found& camera);

}  // namespace vitreo::genicam
