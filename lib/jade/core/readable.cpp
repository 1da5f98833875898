// SPDX-License-Identifier: Apache-2.0
#include "jade/core/readable.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace jade {

std::string grouped(int64_t number) {
  std::string text = std::to_string(number);
  const auto digits_from = static_cast<std::ptrdiff_t>(number < 0 ? 1 : 0);
  for (auto at = static_cast<std::ptrdiff_t>(text.size()) - 3; at > digits_from; at -= 3) {
    text.insert(static_cast<size_t>(at), ",");
  }
  return text;
}

std::string about_time(double seconds) {
  char text[40];
  if (seconds < 90) {
    std::snprintf(text, sizeof text, "about %d s", static_cast<int>(std::ceil(seconds)));
  } else if (seconds < 90 * 60) {
    std::snprintf(text, sizeof text, "about %d min", static_cast<int>(std::lround(seconds / 60)));
  } else {
    std::snprintf(text, sizeof text, "about %.1f h", seconds / 3600);
  }
  return text;
}

}  // namespace jade
