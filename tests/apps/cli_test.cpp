// SPDX-License-Identifier: Apache-2.0
// The programs from the command line: exit codes, one clear line on stderr, results on stdout.
#include "common/cli.h"

#include "support/catch.h"

#include <c10/util/Exception.h>
#include <new>
#include <torch/types.h>
#include <unistd.h>

#include "jade/core/atomic_file.h"
#include "jade/core/folder_lock.h"
#include "support/naming.h"
#include "support/programs.h"
#include "support/temp_dir.h"
#include "support/tiny_dataset.h"

using namespace jade;
using test::check_error;
using test::Outcome;
using test::run;
namespace fs = std::filesystem;

TEST_CASE("jade_train: the printed configuration prints itself", "[apps]") {
  const test::TempDir dir;
  const Outcome first =
      run(dir, "jade_train --print-config --set dataset.path=x --set route.lr=1e-3");
  CHECK(first.code == 0);
  dir.write("first.yaml", first.out);
  const Outcome second = run(dir, "jade_train --config /dev/stdin --print-config < first.yaml");
  CHECK(second.code == 0);
  CHECK(second.out == first.out);
}

TEST_CASE("print-config: says what the schedule's shares amount to in a run of this length",
          "[apps]") {
  const test::TempDir dir;
  const std::string out = run(dir, "jade_train --print-config --set train.iterations=3000").out;
  CHECK_THAT(out, Catch::Contains("\n  warmup: 6%  # ") && Catch::Contains("here 180 steps"));
  const std::string kept =
      run(dir, "jade_train --print-config --set train.iterations=3000 --set train.calendar=25000")
          .out;
  CHECK_THAT(kept, Catch::Contains("here 1500 steps"));
}

TEST_CASE("jade_train: configs/reference.yaml is what the program prints", "[apps]") {
  const test::TempDir dir;
  CHECK(run(dir, "jade_train --print-config").out ==
        read_file(JADE_SOURCE "/configs/reference.yaml"));
}

TEST_CASE("--config: settings that ship are found by their name from any folder", "[apps]") {
  const test::TempDir dir;
  const Outcome shipped =
      run(dir, "jade_train --print-config --config configs/paper.yaml --set dataset.path=x");
  CHECK(shipped.code == 0);
  CHECK_THAT(shipped.err, test::naming("configs/paper.yaml", "ships"));
  dir.write("configs/paper.yaml", "train: {iterations: 17}");
  const Outcome own = run(dir, "jade_train --print-config --config configs/paper.yaml");
  CHECK_THAT(own.out, Catch::Contains("iterations: 17"));
  CHECK(run(dir, "jade_train --print-config --config configs/none.yaml").code == 2);
}

TEST_CASE("programs: --print-config and --print-schema need no data", "[apps]") {
  const test::TempDir dir;
  for (const char* program : {"jade_train", "jade_deblur", "jade_import", "jade_simulate"}) {
    for (const char* flag : {" --print-config", " --print-schema"}) {
      const Outcome outcome = run(dir, concat(program, flag));
      INFO(program << flag << ": " << outcome.err);
      CHECK(outcome.code == 0);
    }
  }
}

TEST_CASE("programs: every configuration that ships can be read", "[apps]") {
  const test::TempDir dir;
  int count = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(JADE_SOURCE "/configs")) {
    const std::string path = entry.path().string();
    if (entry.path().extension() != ".yaml" || path.find("/sweeps/") != std::string::npos) continue;
    const bool simulated =
        path.find("/simulate/") != std::string::npos || path.find("/battery/") != std::string::npos;
    const std::string program = simulated ? "jade_simulate" : "jade_train";
    const Outcome outcome = run(dir, program + " --print-config --config " + path);
    INFO(path << ": " << outcome.err);
    CHECK(outcome.code == 0);
    ++count;
  }
  CHECK(count > 10);
}

