// SPDX-License-Identifier: Apache-2.0
#include "jade/config/config.h"

#include "support/catch.h"

#include <nlohmann/json.hpp>

#include "jade/config/text.h"
#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/core/log.h"
#include "support/naming.h"
#include "support/temp_dir.h"

using namespace jade;

namespace {

struct RouteOptions {
  double lr = 5e-4;
  bool render_consistency = true;
  Steps rest = Steps::share(2);
};
template <class V>
void describe(V& v, RouteOptions& o) {
  v.field("lr", o.lr, "Adam step size", Range{1e-8, 1});
  v.renamed("step_size", "lr");
  v.fixed("rest", o.rest);
  v.fixed("lr_final", [&o] { return o.lr / 100; });
  v.fixed("eps", 1e-15);
  v.fixed("path", "line");
  v.fixed("graph", true);
  v.field("render_consistency", o.render_consistency, "first term");
}

enum class Colour { kRed, kAmber };

constexpr auto words_of(Colour) {
  return std::array{Word{"red", Colour::kRed, "stop", "crimson"}, Word{"amber", Colour::kAmber}};
}

struct TestOptions {
  int64_t iterations = 25000;
  std::string device = "auto";
  Colour kind = Colour::kRed;
  std::filesystem::path data;
  std::vector<double> steps = {1, 0.5};
  Steps warmup = Steps::share(6);
  Steps resets = Steps::share(12, 1000);
  AutoNumber level = AutoNumber::automatic(2);
  AutoCount voices = AutoCount::automatic(4);
  RouteOptions route;
};
template <class V>
void describe(V& v, TestOptions& o) {
  v.field("iterations", o.iterations, "steps", Range{1, 1e9});
  v.field("device", o.device, "where");
  v.field("kind", o.kind, "which");
  v.field("data", o.data, "folder");
  v.field("steps", o.steps, "list");
  v.field("warmup", o.warmup, "rest until", Range{0, 1e9});
  v.field("resets", o.resets, "steps between resets", Range{0, 1e9});
  v.field("level", o.level, "how loud", Range{2.5, 11});  // without the fallback
  v.field("voices", o.voices, "how many", Range{1, 8});
  v.renamed("router", "route");
  v.group("route", o.route, "the router");
}

/// config::load calls this once all fields are read.
void settle(TestOptions& o) {
  o.warmup.settle(o.iterations);
  o.resets.settle(o.iterations);
}

TestOptions load_text(const test::TempDir& dir, const std::string& text,
                      const std::vector<std::string>& overrides = {}) {
  return config::load<TestOptions>({dir.write("scene.yaml", text), overrides, {}});
}

std::string error_of(const test::TempDir& dir, const std::string& text,
                     const std::vector<std::string>& overrides = {}) {
  try {
    load_text(dir, text, overrides);
  } catch (const ConfigError& error) {
    std::string message = error.what();
    const std::string folder = dir.path().string() + "/";
    for (size_t at; (at = message.find(folder)) != std::string::npos;)
      message.erase(at, folder.size());
    return message;
  }
  return "no error";
}

}  // namespace

TEST_CASE("config: a renamed key is read under both names and printed under the new one",
          "[config]") {
  const test::TempDir dir;
  CHECK(load_text(dir, "router: {lr: 0.1}\n").route.lr == 0.1);
  CHECK(load_text(dir, "route: {step_size: 0.2}\n").route.lr == 0.2);
  CHECK(load_text(dir, "", {"router.step_size=0.3"}).route.lr == 0.3);
  CHECK(load_text(dir, "router: {lr: 0.1}\n", {"route.lr=0.4"}).route.lr == 0.4);
  CHECK(error_of(dir, "router: {lr: fast}\n") ==
        "scene.yaml:1:14: route.lr: expected a number from 1e-8 to 1, found 'fast'");
  TestOptions options;
  const std::string printed = config::to_yaml(fields_of(options), "title");
  CHECK(printed.find("router:") == std::string::npos);
  CHECK(printed.find("step_size") == std::string::npos);
}

