// SPDX-License-Identifier: Apache-2.0
#include "jade/sweep/local.h"

#include "support/catch.h"

#include <algorithm>
#include <cstdlib>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <thread>

#include "fixture.h"
#include "jade/core/atomic_file.h"
#include "jade/core/device.h"
#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/core/log.h"
#include "jade/core/progress.h"
#include "jade/sweep/task.h"
#include "support/naming.h"

using namespace jade;
using namespace jade::test;
using sweep::RunState;

namespace {

constexpr int64_t kGiB = int64_t{1} << 30;

std::string sweep_of(const std::string& rows, const std::string& seeds = "[0, 1]") {
  return "columns: [psnr]\nseeds: " + seeds + "\nscenes: [{name: a, config: a.yaml}]\nrows:\n" +
         rows;
}

sweep::MemoryProbe plenty() {
  return {[] { return 1000 * kGiB; }, [](pid_t) { return kGiB; },
          [](const std::string&) { return 1000 * kGiB; },
          [](const std::string&) { return std::map<pid_t, int64_t>(); }};
}

/// Runs a sweep with the fake trainer; returns its journal.
std::string run(const TempDir& dir, const std::string& yaml, int jobs,
                const sweep::MemoryProbe& memory, std::vector<std::string> devices = {"cpu"}) {
  set_progress_enabled(false);
  set_log_level("off");
  const sweep::Plan plan = plan_of(dir, yaml);
  const sweep::SweepOutput output(dir / "out");
  output.write_settings(plan, resolve);
  std::filesystem::remove(dir / "journal");
  sweep::LocalOptions options;
  options.program = fake_trainer(dir);
  options.devices = std::move(devices);
  options.jobs = jobs;
  options.cores = 8;
  options.poll_ms = 20;
  sweep::run_local(plan, output, options, memory);
  return std::filesystem::exists(dir / "journal") ? read_file(dir / "journal") : "";
}

/// Largest number of concurrent runs in a journal.
int most_at_once(const std::string& journal) {
  std::istringstream in(journal);
  int now = 0, most = 0;
  for (std::string line; std::getline(in, line);) {
    now += line.rfind("start", 0) == 0 ? 1 : line.rfind("end", 0) == 0 ? -1 : 0;
    most = std::max(most, now);
  }
  return most;
}

size_t count(const std::string& text, const std::string& word) {
  size_t found = 0;
  for (size_t at = 0; (at = text.find(word, at)) != std::string::npos; at += word.size()) ++found;
  return found;
}

/// Unsets OMP_WAIT_POLICY for the duration of a test.
class WaitPolicy {
 public:
  WaitPolicy() {
    if (const char* value = std::getenv(kName)) before_ = value;
    unsetenv(kName);
  }
  ~WaitPolicy() { before_ ? setenv(kName, before_->c_str(), 1) : unsetenv(kName); }
  WaitPolicy(const WaitPolicy&) = delete;
  WaitPolicy& operator=(const WaitPolicy&) = delete;
  void set(const char* value) const { setenv(kName, value, 1); }

 private:
  static constexpr const char* kName = "OMP_WAIT_POLICY";
  std::optional<std::string> before_;
};

}  // namespace

TEST_CASE("run_local: several at once, with the cores shared out, and nothing twice", "[sweep]") {
  const WaitPolicy waiting;
  const TempDir dir;
  const std::string yaml = sweep_of("  - {name: x}\n  - {name: y}\n");
  const std::string journal = run(dir, yaml, 2, plenty());
  INFO(journal);
  CHECK(count(journal, "end ") == 4);
  CHECK(count(journal, "threads 4 resume no") == 4);
  CHECK(count(journal, "wait unset") == 4);
  CHECK(most_at_once(journal) == 2);
  CHECK(run(dir, yaml, 2, plenty()).empty());
  // Only the new row runs.
  CHECK(count(run(dir, yaml + "  - {name: z}\n", 2, plenty()), "start") == 2);
}