TEST_CASE("jade_train: a mistake gets one line and its exit code", "[apps]") {
  const test::TempDir dir;
  dir.write("key.yaml", "train:\n  iteratons: 5\n");
  check_error(run(dir, "jade_train --config key.yaml"), 2, "key.yaml:2:3", "train.iteratons",
              "train.iterations?");
  check_error(run(dir, "jade_train --set train.iterations=many"), 2, "train.iterations", "'many'");
  check_error(run(dir, "jade_train --set objective.dssim=2"), 2, "objective.dssim", "0 to 1",
              "'2'");
  check_error(run(dir, "jade_train --config nowhere.yaml"), 2, "nowhere.yaml");
  dir.write("a.yaml", "extends: b.yaml\n");
  dir.write("b.yaml", "extends: a.yaml\n");
  check_error(run(dir, "jade_train --config a.yaml"), 2, "a.yaml", "b.yaml");
  dir.write("syntax.yaml", "train: {iterations: 5\n");
  check_error(run(dir, "jade_train --config syntax.yaml"), 2, "syntax.yaml:2:1");
  check_error(run(dir, "jade_train --nonsense"), 2, "--nonsense", "--help");
  check_error(run(dir, "jade_train --log-level loud"), 2, "debug, info, warn, error or off");
  check_error(run(dir, "jade_train --output run"), 2, "data set", "jade_train PATH");
  check_error(run(dir, "jade_train --set dataset.path=nothing"), 2, "--output");
  check_error(run(dir, "jade_train --set dataset.path=nothing --output run"), 3, "nothing");
  check_error(run(dir, "jade_train --set dataset.path=x --output /proc/run"), 3, "/proc/run");
  check_error(run(dir, "jade_train --set dataset.path=x --output run --device gpu"), 2, "device",
              "cuda:N");
  check_error(run(dir, "jade_train --set dataset.path=x --output run --device cuda:77"), 4,
              "device cuda:77");
}

TEST_CASE("programs: flags and assignments with a slip get the right one", "[apps]") {
  const test::TempDir dir;
  check_error(run(dir, "jade_train --outputt x"), 2, "--outputt", "--output?");
  check_error(run(dir, "jade_inspect --log-ofset=1 x"), 2, "--log-offset?");
  check_error(run(dir, "jade_simulate --outputt x y"), 2, "--outputt", "--output?");
  check_error(run(dir, "jade_train -o x"), 2, "-o", "--output?");
  check_error(run(dir, "jade_train --output"), 2, "--output", "DIR");
  check_error(run(dir, "jade_view --quiet"), 2, "SCENE");
  check_error(run(dir, "jade_bench slpat"), 2, "slpat", "splat?");
  check_error(run(dir, "jade_train --minutes nan"), 2, "--minutes", "0.5 to 100,000", "nan");
  check_error(run(dir, "jade_train --set train.iterations 200"), 2, "--set train.iterations=200");
  check_error(run(dir, "jade_train --set train.iterations --output x"), 2, "train.iterations=");
  const Outcome bare = run(dir, "jade_train");
  check_error(bare, 2, "--output");
  CHECK_THAT(bare.out, Catch::Contains("Usage: jade_train"));
}

TEST_CASE(
    "jade_train: the path behind it is a data set or the YAML of a scene, a recording is reported",
    "[apps]") {
  const test::TempDir dir;
  test::write_tiny_dataset(dir / "scene");
  const std::string print = " --print-config";
  CHECK_THAT(run(dir, "jade_train scene" + print).out, Catch::Contains((dir / "scene").string()));
  dir.write("scene/scene.yaml", "dataset: {path: .}\ntrain: {iterations: 77}\n");
  CHECK_THAT(run(dir, "jade_train scene" + print).out, Catch::Contains("iterations: 77"));
  CHECK_THAT(run(dir, "jade_train scene/scene.yaml --set train.iterations=5" + print).out,
             Catch::Contains("iterations: 5 "));
  dir.write("other.yaml", "dataset: {path: elsewhere}\n");
  check_error(run(dir, "jade_train scene --config other.yaml --output x"), 2, "scene", "elsewhere");
  // A folder that was moved, whose YAML names the old place.
  dir.write("scene/scene.yaml", "dataset: {path: /moved/away}\n");
  check_error(run(dir,
                  "jade_train scene --set dataset.path=scene --output x --device cpu "
                  "--set train.iterations=0"),
              2, "train.iterations");
  dir.write("events.txt", "0.001 1 2 1\n0.002 1 3 0\n");
  check_error(run(dir, "jade_train events.txt --output x"), 2, "jade_import events.txt");
  check_error(run(dir, "jade_train nowhere --output x"), 3, "nowhere");
  CHECK_THAT(run(dir, "jade_train nowhere --output x").err, !Catch::Contains("dataset.path"));
  dir.write("odd.bin", std::string("\x01\x02\x03\0\xFF", 5));
  check_error(run(dir, "jade_train odd.bin --output x"), 3, "odd.bin", "recording");
}

