// SPDX-License-Identifier: Apache-2.0
#include "jade/import/calibration_xml.h"

#include <algorithm>
#include <cctype>
#include <sstream>

#include "jade/core/error.h"

namespace jade::import {
namespace {

using config::DocumentNode;

/// Deeper nesting than in any OpenCV storage.
constexpr int kDeepest = 32;

class XmlReader {
 public:
  XmlReader(const std::filesystem::path& path, const std::string& text)
      : path_(path), text_(text) {}

  DocumentNode root() {
    skip_other();
    std::string name;
    bool empty = false;
    if (!opens(name, empty)) fail("an element");
    return empty ? DocumentNode() : content(name, 0);
  }

 private:
  [[noreturn]] void fail(const std::string& expected) const {
    throw DataError(concat(path_.string(), ":", line(), ": expected ", expected,
                           " of OpenCV's storage as XML, found '", here(),
                           "'; export the calibration again"));
  }
  /// Text at the current position, on one line.
  std::string here() const {
    const std::string some = text_.substr(std::min(at_, text_.size()), 20);
    return some.substr(0, some.find('\n'));
  }
  int line() const {
    const auto end = text_.begin() + static_cast<std::ptrdiff_t>(std::min(at_, text_.size()));
    return 1 + static_cast<int>(std::count(text_.begin(), end, '\n'));
  }
  bool starts(const char* with) const {
    return text_.compare(at_, std::char_traits<char>::length(with), with) == 0;
  }
  void skip_to(const char* end) {
    const size_t found = text_.find(end, at_);
    if (found == std::string::npos) fail(end);
    at_ = found + std::char_traits<char>::length(end);
  }
  /// Blanks, comments, and declarations.
  void skip_other() {
    while (true) {
      while (at_ < text_.size() && std::isspace(static_cast<unsigned char>(text_[at_]))) ++at_;
      if (starts("<!--")) {
        skip_to("-->");
      } else if (starts("<?") || starts("<!")) {
        skip_to(">");
      } else {
        return;
      }
    }
  }
  /// Whether an opening tag starts here, its name, and whether it is self-closing.
  bool opens(std::string& name, bool& empty) {
    if (at_ + 1 >= text_.size() || text_[at_] != '<' || text_[at_ + 1] == '/') return false;
    const size_t end = text_.find('>', at_);
    if (end == std::string::npos) fail("the end of a tag");
    const std::string tag = text_.substr(at_ + 1, end - at_ - 1);
    empty = !tag.empty() && tag.back() == '/';
    name = tag.substr(0, tag.find_first_of(" \t\r\n/"));
    at_ = end + 1;
    return true;
  }

  DocumentNode content(const std::string& name, int depth) {
    if (depth > kDeepest) fail("fewer elements in each other");
    DocumentNode node;
    node.line = line();
    std::string words;
    while (true) {
      skip_other();
      if (starts("</")) break;
      std::string child;
      bool empty = false;
      if (opens(child, empty)) {
        node.entries.emplace_back(child, empty ? DocumentNode() : content(child, depth + 1));
        continue;
      }
      const size_t end = text_.find('<', at_);
      if (end == std::string::npos) fail(concat("</", name, ">"));
      words += text_.substr(at_, end - at_) + " ";
      at_ = end;
    }
    if (!starts(concat("</", name).c_str())) fail(concat("</", name, ">"));
    skip_to(">");
    if (!node.entries.empty()) {
      node.kind = DocumentNode::Kind::kMap;
    } else if (name == "data") {
      node.kind = DocumentNode::Kind::kList;
      std::istringstream in(words);
      for (std::string word; in >> word;) {
        DocumentNode item;
        item.kind = DocumentNode::Kind::kText;
        item.text = word, item.line = node.line;
        node.items.push_back(item);
      }
    } else {
      node.kind = DocumentNode::Kind::kText;
      const size_t last = words.find_last_not_of(" \t\r\n");
      node.text = last == std::string::npos ? "" : words.substr(0, last + 1);
    }
    return node;
  }

  const std::filesystem::path& path_;
  const std::string& text_;
  size_t at_ = 0;
};

}  // namespace

bool is_xml(const std::string& text) {
  const size_t begin = text.find_first_not_of(" \t\r\n\xEF\xBB\xBF");
  return begin != std::string::npos && text[begin] == '<';
}

DocumentNode read_xml(const std::filesystem::path& path, const std::string& text) {
  const size_t begin = text.find('<');
  const std::string body = begin == std::string::npos ? "" : text.substr(begin);
  return XmlReader(path, body).root();
}

}  // namespace jade::import
