// SPDX-License-Identifier: Apache-2.0
#include "support/catch.h"

#include <csignal>
#include <torch/types.h>

#include "jade/core/atomic_file.h"
#include "jade/core/check.h"
#include "jade/core/device.h"
#include "jade/core/digest.h"
#include "jade/core/interrupt.h"
#include "jade/core/progress.h"
#include "jade/core/random.h"
#include "support/temp_dir.h"

using namespace jade;

TEST_CASE("error: each type carries its documented exit code", "[core]") {
  CHECK(static_cast<int>(ConfigError("").exit_code()) == 2);
  CHECK(static_cast<int>(DataError("").exit_code()) == 3);
  CHECK(static_cast<int>(DeviceError("").exit_code()) == 4);
  CHECK(static_cast<int>(NumericError("").exit_code()) == 5);
  CHECK(static_cast<int>(CheckpointError("").exit_code()) == 6);
  CHECK(static_cast<int>(Interrupted().exit_code()) == 130);
  CHECK(static_cast<int>(ContractError("").exit_code()) == 1);
}

TEST_CASE("check_shape: names the tensor, what was expected and what was found", "[core]") {
  const auto image = torch::zeros({3, 4, 5});
  CHECK_NOTHROW(check_shape(image, "image", {3, -1, 5}));
  CHECK_THROWS_WITH(check_shape(image, "image", {3, 4}),
                    "image: expected shape [3, 4], found [3, 4, 5]");
  CHECK_THROWS_WITH(check_shape(image, "image", {3, -1, 6}),
                    "image: expected shape [3, any, 6], found [3, 4, 5]");
  CHECK_THROWS_AS(check_shape(torch::Tensor(), "image", {1}), ContractError);
}

TEST_CASE("make_generator: purposes are independent and repeatable", "[core]") {
  auto a = make_generator(7, "view order"), b = make_generator(7, "view order");
  auto other = make_generator(7, "pose draws"), seed = make_generator(8, "view order");
  const auto draw = [](at::Generator& g) { return torch::rand({16}, g); };
  const auto first = draw(a);
  CHECK(first.equal(draw(b)));
  CHECK_FALSE(first.equal(draw(other)));
  CHECK_FALSE(first.equal(draw(seed)));
}

TEST_CASE("make_generator: its state restores the stream", "[core]") {
  auto generator = make_generator(1, "test");
  draw_index(generator, 10);
  const auto state = generator.get_state();
  const auto expected = torch::rand({8}, generator);
  generator.set_state(state);
  CHECK(expected.equal(torch::rand({8}, generator)));
}

TEST_CASE("draw_index: covers its range evenly", "[core]") {
  auto generator = make_generator(3, "test");
  std::vector<int> counts(5);
  for (int i = 0; i < 5000; ++i) ++counts.at(static_cast<size_t>(draw_index(generator, 5)));
  for (const int count : counts) CHECK(std::abs(count - 1000) < 150);  // five standard deviations
  CHECK_THROWS_AS(draw_index(generator, 0), ContractError);
}

TEST_CASE("AtomicFile: without commit the old content stays and no trace is left", "[core]") {
  const test::TempDir dir;
  const auto path = dir.write("file.txt", "old");
  {
    AtomicFile file(path);
    std::ofstream(file.temporary_path()) << "new";
  }
  CHECK(read_file(path) == "old");
  CHECK(std::distance(std::filesystem::directory_iterator(dir.path()), {}) == 1);
  write_file(path, "new");
  CHECK(read_file(path) == "new");
  CHECK(std::distance(std::filesystem::directory_iterator(dir.path()), {}) == 1);
}

TEST_CASE("files: what cannot be written or read is a DataError that names the path", "[core]") {
  const test::TempDir dir;
  const auto file = dir.write("file.txt", "x");
  CHECK_THROWS_AS(AtomicFile(dir.path() / "missing" / "a.txt"), DataError);
  CHECK_THROWS_WITH(make_writable_folder(file / "sub"), Catch::Contains("file.txt"));
  CHECK_THROWS_WITH(read_file(dir.path()), Catch::Contains(dir.path().string()));
  CHECK_THROWS_AS(write_file("/dev/full/x", "content"), DataError);
}

TEST_CASE("Sha256: gives the published digest of 'abc' (FIPS 180-4)", "[core]") {
  const test::TempDir dir;
  const std::string expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
  CHECK(file_sha256(dir.write("file", "abc")) == expected);
  Sha256 pieces;
  pieces.update("a");
  pieces.update("bc");
  CHECK(pieces.hex() == expected);
  CHECK_THROWS_AS(file_sha256(dir.path() / "missing"), DataError);
}

TEST_CASE("interrupt: a signal sets the flag that long work asks for", "[core]") {
  install_interrupt_handlers();
  CHECK_FALSE(interrupt_requested());
  CHECK_NOTHROW(throw_if_interrupted());
  std::raise(SIGTERM);
  CHECK(interrupt_requested());
  CHECK_THROWS_AS(throw_if_interrupted(), Interrupted);
  set_interrupt_requested(false);
}

TEST_CASE("trim_device_memory: gives back what no tensor holds, and only beyond what may be kept",
          "[core][cuda]") {
  constexpr int64_t kBytes = int64_t{256} << 20;
  const torch::Device device(torch::kCUDA, 0);
  const torch::Tensor held = torch::ones({1024}, device);
  torch::empty({kBytes}, torch::dtype(torch::kUInt8).device(device));
  CHECK(trim_device_memory(device, 4 * kBytes) == 0);
  CHECK(trim_device_memory(device, kBytes / 2) >= kBytes);
  CHECK(trim_device_memory(device, kBytes / 2) == 0);
  CHECK(held.sum().item<float>() == 1024);
}

TEST_CASE("trim_device_memory: has nothing to do on the CPU", "[core]") {
  CHECK(trim_device_memory(torch::kCPU, 0) == 0);
}

TEST_CASE("select_device: words it does not know and GPUs that are not there are told apart",
          "[core]") {
  CHECK(select_device("cpu").is_cpu());
  CHECK(select_device("auto").is_cuda() == (cuda_device_count() > 0));
  for (const char* word : {"gpu", "cuda:", "cuda:x", "cuda:-1", ""}) {
    CHECK_THROWS_AS(select_device(word), ConfigError);
  }
  CHECK_THROWS_AS(select_device("cuda:63"), DeviceError);
}

TEST_CASE("duration_text: reads as a clock", "[core]") {
  CHECK(duration_text(5.2) == "0:05");
  CHECK(duration_text(245) == "4:05");
  CHECK(duration_text(3723) == "1:02:03");
}

TEST_CASE("Progress: off a terminal a report is due every ten seconds, not every step", "[core]") {
  Progress progress("work", 1000);
  int due = 0;
  for (int i = 0; i < 1000; ++i) due += progress.step() ? 1 : 0;
  CHECK(due <= 1);
}
