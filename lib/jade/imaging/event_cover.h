// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <torch/types.h>

#include "jade/events/event_stream.h"

namespace jade::imaging {

/// A one-line fault of a thousand events or more that touch less than 60 % of an image's width or
/// height although the image has detail elsewhere: events of a smaller or cropped sensor. Empty
/// otherwise. A few pixels beyond, such as hot ones, do not count.
/// @param image  [3,H,W], whose pixels the events share
std::string cover_fault(const events::EventStream& events, const torch::Tensor& image);

}  // namespace jade::imaging
