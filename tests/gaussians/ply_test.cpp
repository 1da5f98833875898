// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/ply.h"

#include "support/catch.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <sstream>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/gaussians/ply_header.h"
#include "jade/gaussians/ply_kind.h"
#include "jade/gaussians/summary.h"
#include "jade/geometry/origin.h"
#include "random_gaussians.h"
#include "support/naming.h"
#include "support/temp_dir.h"

namespace jade::gaussians {
namespace {

using test::random_gaussians;

void check_same_bits(const splat::Gaussians& a, const splat::Gaussians& b) {
  for (int i = 0; i < kParameterCount; ++i) CHECK(torch::equal(parameter(a, i), parameter(b, i)));
}

/// The values of one Gaussian by property name.
std::vector<std::pair<std::string, float>> named_values(const splat::Gaussians& g, int64_t row) {
  std::vector<std::pair<std::string, float>> values;
  const auto put = [&](const std::string& name, const torch::Tensor& value) {
    values.emplace_back(name, value.item<float>());
  };
  for (int i = 0; i < 3; ++i) {
    put(std::string(1, "xyz"[i]), g.means[row][i]);
    put(concat("f_dc_", i), g.sh[row][0][i]);
    put(concat("scale_", i), g.log_scales[row][i]);
  }
  for (int i = 0; i < 4; ++i) put(concat("rot_", i), g.rotations[row][i]);
  put("opacity", g.logit_opacities[row]);
  const int64_t rest = g.sh.size(1) - 1;
  for (int64_t c = 0; c < 3; ++c) {
    for (int64_t k = 0; k < rest; ++k) put(concat("f_rest_", c * rest + k), g.sh[row][k + 1][c]);
  }
  return values;
}

template <class T>
void append(std::string& out, T value, bool swap) {
  char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof(T));
  if (swap) std::reverse(bytes, bytes + sizeof(T));
  out.append(bytes, sizeof(T));
}

/// A file with its properties in reverse order, doubles among floats, and unknown properties and
/// elements.
std::string shuffled_file(const splat::Gaussians& g, const std::string& format) {
  std::ostringstream text;
  text << "ply\r\nformat " << format << " 1.0\nobj_info made by hand\ncomment hello\n"
       << "element camera 1\nproperty list uchar int ids\nelement vertex " << g.size() << "\n";
  std::vector<size_t> order;
  const size_t count = named_values(g, 0).size();
  for (size_t i = 0; i < count; ++i) order.push_back((i * 7 + 3) % count);
  for (const size_t i : order) {
    text << "property " << (i % 2 ? "double " : "float ") << named_values(g, 0)[i].first << "\n";
  }
  text << "property uchar unknown\nend_header\n";
  const bool swap = format == "binary_big_endian";
  if (format == "ascii") text << "2 7 8\n";
  std::string binary;
  append<uint8_t>(binary, 2, swap);
  append<int32_t>(binary, 7, swap);
  append<int32_t>(binary, 8, swap);
  text.precision(9);
  for (int64_t row = 0; row < g.size(); ++row) {
    const auto values = named_values(g, row);
    for (const size_t i : order) {
      if (i % 2) append<double>(binary, static_cast<double>(values[i].second), swap);
      if (i % 2 == 0) append<float>(binary, values[i].second, swap);
      if (format == "ascii") text << values[i].second << " ";
    }
    append<uint8_t>(binary, 9, swap);
    if (format == "ascii") text << "9\n";
  }
  return format == "ascii" ? text.str() : text.str() + binary;
}

std::string message_of(const std::filesystem::path& path) {
  try {
    read_ply(path);
  } catch (const DataError& error) {
    return error.what();
  }
  return "no error";
}

TEST_CASE("ply: what was written is read back bit by bit, at every SH degree", "[gaussians]") {
  const test::TempDir folder;
  for (const int64_t coefficients : {1, 4, 9, 16}) {
    for (const bool antialiased : {false, true}) {
      const splat::Gaussians g = random_gaussians(37, coefficients);
      write_ply(folder / "a.ply", {g, antialiased});
      const GaussianFile read = read_ply(folder / "a.ply");
      check_same_bits(read.gaussians, g);
      CHECK(read.antialiased == antialiased);
      CHECK(has_gaussians(folder / "a.ply"));
    }
  }
}

TEST_CASE("ply: an infinite opacity is read as full or none, NaN stays", "[gaussians]") {
  const test::TempDir folder;
  splat::Gaussians g = random_gaussians(4, 1);
  const float infinity = std::numeric_limits<float>::infinity();
  const torch::Tensor written = torch::tensor({infinity, -infinity, std::nanf(""), 2.5F});
  g.logit_opacities = written;
  write_ply(folder / "a.ply", {g, false});
  const torch::Tensor read = read_ply(folder / "a.ply").gaussians.logit_opacities;
  CHECK(read.isfinite().equal(torch::tensor({true, true, false, true})));
  CHECK(torch::sigmoid(read[0]).item<float>() == 1.0F);
  CHECK(torch::sigmoid(read[1]).item<float>() < 1e-12F);
  CHECK(read[3].item<float>() == 2.5F);
}

TEST_CASE("ply: numbers as text may have a plus, and may be too small or large for a float",
          "[gaussians]") {
  const test::TempDir folder;
  const auto read = [&](const std::string& x) {
    folder.write("a.ply",
                 "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
                 "property float z\nend_header\n" +
                     x + " 2 3\n");
    return PlyFile(folder / "a.ply").read_vertices({"x", "y", "z"});
  };
  CHECK(read("+1.5")[0][0].item<float>() == 1.5F);
  CHECK(read("1e-50")[0][0].item<float>() == 0);
  CHECK(read("-1e50")[0][0].item<float>() == -std::numeric_limits<float>::infinity());
  CHECK_THROWS_NAMING(DataError, read("+-1"), "row 0");
}

TEST_CASE("ply: zero Gaussians make a valid file, from which nothing can begin", "[gaussians]") {
  const test::TempDir folder;
  write_ply(folder / "a.ply", {random_gaussians(0, 16), false});
  const splat::Gaussians none = read_ply(folder / "a.ply").gaussians;
  CHECK(none.size() == 0);
  CHECK_THROWS_WITH(check_some(none, "a.ply"), "a.ply: expected Gaussians, found none");
  splat::Gaussians lost = random_gaussians(3, 1);
  lost.means.select(1, 2).fill_(std::nanf(""));
  CHECK_THROWS_NAMING(DataError, check_some(lost, "a.ply"), "positions", "none of 3");
  lost.means[1].fill_(0);
  CHECK_NOTHROW(check_some(lost, "a.ply"));
  lost.rotations[1].zero_();
  CHECK_THROWS_NAMING(DataError, check_some(lost, "a.ply"), "a.ply", "none of 3");
}

TEST_CASE("ply: f_rest is channel-major, red first", "[gaussians]") {
  const test::TempDir folder;
  splat::Gaussians g = random_gaussians(1, 4);
  write_ply(folder / "a.ply", {g, false});
  const std::string content = read_file(folder / "a.ply");
  const size_t data = content.find("end_header\n") + 11;
  float rest[9];
  std::memcpy(rest, content.data() + data + 9 * sizeof(float), sizeof(rest));
  CHECK(rest[1] == g.sh[0][2][0].item<float>());
  CHECK(rest[3] == g.sh[0][1][1].item<float>());
}

TEST_CASE("ply: a missing coefficient is named, and does not lower the SH degree", "[gaussians]") {
  const test::TempDir folder;
  write_ply(folder / "a.ply", {random_gaussians(3, 16)});
  std::string content = read_file(folder / "a.ply");
  const std::string name = "f_rest_9\n";
  content.replace(content.find(name), name.size(), "unknown9\n");
  write_file(folder / "b.ply", content);
  CHECK_THAT(message_of(folder / "b.ply"), test::naming("b.ply", "found 44"));
}

TEST_CASE("ply: any property order, type, byte order and ascii give the same Gaussians",
          "[gaussians]") {
  const test::TempDir folder;
  const splat::Gaussians g = random_gaussians(5, 9);
  for (const std::string format : {"ascii", "binary_little_endian", "binary_big_endian"}) {
    write_file(folder / "b.ply", shuffled_file(g, format));
    check_same_bits(read_ply(folder / "b.ply").gaussians, g);
  }
}

TEST_CASE("ply: a file cut anywhere is refused by name", "[gaussians]") {
  const test::TempDir folder;
  write_ply(folder / "a.ply", {random_gaussians(3, 16), false});
  const std::string whole = read_file(folder / "a.ply");
  for (size_t size = 0; size < whole.size(); size += 13) {
    write_file(folder / "cut.ply", whole.substr(0, size));
    CHECK(message_of(folder / "cut.ply").find("cut.ply") != std::string::npos);
  }
}

TEST_CASE("ply: a header that claims too many vertices allocates nothing", "[gaussians]") {
  const test::TempDir folder;
  write_ply(folder / "a.ply", {random_gaussians(3, 1), false});
  std::string content = read_file(folder / "a.ply");
  content.replace(content.find("vertex 3"), 8, "vertex 4000000000000");
  write_file(folder / "a.ply", content);
  CHECK(message_of(folder / "a.ply").find("cut short") != std::string::npos);
}

TEST_CASE("ply: rows without properties are passed over, however many", "[gaussians]") {
  const test::TempDir folder;
  const splat::Gaussians some = random_gaussians(3, 1);
  write_ply(folder / "a.ply", {some, false});
  std::string content = read_file(folder / "a.ply");
  content.insert(content.find("element vertex"), "element nothing 9000000000000000000\n");
  write_file(folder / "a.ply", content);
  check_same_bits(read_ply(folder / "a.ply").gaussians, some);
}

TEST_CASE("ply: foreign files are refused with what was expected", "[gaussians]") {
  const test::TempDir folder;
  CHECK_THROWS_AS(read_ply(folder / "missing.ply"), DataError);
  const std::string head = "ply\nformat ascii 1.0\n";
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"PNG", "no .ply"},
      {"ply\nformat binary_middle_endian 1.0\nend_header\n", "binary_middle_endian"},
      {"ply\nelement vertex 0\nproperty float x\nend_header\n", "format"},
      {head + "element face 0\nproperty list uchar int i\nend_header\n", "vertex"},
      {head + "element vertex 1\nproperty half x\nend_header\n1\n", "half"},
      {head + "element vertex 1\nproperty list uchar int x\nend_header\n1 1\n", "list"},
      {head + "element vertex -1\nend_header\n", "bad header"},
      {head + "property float x\nend_header\n", "before the first element"},
      {head + "element vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
              "end_header\n1 2 3\n",
       "3DGS"}};
  for (const auto& [content, expected] : cases) {
    write_file(folder / "f.ply", content);
    INFO(content);
    CHECK(message_of(folder / "f.ply").find(expected) != std::string::npos);
  }
}

