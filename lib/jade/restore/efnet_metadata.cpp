// SPDX-License-Identifier: Apache-2.0
#include "jade/restore/efnet_metadata.h"

#include <algorithm>
#include <caffe2/serialize/inline_container.h>
#include <nlohmann/json.hpp>

#include "jade/core/check.h"

namespace jade::restore {
namespace {

constexpr int64_t kFormatVersion = 2;
constexpr int64_t kBinsOfVersion1 = 6;
constexpr int64_t kMostWindows = 1024;

/// Input that the metadata must name for a network of each version.
struct EventInput {
  bool known;
  const char* normalization;
};

EventInput event_input(const RestorerMetadata& m) {
  if (m.version >= 2) return {m.input == "counts", "inside"};
  return {m.input == "scer" || m.input == "bins", "max_abs"};
}

void check_values(const std::filesystem::path& path, const RestorerMetadata& m,
                  const std::string& normalization) {
  if (m.kind != "efnet" && m.kind != "image") {
    fail_restorer(path, concat("expected kind efnet or image, found '", m.kind, "'"));
  }
  const bool events = m.kind == "efnet";
  const EventInput expected = event_input(m);
  if (events ? !expected.known : m.input != "none") {
    fail_restorer(path, concat("input '", m.input, "' does not fit kind ", m.kind, " of version ",
                               m.version));
  }
  if (events && normalization != expected.normalization) {
    fail_restorer(path, concat("unknown normalization '", normalization, "'; expected ",
                               expected.normalization));
  }
  if (events && (m.windows < 2 || m.windows % 2 != 0 || m.windows > kMostWindows)) {
    fail_restorer(path, concat("windows: expected an even number from 2 to ", kMostWindows,
                               ", found ", m.windows));
  }
  if (events && m.any_time != (m.version >= 2)) {
    fail_restorer(path, "any_time: expected true in version 2, found false");
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
    m.version = json.at("format_version").get<int64_t>();
    if (m.version < 1 || m.version > kFormatVersion) {
      fail_restorer(path, concat("has format version ", m.version, ", this program reads up to ",
                                 kFormatVersion, ": update it, or export the restorer again"));
    }
    const std::string dtype = json.at("dtype").get<std::string>();
    m.stored_as_half = m.version >= 2 && dtype == "float16";
    if (dtype != "float32" && !m.stored_as_half) {
      fail_restorer(path, concat("expected dtype float32", m.version >= 2 ? " or float16" : "",
                                 ", found ", dtype));
    }
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
    if (m.kind == "efnet") {
      m.windows = m.version >= 2 ? json.at("windows").get<int64_t>() : kBinsOfVersion1;
      m.any_time = m.version >= 2 && json.at("any_time").get<bool>();
    }
  } catch (const nlohmann::json::exception& problem) {
    fail_restorer(path, concat("bad ", kRestorerMetadataFile, ": ", problem.what()));
  }
  check_values(path, m, normalization);
  return m;
}

RestorerMetadata read_restorer_metadata(const std::filesystem::path& path) {
  std::string text;
  try {
    caffe2::serialize::PyTorchStreamReader reader(path.string());
    const std::string record = concat("extra/", kRestorerMetadataFile);
    if (reader.hasRecord(record)) {
      const auto [data, bytes] = reader.getRecord(record);
      text.assign(static_cast<const char*>(data.get()), bytes);
    }
  } catch (const c10::Error& problem) {
    const std::string reason = problem.what_without_backtrace();
    fail_restorer(path, concat("no TorchScript file, or a damaged one: ",
                               reason.substr(0, std::min(reason.find(". "), reason.find('\n'))),
                               "; make it with scripts/efnet/export_efnet.py"));
  }
  return parse_restorer_metadata(path, text);
}

void check_times(const std::filesystem::path& path, const RestorerMetadata& metadata,
                 const std::vector<double>& times) {
  JADE_CHECK(!times.empty(), "expected a moment or more, found none");
  for (const double time : times) {
    JADE_CHECK(time >= 0 && time <= 1, "expected moments from 0 to 1, found ", time);
    if (time == 0.5 || metadata.any_time) continue;
    fail_restorer(
        path,
        concat("is of ",
               metadata.kind == "image" ? "kind image" : concat("version ", metadata.version),
               " and restores the middle of an exposure only, asked for moment ", time,
               "; name a restorer of version 2 as efnet.path (docs/engineering/restorer.md)"));
  }
}

}  // namespace jade::restore
