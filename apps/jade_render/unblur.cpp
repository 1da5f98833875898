// SPDX-License-Identifier: Apache-2.0
#include "jade_render/unblur.h"

#include <algorithm>

#include "jade/config/config.h"
#include "jade/core/error.h"
#include "jade/core/text.h"
#include "jade/train/exposure_span.h"

namespace jade::apps {
namespace {

std::string joined(const std::vector<std::string>& words) {
  std::string out;
  for (const std::string& word : words) out += (out.empty() ? "" : ", ") + word;
  return out;
}

/// Up to three names similar to the wrong one; without any, the first three.
std::string names_near(const std::string& wrong, std::vector<std::string> names) {
  constexpr size_t kShown = 3;
  const std::vector<std::string> all = names;
  std::vector<std::string> near;
  while (near.size() < kShown) {
    const std::string next = config::nearest(wrong, names);
    if (next.empty()) break;
    near.push_back(next);
    names.erase(std::find(names.begin(), names.end(), next));
  }
  if (!near.empty()) return "near it: " + joined(near);
  const size_t shown = std::min(kShown, all.size());
  return "they are " + joined({all.begin(), all.begin() + static_cast<std::ptrdiff_t>(shown)}) +
         (all.size() > shown ? concat(" … ", all.back()) : "");
}

}  // namespace

const data::Exposure& exposure_named(const data::Dataset& dataset, const std::string& name,
                                     const std::string& flag) {
  std::vector<std::string> names;
  for (const auto* exposures : {&dataset.train, &dataset.held_out}) {
    for (const data::Exposure& exposure : *exposures) {
      if (exposure.name == name) return exposure;
      names.push_back(exposure.name);
    }
  }
  throw ConfigError(concat(flag, ": expected one of the ", names.size(), " exposures of ",
                           dataset.root.string(), ", found '", name, "'; ",
                           names_near(name, names)));
}

Unblurring unblurring_of(const data::Exposure& exposure, const geometry::ExposureOptions& options) {
  if (exposure.duration_us() <= 0) {
    throw ConfigError(
        concat("--unblur: ", exposure.name, " is a sharp image; expected one with an exposure"));
  }
  Unblurring film{exposure.name, exposure.blurry, {}};
  const train::ExposureSpan span = train::span_of(exposure);
  const auto moments = geometry::quadrature(options.quadrature, options.samples);
  for (size_t k = 0; k < moments.u.size(); ++k) {
    film.moments.push_back({concat(exposure.name, "_", padded(k, moments.u.size())),
                            span.at(moments.u[k]), exposure.camera});
  }
  return film;
}

}  // namespace jade::apps
