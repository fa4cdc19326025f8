// Rights of operators: a technician runs protocols within their ranges; a researcher also has the
// prompt and may override what was refused. They prevent mistakes, not malice: an account that can
// write the rig file can do anything.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/config/config.h"

#include <map>
#include <stdexcept>
#include <string>

namespace vitreo {

enum class Right { technician, researcher };
const char* to_string(Right right);

/// A request that only a researcher may make; what() names the operator and the request.
class RightError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// As the rig file's table `rights` has them: { anna = "researcher", others = "technician" }.
/// Without that table every operator is a researcher; with it, one that is not named is a
/// technician, or what `others` says.
class Rights {
 public:
  Rights() = default;
  /// Throws ConfigError.
  static Rights read(ConfigReader& rig);
  /// The same from a description alone, before anything else of it was read.
  static Rights of(const RigDescription& rig);
  Right of(const std::string& name) const;
  /// Throws RightError: "ben is a technician: the prompt wants a researcher's right".
  void require_researcher(const std::string& name, const std::string& what) const;

 private:
  std::map<std::string, Right> named_;
  Right others_ = Right::researcher;
};

/// The name of the account that runs this program, or its number where it has none.
std::string account_name();

}  // namespace vitreo
