// Query for runs: the expression language of `vitreo runs --where`, its reader and its translation
// to SQL over the catalog.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <variant>
#include <vector>

namespace vitreo {

/// Kinds of values: parameter, result, tag, field of the sample.
inline constexpr const char* kCatalogKinds = "prts";

/// What the catalog knows of a name: a kind of value (of kCatalogKinds) with the SI unit in
/// which runs have it.
struct KnownValue {
  char kind = 'p';
  std::string unit;
  bool text = false;  // runs have a text under it
};

/// The catalog as a query sees it.
struct Vocabulary {
  /// Every kind and unit under which runs have that name; `kind` 0: any.
  std::function<std::vector<KnownValue>(const std::string& name, char kind)> find;
  /// All names, for "did you mean"; asked only for an error.
  std::function<std::vector<std::string>()> names;
};

/// A condition on the catalog's view `all_run` with the values to be bound, in order.
struct SqlCondition {
  std::string sql;
  std::vector<std::variant<double, std::string>> values;
};

/// A name in a query or a list of columns: a field of the run itself ("outcome"), or a value: a
/// bare name is any of the run's parameters, results, tags and sample fields; p.NAME, r.NAME,
/// tag.NAME and sample.NAME say which.
struct QueryName {
  std::string field;  // column of all_run; empty: a value
  char kind = 0;      // of a value; 0: any
  std::string name;   // of a value
};

/// SQL over the catalog's values of a kind (of kCatalogKinds); 0: any.
std::string kind_condition(char kind);

/// Throws ConfigError, with `at` for the message, where no run has it.
QueryName query_name(const std::string& word, const Vocabulary& known, const std::string& at);

/// expression: comparisons joined by `and`, `or`, `not` and parentheses.
/// comparison: NAME OP VALUE with OP one of < <= > >= = != and ~ (contains, letters of either
/// case), or NAME alone: the run has such a value. VALUE: a number with its unit (0.3mm/s, 150 um),
/// a word, or a text in quotes. A time (field `time`) is compared as far as it is written:
/// time >= 2026-11-21, time = 2026-11. A run without the value does not fulfil a comparison.
/// Throws ConfigError with the place of the mistake.
SqlCondition translate_query(const std::string& text, const Vocabulary& known);

}  // namespace vitreo
