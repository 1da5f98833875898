// SPDX-License-Identifier: Apache-2.0
#include "jade/sweep/output.h"

#include "support/catch.h"

#include "fixture.h"
#include "jade/core/error.h"
#include "jade/core/folder_lock.h"
#include "jade/sweep/task.h"

using namespace jade;
using namespace jade::test;
using sweep::RunState;

namespace {

const std::string kOneRun =
    "columns: [psnr]\nscenes: [{name: a, config: a.yaml}]\nrows: [{name: full}]\n";

sweep::Outcome ended(int code) {
  sweep::Outcome outcome;
  outcome.attempts = 1;
  outcome.exit_code = code;
  return outcome;
}

}  // namespace

TEST_CASE("SweepOutput: the state of a run follows from what lies there", "[sweep]") {
  const TempDir dir;
  const sweep::SweepOutput output(dir / "out");
  const std::string id = "full/a/0";
  CHECK(output.state(id) == RunState::kNew);
  output.write_outcome(id, ended(-1));
  CHECK(output.state(id) == RunState::kUnfinished);
  output.write_outcome(id, ended(130));
  CHECK(output.state(id) == RunState::kUnfinished);
  output.write_outcome(id, ended(5));
  CHECK(output.state(id) == RunState::kFailed);
  CHECK_FALSE(sweep::wants_attempt(output, id, false));
  CHECK(sweep::wants_attempt(output, id, true));
  output.write_outcome(id, ended(4));
  CHECK(sweep::wants_attempt(output, id, false));
  dir.write("out/runs/full/a/0/point_cloud.ply", "");
  CHECK(output.state(id) == RunState::kFailed);
  dir.write("out/runs/full/a/0/eval.json", "{}");
  CHECK(output.state(id) == RunState::kFinished);
  CHECK_FALSE(sweep::wants_attempt(output, id, true));
  {
    const auto lock = FolderLock::take(output.run_folder(id));
    CHECK(output.state(id) == RunState::kRunning);
  }
  CHECK(output.present() == std::vector<std::string>{id});
}

TEST_CASE("SweepOutput: settings of a run that was started are not changed", "[sweep]") {
  const TempDir dir;
  const sweep::SweepOutput output(dir / "out");
  output.write_settings(plan_of(dir, kOneRun), resolve);
  sweep::PlanOptions changed;
  changed.overrides = {"train.rate=0.75", "train.iterations=11"};
  // No run has started yet.
  CHECK_NOTHROW(output.write_settings(plan_of(dir, kOneRun, changed), resolve));
  output.write_outcome("full/a/0", ended(130));
  dir.write("out/runs/full/a/0/checkpoints/step_1.pt", "");
  CHECK_NOTHROW(output.write_settings(plan_of(dir, kOneRun, changed), resolve));
  changed.overrides.push_back("device=cuda:3");
  CHECK_NOTHROW(output.write_settings(plan_of(dir, kOneRun, changed), resolve));
  CHECK_THROWS_WITH(
      output.write_settings(plan_of(dir, kOneRun), resolve),
      Catch::Contains("full/a/0: train.iterations: 11 -> 10; train.rate: 0.75 -> 0.5"));
}

TEST_CASE("SweepOutput: settings of a run that failed without a checkpoint can be corrected",
          "[sweep]") {
  const TempDir dir;
  const sweep::SweepOutput output(dir / "out");
  const std::string id = "full/a/0";
  output.write_settings(plan_of(dir, kOneRun), resolve);
  output.write_outcome(id, ended(5));
  dir.write("out/runs/full/a/0/metrics.jsonl", "");
  output.write_settings(plan_of(dir, kOneRun), resolve);
  CHECK_FALSE(sweep::wants_attempt(output, id, false));
  sweep::PlanOptions changed;
  changed.overrides = {"train.rate=0.75"};
  CHECK_NOTHROW(output.write_settings(plan_of(dir, kOneRun, changed), resolve));
  CHECK(sweep::wants_attempt(output, id, false));
  const auto lock = FolderLock::take(output.run_folder(id));
  CHECK_THROWS_AS(output.check_settings(plan_of(dir, kOneRun), resolve), ConfigError);
}

TEST_CASE("SweepOutput: an outcome with strange bytes in it survives", "[sweep]") {
  const TempDir dir;
  const sweep::SweepOutput output(dir / "out");
  sweep::Outcome outcome = ended(3);
  outcome.reason = "bad \xff byte";
  outcome.seconds = 1.5;
  output.write_outcome("r/s/0", outcome);
  CHECK(output.outcome("r/s/0").exit_code == 3);
  CHECK(output.outcome("r/s/0").seconds == 1.5);
  dir.write("out/tasks/r/s/0.json", "{ cut");
  CHECK_THROWS_AS(output.outcome("r/s/0"), DataError);
}