TEST_CASE("ply: a text where a number should be is named", "[gaussians]") {
  const test::TempDir folder;
  std::string content = shuffled_file(random_gaussians(1, 4), "ascii");
  const size_t data = content.find("2 7 8\n") + 6;
  content.replace(data, 1, "q");
  write_file(folder / "a.ply", content);
  CHECK(message_of(folder / "a.ply").find("expected a number") != std::string::npos);
}

TEST_CASE("ply: plain point clouds come with their colours", "[gaussians]") {
  const test::TempDir folder;
  const std::string head =
      "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
      "property float z\n";
  write_file(folder / "p.ply", head +
                                   "property uchar red\nproperty uchar green\n"
                                   "property uchar blue\nend_header\n1 2 3 255 0 51\n");
  const PointCloud cloud = read_point_cloud(folder / "p.ply");
  CHECK(torch::equal(cloud.points, torch::tensor({{1.f, 2.f, 3.f}})));
  CHECK(torch::allclose(cloud.colors, torch::tensor({{1.f, 0.f, 0.2f}})));
  CHECK_FALSE(has_gaussians(folder / "p.ply"));
  write_file(folder / "q.ply", head + "end_header\n1 2 3\n");
  CHECK(torch::equal(read_point_cloud(folder / "q.ply").colors, torch::full({1, 3}, 0.5f)));
}

