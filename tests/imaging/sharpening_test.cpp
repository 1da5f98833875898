// SPDX-License-Identifier: Apache-2.0
// EDI and the reblur operator against a simulated exposure, whose sharp frames are known.
#include "support/catch.h"

#include <cmath>
#include <torch/types.h>

#include "jade/core/progress.h"
#include "jade/events/exposure_maps.h"
#include "jade/geometry/trajectory.h"
#include "jade/imaging/edi.h"
#include "jade/imaging/reblur.h"
#include "jade/simulate/sensor.h"
#include "jade/simulate/simulator.h"
#include "support/drifting_pattern.h"
#include "support/exposure_model.h"

using namespace jade;
using namespace jade::imaging;
using namespace jade::test;

namespace {

constexpr double kThreshold = 0.05;

/// One exposure of 100 ms by noiseless sensors while a pattern drifts by 8 px.
struct Filmed {
  torch::Tensor blurry;               ///< [3,H,W]
  std::vector<torch::Tensor> latent;  ///< the true sharp frames at the nine times
  events::ExposureMaps maps;

  const torch::Tensor& sharp() const { return latent[geometry::kMidPose]; }
  torch::Tensor windows() const {
    return events::edi_windows({maps.windows.positive.clone(), maps.windows.negative.clone()},
                               {kThreshold, kThreshold});
  }
};

const Filmed& filmed() {
  static const Filmed exposure = [] {
    set_progress_enabled(false);
    simulate::SimulateRun run;
    run.simulate.exposures = 1, run.simulate.exposure_ms = 100;
    run.simulate.test_views = 0, run.simulate.seen_test_views = 0;
    run.simulate.events.threshold_positive = run.simulate.events.threshold_negative = kThreshold;
    test::DriftingPattern pattern(64, 48, 80, 1000);
    const auto content = simulate::simulate(run, pattern).content;
    const auto& seen = content.train.front();
    Filmed out{seen.blurry, {}, {}};
    for (const double t_us : geometry::exposure_times(seen.t_start_us, seen.t_end_us)) {
      world::SharpFrame frame;
      pattern.frame(static_cast<int64_t>(std::llround(t_us)), 1, frame);
      out.latent.push_back(simulate::to_image(frame));
    }
    out.maps = events::map_exposure(content.events, {seen.t_start_us, seen.t_end_us}, 6, {48, 64});
    return out;
  }();
  return exposure;
}

double psnr(const torch::Tensor& a, const torch::Tensor& b) {
  return -10 * std::log10((a - b).square().mean().item<double>());
}

}  // namespace

TEST_CASE("edi: a blurry exposure gains more than 10 dB at all nine times", "[imaging]") {
  const Filmed& f = filmed();
  const EdiKernel kernel = edi_kernel(f.windows());
  for (int64_t k = 0; k < geometry::kExposurePoses; ++k) {
    const auto& truth = f.latent[static_cast<size_t>(k)];
    INFO("pose " << k << ": " << psnr(f.blurry, truth) << " dB");
    CHECK(psnr(edi_at(f.blurry, kernel, k), truth) > psnr(f.blurry, truth) + 10);
  }
}

TEST_CASE("edi: events of the wrong sign make an exposure worse than its blur", "[imaging]") {
  const Filmed& f = filmed();
  CHECK(psnr(edi_at(f.blurry, edi_kernel(-f.windows()), geometry::kMidPose), f.sharp()) <
        psnr(f.blurry, f.sharp()) - 3);
}

TEST_CASE("reblur: K of Eq. (7) with c = Θ v_max makes the true sharp frame the blurry one",
          "[imaging]") {
  const Filmed& f = filmed();
  const double calibrated = kThreshold * f.maps.voxel.v_max;
  const auto fit = [&](double contrast) {
    return psnr(reblur(f.sharp(), f.maps.voxel, contrast), f.blurry);
  };
  const double best = fit(calibrated);
  CHECK(best > fit(0) + 10);  // the unchanged sharp frame
  for (const double wrong : {0.5 * calibrated, 2 * calibrated, 1.0, -calibrated}) {
    INFO("c = " << wrong << " where " << calibrated << " is right");
    CHECK(best > fit(wrong) + 4);
  }
}

TEST_CASE("reblur: its inverse with c = Θ v_max sharpens the blurry frame", "[imaging]") {
  const Filmed& f = filmed();
  const double calibrated = kThreshold * f.maps.voxel.v_max;
  const auto gain = [&](double contrast) {
    return psnr(unblur(f.blurry, f.maps.voxel, contrast), f.sharp()) - psnr(f.blurry, f.sharp());
  };
  CHECK(gain(calibrated) > 10);
  CHECK(gain(-calibrated) < -3);
  for (const double wrong : {0.5 * calibrated, 2 * calibrated, 1.0}) {
    INFO("c = " << wrong << " where " << calibrated << " is right");
    CHECK(gain(calibrated) > gain(wrong) + 4);
  }
}
