// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <memory>
#include <torch/types.h>
#include <zip.h>

#include "jade/core/atomic_file.h"
#include "jade/core/check.h"
#include "jade/core/error.h"
#include "jade/io/npy.h"
#include "jade/io/npy_fields.h"
#include "jade/io/npy_format.h"
#include "jade/io/zip.h"

namespace jade::io {
namespace {

struct ZipClose {
  void operator()(zip_t* archive) const { zip_discard(archive); }
};
using ZipArchive = std::unique_ptr<zip_t, ZipClose>;

const ZipWords kNpzWords{"an .npz archive", "write it again with numpy.savez"};

/// An array as .npy, and what to call it in messages.
struct NpzEntry {
  std::string bytes, label;
};

NpzEntry entry_of(const std::filesystem::path& path, const Npz& archive, const std::string& name) {
  if (!archive.has(name)) {
    std::string found;
    for (const std::string& known : archive.names()) found += (found.empty() ? "" : ", ") + known;
    throw DataError(concat(path.string(), ": expected an array '", name, "', found ",
                           found.empty() ? "none" : found));
  }
  return {Zip(path, kNpzWords).read(name + ".npy"), concat(path.string(), "[", name, "]")};
}

}  // namespace

Npz::Npz(const std::filesystem::path& path) : path_(path) {
  const Zip archive(path, kNpzWords);
  for (const std::string& entry : archive.names()) {
    if (entry.size() < 5 || entry.compare(entry.size() - 4, 4, ".npy") != 0) continue;
    names_.push_back(entry.substr(0, entry.size() - 4));
  }
}

bool Npz::has(const std::string& name) const {
  return std::find(names_.begin(), names_.end(), name) != names_.end();
}

torch::Tensor Npz::read(const std::string& name) const {
  const NpzEntry entry = entry_of(path_, *this, name);
  return parse_npy(entry.bytes.data(), entry.bytes.size(), entry.label);
}

NamedTensors read_npz_fields(const std::filesystem::path& path, const std::string& name) {
  const NpzEntry entry = entry_of(path, Npz(path), name);
  return parse_npy_fields(entry.bytes.data(), entry.bytes.size(), entry.label);
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
