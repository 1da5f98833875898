// SPDX-License-Identifier: Apache-2.0
#include "jade/restore/efnet_metadata.h"

#include <nlohmann/json.hpp>

#include "jade/core/error.h"

namespace jade::restore {
namespace {

constexpr int64_t kFormatVersion = 1;

void check_values(const std::filesystem::path& path, const RestorerMetadata& m,
                  const std::string& normalization) {
  if (m.kind != "efnet" && m.kind != "image") {
    fail_restorer(path, concat("expected kind efnet or image, found '", m.kind, "'"));
  }
  const bool events = m.kind == "efnet";
  if (events ? m.input != "scer" && m.input != "bins" : m.input != "none") {
    fail_restorer(path, concat("input '", m.input, "' does not fit kind ", m.kind));
  }
  if (events && normalization != "max_abs") {
    fail_restorer(path, concat("unknown normalization '", normalization, "'; expected max_abs"));
  }
  if (m.padding_multiple < 1 || m.padding_multiple > 1024 || m.minimum_size < 1 ||
      m.minimum_size > 65536) {
    fail_restorer(path, concat("padding_multiple ", m.padding_multiple, " or minimum_size ",
                               m.minimum_size, " makes no sense"));
  }
}

}  // namespace

void fail_restorer(const std::filesystem::path& path, const std::string& what) {
  throw DataError(concat(path.string(), ": ", what));
}

RestorerMetadata parse_restorer_metadata(const std::filesystem::path& path,
                                         const std::string& text) {
  if (text.empty()) {
    fail_restorer(
        path, concat("has no ", kRestorerMetadataFile, ": export the restorer with scripts/efnet/",
                     "export_efnet.py --help"));
  }
  RestorerMetadata m;
  std::string normalization;
  try {
    const nlohmann::json json = nlohmann::json::parse(text);
    if (json.at("format").get<std::string>() != "jade-restorer") {
      fail_restorer(path, concat(kRestorerMetadataFile, " is not of format jade-restorer"));
    }
    const auto version = json.at("format_version").get<int64_t>();
    if (version > kFormatVersion) {
      fail_restorer(path, concat("has format version ", version, ", this program reads up to ",
                                 kFormatVersion, ": update it, or export the restorer anew"));
    }
    const std::string dtype = json.at("dtype").get<std::string>();
    if (dtype != "float32") fail_restorer(path, concat("expected dtype float32, found ", dtype));
    m.kind = json.at("kind").get<std::string>();
    m.name = json.at("name").get<std::string>();
    m.width = json.at("width").get<int64_t>();
    m.parameters = json.at("parameters").get<int64_t>();
    m.input = json.at("input").get<std::string>();
    m.channel_order = json.at("channel_order").get<std::string>();
    m.padding_multiple = json.at("padding_multiple").get<int64_t>();
    m.minimum_size = json.at("minimum_size").get<int64_t>();
    m.uses_mask = json.at("uses_mask").get<bool>();
    m.weights_sha256 = json.at("weights_sha256").get<std::string>();
    m.source = json.at("source").get<std::string>();
    normalization = json.at("normalization").get<std::string>();
  } catch (const nlohmann::json::exception& problem) {
    fail_restorer(path, concat("bad ", kRestorerMetadataFile, ": ", problem.what()));
  }
  check_values(path, m, normalization);
  return m;
}

}  // namespace jade::restore