TEST_CASE("config: a key that became a constant is read with that value alone, and never printed",
          "[config]") {
  const test::TempDir dir;
  CHECK(load_text(dir, "route: {rest: 2%, eps: 1.0e-15, path: line, graph: true}\n").route.lr ==
        5e-4);
  CHECK(error_of(dir, "iterations: 10\nroute: {eps: 1e-8}\n") ==
        "scene.yaml:2:14: route.eps: expected 1e-15, which is its only value now (\"Removed keys\" "
        "in CHANGELOG.md), found '1e-8'; remove the key");
  for (const char* wrong : {"rest: 3%", "rest: 2", "rest: 500", "eps: none", "path: spline",
                            "path: [line]", "path: {line: 1}", "graph: false", "graph:"}) {
    const std::string key = std::string(wrong).substr(0, std::string(wrong).find(':'));
    INFO(wrong);
    CHECK_THAT(error_of(dir, concat("route: {", wrong, "}\n")),
               test::naming("scene.yaml:1:", "route." + key));
  }
  // A value derived from a field uses the field's final value, in any order of the files.
  CHECK(load_text(dir, "route: {lr_final: 1e-3, lr: 0.1}\n").route.lr == 0.1);
  CHECK(load_text(dir, "route: {lr_final: 1e-3}\n", {"route.lr=0.1"}).route.lr == 0.1);
  CHECK_THAT(error_of(dir, "route: {lr_final: 1e-3}\n"),
             Catch::Contains("route.lr_final: expected 5e-06"));
  CHECK_THAT(error_of(dir, "", {"route.eps=1"}), Catch::Contains("--set route.eps=1: route.eps"));
  TestOptions options;
  CHECK_THAT(config::to_yaml(fields_of(options), "title"), !Catch::Contains("lr_final"));
  CHECK_THAT(config::to_json_schema(fields_of(options), "title"), !Catch::Contains("lr_final"));
}

TEST_CASE("config: a number may be auto, by default or by word, and then has its fallback",
          "[config]") {
  const test::TempDir dir;
  TestOptions options;
  CHECK((options.level.is_auto() && options.level == 2));
  CHECK(config::value_text(&options.level) == "auto");
  options = load_text(dir, "level: 3\n");
  CHECK((!options.level.is_auto() && options.level == 3));
  CHECK(config::value_text(&options.level) == "3");
  options = load_text(dir, "level: 3\n", {"level=auto"});
  CHECK(options.level.is_auto());
  options = load_text(dir, config::to_yaml(fields_of(options), "title"));
  CHECK(options.level.is_auto());
  CHECK_THAT(error_of(dir, "level: 12\n"), Catch::Contains("level: ") && Catch::Contains("12"));
  CHECK((options.voices.is_auto() && options.voices == 4));
  options = load_text(dir, "voices: 3\n");
  CHECK((!options.voices.is_auto() && options.voices == 3));
  CHECK(config::value_text(&options.voices) == "3");
  CHECK_THAT(error_of(dir, "voices: 2.5\n"),
             Catch::Contains("voices: ") && Catch::Contains("auto"));
  CHECK_THAT(error_of(dir, "voices: 9\n"), Catch::Contains("voices: ") && Catch::Contains("9"));
  CHECK_THAT(error_of(dir, "level: loud\n"), Catch::Contains("level: ") && Catch::Contains("auto"));
}

TEST_CASE("config: an enum is its word in files, and an old word is read but never written",
          "[config]") {
  const test::TempDir dir;
  const auto said = dir.path() / "said.txt";
  set_log_file(said);
  TestOptions options = load_text(dir, "kind: amber\n", {"kind=crimson"});
  set_log_file({});
  CHECK(options.kind == Colour::kRed);
  CHECK_THAT(read_file(said), test::naming("--set kind=crimson", "crimson", "red"));
  const std::string printed = config::to_yaml(fields_of(options), "title");
  CHECK_THAT(printed, Catch::Contains("kind: red  # which (red|amber)\n  # red: stop\n") &&
                          !Catch::Contains("crimson") && !Catch::Contains("# amber"));
  options = load_text(dir, printed);
  CHECK(options.kind == Colour::kRed);
  const auto values = config::values(fields_of(options));
  CHECK(std::count(values.begin(), values.end(),
                   std::pair<std::string, std::string>("kind", "red")) == 1);
  CHECK_THAT(error_of(dir, "kind: [red]\n"), test::naming("kind", "red, amber"));
  CHECK(word_of(Colour::kAmber) == std::string("amber"));
  CHECK(value_of<Colour>("amber") == Colour::kAmber);
  CHECK(value_of<Colour>("crimson") == std::nullopt);
}

TEST_CASE("config: later layers win: defaults, extends, file, --set", "[config]") {
  const test::TempDir dir;
  dir.write("base.yaml", "iterations: 10\nkind: amber\nroute: {lr: 0.1}\n");
  const auto options = load_text(dir, "extends: base.yaml\niterations: 20\n",
                                 {"route.lr=0.2", "route.lr=0.3", "steps=[1, 2]"});
  CHECK(options.iterations == 20);
  CHECK(options.kind == Colour::kAmber);
  CHECK(options.route.lr == 0.3);
  CHECK(options.route.render_consistency);
  CHECK(options.steps == std::vector<double>{1, 2});
}

