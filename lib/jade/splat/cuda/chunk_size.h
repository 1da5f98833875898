// SPDX-License-Identifier: Apache-2.0
// Number of Gaussians of a view per chunk, a block's work when filling the tiles' lists.
#pragma once

#include "jade/splat/cuda/layout.h"

namespace jade::splat::cuda {

/// At most kMostChunkGaussians, chosen so that all multiprocessors of the current device have the
/// same number of chunks; 0 if chunks do not pay: in a view of many tiles a chunk has few instances
/// per tile.
int chunk_gaussians(const RenderCall& call);

/// For tests: a fixed number, 0 for no chunks, or −1 for the default.
void set_chunk_gaussians_for_test(int gaussians);

}  // namespace jade::splat::cuda
