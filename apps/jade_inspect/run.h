// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

namespace jade::apps {

/// Prints the contents of a run directory, its progress and whether its files are intact, as text
/// or JSON on stdout. Does not need the data set.
/// @param train_program  the command of jade_train
void inspect_run(const std::filesystem::path& folder, const std::string& train_program, bool json);

}  // namespace jade::apps