TEST_CASE("config: a second document and extends on the command line are refused", "[config]") {
  const test::TempDir dir;
  CHECK_THAT(error_of(dir, "iterations: 10\n---\niterations: 20\n"), test::naming("found 2"));
  CHECK_NOTHROW(load_text(dir, "---\niterations: 10\n"));
  CHECK_THROWS_NAMING(ConfigError, load_text(dir, "iterations: 10\n", {"extends=base.yaml"}),
                      "--set extends=base.yaml");
}

TEST_CASE("config: paths start at the file that names them", "[config]") {
  const test::TempDir dir;
  dir.write("sub/base.yaml", "data: scenes/x\n");
  CHECK(load_text(dir, "extends: sub/base.yaml\n").data == dir.path() / "sub/scenes/x");
  CHECK(load_text(dir, "data: ../y\n").data == dir.path().parent_path() / "y");
  CHECK(load_text(dir, "", {"data=z"}).data == std::filesystem::current_path() / "z");
}

TEST_CASE("config: a path with ~ or a variable has a warning that it is not expanded", "[config]") {
  const test::TempDir dir;
  set_log_file(dir / "log.txt");
  load_text(dir, "data: ~/scene\n");
  load_text(dir, "", {"data=$HOME/scene"});
  load_text(dir, "data: a$/scene\n");
  set_log_file({});
  const std::string log = read_file(dir / "log.txt");
  CHECK_THAT(log, Catch::Contains("'~/scene'") && Catch::Contains("'$HOME/scene'") &&
                      !Catch::Contains("a$/scene"));
}

TEST_CASE("config: a mistake is one line with place, key, expectation and finding", "[config]") {
  const test::TempDir dir;
  CHECK(error_of(dir, "route:\n  lrr: 1\n") ==
        "scene.yaml:2:3: route.lrr: unknown key; did you mean route.lr?");
  CHECK(
      error_of(dir, "iterations: ten\n") ==
      "scene.yaml:1:13: iterations: expected a whole number from 1 to 1,000,000,000, found 'ten'");
  CHECK(error_of(dir, "route: {lr: 2}\n") ==
        "scene.yaml:1:13: route.lr: expected a number from 1e-8 to 1, found '2'");
  CHECK(error_of(dir, "kind: ambre\n") ==
        "scene.yaml:1:7: kind: expected one of red, amber, found 'ambre'; did you mean amber?");
  CHECK(error_of(dir, "kind: ultramarine\n") ==
        "scene.yaml:1:7: kind: expected one of red, amber, found 'ultramarine'");
  CHECK(error_of(dir, "iterations: \"5\"\n").find("found '5'") != std::string::npos);
  CHECK(error_of(dir, "iterations: 1.5\n").find("whole number") != std::string::npos);
  CHECK(error_of(dir, "route: 3\n") ==
        "scene.yaml:1:8: route: expected a group of keys, found '3'");
  CHECK(error_of(dir, "kind: red\nkind: amber\n") == "scene.yaml:2:1: kind: given twice");
  CHECK(error_of(dir, "", {"itterations=5"}) ==
        "--set itterations=5: itterations: unknown key; did you mean iterations?");
  CHECK(error_of(dir, "", {"iterations"}).find("expected key=value") != std::string::npos);
  CHECK(error_of(dir, "kind: [a\n").find("scene.yaml:2:1: not valid YAML") == 0);
  CHECK(error_of(dir, "- a\n").find("expected 'key: value' lines") != std::string::npos);
  CHECK(error_of(dir, "extends: nothere.yaml\n").find("no such file") != std::string::npos);
}

TEST_CASE("config: whole numbers are decimal, with leading zeros too", "[config]") {
  const test::TempDir dir;
  for (const auto& [text, value] : {std::pair("010", 10), {"08", 8}, {"1e2", 100}, {"+12", 12}}) {
    INFO(text);
    CHECK(load_text(dir, concat("iterations: ", text, "\n")).iterations == value);
  }
}

TEST_CASE("config: all problems are reported together", "[config]") {
  const test::TempDir dir;
  const std::string message = error_of(dir, "kind: c\nsteps: 3\n", {"zzzzzzzzzz=1"});
  CHECK(std::count(message.begin(), message.end(), '\n') == 2);
}

