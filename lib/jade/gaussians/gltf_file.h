// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

#include "jade/gaussians/ply.h"

namespace jade::gaussians {

/// Writes binary glTF 2.0 with the extension KHR_gaussian_splatting of Khronos, float32 throughout:
/// scales, opacities and unit quaternions (xyzw) as they act, SH as they are. Positions are turned
/// from our axes to those of glTF (x right, y up, z back). Gaussians with a number that is not
/// finite are left out.
/// @throws DataError naming the path.
void write_glb(const std::filesystem::path& path, const GaussianFile& file);

/// Reads the Gaussians of all nodes of the scene of a .glb or .gltf, whose buffers are in the file
/// or beside it, moved as their nodes say and turned to our axes. SH beyond degree 3 are left out.
/// @throws DataError naming the path for damaged files, files without Gaussians, nodes that shear
///   or stretch, and what the extension leaves to others: compression, other kernels.
GaussianFile read_gltf(const std::filesystem::path& path);

}  // namespace jade::gaussians
