// SPDX-License-Identifier: Apache-2.0
// Everything that a run's YAML can say, composed from the options of the modules.
#pragma once

#include <cstdint>
#include <string>

#include "jade/core/fields.h"
#include "jade/data/dataset.h"

namespace jade::train {

struct TrainOptions {
  int64_t iterations = 25000;
  int64_t log_every = 100;
  int64_t evaluate_every = 5000;
  int64_t picture_every = 5000;
};

template <class V>
void describe(V& v, TrainOptions& o) {
  v.field("iterations", o.iterations, "training steps; the paper's budget is 25000", Range{1, 1e8});
  v.field("log_every", o.log_every, "steps between lines of metrics.jsonl", Range{1, 1e8});
  v.field("evaluate_every", o.evaluate_every,
          "steps between evaluations on the test views; 0: only at the end", Range{0, 1e8});
  v.field("picture_every", o.picture_every,
          "steps between pictures in images/ and alpha/; 0: only at the end", Range{0, 1e8});
}

struct CheckpointOptions {
  int64_t every = 5000;
  int64_t keep = 2;
};

template <class V>
void describe(V& v, CheckpointOptions& o) {
  v.field("every", o.every, "steps between checkpoints; 0: only at the end", Range{0, 1e8});
  v.field("keep", o.keep, "how many of the newest checkpoints stay", Range{1, 1000});
}

struct RunOptions {
  int64_t seed = 0;
  std::string device = "auto";
  bool deterministic = false;
  data::DatasetOptions dataset;
  TrainOptions train;
  CheckpointOptions checkpoint;
};

template <class V>
void describe(V& v, RunOptions& o) {
  v.field("seed", o.seed, "seed of every random draw", Range{0, 9e15});
  v.field("device", o.device, "auto (a GPU if there is one), cpu, cuda or cuda:N");
  v.field("deterministic", o.deterministic,
          "bit-identical results on a GPU too, somewhat slower; the CPU always is");
  v.group("dataset", o.dataset, "where the frames, events and poses are");
  v.group("train", o.train, "the calendar of a run");
  v.group("checkpoint", o.checkpoint, "what a run can be resumed from");
}

/// Rules between fields.
/// @throws ConfigError naming the keys.
void validate(const RunOptions& options);

}  // namespace jade::train
