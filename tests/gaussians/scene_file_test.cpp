// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/scene_file.h"

#include "support/catch.h"

#include <cmath>
#include <tuple>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/log.h"
#include "jade/gaussians/gaussian_model.h"
#include "jade/gaussians/spatial_order.h"
#include "random_gaussians.h"
#include "support/naming.h"
#include "support/temp_dir.h"

namespace jade::gaussians {
namespace {

namespace fs = std::filesystem;

/// A format, and the largest errors that its quantisation allows for Gaussians of
/// random_gaussians(): means within 4 of the origin, log scales of a spread of 4.
struct Format {
  std::string name;
  int spz_version;
  bool ordered;  ///< sorted along a space-filling curve
  double mean, log_scale, opacity, dc, rest;
  double degrees;  ///< error of the rotation
};

const std::vector<Format> kFormats = {
    {"a.ply", 2, false, 0, 0, 1e-6, 0, 0, 0.05},
    {"a.splat", 2, false, 0, 1e-6, 0.5 / 255, 0.5 / 255 / 0.282, 0, 2},
    {"a.spz", 2, false, 0.5 / 4096, 0.5 / 16, 0.5 / 255, 0.5 / 255 / 0.15, 0.08, 14},
    {"a.spz", 3, false, 0.5 / 4096, 0.5 / 16, 0.5 / 255, 0.5 / 255 / 0.15, 0.08, 0.3},
    {"a.spz", 4, false, 0.5 / 4096, 0.5 / 16, 0.5 / 255, 0.5 / 255 / 0.15, 0.08, 0.3},
    {"a.compressed.ply", 2, true, 0.5 * 8 / 1023, 0.5 * 4 / 1023, 0.5 / 255, 0.5 * 2.5 / 255,
     8.0 / 256, 0.2},
    {"a.sog", 2, true, 5 * 0.5 * 3.6 / 65535, 0.07, 0.5 / 255, 0.07, 0.04, 0.8},
    {"a.glb", 2, false, 0, 2e-6, 1e-6, 0, 0, 0.05}};

/// .splat cannot store SH beyond degree 0.
int64_t kept(const Format& format, int64_t coefficients) {
  return format.name == "a.splat" ? 1 : coefficients;
}

double worst(const torch::Tensor& a, const torch::Tensor& b) {
  REQUIRE(a.sizes() == b.sizes());
  return a.numel() == 0 ? 0 : (a - b).abs().max().item<double>();
}

double worst_turn(const torch::Tensor& a, const torch::Tensor& b) {
  const auto unit = [](const torch::Tensor& q) {
    const torch::Tensor exact = q.to(torch::kFloat64);
    return exact / exact.norm(2, 1, true);
  };
  const torch::Tensor cosine = (unit(a) * unit(b)).sum(1).abs().clamp_max(1);
  return 2 * cosine.min().acos().item<double>() * 180 / M_PI;
}

splat::Gaussians in_order(const splat::Gaussians& gaussians, const torch::Tensor& order) {
  return map_parameters(gaussians,
                        [&](const torch::Tensor& value) { return value.index_select(0, order); });
}

std::string message_of(const fs::path& path) {
  try {
    read_scene_file(path);
  } catch (const DataError& error) {
    return error.what();
  }
  return "";
}

TEST_CASE("scene file: every format that is written is read within its steps", "[gaussians]") {
  const test::TempDir dir;
  for (const Format& format : kFormats) {
    for (const int64_t coefficients : {1, 4, 9, 16}) {
      INFO(format.name << " version " << format.spz_version << ", " << coefficients);
      splat::Gaussians all = test::random_gaussians(700, coefficients);
      all.sh.slice(1, 1).clamp_(-0.95, 0.95);  // .spz stores them in [-1, 1]
      const splat::Gaussians g = format.ordered ? in_order(all, spatial_order(all.means)) : all;
      SceneWriting writing;
      writing.spz_version = format.spz_version;
      write_scene_file(dir / format.name, {all, true}, writing);
      splat::Gaussians back = read_gaussians(dir / format.name).gaussians;
      REQUIRE(back.size() == 700);
      if (format.name == "a.splat") {
        // Large and opaque ones come first.
        const torch::Tensor importance = g.log_scales.exp().prod(1) * g.logit_opacities.sigmoid();
        back = in_order(back, importance.argsort(true, 0, true).argsort(true, 0, false));
      }
      CHECK(worst(back.means, g.means) <= format.mean * 1.01);
      CHECK(worst(back.log_scales, g.log_scales) <= format.log_scale * 1.01);
      CHECK(worst(back.logit_opacities.sigmoid(), g.logit_opacities.sigmoid()) <=
            format.opacity * 1.01);
      CHECK(worst(back.sh.select(1, 0), g.sh.select(1, 0)) <= format.dc * 1.01);
      const int64_t count = kept(format, coefficients);
      REQUIRE(back.sh.size(1) == count);
      CHECK(worst(back.sh.slice(1, 1), g.sh.slice(1, 1, count)) <= format.rest * 1.01);
      CHECK(worst_turn(back.rotations, g.rotations) <= format.degrees);
    }
  }
}

TEST_CASE("scene file: .compressed.ply leaves out degrees of SH that are 0 everywhere",
          "[gaussians]") {
  const test::TempDir dir;
  for (const int64_t used : {1, 4, 9, 16}) {
    splat::Gaussians g = test::random_gaussians(300, 16);
    g.sh.slice(1, used).zero_();
    write_scene_file(dir / "a.compressed.ply", {g, false});
    CHECK(read_gaussians(dir / "a.compressed.ply").gaussians.sh.size(1) == used);
  }
}

TEST_CASE("scene file: endings may have capitals", "[gaussians]") {
  const test::TempDir dir;
  for (const char* const name : {"a.PLY", "a.Spz", "a.SOG", "a.GLB", "a.SPLAT"}) {
    INFO(name);
    write_scene_file(dir / name, {test::random_gaussians(10, 1), false});
    CHECK(read_gaussians(dir / name).gaussians.size() == 10);
  }
}

TEST_CASE("scene file: SH in .compressed.ply are right on average", "[gaussians]") {
  const test::TempDir dir;
  for (const double value : {-0.9, -0.01, 0.001, 0.02}) {
    splat::Gaussians g = test::random_gaussians(600, 16);
    g.sh.slice(1, 1).fill_(value);
    write_scene_file(dir / "a.compressed.ply", {g, false});
    const torch::Tensor back = read_gaussians(dir / "a.compressed.ply").gaussians.sh.slice(1, 1);
    CHECK(worst(back.mean(0), g.sh.slice(1, 1).mean(0)) < 1e-3);
    CHECK(worst(back.mean({1, 2}).mean(0), g.sh.slice(1, 1).mean()) < 3e-4);
  }
}

TEST_CASE("scene file: the flag of antialiased scenes is kept, or its loss is reported",
          "[gaussians]") {
  const test::TempDir dir;
  const splat::Gaussians g = test::random_gaussians(10, 4);
  for (const bool antialiased : {false, true}) {
    for (const char* const name : {"a.ply", "a.compressed.ply", "a.spz", "a.sog"}) {
      INFO(name);
      write_scene_file(dir / name, {g, antialiased});
      CHECK(read_gaussians(dir / name).antialiased == antialiased);
    }
    for (const char* const name : {"a.glb", "a.splat"}) {
      INFO(name);
      set_log_file(dir / "said.log");
      write_scene_file(dir / name, {g, antialiased});
      set_log_file({});
      const bool warned = read_file(dir / "said.log").find("antialiased") != std::string::npos;
      CHECK(warned == antialiased);
    }
  }
}

TEST_CASE("scene file: kinds are known by content, .splat by its name", "[gaussians]") {
  const test::TempDir dir;
  const splat::Gaussians g = test::random_gaussians(10, 4);
  const std::vector<std::pair<std::string, SceneKind>> kinds = {
      {"a.ply", SceneKind::kPly},
      {"a.compressed.ply", SceneKind::kPly},
      {"a.spz", SceneKind::kSpz},
      {"a.sog", SceneKind::kSog},
      {"a.glb", SceneKind::kGltf}};
  for (const auto& [name, kind] : kinds) {
    for (const int version : {2, 4}) {
      INFO(name);
      SceneWriting writing;
      writing.spz_version = version;
      write_scene_file(dir / name, {g, false}, writing);
      CHECK(scene_kind(dir / name) == kind);
      fs::rename(dir / name, dir / "renamed");
      CHECK(scene_kind(dir / "renamed") == kind);
      CHECK(read_gaussians(dir / "renamed").gaussians.size() == 10);
    }
  }
  write_scene_file(dir / "a.splat", {g, false});
  CHECK(scene_kind(dir / "a.splat") == SceneKind::kSplat);
  fs::rename(dir / "a.splat", dir / "renamed");
  CHECK_FALSE(scene_kind(dir / "renamed"));
  CHECK_THAT(message_of(dir / "renamed"), Catch::Contains("another kind of file"));
  CHECK_THAT(message_of(dir / "none.ply"), Catch::Contains("found nothing"));
  CHECK_THAT(message_of(dir.path()), Catch::Contains("found a folder"));
  CHECK(can_write("b.compressed.ply"));
  CHECK_FALSE(can_write("b.gltf"));
  CHECK_FALSE(can_write("b.obj"));
  CHECK_FALSE(is_exact("b.compressed.ply"));
}

TEST_CASE("scene file: damaged files of every kind are one line that names the file",
          "[gaussians]") {
  const test::TempDir dir;
  const splat::Gaussians g = test::random_gaussians(300, 9);
  for (const Format& format : kFormats) {
    SceneWriting writing;
    writing.spz_version = format.spz_version;
    const fs::path path = dir / format.name;
    write_scene_file(path, {g, false}, writing);
    const std::string whole = read_file(path);
    for (const size_t size :
         {size_t(0), size_t(3), size_t(20), whole.size() / 3, whole.size() / 2, whole.size() - 1}) {
      INFO(format.name << " version " << format.spz_version << " cut to " << size);
      // Some of these are whole records of a .splat.
      if (format.name == "a.splat" && size > 0 && size % 32 == 0) continue;
      write_file(path, whole.substr(0, size));
      const std::string message = message_of(path);
      CHECK_THAT(message, Catch::Contains(format.name));
      CHECK(message.find('\n') == std::string::npos);
    }
    // Changes every byte: the reader must return a scene or throw an error, nothing else.
    for (size_t at = 0; at < whole.size(); at += 1 + whole.size() / 60) {
      std::string spoilt = whole;
      spoilt[at] = static_cast<char>(spoilt[at] ^ 0x5a);
      write_file(path, spoilt);
      CHECK(message_of(path).find('\n') == std::string::npos);
    }
  }
}

TEST_CASE("scene file: known files that are not read are named with what to do", "[gaussians]") {
  const test::TempDir dir;
  const std::string pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:aa\n";
  for (const auto& [name, content, word] :
       {std::tuple{"a.ply", pointer, "git lfs pull"}, std::tuple{"a.spz", pointer, "git lfs pull"},
        std::tuple{"b.ply", std::string("<html>"), "HTML"},
        std::tuple{"c.ply", std::string(), "empty"},
        std::tuple{"d.ksplat", std::string(4096, '\1'), "GaussianSplats3D"}}) {
    INFO(name);
    write_file(dir / name, content);
    CHECK_THROWS_NAMING(DataError, read_scene_file(dir / name), name, word);
    CHECK_THROWS_AS(refuse_foreign_scene(dir / name), DataError);
  }
  write_file(dir / "recording.raw", "% evt 3.0\n");
  refuse_foreign_scene(dir / "recording.raw");
}

TEST_CASE("scene file: means far from the origin get one of their own", "[gaussians]") {
  const test::TempDir dir;
  splat::Gaussians g = test::random_gaussians(50, 1);
  g.means = g.means * 100 + torch::tensor({4e6, 3e6, 0.0}).to(torch::kFloat32);
  write_scene_file(dir / "a.glb", {g, false});
  const GaussianFile back = read_gaussians(dir / "a.glb");
  CHECK(back.origin[0] == Approx(4e6).epsilon(0.01));
  const torch::Tensor places =
      back.gaussians.means.to(torch::kFloat64) +
      torch::tensor({back.origin[0], back.origin[1], back.origin[2]}, torch::kFloat64);
  CHECK((places - g.means.to(torch::kFloat64)).abs().max().item<double>() < 1e-3);
}

TEST_CASE("scene file: colours that a format clips or leaves out are reported", "[gaussians]") {
  const test::TempDir folder;
  const auto said = [&](const std::string& name, int64_t coefficients, double base, double rest,
                        double logit = 2) {
    splat::Gaussians g = test::random_gaussians(20, coefficients);
    g.sh = torch::zeros_like(g.sh);
    g.sh[3][0][1] = base;
    if (coefficients > 1) g.sh[4][coefficients - 1][2] = rest;
    g.logit_opacities[3] = g.logit_opacities[4] = logit;
    fs::remove(folder / "said.log");
    set_log_file(folder / "said.log");
    write_scene_file(folder / name, {g, false});
    set_log_file({});
    return read_file(folder / "said.log");
  };
  const auto clipped = [](const char* count) {
    return test::naming("warning", "can hold", concat("found ", count, " of 20 Gaussians"));
  };
  CHECK_THAT(said("a.splat", 4, 0, 0.1), test::naming("a.splat", "SH above degree 0", "left out"));
  CHECK(said("a.splat", 4, 0, 0).empty());
  CHECK(said("a.splat", 1, 1.77, 0).empty());
  CHECK(said("a.splat", 1, -3, 0).empty());  // shown as black in any format
  CHECK_THAT(said("a.splat", 1, 1.8, 0), clipped("1"));
  CHECK(said("a.splat", 1, 1.8, 0, -6).empty());  // invisible
  CHECK(said("a.spz", 16, 3.34, 1.05).empty());
  CHECK_THAT(said("a.spz", 16, 3.4, 0), clipped("1"));
  CHECK_THAT(said("a.spz", 16, -3.4, -1.2), clipped("2"));
  CHECK(said("a.compressed.ply", 16, 9, -4).empty());
  CHECK_THAT(said("a.compressed.ply", 16, 9, 4.2), clipped("1"));
  for (const char* name : {"a.ply", "a.sog", "a.glb"}) CHECK(said(name, 16, 9, 9).empty());
}

}  // namespace
}  // namespace jade::gaussians
