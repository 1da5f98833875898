// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

namespace jade {

/// Folder for data that can be recomputed: $JADE_CACHE, else $XDG_CACHE_HOME/jade, else
/// ~/.cache/jade. Does not create it.
std::filesystem::path cache_folder();

}  // namespace jade
