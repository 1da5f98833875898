// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <torch/types.h>

#include "jade/geometry/pose.h"
#include "jade/splat/gaussians.h"

namespace jade::gaussians {

/// Gaussians as stored in a file.
struct GaussianFile {
  splat::Gaussians gaussians;  ///< float32 on the CPU; K from the file's SH degree
  bool antialiased = false;    ///< header comment "SplatRenderMode: mip"; default is "default"
  /// Origin of the means in the coordinates of the data set (geometry/origin.h); in a file the
  /// header comment "origin X Y Z".
  geometry::Vector3 origin{0, 0, 0};
};

/// Coordinates in which write_ply() writes Gaussians.
enum class PlyCoordinates { kOwn, kDataset };

/// Coloured points.
struct PointCloud {
  torch::Tensor points;               ///< [P,3] float32, world
  torch::Tensor colors;               ///< [P,3] float32 in [0,1]
  geometry::Vector3 origin{0, 0, 0};  ///< as GaussianFile::origin
};

/// Reads a .ply with the 3DGS attributes: x y z, f_dc_0..2, f_rest_0.. (channel-major: all of red,
/// then green, then blue), opacity (logit), scale_0..2 (log), rot_0..3 (wxyz). Binary little- or
/// big-endian or ascii, properties in any order, floats for all but x y z and rot; other properties
/// and elements are skipped. Means far from the origin are moved to an origin near them, in double.
/// SH degree 0 to 3 from the number of f_rest properties. An infinite opacity, as converters from
/// byte formats write it, becomes the finite one that is 1 or 0 in float32. Applies Mip-Splatting's
/// filter_3D.
/// @throws DataError naming the path for files that are no such .ply, are truncated, or claim more
///   vertices than they have bytes for.
GaussianFile read_ply(const std::filesystem::path& path);

/// Checks that a scene has at least one Gaussian at a finite position.
/// @throws DataError naming the file if it has none.
void check_some(const splat::Gaussians& gaussians, const std::filesystem::path& path);

/// Writes binary little-endian float32 with the attributes above plus nx ny nz (zero), which other
/// viewers expect. Reading it back gives the same bits. Accepts any float dtype and device.
/// @param coordinates  for a file with an origin: kOwn writes the means unchanged, with the origin
///   in a comment; kDataset adds the origin and writes x y z as double, because float32 is too
///   coarse
void write_ply(const std::filesystem::path& path, const GaussianFile& file,
               PlyCoordinates coordinates = PlyCoordinates::kOwn);

/// Reads x y z and red green blue (uchar, ushort, or float in [0,1]; floats up to 255 or 65535 are
/// divided by that, with a warning; gray 0.5 if there is no colour).
/// @throws DataError as read_ply.
PointCloud read_point_cloud(const std::filesystem::path& path);

/// True if the .ply's vertices have Gaussian attributes, false if they are plain points.
/// @throws DataError as read_ply.
bool has_gaussians(const std::filesystem::path& path);

}  // namespace jade::gaussians
