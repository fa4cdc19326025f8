// Mutants chosen at run time: what the sources that tests/mutation/schemata.py rewrites call. Each
// place has a number; VITREO_MUTANT names the one that is wrong in this process, and
// VITREO_MUTANT_REACHED a file that is made when it is reached.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdlib>
#include <fcntl.h>
#include <type_traits>
#include <unistd.h>
#include <utility>

namespace mutant {

inline int chosen() {
  static const int number = [] {
    const char* const text = std::getenv("VITREO_MUTANT");
    return text == nullptr ? 0 : std::atoi(text);
  }();
  return number;
}

/// Whether this place is the wrong one.
inline bool is(int number) {
  if (number != chosen()) return false;
  static const bool noted = [] {
    const char* const file = std::getenv("VITREO_MUTANT_REACHED");
    const int made = file == nullptr ? -1 : ::open(file, O_CREAT | O_WRONLY | O_CLOEXEC, 0600);
    if (made >= 0) ::close(made);
    return true;
  }();
  return noted;
}

/// Where there is no mutant, because what it would compute has no meaning: says so.
inline void none(int number) {
  if (number != chosen()) return;
  const char* const file = std::getenv("VITREO_MUTANT_NONE");
  const int made = file == nullptr ? -1 : ::open(file, O_CREAT | O_WRONLY | O_CLOEXEC, 0600);
  if (made >= 0) ::close(made);
}

/// By value: an expression of Eigen's refers to its operands, which end with the operator here.
template <class T>
auto plain(const T& value) {
  if constexpr (requires { value.eval(); })
    return value.eval();
  else
    return std::decay_t<T>(value);
}
template <class T>
using Plain = decltype(plain(std::declval<T>()));

/// a < b as (a < Less(n)) > b: the named operator has the precedence of the one that it stands for,
/// so nothing of the operands must be known.
template <class A>
struct Left {
  A value;
  int number;
};
enum class Relation { less, less_equal, greater, greater_equal, equal, unequal };
template <Relation R>
struct Relational {
  int number;
};
template <class A, Relation R>
struct Compared {
  const A& value;
  int number;
};
template <class A, Relation R>
Compared<A, R> operator<(const A& a, Relational<R> which) {
  return {a, which.number};
}
template <class A, Relation R>
Compared<A, R> operator==(const A& a, Relational<R> which) {
  return {a, which.number};
}
template <Relation R, class A, class B>
auto hold(const A& a, const B& b) {
  if constexpr (R == Relation::less) return plain(a < b);
  if constexpr (R == Relation::less_equal) return plain(a <= b);
  if constexpr (R == Relation::greater) return plain(a > b);
  if constexpr (R == Relation::greater_equal) return plain(a >= b);
  if constexpr (R == Relation::equal) return plain(a == b);
  if constexpr (R == Relation::unequal) return plain(a != b);
}
/// The neighbor: the bound itself changes sides; equality is negated.
template <Relation R, class A, class B>
auto wrong(const A& a, const B& b) {
  if constexpr (R == Relation::less) return plain(a <= b);
  if constexpr (R == Relation::less_equal) return plain(a < b);
  if constexpr (R == Relation::greater) return plain(a >= b);
  if constexpr (R == Relation::greater_equal) return plain(a > b);
  if constexpr (R == Relation::equal) return plain(a != b);
  if constexpr (R == Relation::unequal) return plain(a == b);
}
template <class A, Relation R, class B>
auto operator>(Compared<A, R> a, const B& b) {
  return is(a.number) ? wrong<R>(a.value, b) : hold<R>(a.value, b);
}
template <class A, Relation R, class B>
auto operator==(Compared<A, R> a, const B& b) {
  return is(a.number) ? wrong<R>(a.value, b) : hold<R>(a.value, b);
}

/// The sum as a difference and the reverse, a product as a quotient and the reverse; where the
/// other one is of another type, as of two points in time, there is no mutant (none()).
enum class Sum { plus, minus };
enum class Product { times, over };
template <Sum S>
struct Summing {
  int number;
};
template <Product P>
struct Multiplying {
  int number;
};
template <class A, Sum S>
struct Summand {
  A value;
  int number;
};
template <class A, Product P>
struct Factor {
  A value;
  int number;
};
template <class A, Sum S>
auto operator+(A&& a, Summing<S> which) -> Summand<std::decay_t<A>, S> {
  return {std::forward<A>(a), which.number};
}
template <class A, Product P>
Factor<std::decay_t<A>, P> operator*(A&& a, Multiplying<P> which) {
  return {std::forward<A>(a), which.number};
}
template <class A, class B>
auto operator+(Summand<A, Sum::plus> a, const B& b) {
  using Result = Plain<decltype(a.value + b)>;
  if constexpr (requires { Result(a.value - b); }) {
    if (is(a.number)) return Result(a.value - b);
  } else {
    none(a.number);
  }
  return Result(a.value + b);
}
template <class A, class B>
auto operator+(Summand<A, Sum::minus> a, const B& b) {
  using Result = Plain<decltype(a.value - b)>;
  if constexpr (requires { Result(a.value + b); }) {
    if (is(a.number)) return Result(a.value + b);
  } else {
    none(a.number);
  }
  return Result(a.value - b);
}
template <class A, class B>
auto operator*(Factor<A, Product::times> a, const B& b) {
  using Result = Plain<decltype(a.value * b)>;
  if constexpr (requires { Result(a.value / b); }) {
    if (is(a.number)) return Result(a.value / b);
  } else {
    none(a.number);
  }
  return Result(a.value * b);
}
template <class A, class B>
auto operator*(Factor<A, Product::over> a, const B& b) {
  using Result = Plain<decltype(a.value / b)>;
  if constexpr (requires { Result(a.value * b); }) {
    if (is(a.number)) return Result(a.value * b);
  } else {
    none(a.number);
  }
  return Result(a.value / b);
}

/// A number that is twice as large, or 1 instead of 0.
template <class T>
T number(int place, T value) {
  if (!is(place)) return value;
  return value == T{} ? static_cast<T>(1) : static_cast<T>(value * 2);
}

}  // namespace mutant