TEST_CASE("ply: a scene of its own origin keeps it, in either coordinates", "[gaussians]") {
  const test::TempDir folder;
  GaussianFile file{random_gaussians(50, 16), false, {471234.5, 5431987, 312}};
  write_ply(folder / "own.ply", file);
  const GaussianFile own = read_ply(folder / "own.ply");
  check_same_bits(own.gaussians, file.gaussians);
  CHECK(own.origin == file.origin);
  CHECK(read_file(folder / "own.ply").find("comment origin 471234.5 5431987 312\n") !=
        std::string::npos);

  write_ply(folder / "dataset.ply", file, PlyCoordinates::kDataset);
  const torch::Tensor exact =
      PlyFile(folder / "dataset.ply").read_vertices({"x", "y", "z"}, torch::kFloat64);
  CHECK((exact[7][1] - 5431987 - file.gaussians.means[7][1].to(torch::kFloat64))
            .abs()
            .item<double>() < 1e-8);
  // A reader finds an origin near the scene again.
  const GaussianFile back = read_ply(folder / "dataset.ply");
  CHECK_FALSE(geometry::is_zero(back.origin));
  for (int64_t axis = 0; axis < 3; ++axis) {
    const double want = file.gaussians.means[7][axis].item<double>() + file.origin[size_t(axis)];
    CHECK(back.gaussians.means[7][axis].item<double>() + back.origin[size_t(axis)] ==
          Approx(want).margin(1e-5));
  }
  CHECK(torch::equal(back.gaussians.sh, file.gaussians.sh));

  file.origin = {0, 0, 0};
  write_ply(folder / "plain.ply", file);
  write_ply(folder / "same.ply", file, PlyCoordinates::kDataset);
  CHECK(read_file(folder / "plain.ply") == read_file(folder / "same.ply"));
  CHECK(geometry::is_zero(read_ply(folder / "plain.ply").origin));
}

