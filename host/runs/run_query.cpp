// SPDX-License-Identifier: Apache-2.0
#include "host/runs/run_query.h"

#include "host/config/config.h"
#include "host/text/units.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <optional>
#include <set>
#include <string_view>
#include <utility>

namespace vitreo {
namespace {

/// Fields of the run itself; `words` is all of its texts, for a search.
constexpr std::pair<const char*, const char*> kFields[] = {
    {"run", "name"},          {"name", "name"}, {"protocol", "protocol"}, {"title", "title"},
    {"operator", "operator"}, {"seed", "seed"}, {"outcome", "outcome"},   {"reason", "reason"},
    {"ended_by", "ended_by"}, {"rig", "rig"},   {"time", "time"},         {"date", "time"},
    {"version", "version"},   {"text", "words"}};

/// A prefix says of which kind a name is, where a parameter and a result share one.
/// The letter is the kind in the catalog's table `value`: p parameter, r result, t tag, s field of
/// the sample.
constexpr std::pair<const char*, char> kPrefixes[] = {{"p.", 'p'},   {"parameter.", 'p'},
                                                      {"r.", 'r'},   {"result.", 'r'},
                                                      {"tag.", 't'}, {"sample.", 's'}};

/// A word of the query. Keywords are names: `and` is one only where a name cannot stand.
struct Token {
  enum class Kind { name, operation, number, text, open, close, end };
  Kind kind = Kind::end;
  std::string text;
  std::size_t at = 0;  // in the query
};

/// The query with a mark below the place: what a person at a terminal reads.
[[noreturn]] void fail(const std::string& query, std::size_t at, const std::string& problem) {
  // Characters, not bytes: µ has two.
  std::size_t column = 0;
  for (std::size_t i = 0; i < std::min(at, query.size()); ++i)
    if ((static_cast<unsigned char>(query[i]) & 0xC0) != 0x80) ++column;
  throw ConfigError(fmt::format("--where: at character {}: {}\n  {}\n  {}^", column + 1, problem,
                                query, std::string(column, ' ')));
}

/// Letters of other alphabets are taken as they are: bytes of UTF-8 from 0x80 on.
bool is_word(char c) {
  const auto byte = static_cast<unsigned char>(c);
  return std::isalnum(byte) != 0 || c == '_' || c == '.' || byte >= 0x80;
}

/// These three are no names; a parameter of such a name is reached by its prefix.
bool is_keyword(const std::string& word) { return word == "and" || word == "or" || word == "not"; }

/// Cuts a query into words.
class Lexer {
 public:
  explicit Lexer(const std::string& query) : query_(query) {}

  std::vector<Token> tokens() {
    std::vector<Token> list;
    do {
      // A value follows an operation: 2026-11-21 is a word there.
      const bool value = !list.empty() && list.back().kind == Token::Kind::operation;
      list.push_back(next(value));
    } while (list.back().kind != Token::Kind::end);
    return list;
  }

 private:
  Token next(bool value) {
    skip_blanks();
    const std::size_t at = at_;
    if (at == query_.size()) return {Token::Kind::end, "", at};
    const char c = query_[at];
    if (c == '(' || c == ')') {
      ++at_;
      return {c == '(' ? Token::Kind::open : Token::Kind::close, std::string(1, c), at};
    }
    if (c == '"' || c == '\'') return quoted(c);
    // Signs before words: what begins with one cannot be a name.
    if (std::string_view("<>=!~").find(c) != std::string_view::npos) return operation();
    if (value) return word_or_number();
    if (!is_word(c)) fail(query_, at, fmt::format("'{}' is not understood", c));
    // A dash belongs to a name and begins none.
    while (at_ < query_.size() && (is_word(query_[at_]) || query_[at_] == '-')) ++at_;
    return {Token::Kind::name, query_.substr(at, at_ - at), at};
  }

  void skip_blanks() {
    while (at_ < query_.size() && std::isspace(static_cast<unsigned char>(query_[at_])) != 0) ++at_;
  }

