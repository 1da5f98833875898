// SPDX-License-Identifier: Apache-2.0
#include "jade/page/page.h"

#include <initializer_list>
#include <string_view>
#include <utility>

#include "jade/core/digest.h"
#include "jade/page/front.h"

namespace jade::page {
namespace {

/// Escapes "</script>" and "<!--", which would end or change the element.
std::string inside_script(std::string text) {
  for (size_t at = 0; (at = text.find('<', at)) != std::string::npos; at += 6) {
    text.replace(at, 1, "\\u003c");
  }
  return text;
}

/// Replaces the placeholders of the page, which must be in this order.
std::string filled(std::string_view html,
                   std::initializer_list<std::pair<std::string_view, std::string_view>> texts) {
  std::string page;
  size_t from = 0, size = html.size();
  for (const auto& [mark, text] : texts) size += text.size();
  page.reserve(size);
  for (const auto& [mark, text] : texts) {
    const size_t at = html.find(mark, from);
    page.append(html, from, at - from).append(text);
    from = at + mark.size();
  }
  return page.append(html, from);
}

/// @param connect  directives for the policy
std::string scene_page(std::string json, const std::string& spz, const char* connect) {
  return filled(kHtml, {{"@CONNECT@", connect},
                        {"@STYLE@", kStyle},
                        {"@DATA@", inside_script(std::move(json))},
                        {"@SCENE@", base64(spz)},
                        {"@SCRIPT@", kScript}});
}

}  // namespace

std::string report_page(std::string json, const std::string& spz) {
  return scene_page(std::move(json), spz, "");
}

std::string live_page(const std::string& json) {
  return scene_page(json, "", " 'self'; connect-src 'self'");
}

std::string sweep_page(const std::string& json) {
  return filled(
      kSweepHtml,
      {{"@STYLE@", kSweepStyle}, {"@DATA@", inside_script(json)}, {"@SCRIPT@", kSweepScript}});
}

}  // namespace jade::page
