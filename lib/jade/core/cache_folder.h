// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

namespace jade {

/// Where this user's programs keep what can be made again: $JADE_CACHE, else $XDG_CACHE_HOME/jade,
/// else ~/.cache/jade. Not made here.
std::filesystem::path cache_folder();

}  // namespace jade
