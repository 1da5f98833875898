// SPDX-License-Identifier: Apache-2.0
// The words of an enum: the configuration's name for each value. They are declared once, beside the
// enum, in a function that argument-dependent lookup finds:
//
//   enum class Strategy { kAdc, kNone };
//   constexpr auto words_of(Strategy) {
//     return std::array{Word{"adc", Strategy::kAdc, "clone, split and prune"},
//                       Word{"none", Strategy::kNone, "fixed number"}};
//   }
#pragma once

#include <array>
#include <optional>
#include <string>

namespace jade {

template <class E>
struct Word {
  const char* word;
  E value;
  const char* help = "";      ///< empty if the word needs no explanation
  const char* old_word = "";  ///< name in older files: read with a warning, never printed
};
template <class E>
Word(const char*, E, const char* = "", const char* = "") -> Word<E>;

/// The word of a value.
template <class E>
const char* word_of(E value) {
  for (const Word<E>& each : words_of(value)) {
    if (each.value == value) return each.word;
  }
  return "?";
}

/// The value of a word; no value for an unknown word.
template <class E>
std::optional<E> value_of(const std::string& word) {
  for (const Word<E>& each : words_of(E{})) {
    if (each.word == word) return each.value;
  }
  return std::nullopt;
}

}  // namespace jade
