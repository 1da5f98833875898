// SPDX-License-Identifier: Apache-2.0
// Builds without CUDA kernels run all work in order.
#include "jade/kernel/side_stream.h"

namespace jade::kernel {

struct SideStream::Streams {};
SideStream::SideStream(int) {}
SideStream::~SideStream() = default;
void SideStream::follow() {}
void SideStream::run(const std::function<void()>& work) { work(); }
bool SideStream::apart() const { return false; }
void SideStream::join() {}

}  // namespace jade::kernel
