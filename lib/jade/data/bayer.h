// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <torch/types.h>

#include "jade/data/warnings.h"

namespace jade::data {

/// The channel (0 red, 1 green, 2 blue) that the RGGB filter of colour event sensors passes at a
/// raw pixel: red at even rows and even columns.
constexpr int64_t filter_channel(int64_t row, int64_t column) { return row % 2 + column % 2; }

/// Computes the colour of the events at each rectified pixel, for a sensor with this filter. Raw
/// pixel (row i, column j) maps to (map_x[i,j], map_y[i,j]) of the rectified image and gives its
/// colour to the nearest pixel; if several map to one pixel, the nearest to its centre wins.
/// @param map_x, map_y  [h,w] of any floating type, in pixels; NaN and places outside are ignored.
/// @return [3,height,width] bool, at most one channel set.
/// @throws ContractError if the maps differ in shape.
torch::Tensor event_color_map(const torch::Tensor& map_x, const torch::Tensor& map_y,
                              int64_t height, int64_t width);

/// Colour map from ev_map.npz with inv_mapx and inv_mapy. Warns of one that leaves a large part of
/// the image without a colour.
/// @throws DataError for arrays of other shapes, and for places of which nearly none is in the
///   image.
torch::Tensor read_event_color_map(const std::filesystem::path& path, int64_t height, int64_t width,
                                   const Warnings& warnings);

/// Writes ev_map.npz: raw pixel (i,j) maps to column map[0,i,j] and row map[1,i,j].
/// @throws DataError.
void write_event_color_map(const std::filesystem::path& path, const torch::Tensor& map);

/// Writes the identity map, for a sensor without distortion.
void write_event_color_map(const std::filesystem::path& path, int64_t height, int64_t width);

}  // namespace jade::data