TEST_CASE("run_local: runs are spread over the devices, whose threads do not wait busily",
          "[sweep]") {
  const WaitPolicy waiting;
  const TempDir dir;
  const std::string journal =
      run(dir, sweep_of("  - {name: x}\n  - {name: y}\n"), 2, plenty(), {"cuda:0", "cuda:1"});
  INFO(journal);
  CHECK(count(journal, " cuda:0 ") >= 1);
  CHECK(count(journal, " cuda:1 ") >= 1);
  CHECK(count(journal, "wait passive") == 4);
  waiting.set("active");
  const TempDir other;
  const std::string chosen = run(other, sweep_of("  - {name: x}\n"), 1, plenty(), {"cuda:0"});
  CHECK(count(chosen, "wait active") == 2);
}

TEST_CASE("run_local: never more runs than memory holds", "[sweep]") {
  const TempDir dir;
  sweep::Outcome before;
  before.attempts = 1;
  before.peak_host_bytes = 4 * kGiB;
  sweep::SweepOutput(dir / "out").write_outcome("x/a/0", before);
  sweep::MemoryProbe tight = plenty();
  // 10 GiB are free before the runs start, each takes 4; 1 must stay free.
  tight.host_free = [] { return 10 * kGiB; };
  tight.host_used = [](pid_t) { return int64_t{0}; };
  const std::string journal = run(dir, sweep_of("  - {name: x}\n  - {name: y}\n"), 4, tight);
  INFO(journal);
  CHECK(count(journal, "end ") == 4);
  CHECK(most_at_once(journal) == 2);
}

TEST_CASE("run_local: never more runs than a GPU's memory holds", "[sweep]") {
  const TempDir dir;
  const auto journal_path = dir / "journal";
  sweep::MemoryProbe probe = plenty();
  // 10 GiB in total, each run uses 8: a second one does not fit.
  probe.device_free = [journal_path](const std::string&) {
    const std::string journal =
        std::filesystem::exists(journal_path) ? read_file(journal_path) : "";
    return 10 * kGiB -
           8 * kGiB * static_cast<int64_t>(count(journal, "start") - count(journal, "end"));
  };
  const std::string journal =
      run(dir, sweep_of("  - {name: x}\n  - {name: y}\n"), 4, probe, {"cuda:0"});
  INFO(journal);
  CHECK(count(journal, "end ") == 4);
  CHECK(most_at_once(journal) == 1);
}

TEST_CASE("run_local: a run is charged what it holds of a GPU by itself, where the driver tells",
          "[sweep]") {
  const TempDir dir;
  sweep::MemoryProbe probe = plenty();
  // 100 GiB; a run uses 2, and 90 belong to a process that started later.
  std::set<pid_t> ours;
  probe.host_used = [&ours](pid_t pid) {
    ours.insert(pid);
    return kGiB;
  };
  bool before = true;
  probe.device_free = [&before](const std::string&) {
    const int64_t free = before ? 100 * kGiB : 8 * kGiB;
    before = false;
    return free;
  };
  probe.device_used = [&ours](const std::string&) {
    std::map<pid_t, int64_t> processes{{1, 90 * kGiB}};
    for (const pid_t pid : ours) processes[pid] = 2 * kGiB;
    return processes;
  };
  run(dir, sweep_of("  - {name: x}\n"), 2, probe, {"cuda:0"});
  const sweep::SweepOutput output(dir / "out");
  CHECK(output.outcome("x/a/0").peak_device_bytes == 2 * kGiB);
  CHECK(output.outcome("x/a/1").peak_device_bytes == 2 * kGiB);
}

TEST_CASE("run_local: a failed run is marked and the rest goes on", "[sweep]") {
  const TempDir dir;
  const std::string yaml =
      sweep_of("  - {name: bad, set: [train.mode=diverge]}\n  - {name: good}\n", "[0]");
  const std::string journal = run(dir, yaml, 1, plenty());
  const sweep::SweepOutput output(dir / "out");
  CHECK(count(journal, "end ") == 1);
  CHECK(output.state("good/a/0") == RunState::kFinished);
  CHECK(output.state("bad/a/0") == RunState::kFailed);
  CHECK(sweep::describe(output.outcome("bad/a/0")) ==
        "diverged (exit 5): step 3: loss blur is NaN");
  CHECK(run(dir, yaml, 1, plenty()).empty());
}

