// SPDX-License-Identifier: Apache-2.0
// Counts the members of an aggregate, so that a list of them can be checked against the struct at
// compile time: adding a member to only one of them does not compile.
#pragma once

#include <cstddef>
#include <type_traits>
#include <utility>

namespace jade {
namespace detail {

/// Converts to any type; for unevaluated code only.
struct AnyValue {
  template <class T>
  operator T() const;  // NOLINT(google-explicit-constructor)
};

template <class Struct, class Indices, class = void>
struct TakesValues : std::false_type {};

template <class Struct, size_t... I>
struct TakesValues<Struct, std::index_sequence<I...>,
                   std::void_t<decltype(Struct{(static_cast<void>(I), AnyValue{})...})>>
    : std::true_type {};

template <class Struct, size_t Count>
constexpr size_t most_values() {
  if constexpr (Count == 0 || TakesValues<Struct, std::make_index_sequence<Count>>::value) {
    return Count;
  } else {
    return most_values<Struct, Count - 1>();
  }
}

}  // namespace detail

/// For aggregates of up to 32 members, none of them a C array.
template <class Struct>
constexpr size_t member_count() {
  static_assert(std::is_aggregate_v<Struct>, "members of an aggregate can be counted");
  return detail::most_values<Struct, 32>();
}

}  // namespace jade
