// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace jade {

/// From now on Ctrl-C, SIGTERM and SIGHUP (unless ignored, as under nohup) set a flag that long
/// work asks for; a second one, 0.3 s later or more, stops the program at once with exit code 130.
/// Who reads our output may go (`| head`, or a `| tee` that Ctrl-C ended), and files may be limited
/// (`ulimit -f`): neither SIGPIPE nor SIGXFSZ ends the program, the write fails.
void install_interrupt_handlers();

/// True once Ctrl-C or SIGTERM has come.
bool interrupt_requested();

/// @throws Interrupted if interrupt_requested().
void throw_if_interrupted();

/// Sets or clears the flag, for tests and for programs that go on after saving.
void set_interrupt_requested(bool requested);

}  // namespace jade
