// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <torch/types.h>
#include <vector>

namespace jade::imaging {

/// Faults of images that cannot be right, one line each: a wrong range (all of them black, or all
/// 16-bit ones use 10 or 12 bits only), images that are all black or all white, and some that are
/// equal to the one before. Values up to 1/255 count as black, from 254/255 as white.
/// @param images  [3,H,W] each, from read_image(), in the order of a camera
/// @param names   of the images, for the messages
std::vector<std::string> frame_faults(const std::vector<torch::Tensor>& images,
                                      const std::vector<std::string>& names);

/// The fault of a wrong range alone; empty if there is none.
/// @param images  as above, or of any shape: some pixels of each, if its brightest is among them
std::string range_fault(const std::vector<torch::Tensor>& images,
                        const std::vector<std::string>& names);

/// True for a gray frame that is the raw mosaic of a colour sensor: the four places of its 2 x 2
/// cells differ in mean brightness, two on a diagonal (the greens) less than the others.
/// @param frame  [3,H,W]; false if it is in colour
bool is_mosaic(const torch::Tensor& frame);

}  // namespace jade::imaging
