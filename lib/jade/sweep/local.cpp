// SPDX-License-Identifier: Apache-2.0
#include "jade/sweep/local.h"

#include <algorithm>
#include <cstdlib>
#include <deque>
#include <list>
#include <map>
#include <sched.h>
#include <thread>

#include "jade/core/device.h"
#include "jade/core/error.h"
#include "jade/core/interrupt.h"
#include "jade/core/log.h"
#include "jade/core/progress.h"
#include "jade/sweep/task.h"

namespace jade::sweep {
namespace {

using Clock = std::chrono::steady_clock;

int64_t steps_of(const Run& run) {
  return std::max<int64_t>(1, std::atoll(run.value("train.iterations").c_str()));
}

std::string gib(int64_t bytes) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f GiB", static_cast<double>(bytes) / (1 << 30));
  return text;
}

class Launcher {
 public:
  Launcher(const Plan& plan, const SweepOutput& output, const LocalOptions& options,
           const MemoryProbe& memory)
      : plan_(plan), output_(output), options_(options), memory_(memory) {
    for (const std::string& device : options_.devices) {
      if (device != "cpu") pools_[device].baseline = memory_.device_free(device);
    }
    for (const Run& run : plan_.runs) enlist(run);
  }

  void run() {
    shown_steps_ = known_steps();
    Progress progress("sweep", total_steps_, shown_steps_);
    while (!waiting_.empty() || !running_.empty()) {
      if (interrupt_requested()) stop();
      collect();
      observe();
      start_what_fits();
      if (progress.step(known_steps() - shown_steps_)) progress.show(overview());
      shown_steps_ = known_steps();
      std::this_thread::sleep_for(std::chrono::milliseconds(options_.poll_ms));
    }
    progress.finish();
  }

 private:
  struct Pool {
    int64_t baseline = -1;  ///< free before the first run started
    int64_t peak = 0;
  };
  struct Running {
    Task task;
    int64_t steps;
    int64_t step = 0;
    int64_t host = 0;  ///< current resident size
    int64_t held = 0;  ///< current use of its device
  };

  void enlist(const Run& run) {
    const std::string id = run.id();
    const int64_t steps = steps_of(run);
    total_steps_ += steps;
    const Outcome outcome = output_.outcome(id);
    host_peak_ = std::max(host_peak_, outcome.peak_host_bytes);
    if (pools_.count(outcome.device)) {
      Pool& pool = pools_[outcome.device];
      pool.peak = std::max(pool.peak, outcome.peak_device_bytes);
    }
    const RunState state = output_.state(id);
    if (state == RunState::kRunning) {
      log_warn(id + ": another program trains it; skipped");
    } else if (wants_attempt(output_, id, options_.retry_failed)) {
      waiting_.emplace_back(id, steps);
      return;
    } else if (state == RunState::kFailed) {
      log_warn(concat(id, ": ", describe(outcome), "; skipped, --retry-failed starts it again"));
      ++failed_;
    } else {
      ++finished_;
    }
    ended_steps_ += steps;
  }

