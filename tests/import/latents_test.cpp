// SPDX-License-Identifier: Apache-2.0
#include "jade/import/latents.h"

#include "support/catch.h"

#include <torch/types.h>

#include "support/stub_restorer.h"
#include "support/temp_dir.h"

using namespace jade;

namespace {

/// One exposure of 8 ms with brightening events in its second half.
import::Capture brightening_capture(){import::Capture capture;
capture.shots.push_back({"a", torch::full({3, 8, 10}, 0.4), 0, 8000, 9});
std::vector<float> x, y;
std::vector<int64_t> t;
for (int64_t i = 0; i < 80; ++i) {
  x.push_back(static_cast<float>(i % 10));
  y.push_back(static_cast<float>(i / 10));
  t.push_back(5000 + 30 * i);
}
capture.events = events::EventStream::from_lists(x, y, t, std::vector<int8_t>(80, 1));
capture.camera = geometry::Intrinsics::centred(10, 10, 8);
return capture;
}  // namespace

torch::Tensor latents(const std::filesystem::path& network, import::LatentKind kind) {
  import::ImportOptions options;
  options.latents.kind = kind;
  options.events.threshold_positive = 0.3;
  restore::ViewRestorer restorer({false, {}, 1}, restore::EfnetOptions{network}, torch::kCPU);
  const import::Capture capture = brightening_capture();
  return import::latents_of(capture.shots.front(), capture, options, restorer);
}

}  // namespace

TEST_CASE("latents: the mean is of both restorations at each moment where the restorer knows them",
          "[import]") {
  const test::TempDir dir;
  const auto any = test::save_any_time_restorer(
      dir / "any.pt", "  return 0 * image + 0.2 + 0.4 * time.view(-1, 1, 1, 1)\n");
  const auto middle = test::save_restorer(dir / "middle.pt", "  return 0 * image + 0.4\n");
  const torch::Tensor edi = latents(any, import::LatentKind::kEdi);
  CHECK(edi[2].mean().item<double>() > 1.1 * edi[0].mean().item<double>());
  CHECK(edi.equal(latents(middle, import::LatentKind::kEdi)));
  const torch::Tensor restored = torch::tensor({0.2f, 0.4f, 0.6f}).view({3, 1, 1, 1});
  CHECK(torch::allclose(latents(any, import::LatentKind::kMean), 0.5 * (edi + restored), 0, 3e-4));
  // EDI transforms the result of a restorer of the middle to the ends.
  const torch::Tensor carried = latents(middle, import::LatentKind::kMean);
  CHECK(torch::allclose(carried, 0.5 * (edi[1] + 0.4) * (edi / edi[1])));
  CHECK_FALSE(torch::allclose(carried, 0.5 * (edi + restored)));
}

TEST_CASE("latents: a blurry frame without events is one image, of its middle", "[import]") {
  const test::TempDir dir;
  import::Capture capture = brightening_capture();
  capture.shots.push_back({"lost", capture.shots[0].image, 20000, 28000, -1});
  import::ImportOptions options;
  options.device = "cpu";
  const auto images = import::write_latents(dir.path(), capture, options);
  REQUIRE(images.size() == 4);
  CHECK(images[3].shot == 1);
  CHECK(images[3].t_us == 24000);
}
