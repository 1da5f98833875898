// SPDX-License-Identifier: Apache-2.0
// Predicts the number of instances to allocate from earlier calls, without waiting for the device.
#pragma once

#include <cstdint>

namespace jade::splat::cuda {

/// Upper limit of capacities.
constexpr int64_t kMostInstances = int64_t{1} << 31;

/// Largest need so far for one image size on one device. Calls of one size share an object.
class InstanceBudget {
 public:
  /// The budget of a device and batch shape, with static lifetime.
  static InstanceBudget& of(int device, int64_t views, int64_t width, int64_t height);

  /// False until a count has arrived.
  bool known();
  /// Capacity for N Gaussians: a quarter more than the largest need for N so far.
  int64_t capacity(int64_t gaussians);
  void learn(uint64_t instances, uint64_t gaussians);
  /// Page-locked memory where kernels may write {instances, gaussians} at any time; later calls
  /// read it.
  volatile uint64_t* inbox() { return inbox_; }

 private:
  InstanceBudget();
  void read_inbox();
  double per_gaussian_ = -1;
  volatile uint64_t* inbox_ = nullptr;
};

/// For tests: a fixed capacity for every call, or −1 for the default.
void set_instance_capacity_for_test(int64_t capacity);
int64_t instance_capacity_for_test();

}  // namespace jade::splat::cuda
