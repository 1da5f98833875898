// SPDX-License-Identifier: Apache-2.0
#include "jade/run/metrics_log.h"

#include "support/catch.h"

#include "jade/core/atomic_file.h"
#include "support/temp_dir.h"

using namespace jade;

TEST_CASE("metrics log: goes on after the line of its checkpoint's own step", "[run]") {
  const test::TempDir dir;
  const std::string upto = "{\"step\":5,\"loss\":3}\n{\"step\":10,\"loss\":2}\n";
  // Two steps that a killed run lost, one line incomplete.
  const auto path = dir.write("metrics.jsonl", upto + "{\"step\":11,\"loss\":1}\n{\"step\":1");
  run::MetricsLog log(path, 10);
  CHECK(read_file(path) == upto);
  std::string told;
  log.tell([&](const std::string& line) { told += line; });
  log.append({{"step", 15}});
  CHECK(read_file(path) == upto + "{\"step\":15}\n");
  CHECK(told == "{\"step\":15}");
}
