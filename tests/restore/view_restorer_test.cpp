// SPDX-License-Identifier: Apache-2.0
#include "jade/restore/view_restorer.h"

#include "support/catch.h"

#include <torch/types.h>

#include "jade/core/digest.h"
#include "jade/core/error.h"
#include "jade/core/version.h"
#include "support/stub_restorer.h"
#include "support/temp_dir.h"

namespace jade::restore {
namespace {

namespace fs = std::filesystem;

RestorationCacheOptions in(const fs::path& folder) { return {true, folder, 2048}; }

TEST_CASE("view restorer: a second start with all views at hand loads no network", "[restore]") {
  const test::TempDir dir;
  const fs::path network = test::save_restorer(dir / "n.pt", "  return image * 0.5\n");
  const torch::Tensor blurry = torch::rand({3, 16, 20}), voxel = torch::randn({6, 16, 20});
  const auto restore = [&](const fs::path& file, const torch::Tensor& image, bool* loaded) {
    ViewRestorer restorer(in(dir / "cache"), EfnetOptions{file}, torch::kCPU);
    const torch::Tensor out = restorer.efnet(image, voxel);
    *loaded = restorer.network_is_loaded();
    return out;
  };
  bool loaded = false;
  const torch::Tensor first = restore(network, blurry, &loaded);
  CHECK(loaded);
  CHECK(torch::equal(restore(network, blurry, &loaded), first));
  CHECK_FALSE(loaded);
  restore(network, blurry + 0.01, &loaded);
  CHECK(loaded);
  // Another network in the same file.
  test::save_restorer(network, "  return image * 0.25\n");
  CHECK(torch::allclose(restore(network, blurry, &loaded), blurry * 0.25));
  CHECK(loaded);
}

TEST_CASE("view restorer: a data set whose views are all in the cache is known before it is read",
          "[restore]") {
  const test::TempDir dir;
  const EfnetOptions file{test::save_restorer(dir / "n.pt", "  return image * 0.5\n")};
  const torch::Tensor blurry = torch::rand({3, 16, 20}), voxel = torch::randn({6, 16, 20});
  const auto known = [&](const RestorationCacheOptions& cache, const fs::path& data) {
    return restored_before(cache, restorer_file_sha256(file), torch::kCPU, data);
  };
  const auto restore = [&](const RestorationCacheOptions& cache, int views) {
    ViewRestorer restorer(cache, file, torch::kCPU);
    for (int i = 0; i < views; ++i) restorer.efnet(blurry + 0.01 * i, voxel);
    restorer.note_restored(dir / "data");
  };
  const RestorationCacheOptions cache = in(dir / "cache");
  CHECK_FALSE(known(cache, dir / "data"));
  CHECK_FALSE(fs::exists(dir / "cache"));
  restore(cache, 2);
  CHECK(known(cache, dir / "data"));
  CHECK(known(cache, dir / "." / "data"));
  CHECK_FALSE(known(cache, dir / "other"));
  CHECK_FALSE(known({false, dir / "cache"}, dir / "data"));
  CHECK_FALSE(restored_before(cache, "another restorer", torch::kCPU, dir / "data"));
  // A view that does not fit the cache would be missing.
  const RestorationCacheOptions none{true, dir / "full", 0};
  restore(none, 1);
  CHECK_FALSE(known(none, dir / "data"));
}

TEST_CASE("view restorer: a network that loads beside it is taken as one of its own", "[restore]") {
  const test::TempDir dir;
  const torch::Tensor blurry = torch::rand({3, 16, 20}), voxel = torch::randn({6, 16, 20});
  // Its warm-up fails because it rejects the small black frame; that is not reported.
  const EfnetOptions file{
      test::save_restorer(dir / "n.pt", "  assert image.sum() > 0\n  return image * 0.5\n")};
  ViewRestorer restorer(in(dir / "cache"), file, torch::kCPU, false,
                        load_beside(file, torch::kCPU));
  CHECK_FALSE(restorer.network_is_loaded());
  CHECK(torch::allclose(restorer.efnet(blurry, voxel), blurry * 0.5));
  CHECK(restorer.network_is_loaded());
  // Each call reports the failure of the loading thread.
  ViewRestorer broken(in(dir / "cache"), file, torch::kCPU, false,
                      load_beside({dir / "none.pt"}, torch::kCPU));
  CHECK_THROWS_AS(broken.efnet(blurry + 0.01, voxel), DataError);
}

TEST_CASE("view restorer: restorations at several moments are one entry, found by data and moments",
          "[restore]") {
  const test::TempDir dir;
  const EfnetOptions network{test::save_any_time_restorer(
      dir / "n.pt",
      "  return 0.4 * image + 0.3 * time.view(-1, 1, 1, 1) + 0.01 * counts[:, 3:]\n")};
  const torch::Tensor blurry = torch::rand({3, 16, 20}), counts = torch::randn({4, 16, 20});
  struct Found {
    torch::Tensor images;
    bool loaded;
  };
  const auto restore = [&](const torch::Tensor& events, const std::vector<double>& times) {
    ViewRestorer restorer(in(dir / "cache"), network, torch::kCPU);
    const torch::Tensor out = restorer.efnet(blurry, events, times);
    return Found{out, restorer.network_is_loaded()};
  };
  const Found first = restore(counts, {0, 0.5, 1});
  CHECK(first.loaded);
  CHECK(first.images.sizes() == torch::IntArrayRef({3, 3, 16, 20}));
  CHECK(first.images.scalar_type() == torch::kHalf);
  const torch::Tensor last = (0.4 * blurry + 0.3 + 0.01 * counts.narrow(0, 3, 1)).clamp(0, 1);
  CHECK(torch::allclose(first.images[2].to(torch::kFloat32), last, 0, 3e-4));
  const Found again = restore(counts, {0, 0.5, 1});
  CHECK_FALSE(again.loaded);
  CHECK(again.images.equal(first.images));
  const Found turned = restore(counts, {1, 0.5, 0});
  CHECK(turned.loaded);
  CHECK(turned.images.equal(first.images.flip(0)));
  CHECK(restore(counts + 1, {0, 0.5, 1}).loaded);
  ViewRestorer middle(in(dir / "cache"), network, torch::kCPU);
  CHECK(
      torch::allclose(middle.efnet(blurry, counts), first.images[1].to(torch::kFloat32), 0, 3e-4));
  CHECK(middle.metadata().any_time);
}

TEST_CASE("view restorer: an entry is named by its network, its data and torch", "[restore]") {
  const test::TempDir dir;
  const fs::path network = test::save_restorer(dir / "n.pt", "  return image * 0.5\n");
  const torch::Tensor blurry = torch::rand({3, 16, 20}), voxel = torch::randn({6, 16, 20});
  const EfnetOptions options{network};
  ViewRestorer(in(dir / "cache"), options, torch::kCPU).efnet(blurry, voxel);
  const std::string recipe = concat("efnet 3; ", file_sha256(network), "; torch ", torch_version(),
                                    "; ", torch::Device(torch::kCPU).type());
  CHECK(fs::exists(dir / "cache" / (restoration_key(recipe, {blurry, voxel}) + ".restoration")));
  ViewRestorer restorer(in(dir / "cache"), options, torch::kCPU);
  CHECK_THROWS_WITH(restorer.efnet(blurry, voxel, {0}), Catch::Contains("version 1"));
}

TEST_CASE("view restorer: gray frames get gray restorations, whatever the cache holds of them",
          "[restore]") {
  const test::TempDir dir;
  const EfnetOptions tints{test::save_restorer(
      dir / "n.pt",
      "  return torch.cat([image[:, :1], image[:, 1:2] * 0.9, image[:, 2:] * 0.8], "
      "1)\n")};
  const torch::Tensor gray = torch::rand({1, 16, 20}).expand({3, 16, 20}).contiguous();
  const torch::Tensor voxel = torch::randn({6, 16, 20});
  const auto restore = [&](bool monochrome) {
    return ViewRestorer(in(dir / "cache"), tints, torch::kCPU, monochrome).efnet(gray, voxel);
  };
  const torch::Tensor tinted = restore(false);
  CHECK(torch::allclose(tinted[2], gray[2] * 0.8));
  for (int i = 0; i < 2; ++i) {  // computed, then from the cache
    const torch::Tensor restored = restore(true);
    CHECK(restored[0].equal(restored[1]));
    CHECK(restored[0].equal(restored[2]));
    CHECK(torch::allclose(restored, gray * 0.9));
  }
  CHECK(restore(false).equal(tinted));
}

/// Restores a frame twice, in two program starts with one cache: both images, whether the second
/// start loaded the network, and the number of files in the cache at the end.
struct TwoStarts {
  torch::Tensor first, second;
  bool loaded_again = false;
  size_t kept = 0;
};
TwoStarts restore_twice(const fs::path& cache, const fs::path& network, torch::Device device) {
  const torch::Tensor blurry = torch::rand({3, 200, 330}), voxel = torch::randn({6, 200, 330});
  TwoStarts out;
  out.first = ViewRestorer(in(cache), EfnetOptions{network}, device).efnet(blurry, voxel);
  ViewRestorer again(in(cache), EfnetOptions{network}, device);
  out.second = again.efnet(blurry, voxel);
  out.loaded_again = again.network_is_loaded();
  for ([[maybe_unused]] const auto& file : fs::directory_iterator(cache)) ++out.kept;
  return out;
}

TEST_CASE("view restorer: what was restored in tiles is not kept for a whole frame", "[restore]") {
  const test::TempDir dir;
  const auto network = [&](const std::string& name, int pixels) {
    return test::save_restorer(
        dir / name, "  assert image.size(2) * image.size(3) <= " + std::to_string(pixels) +
                        ", 'out of memory'\n  return image * 0.5\n");
  };
  const TwoStarts tiled = restore_twice(dir / "tiled", network("small.pt", 40000), torch::kCPU);
  CHECK(tiled.kept == 0);
  CHECK(tiled.loaded_again);
  CHECK(torch::equal(tiled.first, tiled.second));
  const TwoStarts whole = restore_twice(dir / "whole", network("large.pt", 1 << 20), torch::kCPU);
  CHECK(whole.kept == 1);
  CHECK_FALSE(whole.loaded_again);
}

TEST_CASE("view restorer: what a full GPU left to the CPU is not kept for the GPU",
          "[restore][cuda]") {
  const test::TempDir dir;
  const fs::path network = test::save_restorer(
      dir / "n.pt", "  assert not image.is_cuda, 'CUDA out of memory'\n  return image * 0.5\n");
  const TwoStarts fallen = restore_twice(dir / "cache", network, torch::kCUDA);
  CHECK(fallen.kept == 0);
  CHECK(fallen.loaded_again);
  CHECK(fallen.second.is_cuda());
  CHECK(restore_twice(dir / "cpu", network, torch::kCPU).kept == 1);
}

}  // namespace
}  // namespace jade::restore
