// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <torch/types.h>
#include <vector>

namespace jade::restore {

/// All images of one exposure at its middle, each [3,H,W]; undefined if not requested.
struct Candidates {
  torch::Tensor blurry, edi, efnet;
  torch::Tensor alpha;  ///< [1,H,W], the router's weight of EDI
  torch::Tensor truth;  ///< the sharp frame
};

/// A restoration method. To add one, add an entry to methods().
struct Method {
  std::string name;
  std::string help;
  bool needs_efnet, needs_truth, needs_run;
  torch::Tensor (*restore)(const Candidates&);
};

const std::vector<Method>& methods();

/// @throws ConfigError listing the methods.
const Method& find_method(const std::string& name);

/// [1,H,W] bool: true where EDI is nearer to the truth than EFNet, by the squared error over
/// channels of the images clamped to [0,1].
torch::Tensor edi_is_better(const Candidates& candidates);

}  // namespace jade::restore
