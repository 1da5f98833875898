// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/spz_file.h"

#include "support/catch.h"

#include <cmath>
#include <functional>
#include <limits>
#include <zlib.h>

#include "file_bytes.h"
#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/log.h"
#include "jade/gaussians/gaussian_model.h"
#include "jade/io/gzip.h"
#include "random_gaussians.h"
#include "support/naming.h"
#include "support/temp_dir.h"

namespace jade::gaussians {
namespace {

using test::byte_at;
using test::random_gaussians;

std::string gunzip(const std::filesystem::path& path) {
  gzFile file = gzopen(path.c_str(), "rb");
  REQUIRE(file != nullptr);
  std::string content(1 << 20, '\0');
  const int size = gzread(file, content.data(), static_cast<unsigned>(content.size()));
  gzclose(file);
  REQUIRE(size > 0);
  content.resize(static_cast<size_t>(size));
  return content;
}

/// A file of degree 0 with the degree 4 in its header and `rest` bytes of SH.
std::string of_degree_4(const std::string& packed, size_t rest) {
  std::string content = io::gunzip(packed, "");
  content[12] = 4;
  return io::gzip(content + std::string(rest, '\x80'));
}

double fixed24(const std::string& content, size_t at, int bits) {
  int value = byte_at(content, at) | byte_at(content, at + 1) << 8 | byte_at(content, at + 2) << 16;
  if (value & 0x800000) value -= 0x1000000;
  return std::ldexp(static_cast<double>(value), -bits);
}

TEST_CASE("spz file: header and attributes decode to the Gaussians within their steps",
          "[gaussians]") {
  const test::TempDir folder;
  for (const int64_t coefficients : {1, 4, 9, 16}) {
    const splat::Gaussians g = random_gaussians(6, coefficients);
    write_spz(folder / "a.spz", g, {true, 12});
    const std::string content = gunzip(folder / "a.spz");
    const auto rest = static_cast<size_t>(3 * (coefficients - 1));
    REQUIRE(content.size() == 16 + 6 * (9 + 1 + 3 + 3 + 3 + rest));
    CHECK(content.substr(0, 4) == "NGSP");
    CHECK(byte_at(content, 4) == 2);
    CHECK(byte_at(content, 8) == 6);
    CHECK((byte_at(content, 12) + 1) * (byte_at(content, 12) + 1) == coefficients);
    CHECK(byte_at(content, 13) == 12);
    CHECK(byte_at(content, 14) == 1);
    const size_t alphas = 16 + 6 * 9, colors = alphas + 6, scales = colors + 18;
    const size_t rotations = scales + 18, sh = rotations + 18;
    for (size_t i = 0; i < 6; ++i) {
      const auto row = static_cast<int64_t>(i);
      const double flip[3] = {1, -1, -1};
      for (size_t a = 0; a < 3; ++a) {
        const auto axis = static_cast<int64_t>(a);
        CHECK(fixed24(content, 16 + 9 * i + 3 * a, 12) ==
              Approx(flip[a] * g.means[row][axis].item<double>()).margin(1.3e-4));
        CHECK(byte_at(content, scales + 3 * i + a) / 16.0 - 10 ==
              Approx(g.log_scales[row][axis].item<double>()).margin(0.032));
        CHECK((byte_at(content, colors + 3 * i + a) / 255.0 - 0.5) / 0.15 ==
              Approx(g.sh[row][0][axis].item<double>()).margin(0.0135));
      }
      CHECK(byte_at(content, alphas + i) / 255.0 ==
            Approx(g.logit_opacities[row].sigmoid().item<double>()).margin(0.002));
      torch::Tensor q = g.rotations[row] / g.rotations[row].norm();
      if (q[0].item<double>() < 0) q = -q;
      CHECK(byte_at(content, rotations + 3 * i) / 127.5 - 1 ==
            Approx(q[1].item<double>()).margin(0.004));
      CHECK(byte_at(content, rotations + 3 * i + 1) / 127.5 - 1 ==
            Approx(-q[2].item<double>()).margin(0.004));
      if (coefficients > 1) {
        // The second coefficient, −C1·y, changes sign with y.
        CHECK((byte_at(content, sh + rest * i) - 128) / 128.0 ==
              Approx(-g.sh[row][1][0].item<double>()).margin(0.04));
      }
    }
  }
}

TEST_CASE("spz file: large scenes get fewer fractional bits", "[gaussians]") {
  const test::TempDir folder;
  splat::Gaussians g = random_gaussians(2, 1);
  g.means[1][0].fill_(50000.0);
  write_spz(folder / "a.spz", g);
  const std::string content = gunzip(folder / "a.spz");
  const int bits = byte_at(content, 13);
  CHECK(bits < 12);
  CHECK(fixed24(content, 16 + 9, bits) == Approx(50000).margin(0.01));
}

TEST_CASE("spz file: Gaussians with a number that is not finite are left out", "[gaussians]") {
  splat::Gaussians g = random_gaussians(3, 4);
  const std::string others = encode_spz(map_parameters(g, [](const torch::Tensor& value) {
    return value.index_select(0, torch::tensor({0, 2}));
  }));
  for (int i = 0; i < kParameterCount; ++i) {
    splat::Gaussians spoilt = map_parameters(g, [](const auto& value) { return value.clone(); });
    parameter(spoilt, i)[1].fill_(std::numeric_limits<float>::infinity());
    CHECK(encode_spz(spoilt) == others);
  }
}

TEST_CASE("spz file: one Gaussian far away, for which all others lose digits, is reported",
          "[gaussians]") {
  const test::TempDir folder;
  splat::Gaussians g = random_gaussians(20, 1);
  const auto said = [&] {
    set_log_file(folder / "said.log");
    encode_spz(g);
    set_log_file({});
    return read_file(folder / "said.log");
  };
  CHECK_THAT(said(), !test::naming("units"));
  g.means[3][0] = 1e6;
  CHECK_THAT(said(), test::naming("0.125 units"));
}

TEST_CASE("spz file: small scenes get more fractional bits, coarse steps are reported",
          "[gaussians]") {
  const test::TempDir folder;
  splat::Gaussians g = random_gaussians(100, 1);
  const auto shrunk = [&](double factor) {
    splat::Gaussians small = g;
    small.means = g.means * factor;
    set_log_file(folder / "said.log");
    write_spz(folder / "a.spz", small);
    set_log_file({});
    std::vector<std::string> notes;
    const torch::Tensor back =
        parse_spz(read_file(folder / "a.spz"), "a.spz", notes).gaussians.means;
    CHECK(notes.empty());
    return (back / factor - g.means).abs().max().item<double>();
  };
  CHECK(shrunk(1e-3) < 1e-4);
  CHECK_THAT(read_file(folder / "said.log"), !test::naming("warning"));
  CHECK(shrunk(1e-6) < 0.05);
  CHECK_THAT(read_file(folder / "said.log"), test::naming("warning", "a.spz", "5.96046e-08 units"));
}

TEST_CASE("spz file: sizes beyond those of the format are reported", "[gaussians]") {
  const test::TempDir folder;
  const splat::Gaussians usual = random_gaussians(100, 1);
  const auto said = [&](const std::function<void(torch::Tensor&)>& change) {
    splat::Gaussians g = usual;
    g.log_scales = g.log_scales.clone();
    change(g.log_scales);
    set_log_file(folder / "said.log");
    encode_spz(g);
    set_log_file({});
    return read_file(folder / "said.log");
  };
  // Needles keep their shape, and specks do not show, unless all Gaussians are so small.
  CHECK(said([](torch::Tensor& s) { s.select(1, 1).fill_(-13); }).empty());
  CHECK(said([](torch::Tensor& s) { s.slice(0, 0, 3).fill_(-13); }).empty());
  CHECK(said([](torch::Tensor& s) { s.slice(0, 0, 30).fill_(-11); }).empty());
  CHECK_THAT(said([](torch::Tensor& s) { s.fill_(-11); }),
             test::naming("100 smaller and 0 larger of 100", ".ply"));
  CHECK_THAT(said([](torch::Tensor& s) { s[4][2] = 7; }), test::naming("0 smaller and 1 larger"));
}

TEST_CASE("spz file: SH beyond degree 3 are noted", "[gaussians]") {
  const std::string bytes = of_degree_4(encode_spz(random_gaussians(2, 1)), 2 * 72);
  std::vector<std::string> notes;
  CHECK(parse_spz(bytes, "a.spz", notes).gaussians.sh.size(1) == 16);
  REQUIRE(notes.size() == 1);
  CHECK_THAT(notes[0], test::naming("a.spz", "degree", "4"));
}

TEST_CASE("spz file: bytes behind the Gaussians are noted", "[gaussians]") {
  SpzOptions options;
  for (options.version = 2; options.version <= 4; ++options.version) {
    const std::string written = encode_spz(random_gaussians(3, 4), options);
    const bool packed = options.version < 4;
    const std::string content = packed ? io::gunzip(written, "") : written;
    const auto notes_of = [&](const std::string& more, char flags) {
      std::string changed = content + more;
      changed[14] = flags;
      std::vector<std::string> notes;
      parse_spz(packed ? io::gzip(changed) : changed, "a.spz", notes);
      return notes;
    };
    CHECK(notes_of("", 0).empty());
    CHECK(notes_of("more", 2).empty());  // an extension's data
    REQUIRE(notes_of("more", 0).size() == 1);
    CHECK_THAT(notes_of("more", 0)[0], test::naming("a.spz", "3 Gaussians", "4 bytes"));
  }
}

TEST_CASE("spz file: more bits hold the SH finer, in the same bytes", "[gaussians]") {
  splat::Gaussians g = random_gaussians(50, 16);
  g.sh = 0.3 * torch::randn({50, 16, 3}).clamp(-3, 3);
  const test::TempDir folder;
  double before = 1;
  for (const int bits : {4, 6, 8}) {
    write_spz(folder / "a.spz", g, {false, 12, bits, bits});
    const std::string content = gunzip(folder / "a.spz");
    const size_t sh = 16 + 50 * 19;
    REQUIRE(content.size() == sh + 50 * 45);
    double worst = 0;
    for (int64_t i = 0; i < 50; ++i) {
      for (int64_t k = 1; k < 16; ++k) {
        const auto at = sh + static_cast<size_t>(45 * i + 3 * (k - 1));
        const double value = (byte_at(content, at) - 128) / 128.0;
        worst = std::max(worst, std::abs(std::abs(value) - std::abs(g.sh[i][k][0].item<double>())));
      }
    }
    CHECK(worst <= std::ldexp(1.0, -bits) + 1.0 / 256);
    CHECK(worst < before);
    before = worst;
  }
  CHECK_THROWS_AS(encode_spz(g, {false, 12, 5, 9}), ContractError);
}

}  // namespace
}  // namespace jade::gaussians
