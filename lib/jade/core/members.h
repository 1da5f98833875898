// SPDX-License-Identifier: Apache-2.0
// How many members an aggregate has, so that a list of them can be held against the struct: a
// member that is added to the one and not to the other does not compile.
#pragma once

#include <cstddef>
#include <type_traits>
#include <utility>

namespace jade {
namespace detail {

/// Stands for a value of any type, in unevaluated code only.
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
