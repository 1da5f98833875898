// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/summary.h"

#include <algorithm>
#include <cmath>
#include <torch/types.h>
#include <utility>

#include "jade/core/error.h"
#include "jade/gaussians/gaussian_model.h"
#include "jade/splat/math/projection.h"

namespace jade::gaussians {
namespace {

int64_t count_of(const torch::Tensor& mask) { return mask.sum().item<int64_t>(); }

/// [N], whether all numbers of a row are finite.
torch::Tensor finite_rows(const torch::Tensor& tensor) {
  return tensor.reshape({tensor.size(0), -1}).isfinite().all(1);
}

/// A reason for not rendering Gaussians: its text, and [N] whether it applies.
struct Reason {
  std::string words;
  torch::Tensor of;
  const char* mend = "";
};

/// The conditions of is_usable() in splat/math/projection.h.
std::vector<Reason> reasons(const splat::Gaussians& g) {
  std::vector<Reason> out;
  const std::pair<const char*, torch::Tensor> parts[] = {{"means", g.means},
                                                         {"rotations", g.rotations},
                                                         {"log scales", g.log_scales},
                                                         {"opacity logits", g.logit_opacities},
                                                         {"colours", g.sh}};
  for (const auto& [name, tensor] : parts) {
    out.push_back({concat("NaN or Inf in their ", name), finite_rows(tensor).logical_not(),
                   "export from an older checkpoint, or delete them"});
  }
  const auto beyond = [](const torch::Tensor& tensor, double most) {
    const torch::Tensor size = tensor.reshape({tensor.size(0), -1}).abs();
    return (size > most).logical_and(size.isfinite()).any(1);
  };
  out.push_back({concat("means beyond ", splat::math::kMaxAbsMean),
                 beyond(g.means, splat::math::kMaxAbsMean), "delete them"});
  out.push_back({concat("log scales beyond ", splat::math::kMaxAbsLogScale),
                 beyond(g.log_scales, splat::math::kMaxAbsLogScale),
                 "scales are stored as logarithms; write them so, or delete these Gaussians"});
  out.push_back({concat("opacity logits beyond ", splat::math::kMaxAbsLogit),
                 beyond(g.logit_opacities, splat::math::kMaxAbsLogit),
                 "opacities are stored as logits; write them so"});
  const torch::Tensor norm2 = g.rotations.to(torch::kFloat64).square().sum(1);
  out.push_back({"the zero quaternion, or one without bounds, as rotation",
                 (norm2 < splat::math::kMinQuaternion2)
                     .logical_or(norm2 > 1 / splat::math::kMinQuaternion2)
                     .logical_and(norm2.isfinite()),
                 "set it to 1 0 0 0"});
  return out;
}

/// [N], whether a Gaussian can be rendered.
torch::Tensor is_drawable(const splat::Gaussians& gaussians) {
  torch::Tensor lost = torch::zeros({gaussians.size()}, gaussians.means.options().dtype(at::kBool));
  for (const Reason& reason : reasons(gaussians)) lost = lost.logical_or(reason.of);
  return lost.logical_not();
}

void find_problems(const splat::Gaussians& g, GaussianSummary& summary) {
  const auto add = [&](const auto&... parts) { summary.problems.push_back(concat(parts...)); };
  if (summary.count == 0) {
    add("holds no Gaussian: training pruned everything, or the file was cut; check "
        "the poses and thresholds");
    return;
  }
  for (const Reason& reason : reasons(g)) {
    const int64_t bad = count_of(reason.of);
    if (bad == 0) continue;
    add(bad, " of ", summary.count, " Gaussians have ", reason.words, ": they cannot be rendered; ",
        reason.mend);
  }
  if (summary.transparent > 0.5) {
    add("more than half of the Gaussians are next to transparent (opacity below ", kTransparent,
        "): saved just after an opacity reset? train on, or use a later checkpoint");
  }
  const double extent = std::max({summary.x.high - summary.x.low, summary.y.high - summary.y.low,
                                  summary.z.high - summary.z.low});
  if (extent > 0 && summary.scale.high > extent) {
    add("more than 1 % of the Gaussians are larger than the whole scene (", summary.scale.high,
        " of ", extent, " units): a fog of them; check the poses");
  }
  const double reach =
      std::max({std::abs(summary.x.min), std::abs(summary.x.max), std::abs(summary.y.min),
                std::abs(summary.y.max), std::abs(summary.z.min), std::abs(summary.z.max)});
  if (extent > 0 && reach > 1000 * extent) {
    add("some Gaussians lie ", reach,
        " units away, a thousand times the scene's size: floaters; "
        "viewers may frame them instead of the scene, delete them");
  }
}

}  // namespace

Spread spread_of(const torch::Tensor& values) {
  const torch::Tensor flat = values.flatten();
  const torch::Tensor sorted =
      std::get<0>(flat.masked_select(flat.isfinite()).to(torch::kFloat64).sort());
  const int64_t count = sorted.numel();
  if (count == 0) return {};
  const auto at = [&](double share) {
    return sorted[static_cast<int64_t>(std::lround(share * double(count - 1)))].item<double>();
  };
  return {at(0), at(0.01), at(0.5), at(0.99), at(1)};
}

GaussianSummary summarize(const splat::Gaussians& g) {
  GaussianSummary summary;
  summary.count = g.means.size(0);
  summary.sh_degree = std::lround(std::sqrt(double(g.sh.size(1)))) - 1;
  if (summary.count > 0) {
    summary.x = spread_of(g.means.select(1, 0));
    summary.y = spread_of(g.means.select(1, 1));
    summary.z = spread_of(g.means.select(1, 2));
    const torch::Tensor opacity = g.logit_opacities.sigmoid();
    summary.opacity = spread_of(opacity);
    summary.transparent = double(count_of(opacity < kTransparent)) / double(summary.count);
    const torch::Tensor longest = g.log_scales.amax(1);
    summary.scale = spread_of(longest.exp());
    summary.elongation = spread_of((longest - g.log_scales.amin(1)).exp());
  }
  find_problems(g, summary);
  return summary;
}

Bulk bulk_of(const splat::Gaussians& gaussians) {
  Bulk bulk{};
  double squares = 0;
  for (size_t axis = 0; axis < 3; ++axis) {
    const Spread spread = spread_of(gaussians.means.select(1, static_cast<int64_t>(axis)));
    bulk.middle[axis] = 0.5 * (spread.low + spread.high);
    squares += std::pow(0.5 * (spread.high - spread.low), 2);
  }
  bulk.radius = squares > 0 ? std::sqrt(squares) : 1e-3;
  return bulk;
}

double near_plane_of(const splat::Gaussians& gaussians, double usual) {
  return std::min(usual, 0.01 * bulk_of(gaussians).radius);
}

splat::Gaussians drawable(const splat::Gaussians& gaussians) {
  if (gaussians.size() == 0) return gaussians;
  const torch::Tensor visible = is_drawable(gaussians);
  if (visible.all().item<bool>()) return gaussians;
  return map_parameters(gaussians,
                        [&](const torch::Tensor& value) { return value.index({visible}); });
}

std::string undrawable_warning(const splat::Gaussians& gaussians, const std::string& file) {
  if (gaussians.size() == 0) return {};
  const int64_t left = gaussians.size() - count_of(is_drawable(gaussians));
  if (left > 0) {
    return concat(file, ": ", left, " of ", gaussians.size(),
                  " Gaussians have NaN or Inf in their numbers, or numbers beyond all bounds, and "
                  "are not rendered; jade_inspect says in which");
  }
  if (count_visible(gaussians) > 0) return {};
  return concat(file, ": all of ", gaussians.size(),
                " Gaussians have an opacity below 1/255, so that nothing of them shows");
}

std::string undrawable_reasons(const splat::Gaussians& gaussians) {
  std::string out;
  for (const Reason& reason : reasons(gaussians)) {
    const int64_t bad = count_of(reason.of);
    if (bad > 0) out += concat(out.empty() ? "" : ", ", bad, " have ", reason.words);
  }
  return out;
}

int64_t count_visible(const splat::Gaussians& gaussians) {
  return count_of(gaussians.logit_opacities.sigmoid() >= 1.0 / 255);
}

}  // namespace jade::gaussians
