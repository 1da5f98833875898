// SPDX-License-Identifier: Apache-2.0
#include "jade/core/interrupt.h"

#include <csignal>
#include <cstdint>
#include <unistd.h>

#include "jade/core/error.h"

namespace jade {
namespace {

/// Schedulers and parent processes may send the same signal twice, faster than a person presses
/// Ctrl-C again.
constexpr int64_t kRepeatMs = 300;

volatile std::sig_atomic_t requested = 0;
int64_t requested_ms = 0;

int64_t now_ms() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return int64_t{1000} * now.tv_sec + now.tv_nsec / 1000000;
}

extern "C" void on_signal(int) {
  const int64_t now = now_ms();
  if (requested) {
    if (now - requested_ms < kRepeatMs) return;
    _exit(static_cast<int>(ExitCode::kInterrupted));
  }
  requested = 1;
  requested_ms = now;
  constexpr char kNote[] = "\ninterrupted: ending in order; press Ctrl-C again to stop at once\n";
  // write() is one of the few calls allowed in a signal handler; its failure has no remedy.
  if (write(STDERR_FILENO, kNote, sizeof kNote - 1) < 0) return;
}

/// The failing write reports the error. A handler instead of SIG_IGN, which children would inherit.
extern "C" void on_failed_write(int) {}

}  // namespace

void install_interrupt_handlers() {
  struct sigaction action {};
  action.sa_handler = on_signal;
  sigemptyset(&action.sa_mask);
  action.sa_flags = SA_RESTART;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  // Sent when the terminal closes; nohup ignores it.
  struct sigaction before {};
  sigaction(SIGHUP, nullptr, &before);
  if (before.sa_handler != SIG_IGN) sigaction(SIGHUP, &action, nullptr);
  action.sa_handler = on_failed_write;
  sigaction(SIGPIPE, &action, nullptr);
  sigaction(SIGXFSZ, &action, nullptr);
}

bool interrupt_requested() { return requested != 0; }

void throw_if_interrupted() {
  if (interrupt_requested()) throw Interrupted();
}

void set_interrupt_requested(bool value) { requested = value ? 1 : 0; }

}  // namespace jade
