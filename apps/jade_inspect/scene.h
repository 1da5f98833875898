// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>

#include "jade/gaussians/summary.h"

namespace jade::apps {

/// Prints a summary of a file of Gaussians, or a .ply of plain points, as text or JSON on stdout.
/// @throws DataError naming the path.
void inspect_scene(const std::filesystem::path& path, bool json);

/// @param antialiased  whether to render them as Mip-Splatting does
void print_text(const gaussians::GaussianSummary& summary, bool antialiased = false);
nlohmann::json to_json(const gaussians::GaussianSummary& summary, bool antialiased = false);

}  // namespace jade::apps