TEST_CASE("ply: points in map coordinates are moved in double", "[gaussians]") {
  const test::TempDir folder;
  write_file(folder / "far.ply",
             "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\n"
             "property double z\nend_header\n471234.5625 5431987.25 312\n471235.5 5431988 313\n"
             "471236.5 5431989 311\n");
  const PointCloud cloud = read_point_cloud(folder / "far.ply");
  CHECK(cloud.points[0][0].item<double>() + cloud.origin[0] == 471234.5625);
  CHECK(cloud.points[0][1].item<double>() + cloud.origin[1] == 5431987.25);
}

/// A binary file of one element of float32 properties.
void write_rows(const std::filesystem::path& path, const std::vector<std::string>& names,
                const torch::Tensor& rows, const std::string& last = "") {
  std::string text =
      concat("ply\nformat binary_little_endian 1.0\nelement vertex ", rows.size(0), "\n");
  for (const std::string& name : names) text += "property float " + name + "\n";
  text += last + "end_header\n";
  const torch::Tensor bytes = rows.to(torch::kFloat32).contiguous();
  text.append(static_cast<const char*>(bytes.data_ptr()), bytes.nbytes());
  write_file(path, text);
}

/// The properties and rows of Gaussians of degree 0.
const std::vector<std::string> kNames = {"x",      "y",       "z",       "f_dc_0",  "f_dc_1",
                                         "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2",
                                         "rot_0",  "rot_1",   "rot_2",   "rot_3"};
torch::Tensor rows_of(const splat::Gaussians& g) {
  return torch::cat(
      {g.means, g.sh.select(1, 0), g.logit_opacities.unsqueeze(1), g.log_scales, g.rotations}, 1);
}

TEST_CASE("ply: integers in place of logits, logarithms and SH are refused", "[gaussians]") {
  const test::TempDir folder;
  const auto told = [&](const std::string& changed, const std::string& type) {
    std::string text = "ply\nformat ascii 1.0\nelement vertex 1\n";
    for (const std::string& name : kNames) {
      text += concat("property ", name == changed ? type : "float", " ", name, "\n");
    }
    write_file(folder / "a.ply", text + "end_header\n0 0 1 0 0 0 2 0 0 0 1 0 0 0\n");
    return message_of(folder / "a.ply");
  };
  for (const std::string name : {"opacity", "f_dc_1", "scale_0"}) {
    for (const std::string type : {"uchar", "ushort", "int"}) {
      CHECK_THAT(told(name, type), test::naming("a.ply", name, "float", "integers"));
    }
  }
  CHECK_THAT(told("rot_0", "uchar"), test::naming("rot_0", "float"));
  CHECK(told("rot_0", "char") == "no error");
  CHECK(told("x", "int") == "no error");
}

