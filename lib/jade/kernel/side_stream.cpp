// SPDX-License-Identifier: Apache-2.0
#include "jade/kernel/side_stream.h"

#include <ATen/cuda/CUDAEvent.h>
#include <c10/cuda/CUDAGuard.h>
#include <c10/cuda/CUDAStream.h>
#include <map>
#include <mutex>

#include "jade/core/check.h"

namespace jade::kernel {
namespace {

using c10::cuda::CUDAStream;

/// One side stream per stream, because torch's allocator caches memory per stream. High priority,
/// because the main stream waits for this work.
CUDAStream beside(const CUDAStream& stream) {
  static std::mutex mutex;
  static auto& known = *new std::map<std::pair<c10::DeviceIndex, cudaStream_t>, CUDAStream>;
  const std::lock_guard<std::mutex> lock(mutex);
  const auto key = std::pair(stream.device_index(), stream.stream());
  const auto found = known.find(key);
  if (found != known.end()) return found->second;
  return known
      .emplace(key, c10::cuda::getStreamFromPool(/*isHighPriority=*/true, stream.device_index()))
      .first->second;
}

/// Makes `later` wait for the work that `earlier` has queued so far.
void order(const CUDAStream& earlier, const CUDAStream& later) {
  at::cuda::CUDAEvent done;
  done.record(earlier);
  done.block(later);
}

}  // namespace

struct SideStream::Streams {
  CUDAStream main, side;
  bool apart = false;
};

SideStream::SideStream(int device) {
  if (device < 0) return;
  const CUDAStream main = c10::cuda::getCurrentCUDAStream(static_cast<c10::DeviceIndex>(device));
  streams_ = std::make_unique<Streams>(Streams{main, beside(main)});
}

SideStream::~SideStream() {
  try {
    join();
  } catch (const std::exception&) {  // NOLINT(bugprone-empty-catch): the next call reports it
  }
}

void SideStream::follow() {
  if (!streams_) return;
  order(streams_->main, streams_->side);
  streams_->apart = true;
}

void SideStream::run(const std::function<void()>& work) {
  if (!streams_) return work();
  JADE_CHECK(streams_->apart, "a side stream runs nothing before follow()");
  const c10::cuda::CUDAStreamGuard guard(streams_->side);
  work();
}

bool SideStream::apart() const { return streams_ && streams_->apart; }

void SideStream::join() {
  if (!apart()) return;
  order(streams_->side, streams_->main);
  streams_->apart = false;
}

}  // namespace jade::kernel
