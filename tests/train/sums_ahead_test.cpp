// SPDX-License-Identifier: Apache-2.0
#include "jade/train/sums_ahead.h"

#include "support/catch.h"

#include <torch/types.h>

#include "support/tiny_run.h"

namespace jade::train {
namespace {

TEST_CASE("sums ahead: each exposure's in its turn with what is cached, on threads or not",
          "[train]") {
  test::TinyDatasetOptions tiny;
  tiny.exposures = 7;
  const test::TinyScene scene(tiny);
  const data::Dataset dataset = data::load_dataset(test::tiny_options(scene).dataset);
  const train::RunOptions run = test::all_poses_options(scene);
  restore::RestoreOptions options;
  options.times = {0, 0.5, 1};
  const restore::ViewRestorer restorer(run.cache, run.efnet, torch::kCPU);
  const restore::RestorerMetadata& network = restorer.metadata();
  const auto network_input = [&](const data::Exposure& exposure) {
    return restore::sum_events(exposure, dataset.events, options, &network).network;
  };
  const data::Exposure& known = dataset.train[3];
  // Its destructor waits until the entry is written.
  const torch::Tensor restored = restore::ViewRestorer(run.cache, run.efnet, torch::kCPU)
                                     .efnet(known.blurry, network_input(known), options.times);
  for (const std::launch policy : {std::launch::async, std::launch::deferred}) {
    SumsAhead sums(dataset, options, restorer, policy, 0);
    torch::Tensor before;
    for (const data::Exposure& exposure : dataset.train) {
      const restore::ExposureSums found = sums.next();
      const restore::ExposureSums expected =
          restore::sum_events(exposure, dataset.events, options, &network);
      CHECK(found.maps.density.equal(expected.maps.density));
      CHECK(found.windows.equal(expected.windows));
      CHECK(found.network.equal(expected.network));
      CHECK(found.kept.images.defined() == (&exposure == &known));
      if (found.kept.images.defined()) CHECK(found.kept.images.equal(restored));
      CHECK_FALSE((before.defined() && before.equal(found.maps.density)));
      before = found.maps.density;
    }
  }
}

TEST_CASE("sums ahead: what one throws is reported in its turn, and leaving early ends them",
          "[train]") {
  test::TinyDatasetOptions tiny;
  tiny.exposures = 6;
  const test::TinyScene scene(tiny);
  data::Dataset dataset = data::load_dataset(test::tiny_options(scene).dataset);
  dataset.train[1].camera.width = 0;
  const restore::RestoreOptions options;
  const restore::ViewRestorer no_network({false, {}, 1}, std::nullopt, torch::kCPU);
  SumsAhead sums(dataset, options, no_network, std::launch::async, 0);
  CHECK(sums.next().maps.density.defined());
  CHECK_THROWS(sums.next());
}

}  // namespace
}  // namespace jade::train