TEST_CASE("ply: opacities and scales that look like no logits and logarithms are noted",
          "[gaussians]") {
  const test::TempDir folder;
  const splat::Gaussians usual = random_gaussians(400, 1);
  const auto notes_of = [&](const splat::Gaussians& g) {
    write_rows(folder / "a.ply", kNames, rows_of(g));
    return read_scene(folder / "a.ply").notes;
  };
  const auto with_opacity = [&](const torch::Tensor& values) {
    splat::Gaussians g = usual;
    g.logit_opacities = values;
    return notes_of(g);
  };
  const auto with_scales = [&](const torch::Tensor& values, double units) {
    splat::Gaussians g = usual;
    g.means = g.means * units;
    g.log_scales = values;
    return notes_of(g);
  };
  CHECK(notes_of(usual).empty());
  const torch::Tensor shares = torch::linspace(0.02, 0.99, 400);
  for (const double full : {1.0, 100.0, 255.0}) {
    const std::vector<std::string> notes = with_opacity(full * shares);
    REQUIRE(notes.size() == 1);
    CHECK_THAT(notes[0], test::naming("a.ply", "opacity", "logits"));
  }
  CHECK(with_opacity(torch::full({400}, 0.5)).empty());
  CHECK(with_opacity(20 * shares).empty());
  // Lengths as they are, in a scene of a few units and in one of hundreds.
  for (const double units : {1.0, 100.0}) {
    const std::vector<std::string> notes = with_scales(4 * units * usual.log_scales.exp(), units);
    REQUIRE(notes.size() == 1);
    CHECK_THAT(notes[0], test::naming("a.ply", "scale", "logarithms"));
  }
  // Scenes in millimetres, whose logarithms are positive.
  for (const double units : {100.0, 1000.0, 100000.0}) {
    CHECK(with_scales(torch::full({400, 3}, std::log(0.2 * units)), units).empty());
  }
}

TEST_CASE("ply: the two scales of 2DGS become flat Gaussians, and so does minus infinity",
          "[gaussians]") {
  const test::TempDir folder;
  splat::Gaussians g = random_gaussians(6, 1);
  write_rows(folder / "2d.ply",
             {"x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "rot_0",
              "rot_1", "rot_2", "rot_3"},
             torch::cat({g.means, g.sh.select(1, 0), g.logit_opacities.unsqueeze(1),
                         g.log_scales.narrow(1, 0, 2), g.rotations},
                        1));
  g.log_scales.select(1, 2).fill_(-std::numeric_limits<float>::infinity());
  write_ply(folder / "3d.ply", {g, false});
  CHECK(kind_of(folder / "2d.ply") == PlyKind::kFlat);
  CHECK(kind_of(folder / "3d.ply") == PlyKind::kGaussians);
  for (const char* name : {"2d.ply", "3d.ply"}) {
    const PlyScene read = read_scene(folder / name);
    CHECK(read.flat == 6);
    CHECK(drawable(read.file.gaussians).size() == 6);
    const torch::Tensor scales = read.file.gaussians.log_scales;
    CHECK(torch::equal(scales.narrow(1, 0, 2), g.log_scales.narrow(1, 0, 2)));
    CHECK(torch::allclose(scales.select(1, 2),
                          std::get<0>(g.log_scales.narrow(1, 0, 2).min(1)) - 6.9));
  }
  // Flat along every axis, or with a finite number beyond what is rendered.
  g.log_scales[1].fill_(-100);
  write_ply(folder / "point.ply", {g, false});
  CHECK(drawable(read_ply(folder / "point.ply").gaussians).size() == 6);
}