  /// Passes the interrupt on once, waits for all runs, and skips the rest.
  [[noreturn]] void stop() {
    for (Running& run : running_) run.task.interrupt();
    while (!running_.empty()) {
      collect();
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
    throw Interrupted();
  }

  void collect() {
    for (auto run = running_.begin(); run != running_.end();) {
      const auto outcome = run->task.poll();
      if (!outcome) {
        ++run;
        continue;
      }
      const std::string id = run->task.id();
      host_peak_ = std::max(host_peak_, outcome->peak_host_bytes);
      ended_steps_ += run->steps;
      run = running_.erase(run);
      if (output_.state(id) == RunState::kFinished) {
        ++finished_;
        log_info(concat(id, ": done in ", duration_text(outcome->seconds), "  (", finished_, " of ",
                        plan_.runs.size(), ")"));
      } else {
        ++failed_;
        log_warn(concat(id, ": ", describe(*outcome), "; see ", output_.log_file(id).string()));
      }
      if (options_.on_end) options_.on_end();
    }
  }

  /// Reads steps and memory of the running runs once per second.
  void observe() {
    const auto now = Clock::now();
    if (now < next_look_) return;
    next_look_ = now + std::chrono::seconds(1);
    for (Running& run : running_) {
      run.step = std::max(run.step, run.task.step());
      run.host = memory_.host_used(run.task.pid());
      // Before its first line of metrics a run has not allocated all of its memory.
      if (run.step > 0) host_peak_ = std::max(host_peak_, run.host);
    }
    for (auto& [device, pool] : pools_) observe_device(device, pool);
  }

  void observe_device(const std::string& device, Pool& pool) {
    std::vector<Running*> here;
    for (Running& run : running_) {
      if (run.task.device() == device) here.push_back(&run);
    }
    if (here.empty()) return;
    measure(device, pool, here);
    const bool started =
        std::all_of(here.begin(), here.end(), [](const Running* run) { return run->step > 0; });
    for (Running* run : here) {
      if (started) pool.peak = std::max(pool.peak, run->held);
      run->task.note_device_peak(run->held);
    }
  }

  /// Measures the device memory of each run: per process if the driver knows all of them (in a
  /// container process numbers differ), else the average.
  void measure(const std::string& device, const Pool& pool, const std::vector<Running*>& here) {
    const std::map<pid_t, int64_t> processes = memory_.device_used(device);
    const auto told = [&](const Running* run) { return processes.count(run->task.pid()) > 0; };
    if (std::all_of(here.begin(), here.end(), told)) {
      for (Running* run : here) run->held = processes.at(run->task.pid());
      return;
    }
    const int64_t free = memory_.device_free(device);
    const int64_t all = free < 0 || pool.baseline < 0 ? 0 : pool.baseline - free;
    for (Running* run : here) {
      run->held = std::max<int64_t>(0, all) / static_cast<int64_t>(here.size());
    }
  }

  void start_what_fits() {
    while (!waiting_.empty() && static_cast<int>(running_.size()) < options_.jobs &&
           !interrupt_requested()) {
      const std::string device = emptiest_device();
      if (!fits(device)) return;
      const auto [id, steps] = waiting_.front();
      waiting_.pop_front();
      try {
        running_.push_back({Task(output_, id, task_options(device)), steps});
        log_info(concat(id, ": started on ", device));
      } catch (const Error& error) {
        ++failed_;
        ended_steps_ += steps;
        log_warn(concat(id, ": ", error.what()));
      }
      next_look_ = {};
    }
  }

  std::string emptiest_device() const {
    std::string best;
    size_t least = 0;
    for (const std::string& device : options_.devices) {
      const size_t count = static_cast<size_t>(
          std::count_if(running_.begin(), running_.end(),
                        [&](const Running& run) { return run.task.device() == device; }));
      if (best.empty() || count < least) {
        best = device;
        least = count;
      }
    }
    return best;
  }

  bool fits(const std::string& device) {
    MemoryUse host{memory_.host_free(), {}, host_peak_};
    for (const Running& run : running_) host.running.push_back(run.host);
    bool enough = may_start(host, options_.memory_margin);
    int64_t free = host.free, peak = host.peak;
    const auto pool = pools_.find(device);
    // If a device reports no memory, --jobs alone limits the runs.
    if (enough && pool != pools_.end() && pool->second.baseline >= 0) {
      MemoryUse use{memory_.device_free(device), {}, pool->second.peak};
      for (const Running& run : running_) {
        if (run.task.device() == device) use.running.push_back(run.held);
      }
      enough = may_start(use, options_.memory_margin);
      free = use.free;
      peak = use.peak;
    }
    if (!enough && running_.empty() && Clock::now() >= next_word_) {
      log_warn(concat("waiting for memory on ", device, ": ", gib(free), " free, a run has needed ",
                      gib(peak), " and ", gib(options_.memory_margin), " stay free"));
      next_word_ = Clock::now() + std::chrono::minutes(1);
    }
    return enough;
  }

  TaskOptions task_options(const std::string& device) const {
    TaskOptions task;
    task.program = options_.program;
    task.device = device;
    task.threads = std::max(1, options_.cores / std::max(1, options_.jobs));
    task.retry_failed = options_.retry_failed;
    return task;
  }

  int64_t known_steps() const {
    int64_t steps = ended_steps_;
    for (const Running& run : running_) steps += std::min(run.step, run.steps);
    return steps;
  }

  std::string overview() const {
    std::string text = concat(finished_, "/", plan_.runs.size(), " runs");
    if (failed_ > 0) text += concat(", ", failed_, " failed");
    for (const Running& run : running_) {
      text += concat("  ", run.task.id(), " ", 100 * run.step / run.steps, "%");
    }
    return text;
  }

  const Plan& plan_;
  const SweepOutput& output_;
  const LocalOptions& options_;
  const MemoryProbe& memory_;
  std::deque<std::pair<std::string, int64_t>> waiting_;
  std::list<Running> running_;
  std::map<std::string, Pool> pools_;
  int64_t host_peak_ = 0;
  int64_t total_steps_ = 0, ended_steps_ = 0, shown_steps_ = 0;
  int finished_ = 0, failed_ = 0;
  Clock::time_point next_look_{}, next_word_{};
};

}  // namespace

int jobs_for(const std::vector<std::string>& devices, int cores, int runs) {
  constexpr int kPerGpu = 6;
  const int gpus = static_cast<int>(std::count_if(devices.begin(), devices.end(),
                                                  [](const auto& name) { return name != "cpu"; }));
  const int fit = gpus == 0 ? cores / 2 : std::max(gpus, std::min(kPerGpu * gpus, cores));
  return std::max(1, std::min(fit, runs));
}

void run_local(const Plan& plan, const SweepOutput& output, const LocalOptions& options,
               const MemoryProbe& memory) {
  Launcher launcher(plan, output, options, memory);
  launcher.run();
}

std::vector<std::string> devices_of(const std::vector<std::string>& words) {
  std::vector<std::string> list;
  for (const std::string& word : words) {
    if (word == "auto" && cuda_device_count() > 0) {
      for (int i = 0; i < cuda_device_count(); ++i) list.push_back(concat("cuda:", i));
    } else {
      const torch::Device device = select_device(word);
      list.push_back(device.is_cpu() ? "cpu"
                                     : concat("cuda:", device.has_index() ? device.index() : 0));
    }
  }
  return list;
}

int usable_cores() {
  cpu_set_t cores;
  return sched_getaffinity(0, sizeof cores, &cores) == 0 ? std::max(1, CPU_COUNT(&cores)) : 1;
}

}  // namespace jade::sweep
