// SPDX-License-Identifier: Apache-2.0
// make_seeds DIR writes small valid files into DIR/<reader>/ as initial inputs of the fuzzers.
#include <filesystem>
#include <torch/types.h>
#include <vector>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/data/llff.h"
#include "jade/io/hdf5.h"
#include "jade/io/npy.h"
#include "recording/evt_words.h"
#include "support/colmap_writer.h"

namespace fs = std::filesystem;
using namespace jade;

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  const fs::path root = argv[1];
  for (const char* reader : {"colmap", "ecf", "evt", "hdf5", "llff", "npy", "npz"}) {
    fs::create_directories(root / reader);
  }
  io::write_npy(root / "npy/float", torch::rand({3, 5}));
  io::write_npy(root / "npy/int", torch::arange(7));
  io::write_npy(root / "npy/scalar", torch::tensor(true));
  io::write_npy(root / "llff/rows", data::llff_rows({{{}, 10, 20, 30, 1, 2}, {{}, 1, 2, 3, 4, 5}}));
  io::write_npz(root / "npz/times",
                {{"timestamps_start", torch::arange(4)}, {"timestamps_end", torch::arange(4) + 1}});

  const std::vector<int64_t> t = {1, 2, 3, 4, 5, 6, 7, 8};
  const std::vector<float> x(t.begin(), t.end());
  for (const int level : {0, 4}) {
    io::Hdf5Writer writer(root / concat("hdf5/gzip", level), level);
    writer.append("t", t.data(), 8);
    writer.append("events/x", x.data(), 8);
    writer.close();
  }

  write_file(root / "evt/evt2", test::evt_header("2.0", "% geometry 640x480\n") +
                                    test::bytes_of(test::evt2_time(640), 4) +
                                    test::bytes_of(test::evt2_event(645, 3, 4, true), 4) +
                                    test::bytes_of(test::evt2_trigger(646, false), 4));
  for (const bool upper_first : {false, true}) {
    write_file(root / (upper_first ? "evt/evt21" : "evt/evt21_swapped"),
               test::evt_header("2.1") + test::evt21_word(test::evt2_time(640), 0, upper_first) +
                   test::evt21_word(test::evt2_event(645, 32, 4, true), 5, upper_first));
  }
  write_file(root / "evt/evt3", test::evt_header("3.0") + test::evt3_time(5000) +
                                    test::evt3_word(0, 9) + test::evt3_word(2, 8) +
                                    test::evt3_word(3, 64) + test::evt3_word(4, 0x801) +
                                    test::evt3_word(5, 1) + test::evt3_word(10, 1));

  // Two events 17 µs apart in each of the layouts.
  const std::string times("\x64\0\0\0\0\0\0\0\x01\xf1\xf1\x01", 12);
  const std::string rows("\x41\0\x61\0", 4), columns("\x20\0\x40\0", 4), packed(12, '\x11');
  write_file(root / "ecf/runs", std::string("\x08\0\0\0", 4) + times + rows + columns + "\x81\x01");
  write_file(root / "ecf/packed_columns", std::string("\x09\0\0\0", 4) + times + rows + packed);
  write_file(root / "ecf/packed", std::string("\x0a\0\0\0", 4) + times + packed);

  const io::ColmapCamera camera{1, "PINHOLE", 20, 10, {15, 16, 10, 5}};
  const std::vector<io::ColmapImage> images = {{1, {1, 0, 0, 0}, {0, 0, 1}, 1, "0_0.png"},
                                               {2, {1, 0, 0, 0}, {0, 1, 0}, 1, "GT0.png"}};
  const std::vector<double> points = {0, 1, 2, 3, 4, 5};
  for (const bool binary : {true, false}) {
    const io::ColmapFiles files = binary ? test::binary_model(camera, images, points)
                                         : test::text_model(camera, images, points);
    write_file(root / (binary ? "colmap/binary" : "colmap/text"),
               std::string(1, binary ? '\0' : '\1') + files.cameras + "<cut>" + files.images +
                   "<cut>" + files.points);
  }
  return 0;
}
