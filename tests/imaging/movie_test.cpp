// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/movie.h"

#include "support/catch.h"

#include <cstdlib>
#include <string>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "support/temp_dir.h"

namespace jade::imaging {
namespace {

namespace fs = std::filesystem;

/// PATH for the duration of a test.
class Path {
 public:
  explicit Path(const fs::path& folder) : before_(std::getenv("PATH")) {
    setenv("PATH", folder.c_str(), 1);
  }
  ~Path() { setenv("PATH", before_.c_str(), 1); }
  Path(const Path&) = delete;
  Path& operator=(const Path&) = delete;

 private:
  std::string before_;
};

/// A program of that name that runs `body` with its last argument, the file, as $out. Like ffmpeg,
/// it rejects file names that may contain a colon or begin with a dash.
void write_ffmpeg(const test::TempDir& dir, const std::string& body) {
  const fs::path path = dir.write("bin/ffmpeg",
                                  "#!/bin/sh\nfor out; do :; done\n"
                                  "case $out in file:*) out=./${out#file:} ;; *) exit 1 ;; esac\n"
                                  "case $out in .//*) out=${out#./} ;; esac\n" +
                                      body + "\n");
  fs::permissions(path, fs::perms::owner_all);
}

TEST_CASE("movie: ffmpeg gets the frames as bytes, and the file appears at the end", "[imaging]") {
  const test::TempDir dir;
  write_ffmpeg(dir, "/bin/cat > \"$out\"");
  const Path path(dir / "bin");
  const torch::Tensor image = torch::zeros({3, 2, 4});
  image[0][0][1] = 0.5;
  image[2][1][3] = 7;
  Movie movie(dir / "a.mp4", 4, 2, 30);
  movie.add(image);
  movie.add(image);
  CHECK_FALSE(fs::exists(dir / "a.mp4"));
  movie.finish();
  const std::string bytes = read_file(dir / "a.mp4");
  REQUIRE(bytes.size() == 48);
  CHECK(static_cast<unsigned char>(bytes[3]) == 128);
  CHECK(static_cast<unsigned char>(bytes[23]) == 255);
  CHECK(bytes.substr(0, 24) == bytes.substr(24));
  CHECK_THROWS_AS(movie.add(torch::zeros({3, 2, 5})), DataError);
}

TEST_CASE("movie: a name with a colon or a dash at its head is a file's", "[imaging]") {
  const test::TempDir dir;
  write_ffmpeg(dir, "/bin/cat > \"$out\"");
  const Path path(dir / "bin");
  const fs::path before = fs::current_path();
  fs::current_path(dir.path());
  for (const char* name : {"fi:lm.mp4", "-film.mp4"}) {
    INFO(name);
    Movie movie(name, 4, 2, 30);
    movie.add(torch::zeros({3, 2, 4}));
    CHECK_NOTHROW(movie.finish());
    CHECK(fs::is_regular_file(dir / name));
  }
  fs::current_path(before);
}

TEST_CASE("movie: without an end nothing stays", "[imaging]") {
  const test::TempDir dir;
  write_ffmpeg(dir, "/bin/cat > \"$out\"");
  const Path path(dir / "bin");
  {
    Movie movie(dir / "a.mp4", 4, 2, 30);
    movie.add(torch::zeros({3, 2, 4}));
  }
  for (const auto& entry : fs::directory_iterator(dir.path())) {
    CHECK(entry.path().filename() == "bin");
  }
}

TEST_CASE("movie: no ffmpeg, one that fails and too small frames are errors", "[imaging]") {
  const test::TempDir dir;
  const Path path(dir / "bin");
  CHECK_THROWS_AS(Movie(dir / "a.mp4", 4, 2, 30), ConfigError);
  write_ffmpeg(dir, "exit 1");
  CHECK_THROWS_AS(Movie(dir / "a.mp4", 1, 2, 30), ConfigError);
  Movie movie(dir / "a.mp4", 4, 2, 30);
  CHECK_THROWS_AS(movie.finish(), DataError);
  CHECK_FALSE(fs::exists(dir / "a.mp4"));
}

}  // namespace
}  // namespace jade::imaging