TEST_CASE("ply: Gaussians with red, green, blue have the colours of f_dc", "[gaussians]") {
  const test::TempDir folder;
  const splat::Gaussians g = random_gaussians(3, 1);
  const torch::Tensor rgb = torch::tensor({{0.f, 0.5f, 1.f}, {0.2f, 0.4f, 0.6f}, {1.f, 1.f, 1.f}});
  const torch::Tensor rows =
      torch::cat({g.means, rgb, g.logit_opacities.unsqueeze(1), g.log_scales, g.rotations}, 1);
  const std::vector<std::string> rest = {"opacity", "scale_0", "scale_1", "scale_2",
                                         "rot_0",   "rot_1",   "rot_2",   "rot_3"};
  for (const std::string prefix : {"", "diffuse_"}) {
    std::vector<std::string> names = {"x", "y", "z"};
    for (const char* color : {"red", "green", "blue"}) names.push_back(prefix + color);
    names.insert(names.end(), rest.begin(), rest.end());
    write_rows(folder / "rgb.ply", names, rows);
    CHECK(kind_of(folder / "rgb.ply") == PlyKind::kColored);
    const splat::Gaussians read = read_ply(folder / "rgb.ply").gaussians;
    CHECK(torch::allclose(read.sh.select(1, 0) * 0.28209479 + 0.5, rgb, 1e-5, 1e-6));
    CHECK(torch::equal(read.log_scales, g.log_scales));
  }
}

TEST_CASE("ply: colours of Gaussians as floats up to 255 are scaled with a note", "[gaussians]") {
  const test::TempDir folder;
  const splat::Gaussians g = random_gaussians(3, 1);
  const torch::Tensor rgb = torch::tensor({{0.f, 0.5f, 1.f}, {0.2f, 0.4f, 0.6f}, {1.f, 1.f, 1.f}});
  const std::vector<std::string> names = {"x",     "y",       "z",       "red",     "green",
                                          "blue",  "opacity", "scale_0", "scale_1", "scale_2",
                                          "rot_0", "rot_1",   "rot_2",   "rot_3"};
  const auto read = [&](const torch::Tensor& colors) {
    write_rows(
        folder / "rgb.ply", names,
        torch::cat({g.means, colors, g.logit_opacities.unsqueeze(1), g.log_scales, g.rotations},
                   1));
    return read_scene(folder / "rgb.ply");
  };
  for (const float brightest : {255.f, 65535.f}) {
    const PlyScene scene = read(rgb * brightest);
    CHECK(
        torch::allclose(scene.file.gaussians.sh.select(1, 0) * 0.28209479 + 0.5, rgb, 1e-4, 1e-5));
    REQUIRE(scene.notes.size() == 1);
    CHECK_THAT(scene.notes[0], test::naming("rgb.ply", "red", "divided by"));
  }
  // Unclamped colours.
  const PlyScene bright = read(rgb * 1.2);
  CHECK(bright.notes.empty());
  CHECK(torch::allclose(bright.file.gaussians.sh.select(1, 0) * 0.28209479 + 0.5, rgb * 1.2, 1e-4,
                        1e-5));
  CHECK_THROWS_AS(read(rgb * 1e6), DataError);
  CHECK_THAT(message_of(folder / "rgb.ply"), test::naming("65535", "export"));
}

TEST_CASE("ply: the 3D smoothing filter of Mip-Splatting is applied with a note", "[gaussians]") {
  const test::TempDir folder;
  const splat::Gaussians g = random_gaussians(5, 1);
  const torch::Tensor filter = torch::tensor({0.f, 0.01f, 0.1f, 0.3f, 1.f}).unsqueeze(1);
  write_rows(folder / "mip.ply",
             {"x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1",
              "scale_2", "rot_0", "rot_1", "rot_2", "rot_3", "filter_3D"},
             torch::cat({g.means, g.sh.select(1, 0), g.logit_opacities.unsqueeze(1), g.log_scales,
                         g.rotations, filter},
                        1));
  const PlyScene scene = read_scene(folder / "mip.ply");
  const splat::Gaussians& read = scene.file.gaussians;
  const torch::Tensor s = g.log_scales.exp(), smooth = (s.square() + filter.square()).sqrt();
  CHECK(torch::allclose(read.log_scales.exp(), smooth, 1e-4, 1e-6));
  CHECK(torch::allclose(read.logit_opacities.sigmoid(),
                        g.logit_opacities.sigmoid() * (s / smooth).prod(1), 1e-4, 1e-6));
  CHECK(torch::equal(read.log_scales[0], g.log_scales[0]));
  CHECK(torch::equal(read.logit_opacities[0], g.logit_opacities[0]));
  REQUIRE(scene.notes.size() == 1);
  CHECK_THAT(scene.notes[0], test::naming("mip.ply", "filter_3D", "applied"));
}

