// SPDX-License-Identifier: Apache-2.0
#include "jade/data/llff.h"

#include <cmath>
#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/io/npy.h"

namespace jade::data {
namespace {

constexpr int64_t kRow = 17;

double determinant_of(const geometry::Matrix3& m) {
  return m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) +
         m[2] * (m[3] * m[7] - m[4] * m[6]);
}

geometry::Pose pose_of_row(const double* row, const std::string& where) {
  geometry::Pose world_from_camera;
  for (int axis = 0; axis < 3; ++axis) {
    const double* line = row + 5 * axis;
    world_from_camera.rotation[3 * axis + 0] = line[1];
    world_from_camera.rotation[3 * axis + 1] = line[0];
    world_from_camera.rotation[3 * axis + 2] = -line[2];
    world_from_camera.translation[axis] = line[3];
  }
  if (determinant_of(world_from_camera.rotation) < 0) {
    throw DataError(concat(where,
                           ": its 3x3 part is a reflection; the columns must be down, right, "
                           "backwards as in LLFF"));
  }
  try {
    world_from_camera.rotation = geometry::nearest_rotation(world_from_camera.rotation);
  } catch (const ContractError&) {
    throw DataError(concat(where,
                           ": its 3x3 part is no rotation; write the poses again in LLFF "
                           "form, with columns down, right, backwards"));
  }
  return geometry::inverse(world_from_camera);
}

}  // namespace

std::vector<LlffView> parse_llff(const torch::Tensor& rows, const std::string& name) {
  if (rows.dim() != 2 || rows.size(1) != kRow) {
    throw DataError(concat(name, ": expected LLFF rows of shape [N, 17], found ", rows.sizes(),
                           "; a row is the 3x5 matrix [R|t|hwf] and the near and far depth"));
  }
  const torch::Tensor values = rows.to(torch::kFloat64).contiguous();
  const double* row = values.data_ptr<double>();
  std::vector<LlffView> views(static_cast<size_t>(values.size(0)));
  for (size_t i = 0; i < views.size(); ++i, row += kRow) {
    const std::string where = concat(name, ": row ", i);
    for (int64_t column = 0; column < kRow; ++column) {
      if (!std::isfinite(row[column])) {
        throw DataError(
            concat(where, " column ", column, " is ", row[column], "; export the poses again"));
      }
    }
    views[i] = {pose_of_row(row, where), row[4], row[9], row[14], row[15], row[16]};
  }
  return views;
}

std::vector<LlffView> read_llff(const std::filesystem::path& path) {
  return parse_llff(io::read_npy(path), path.string());
}

torch::Tensor llff_rows(const std::vector<LlffView>& views) {
  torch::Tensor rows = torch::empty({int64_t(views.size()), kRow}, torch::kFloat64);
  double* row = rows.data_ptr<double>();
  for (const LlffView& view : views) {
    const geometry::Pose pose = geometry::inverse(view.camera_from_world);
    const double hwf[3] = {view.height, view.width, view.focal_px};
    for (int axis = 0; axis < 3; ++axis) {
      row[5 * axis + 0] = pose.rotation[3 * axis + 1];
      row[5 * axis + 1] = pose.rotation[3 * axis + 0];
      row[5 * axis + 2] = -pose.rotation[3 * axis + 2];
      row[5 * axis + 3] = pose.translation[axis];
      row[5 * axis + 4] = hwf[axis];
    }
    row[15] = view.near;
    row[16] = view.far;
    row += kRow;
  }
  return rows;
}

}  // namespace jade::data