TEST_CASE("config: extends that goes in a circle is refused with the circle", "[config]") {
  const test::TempDir dir;
  dir.write("a.yaml", "extends: scene.yaml\n");
  CHECK(error_of(dir, "extends: a.yaml\n").find("scene.yaml -> a.yaml -> scene.yaml") !=
        std::string::npos);
}

TEST_CASE("config: a file that does not exist is a ConfigError that names it", "[config]") {
  CHECK_THROWS_WITH(config::load<TestOptions>({"/nowhere/scene.yaml", {}, {}}),
                    Catch::Contains("/nowhere/scene.yaml"));
}

TEST_CASE("config: what is printed reads back and prints the same bytes", "[config]") {
  const test::TempDir dir;
  auto options =
      load_text(dir, "", {"data='x y: z'", "device=\"true\"", "route.lr=0.1", "steps=[]"});
  CHECK(options.device == "true");
  const std::string printed = config::to_yaml(fields_of(options), "title");
  auto again = load_text(dir, printed);
  CHECK(again.data == options.data);
  CHECK(again.route.lr == 0.1);
  CHECK(config::to_yaml(fields_of(again), "title") == printed);
}

TEST_CASE("config: the schema is JSON with every key, its default and its limits", "[config]") {
  TestOptions options;
  const auto schema = nlohmann::json::parse(config::to_json_schema(fields_of(options), "title"));
  CHECK(schema["additionalProperties"] == false);
  const auto& kind = schema["properties"]["kind"];
  CHECK(kind["type"] == "string");
  CHECK(kind["enum"] == nlohmann::json{"red", "amber"});
  CHECK(kind["default"] == "red");
  CHECK(kind["description"] == "which\nred: stop");
  const auto& lr = schema["properties"]["route"]["properties"]["lr"];
  CHECK(lr["default"] == 5e-4);
  CHECK(lr["maximum"] == 1);
  CHECK(lr["description"] == "Adam step size");
}

TEST_CASE("config: nearest finds typing mistakes and leaves strangers alone", "[config]") {
  const std::vector<std::string> words = {"iterations", "device", "route.lr"};
  CHECK(config::nearest("iteratoins", words) == "iterations");
  CHECK(config::nearest("devise", words) == "device");
  CHECK(config::nearest("background", words).empty());
}

TEST_CASE("config: a share of the run follows its length, a number of steps does not", "[config]") {
  const test::TempDir dir;
  const auto steps = [&](const std::string& text) {
    const TestOptions options = load_text(dir, text);
    return std::pair(int64_t{options.warmup}, int64_t{options.resets});
  };
  CHECK(steps("") == std::pair(int64_t{1500}, int64_t{3000}));
  CHECK(steps("iterations: 40000") == std::pair(int64_t{2400}, int64_t{4800}));
  CHECK(steps("{iterations: 3000, warmup: 0.5 %}") == std::pair(int64_t{15}, int64_t{1000}));
  CHECK(steps("{iterations: 3000, resets: 120, warmup: 1500}") ==
        std::pair(int64_t{1500}, int64_t{120}));
  CHECK(steps("{warmup: 0%, resets: 0}") == std::pair(int64_t{0}, int64_t{0}));
  CHECK(steps("{iterations: 3, warmup: 1%}").first == 1);  // a share is at least one step
  for (const char* bad : {"warmup: 6 steps", "warmup: -6%", "warmup: '%'", "warmup: 1.5"}) {
    CHECK_THAT(error_of(dir, bad), Catch::Contains("warmup: expected a whole number of steps or a "
                                                   "share of the run such as 6%"));
  }
}

TEST_CASE("config: a share prints itself and what it comes to", "[config]") {
  const test::TempDir dir;
  TestOptions options = load_text(dir, "{iterations: 3000, warmup: 0.4%}");
  const std::string yaml = config::to_yaml(fields_of(options), "title");
  CHECK_THAT(yaml, Catch::Contains("warmup: 0.4%  # ") && Catch::Contains("here 12 steps") &&
                       Catch::Contains("at least 1000; here 1000 steps"));
  TestOptions again = load_text(dir, yaml);
  CHECK(config::to_yaml(fields_of(again), "title") == yaml);
  const auto schema = nlohmann::json::parse(config::to_json_schema(fields_of(options), "title"));
  CHECK(schema["properties"]["warmup"]["type"] == nlohmann::json{"integer", "string"});
  CHECK(schema["properties"]["warmup"]["default"] == "0.4%");
}
