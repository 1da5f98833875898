// SPDX-License-Identifier: Apache-2.0
#include "jade/eval/folders.h"

#include "support/catch.h"

#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/imaging/image_io.h"
#include "support/temp_dir.h"

namespace jade::eval {
namespace {

TEST_CASE("compare_folders: pairs by name, and each name in the truth must be there", "[eval]") {
  const test::TempDir dir;
  const Lpips lpips(torch::kCPU);
  const torch::Tensor image = torch::rand({3, 16, 20});
  imaging::write_image(dir / "truth/a.png", image);
  imaging::write_image(dir / "renders/a.png", (image + 0.1));
  imaging::write_image(dir / "renders/b.png", image);
  const Evaluation evaluation = compare_folders(dir / "renders", dir / "truth", lpips);
  REQUIRE(evaluation.views.size() == 1);
  CHECK(evaluation.views[0].name == "a");
  CHECK(evaluation.mean.psnr < 25);
  imaging::write_image(dir / "truth/b.png", torch::rand({3, 16, 21}));
  CHECK_THROWS_WITH(compare_folders(dir / "renders", dir / "truth", lpips),
                    Catch::Contains("expected 21x16"));
  imaging::write_image(dir / "truth/c.png", image);
  CHECK_THROWS_AS(compare_folders(dir / "renders", dir / "truth", lpips), DataError);
}

}  // namespace
}  // namespace jade::eval
