// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

namespace jade::apps {

/// True for a folder that jade_train made: it has config.yaml and checkpoints/ or metrics.jsonl.
bool is_run(const std::filesystem::path& folder);

/// What a run directory holds, how far it came, whether its files are whole, as text or JSON on
/// stdout. Its data set is not needed.
void inspect_run(const std::filesystem::path& folder, bool json);

}  // namespace jade::apps