TEST_CASE("ply: Gaussians of a scene that moves are noted", "[gaussians]") {
  const test::TempDir folder;
  const splat::Gaussians g = random_gaussians(5, 1);
  for (const std::vector<std::string>& more :
       {std::vector<std::string>{"trbf_center", "trbf_scale", "motion_0", "omega_0"},
        std::vector<std::string>{"t", "scale_t", "rot_r_0"}}) {
    std::vector<std::string> names = kNames;
    names.insert(names.end(), more.begin(), more.end());
    write_rows(folder / "moves.ply", names,
               torch::cat({rows_of(g), torch::zeros({5, int64_t(more.size())})}, 1));
    const PlyScene scene = read_scene(folder / "moves.ply");
    CHECK(torch::equal(scene.file.gaussians.rotations, g.rotations));
    REQUIRE(scene.notes.size() == 1);
    CHECK_THAT(scene.notes[0],
               test::naming("moves.ply", more.back(), "moves", "export one moment"));
  }
}

TEST_CASE("ply: rows behind those that the header promises are named", "[gaussians]") {
  const test::TempDir folder;
  const splat::Gaussians g = random_gaussians(6, 4);
  for (const std::string format : {"ascii", "binary_little_endian", "binary_big_endian"}) {
    INFO(format);
    std::string text = shuffled_file(g, format);
    write_file(folder / "a.ply", text);
    CHECK(read_scene(folder / "a.ply").notes.empty());
    write_file(folder / "a.ply", text + "\n");
    CHECK(read_scene(folder / "a.ply").notes.empty());
    text.replace(text.find("vertex 6"), 8, "vertex 2");
    write_file(folder / "a.ply", text);
    const PlyScene scene = read_scene(folder / "a.ply");
    CHECK(scene.file.gaussians.size() == 2);
    REQUIRE(scene.notes.size() == 1);
    CHECK_THAT(scene.notes[0], test::naming("a.ply", "2 'vertex'", "4 rows"));
  }
}

/// `value` in [0,1] in `bits` bits.
uint32_t bits_of(double value, int bits) {
  return static_cast<uint32_t>(std::lround(value * ((1 << bits) - 1)));
}

