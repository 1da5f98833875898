// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "jade/gaussians/ply.h"

namespace jade::gaussians {

/// Writes binary glTF 2.0 with Khronos' extension KHR_gaussian_splatting, all float32: activated
/// scales and opacities, unit quaternions (xyzw), and SH coefficients unchanged. Positions are
/// rotated from this library's axes to those of glTF (x right, y up, z back). Gaussians with a
/// number that is not finite are omitted.
/// @throws DataError naming the path.
void write_glb(const std::filesystem::path& path, const GaussianFile& file);

/// Reads the Gaussians of all nodes of the scene of a .glb or .gltf, whose buffers are in the file
/// or beside it, transformed by their nodes and rotated to this library's axes. Omits SH beyond
/// degree 3. Adds a line to `notes` for a few scales below 0 or opacities outside [0,1], and for
/// copies (EXT_mesh_gpu_instancing) and animations, which are not read.
/// @throws DataError naming the path for damaged files, files without Gaussians, nodes that shear
///   or stretch, many such scales or opacities, and parts that the extension does not specify:
///   compression, other kernels.
GaussianFile read_gltf(const std::filesystem::path& path, std::vector<std::string>& notes);

}  // namespace jade::gaussians