  Token quoted(char quote) {
    const std::size_t at = at_;
    // No escapes: a text with one kind of quotation mark is put into the other kind.
    const std::size_t end = query_.find(quote, at + 1);
    if (end == std::string::npos) fail(query_, at, "the quotation is not closed");
    at_ = end + 1;
    return {Token::Kind::text, query_.substr(at + 1, end - at - 1), at};
  }

  Token operation() {
    const std::size_t at = at_;
    // The longer ones first, or "<=" would be read as "<".
    for (const char* const sign : {"<=", ">=", "!=", "==", "<", ">", "=", "~"})
      if (query_.compare(at, std::string_view(sign).size(), sign) == 0) {
        at_ += std::string_view(sign).size();
        return {Token::Kind::operation, std::string(sign) == "==" ? "=" : sign, at};
      }
    fail(query_, at, "wants one of < <= > >= = != ~");
  }

  /// Up to a blank or a parenthesis; a number may have its unit behind blanks: "150 um".
  Token word_or_number() {
    const std::size_t at = at_;
    const std::string word = run_of_value();
    if (word.empty()) fail(query_, at, "wants a value");
    const std::size_t behind = at_;
    // A number that ends with its unit already does not take the next word for one.
    if (std::isalpha(static_cast<unsigned char>(word.back())) == 0) {
      skip_blanks();
      const std::string unit = run_of_value();
      if (!unit.empty() && !is_keyword(unit) && parse_quantity(word) && find_unit(unit))
        return {Token::Kind::number, word + " " + unit, at};
      // That was the next word of the query: "and", or a name.
      at_ = behind;
    }
    return {parse_quantity(word) ? Token::Kind::number : Token::Kind::text, word, at};
  }

  std::string run_of_value() {
    const std::size_t begin = at_;
    while (at_ < query_.size() && std::isspace(static_cast<unsigned char>(query_[at_])) == 0 &&
           query_[at_] != '(' && query_[at_] != ')')
      ++at_;
    return query_.substr(begin, at_ - begin);
  }

  const std::string& query_;
  std::size_t at_ = 0;
};

/// Values stay apart from the text, in the order of their marks: nothing that was typed becomes
/// SQL.
/// In parentheses, so that the SQL is grouped as the query is.
SqlCondition joined(SqlCondition a, const char* word, SqlCondition b) {
  a.sql = "(" + a.sql + word + b.sql + ")";
  a.values.insert(a.values.end(), b.values.begin(), b.values.end());
  return a;
}

/// Recursive descent over the tokens; the language is at translate_query().
class Parser {
 public:
  Parser(const std::string& query, const Vocabulary& known)
      : query_(query), known_(known), tokens_(Lexer(query).tokens()) {}

  SqlCondition whole() {
    if (peek().kind == Token::Kind::end)
      fail(query_, 0, "wants a condition, such as speed > 1mm/s");
    SqlCondition condition = disjunction();
    if (peek().kind == Token::Kind::close) fail(query_, peek().at, "there is no ( for this )");
    if (peek().kind != Token::Kind::end) fail(query_, peek().at, "wants and, or, or the end");
    return condition;
  }

 private:
  const Token& peek() const { return tokens_[next_]; }
  Token take() { return tokens_[next_++]; }
  bool take_word(const char* word) {
    if (peek().kind != Token::Kind::name || peek().text != word) return false;
    ++next_;
    return true;
  }

  SqlCondition disjunction() {
    // "or" binds less than "and", as everywhere.
    SqlCondition left = conjunction();
    while (take_word("or")) left = joined(std::move(left), " OR ", conjunction());
    return left;
  }

  SqlCondition conjunction() {
    SqlCondition left = negation();
    while (take_word("and")) left = joined(std::move(left), " AND ", negation());
    return left;
  }

