// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace jade {

/// While it lives, the C library keeps what the program frees instead of giving it back to the
/// system and taking it anew, page by page; afterwards what is free goes back. For work that frees
/// and takes many times what it holds at once, such as a network on the CPU. Does nothing but in
/// glibc.
class FreedMemoryKept {
 public:
  FreedMemoryKept();
  ~FreedMemoryKept();
  FreedMemoryKept(const FreedMemoryKept&) = delete;
  FreedMemoryKept& operator=(const FreedMemoryKept&) = delete;
};

}  // namespace jade
