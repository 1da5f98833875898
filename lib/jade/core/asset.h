// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

namespace jade {

/// Finds a file that ships with the programs by its path in the source tree ("configs/base.yaml").
/// Searches share/jade beside the folder of the running program (installations have it; build
/// folders link it to their source tree), then the folder $JADE_DATA. If neither has the file,
/// returns its path in the first, for the caller's message. No path is compiled in, so programs can
/// be moved together with their share/jade.
std::filesystem::path asset(const std::string& name);

}  // namespace jade
