// SPDX-License-Identifier: Apache-2.0
#include "jade/restore/efnet_metadata.h"

#include "support/catch.h"

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "support/naming.h"
#include "support/stub_restorer.h"
#include "support/temp_dir.h"

namespace jade::restore {
namespace {

std::string with(std::string text, const std::string& from, const std::string& to) {
  const size_t place = text.find(from);
  REQUIRE(place != std::string::npos);
  return text.replace(place, from.size(), to);
}

TEST_CASE("efnet metadata: both versions say what they take", "[restore]") {
  const RestorerMetadata old = parse_restorer_metadata("r.pt", test::kStubMetadata);
  CHECK(old.version == 1);
  CHECK(old.windows == 6);
  CHECK_FALSE(old.any_time);
  const RestorerMetadata any = parse_restorer_metadata("r.pt", test::kAnyTimeMetadata);
  CHECK(any.version == 2);
  CHECK(any.windows == 4);
  CHECK(any.any_time);
  CHECK_FALSE(any.stored_as_half);
}

TEST_CASE("efnet metadata: values that do not fit a version are refused, by name", "[restore]") {
  const auto refused = [](const std::string& from, const std::string& to, const char* says) {
    INFO(to);
    CHECK_THROWS_WITH(parse_restorer_metadata("r.pt", with(test::kAnyTimeMetadata, from, to)),
                      Catch::StartsWith("r.pt: ") && Catch::Contains(says));
  };
  refused("\"windows\": 4", "\"windows\": 5", "windows: expected an even number");
  refused("\"windows\": 4", "\"windows\": 0", "windows: expected an even number");
  refused("\"windows\": 4", "\"window\": 4", "windows");
  refused("\"any_time\": true", "\"any_time\": false", "any_time: expected true");
  refused("\"counts\"", "\"scer\"", "does not fit kind efnet of version 2");
  refused("\"inside\"", "\"max_abs\"", "expected inside");
  refused("\"float32\"", "\"bfloat16\"", "expected dtype float32 or float16");
  refused("\"format_version\": 2", "\"format_version\": 3", "format version 3");
  refused("\"format_version\": 2", "\"format_version\": 0", "format version 0");
  CHECK_THROWS_NAMING(
      DataError,
      parse_restorer_metadata("r.pt", with(test::kStubMetadata, "\"float32\"", "\"float16\"")),
      "dtype", "float16");
}

TEST_CASE("efnet metadata: is read without the network, and from its file alone", "[restore]") {
  const test::TempDir folder;
  const auto path = test::save_any_time_restorer(folder / "r.pt", "  return image\n");
  CHECK(read_restorer_metadata(path).name == "anytime");
  write_file(folder / "cut.pt", read_file(path).substr(0, 200));
  CHECK_THROWS_WITH(read_restorer_metadata(folder / "cut.pt"),
                    test::naming("cut.pt", "TorchScript") && !Catch::Contains("\n"));
  CHECK_THROWS_WITH(
      read_restorer_metadata(test::save_any_time_restorer(folder / "e.pt", "  return image\n", "")),
      Catch::Contains("export_efnet.py"));
}

}  // namespace
}  // namespace jade::restore