TEST_CASE("run_local: a killed run goes on from its checkpoint on the next call", "[sweep]") {
  const TempDir dir;
  const std::string yaml = sweep_of("  - {name: x, set: [train.mode=die]}\n", "[0]");
  CHECK(count(run(dir, yaml, 1, plenty()), "end ") == 0);
  const sweep::SweepOutput output(dir / "out");
  CHECK(output.state("x/a/0") == RunState::kUnfinished);
  CHECK(output.outcome("x/a/0").signal == 9);
  CHECK_THAT(run(dir, yaml, 1, plenty()), Catch::Contains("resume yes"));
  CHECK(output.state("x/a/0") == RunState::kFinished);
  CHECK(output.outcome("x/a/0").attempts == 2);
}

TEST_CASE("run_local: a program that cannot be started is a failed run", "[sweep]") {
  const TempDir dir;
  const sweep::Plan plan = plan_of(dir, sweep_of("  - {name: x}\n", "[0]"));
  const sweep::SweepOutput output(dir / "out");
  output.write_settings(plan, resolve);
  sweep::LocalOptions options;
  options.program = dir / "nothing";
  options.poll_ms = 20;
  sweep::run_local(plan, output, options, plenty());
  CHECK(output.state("x/a/0") == RunState::kFailed);
  CHECK_THAT(output.outcome("x/a/0").reason, test::naming("started"));
}

TEST_CASE("run_local: a request to stop reaches the children, which are waited for", "[sweep]") {
  const TempDir dir;
  std::thread later([&] {
    // After both have started.
    for (int i = 0; i < 200; ++i) {
      if (std::filesystem::exists(dir / "journal") &&
          count(read_file(dir / "journal"), "start") == 2)
        break;
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(300));
    set_interrupt_requested(true);
  });
  const std::string yaml = sweep_of("  - {name: x, set: [train.mode=hang]}\n");
  CHECK_THROWS_AS(run(dir, yaml, 2, plenty()), Interrupted);
  later.join();
  set_interrupt_requested(false);
  const sweep::SweepOutput output(dir / "out");
  CHECK(count(read_file(dir / "journal"), "asked") == 2);
  CHECK(output.state("x/a/0") == RunState::kUnfinished);
  CHECK(output.outcome("x/a/1").exit_code == 130);
  CHECK(output.can_resume("x/a/0"));
}

TEST_CASE("jobs_for: six per GPU while cores last, one per two cores without", "[sweep]") {
  CHECK(sweep::jobs_for({"cuda:0"}, 16, 100) == 6);
  CHECK(sweep::jobs_for({"cuda:0", "cuda:1"}, 32, 100) == 12);
  CHECK(sweep::jobs_for({"cuda:0", "cuda:1"}, 8, 100) == 8);
  CHECK(sweep::jobs_for({"cuda:0", "cuda:1"}, 1, 100) == 2);
  CHECK(sweep::jobs_for({"cpu"}, 16, 100) == 8);
  CHECK(sweep::jobs_for({"cpu"}, 1, 100) == 1);
  // One run has all the cores.
  CHECK(sweep::jobs_for({"cpu"}, 16, 1) == 1);
  CHECK(sweep::jobs_for({"cuda:0"}, 16, 4) == 4);
  CHECK(sweep::jobs_for({"cuda:0"}, 16, 0) == 1);
}

TEST_CASE("devices_of: words become devices that are there", "[sweep]") {
  CHECK(sweep::devices_of({"cpu"}) == std::vector<std::string>{"cpu"});
  const auto found = sweep::devices_of({"auto"});
  CHECK(found.size() == static_cast<size_t>(std::max(1, cuda_device_count())));
  CHECK(found.front() == (cuda_device_count() > 0 ? "cuda:0" : "cpu"));
  CHECK_THROWS_AS(sweep::devices_of({"gpu"}), ConfigError);
  CHECK(sweep::usable_cores() >= 1);
}
