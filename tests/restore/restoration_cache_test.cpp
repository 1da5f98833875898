// SPDX-License-Identifier: Apache-2.0
#include "jade/restore/restoration_cache.h"

#include "support/catch.h"

#include <chrono>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "support/temp_dir.h"

namespace jade::restore {
namespace {

namespace fs = std::filesystem;

RestorationCacheOptions in(const fs::path& folder) { return {true, folder, 2048}; }

/// Gets an image by `key` and reports whether it was computed.
struct Asked {
  torch::Tensor image;
  bool made = false;
};
Asked ask(RestorationCache& cache, const std::string& key, double value,
          torch::IntArrayRef shape = {3, 4, 5}) {
  Asked asked;
  asked.image = cache.get(key, shape, [&] {
    asked.made = true;
    return torch::full(shape, value);
  });
  return asked;
}

fs::path only_file(const fs::path& folder) {
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(folder)) files.push_back(entry.path());
  REQUIRE(files.size() == 1);
  return files.front();
}

TEST_CASE("restoration cache: what was made once is read back to the bit", "[restore]") {
  const test::TempDir dir;
  const torch::Tensor image = torch::rand({3, 7, 9}) * 3 - 1;
  RestorationCache first(in(dir / "a/b"));
  first.get("key", image.sizes(), [&] { return image; });
  CHECK(first.hits() == 0);
  RestorationCache second(in(dir / "a/b"));
  const torch::Tensor back = second.get("key", image.sizes(), [] { return torch::Tensor(); });
  CHECK(torch::equal(back, image));
  CHECK(second.hits() == 1);
}

TEST_CASE("restoration cache: the key knows settings, values, shapes and types", "[restore]") {
  const torch::Tensor a = torch::rand({2, 3}), b = torch::rand({4});
  const std::string key = restoration_key("r", {a, b});
  CHECK(key.size() == 64);
  CHECK(restoration_key("r", {a.clone(), b.clone()}) == key);
  CHECK(restoration_key("s", {a, b}) != key);
  CHECK(restoration_key("r", {b, a}) != key);
  CHECK(restoration_key("r", {a.view({3, 2}), b}) != key);
  CHECK(restoration_key("r", {a.to(torch::kFloat64), b}) != key);
  torch::Tensor changed = a.clone();
  changed[1][2] += 1e-6;
  CHECK(restoration_key("r", {changed, b}) != key);
}

TEST_CASE("restoration cache: damaged, cut, foreign and wrongly sized files are made again",
          "[restore]") {
  const test::TempDir dir;
  RestorationCache cache(in(dir.path()));
  CHECK(ask(cache, "key", 0.25).made);
  const fs::path file = only_file(dir.path());
  const std::string whole = read_file(file);
  std::string flipped = whole;
  flipped[flipped.size() - 5] ^= 1;
  for (const std::string& content :
       {flipped, whole.substr(0, whole.size() - 1), whole.substr(0, 10), std::string(),
        std::string("hello\n"), whole + "x"}) {
    write_file(file, content);
    const Asked asked = ask(cache, "key", 0.25);
    CHECK(asked.made);
    CHECK(read_file(file) == whole);
    CHECK_FALSE(ask(cache, "key", 0.75).made);
  }
  CHECK(ask(cache, "key", 0.5, {3, 5, 4}).made);
}

TEST_CASE("restoration cache: off, or where nothing can be written, everything is made each time",
          "[restore]") {
  const test::TempDir dir;
  RestorationCacheOptions off = in(dir / "off");
  off.enabled = false;
  RestorationCache none(off);
  CHECK(ask(none, "key", 1).made);
  CHECK(ask(none, "key", 1).made);
  CHECK_FALSE(fs::exists(dir / "off"));
  const fs::path blocked = dir.write("file", "in the way");
  RestorationCache nowhere(in(blocked / "cache"));
  CHECK(ask(nowhere, "key", 1).made);
  CHECK(ask(nowhere, "key", 1).made);
}

TEST_CASE("restoration cache: the longest unused go first, and what killed runs left behind",
          "[restore]") {
  const test::TempDir dir;
  RestorationCacheOptions options = in(dir.path());
  options.max_mib = 1;
  RestorationCache before(options), cache(options);
  const std::vector<int64_t> shape{3, 200, 200};  // 469 KiB
  const auto hour = std::chrono::hours(1);
  const auto now = fs::file_time_type::clock::now();
  for (const char* key : {"a", "b"}) ask(before, key, 0, shape);
  fs::last_write_time(dir / "a.restoration", now - 3 * hour);
  fs::last_write_time(dir / "b.restoration", now - 2 * hour);
  CHECK_FALSE(ask(cache, "a", 0, shape).made);  // used again
  dir.write("d.restoration.77.part", "half");
  dir.write("e.restoration.78.part", "being written");
  dir.write("f.txt", "not ours");
  fs::last_write_time(dir / "d.restoration.77.part", now - 2 * hour);
  ask(cache, "c", 0, shape);  // keeps the size limit while it fills
  CHECK(fs::exists(dir / "a.restoration"));
  CHECK_FALSE(fs::exists(dir / "b.restoration"));
  CHECK(fs::exists(dir / "c.restoration"));
  CHECK_FALSE(fs::exists(dir / "d.restoration.77.part"));
  CHECK(fs::exists(dir / "e.restoration.78.part"));
  CHECK(fs::exists(dir / "f.txt"));
}

TEST_CASE("restoration cache: half precision stays, and one run keeps no more than the limit",
          "[restore]") {
  const test::TempDir dir;
  RestorationCacheOptions options = in(dir.path());
  options.max_mib = 1;
  RestorationCache cache(options);
  const torch::Tensor image = torch::rand({3, 300, 200}).to(torch::kHalf);  // 352 KiB, so two fit
  for (const char* key : {"a", "b", "c"}) cache.keep(key, image);
  const auto found = [&](const char* key) { return cache.find(key, image.sizes()); };
  REQUIRE((found("a") && found("b")));
  CHECK(found("a")->scalar_type() == torch::kHalf);
  CHECK(found("a")->equal(image));
  CHECK_FALSE(found("c"));
}

}  // namespace
}  // namespace jade::restore
