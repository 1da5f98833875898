// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <memory>
#include <torch/types.h>
#include <zip.h>

#include "jade/core/atomic_file.h"
#include "jade/core/check.h"
#include "jade/core/error.h"
#include "jade/io/npy.h"
#include "jade/io/npy_format.h"

namespace jade::io {
namespace {

struct ZipClose {
  void operator()(zip_t* archive) const { zip_discard(archive); }
  void operator()(zip_file_t* file) const { zip_fclose(file); }
};
using ZipArchive = std::unique_ptr<zip_t, ZipClose>;
using ZipEntry = std::unique_ptr<zip_file_t, ZipClose>;

ZipArchive open_zip(const std::filesystem::path& path) {
  int code = 0;
  ZipArchive archive(zip_open(path.c_str(), ZIP_RDONLY, &code));
  if (archive) return archive;
  const bool missing = code == ZIP_ER_NOENT || code == ZIP_ER_OPEN;
  throw DataError(
      concat(path.string(), missing ? ": no such file, or it cannot be read"
                                    : ": expected an .npz archive, found a damaged or other file; "
                                      "write it again with numpy.savez"));
}

/// Decompresses an entry in steps, so that memory follows what is really there rather than the
/// size that the archive claims.
std::string read_entry(zip_file_t* file, const std::string& name) {
  constexpr size_t kStep = 1 << 20;
  std::string bytes;
  for (;;) {
    const size_t before = bytes.size();
    bytes.resize(before + kStep);
    const zip_int64_t count = zip_fread(file, bytes.data() + before, kStep);
    if (count < 0) throw DataError(concat(name, ": damaged entry; copy the file again"));
    bytes.resize(before + static_cast<size_t>(count));
    if (count == 0) return bytes;
  }
}

}  // namespace

Npz::Npz(const std::filesystem::path& path) : path_(path) {
  const ZipArchive archive = open_zip(path);
  const zip_int64_t count = zip_get_num_entries(archive.get(), 0);
  for (zip_int64_t i = 0; i < count; ++i) {
    const char* entry = zip_get_name(archive.get(), static_cast<zip_uint64_t>(i), 0);
    std::string name = entry == nullptr ? "" : entry;
    if (name.size() < 5 || name.compare(name.size() - 4, 4, ".npy") != 0) continue;
    names_.push_back(name.substr(0, name.size() - 4));
  }
}

bool Npz::has(const std::string& name) const {
  return std::find(names_.begin(), names_.end(), name) != names_.end();
}

torch::Tensor Npz::read(const std::string& name) const {
  if (!has(name)) {
    std::string found;
    for (const std::string& known : names_) found += (found.empty() ? "" : ", ") + known;
    throw DataError(concat(path_.string(), ": expected an array '", name, "', found ",
                           found.empty() ? "none" : found));
  }
  const std::string label = concat(path_.string(), "[", name, "]");
  const ZipArchive archive = open_zip(path_);
  const ZipEntry entry(zip_fopen(archive.get(), (name + ".npy").c_str(), 0));
  if (!entry) throw DataError(concat(label, ": damaged entry; copy the file again"));
  const std::string bytes = read_entry(entry.get(), label);
  return parse_npy(bytes.data(), bytes.size(), label);
}

void write_npz(const std::filesystem::path& path, const NamedTensors& arrays) {
  const auto failed = [&] {
    return DataError(
        concat(path.string(), ": cannot be written; check the folder and the free space"));
  };
  AtomicFile target(path);
  int code = 0;
  ZipArchive archive(zip_open(target.temporary_path().c_str(), ZIP_CREATE | ZIP_TRUNCATE, &code));
  if (!archive) throw failed();
  std::vector<std::string> contents;  // libzip reads them at zip_close
  contents.reserve(arrays.size());
  for (const auto& [name, tensor] : arrays) {
    JADE_CHECK(tensor.defined(), "write_npz: array '", name, "' is undefined");
    const torch::Tensor data = tensor.detach().cpu().contiguous();
    contents.push_back(npy_header(data, name));
    contents.back().append(static_cast<const char*>(data.data_ptr()), data.nbytes());
    zip_source_t* source = zip_source_buffer(archive.get(), contents.back().data(),
                                             contents.back().size(), /*freep=*/0);
    const zip_int64_t index =
        source == nullptr
            ? -1
            : zip_file_add(archive.get(), (name + ".npy").c_str(), source, ZIP_FL_ENC_UTF_8);
    if (index < 0) {
      zip_source_free(source);
      throw failed();
    }
  }
  if (zip_close(archive.get()) != 0) throw failed();
  static_cast<void>(archive.release());  // zip_close has freed it
  target.commit();
}

}  // namespace jade::io
