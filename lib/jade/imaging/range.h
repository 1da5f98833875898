// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <torch/types.h>
#include <vector>

namespace jade::imaging {

/// A one-line fault of images with a wrong range: all of them black, or all 16-bit ones use 10 or
/// 12 bits only. Empty otherwise.
/// @param images  [3,H,W] each, from read_image()
/// @param names   of the images, for the message
std::string range_fault(const std::vector<torch::Tensor>& images,
                        const std::vector<std::string>& names);

}  // namespace jade::imaging