  SqlCondition negation() {
    // A bound, so that a text of nothing but "not (" cannot end the program's stack.
    constexpr int kDeepest = 100;
    if (++depth_ > kDeepest) fail(query_, peek().at, "is nested too deeply");
    SqlCondition condition;
    if (take_word("not")) {
      condition = negation();
      condition.sql = "NOT (" + condition.sql + ")";
    } else if (peek().kind == Token::Kind::open) {
      const std::size_t at = take().at;
      condition = disjunction();
      if (peek().kind != Token::Kind::close) fail(query_, at, "this ( is not closed");
      take();
    } else {
      condition = comparison();
    }
    --depth_;
    return condition;
  }

  SqlCondition comparison() {
    const Token name = take();
    if (name.kind != Token::Kind::name || is_keyword(name.text))
      fail(query_, name.at,
           name.kind == Token::Kind::end ? "a condition is missing" : "wants a name");
    const QueryName meant = named(name);
    if (peek().kind != Token::Kind::operation) return has(meant);
    const std::string operation = take().text;
    const Token value = take();
    if (value.kind != Token::Kind::number && value.kind != Token::Kind::text)
      fail(query_, value.at, "wants a value");
    return meant.field.empty() ? compare_value(meant, operation, value)
                               : compare_field(meant.field, operation, value);
  }

  QueryName named(const Token& name) const {
    try {
      return query_name(name.text, known_, "");
    } catch (const ConfigError& problem) {
      fail(query_, name.at, problem.what());
    }
  }

  /// A name alone: the run has such a value; of a field, that it is not empty.
  static SqlCondition has(const QueryName& meant) {
    if (!meant.field.empty()) return {"coalesce(" + meant.field + ", '') != ''", {}};
    // By a list of runs and not by a join: a run with two values of one name is listed once.
    return {
        "id IN (SELECT run FROM all_value WHERE " + kind_condition(meant.kind) + " AND name = ?)",
        {meant.name}};
  }

  SqlCondition compare_field(const std::string& field, const std::string& operation,
                             const Token& value) const {
    if (operation == "~" || field == "words") {
      if (operation != "~" && operation != "=") fail(query_, value.at, "text: is searched by ~");
      // instr() and not LIKE: % and _ in what was typed are letters like others.
      return {"instr(lower(" + field + "), lower(?)) > 0", {value.text}};
    }
    // "2026-11" compares months: as much of the time as was typed.
    if (field == "time")
      return {fmt::format("substr(time, 1, {}) {} ?", value.text.size(), operation), {value.text}};
    const bool ordered = operation != "=" && operation != "!=";
    if (field == "version") {
      const auto number = parse_quantity(value.text);
      if (!number || !number->bare) fail(query_, value.at, "version: wants a number");
      return {"version " + operation + " ?", {number->value}};
    }
    // Texts have no order that a person would mean.
    if (ordered) fail(query_, value.at, "is a text: compare it by =, != or ~");
    // As protocols are called: a part of the path will do.
    if (field == "protocol" || field == "rig") {
      const char* const word = operation == "=" ? "" : "NOT ";
      return {fmt::format("{}({} = ? OR {} LIKE '%/' || ? || '.lua' OR {} = ? || '.lua')", word,
                          field, field, field),
              {value.text, value.text, value.text}};
    }
    return {field + " " + operation + " ?", {value.text}};
  }

  /// A run without the value is in none of the inner lists, so that no comparison holds for it, !=
  /// among them.
  SqlCondition compare_value(const QueryName& meant, const std::string& operation,
                             const Token& value) const {
    const std::string from = "id IN (SELECT run FROM all_value WHERE " +
                             kind_condition(meant.kind) + " AND name = ? AND ";
    if (operation == "~")
      return {from + "instr(lower(text), lower(?)) > 0)", {meant.name, value.text}};
    // One name may be a number in some runs and a text in others, over the versions of a protocol.
    const std::vector<KnownValue> kinds = known_.find(meant.name, meant.kind);
    const bool texts =
        std::any_of(kinds.begin(), kinds.end(), [](const KnownValue& one) { return one.text; });
    const bool equal = operation == "=" || operation == "!=";
    // A flag is a number, 1 or 0, with the text true or false.
    const bool flag = value.text == "true" || value.text == "false";
    // Runs may have texts and numbers under one name: a value of another dimension than the numbers
    // is compared with the texts.
    const bool word = value.kind == Token::Kind::text || !fits(kinds, value);
    if (equal && (flag || (texts && word)))
      return {from + "text " + operation + " ?)", {meant.name, value.text}};
    // In SI, as the index has its numbers; the dimension decides which of them are compared.
    const Quantity quantity = quantity_of(meant, kinds, value);
    // A comparison for equality of what was typed: 0.3mm/s is not to the bit what another parser
    // made of it.
    if (equal)
      return {from + "unit = ? AND abs(number - ?) " + (operation == "=" ? "<=" : ">") +
                  " 1e-9 * abs(?))",
              {meant.name, quantity.dimension, quantity.value, quantity.value}};
    // The unit is compared as well: another protocol may have another quantity under this name.
    return {from + "unit = ? AND number " + operation + " ?)",
            {meant.name, quantity.dimension, quantity.value}};
  }

