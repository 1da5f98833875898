// SPDX-License-Identifier: Apache-2.0
#include "jade/core/progress.h"

#include "support/catch.h"

#include <cstdlib>
#include <string>
#include <vector>

#include "jade/core/terminal.h"

namespace jade {
namespace {

TEST_CASE("duration_text: reads as a clock", "[core]") {
  CHECK(duration_text(5.2) == "0:05");
  CHECK(duration_text(245) == "4:05");
  CHECK(duration_text(3723) == "1:02:03");
}

TEST_CASE("Progress: off a terminal a report is due every ten seconds, not every step", "[core]") {
  Progress progress("work", 1000);
  int due = 0;
  for (int i = 0; i < 1000; ++i) due += progress.step() ? 1 : 0;
  CHECK(due <= 1);
}

TEST_CASE("terminal_is_utf8: the first locale that is set decides", "[core]") {
  const char* const names[] = {"LC_ALL", "LC_CTYPE", "LANG"};
  std::vector<std::string> before;
  for (const char* name : names) before.emplace_back(std::getenv(name) ? std::getenv(name) : "");
  for (const char* name : names) unsetenv(name);
  CHECK_FALSE(terminal_is_utf8());
  setenv("LANG", "de_DE.UTF-8", 1);
  CHECK(terminal_is_utf8());
  setenv("LC_CTYPE", "", 1);
  CHECK(terminal_is_utf8());
  setenv("LC_ALL", "C", 1);
  CHECK_FALSE(terminal_is_utf8());
  setenv("LC_ALL", "C.utf8", 1);
  CHECK(terminal_is_utf8());
  for (size_t i = 0; i < before.size(); ++i) setenv(names[i], before[i].c_str(), 1);
}

}  // namespace
}  // namespace jade
