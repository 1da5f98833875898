// SPDX-License-Identifier: Apache-2.0
#include "jade/run/stage_times.h"

#include "support/catch.h"

#include <chrono>
#include <thread>

using namespace jade;

namespace {

void pass(int milliseconds) {
  std::this_thread::sleep_for(std::chrono::milliseconds(milliseconds));
}

}  // namespace

TEST_CASE("stage_times: every moment belongs to one stage, and a repeated stage accumulates",
          "[run]") {
  const auto begin = std::chrono::steady_clock::now();
  run::StageTimes times;
  pass(60);
  times.end("data");
  times.end("nothing");
  pass(10);
  times.end("steps");
  pass(70);
  times.end("data");
  const double all =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  REQUIRE(times.seconds().size() == 3);
  CHECK(times.seconds()[0].first == "data");
  CHECK(times.seconds()[0].second >= 0.13);
  CHECK(times.seconds()[2].first == "steps");
  CHECK(times.seconds()[2].second >= 0.01);
  double sum = 0;
  for (const auto& entry : times.seconds()) sum += entry.second;
  CHECK(sum <= all);
  CHECK(sum >= 0.14);
  CHECK_THAT(times.text(), Catch::StartsWith("data 0.") && Catch::EndsWith(" s in all"));
  CHECK_THAT(times.text(), !Catch::Contains("nothing"));
  // The current stage counts.
  pass(30);
  CHECK(times.without("data") >= 0.04);
  CHECK(times.without("data") <= times.without("none") - 0.13);
}

TEST_CASE("stage_times: before anything has ended", "[run]") {
  CHECK(run::StageTimes().text() == "0.0 s in all");
}
