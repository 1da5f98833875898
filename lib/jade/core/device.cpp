// SPDX-License-Identifier: Apache-2.0
#include "jade/core/device.h"

#include <ATen/Parallel.h>
#include <cstdlib>
#include <sys/resource.h>

#include "jade/core/cuda_runtime.h"
#include "jade/core/error.h"

namespace jade {

int cuda_device_count() { return cuda::device_count(); }

std::string cuda_problem() { return cuda::problem(); }

std::string device_name(torch::Device device) {
  if (device.is_cuda()) return cuda::device_name(device.index() < 0 ? 0 : device.index());
  return concat("CPU, ", at::get_num_threads(),
                at::get_num_threads() == 1 ? " thread" : " threads");
}

int64_t peak_memory_bytes(torch::Device device) {
  if (device.is_cuda()) return cuda::peak_memory_bytes(device.index() < 0 ? 0 : device.index());
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<int64_t>(usage.ru_maxrss) * 1024;
}

int64_t free_memory_bytes(torch::Device device) {
  return device.is_cuda() ? cuda::free_memory_bytes(device.index() < 0 ? 0 : device.index()) : 0;
}

void limit_memory(torch::Device device, int64_t bytes) {
  if (device.is_cuda()) cuda::limit_memory(device.index() < 0 ? 0 : device.index(), bytes);
}

void limit_threads_beside(torch::Device device) {
  constexpr int kThreads = 8;
  if (device.is_cuda() && std::getenv("OMP_NUM_THREADS") == nullptr &&
      at::get_num_threads() > kThreads) {
    at::set_num_threads(kThreads);
  }
}

FewerThreads::FewerThreads(bool fewer) : before_(at::get_num_threads()) {
  constexpr int kLeast = 8, kLeft = 2;
  if (fewer && before_ >= kLeast && std::getenv("OMP_NUM_THREADS") == nullptr) {
    at::set_num_threads(before_ - kLeft);
  }
}

FewerThreads::~FewerThreads() {
  if (at::get_num_threads() != before_) at::set_num_threads(before_);
}

int64_t trim_device_memory(torch::Device device, int64_t keep_bytes) {
  if (!device.is_cuda()) return 0;
  return cuda::trim_memory(device.index() < 0 ? 0 : device.index(), keep_bytes);
}

void bound_stack_memory(torch::Device device) {
  if (device.is_cuda()) cuda::bound_stack_memory(device.index() < 0 ? 0 : device.index());
}

void start_device(torch::Device device) {
  if (!device.is_cuda()) return;
  bound_stack_memory(device);
  torch::zeros({1}, device).cpu();
}

torch::Device select_device(const std::string& choice) {
  if (choice == "cpu") return torch::kCPU;
  if (choice == "auto") {
    return cuda::device_count() > 0 ? torch::Device(torch::kCUDA, 0) : torch::Device(torch::kCPU);
  }
  const bool numbered = choice.rfind("cuda:", 0) == 0 && choice.size() > 5 && choice.size() < 9 &&
                        choice.find_first_not_of("0123456789", 5) == std::string::npos;
  if (choice != "cuda" && !numbered) {
    throw ConfigError(concat("device: expected auto, cpu, cuda or cuda:N, found '", choice, "'"));
  }
  const int index = numbered ? std::stoi(choice.substr(5)) : 0;
  const int count = cuda::device_count();
  if (count == 0)
    throw DeviceError(concat("device ", choice, ": ", cuda::problem(), "; or use --device cpu"));
  if (index >= count) {
    throw DeviceError(concat("device ", choice, ": this machine has ", count,
                             count == 1 ? " GPU" : " GPUs", ", numbered from 0; use cuda:0",
                             count > 1 ? concat(" to cuda:", count - 1) : ""));
  }
  return torch::Device(torch::kCUDA, static_cast<c10::DeviceIndex>(index));
}

}  // namespace jade
