// SPDX-License-Identifier: Apache-2.0
#include "jade/import/stages.h"

#include "support/catch.h"

#include <map>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/log.h"
#include "support/naming.h"
#include "support/temp_dir.h"

using namespace jade;
using import::Stage;

namespace {

/// Three stages that count their calls; each appends its letter to the previous result.
struct Letters {
  test::TempDir dir;
  std::map<std::string, int> made;
  std::map<std::string, std::string> settings{{"a", "1"}, {"b", "1"}, {"c", "1"}};
  std::string text;
  std::string failing;

  Letters() { set_log_level("error"); }

  std::vector<Stage> stages() {
    std::vector<Stage> list;
    for (const char* letter : {"a", "b", "c"}) {
      const std::string name = letter;
      list.push_back(
          {name, settings[name],
           [this, name](const std::filesystem::path& folder) {
             ++made[name];
             write_file(folder / "text", text + name);
             if (name == failing) throw Interrupted();
             return "wrote " + name;
           },
           [this](const std::filesystem::path& folder) { text = read_file(folder / "text"); }});
    }
    return list;
  }

  void run(const import::StageRange& range = {}) {
    made.clear();
    text.clear();
    import::run_stages(dir.path(), stages(), range);
  }
  std::vector<int> counts() { return {made["a"], made["b"], made["c"]}; }
};

}  // namespace

TEST_CASE("stages: what is up to date is not made again", "[import]") {
  Letters letters;
  letters.run();
  CHECK(letters.counts() == std::vector{1, 1, 1});
  CHECK(letters.text == "abc");
  letters.run();
  CHECK(letters.counts() == std::vector{0, 0, 0});
}

TEST_CASE("stages: a changed setting makes its stage and those behind it", "[import]") {
  Letters letters;
  letters.run();
  letters.settings["b"] = "2";
  letters.run();
  CHECK(letters.counts() == std::vector{0, 1, 1});
  CHECK(letters.text == "abc");
}

TEST_CASE("stages: from and until", "[import]") {
  Letters letters;
  letters.run({"", "b"});
  CHECK(letters.counts() == std::vector{1, 1, 0});
  letters.run({"b", ""});
  CHECK(letters.counts() == std::vector{0, 1, 1});
  letters.run({"a", "a"});
  CHECK(letters.counts() == std::vector{1, 0, 0});
  CHECK_THROWS_NAMING(ConfigError, letters.run({"d", ""}), "--from", "a, b, c");
  CHECK_THROWS_NAMING(ConfigError, letters.run({"c", "b"}), "--until", "expected c", "found b");
}

TEST_CASE("stages: an interruption loses one stage, and its old result stays", "[import]") {
  Letters letters;
  letters.failing = "b";
  CHECK_THROWS_AS(letters.run(), Interrupted);
  CHECK_FALSE(std::filesystem::exists(letters.dir / "b"));
  letters.failing = "";
  letters.run();
  CHECK(letters.counts() == std::vector{0, 1, 1});
  letters.failing = "c";
  CHECK_THROWS_AS(letters.run({"c", ""}), Interrupted);
  CHECK(read_file(letters.dir / "c/text") == "abc");
}

TEST_CASE("stages: what was made before the stage ahead of it is made again", "[import]") {
  Letters letters;
  letters.run();
  letters.failing = "c";
  CHECK_THROWS_AS(letters.run({"b", ""}), Interrupted);
  CHECK(read_file(letters.dir / "c/text") == "abc");
  letters.failing = "";
  letters.run();
  CHECK(letters.counts() == std::vector{0, 0, 1});
  letters.run({"a", "a"});
  letters.run();
  CHECK(letters.counts() == std::vector{0, 1, 1});
}
