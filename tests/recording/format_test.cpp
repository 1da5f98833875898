// SPDX-License-Identifier: Apache-2.0
#include "jade/recording/format.h"

#include "support/catch.h"

#include <torch/types.h>

#include "jade/core/error.h"
#include "jade/io/gzip.h"
#include "jade/io/hdf5.h"
#include "jade/io/npy.h"
#include "support/naming.h"
#include "support/temp_dir.h"

using namespace jade;
using namespace jade::recording;

TEST_CASE("format: recognised by content, whatever the name", "[recording]") {
  const test::TempDir dir;
  CHECK(recognise(dir.write("a", "% evt 3.0\n% end\n\x01\x02")) == Format::kEvt);
  CHECK(recognise(dir.write("b.txt", "#!AER-DAT4.0\r\n....")) == Format::kAedat);
  CHECK(recognise(dir.write("b.aedat", "#!AER-DAT3.1\r\n....")) == Format::kAedat);
  CHECK(recognise(dir.write("old.aedat", "#!AER-DAT2.0\r\n....")) == Format::kAedat);
  CHECK(recognise(dir.write("c.raw", "#ROSBAG V2.0\n....")) == Format::kRosBag);
  CHECK(recognise(dir.write("d", std::string("SQLite format 3\0....", 20))) == Format::kRosBag);
  CHECK(recognise(dir.write("e", "\x89MCAP0\r\n....")) == Format::kRosBag);
  CHECK(recognise(dir.write("f.dat", "0.5 1 2 1\n0.6 3 4 0\n")) == Format::kText);
  CHECK(recognise(dir.write("p.dat", "% Data file containing CD events.\n")) == Format::kDat);
  CHECK(recognise(dir.write("q.dat", std::string("% Version 2\n\x0c\x08") + "12345678")) ==
        Format::kDat);
  CHECK(recognise(dir.write("c.csv", "% t x y p\n1 2 3 1\n")) == Format::kText);
  CHECK(recognise(dir.write("f.csv.gz", io::gzip("t,x,y,p\n0.5,1,2,1\n"))) == Format::kText);
  CHECK(recognise(dir.write("packed/events.txt.gz", io::gzip("0.5 1 2 1\n"))) == Format::kText);
  CHECK(recognise(dir / "packed") == Format::kFrameFolder);
  CHECK(recognise(dir.write("f.csv", "\xEF\xBB\xBFt,x,y,p\n0.5,1,2,1\n")) == Format::kText);
  io::write_npy(dir / "g.h5", torch::zeros({1, 4}));
  CHECK(recognise(dir / "g.h5") == Format::kNpy);
  io::write_npz(dir / "h", {{"x", torch::zeros({1})}});
  CHECK(recognise(dir / "h") == Format::kNpz);
  const float x = 1;
  io::Hdf5Writer file(dir / "i.raw");
  file.append("x", &x, 1);
  file.close();
  CHECK(recognise(dir / "i.raw") == Format::kHdf5);
  dir.write("rpg/events.txt", "0.5 1 2 1\n");
  CHECK(recognise(dir / "rpg") == Format::kFrameFolder);
  dir.write("folder/events.npz", "");
  CHECK(recognise(dir / "folder") == Format::kFrameFolder);
  CHECK(recognise(dir.write("v2e/v2e-dvs-events.txt", "0.5 1 2 1\n").parent_path()) ==
        Format::kFrameFolder);
  dir.write("chunk/events/out.npz", "");
  CHECK(recognise(dir / "chunk") == Format::kFrameFolder);
  dir.write("chunk/events/more.npz", "");
  CHECK_THROWS_WITH(recognise(dir / "chunk"), test::naming("neither events nor frames"));
  dir.write("bag/metadata.yaml", "rosbag2_bagfile_information:");
  dir.write("bag/a_0.db3", "");
  CHECK(recognise(dir / "bag") == Format::kRosBag);
}

TEST_CASE("format: what is not read says what it is and what to do", "[recording]") {
  const test::TempDir dir;
  const auto message = [](const std::filesystem::path& path) -> std::string {
    CHECK_FALSE(is_recording(path));
    try {
      recognise(path);
    } catch (const DataError& error) {
      return error.what();
    }
    return "";
  };
  CHECK_THAT(message(dir / "missing"), test::naming("missing"));
  CHECK_THAT(message(dir.write("empty.raw", "")), test::naming("empty.raw", "is empty"));
  CHECK_THAT(message(dir.write("old.aedat", "#!AER-DAT3.0\n")),
             test::naming("old.aedat", "AEDAT 1.0 or 3.0", "DV"));
  CHECK_THAT(message(dir.write("x.raw", "\x01\x02\x03")), Catch::Contains("Prophesee header"));
  CHECK_THAT(message(dir.write("x.mp4", std::string("\0\0\0 ftypisom", 12))),
             Catch::Contains("another kind of file"));
  CHECK_THAT(message(dir.write("words.aedat4", "not a recording\n")),
             test::naming("words.aedat4", "found text"));
  CHECK_THAT(message(dir.write("wide.csv", std::string("\xFF\xFEt\0,\0x\0", 8))),
             test::naming("wide.csv", "UTF-16"));
  CHECK_THAT(message(dir.write("x.zip", "PK\x03\x04 cut short")), Catch::Contains("zip archive"));
  CHECK_THAT(message(dir.write("x.h5.gz", io::gzip("x"))), test::naming("gunzip -k x.h5.gz"));
  CHECK_THAT(message(dir.write("x.txt.bz2", "BZh91AY&SY")), test::naming("bunzip2 -k x.txt.bz2"));
  dir.write("packed/events.txt.xz", std::string("\xFD"
                                                "7zXZ\0",
                                                6));
  CHECK_THAT(message(dir / "packed"), test::naming("packed", "unxz -k events.txt.xz"));
  dir.write("folder/notes.md", "");
  CHECK_THAT(message(dir / "folder"), test::naming("folder", "neither events"));
}

TEST_CASE("format: a folder with poses is a data set, no recording", "[recording]") {
  const test::TempDir dir;
  dir.write("scene/events.txt", "0.5 1 2 1\n");
  CHECK(is_recording(dir / "scene"));
  dir.write("scene/poses_bounds.npy", "");
  CHECK_FALSE(is_recording(dir / "scene"));
  dir.write("model/events.txt", "0.5 1 2 1\n");
  dir.write("model/cameras.txt", "");
  dir.write("model/images.txt", "");
  CHECK_FALSE(is_recording(dir / "model"));
}
