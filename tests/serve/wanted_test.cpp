// SPDX-License-Identifier: Apache-2.0
#include "jade/serve/wanted.h"

#include "support/catch.h"

#include <map>

#include "jade/core/error.h"

using namespace jade;
using serve::Wanted;

namespace {

using Parts = std::map<std::string, std::string>;

const Parts kFrameParts{{"layer", "color"},
                        {"pose", "0,-1,0,1.5,1,0,0,-2,0,0,1,3e-1"},
                        {"camera", "100,101,40,30,80,60"}};

serve::Parameter from(const Parts& parts) {
  return [parts](const char* name) {
    const auto at = parts.find(name);
    return at == parts.end() ? std::string() : at->second;
  };
}

Parts with(const std::string& name, const std::string& value) {
  Parts parts = kFrameParts;
  parts[name] = value;
  return parts;
}

}  // namespace

TEST_CASE("wanted: a frame's pose, camera and layer", "[serve]") {
  const Wanted wanted = serve::wanted_frame(from(kFrameParts));
  CHECK(wanted.kind == Wanted::Kind::kColor);
  CHECK(wanted.pose.rotation[1] == Approx(-1));
  CHECK(wanted.pose.rotation[3] == Approx(1));
  CHECK(wanted.pose.translation == geometry::Vector3{1.5, -2, 0.3});
  CHECK(wanted.camera == geometry::Intrinsics{100, 101, 40, 30, 80, 60});
  CHECK(serve::wanted_frame(from(with("layer", "depth"))).kind == Wanted::Kind::kDepth);
  CHECK(wanted.view.empty());
  CHECK(serve::wanted_frame(from(with("view", "test.1"))).view == "test.1");
  CHECK_THROWS_AS(serve::wanted_frame(from(with("view", std::string(201, 'x')))), ConfigError);
}

TEST_CASE("wanted: what cannot be rendered is refused before it reaches who draws", "[serve]") {
  const std::string identity = "1,0,0,0,0,1,0,0,0,0,1,";
  for (const Parts& bad :
       {Parts{}, with("layer", "secret"), with("pose", ""), with("pose", identity),
        with("pose", identity + "0,0"), with("pose", identity + "nan"),
        with("pose", identity + "inf"), with("pose", identity + "1e300"),
        with("pose", identity + "0x"), with("pose", "2,0,0,0,0,1,0,0,0,0,1,0"),
        with("pose", "0,0,0,0,0,0,0,0,0,0,0,0"), with("camera", "100,101,40,30,80"),
        with("camera", "0,101,40,30,80,60"), with("camera", "100,-1,40,30,80,60"),
        with("camera", "100,101,40,30,0,60"), with("camera", "100,101,40,30,80.5,60"),
        with("camera", "100,101,40,30,100000,1"), with("camera", "100,101,40,30,4096,2048")}) {
    INFO((bad.empty() ? std::string("nothing") : bad.at("pose") + " " + bad.at("camera")));
    CHECK_THROWS_AS(serve::wanted_frame(from(bad)), ConfigError);
  }
}

TEST_CASE("wanted: pictures and viewers have short names", "[serve]") {
  const Wanted wanted = serve::wanted_picture(from({{"view", "train.3"}, {"name", "α"}}));
  CHECK(wanted.kind == Wanted::Kind::kPicture);
  CHECK(wanted.view == "train.3");
  CHECK(wanted.picture == "α");
  CHECK_THROWS_AS(serve::wanted_picture(from({{"view", "train.3"}})), ConfigError);
  CHECK_THROWS_AS(serve::wanted_picture(from({{"view", std::string(201, 'x')}, {"name", "a"}})),
                  ConfigError);
  const Wanted camera = serve::wanted_camera(from({{"view", "test.1"}}));
  CHECK(camera.kind == Wanted::Kind::kCamera);
  CHECK(camera.view == "test.1");
  CHECK_THROWS_AS(serve::wanted_camera(from({})), ConfigError);
  CHECK(serve::viewer_of(from({{"viewer", "aB3"}})) == "aB3");
  for (const std::string& bad : {std::string(), std::string("a b"), std::string(33, 'a')}) {
    CHECK_THROWS_AS(serve::viewer_of(from({{"viewer", bad}})), ConfigError);
  }
}
