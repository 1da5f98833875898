// SPDX-License-Identifier: Apache-2.0
// The scripts of this project that the programs run.
#pragma once

#include <filesystem>
#include <string>

namespace jade::recording {

/// A script by its name, as it ships (core/asset.h).
std::filesystem::path script(const std::string& name);

/// The interpreter that has their packages: the one given, $JADE_PYTHON, the project's own,
/// python3.
std::string interpreter(const std::filesystem::path& given);

}  // namespace jade::recording
