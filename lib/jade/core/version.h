// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace jade {

/// "0.2.0".
std::string version();

/// The git commit of the build, with "+" if files differed from it; "unknown" outside git.
std::string git_commit();

/// "2.11.0", of the LibTorch in use.
std::string torch_version();

/// "13.0", of the CUDA runtime compiled against; "none" in CPU-only builds.
std::string cuda_version();

}  // namespace jade