TEST_CASE("jade_train: trains, resumes and is scored from the command line", "[apps]") {
  const test::TempDir dir;
  test::write_tiny_dataset(dir.path() / "scene");
  const std::string train =
      "jade_train --quiet --device cpu --set dataset.path=scene --set objective.target=edi --set "
      "init.points=200 --output run ";
  CHECK(run(dir, train + "--set train.iterations=5").code == 0);
  check_error(run(dir, train + "--set train.iterations=8"), 3, "run", "--resume");
  const Outcome resumed = run(dir, train + "--set train.iterations=8 --resume");
  INFO(resumed.err);
  CHECK(resumed.code == 0);
  CHECK(std::filesystem::exists(dir.path() / "run/checkpoints/step_0000008.pt"));
  // Uses the run's own settings: by default the target would be EFNet, and nothing else names the
  // data.
  const Outcome further =
      run(dir, "jade_train --quiet --output run --resume --set train.iterations=9");
  INFO(further.err);
  CHECK(further.code == 0);
  CHECK(std::filesystem::exists(dir.path() / "run/checkpoints/step_0000009.pt"));
  CHECK_THAT(read_file(dir / "run/config.yaml"), Catch::Contains("target: edi"));
  check_error(run(dir, "jade_train --output nowhere --resume"), 2, "--resume", "nowhere");
  const Outcome scores = run(dir, "jade_eval --run run --device cpu --json");
  CHECK(scores.code == 0);
  CHECK_THAT(scores.out, Catch::Contains("psnr_channel_mean"));
  check_error(run(dir, "jade_eval --run nowhere"), 3, "nowhere", "run directory");
  check_error(run(dir, "jade_eval"), 2, "--run");
}

TEST_CASE("jade_train: the restorer is the one that ships, and is looked for before the data",
          "[apps]") {
  const test::TempDir dir;
  test::write_tiny_dataset(dir.path() / "scene");
  const Outcome trained = run(dir,
                              "jade_train --device cpu --set dataset.path=scene --set "
                              "init.points=100 --set train.iterations=2 --output run");
  INFO(trained.err);
  CHECK(trained.code == 0);
  CHECK_THAT(trained.err, Catch::Contains("efnet_anytime.pt"));
  CHECK_THAT(read_file(dir / "run/config.yaml"), Catch::Contains("path: \"\"  # TorchScript"));
  check_error(run(dir,
                  "jade_train --device cpu --set dataset.path=nothing --set efnet.path=nowhere.pt "
                  "--output other"),
              3, "efnet.path", "nowhere.pt");
}

namespace {

/// The exit code of a program whose body is `body`.
int code_of(const std::function<void()>& body) {
  apps::Program program("probe", "throws");
  char name[] = "probe", quiet[] = "--log-level=off";
  char* arguments[] = {name, quiet};
  return program.run(2, arguments, [&] {
    body();
    return ExitCode::kOk;
  });
}

}  // namespace

TEST_CASE("programs: a failure of the GPU has its own exit code, in any library", "[apps]") {
  const c10::SourceLocation here{__func__, __FILE__, __LINE__};
  CHECK(code_of([] {}) == 0);
  CHECK(code_of([&] { throw c10::AcceleratorError(here, 700, "CUDA error: illegal address"); }) ==
        4);
  CHECK(code_of([&] { throw c10::Error(here, "CUDA error: CUBLAS_STATUS_NOT_INITIALIZED"); }) == 4);
  CHECK(code_of([&] { throw c10::Error(here, "expected a tensor of CUDA error codes"); }) == 1);
}

TEST_CASE("programs: lack of memory has its own exit code, for any allocator", "[apps]") {
  CHECK(code_of([] { throw std::bad_alloc(); }) == 4);
  CHECK(code_of([] { torch::empty({int64_t(1) << 48}); }) == 4);  // more than the address space
}

