// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <torch/types.h>
#include <vector>

namespace jade::imaging {

/// One line for images whose common range is wrong: all of them black, or 16-bit values that fill
/// 10 or 12 bits only. Empty otherwise.
/// @param images  [3,H,W] each, as read_image() returns them
std::string range_fault(const std::vector<torch::Tensor>& images);

}  // namespace jade::imaging
