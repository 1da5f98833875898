// SPDX-License-Identifier: Apache-2.0
// Python scripts of this project that the programs run.
#pragma once

#include <filesystem>
#include <string>

namespace jade::recording {

/// Path of an installed script (core/asset.h).
std::filesystem::path script(const std::string& name);

/// The interpreter with their packages: the given one, $JADE_PYTHON, the project's own, python3.
std::string interpreter(const std::filesystem::path& given);

}  // namespace jade::recording
