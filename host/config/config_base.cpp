// SPDX-License-Identifier: Apache-2.0
#include "host/config/config_base.h"

#include <utility>

namespace vitreo {
namespace {

const ConfigTable* table_of(const ConfigValue& value) {
  return std::get_if<ConfigTable>(&value.value);
}

const std::string* driver_of(const ConfigTable& table) {
  const auto found = table.find("driver");
  return found == table.end() ? nullptr : std::get_if<std::string>(&found->second.value);
}

/// Settings of one driver mean nothing to another: then the base's table is replaced, not joined.
bool is_another_driver(const ConfigTable& own, const ConfigTable& base) {
  const std::string *wanted = driver_of(own), *before = driver_of(base);
  return wanted != nullptr && before != nullptr && *wanted != *before;
}

/// `false` in the place of a table, number, text or list.
bool takes_away(const ConfigValue& own, const ConfigValue& base) {
  const bool* const flag = std::get_if<bool>(&own.value);
  return flag != nullptr && !*flag && !std::holds_alternative<bool>(base.value);
}

class Joiner {
 public:
  explicit Joiner(RigDescription& rig) : rig_(rig) {}

  /// Notes every key of the base as the base's, until a nearer file sets it. `first`: its index in
  /// `bases`; what the base itself has from farther files comes behind it.
  void claim(const ConfigTable& base, const std::string& path, const RigDescription& from,
             std::size_t first) {
    for (const auto& [key, value] : base) {
      const std::string dotted = path + key;
      // A base that builds on another one knows that itself; its indices move by its own place.
      const auto farther = from.from_base.find(dotted);
      rig_.from_base[dotted] =
          farther == from.from_base.end() ? first : first + 1 + farther->second;
      if (const ConfigTable* const inner = table_of(value))
        claim(*inner, dotted + ".", from, first);
    }
  }

  // Works in the base's table: what the rig states is moved over it, everything else is already
  // there.
  void join(ConfigTable& base, ConfigTable own, const std::string& path) {
    for (auto& [key, value] : own) {
      const std::string dotted = path + key;
      const auto under = base.find(key);
      if (under == base.end()) {
        base[key] = std::move(value);
      } else if (takes_away(value, under->second)) {
        forget(dotted);
        base.erase(under);
      } else {
        put(under->second, std::move(value), dotted);
      }
    }
  }

 private:
  // Two tables of the same driver are joined key by key; anything else replaces what was there.
  void put(ConfigValue& under, ConfigValue value, const std::string& dotted) {
    auto* const own = std::get_if<ConfigTable>(&value.value);
    auto* const before = std::get_if<ConfigTable>(&under.value);
    if (own != nullptr && before != nullptr && !is_another_driver(*own, *before)) {
      rig_.from_base.erase(dotted);
      return join(*before, std::move(*own), dotted + ".");
    }
    forget(dotted);
    under = std::move(value);
  }

  // The key and all below it come from the nearer file from now on.
  void forget(const std::string& dotted) {
    rig_.from_base.erase(dotted);
    std::erase_if(rig_.from_base,
                  [&](const auto& entry) { return entry.first.starts_with(dotted + "."); });
  }

  RigDescription& rig_;
};

}  // namespace

// The order matters: first every key is claimed for the base, then those that the rig sets are
// taken out again.
void build_on(RigDescription& rig, RigDescription base) {
  Joiner joiner(rig);
  joiner.claim(base.table, "", base, rig.bases.size());
  rig.bases.push_back({base.file, base.text});
  for (RigSource& farther : base.bases) rig.bases.push_back(std::move(farther));
  ConfigTable own = std::exchange(rig.table, std::move(base.table));
  joiner.join(rig.table, std::move(own), "");
}

}  // namespace vitreo
