// SPDX-License-Identifier: Apache-2.0
#include "common/help.h"

#include "support/catch.h"

#include <algorithm>
#include <iterator>
#include <regex>
#include <set>
#include <sstream>

#include "support/programs.h"
#include "support/temp_dir.h"

using namespace jade;
using test::Outcome;
using test::run;

namespace {

constexpr const char* kPrograms[] = {"jade_train",    "jade_import", "jade_inspect", "jade_eval",
                                     "jade_render",   "jade_export", "jade_view",    "jade_deblur",
                                     "jade_simulate", "jade_sweep",  "jade_bench"};

std::vector<std::string> lines_of(const std::string& text) {
  std::istringstream in(text);
  std::vector<std::string> lines;
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  return lines;
}

size_t characters(const std::string& line) {
  return static_cast<size_t>(
      std::count_if(line.begin(), line.end(), [](char c) { return (c & 0xC0) != 0x80; }));
}

std::set<std::string> matches(const std::string& text, const std::regex& pattern) {
  return {std::sregex_token_iterator(text.begin(), text.end(), pattern),
          std::sregex_token_iterator()};
}

/// Flags at the start of a line of `help`: those of the program.
std::set<std::string> declared_flags(const std::string& help) {
  std::set<std::string> flags;
  for (const std::string& line : lines_of(help)) {
    if (line.rfind("  -", 0) != 0) continue;
    const size_t end = std::min(line.find("  ", 3), line.size());
    flags.merge(matches(line.substr(0, end), std::regex("--[a-z0-9-]+")));
  }
  return flags;
}

}  // namespace

TEST_CASE("wrapped: breaks at spaces and counts characters, not bytes", "[apps]") {
  CHECK(apps::wrapped("one two three", 9, 2, 0) == "one two\n  three");
  CHECK(apps::wrapped("one two three", 8, 2, 4) == "one\n  two\n  three");
  CHECK(apps::wrapped("a…b c…d", 7, 0, 0) == "a…b c…d");
  CHECK(apps::wrapped("short averyveryverylongword", 8, 1, 0) == "short\n averyveryverylongword");
}

TEST_CASE("--help: groups, two examples, 80 columns and only flags of the program", "[apps]") {
  const test::TempDir dir;
  for (const std::string program : kPrograms) {
    const Outcome outcome = run(dir, program + " --help");
    INFO(program << "\n" << outcome.out << outcome.err);
    REQUIRE(outcome.code == 0);
    const std::vector<std::string> lines = lines_of(outcome.out);
    for (const char* group : {"Usage: ", "Examples:", "Output:", "Common:"}) {
      CHECK(std::any_of(lines.begin(), lines.end(),
                        [&](const std::string& line) { return line.rfind(group, 0) == 0; }));
    }
    CHECK(std::count_if(lines.begin(), lines.end(), [&](const std::string& line) {
            return line.rfind("  " + program + " ", 0) == 0;
          }) == 2);
    for (const std::string& line : lines) {
      INFO(line);
      CHECK(characters(line) <= 80);
    }
    // jade_bench uses flags of its subcommands in its examples.
    std::set<std::string> flags = declared_flags(outcome.out);
    if (program == "jade_bench") {
      for (const char* command : {" splat --help", " run --help"})
        flags.merge(declared_flags(run(dir, program + command).out));
    }
    for (const std::string& flag : matches(outcome.out, std::regex("--[a-z][a-z0-9-]+"))) {
      INFO(flag);
      CHECK(flags.count(flag) == 1);
    }
  }
}

TEST_CASE("programs: without arguments they print their usage and end with exit code 2", "[apps]") {
  const test::TempDir dir;
  for (const std::string program : kPrograms) {
    const Outcome outcome = run(dir, program);
    INFO(program << "\n" << outcome.out << outcome.err);
    CHECK(outcome.code == 2);
    CHECK_THAT(outcome.out,
               Catch::Contains("Usage: " + program) && Catch::Contains(program + " --help"));
    CHECK(std::count(outcome.err.begin(), outcome.err.end(), '\n') == 1);
  }
}

TEST_CASE("jade_bench: each command has its groups and two examples", "[apps]") {
  const test::TempDir dir;
  for (const std::string name :
       {"splat", "iteration", "restorer", "events", "losses", "run", "quality"}) {
    const std::string help = run(dir, "jade_bench " + name + " --help").out;
    INFO(help);
    CHECK_THAT(help, Catch::Contains("\nExamples:\n") && Catch::Contains("\nCommon:\n") &&
                         !Catch::Contains("\nOptions:\n"));
    const auto lines = lines_of(help);
    CHECK(std::count_if(lines.begin(), lines.end(), [&](const std::string& line) {
            return line.rfind("  jade_bench " + name, 0) == 0;
          }) == 2);
    for (const std::string& line : lines) CHECK(characters(line) <= 80);
    const auto flags = declared_flags(help);
    for (const std::string& flag : matches(help, std::regex("--[a-z][a-z0-9-]+"))) {
      INFO(flag);
      CHECK(flags.count(flag) == 1);
    }
  }
}

TEST_CASE("--help: a narrow terminal has the texts below the flags", "[apps]") {
  const test::TempDir dir;
  const Outcome outcome =
      run(dir, "script -qec 'stty cols 40; jade_train --help' /dev/null < /dev/null");
  INFO(outcome.out << outcome.err);
  REQUIRE(outcome.code == 0);
  std::string text = outcome.out;
  text.erase(std::remove(text.begin(), text.end(), '\r'), text.end());
  const auto lines = lines_of(text);
  CHECK(std::find(lines.begin(), lines.end(), "  --output DIR") != lines.end());
  for (const std::string& line : lines) {
    if (line.rfind("  jade_train ", 0) != 0) CHECK(characters(line) <= 40);
  }
}

TEST_CASE("--help: numbers have no exponents and their thousands apart", "[apps]") {
  const test::TempDir dir;
  for (const std::string program : kPrograms) {
    const std::string help = run(dir, program + " --help").out;
    INFO(program << help);
    CHECK(matches(help, std::regex("[0-9]e[+-]?0|\\b[0-9]{5,}\\b")).empty());
  }
}

TEST_CASE("programs: an unknown flag is answered with the nearest one", "[apps]") {
  const test::TempDir dir;
  for (const std::string program : kPrograms) {
    const Outcome outcome = run(dir, program + " --log-leve=debug");
    INFO(program << "\n" << outcome.err);
    CHECK(outcome.code == 2);
    CHECK_THAT(outcome.err, Catch::Contains("--log-level"));
  }
}
