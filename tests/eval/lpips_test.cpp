// SPDX-License-Identifier: Apache-2.0
#include "jade/eval/lpips.h"

#include "support/catch.h"

#include <torch/types.h>

#include "jade/core/cache_folder.h"
#include "support/temp_dir.h"

using namespace jade;

TEST_CASE("lpips: without its modules, or with a broken one, the metric is absent", "[eval]") {
  const test::TempDir dir;
  dir.write("lpips_vgg.pt", "not a module");
  const eval::Lpips lpips(torch::kCPU, dir.path());
  const auto image = torch::rand({3, 64, 64});
  CHECK_FALSE(lpips.alex01(image, image).has_value());
  CHECK_FALSE(lpips.vgg(image, image).has_value());
  CHECK_THAT(eval::lpips_absent(), Catch::Contains(cache_folder().string()));
}
