// SPDX-License-Identifier: Apache-2.0
// A stub of the training program, its settings, and sweeps with it.
#pragma once

#include <string>

#include "jade/core/error.h"
#include "jade/core/fields.h"
#include "jade/sweep/output.h"
#include "jade/sweep/plan.h"
#include "support/temp_dir.h"

namespace jade::test {

struct TrainPart {
  int64_t iterations = 10;
  int64_t evaluate_every = 5;
  double rate = 0.5;
  std::string mode = "work";
};
template <class V>
void describe(V& v, TrainPart& o) {
  v.field("iterations", o.iterations, "steps", Range{1, 1e6});
  v.field("evaluate_every", o.evaluate_every, "steps", Range{0, 1e6});
  v.field("rate", o.rate, "a number", Range{0, 1});
  v.field("mode", o.mode, "what the program does");
}
struct DataPart {
  std::filesystem::path path;
};
template <class V>
void describe(V& v, DataPart& o) {
  v.field("path", o.path, "folder");
}
struct Settings {
  int64_t seed = 0;
  std::string device = "auto";
  DataPart dataset;
  TrainPart train;
};
template <class V>
void describe(V& v, Settings& o) {
  v.field("seed", o.seed, "seed");
  v.field("device", o.device, "device");
  v.group("dataset", o.dataset, "data");
  v.group("train", o.train, "training");
}

inline sweep::Resolved resolve(const std::vector<config::Sources>& layers) {
  Settings settings;
  const FieldList fields = fields_of(settings);
  for (const config::Sources& layer : layers) config::read(layer, fields);
  sweep::Resolved resolved{config::to_yaml(fields, "test"), config::values(fields), {}, ""};
  if (!settings.dataset.path.empty() && !std::filesystem::exists(settings.dataset.path)) {
    resolved.missing.push_back({"dataset.path", "expected " + settings.dataset.path.string()});
  }
  if (settings.train.mode == "rest" && settings.train.iterations > 10) {
    resolved.conflict = "train.mode: no rest of more than 10 steps";
  }
  return resolved;
}

/// The message of a ConfigError.
template <class Call>
std::string problems_of(const Call& call) {
  try {
    call();
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "";
}

/// A plan from the text of a sweep; scene "a" uses a.yaml, "b" b.yaml.
inline sweep::Plan plan_of(const TempDir& dir, const std::string& yaml,
                           sweep::PlanOptions options = {}) {
  dir.write("a.yaml", "train: {iterations: 10}\n");
  dir.write("b.yaml", "train: {iterations: 20, rate: 0.25}\n");
  return sweep::make_plan(sweep::read_spec(dir.write("test.yaml", yaml)), options, resolve);
}

/// A shell program with the command line and the files of the training program. train.mode: work;
/// diverge (exit 5 with a message); die (SIGKILL, the first time, after a checkpoint); hang (until
/// interrupted, which it records).
inline std::filesystem::path fake_trainer(const TempDir& dir) {
  const auto path = dir.write("fake_train", R"SH(#!/bin/sh
while [ $# -gt 0 ]; do
  case $1 in --config) config=$2; shift;; --output) out=$2; shift;; --device) device=$2; shift;; --resume) resume=yes;; esac
  shift
done
here=$(dirname "$0")
echo "start $out $device threads $OMP_NUM_THREADS resume ${resume:-no} wait ${OMP_WAIT_POLICY:-unset}" >> "$here/journal"
mkdir -p "$out/checkpoints"
mode=$(sed -n 's/^  mode: \([a-z]*\).*/\1/p' "$config")
seed=$(sed -n 's/^seed: \([0-9]*\).*/\1/p' "$config")
echo '{"step": 1, "memory_bytes": 1073741824, "iterations_per_second": 5}' > "$out/metrics.jsonl"
case $mode in
  diverge) echo 'error: step 3: loss blur is NaN' >&2; exit 5;;
  die) if [ -z "$resume" ]; then touch "$out/checkpoints/step_1.pt"; kill -9 $$; fi;;
  hang) trap 'touch "$out/checkpoints/step_1.pt"; echo asked >> "$here/journal"; exit 130' TERM; while :; do sleep 0.05; done;;
esac
sleep 0.3
echo "end $out" >> "$here/journal"
echo "{\"mean\": {\"psnr\": 3$seed.5, \"ssim\": 0.9, \"lpips_vgg\": null}}" > "$out/eval.json"
touch "$out/point_cloud.ply"
)SH");
  std::filesystem::permissions(path, std::filesystem::perms::owner_all);
  return path;
}

}  // namespace jade::test