TEST_CASE("ply: the compressed files of PlayCanvas and SuperSplat are unpacked", "[gaussians]") {
  const test::TempDir folder;
  constexpr int64_t kCount = 300;  // two chunks
  const splat::Gaussians g = random_gaussians(kCount, 4);
  const torch::Tensor turn = g.rotations / g.rotations.norm(2, 1, true);
  const auto range = [&](const torch::Tensor& values, int64_t chunk) {
    const torch::Tensor rows = values.slice(0, 256 * chunk, std::min(256 * (chunk + 1), kCount));
    return std::pair(std::get<0>(rows.min(0)), std::get<0>(rows.max(0)));
  };
  std::string text = concat("ply\nformat binary_little_endian 1.0\nelement chunk 2\n");
  for (const char* part : {"", "scale_"}) {
    for (const char* end : {"min_", "max_"}) {
      for (const char* axis : {"x", "y", "z"})
        text += concat("property float ", end, part, axis, "\n");
    }
  }
  text += concat("element vertex ", kCount, "\n");
  for (const char* name : {"position", "rotation", "scale", "color"})
    text += concat("property uint packed_", name, "\n");
  text += concat("element sh ", kCount, "\n");
  for (int i = 0; i < 9; ++i) text += concat("property uchar f_rest_", i, "\n");
  std::string bytes;
  for (int64_t chunk = 0; chunk < 2; ++chunk) {
    for (const torch::Tensor& values : {g.means, g.log_scales}) {
      const auto [low, high] = range(values, chunk);
      for (const torch::Tensor& end : {low, high}) {
        for (int64_t i = 0; i < 3; ++i) append<float>(bytes, end[i].item<float>(), false);
      }
    }
  }
  for (int64_t row = 0; row < kCount; ++row) {
    const auto triple = [&](const torch::Tensor& values) {
      const auto [low, high] = range(values, row / 256);
      const torch::Tensor unit = (values[row] - low) / (high - low);
      return bits_of(unit[0].item<double>(), 11) << 21 | bits_of(unit[1].item<double>(), 10) << 11 |
             bits_of(unit[2].item<double>(), 11);
    };
    const auto largest = turn[row].abs().argmax().item<int64_t>();
    const double sign = turn[row][largest].item<double>() < 0 ? -1 : 1;
    auto rotation = static_cast<uint32_t>(largest);
    for (int64_t i = 0; i < 4; ++i) {
      if (i == largest) continue;
      const double part = sign * turn[row][i].item<double>() / std::sqrt(2.0) + 0.5;
      rotation = rotation << 10 | bits_of(part, 10);
    }
    uint32_t color = 0;
    for (int64_t i = 0; i < 3; ++i) {
      const double value = 0.28209479 * g.sh[row][0][i].item<double>() + 0.5;
      color = color << 8 | bits_of(std::clamp(value, 0.0, 1.0), 8);
    }
    color = color << 8 | bits_of(g.logit_opacities[row].sigmoid().item<double>(), 8);
    for (const uint32_t word : {triple(g.means), rotation, triple(g.log_scales), color})
      append<uint32_t>(bytes, word, false);
  }
  for (int64_t row = 0; row < kCount; ++row) {
    for (int64_t i = 0; i < 9; ++i) {
      const double value = g.sh[row][1 + i % 3][i / 3].item<double>();
      append<uint8_t>(bytes, uint8_t(std::clamp(std::floor((value / 8 + 0.5) * 256), 0.0, 255.0)),
                      false);
    }
  }
  write_file(folder / "a.compressed.ply", text + "end_header\n" + bytes);
  CHECK(kind_of(folder / "a.compressed.ply") == PlyKind::kPacked);
  const splat::Gaussians r = read_ply(folder / "a.compressed.ply").gaussians;
  const auto far = [](const torch::Tensor& a, const torch::Tensor& b) {
    return (a - b).abs().max().item<double>();
  };
  const auto step = [](const torch::Tensor& values) {
    return (values.max() - values.min()).item<double>() / 1023;
  };
  CHECK(far(r.means, g.means) <= step(g.means));
  CHECK(far(r.log_scales, g.log_scales) <= step(g.log_scales));
  const torch::Tensor same = (r.rotations * turn).sum(1).abs();
  CHECK(same.min().item<double>() > 0.999);
  CHECK(far(r.logit_opacities.sigmoid(), g.logit_opacities.sigmoid()) < 0.003);
  const auto shown = [](const torch::Tensor& sh) {
    return (0.28209479 * sh.select(1, 0) + 0.5).clamp(0, 1);
  };
  CHECK(far(shown(r.sh), shown(g.sh)) < 0.003);
  CHECK(far(r.sh.slice(1, 1), g.sh.slice(1, 1).clamp(-4, 4)) < 0.02);
  write_file(folder / "cut.ply", text + "end_header\n" + bytes.substr(0, bytes.size() - 1));
  CHECK_THAT(message_of(folder / "cut.ply"), test::naming("cut.ply", "cut short"));
  std::string few = text;
  few.replace(few.find("chunk 2"), 7, "chunk 1");
  write_file(folder / "few.ply", few + "end_header\n" + bytes);
  CHECK_THAT(message_of(folder / "few.ply"), test::naming("few.ply", "256"));
}

TEST_CASE("ply: what a file without Gaussians is, or lacks, is named", "[gaussians]") {
  const test::TempDir folder;
  const torch::Tensor rows = torch::zeros({2, 9});
  write_rows(folder / "some.ply",
             {"x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "rot_0", "rot_1", "rot_2"}, rows);
  CHECK_THAT(message_of(folder / "some.ply"),
             test::naming("opacity, scale_0, scale_1, scale_2, rot_3"));
  write_rows(folder / "mesh.ply", {"x", "y", "z"}, rows.narrow(1, 0, 3),
             "element face 1\nproperty list uchar int vertex_indices\n");
  CHECK(kind_of(folder / "mesh.ply") == PlyKind::kMesh);
  CHECK_THAT(message_of(folder / "mesh.ply"), test::naming("mesh.ply", "a mesh"));
  write_rows(folder / "cloud.ply", {"x", "y", "z", "opacity"}, rows.narrow(1, 0, 4));
  CHECK(kind_of(folder / "cloud.ply") == PlyKind::kPoints);
  CHECK_THAT(message_of(folder / "cloud.ply"), test::naming("cloud.ply", "a point cloud"));
}

}  // namespace
}  // namespace jade::gaussians
