// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

namespace jade::apps {

/// Prints the contents of a run directory, its progress and whether its files are intact, as text
/// or JSON on stdout. Does not need the data set.
void inspect_run(const std::filesystem::path& folder, bool json);

}  // namespace jade::apps
