// SPDX-License-Identifier: Apache-2.0
#include "jade/sweep/task.h"

#include "support/catch.h"

#include "fixture.h"
#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/folder_lock.h"
#include "jade/core/log.h"
#include "support/naming.h"

using namespace jade;
using namespace jade::test;
using sweep::RunState;

namespace {

/// A folder with the settings of good/a/0 and of bad/a/0, which diverges.
struct Prepared {
  TempDir dir;
  sweep::SweepOutput output{dir / "out"};
  sweep::TaskOptions options;
  Prepared() {
    set_log_level("off");
    options.program = fake_trainer(dir);
    options.device = "cpu";
    output.write_settings(
        plan_of(dir,
                "columns: [psnr]\nscenes: [{name: a, config: a.yaml}]\nrows: [{name: good}, {name: "
                "bad, set: [train.mode=diverge]}, {name: killed, set: [train.mode=die]}]\n"),
        resolve);
  }
};

}  // namespace

TEST_CASE("run_task: one run to its end, once", "[sweep]") {
  const Prepared sweep;
  CHECK(sweep::run_task(sweep.output, "good/a/0", sweep.options) == ExitCode::kOk);
  CHECK(sweep.output.state("good/a/0") == RunState::kFinished);
  const std::string journal = read_file(sweep.dir / "journal");
  CHECK(sweep::run_task(sweep.output, "good/a/0", sweep.options) == ExitCode::kOk);
  CHECK(read_file(sweep.dir / "journal") == journal);
}

TEST_CASE("run_task: a diverged run keeps its exit code and is not started again", "[sweep]") {
  Prepared sweep;
  CHECK(sweep::run_task(sweep.output, "bad/a/0", sweep.options) == ExitCode::kNumeric);
  CHECK(sweep::run_task(sweep.output, "bad/a/0", sweep.options) == ExitCode::kNumeric);
  CHECK(sweep.output.outcome("bad/a/0").attempts == 1);
  sweep.options.retry_failed = true;
  CHECK(sweep::run_task(sweep.output, "bad/a/0", sweep.options) == ExitCode::kNumeric);
  CHECK(sweep.output.outcome("bad/a/0").attempts == 2);
}

TEST_CASE("run_task: the reason is of this attempt, not of one before it in the log", "[sweep]") {
  const Prepared sweep;
  sweep.output.write_outcome("killed/a/0", {});
  write_file(sweep.output.log_file("killed/a/0"), "error: the folder is empty\n");
  sweep::run_task(sweep.output, "killed/a/0", sweep.options);
  const sweep::Outcome outcome = sweep.output.outcome("killed/a/0");
  CHECK(outcome.signal == 9);
  CHECK(outcome.reason.empty());
}

TEST_CASE("run_task: the time of attempts that left no checkpoint does not count", "[sweep]") {
  const Prepared sweep;
  sweep::Outcome failed;
  failed.attempts = 1;
  failed.exit_code = 3;
  failed.seconds = 1000;
  for (const char* id : {"good/a/0", "killed/a/0"}) sweep.output.write_outcome(id, failed);
  sweep::run_task(sweep.output, "good/a/0", sweep.options);
  CHECK(sweep.output.outcome("good/a/0").attempts == 2);
  CHECK(sweep.output.outcome("good/a/0").seconds < 1000);
  sweep.dir.write("out/runs/killed/a/0/checkpoints/step_1.pt", "");
  sweep::run_task(sweep.output, "killed/a/0", sweep.options);
  CHECK(sweep.output.outcome("killed/a/0").seconds > 1000);
}

TEST_CASE("run_task: a run that is none, and one that another process trains", "[sweep]") {
  const Prepared sweep;
  CHECK_THROWS_NAMING(ConfigError, sweep::run_task(sweep.output, "none/a/0", sweep.options),
                      "--run-task none/a/0");
  std::filesystem::create_directories(sweep.output.run_folder("good/a/0"));
  const auto lock = FolderLock::take(sweep.output.run_folder("good/a/0"));
  CHECK_THROWS_AS(sweep::run_task(sweep.output, "good/a/0", sweep.options), DataError);
}
