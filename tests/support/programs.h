// SPDX-License-Identifier: Apache-2.0
// Runs this project's programs from the command line. JADE_BIN is their folder.
#pragma once

#include "support/catch.h"

#include <algorithm>
#include <cstdlib>
#include <string>
#include <sys/wait.h>

#include "jade/core/atomic_file.h"
#include "support/naming.h"
#include "support/temp_dir.h"

namespace jade::test {

struct Outcome {
  int code;
  std::string out, err;
};

/// Runs a shell command in `dir`, with the programs on PATH and a cache in `dir`/cache.
inline Outcome run(const TempDir& dir, const std::string& command) {
  const auto out = dir.path() / "out.txt", err = dir.path() / "err.txt";
  const std::string line = "cd " + dir.path().string() + " && export PATH=" + JADE_BIN +
                           ":\"$PATH\" JADE_CACHE=" + (dir / "cache").string() + " && { " +
                           command + "\n} >" + out.string() + " 2>" + err.string();
  const int status = std::system(line.c_str());
  return {WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status), read_file(out),
          read_file(err)};
}

/// Checks that the outcome is the exit code and one line that contains all of `words`.
template <class... Words>
void check_error(const Outcome& outcome, int code, const Words&... words) {
  INFO(outcome.err);
  CHECK(outcome.code == code);
  CHECK_THAT(outcome.err, naming(words...));
  CHECK(std::count(outcome.err.begin(), outcome.err.end(), '\n') == 1);
}

}  // namespace jade::test
