// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

namespace jade {

/// A file that ships with the programs: in share/jade beside the folder of the running program, as
/// installed, else in assets/ of the source tree. Where it is in neither, its place in the latter.
std::filesystem::path asset(const std::string& name);

}  // namespace jade
