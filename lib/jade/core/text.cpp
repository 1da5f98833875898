// SPDX-License-Identifier: Apache-2.0
#include "jade/core/text.h"

#include <algorithm>

#include "jade/core/error.h"

namespace jade {

std::string in_small_letters(std::string text) {
  for (char& c : text) {
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  }
  return text;
}

bool has_ending(std::string_view text, std::string_view ending) {
  return text.size() >= ending.size() && text.substr(text.size() - ending.size()) == ending;
}

std::string padded(size_t index, size_t count) {
  const std::string number = std::to_string(index);
  return std::string(std::to_string(count - 1).size() - number.size(), '0') + number;
}

std::string listing(const std::vector<std::string>& names, size_t most) {
  std::string text;
  const size_t shown = std::min(names.size(), most);
  for (size_t i = 0; i < shown; ++i) text += (i == 0 ? "" : ", ") + names[i];
  if (names.size() > shown) text += concat(" and ", names.size() - shown, " more");
  return text;
}

}  // namespace jade
