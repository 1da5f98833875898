// SPDX-License-Identifier: Apache-2.0
#include "jade/restore/restored_exposure.h"

#include "support/catch.h"

#include <torch/types.h>

#include "support/stub_restorer.h"
#include "support/temp_dir.h"

namespace jade::restore {
namespace {

constexpr int kWidth = 10, kHeight = 8;

/// A frame of 0.1 to 0.9 whose brightness rises for a while in one half and falls in the other.
data::Exposure exposure_with_events() {
  data::Exposure exposure;
  exposure.blurry = torch::linspace(0.1, 0.9, 3 * kHeight * kWidth).view({3, kHeight, kWidth});
  exposure.t_start_us = 1000;
  exposure.t_end_us = 9000;
  exposure.camera.width = kWidth;
  exposure.camera.height = kHeight;
  std::vector<float> x, y;
  std::vector<int64_t> t;
  std::vector<int8_t> p;
  for (int i = 0; i < 400; ++i) {
    x.push_back(static_cast<float>(i * 7 % kWidth));
    y.push_back(static_cast<float>(i * 3 % kHeight));
    t.push_back(500 + 25 * i);  // beyond both ends
    p.push_back(x.back() < kWidth / 2 ? 1 : -1);
  }
  exposure.events = events::EventStream::from_lists(x, y, t, p);
  return exposure;
}

TEST_CASE("restore_exposure: EDI blurred again is the frame, whatever the sensor's offset",
          "[restore]") {
  const data::Exposure exposure = exposure_with_events();
  ViewRestorer restorer({false, {}, 1}, std::nullopt, torch::kCPU);
  for (const double offset : {0.0, 0.05}) {
    const RestoredExposure found = restore_exposure(exposure, {}, restorer, offset);
    const torch::Tensor again = (found.restorations.edi + offset) * found.kernel.blur - offset;
    CHECK(torch::allclose(again, exposure.blurry));
    CHECK_FALSE(torch::allclose(found.restorations.edi, exposure.blurry));
    CHECK_FALSE(found.restorations.efnet.defined());
  }
}

TEST_CASE("restore_exposure: only events of the exposure count, and the voxel is the network's",
          "[restore]") {
  const test::TempDir dir;
  const data::Exposure exposure = exposure_with_events();
  const EfnetOptions adds_events{
      test::save_restorer(dir / "n.pt", "  return 0.5 * image + 0.1 * mask\n"), ""};
  ViewRestorer restorer({false, {}, 1}, adds_events, torch::kCPU);
  const RestoredExposure found = restore_exposure(exposure, {}, restorer);
  CHECK(found.maps.density.sum().item<double>() == 320);  // one each 25 µs of 8000
  CHECK(found.restorations.efnet.equal(
      restorer.network().restore(exposure.blurry, found.maps.voxel.values)));
  CHECK_FALSE(torch::allclose(found.restorations.efnet, exposure.blurry * 0.5));
}

TEST_CASE("restore_exposure: a second start finds both restorations; another offset is another EDI",
          "[restore]") {
  const test::TempDir dir;
  const data::Exposure exposure = exposure_with_events();
  const EfnetOptions halves{test::save_restorer(dir / "n.pt", "  return image * 0.5\n"), ""};
  const auto hits = [&](double offset) {
    ViewRestorer restorer({true, dir / "cache", 2048}, halves, torch::kCPU);
    restore_exposure(exposure, {}, restorer, offset);
    return restorer.cache().hits();
  };
  CHECK(hits(0) == 0);
  CHECK(hits(0) == 2);
  CHECK(hits(0.05) == 1);
  CHECK(hits(0.05) == 2);
}

}  // namespace
}  // namespace jade::restore
