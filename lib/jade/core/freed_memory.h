// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace jade {

/// While an instance exists, the C library keeps freed memory instead of returning it to the system
/// and requesting it again page by page. The destructor returns free memory to the system. For work
/// that frees and allocates many times its peak, such as a network on the CPU. Has an effect with
/// glibc only.
class FreedMemoryKept {
 public:
  FreedMemoryKept();
  ~FreedMemoryKept();
  FreedMemoryKept(const FreedMemoryKept&) = delete;
  FreedMemoryKept& operator=(const FreedMemoryKept&) = delete;
};

}  // namespace jade
