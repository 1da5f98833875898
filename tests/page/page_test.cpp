// SPDX-License-Identifier: Apache-2.0
#include "jade/page/page.h"

#include "support/catch.h"

#include <string>

using namespace jade;

namespace {

size_t count(const std::string& text, const std::string& part) {
  size_t found = 0;
  for (size_t at = 0; (at = text.find(part, at)) != std::string::npos; at += part.size()) ++found;
  return found;
}

std::string between(const std::string& text, const std::string& left, const std::string& right) {
  const size_t from = text.find(left) + left.size();
  return text.substr(from, text.find(right, from) - from);
}

}  // namespace

TEST_CASE("page: holds its data, its scene and every module, and no mark is left", "[page]") {
  const std::string page = page::report_page(R"({"config": "@SCENE@ @SCRIPT@"})", "foobar");
  CHECK(between(page, "id=\"data\">", "</script>") == R"({"config": "@SCENE@ @SCRIPT@"})");
  CHECK(between(page, "id=\"spz\">", "</script>") == "Zm9vYmFy");
  CHECK(count(page, "@SCENE@") == 1);
  CHECK(count(page, "@DATA@") + count(page, "@STYLE@") + count(page, "@CONNECT@") == 0);
  for (const char* part :
       {"function parseSpz", "class Renderer", "class Page", "#stage", "</html>"}) {
    CHECK(count(page, part) >= 1);
  }
  CHECK(count(page, "\nimport ") + count(page, "\nexport ") == 0);
  CHECK(count(page, "default-src 'none'") == 1);
}

TEST_CASE("page: a report may ask nobody, a live page whom it comes from", "[page]") {
  const std::string report = page::report_page("{}", ""), live = page::live_page("{}");
  CHECK(count(report, "'self'") + count(report, "connect-src") == 0);
  CHECK(count(live, "default-src 'none'; img-src data: blob: 'self'; connect-src 'self'; ") == 1);
  CHECK(between(live, "id=\"spz\">", "</script>").empty());
}

TEST_CASE("page: a text cannot end the element that holds it", "[page]") {
  const std::string plain = page::report_page("{}", "");
  const std::string page = page::report_page(R"({"config": "</script><!-- <b>"})", "");
  CHECK(count(page, "</script>") == count(plain, "</script>"));
  CHECK(count(page, R"(\u003c/script>\u003c!-- \u003cb>)") == 1);
}

TEST_CASE("sweep_page: holds what it was given, its own program, and the policy", "[page]") {
  const std::string page = page::sweep_page(R"({"title": "</script><b>"})");
  CHECK(page.rfind("<!doctype html>", 0) == 0);
  CHECK_THAT(page, Catch::Contains(R"({"title": "\u003c/script>\u003cb>"})"));
  CHECK_THAT(page, Catch::Contains("class SweepPage") && Catch::Contains("class Layers"));
  CHECK_THAT(page, Catch::Contains("default-src 'none'"));
  CHECK(page.find("import {") == std::string::npos);
  CHECK(page.find("@STYLE@") == std::string::npos);
  CHECK(page.find("@SCRIPT@") == std::string::npos);
}
