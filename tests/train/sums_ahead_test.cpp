// SPDX-License-Identifier: Apache-2.0
#include "jade/train/sums_ahead.h"

#include "support/catch.h"

#include <torch/types.h>

#include "support/tiny_run.h"

namespace jade::train {
namespace {

TEST_CASE("sums ahead: each exposure's in its turn, on threads or not", "[train]") {
  test::TinyDatasetOptions tiny;
  tiny.exposures = 7;
  const test::TinyScene scene(tiny);
  const data::Dataset dataset = data::load_dataset(test::tiny_options(scene).dataset);
  const restore::RestoreOptions options;
  const restore::RestorerMetadata network;
  for (const std::launch policy : {std::launch::async, std::launch::deferred}) {
    SumsAhead sums(dataset, options, &network, policy);
    torch::Tensor before;
    for (const data::Exposure& exposure : dataset.train) {
      const restore::ExposureSums found = sums.next();
      const restore::ExposureSums expected =
          restore::sum_events(exposure, dataset.events, options, &network);
      CHECK(found.maps.density.equal(expected.maps.density));
      CHECK(found.windows.equal(expected.windows));
      CHECK(found.network.equal(expected.network));
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
  SumsAhead sums(dataset, options, nullptr, std::launch::async);
  CHECK(sums.next().maps.density.defined());
  CHECK_THROWS(sums.next());
}

}  // namespace
}  // namespace jade::train
