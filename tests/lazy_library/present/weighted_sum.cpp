// A small shared library that is there, and has one of the two functions that its stand-in names.
// SPDX-License-Identifier: Apache-2.0

extern "C" double lazy_weighted_sum(int count, double a, double b, double c, double d, double e,
                                    double f, double g, double h, double on_stack) {
  return count * (a + 2 * b + 3 * c + 4 * d + 5 * e + 6 * f + 7 * g + 8 * h + 9 * on_stack);
}
