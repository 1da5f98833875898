// SPDX-License-Identifier: Apache-2.0
#include "jade/core/interrupt.h"

#include <csignal>
#include <unistd.h>

#include "jade/core/error.h"

namespace jade {
namespace {

volatile std::sig_atomic_t requested = 0;

extern "C" void on_signal(int) {
  if (requested) _exit(static_cast<int>(ExitCode::kInterrupted));
  requested = 1;
  constexpr char kNote[] =
      "\ninterrupted: finishing and saving; press Ctrl-C again to stop at once\n";
  // write() is one of the few calls that a signal handler may make; nothing to do if it fails.
  if (write(STDERR_FILENO, kNote, sizeof kNote - 1) < 0) return;
}

}  // namespace

void install_interrupt_handlers() {
  struct sigaction action {};
  action.sa_handler = on_signal;
  sigemptyset(&action.sa_mask);
  action.sa_flags = SA_RESTART;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

bool interrupt_requested() { return requested != 0; }

void throw_if_interrupted() {
  if (interrupt_requested()) throw Interrupted();
}

void set_interrupt_requested(bool value) { requested = value ? 1 : 0; }

}  // namespace jade
