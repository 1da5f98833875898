// SPDX-License-Identifier: Apache-2.0
#include "jade/restore/methods.h"

#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/restore/restorations.h"

namespace jade::restore {
namespace {

torch::Tensor mean_of(const Candidates& c) {
  return fuse(torch::full({1}, 0.5F, c.edi.options()), {c.edi, c.efnet});
}

}  // namespace

torch::Tensor edi_is_better(const Candidates& c) {
  const auto error = [&](const torch::Tensor& image) {
    return (image.clamp(0, 1) - c.truth).square().sum(0, true);
  };
  return error(c.edi) < error(c.efnet);
}

const std::vector<Method>& methods() {
  static const std::vector<Method> all = {
      {"edi", "event double integral", false, false, false,
       [](const Candidates& c) { return c.edi; }},
      {"efnet", "the learned restorer", true, false, false,
       [](const Candidates& c) { return c.efnet; }},
      {"mean", "half EDI, half EFNet", true, false, false, mean_of},
      {"oracle", "the better of both at each pixel, by the sharp truth", true, true, false,
       [](const Candidates& c) { return torch::where(edi_is_better(c), c.edi, c.efnet); }},
      {"router", "the mix that the router of a trained run (--run) decides", true, false, true,
       [](const Candidates& c) {
         return fuse(c.alpha, {c.edi, c.efnet});
       }}};
  return all;
}

const Method& find_method(const std::string& name) {
  std::string known;
  for (const Method& method : methods()) {
    if (method.name == name) return method;
    known += (known.empty() ? "" : ", ") + method.name;
  }
  throw ConfigError(concat("--method: expected one of ", known, ", found '", name, "'"));
}

}  // namespace jade::restore
