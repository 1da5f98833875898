// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/gltf_file.h"

#include "support/catch.h"

#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <string>
#include <tuple>
#include <vector>

#include "file_bytes.h"
#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/gaussians/axes.h"
#include "random_gaussians.h"
#include "support/naming.h"
#include "support/temp_dir.h"

namespace jade::gaussians {
namespace {

using nlohmann::json;

size_t u32_at(const std::string& content, size_t at) {
  size_t value = 0;
  for (size_t i = 0; i < 4; ++i)
    value |= static_cast<size_t>(test::byte_at(content, at + i)) << 8 * i;
  return value;
}

/// A .glb as a .gltf and its buffer in a.bin, for tests to change.
json opened(const std::filesystem::path& glb, const std::filesystem::path& folder) {
  const std::string content = read_file(glb);
  REQUIRE(content.substr(0, 4) == "glTF");
  REQUIRE(u32_at(content, 4) == 2);
  REQUIRE(u32_at(content, 8) == content.size());
  const size_t size = u32_at(content, 12);
  REQUIRE(content.substr(16, 4) == "JSON");
  const size_t binary = 20 + size;
  REQUIRE(content.substr(binary + 4, 4) == std::string("BIN\0", 4));
  REQUIRE(u32_at(content, binary) == content.size() - binary - 8);
  write_file(folder / "a.bin", content.substr(binary + 8));
  json document = json::parse(content.substr(20, size));
  document["buffers"][0]["uri"] = "a.bin";
  return document;
}

struct GltfFixture {
  test::TempDir dir;
  mutable std::vector<std::string> notes;  ///< of the last read
  splat::Gaussians gaussians;
  json document;
  explicit GltfFixture(int64_t count = 30) : gaussians(test::random_gaussians(count, 9)) {
    write_glb(dir / "a.glb", {gaussians, false});
    document = opened(dir / "a.glb", dir.path());
  }
  splat::Gaussians read() const {
    write_file(dir / "a.gltf", document.dump());
    notes.clear();
    return read_gltf(dir / "a.gltf", notes).gaussians;
  }
  /// Writes one number of an attribute of one column into rows 0 to count - 1.
  void overwrite(size_t accessor, int64_t count, float value) const {
    const json& view =
        document["bufferViews"][document["accessors"][accessor]["bufferView"].get<size_t>()];
    std::string content = read_file(dir / "a.bin");
    for (int64_t i = 0; i < count; ++i) {
      std::memcpy(content.data() + view["byteOffset"].get<size_t>() + 4 * static_cast<size_t>(i),
                  &value, sizeof value);
    }
    write_file(dir / "a.bin", content);
  }
  size_t accessor(const std::string& name) const {
    return document["meshes"][0]["primitives"][0]["attributes"]["KHR_gaussian_splatting:" + name];
  }
};

TEST_CASE("gltf: attributes are those of the extension", "[gaussians]") {
  const GltfFixture fixture;
  CHECK(fixture.document["asset"]["version"] == "2.0");
  CHECK(fixture.document["extensionsUsed"] == json{"KHR_gaussian_splatting"});
  const json& primitive = fixture.document["meshes"][0]["primitives"][0];
  CHECK(primitive["mode"] == 0);
  CHECK(primitive["extensions"]["KHR_gaussian_splatting"]["kernel"] == "ellipse");
  const json& attributes = primitive["attributes"];
  CHECK(attributes.size() == 4 + 9);
  const auto first = [&](const std::string& name) {
    const json& accessor = fixture.document["accessors"][attributes.at(name).get<size_t>()];
    CHECK(accessor["componentType"] == 5126);
    CHECK(accessor["count"] == 30);
    const auto view = accessor["bufferView"].get<size_t>();
    float value = 0;
    const std::string buffer = read_file(fixture.dir / "a.bin");
    std::memcpy(&value,
                buffer.data() + fixture.document["bufferViews"][view]["byteOffset"].get<size_t>(),
                4);
    return value;
  };
  const splat::Gaussians& g = fixture.gaussians;
  const std::string extension = "KHR_gaussian_splatting:";
  CHECK(first("POSITION") == g.means[0][0].item<float>());
  CHECK(first(extension + "SCALE") == Approx(std::exp(g.log_scales[0][0].item<float>())));
  CHECK(first(extension + "OPACITY") == Approx(g.logit_opacities[0].sigmoid().item<float>()));
  CHECK(first(extension + "ROTATION") ==
        Approx((g.rotations[0][1] / g.rotations[0].norm()).item<float>()));
  CHECK(first(extension + "SH_DEGREE_0_COEF_0") == g.sh[0][0][0].item<float>());
  // −C1 y changes its sign with y, and so does C1 z with z; the degree-2 product yz does not.
  CHECK(first(extension + "SH_DEGREE_1_COEF_0") == -g.sh[0][1][0].item<float>());
  CHECK(first(extension + "SH_DEGREE_2_COEF_1") == g.sh[0][5][0].item<float>());
}

TEST_CASE("gltf: nodes move their Gaussians", "[gaussians]") {
  GltfFixture fixture;
  // A quarter turn about y, a scale of two, and a parent's translation.
  const double half = std::sqrt(0.5);
  fixture.document["nodes"] = {
      {{"children", {1}}, {"translation", {1, 2, 3}}},
      {{"mesh", 0}, {"rotation", {0, half, 0, half}}, {"scale", {2, 2, 2}}}};
  const splat::Gaussians found = fixture.read();
  // In glTF's axes x → 2 z + 1, y → 2 y + 2, z → −2 x + 3.
  const torch::Tensor file = half_turn(fixture.gaussians).means;
  const torch::Tensor expected = torch::stack(
      {2 * file.select(1, 2) + 1, 2 * file.select(1, 1) + 2, -2 * file.select(1, 0) + 3}, 1);
  CHECK(torch::allclose(half_turn(found).means, expected, 1e-5, 1e-5));
  CHECK(
      torch::allclose(found.log_scales, fixture.gaussians.log_scales + std::log(2.0), 1e-5, 1e-5));
  // A matrix is written column by column.
  fixture.document["nodes"][1] = {{"mesh", 0},
                                  {"matrix", {0, 0, -2, 0, 0, 2, 0, 0, 2, 0, 0, 0, 0, 0, 0, 1}}};
  CHECK(torch::allclose(fixture.read().means, found.means, 1e-5, 1e-5));
  fixture.document["nodes"][1]["matrix"][0] = 1;
  CHECK_THROWS_WITH(fixture.read(), Catch::Contains("stretches"));
  fixture.document["nodes"][0]["children"] = {0};
  CHECK_THROWS_WITH(fixture.read(), Catch::Contains("node 0 in two places"));
}

TEST_CASE("gltf: shared and deep nodes end at once", "[gaussians]") {
  GltfFixture fixture;
  const auto chain = [&](int length, int copies) {
    json nodes = json::array();
    for (int i = 1; i < length; ++i) nodes.push_back({{"children", std::vector<int>(copies, i)}});
    nodes.push_back({{"mesh", 0}});
    fixture.document["nodes"] = nodes;
  };
  chain(10, 1);
  CHECK(fixture.read().size() == 30);
  chain(40, 2);  // 2^39 paths
  CHECK_THROWS_WITH(fixture.read(), Catch::Contains("node 39 in two places"));
  chain(1000, 1);
  CHECK_THROWS_WITH(fixture.read(), Catch::Contains("nested without end"));
}

TEST_CASE("gltf: the name of a buffer's file may have escapes", "[gaussians]") {
  GltfFixture fixture;
  std::filesystem::rename(fixture.dir / "a.bin", fixture.dir / "my scène 100%.bin");
  for (const char* const uri : {"my%20sc%C3%A8ne%20100%25.bin", "my scène 100%.bin"}) {
    INFO(uri);
    fixture.document["buffers"][0]["uri"] = uri;
    CHECK(fixture.read().size() == 30);
  }
  fixture.document["buffers"][0]["uri"] = "no%20scene.bin";
  CHECK_THROWS_WITH(fixture.read(), test::naming("a.gltf", "no scene.bin", "copy"));
}

TEST_CASE("gltf: two nodes with one mesh are twice as many Gaussians", "[gaussians]") {
  GltfFixture fixture;
  fixture.document["nodes"].push_back({{"mesh", 0}});
  fixture.document["scenes"][0]["nodes"] = {0, 1};
  CHECK(fixture.read().size() == 60);
}

TEST_CASE("gltf: only the first buffer of a .glb is its binary part", "[gaussians]") {
  const GltfFixture fixture;
  std::string content = read_file(fixture.dir / "a.glb");
  const std::string view = R"("buffer":0)";
  const size_t at = content.find(view);
  REQUIRE(at != std::string::npos);
  content.replace(at, view.size(), R"("buffer":1)");
  const std::string buffers = R"("buffers":[{)";
  const size_t list = content.find(buffers);
  REQUIRE(list != std::string::npos);
  // The spaces behind the JSON make room for a second buffer.
  const std::string added = R"("buffers":[{},{)";
  content.replace(list, buffers.size(), added);
  const size_t size = u32_at(content, 12) + added.size() - buffers.size();
  content[12] = static_cast<char>(size & 255u);
  content[13] = static_cast<char>(size >> 8 & 255u);
  write_file(fixture.dir / "b.glb", content);
  std::vector<std::string> notes;
  CHECK_THROWS_WITH(read_gltf(fixture.dir / "b.glb", notes),
                    Catch::Contains("buffer 1 without data"));
}

TEST_CASE("gltf: logits as opacities and logarithms as scales are refused", "[gaussians]") {
  for (const auto& [name, value, others] :
       {std::tuple{"OPACITY", -1.5f, "logits"}, std::tuple{"OPACITY", 255.f, "another scale"},
        std::tuple{"SCALE", -3.f, "logarithms"}}) {
    CAPTURE(name, value);
    const GltfFixture fixture;
    fixture.overwrite(fixture.accessor(name), 3, value);
    CHECK_THROWS_NAMING(DataError, fixture.read(), "a.gltf", name, "3 of", others, ".ply");
  }
}

TEST_CASE("gltf: a few opacities and scales out of range are noted", "[gaussians]") {
  GltfFixture fixture(200);
  CHECK(fixture.read().size() == 200);
  CHECK(fixture.notes.empty());
  fixture.overwrite(fixture.accessor("OPACITY"), 2, 1.0005f);
  fixture.read();
  CHECK(fixture.notes.empty());
  fixture.overwrite(fixture.accessor("OPACITY"), 2, 1.5f);
  fixture.overwrite(fixture.accessor("SCALE"), 1, -0.5f);
  const splat::Gaussians read = fixture.read();
  REQUIRE(fixture.notes.size() == 2);
  CHECK_THAT(fixture.notes[0], test::naming("a.gltf", "SCALE", "1 of 600", "-0.5", "not rendered"));
  CHECK_THAT(fixture.notes[1], test::naming("a.gltf", "OPACITY", "2 of 200", "1.5", "clamped"));
  CHECK(read.logit_opacities[0].sigmoid().item<float>() == 1);
}

TEST_CASE("gltf: copies and animations are noted", "[gaussians]") {
  GltfFixture fixture;
  fixture.document["animations"] = json::array();
  fixture.read();
  CHECK(fixture.notes.empty());
  fixture.document["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = {
      {"TRANSLATION", 0}};
  fixture.document["animations"].push_back({{"channels", json::array()}});
  CHECK(fixture.read().size() == 30);
  REQUIRE(fixture.notes.size() == 2);
  CHECK_THAT(fixture.notes[0], test::naming("a.gltf", "EXT_mesh_gpu_instancing", "not read"));
  CHECK_THAT(fixture.notes[1], test::naming("a.gltf", "animations", "not read"));
}

TEST_CASE("gltf: what is not read is named", "[gaussians]") {
  const auto told = [](const std::function<void(json&)>& change) {
    GltfFixture fixture;
    change(fixture.document);
    try {
      fixture.read();
    } catch (const DataError& error) {
      CHECK(std::string(error.what()).find('\n') == std::string::npos);
      return std::string(error.what());
    }
    return std::string();
  };
  const auto primitive = [](json& d) -> json& { return d["meshes"][0]["primitives"][0]; };
  CHECK_THAT(told([&](json& d) { primitive(d).erase("extensions"); }),
             Catch::Contains("no Gaussians"));
  CHECK_THAT(told([&](json& d) {
               primitive(d)["extensions"]["KHR_gaussian_splatting"]["extensions"] = {
                   {"KHR_gaussian_splatting_compression_spz_2", {{"bufferView", 0}}}};
             }),
             Catch::Contains("KHR_gaussian_splatting_compression_spz_2"));
  CHECK_THAT(told([&](json& d) {
               primitive(d)["extensions"]["KHR_gaussian_splatting"]["kernel"] = "box";
             }),
             Catch::Contains("kernel box"));
  CHECK_THAT(told([&](json& d) {
               primitive(d)["extensions"]["KHR_gaussian_splatting"]["colorSpace"] =
                   "lin_rec709_display";
             }),
             test::naming("lin_rec709_display", "srgb_rec709_display"));
  CHECK_THAT(told([&](json& d) {
               primitive(d)["attributes"]["KHR_gaussian_splatting:SH_DEGREE_4_COEF_0"] = 0;
             }),
             Catch::Contains("SH degree 4"));
  CHECK_THAT(
      told([&](json& d) { primitive(d)["attributes"].erase("KHR_gaussian_splatting:SCALE"); }),
      Catch::Contains("no attribute KHR_gaussian_splatting:SCALE"));
  CHECK_THAT(told([](json& d) { d["accessors"][0]["count"] = 1000000000; }),
             Catch::Contains("beyond the end"));
  CHECK_THAT(told([](json& d) { d["bufferViews"][0]["byteOffset"] = 1u << 31; }),
             Catch::Contains("beyond the end"));
  CHECK_THAT(told([](json& d) { d["buffers"][0]["uri"] = "data:text"; }), Catch::Contains(".glb"));
  CHECK_THAT(told([](json& d) { d["accessors"] = "none"; }), Catch::Contains("missing"));
  for (const char* const name : {"matrix", "translation", "rotation", "scale"}) {
    CHECK_THAT(told([&](json& d) { d["nodes"][0][name] = {1, 2}; }), test::naming(name, "2"));
  }
  CHECK_THAT(told([](json& d) {
               d["nodes"][0]["rotation"] = {0, 0, 0, 0};
             }),
             Catch::Contains("zero quaternion"));
  for (const char* const coefficient : {"1_COEF_0", "1_COEF_2", "2_COEF_4"}) {
    const std::string name = std::string("KHR_gaussian_splatting:SH_DEGREE_") + coefficient;
    CHECK_THAT(told([&](json& d) { primitive(d)["attributes"].erase(name); }),
               Catch::Contains("no attribute " + name));
  }
  CHECK_THAT(told([](json& d) {
               d["extensionsRequired"] = {"KHR_gaussian_splatting", "EXT_meshopt_compression"};
             }),
             Catch::Contains("EXT_meshopt_compression"));
  CHECK_THAT(told([](json& d) { d["buffers"][0].erase("uri"); }),
             Catch::Contains("buffer 0 without data"));
}

}  // namespace
}  // namespace jade::gaussians
