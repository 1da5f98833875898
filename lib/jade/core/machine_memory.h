// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

namespace jade {

/// Bytes of memory available to this process: the machine's, or less if a control group (version 1
/// or 2) of the process or a parent of that group sets a limit.
/// @param root  parent of /proc and /sys; tests pass a folder of their own
double machine_memory(const std::filesystem::path& root = "/");

}  // namespace jade
