// SPDX-License-Identifier: Apache-2.0
#include "jade/core/terminal.h"

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <mutex>
#include <sys/ioctl.h>
#include <unistd.h>

namespace jade {
namespace {

std::mutex& terminal_mutex() {
  static std::mutex mutex;
  return mutex;
}

std::string& live_line() {
  static std::string line;
  return line;
}

size_t columns() {
  winsize size{};
  return ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 1 ? size.ws_col : 80;
}

/// Truncates to one row: a line that wraps cannot be redrawn in place.
void draw_live_line() {
  std::string visible = live_line();
  size_t cells = 0, cut = 0;
  for (; cut < visible.size(); ++cut) {
    const bool starts_character = (static_cast<unsigned char>(visible[cut]) & 0xC0) != 0x80;
    if (starts_character && ++cells >= columns()) break;
  }
  visible.resize(cut);
  std::fprintf(stderr, "\r\033[K%s", visible.c_str());
}

}  // namespace

bool terminal_is_live() {
  static const bool live = [] {
    const char* term = std::getenv("TERM");
    return isatty(STDERR_FILENO) != 0 && term != nullptr && std::strcmp(term, "dumb") != 0;
  }();
  return live;
}

bool terminal_is_utf8() {
  for (const char* name : {"LC_ALL", "LC_CTYPE", "LANG"}) {
    const char* value = std::getenv(name);
    if (value == nullptr || *value == '\0') continue;
    const std::string locale = value;
    return locale.find("UTF-8") != locale.npos || locale.find("utf8") != locale.npos;
  }
  return false;
}

void terminal_print_line(const std::string& text) {
  const std::lock_guard<std::mutex> lock(terminal_mutex());
  const bool live = !live_line().empty();
  std::fprintf(stderr, "%s%s\n", live ? "\r\033[K" : "", text.c_str());
  if (live) draw_live_line();
  std::fflush(stderr);
}

void terminal_set_live_line(const std::string& text) {
  if (!terminal_is_live()) return;
  const std::lock_guard<std::mutex> lock(terminal_mutex());
  if (text.empty() && live_line().empty()) return;
  live_line() = text;
  draw_live_line();
  std::fflush(stderr);
}

}  // namespace jade
