// SPDX-License-Identifier: Apache-2.0
#include "support/catch.h"

#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "jade/run/trainer.h"
#include "support/tiny_run.h"

using namespace jade;

namespace {

/// Losses of the ten steps of a run, all terms of which act within these steps.
std::vector<double> ten_losses(train::RunOptions options) {
  const test::TinyScene scene;
  options.device = "cpu";
  options.dataset.path = scene.data;
  options.cache.enabled = false;
  options.init.points = 300;
  options.train.iterations = options.train.calendar = 10;
  options.train.log_every = 1;
  options.train.evaluate_every = options.train.picture_every = 0;
  const auto run = scene.dir / "run";
  run::Trainer(options, run, "").run();
  std::vector<double> losses;
  std::ifstream metrics(run / "metrics.jsonl");
  for (std::string line; std::getline(metrics, line);) {
    const auto row = nlohmann::json::parse(line);
    if (row.contains("loss")) losses.push_back(row["loss"].get<double>());
  }
  return losses;
}

/// Other threads and instruction sets moved these losses by at most 1e-5.
constexpr double kRounding = 1e-4;

void check_losses(const std::vector<double>& found, const std::vector<double>& recorded) {
  std::string text;
  for (const double loss : found) text += std::to_string(loss) + ", ";
  INFO(text);
  REQUIRE(found.size() == recorded.size());
  for (size_t i = 0; i < found.size(); ++i)
    CHECK(found[i] == Approx(recorded[i]).epsilon(kRounding));
}

}  // namespace

TEST_CASE("trainer: ten losses of the method as printed are those on record", "[run]") {
  const std::vector<double> recorded{1.444101, 1.586122, 1.693518, 1.878415, 1.829906,
                                     1.932977, 1.805541, 1.846371, 1.851709, 1.851078};
  check_losses(ten_losses(train::printed_options()), recorded);
  // The weights of single terms show.
  train::RunOptions other = train::printed_options();
  other.objective.target_weight = 0.99;
  CHECK(ten_losses(other).back() != Approx(recorded.back()).epsilon(kRounding));
}

TEST_CASE("trainer: ten losses of the recommended preset are those on record", "[run]") {
  check_losses(ten_losses({}), {1.539961, 1.494045, 0.887351, 1.141786, 0.980320, 0.889205,
                                0.847186, 0.842883, 0.705545, 0.715455});
}
