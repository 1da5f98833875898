// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

namespace jade {

/// A file that ships with the programs, by its path in the source tree ("configs/base.yaml"). The
/// first that exists of: share/jade beside the folder of the running program, where an installation
/// has it and where a build folder links to its source tree; the folder $JADE_DATA. Where neither
/// has it, its place in the first, for the caller's message. No path is compiled in, so programs
/// can be moved together with their share/jade.
std::filesystem::path asset(const std::string& name);

}  // namespace jade
