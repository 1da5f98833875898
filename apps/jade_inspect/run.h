// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

namespace jade::apps {

/// What a run directory holds, how far it came, whether its files are whole, as text or JSON on
/// stdout. Its data set is not needed.
void inspect_run(const std::filesystem::path& folder, bool json);

}  // namespace jade::apps
