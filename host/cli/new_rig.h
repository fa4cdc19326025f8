// `vitreo new rig`: the interview at a terminal, or with answers from a file or the standard input.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace vitreo::cli {

struct NewRigWords {
  std::string name;     // of the rig, or its file; empty: it is asked for
  std::string answers;  // a file of "key = answer" lines; empty: standard input
  bool json = false;    // only the file that was made
};

/// The program's exit code: 0 when the file is written, 3 when the person quit. Throws ConfigError
/// for answers that cannot be, that are missing, or that nothing asked for; then nothing is
/// written.
int new_rig(const NewRigWords& words);

}  // namespace vitreo::cli
