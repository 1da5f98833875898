// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/sog_file.h"

#include "support/catch.h"

#include <nlohmann/json.hpp>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/io/webp.h"
#include "jade/io/zip.h"
#include "random_gaussians.h"
#include "support/temp_dir.h"

namespace jade::gaussians {
namespace {

TEST_CASE("sog: a small file written by hand", "[gaussians]") {
  const test::TempDir dir;
  std::vector<double> book(256, 0.0);
  book[1] = 0.5, book[2] = -4, book[3] = 0.25;
  const auto image = [](std::vector<int64_t> bytes) {
    return io::encode_webp(torch::tensor(bytes).to(torch::kUInt8).reshape({1, 1, 4}));
  };
  const nlohmann::json meta = {
      {"version", 2},
      {"count", 1},
      {"means", {{"mins", {0, -1, 0}}, {"maxs", {1, 0, 0}}, {"files", {"l.webp", "u.webp"}}}},
      {"scales", {{"codebook", book}, {"files", {"scales.webp"}}}},
      {"quats", {{"files", {"quats.webp"}}}},
      {"sh0", {{"codebook", book}, {"files", {"sh0.webp"}}}}};
  const io::ZipEntries parts = {
      {"l.webp", image({255, 0, 0, 255})},    {"u.webp", image({255, 0, 0, 255})},
      {"scales.webp", image({2, 1, 0, 255})}, {"quats.webp", image({255, 128, 128, 253})},
      {"sh0.webp", image({1, 2, 3, 51})},     {"meta.json", meta.dump()}};
  io::write_zip(dir / "a.sog", parts);
  for (const auto& [name, content] : parts) write_file(dir / name, content);
  for (const char* const name : {"a.sog", "meta.json"}) {
    const splat::Gaussians g = read_sog(dir / name).gaussians;
    CHECK(torch::allclose(g.means, torch::tensor({{std::expm1(1.f), -std::expm1(1.f), 0.f}})));
    CHECK(torch::allclose(g.log_scales, torch::tensor({{-4.f, 0.5f, 0.f}})));
    CHECK(torch::allclose(g.sh, torch::tensor({{{0.5f, -4.f, 0.25f}}})));
    CHECK(g.logit_opacities.sigmoid().item<double>() == Approx(0.2));
    // x is the largest: w = 1/√2 according to the first byte, the others near 0.
    CHECK(torch::allclose(g.rotations, torch::tensor({{0.7071f, 0.7071f, 0.0028f, 0.0028f}}), 0,
                          1e-3));
  }
  write_file(dir / "sh0.webp", "no image");
  CHECK_THROWS_AS(read_sog(dir / "meta.json"), DataError);
  nlohmann::json other = meta;
  other["version"] = 3;
  write_file(dir / "meta.json", other.dump());
  CHECK_THROWS_WITH(read_sog(dir / "meta.json"), Catch::Contains("version 2, found 3"));
  other = meta;
  other["count"] = 2;
  write_file(dir / "meta.json", other.dump());
  CHECK_THROWS_AS(read_sog(dir / "meta.json"), DataError);
  other = meta;
  other["scales"]["files"] = {"../a.sog"};
  write_file(dir / "meta.json", other.dump());
  CHECK_THROWS_WITH(read_sog(dir / "meta.json"), Catch::Contains("damaged"));
}

TEST_CASE("sog: more Gaussians than palette rows stay near their SH", "[gaussians]") {
  const test::TempDir dir;
  splat::Gaussians g = test::random_gaussians(6000, 16);
  g.sh = 0.1 * g.sh;
  write_sog(dir / "a.sog", {g, false});
  const nlohmann::json meta = nlohmann::json::parse(io::Zip(dir / "a.sog").read("meta.json"));
  const auto entries = meta["shN"]["count"].get<int64_t>();
  CHECK(entries <= 1500);
  CHECK(entries > 1000);
  const double spread = g.sh.slice(1, 1).std().item<double>();
  const splat::Gaussians back = read_sog(dir / "a.sog").gaussians;
  CHECK(back.sh.slice(1, 1).std().item<double>() == Approx(spread).epsilon(0.4));
}

}  // namespace
}  // namespace jade::gaussians
