// SPDX-License-Identifier: Apache-2.0
#include "jade/core/asset.h"

#include "support/catch.h"

#include <cstdlib>

#include "support/temp_dir.h"

using namespace jade;
namespace fs = std::filesystem;

namespace {

/// $JADE_DATA for the length of a test.
class DataFolder {
 public:
  explicit DataFolder(const fs::path& folder) { setenv("JADE_DATA", folder.c_str(), 1); }
  ~DataFolder() { unsetenv("JADE_DATA"); }
};

fs::path program_folder() { return fs::read_symlink("/proc/self/exe").parent_path(); }

}  // namespace

TEST_CASE("asset: a program in a build folder finds the files of its source tree", "[core]") {
  unsetenv("JADE_DATA");
  for (const char* name : {"assets/efnet_anytime.pt", "assets/identity_response.npy",
                           "configs/base.yaml", "scripts/read_recording.py"}) {
    INFO(name);
    CHECK(fs::is_regular_file(asset(name)));
    CHECK(asset(name) == program_folder().parent_path() / "share/jade" / name);
  }
}

TEST_CASE("asset: JADE_DATA has what lies not beside the program", "[core]") {
  const test::TempDir dir;
  dir.write("configs/base.yaml", "");
  dir.write("configs/own.yaml", "");
  const DataFolder data(dir.path());
  CHECK(asset("configs/own.yaml") == dir.path() / "configs/own.yaml");
  // Files beside the program belong to its version and take precedence.
  CHECK(asset("configs/base.yaml") ==
        program_folder().parent_path() / "share/jade/configs/base.yaml");
}

TEST_CASE("asset: a file that is nowhere is named where an installation would have it", "[core]") {
  const test::TempDir dir;
  const DataFolder data(dir.path());
  CHECK(asset("configs/none.yaml") ==
        program_folder().parent_path() / "share/jade/configs/none.yaml");
}
