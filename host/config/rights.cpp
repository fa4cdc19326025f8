// SPDX-License-Identifier: Apache-2.0
#include "host/config/rights.h"

#include <pwd.h>
#include <unistd.h>

namespace vitreo {
namespace {

// The default is the lesser right: `rights` is written to restrict.
Right right_in(ConfigReader& reader, const std::string& key) {
  return reader.choice(key, "technician", {"technician", "researcher"}) == "researcher"
             ? Right::researcher
             : Right::technician;
}

}  // namespace

const char* to_string(Right right) {
  return right == Right::researcher ? "researcher" : "technician";
}

// Without the table `rights` the default `others_` (researcher) holds for every account.
Rights Rights::read(ConfigReader& rig) {
  Rights rights;
  if (!rig.has("rights")) return rights;
  ConfigReader reader = rig.table("rights");
  rights.others_ = right_in(reader, "others");
  for (const std::string& name : reader.keys())
    if (name != "others") rights.named_[name] = right_in(reader, name);
  reader.finish();
  return rights;
}

// No finish(): the rest of the description is read elsewhere, and is not this reader's.
Rights Rights::of(const RigDescription& rig) {
  ConfigReader reader(rig);
  return read(reader);
}

Right Rights::of(const std::string& name) const {
  const auto found = named_.find(name);
  return found == named_.end() ? others_ : found->second;
}

void Rights::require_researcher(const std::string& name, const std::string& what) const {
  if (of(name) == Right::researcher) return;
  throw RightError((name.empty() ? std::string("who is not named") : name) +
                   " is a technician here: " + what +
                   " wants a researcher's right (the rig file's rights)");
}

// The effective account, which is the one whose rights the files have. A container may run under a
// number without a name.
std::string account_name() {
  const passwd* const account = getpwuid(geteuid());
  return account != nullptr ? account->pw_name : std::to_string(geteuid());
}

}  // namespace vitreo
