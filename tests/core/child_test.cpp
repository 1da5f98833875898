// SPDX-License-Identifier: Apache-2.0
#include "jade/core/child.h"

#include "support/catch.h"

#include <sstream>

#include "jade/core/atomic_file.h"
#include "support/temp_dir.h"

using namespace jade;

TEST_CASE("child: a program runs to its end, with its output, environment and exit code",
          "[core]") {
  const test::TempDir dir;
  const auto log = dir / "log.txt";
  int asked = 0;
  const auto meanwhile = [&] { ++asked; };
  CHECK(run_to_end({"sh", "-c", "echo $JADE_CHILD; sleep 0.1; echo bad >&2; exit 3"},
                   {{"JADE_CHILD", "told"}}, log, meanwhile) == 3);
  CHECK(read_file(log) == "told\nbad\n");
  CHECK(asked > 0);
  CHECK(run_to_end({"true"}, {}, log) == 0);
  CHECK(run_to_end({"sh", "-c", "kill -9 $$"}, {}, log) == -1);
  CHECK(run_to_end({"jade-no-such-program"}, {}, log) == 127);
}

TEST_CASE("child: Ctrl-C in a terminal reaches it through us alone", "[core]") {
  const test::TempDir dir;
  CHECK(run_to_end({"cut", "-d", " ", "-f", "1,5", "/proc/self/stat"}, {}, dir / "log.txt") == 0);
  int64_t process = 0, group = 1;
  std::istringstream(read_file(dir / "log.txt")) >> process >> group;
  CHECK(process == group);
}

TEST_CASE("child: what the caller throws stops the program", "[core]") {
  const test::TempDir dir;
  const auto mark = dir / "done";
  CHECK_THROWS_AS(run_to_end({"sh", "-c", "sleep 0.5; touch " + mark.string()}, {}, dir / "log.txt",
                             [] { throw std::runtime_error("enough"); }),
                  std::runtime_error);
  CHECK(run_to_end({"sleep", "0.6"}, {}, dir / "log.txt") == 0);
  CHECK_FALSE(std::filesystem::exists(mark));
}
