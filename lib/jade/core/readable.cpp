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

std::string readable(double number, int digits) {
  constexpr double kWhole = 1e16;  // fits an int64
  const double size = std::abs(number);
  if (size < kWhole && (size >= std::pow(10, digits - 1) || number == std::round(number)))
    return grouped(std::llround(number));
  char text[40];
  std::snprintf(text, sizeof text, "%.*g", digits, number);
  std::string out = text;
  const size_t exponent = out.find("e-0");
  if (exponent != std::string::npos) out.erase(exponent + 2, 1);
  const size_t point = out.find('.');
  if (size >= 1000 && out.find('e') == std::string::npos)
    out.replace(0, point, grouped(std::stoll(out.substr(0, point))));
  return out;
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
