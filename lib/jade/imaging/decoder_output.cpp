// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/decoder_output.h"

#include <cstdio>
#include <iostream>
#include <mutex>
#include <streambuf>

namespace jade::imaging {
namespace {

/// Text that receives the output of this thread; null: the output is printed.
thread_local std::string* collected = nullptr;

/// Stands in for the buffer of std::cerr.
class SortedBuffer : public std::streambuf {
 public:
  std::streambuf* original = nullptr;

 protected:
  int_type overflow(int_type c) override {
    const char letter = traits_type::to_char_type(c);
    return xsputn(&letter, 1) == 1 ? traits_type::not_eof(c) : traits_type::eof();
  }
  std::streamsize xsputn(const char* text, std::streamsize count) override {
    if (collected == nullptr) return original->sputn(text, count);
    collected->append(text, size_t(count));
    return count;
  }
  int sync() override { return collected == nullptr ? original->pubsync() : 0; }
};

/// The streams in place of stderr and std::cerr, while any thread decodes. Never freed: a thread
/// may still print through them.
struct Streams {
  std::mutex mutex;
  int users = 0;
  FILE* original = stderr;
  FILE* sorted = nullptr;
  SortedBuffer buffer;

  static ssize_t write(void* streams, const char* text, size_t count) {
    if (collected == nullptr)
      return ssize_t(std::fwrite(text, 1, count, static_cast<Streams*>(streams)->original));
    collected->append(text, count);
    return ssize_t(count);
  }
  Streams() {
    sorted = fopencookie(this, "w", {nullptr, &write, nullptr, nullptr});
    if (sorted != nullptr) std::setvbuf(sorted, nullptr, _IONBF, 0);
  }
  void enter() {
    const std::lock_guard<std::mutex> lock(mutex);
    if (users++ > 0) return;
    original = stderr;
    if (sorted != nullptr) stderr = sorted;
    buffer.original = std::cerr.rdbuf();
    std::cerr.rdbuf(&buffer);
  }
  void leave() {
    const std::lock_guard<std::mutex> lock(mutex);
    if (--users > 0) return;
    stderr = original;
    std::cerr.rdbuf(buffer.original);
  }
};

Streams& streams() {
  static auto* const all = new Streams();
  return *all;
}

}  // namespace

DecoderOutput::DecoderOutput() : outer_(collected) {
  streams().enter();
  collected = &text_;
}

DecoderOutput::~DecoderOutput() {
  collected = outer_;
  streams().leave();
}

}  // namespace jade::imaging
