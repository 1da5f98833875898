// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

namespace jade {

/// Bytes of memory that this process may have: the machine's, or less where a control group of the
/// process (version 1 or 2) or one above it has a limit.
/// @param root  where /proc and /sys lie; tests put their own in
double machine_memory(const std::filesystem::path& root = "/");

}  // namespace jade
