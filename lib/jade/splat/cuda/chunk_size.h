// SPDX-License-Identifier: Apache-2.0
// How many Gaussians of a view make a chunk, a block's share of the way to the tiles' lists.
#pragma once

#include "jade/splat/cuda/layout.h"

namespace jade::splat::cuda {

/// At most kMostChunkGaussians, and so many that the current device's multiprocessors all have the
/// same number of chunks to do; 0 where chunks do not pay: in a view of many tiles a chunk's
/// instances of a tile would be few.
int chunk_gaussians(const RenderCall& call);

/// For tests: a fixed number, 0 for no chunks, or −1 for the usual ones.
void set_chunk_gaussians_for_test(int gaussians);

}  // namespace jade::splat::cuda
