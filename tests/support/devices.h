// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace jade::test {

/// True if the build has CUDA kernels and a GPU is available.
bool has_gpu();

}  // namespace jade::test
