// SPDX-License-Identifier: Apache-2.0
#include "jade/splat/cuda/capacity.h"

#include <algorithm>
#include <cmath>
#include <cuda_runtime_api.h>
#include <map>
#include <memory>
#include <mutex>
#include <tuple>

#include "jade/core/error.h"

namespace jade::splat::cuda {

namespace {
constexpr double kSpare = 1.25;
constexpr int64_t kLeast = 16384;
std::mutex budgets_mutex;
int64_t forced_capacity = -1;
}  // namespace

InstanceBudget::InstanceBudget() {
  void* memory = nullptr;
  if (cudaHostAlloc(&memory, 2 * sizeof(uint64_t), cudaHostAllocMapped) != cudaSuccess) {
    throw DeviceError("no page-locked memory left for the splatting op");
  }
  inbox_ = static_cast<volatile uint64_t*>(memory);
  inbox_[0] = inbox_[1] = 0;
}

InstanceBudget& InstanceBudget::of(int device, int64_t views, int64_t width, int64_t height) {
  static auto& budgets =
      *new std::map<std::tuple<int, int64_t, int64_t, int64_t>, std::unique_ptr<InstanceBudget>>;
  const std::lock_guard<std::mutex> lock(budgets_mutex);
  auto& budget = budgets[{device, views, width, height}];
  if (!budget) budget.reset(new InstanceBudget);
  return *budget;
}

void InstanceBudget::learn(uint64_t instances, uint64_t gaussians) {
  if (gaussians == 0) return;
  per_gaussian_ = std::max(per_gaussian_, static_cast<double>(instances) / gaussians);
}

void InstanceBudget::read_inbox() { learn(inbox_[0], inbox_[1]); }

bool InstanceBudget::known() {
  const std::lock_guard<std::mutex> lock(budgets_mutex);
  read_inbox();
  return per_gaussian_ >= 0;
}

int64_t InstanceBudget::capacity(int64_t gaussians) {
  const std::lock_guard<std::mutex> lock(budgets_mutex);
  read_inbox();
  const double wanted = std::max(per_gaussian_, 0.0) * static_cast<double>(gaussians) * kSpare;
  return std::min(kMostInstances, kLeast + static_cast<int64_t>(std::min(wanted, 4e9)));
}

void set_instance_capacity_for_test(int64_t capacity) { forced_capacity = capacity; }
int64_t instance_capacity_for_test() { return forced_capacity; }

}  // namespace jade::splat::cuda
