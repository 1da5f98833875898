// SPDX-License-Identifier: Apache-2.0
// Memory of the exposures' constants: the training device holds as many as fit, the CPU the rest,
// from which a step fetches what it reads.
#pragma once

#include <cstdint>
#include <torch/types.h>
#include <vector>

#include "jade/train/view.h"

namespace jade::train {

/// Most bytes of a GPU that frames, EDI factors and restorations of all views take: of 1280x720 in
/// colour the frames of some 60 exposures.
constexpr int64_t kMostConstantBytes = int64_t{2} << 30;

/// Puts on the device what it holds in `most_bytes`, each kind for all views or none: the frames
/// with their window means of SSIM, masks and targets, then the EDI factors, then F at the restored
/// poses. Frames that a router reads are put there in any case.
void place_constants(const RunOptions& options, torch::Device device, int64_t most_bytes,
                     std::vector<View>& views);

/// The tensor on the device, in float32. Does not wait for the device: a copy from the CPU goes
/// through page-locked memory.
torch::Tensor fetched(const torch::Tensor& tensor, torch::Device device);

/// The view with its frame, window means, mask and target on the device. Does not wait for it.
View with_frame(View view, torch::Device device);

/// The tensor on a device. One image that stands for all moments stays one.
torch::Tensor moved(const torch::Tensor& moments, torch::Device device);

}  // namespace jade::train