TEST_CASE("jade_simulate: a disk that is full leaves no half of a data set", "[apps]") {
  const test::TempDir dir;
  const std::string tiny =
      "jade_simulate --quiet --set simulate.exposures=2 --set simulate.test_views=0 --set "
      "simulate.seen_test_views=0 --set simulate.width=36 --set simulate.height=28 --set "
      "simulate.focal_px=40 --set simulate.motion.blur_px=3 --output ";
  fs::create_directory(dir / "scene");
  // Limits file sizes to some kilobytes: enough for the pictures, not for the events.
  for (const std::string flag : {"scene", "scene --recording", "new"}) {
    check_error(run(dir, "ulimit -f 12\n" + tiny + flag), 3, "space");
    CHECK(fs::is_empty(dir / "scene"));
    CHECK_FALSE(fs::exists(dir / "new"));
  }
  CHECK(run(dir, tiny + "scene").code == 0);
  CHECK(fs::exists(dir / "scene" / "events.h5"));
}

TEST_CASE("jade_simulate: a used folder is refused, and replaced without remains", "[apps]") {
  const test::TempDir dir;
  const auto simulate = [&](int exposures, const std::string& flags) {
    return concat("jade_simulate --quiet --set simulate.exposures=", exposures,
                  " --set simulate.test_views=0 --set simulate.seen_test_views=0 --set "
                  "simulate.width=36 --set simulate.height=28 --set simulate.focal_px=40 --set "
                  "simulate.motion.blur_px=3 ",
                  flags);
  };
  REQUIRE(run(dir, simulate(3, "--recording --output scene")).code == 0);
  write_file(dir / "scene/notes.md", "mine");
  check_error(run(dir, simulate(2, "--output scene")), 2, "--output", "scene", "--force");
  REQUIRE(run(dir, simulate(2, "--force --output scene")).code == 0);
  for (const char* old : {"images", "events.txt", "images.txt", "truth"})
    CHECK_FALSE(fs::exists(dir / "scene" / old));
  CHECK(fs::exists(dir / "scene/notes.md"));
  CHECK(fs::exists(dir / "scene/events.h5"));
  CHECK_FALSE(fs::exists(dir / "scene/.lock"));
  fs::remove(dir / "scene/simulation.yaml");
  check_error(run(dir, simulate(2, "--force --output scene")), 2, "--force", "images_1",
              "simulation.yaml");
  fs::create_directory(dir / "other");
  const auto lock = FolderLock::take(dir / "other");
  check_error(run(dir, simulate(2, "--output other")), 3, "other", "another jade_simulate");
}

TEST_CASE("programs: all answer --version and --help", "[apps]") {
  const test::TempDir dir;
  for (const char* program :
       {"jade_train", "jade_eval", "jade_simulate", "jade_deblur", "jade_inspect", "jade_render"}) {
    INFO(program);
    const Outcome version = run(dir, std::string(program) + " --version");
    CHECK(version.code == 0);
    CHECK_THAT(version.out, Catch::Contains("torch 2."));
    CHECK(run(dir, std::string(program) + " --help").code == 0);
  }
}

TEST_CASE("programs: whole numbers of flags are decimal, other text is reported", "[apps]") {
  const test::TempDir dir;
  const Outcome zeros = run(dir, "jade_train --print-config --seed 010 --set train.iterations=010");
  CHECK_THAT(zeros.out, Catch::Contains("\nseed: 10 "));
  CHECK_THAT(zeros.out, Catch::Contains("  iterations: 10 "));
  for (const std::string seed : {"-1", "1e3", "x"}) {
    check_error(run(dir, "jade_train --print-config --seed=" + seed), 2, "--seed", "0 or more");
  }
  check_error(run(dir, "jade_bench losses --repeats 0"), 2, "--repeats", "1 or more");
}

TEST_CASE("programs: a path without a flag is answered with the flag that takes it", "[apps]") {
  const test::TempDir dir;
  test::write_tiny_dataset(dir / "scene");
  dir.write("run/config.yaml", "seed: 1\n");
  dir.write("a.ply", "ply\n");
  dir.write("a.yaml", "seed: 1\n");
  for (const std::string program : {"jade_eval", "jade_export", "jade_render", "jade_deblur"})
    check_error(run(dir, program + " run"), 2, "run: ", "--run run");
  for (const std::string program : {"jade_eval", "jade_render", "jade_deblur"})
    check_error(run(dir, program + " scene"), 2, "--dataset scene");
  check_error(run(dir, "jade_export a.ply"), 2, "--ply a.ply");
  check_error(run(dir, "jade_simulate a.yaml"), 2, "--config a.yaml");
  check_error(run(dir, "jade_sweep a.yaml"), 2, "--sweep a.yaml");
  check_error(run(dir, "jade_sweep nowhere"), 2, "nowhere");
}

