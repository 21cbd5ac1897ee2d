// What tools/mutate.py puts in place of operators: each knows its alternatives, and the one whose
// id stands in the environment variable MUTANT acts.
#pragma once
#include <stdint.h>
#include <stdlib.h>

namespace mut {

inline int active() {
  static const int id = getenv("MUTANT") ? atoi(getenv("MUTANT")) : -1;
  return id;
}
inline bool is(int id) { return active() == id; }

#define DARANTI_MUTANT_2(name, op, op0, op1)                       \
  template <typename A, typename B>                                \
  inline auto name(int id, A a, B b) -> decltype(a op b) {         \
    if (is(id)) return static_cast<decltype(a op b)>(a op0 b);     \
    if (is(id + 1)) return static_cast<decltype(a op b)>(a op1 b); \
    return a op b;                                                 \
  }
DARANTI_MUTANT_2(lt, <, <=, >=)
DARANTI_MUTANT_2(gt, >, >=, <=)
DARANTI_MUTANT_2(le, <=, <, >)
DARANTI_MUTANT_2(ge, >=, >, <)

#define DARANTI_MUTANT_1(name, op, op0)                        \
  template <typename A, typename B>                            \
  inline auto name(int id, A a, B b) -> decltype(a op b) {     \
    if (is(id)) return static_cast<decltype(a op b)>(a op0 b); \
    return a op b;                                             \
  }
DARANTI_MUTANT_1(eq, ==, !=)
DARANTI_MUTANT_1(ne, !=, ==)
DARANTI_MUTANT_1(add, +, -)
DARANTI_MUTANT_1(sub, -, +)
DARANTI_MUTANT_1(mul, *, +)
DARANTI_MUTANT_1(div, /, *)
DARANTI_MUTANT_1(mod, %, +)
DARANTI_MUTANT_1(shl, <<, >>)
DARANTI_MUTANT_1(shr, >>, <<)
DARANTI_MUTANT_1(band, &, |)
DARANTI_MUTANT_1(bor, |, &)
DARANTI_MUTANT_1(bxor, ^, |)

template <typename L, typename R>
inline bool land(int id, L left, R right) {
  return is(id) ? left() || right() : is(id + 1) ? left() : left() && right();
}
template <typename L, typename R>
inline bool lor(int id, L left, R right) {
  return is(id) ? left() && right() : is(id + 1) ? left() : left() || right();
}
template <typename A, typename B>
inline A &add_to(int id, A &a, B b) {
  return a = static_cast<A>(is(id) ? a - b : a + b);
}
template <typename A, typename B>
inline A &sub_from(int id, A &a, B b) {
  return a = static_cast<A>(is(id) ? a + b : a - b);
}
template <typename A, typename B>
inline A &or_to(int id, A &a, B b) {
  return a = static_cast<A>(is(id) ? a & b : a | b);
}
template <typename A, typename B>
inline A &and_to(int id, A &a, B b) {
  return a = static_cast<A>(is(id) ? a | b : a & b);
}
inline bool lnot(int id, bool a) { return is(id) ? a : !a; }
template <typename A>
inline auto neg(int id, A a) -> decltype(-a) {
  return is(id) ? +a : -a;
}
inline bool cond(int id, bool a) { return is(id) ? !a : a; }
template <typename A>
inline A lit(int id, A a) {
  return is(id) ? static_cast<A>(a + 1) : a;
}

}  // namespace mut
