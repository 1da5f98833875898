// SPDX-License-Identifier: Apache-2.0
#include "jade/io/zip.h"

#include <algorithm>
#include <fstream>
#include <functional>
#include <memory>
#include <zip.h>

#include "jade/core/atomic_file.h"
#include "jade/core/error.h"
#include "jade/io/stand_in.h"

namespace jade::io {
namespace {

struct ZipFree {
  void operator()(zip_t* archive) const { zip_discard(archive); }
  void operator()(zip_file_t* file) const { zip_fclose(file); }
};
using OpenZip = std::unique_ptr<zip_t, ZipFree>;
using OpenZipEntry = std::unique_ptr<zip_file_t, ZipFree>;

OpenZip open_zip(const std::filesystem::path& path, const ZipWords& words) {
  int code = 0;
  OpenZip archive(zip_open(path.c_str(), ZIP_RDONLY, &code));
  if (archive) return archive;
  if (const std::string other = stand_in(path); !other.empty())
    throw DataError(concat(path.string(), ": expected ", words.expected, ", found ", other));
  if (code == ZIP_ER_NOENT || code == ZIP_ER_OPEN)
    throw DataError(concat(path.string(), ": no such file, or it cannot be read"));
  throw DataError(concat(path.string(), ": expected ", words.expected,
                         ", found a damaged or other file; ", words.remedy));
}

/// Methods of packing that some builds of libzip lack.
std::string method_name(zip_uint16_t method) {
  constexpr zip_uint16_t kZstandard = 93, kXz = 95;  // unknown to libzip before 1.8
  switch (method) {
    case ZIP_CM_DEFLATE64:
      return "Deflate64";
    case ZIP_CM_BZIP2:
      return "BZip2";
    case ZIP_CM_LZMA:
      return "LZMA";
    case kZstandard:
      return "Zstandard";
    case kXz:
      return "XZ";
    default:
      return concat("number ", method);
  }
}

/// The error of an entry that cannot be opened or read.
DataError entry_error(zip_t* archive, const std::string& name, const std::string& label, int code) {
  if (code == ZIP_ER_NOENT)
    return DataError(concat(label, ": missing in the archive; copy the file again"));
  if (code == ZIP_ER_ENCRNOTSUPP || code == ZIP_ER_NOPASSWD) {
    return DataError(concat(label, ": expected an entry without password, found an encrypted one; ",
                            "unpack the archive and pack it again without password"));
  }
  zip_stat_t found;
  if (code == ZIP_ER_COMPNOTSUPP && zip_stat(archive, name.c_str(), 0, &found) == 0) {
    return DataError(concat(label, ": expected an entry packed by Deflate, found the method ",
                            method_name(found.comp_method),
                            ", which is not read; unpack the archive and pack it again with ",
                            "Deflate (zip -r)"));
  }
  return DataError(concat(label, ": damaged entry; copy the file again"));
}

/// Passes an entry to `take` in parts.
void for_each_part(zip_t* archive, const std::string& name, const std::string& label,
                   const std::function<void(const char*, size_t)>& take) {
  const OpenZipEntry entry(zip_fopen(archive, name.c_str(), 0));
  if (!entry) throw entry_error(archive, name, label, zip_error_code_zip(zip_get_error(archive)));
  std::vector<char> part(1 << 20);
  for (;;) {
    const zip_int64_t count = zip_fread(entry.get(), part.data(), part.size());
    if (count < 0) {
      throw entry_error(archive, name, label, zip_error_code_zip(zip_file_get_error(entry.get())));
    }
    if (count == 0) return;
    take(part.data(), static_cast<size_t>(count));
  }
}

}  // namespace

bool is_zip(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  char head[4] = {};
  file.read(head, sizeof head);
  return file && std::string(head, sizeof head) == "PK\x03\x04";
}

Zip::Zip(const std::filesystem::path& path, const ZipWords& words) : path_(path), words_(words) {
  const OpenZip archive = open_zip(path, words);
  const zip_int64_t count = zip_get_num_entries(archive.get(), 0);
  for (zip_int64_t i = 0; i < count; ++i) {
    const char* entry = zip_get_name(archive.get(), static_cast<zip_uint64_t>(i), 0);
    if (entry != nullptr) names_.emplace_back(entry);
  }
}

bool Zip::has(const std::string& name) const {
  return std::find(names_.begin(), names_.end(), name) != names_.end();
}

std::string Zip::read(const std::string& name) const {
  const OpenZip archive = open_zip(path_, words_);
  std::string bytes;
  for_each_part(archive.get(), name, concat(path_.string(), "[", name, "]"),
                [&](const char* part, size_t count) { bytes.append(part, count); });
  return bytes;
}

void Zip::extract(const std::string& name, const std::filesystem::path& target) const {
  const OpenZip archive = open_zip(path_, words_);
  std::ofstream file(target, std::ios::binary | std::ios::trunc);
  for_each_part(archive.get(), name, concat(path_.string(), "[", name, "]"),
                [&](const char* part, size_t count) {
                  file.write(part, static_cast<std::streamsize>(count));
                });
  file.close();
  if (!file) throw DataError(concat(target.string(), ": cannot be written; check the free space"));
}

void write_zip(const std::filesystem::path& path, const ZipEntries& entries, ZipPacking packing) {
  const auto failed = [&] {
    return DataError(
        concat(path.string(), ": cannot be written; check the folder and the free space"));
  };
  AtomicFile target(path);
  int code = 0;
  OpenZip archive(zip_open(target.temporary_path().c_str(), ZIP_CREATE | ZIP_TRUNCATE, &code));
  if (!archive) throw failed();
  const zip_int32_t method = packing == ZipPacking::kStore ? ZIP_CM_STORE : ZIP_CM_DEFAULT;
  for (const auto& [name, content] : entries) {
    // libzip reads the content at zip_close.
    zip_source_t* source =
        zip_source_buffer(archive.get(), content.data(), content.size(), /*freep=*/0);
    const zip_int64_t index =
        source == nullptr ? -1
                          : zip_file_add(archive.get(), name.c_str(), source, ZIP_FL_ENC_UTF_8);
    if (index < 0) {
      zip_source_free(source);
      throw failed();
    }
    zip_set_file_compression(archive.get(), static_cast<zip_uint64_t>(index), method, 0);
  }
  if (zip_close(archive.get()) != 0) throw failed();
  static_cast<void>(archive.release());  // zip_close has freed it
  target.commit();
}

}  // namespace jade::io