TEST_CASE("programs: a folder that may not be read is named, with the exit code of data",
          "[apps]") {
  const test::TempDir dir;
  test::write_tiny_dataset(dir / "closed/scene");
  fs::permissions(dir / "closed", fs::perms::none);
  // Without these two capabilities permissions bind root too; it keeps access to LibTorch below
  // /root.
  const std::string bound =
      geteuid() == 0 ? "setpriv --bounding-set -dac_override,-dac_read_search " : "";
  for (const std::string call :
       {"jade_inspect closed/scene", "jade_train closed/scene --output run",
        "jade_import closed/scene --output data"}) {
    check_error(run(dir, bound + call), 3, "closed/scene");
  }
  fs::permissions(dir / "closed", fs::perms::owner_all);
}

TEST_CASE("programs: results that standard output does not take are not lost in silence",
          "[apps]") {
  const test::TempDir dir;
  check_error(run(dir, "jade_train --print-config > /dev/full"), 3, "standard output");
  for (const std::string flag : {"--help", "--version"})
    check_error(run(dir, "jade_train " + flag + " > /dev/full"), 3, "standard output");
  const Outcome closed = run(dir, "bash -c 'set -o pipefail; jade_train --print-config | head -1'");
  CHECK(closed.err.empty());
}

TEST_CASE("jade_train: a value of --set may hold what YAML takes for a comment or a key",
          "[apps]") {
  const test::TempDir dir;
  for (const std::string path : {"a # c", "#a", "a: b"}) {
    check_error(run(dir, "jade_train --output run --set 'dataset.path=" + path + "'"), 3,
                path + ": no such folder");
  }
}

TEST_CASE("jade_train: the data set is no folder for a run, nor is one whose images/ are frames",
          "[apps]") {
  const test::TempDir dir;
  test::write_tiny_dataset(dir / "scene");
  const std::string train =
      "jade_train --device cpu --set train.iterations=1 --set objective.target=none ";
  check_error(run(dir, train + "--set dataset.path=scene --output ./scene/"), 2, "--output",
              "./scene/");
  // A list of another layout in the data set does not matter.
  dir.write("scene/transforms.json", R"({"frames":[{"file_path":"gone.png"}]})");
  CHECK(run(dir, train + "--set dataset.path=scene --output run").code == 0);
  fs::create_directories(dir / "set");
  fs::create_directories(dir / "other");
  fs::rename(dir / "scene/images_1", dir / "other/images");
  dir.write("set/transforms.json",
            R"({"fl_x":50,"w":36,"h":28,"frames":[{"file_path":"../other/images/00.png",)"
            R"("transform_matrix":[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]})");
  check_error(run(dir, train + "--set dataset.path=set --output other"), 2, "--output");
  check_error(run(dir, "jade_deblur --method edi --dataset set --output other/images"), 2,
              "--output");
}

TEST_CASE("jade_eval: settings that folders of images do not need are refused", "[apps]") {
  const test::TempDir dir;
  const std::string eval = "jade_eval --renders a --truth b ";
  for (const char* setting : {"--dataset c", "--set dataset.path=c", "--set dataset.split=last",
                              "--set splat.near_plane=1"}) {
    check_error(run(dir, eval + setting), 2, std::string(setting).substr(0, 9),
                ": expected with --run", "take it out");
  }
  // The folders are looked for only after the settings.
  check_error(run(dir, eval + "--set device=cpu --set dataset.mask=m.png"), 3, "a");
}

TEST_CASE("jade_eval: --output is a folder", "[apps]") {
  const test::TempDir dir;
  check_error(run(dir, "jade_eval --renders a --truth b --output scores.json"), 2, "--output",
              "eval.json", "scores.json");
  CHECK_FALSE(std::filesystem::exists(dir / "scores.json"));
}
