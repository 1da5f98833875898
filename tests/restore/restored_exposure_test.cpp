// SPDX-License-Identifier: Apache-2.0
#include "jade/restore/restored_exposure.h"

#include "support/catch.h"

#include <torch/types.h>

#include "support/exposure_model.h"
#include "support/stub_restorer.h"
#include "support/temp_dir.h"

namespace jade::restore {
namespace {

/// Rounding of values up to 1 in half precision.
constexpr double kHalfError = 2.5e-4;

constexpr int kFrameWidth = 10, kFrameHeight = 8;

/// A frame of 0.1 to 0.9 whose brightness increases for a while in one half and decreases in the
/// other.
/// @param steady  events at equal time steps, else accelerating
data::Exposure exposure_with_events(bool steady = true) {
  data::Exposure exposure;
  exposure.blurry = torch::linspace(0.1, 0.9, 3 * kFrameHeight * kFrameWidth)
                        .view({3, kFrameHeight, kFrameWidth});
  exposure.t_start_us = 1000;
  exposure.t_end_us = 9000;
  exposure.camera.width = kFrameWidth;
  exposure.camera.height = kFrameHeight;
  std::vector<float> x, y;
  std::vector<int64_t> t;
  std::vector<int8_t> p;
  for (int i = 0; i < 400; ++i) {
    x.push_back(static_cast<float>(i * 7 % kFrameWidth));
    y.push_back(static_cast<float>(i * 3 % kFrameHeight));
    t.push_back(500 + (steady ? 25 * i : 10500 - (400 - i) * (400 - i) / 16));  // beyond both ends
    p.push_back(x.back() < kFrameWidth / 2 ? 1 : -1);
  }
  exposure.events = events::EventStream::from_lists(x, y, t, p);
  return exposure;
}

/// EDI of the exposure at the moments of its integral.
test::EdiKernel kernel_of(const RestoredExposure& found, const RestoreOptions& options = {}) {
  const bool fine = options.events.edi_samples > 0;
  return test::edi_kernel(
      found.windows, fine ? geometry::QuadratureRule::kTrapezoid : options.exposure.quadrature);
}

TEST_CASE("restore_exposure: EDI blurred again is the frame, whatever the sensor's offset",
          "[restore]") {
  const data::Exposure exposure = exposure_with_events();
  ViewRestorer restorer({false, {}, 1}, std::nullopt, torch::kCPU);
  for (const double offset : {0.0, 0.05}) {
    const RestoredExposure found =
        restore_exposure(exposure, exposure.events, {{}, {}, offset}, restorer);
    const torch::Tensor again = (found.restorations.edi + offset) * kernel_of(found).blur - offset;
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
      test::save_restorer(dir / "n.pt", "  return 0.5 * image + 0.1 * mask\n")};
  ViewRestorer restorer({false, {}, 1}, adds_events, torch::kCPU);
  const RestoredExposure found = restore_exposure(exposure, exposure.events, {}, restorer);
  CHECK(found.maps.density.sum().item<double>() == 320);  // one each 25 µs of 8000
  CHECK(found.restorations.efnet.equal(
      restorer.network().restore(exposure.blurry, found.maps.voxel.values)));
  CHECK_FALSE(torch::allclose(found.restorations.efnet, exposure.blurry * 0.5));
}

/// Signed events of equal windows at whole pixels, counted one by one.
torch::Tensor slow_counts(const data::Exposure& exposure, int64_t windows) {
  torch::Tensor counts = torch::zeros({windows, kFrameHeight, kFrameWidth});
  const events::EventStream& all = exposure.events;
  const torch::Tensor x = all.x(), y = all.y(), t = all.t_us(), p = all.polarity();
  for (int64_t i = 0; i < all.size(); ++i) {
    const double place = double(t[i].item<int64_t>() - exposure.t_start_us) /
                         double(exposure.duration_us()) * double(windows);
    if (place < 0 || place >= double(windows)) continue;
    counts[static_cast<int64_t>(place)][y[i].item<int64_t>()][x[i].item<int64_t>()] +=
        p[i].item<int64_t>();
  }
  return counts;
}

TEST_CASE("restore_exposure: a network of any moment gets its own windows' counts, at each moment",
          "[restore]") {
  const test::TempDir dir;
  const data::Exposure exposure = exposure_with_events();
  const EfnetOptions network{test::save_any_time_restorer(
      dir / "n.pt",
      "  return 0.3 + 0.1 * time.view(-1, 1, 1, 1) * image + 0.05 * counts[:, 0:3]\n")};
  ViewRestorer restorer({false, {}, 1}, network, torch::kCPU);
  RestoreOptions options;
  const torch::Tensor events = slow_counts(exposure, 4).narrow(0, 0, 3);
  const auto expected = [&](double time) {
    return (0.3 + 0.1 * time * exposure.blurry + 0.05 * events).clamp(0, 1);
  };
  CHECK(events.abs().sum().item<double>() == 240);
  const RestoredExposure middle = restore_exposure(exposure, exposure.events, options, restorer);
  CHECK_FALSE(middle.efnet_at.defined());
  CHECK(torch::allclose(middle.restorations.efnet, expected(0.5)));
  for (const std::vector<double>& times :
       {std::vector<double>{0, 0.5, 1}, std::vector<double>{0.875, 0.125}}) {
    options.times = times;
    const RestoredExposure found = restore_exposure(exposure, exposure.events, options, restorer);
    REQUIRE(found.efnet_at.size(0) == static_cast<int64_t>(times.size()));
    for (size_t k = 0; k < times.size(); ++k) {
      CHECK(torch::allclose(found.efnet_at[static_cast<int64_t>(k)].to(torch::kFloat32),
                            expected(times[k]), 0, kHalfError));
    }
    CHECK(torch::allclose(found.restorations.efnet, middle.restorations.efnet, 0, kHalfError));
  }
  data::Exposure still = exposure;
  still.events = events::EventStream();
  CHECK(torch::allclose(restore_exposure(still, still.events, options, restorer).restorations.efnet,
                        0.3 + 0.05 * exposure.blurry));
}

TEST_CASE("restore_exposure: a second start finds F, whatever the offset of EDI", "[restore]") {
  const test::TempDir dir;
  const data::Exposure exposure = exposure_with_events();
  const EfnetOptions halves{test::save_restorer(dir / "n.pt", "  return image * 0.5\n")};
  const auto hits = [&](double offset) {
    ViewRestorer restorer({true, dir / "cache", 2048}, halves, torch::kCPU);
    restore_exposure(exposure, exposure.events, {{}, {}, offset}, restorer);
    return restorer.cache().hits();
  };
  CHECK(hits(0) == 0);
  CHECK(hits(0) == 1);
  CHECK(hits(0.05) == 1);
}

TEST_CASE("restore_exposure: every rule, number of samples and integral blurs back to the frame",
          "[restore]") {
  using geometry::QuadratureRule;
  const data::Exposure exposure = exposure_with_events();
  ViewRestorer restorer({false, {}, 1}, std::nullopt, torch::kCPU);
  RestoreOptions options;
  options.events.edi_samples = 0;
  for (const auto rule : {QuadratureRule::kEqual, QuadratureRule::kTrapezoid}) {
    for (const int64_t samples : {5, 9, 17}) {
      options.exposure = {rule, samples};
      const RestoredExposure found = restore_exposure(exposure, exposure.events, options, restorer);
      CHECK(found.gain.size(0) == samples);
      const test::EdiKernel kernel = kernel_of(found, options);
      CHECK(torch::allclose(found.gain, kernel.gain));
      CHECK(torch::allclose(found.restorations.edi * kernel.blur, exposure.blurry));
      const auto weights = torch::tensor(geometry::quadrature(rule, samples).weights);
      const auto mean = torch::einsum("k,khw->hw", {weights, found.gain});
      CHECK(torch::allclose(mean, torch::ones_like(mean)));
    }
  }
  options.exposure = {QuadratureRule::kEqual, 9};
  options.events.edi_samples = 33;
  const RestoredExposure fine = restore_exposure(exposure, exposure.events, options, restorer);
  const test::EdiKernel kernel = kernel_of(fine, options);
  CHECK(kernel.gain.size(0) == 33);
  CHECK(fine.gain.size(0) == 9);
  CHECK(torch::allclose(fine.gain[3], kernel.gain[12]));
  CHECK(torch::allclose(gain_at(fine, options, {0.5, 0.75}),
                        torch::stack({kernel.gain[16], kernel.gain[24]})));
}

TEST_CASE("restore_exposure: ramps read events beyond the exposure and change EDI alone",
          "[restore]") {
  const data::Exposure whole = exposure_with_events(/*steady=*/false);
  data::Exposure exposure = whole;
  exposure.events = whole.events.slice(1000, 9000);
  ViewRestorer restorer({false, {}, 1}, std::nullopt, torch::kCPU);
  RestoreOptions options;
  options.events.ramp_ms = 0;
  const RestoredExposure steps = restore_exposure(exposure, whole.events, options, restorer);
  options.events.ramp_ms = 1;
  const RestoredExposure lines = restore_exposure(exposure, whole.events, options, restorer);
  CHECK(lines.maps.voxel.values.equal(steps.maps.voxel.values));
  CHECK(lines.maps.density.equal(steps.maps.density));
  CHECK_FALSE(lines.restorations.edi.equal(steps.restorations.edi));
  const RestoredExposure alone = restore_exposure(exposure, exposure.events, options, restorer);
  CHECK_FALSE(alone.windows.equal(lines.windows));
}

TEST_CASE("restore_exposure: what teaches has a contrast of its own", "[restore]") {
  const data::Exposure exposure = exposure_with_events();
  ViewRestorer restorer({false, {}, 1}, std::nullopt, torch::kCPU);
  RestoreOptions options;
  const auto found = [&] { return restore_exposure(exposure, exposure.events, options, restorer); };
  const RestoredExposure plain = found();
  CHECK(plain.taught_gain.equal(plain.gain));
  options.taught_contrast = 1.4;
  const RestoredExposure taught = found();
  CHECK(taught.gain.equal(plain.gain));
  CHECK(taught.restorations.edi.equal(plain.restorations.edi));
  options.taught_contrast = 1;
  options.events.threshold_positive = 1.4 * options.events.threshold_positive;
  const RestoredExposure scaled = found();
  CHECK(torch::allclose(taught.taught_gain, scaled.gain, 1e-5));
  CHECK_FALSE(torch::allclose(taught.taught_gain, plain.gain, 1e-3));
}

}  // namespace
}  // namespace jade::restore
