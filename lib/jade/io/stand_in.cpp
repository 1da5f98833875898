// SPDX-License-Identifier: Apache-2.0
#include "jade/io/stand_in.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>

#include "jade/core/error.h"
#include "jade/core/text.h"

namespace jade::io {
namespace {

namespace fs = std::filesystem;

constexpr size_t kHeadBytes = 1024;

bool is_web_page(std::string_view head) {
  const size_t first = head.find_first_not_of("\xEF\xBB\xBF \t\r\n");
  if (first == std::string_view::npos) return false;
  const std::string start = in_small_letters(std::string(head.substr(first, 14)));
  return start.rfind("<!doctype html", 0) == 0 || start.rfind("<html", 0) == 0;
}

/// By the byte order mark, or by JSON's bracket of two bytes.
bool is_utf16(std::string_view head) {
  const std::string_view first = head.substr(0, 2);
  return first == "\xFF\xFE" || first == "\xFE\xFF" || first == std::string_view("{\0", 2) ||
         first == std::string_view("\0{", 2);
}

struct Packer {
  std::string_view mark;  ///< first bytes of its files
  const char* name;
  const char* unpack;  ///< command before the file's name
  const char* ending;
};

constexpr Packer kPackers[] = {{"\x1f\x8b", "gzip", "gunzip -k ", ".gz"},
                               {"BZh", "bzip2", "bunzip2 -k ", ".bz2"},
                               {"\xFD"
                                "7zXZ",
                                "xz", "unxz -k ", ".xz"},
                               {"\x28\xB5\x2F\xFD", "zstd", "unzstd ", ".zst"},
                               {"7z\xBC\xAF", "7-Zip", "7z x ", ".7z"},
                               {"Rar!", "RAR", "unrar x ", ".rar"}};

/// For a file of one of kPackers, or an archive of tar; else empty.
std::string packed(std::string_view head, const std::string& name) {
  constexpr size_t kTarMark = 257;
  const bool is_tar = head.size() > kTarMark && head.substr(kTarMark, 5) == "ustar";
  const bool is_packed_tar = name.find(".tar.") != std::string::npos || has_ending(name, ".tgz");
  for (const Packer& packer : kPackers) {
    if (head.rfind(packer.mark, 0) != 0) continue;
    if (is_packed_tar) break;
    const std::string found = concat("a file that ", packer.name, " compressed; unpack it first: ");
    return has_ending(name, packer.ending) ? concat(found, packer.unpack, name)
                                           : concat(found, "rename it to ", name, packer.ending,
                                                    ", then ", packer.unpack, name, packer.ending);
  }
  if (!is_tar && !is_packed_tar) return "";
  return concat("an archive of tar; unpack it first: tar xf ", name);
}

}  // namespace

std::string stand_in(std::string_view head, const fs::path& path) {
  const std::string name = path.filename().string();
  if (head.empty()) return "an empty file; copy or download it again";
  if (head.rfind("version https://git-lfs", 0) == 0) {
    return "a pointer of Git LFS; fetch the file itself: git lfs pull";
  }
  if (is_web_page(head)) {
    return "a web page (HTML); download the file itself, not the page that shows it";
  }
  if (is_utf16(head)) {
    return concat("text in UTF-16; convert it to UTF-8: iconv -f UTF-16 -t UTF-8 ", name,
                  " > utf8_", name);
  }
  return packed(head, name);
}

std::string stand_in(const fs::path& path) {
  errno = 0;
  std::ifstream in(path, std::ios::binary);
  if (!in && (errno == EACCES || errno == EPERM)) {
    return concat("a file that may not be read (", std::strerror(errno), "); allow it: chmod a+r ",
                  path.filename().string());
  }
  if (!in) return "";
  std::string head(kHeadBytes, '\0');
  in.read(head.data(), static_cast<std::streamsize>(head.size()));
  head.resize(static_cast<size_t>(std::max<std::streamsize>(in.gcount(), 0)));
  return stand_in(head, path);
}

}  // namespace jade::io
