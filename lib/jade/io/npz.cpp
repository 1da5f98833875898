// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <torch/types.h>

#include "jade/core/check.h"
#include "jade/core/error.h"
#include "jade/core/text.h"
#include "jade/io/npy.h"
#include "jade/io/npy_format.h"
#include "jade/io/zip.h"

namespace jade::io {
namespace {

const ZipWords kNpzWords{"an .npz archive", "write it again with numpy.savez"};

/// An array in .npy form, and its name for messages.
struct NpzEntry {
  std::string bytes, label;
};

NpzEntry entry_of(const std::filesystem::path& path, const Npz& archive, const std::string& name) {
  if (!archive.has(name)) {
    const std::vector<std::string>& found = archive.names();
    throw DataError(concat(path.string(), ": expected an array '", name, "', found ",
                           found.empty() ? "none" : listing(found, found.size())));
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
  ZipEntries entries;
  for (const auto& [name, tensor] : arrays) {
    JADE_CHECK(tensor.defined(), "write_npz: array '", name, "' is undefined");
    const torch::Tensor data = tensor.detach().cpu().contiguous();
    entries.emplace_back(name + ".npy", npy_header(data, name));
    entries.back().second.append(static_cast<const char*>(data.data_ptr()), data.nbytes());
  }
  write_zip(path, entries);
}

}  // namespace jade::io
