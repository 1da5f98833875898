// SPDX-License-Identifier: Apache-2.0
// jade_bench: the benchmarks behind every performance figure, one file each.
#include "common/cli.h"
#include "events.h"
#include "iteration.h"
#include "losses.h"
#include "quality.h"
#include "restorer.h"
#include "run.h"
#include "splat.h"

int main(int argc, char** argv) {
  using namespace jade;
  apps::Program program("jade_bench", "Times the parts of the program");
  program.add_example("jade_bench splat --workload W1");
  program.add_example("jade_bench run --config configs/demo.yaml --psnr 28 --output runs/timed");
  program.add_device_flag();
  program.add_json_flag();
  program.cli().require_subcommand(1);
  program.begin_group("Timing");
  bench::SplatBench splat;
  CLI::App* const splat_command = splat.add_to(program.cli());
  bench::IterationBench iteration;
  CLI::App* const iteration_command = iteration.add_to(program);
  bench::RestorerBench restorer;
  CLI::App* const restorer_command = restorer.add_to(program.cli());
  bench::EventsBench events;
  CLI::App* const events_command = events.add_to(program.cli());
  bench::LossesBench losses;
  CLI::App* const losses_command = losses.add_to(program.cli());
  bench::RunBench run;
  CLI::App* const run_command = run.add_to(program);
  bench::QualityBench quality;
  CLI::App* const quality_command = quality.add_to(program);
  program.add_example(*splat_command, "jade_bench splat --workload W1,W2");
  program.add_example(*splat_command, "jade_bench splat --workload W1 --repeats 20 --json");
  program.add_example(*iteration_command, "jade_bench iteration --workload W1");
  program.add_example(*iteration_command, "jade_bench iteration --set objective.target=edi");
  program.add_example(*restorer_command, "jade_bench restorer --size 346x260");
  program.add_example(*restorer_command, "jade_bench restorer --device cpu --repeats 3");
  program.add_example(*events_command, "jade_bench events");
  program.add_example(*events_command, "jade_bench events --width 346 --height 260 --count 500000");
  program.add_example(*losses_command, "jade_bench losses --repeats 20");
  program.add_example(*losses_command, "jade_bench losses --term rec --json");
  program.add_example(*run_command,
                      "jade_bench run --config configs/demo.yaml --psnr 28 --output runs/timed");
  program.add_example(*run_command, "jade_bench run --config table.yaml --every 50 --output timed");
  program.add_example(*quality_command, "jade_bench quality runs/table --psnr 28");
  program.add_example(*quality_command, "jade_bench quality runs --psnr 28,30 --csv quality.csv");
  return program.run(argc, argv, [&] {
    if (splat_command->parsed()) return splat.run(program);
    if (iteration_command->parsed()) return iteration.run(program);
    if (restorer_command->parsed()) return restorer.run(program);
    if (events_command->parsed()) return events.run(program);
    if (losses_command->parsed()) return losses.run(program);
    if (run_command->parsed()) return run.run(program);
    if (quality_command->parsed()) return quality.run(program);
    return ExitCode::kUsage;
  });
}
