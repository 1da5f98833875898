// SPDX-License-Identifier: Apache-2.0
// Access to stderr: message lines scroll above one live line.
#pragma once

#include <string>

namespace jade {

/// True if stderr is a terminal that can redraw a line.
bool terminal_is_live();

/// Whether the locale of the environment (LC_ALL, LC_CTYPE, LANG) is one of UTF-8.
bool terminal_is_utf8();

/// Prints a whole line, above the live line if there is one.
void terminal_print_line(const std::string& text);

/// Replaces the live line; an empty text removes it. Does nothing if terminal_is_live() is false.
void terminal_set_live_line(const std::string& text);

}  // namespace jade