  static bool fits(const std::vector<KnownValue>& kinds, const Token& value) {
    const auto quantity = parse_quantity(value.text);
    return quantity && std::any_of(kinds.begin(), kinds.end(), [&](const KnownValue& one) {
             return !one.text && one.unit == quantity->dimension;
           });
  }

  /// Of the dimension that runs have under that name.
  Quantity quantity_of(const QueryName& meant, const std::vector<KnownValue>& kinds,
                       const Token& value) const {
    std::set<std::string> units;
    // Runs may have several dimensions under one name; the first one is named in the error.
    for (const KnownValue& one : kinds)
      if (!one.text) units.insert(one.unit);
    if (units.empty()) fail(query_, value.at, meant.name + " is a text: compare it by =, != or ~");
    const auto quantity = parse_quantity(value.text);
    const std::string wanted = quantity_name(*units.begin());
    if (!quantity)
      fail(query_, value.at,
           fmt::format("{}: wants {}; '{}' is no number with a unit that is known", meant.name,
                       wanted, value.text));
    if (units.contains(quantity->dimension)) return *quantity;
    if (quantity->bare)
      fail(query_, value.at,
           fmt::format("{}: wants {}; {} has no unit: write {}{}", meant.name, wanted, value.text,
                       value.text, *units.begin()));
    fail(query_, value.at,
         fmt::format("{}: wants {}; {} is {}", meant.name, wanted, value.text,
                     quantity_name(quantity->dimension)));
  }

  const std::string& query_;
  const Vocabulary& known_;
  const std::vector<Token> tokens_;
  std::size_t next_ = 0;
  int depth_ = 0;
};

}  // namespace

// All kinds are named, not left out: only so a comparison of numbers is looked up in the index,
// which has the kind before the number.
std::string kind_condition(char kind) {
  return kind == 0 ? "kind IN ('p', 'r', 't', 's')" : fmt::format("kind = '{}'", kind);
}

QueryName query_name(const std::string& word, const Vocabulary& known, const std::string& at) {
  // A field hides a value of the same name, which p.NAME and its kin still reach.
  for (const auto& [name, column] : kFields)
    if (word == name) return {column, 0, word};
  QueryName meant{"", 0, word};
  for (const auto& [prefix, kind] : kPrefixes)
    if (word.starts_with(prefix)) {
      meant.kind = kind;
      meant.name = word.substr(std::string_view(prefix).size());
    }
  if (!known.find(meant.name, meant.kind).empty()) return meant;
  // A tag may have a dot in its key.
  if (meant.kind != 0 && !known.find(word, 0).empty()) return {"", 0, word};
  std::vector<std::string> names = known.names();
  for (const auto& field : kFields) names.emplace_back(field.first);
  const std::string near = nearest(meant.name, names);
  throw ConfigError(at + word +
                    ": no run has a parameter, result, tag or sample field of that name" +
                    (near.empty() ? "" : "; did you mean " + near + "?"));
}

SqlCondition translate_query(const std::string& text, const Vocabulary& known) {
  return Parser(text, known).whole();
}

}  // namespace vitreo
