// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace jade {

/// Installs signal handlers. Ctrl-C, SIGTERM and SIGHUP (unless ignored, as under nohup) set a flag
/// that long work polls; a second signal, at least 0.3 s later, stops the program at once with exit
/// code 130. SIGPIPE (`| head`) and SIGXFSZ (`ulimit -f`) do not end the program: the write fails
/// instead.
void install_interrupt_handlers();

/// True after Ctrl-C, SIGTERM or SIGHUP.
bool interrupt_requested();

/// @throws Interrupted if interrupt_requested().
void throw_if_interrupted();

/// Sets or clears the flag, for tests and for programs that go on after saving.
void set_interrupt_requested(bool requested);

}  // namespace jade
