// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace jade::test {

/// True when the build has CUDA kernels and a GPU answers.
bool has_gpu();

}  // namespace jade::test
