// SPDX-License-Identifier: Apache-2.0
#include "jade/page/page.h"

#include <string_view>

#include "jade/page/base64.h"
#include "jade/page/front.h"

namespace jade::page {
namespace {

/// "</script>" or "<!--" inside a text would end or change the element that holds it.
std::string inside_script(std::string text) {
  for (size_t at = 0; (at = text.find('<', at)) != std::string::npos; at += 6) {
    text.replace(at, 1, "\\u003c");
  }
  return text;
}

/// @param connect  directives for the policy
std::string page_with(const std::string& json, const std::string& spz, std::string_view connect) {
  const std::string_view html = kHtml;
  std::string page;
  size_t from = 0;
  const auto fill = [&](std::string_view mark, std::string_view text) {
    const size_t at = html.find(mark, from);
    page.append(html, from, at - from).append(text);
    from = at + mark.size();
  };
  fill("@CONNECT@", connect);
  fill("@STYLE@", kStyle);
  fill("@DATA@", inside_script(json));
  fill("@SCENE@", base64(spz));
  fill("@SCRIPT@", kScript);
  return page.append(html, from);
}

}  // namespace

std::string report_page(const std::string& json, const std::string& spz) {
  return page_with(json, spz, "");
}

std::string live_page(const std::string& json) {
  return page_with(json, "", " 'self'; connect-src 'self'");
}

}  // namespace jade::page
