// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace jade::imaging {

/// During its lifetime, collects what the calling thread prints on stderr and std::cerr, for OpenCV
/// and the libraries below it: they print faults of a file without its name, and have no other way
/// to report them. Output of other threads is printed as before.
class DecoderOutput {
 public:
  DecoderOutput();
  ~DecoderOutput();
  DecoderOutput(const DecoderOutput&) = delete;
  DecoderOutput& operator=(const DecoderOutput&) = delete;
  const std::string& text() const { return text_; }

 private:
  std::string text_;
  std::string* outer_;  ///< text of an object that this thread made before
};

}  // namespace jade::imaging
