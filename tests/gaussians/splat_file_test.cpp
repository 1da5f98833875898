// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/splat_file.h"

#include "support/catch.h"

#include <cmath>
#include <cstring>

#include "file_bytes.h"
#include "jade/core/atomic_file.h"
#include "jade/gaussians/gaussian_model.h"
#include "random_gaussians.h"
#include "support/temp_dir.h"

namespace jade::gaussians {
namespace {

using test::byte_at;
using test::random_gaussians;

TEST_CASE("splat file: records are 32 bytes, the most important Gaussian first", "[gaussians]") {
  const test::TempDir folder;
  splat::Gaussians g = random_gaussians(10, 16);
  g.log_scales[7].fill_(1.0);
  g.logit_opacities[7].fill_(5.0);
  write_splat(folder / "a.splat", g);
  const std::string content = read_file(folder / "a.splat");
  REQUIRE(content.size() == 320);
  float head[6];
  std::memcpy(head, content.data(), sizeof(head));
  CHECK(head[0] == g.means[7][0].item<float>());
  CHECK(head[3] == Approx(std::exp(1.0)));
  CHECK(byte_at(content, 27) == static_cast<int>(std::lround(255 / (1 + std::exp(-5.0)))));
  const double red = 0.28209479177387814 * g.sh[7][0][0].item<double>() + 0.5;
  CHECK(byte_at(content, 24) == Approx(255 * red).margin(0.51));
  const double w = g.rotations[7][0].item<double>() / g.rotations[7].norm().item<double>();
  CHECK(byte_at(content, 28) == Approx(128 + 128 * w).margin(0.51));
}

TEST_CASE("splat file: Gaussians with a number that is not finite are left out", "[gaussians]") {
  const test::TempDir folder;
  splat::Gaussians g = random_gaussians(3, 1);
  splat::Gaussians others = map_parameters(g, [](const torch::Tensor& value) {
    return value.index_select(0, torch::tensor({0, 2}));
  });
  write_splat(folder / "others.splat", others);
  for (int i = 0; i < kParameterCount; ++i) {
    splat::Gaussians spoilt = map_parameters(g, [](const auto& value) { return value.clone(); });
    parameter(spoilt, i)[1].fill_(std::nan(""));
    write_splat(folder / "a.splat", spoilt);
    CHECK(read_file(folder / "a.splat") == read_file(folder / "others.splat"));
  }
}

}  // namespace
}  // namespace jade::gaussians
