// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "jade/splat/render.h"

namespace jade::test {

/// render() as plain tensor operations in float64 on the CPU: every Gaussian on every pixel,
/// O(N·H·W) memory, differentiable by autograd. Shares no code with the op. Parameters must be
/// usable; statistics and `rejected` stay undefined.
splat::RenderOutput dense_render(const splat::Gaussians& gaussians,
                                 const splat::CameraBatch& cameras,
                                 const splat::RenderOptions& options);

}  // namespace jade::test
