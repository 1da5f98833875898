// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <torch/types.h>
#include <vector>

namespace jade::imaging {

/// A one-line fault of images with a wrong range: all of them black, or 16-bit values that use 10
/// or 12 bits only. Empty otherwise.
/// @param images  [3,H,W] each, from read_image()
std::string range_fault(const std::vector<torch::Tensor>& images);

}  // namespace jade::imaging
