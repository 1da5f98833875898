// SPDX-License-Identifier: Apache-2.0
#include "jade/run/page_pictures.h"

#include "support/catch.h"

using namespace jade;

TEST_CASE("page_pictures: a picture that is known already is not encoded again", "[run]") {
  const torch::Tensor gray = torch::full({3, 4, 4}, 0.5), white = torch::ones({3, 4, 4});
  run::PagePictures pictures;
  pictures.add("train.0", "EDI", gray);
  pictures.encode();
  nlohmann::ordered_json views = nlohmann::ordered_json::array();
  views.push_back({{"pictures",
                    {pictures.add("train.0", "EDI", white), pictures.add("train.1", "EDI", gray),
                     pictures.add("train.1", "render", white, gray)}}});
  pictures.put_into(views);
  const auto& shown = views[0]["pictures"];
  CHECK(shown[0]["src"].get<std::string>().rfind("data:image/png;base64,iVBOR", 0) == 0);
  CHECK(shown[0]["src"] == shown[1]["src"]);
  CHECK(shown[2]["src"] != shown[1]["src"]);
  CHECK(shown[2]["note"] == "6.02 dB");
  CHECK_FALSE(shown[1].contains("note"));
}
