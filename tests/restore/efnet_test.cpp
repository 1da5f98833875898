// SPDX-License-Identifier: Apache-2.0
#include "jade/restore/efnet.h"

#include "support/catch.h"

#include <cmath>
#include <torch/script.h>

#include "jade/core/atomic_file.h"
#include "jade/core/digest.h"
#include "jade/core/error.h"
#include "support/naming.h"
#include "support/stub_restorer.h"
#include "support/temp_dir.h"

namespace jade::restore {
namespace {

using test::kAnyTimeMetadata;
using test::kStubMetadata;
using test::save_any_time_restorer;
using test::save_restorer;

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  return text.replace(text.find(from), from.size(), to);
}

template <class Error>
std::string message_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const Error& error) {
    return error.what();
  }
  return "no such error";
}

torch::Tensor bins() {
  return torch::arange(1, 7, torch::kFloat32).view({1, 6, 1, 1}).repeat({1, 1, 9, 10});
}

TEST_CASE("efnet: without a path the restorer that ships is meant", "[restore]") {
  const auto shipped = restorer_path({});
  CHECK(shipped.filename() == "efnet_anytime.pt");
  CHECK(restorer_file_sha256({}) == file_sha256(shipped));
  CHECK(Restorer(EfnetOptions()).metadata().kind == "efnet");
  EfnetOptions own;
  own.path = "own.pt";
  CHECK(restorer_path(own) == "own.pt");
  CHECK_THROWS_WITH(restorer_file_sha256(own),
                    test::naming("efnet.path") && test::naming("own.pt"));
}

TEST_CASE("efnet: SCER sums the bins outwards from mid-exposure", "[restore]") {
  const torch::Tensor scer = scer_from_bins(bins())[0].select(2, 0).select(1, 0);
  CHECK(torch::equal(scer, torch::tensor({-6.f, -5.f, -3.f, 4.f, 9.f, 15.f})));
}

TEST_CASE("efnet: views are divided by their largest magnitude, empty ones stay zero",
          "[restore]") {
  torch::Tensor events = torch::cat({bins(), torch::zeros({1, 6, 9, 10})});
  events[0][2][1][1] = -12;
  const torch::Tensor out = normalize_views(events);
  CHECK(out[0].abs().max().item<float>() == 1);
  CHECK(out[0][2][1][1].item<float>() == -1);
  CHECK(out[1].abs().max().item<float>() == 0);
}

TEST_CASE("efnet: each view of a batch is divided by its own largest magnitude", "[restore]") {
  const torch::Tensor out = normalize_views(torch::cat({4 * bins(), bins()}));
  CHECK(out[0].abs().max().item<float>() == 1);
  CHECK(out[1].equal(out[0]));
}

TEST_CASE("efnet: the mask closes gaps of one pixel and keeps single events single", "[restore]") {
  torch::Tensor events = torch::zeros({1, 6, 9, 9});
  events[0][3][4][2] = 1;
  events[0][0][4][4] = -1;
  events[0][5][0][0] = 1;
  const torch::Tensor mask = event_mask(events)[0][0];
  CHECK(mask[4][2].item<float>() == 1);
  CHECK(mask[4][3].item<float>() == 1);
  CHECK(mask[4][4].item<float>() == 1);
  CHECK(mask[0][0].item<float>() == 1);
  CHECK(mask.sum().item<float>() == 4);
}

TEST_CASE("efnet: images are padded by replication, events and mask by zeros, and cropped back",
          "[restore]") {
  const test::TempDir folder;
  // Asserts inside the network; returns the image plus a value that the padding of the others must
  // not have.
  const auto path =
      save_restorer(folder / "r.pt",
                    "  assert image.size(2) == 12\n"
                    "  assert image.size(3) == 12\n"
                    "  assert bool((image[:, :, 9:, :] == image[:, :, 8:9, :]).all())\n"
                    "  assert bool((events[:, :, 9:, :] == 0).all())\n"
                    "  assert bool((mask[:, :, :, 10:] == 0).all())\n"
                    "  assert bool((mask[:, :, :9, :10] == 1).all())\n"
                    "  return image + events[:, 5:6]\n");
  Restorer restorer({path});
  const torch::Tensor image = torch::rand({3, 9, 10}) - 1.5;
  const torch::Tensor out = restorer.restore(image, 7 * bins()[0]);
  CHECK(out.sizes() == image.sizes());
  CHECK(torch::allclose(out, (image + 1).clamp(0, 1)));
  CHECK(restorer.restore(image.unsqueeze(0), bins()).dim() == 4);
  CHECK(restorer.metadata().name == "probe");
  CHECK(restorer_file_sha256({path}) == file_sha256(path));
}

TEST_CASE("efnet: plain bins go in where the metadata says so, and image restorers get no events",
          "[restore]") {
  const test::TempDir folder;
  const auto path = save_restorer(folder / "bins.pt", "  return image * 0 + events[:, 0:1]\n",
                                  replaced(kStubMetadata, "scer", "bins"));
  const torch::Tensor image = torch::rand({3, 8, 8});
  const torch::Tensor six = bins()[0].narrow(1, 0, 8).narrow(2, 0, 8);
  CHECK(torch::allclose(Restorer({path}).restore(image, six), torch::full({3, 8, 8}, 1 / 6.f)));
  std::string metadata = replaced(kStubMetadata, "\"efnet\"", "\"image\"");
  metadata = replaced(metadata, "scer", "none");
  const auto plain =
      save_restorer(folder / "image.pt", "  return image * 0.5\n", metadata, "image");
  CHECK(torch::allclose(Restorer({plain}).restore(image, {}), image / 2));
}

TEST_CASE("efnet: files that are none are refused with what to do", "[restore]") {
  const test::TempDir folder;
  const auto load = [](const std::filesystem::path& path) {
    return message_of<DataError>([&] { Restorer({path}); });
  };
  write_file(folder / "text.pt", "hello");
  CHECK(load(folder / "text.pt").find("no TorchScript") != std::string::npos);
  CHECK(load(folder / "missing.pt").find("missing.pt") != std::string::npos);
  const std::string body = "  return image\n";
  const auto bad = [&](const std::string& metadata) {
    return load(save_restorer(folder / "bad.pt", body, metadata));
  };
  CHECK(bad("").find("export_efnet.py") != std::string::npos);
  CHECK(bad("{").find("bad jade_efnet.json") != std::string::npos);
  CHECK(bad(replaced(kStubMetadata, "\"width\"", "\"wide\"")).find("width") != std::string::npos);
  CHECK(bad(replaced(kStubMetadata, "\"format_version\": 1", "\"format_version\": 3"))
            .find("version 3") != std::string::npos);
  CHECK(bad(replaced(kStubMetadata, "scer", "none")).find("does not fit") != std::string::npos);
  CHECK(bad(replaced(kStubMetadata, "\"padding_multiple\": 4", "\"padding_multiple\": 0"))
            .find("no sense") != std::string::npos);
  const auto good = save_restorer(folder / "good.pt", body);
  CHECK(load(good) == "no such error");
  // Another file's metadata, or weights that were changed after the export.
  std::string metadata = kStubMetadata;
  metadata.replace(metadata.find("e3b0c442"), 8, "00000000");
  CHECK(bad(metadata).find("it holds e3b0c442") != std::string::npos);
  const std::string whole = read_file(good);
  write_file(folder / "cut.pt", whole.substr(0, whole.size() / 2));
  CHECK(load(folder / "cut.pt").find("no TorchScript") != std::string::npos);
}

TEST_CASE("efnet: NaN, wrong shapes and refusals of the network are reported", "[restore]") {
  const test::TempDir folder;
  const torch::Tensor image = torch::rand({3, 8, 8});
  const torch::Tensor voxel = torch::zeros({6, 8, 8});
  Restorer nan({save_restorer(folder / "nan.pt", "  return image / 0 - image / 0\n")});
  CHECK_THROWS_AS(nan.restore(image, voxel), NumericError);
  Restorer shape({save_restorer(folder / "shape.pt", "  return image[:, :1]\n")});
  CHECK_THROWS_AS(shape.restore(image, voxel), DataError);
  Restorer refuses({save_restorer(folder / "no.pt", "  assert False\n  return image\n")});
  CHECK_THROWS_AS(refuses.restore(image, voxel), DataError);
  CHECK_THROWS_AS(refuses.restore(image, torch::zeros({5, 8, 8})), ContractError);
}

/// Counts of four windows, each a different number.
torch::Tensor counts(int64_t height, int64_t width) {
  return torch::arange(4, torch::kFloat32).view({4, 1, 1}).repeat({1, height, width});
}

TEST_CASE("efnet: moments reach the network in their order, all in one call", "[restore]") {
  const test::TempDir folder;
  const std::vector<double> times{1, 0, 0.25};
  Restorer restorer({save_any_time_restorer(folder / "t.pt",
                                            "  assert image.size(0) == time.size(0)\n"
                                            "  assert image.size(0) == 3 or image.size(0) == 1\n"
                                            "  assert bool((counts[:, 3] == 3).all())\n"
                                            "  return image * 0 + time.view(-1, 1, 1, 1)\n")});
  const torch::Tensor image = torch::rand({3, 8, 12});
  const torch::Tensor out = restorer.restore(image, counts(8, 12), times);
  CHECK(out.sizes() == torch::IntArrayRef({3, 3, 8, 12}));
  for (int64_t k = 0; k < 3; ++k) {
    CHECK(out[k].equal(torch::full({3, 8, 12}, times[static_cast<size_t>(k)])));
  }
  CHECK(restorer.restore(image, counts(8, 12)).equal(torch::full({3, 8, 12}, 0.5)));
  CHECK(restorer.batch() == 0);
  CHECK_THROWS_AS(restorer.restore(image, counts(8, 12), {1.25}), ContractError);
  CHECK_THROWS_AS(restorer.restore(image, counts(8, 12), {}), ContractError);
  CHECK_THROWS_AS(restorer.restore(image, counts(8, 12).narrow(0, 0, 3), {0}), ContractError);
}

/// Mixes each pixel with its neighbours and the events, depending on the moment; rejects more than
/// `images`.
std::filesystem::path save_mixing(const std::filesystem::path& path, int images) {
  return save_any_time_restorer(
      path, "  assert image.size(0) <= " + std::to_string(images) +
                ", 'CUDA out of memory. Tried to allocate'\n"
                "  near = torch.max_pool2d(image, [3, 3], [1, 1], [1, 1])\n"
                "  t = time.view(-1, 1, 1, 1)\n"
                "  return t * image + (1 - t) * near + 0.01 * t * counts.cumsum(1)[:, 2:3]\n");
}

TEST_CASE("efnet: a batch of moments equals one by one, also where memory asks for less",
          "[restore]") {
  const test::TempDir folder;
  const torch::Tensor image = torch::rand({3, 13, 10}), events = torch::randn({4, 13, 10});
  const std::vector<double> times{0, 0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1};
  Restorer whole({save_mixing(folder / "whole.pt", 9)});
  Restorer small({save_mixing(folder / "small.pt", 2)});
  const torch::Tensor together = whole.restore(image, events, times);
  CHECK(whole.batch() == 0);
  CHECK(torch::equal(small.restore(image, events, times), together));
  CHECK(small.batch() == 2);  // 9, 4, 2
  CHECK(small.tile() == 0);
  for (size_t k = 0; k < times.size(); ++k) {
    const auto row = static_cast<int64_t>(k);
    CHECK(torch::equal(whole.restore(image, events, {times[k]})[0], together[row]));
  }
  CHECK_FALSE(together[0].equal(together[8]));
}

TEST_CASE("efnet: on a CPU large frames go in one by one and small ones together", "[restore]") {
  const test::TempDir folder;
  Restorer restorer({save_any_time_restorer(
      folder / "n.pt", "  return image * 0 + 0.1 * image.size(0) * torch.ones_like(image)\n")});
  const auto in_one_call = [&](int64_t side) {
    const torch::Tensor out =
        restorer.restore(torch::rand({3, side, side}), torch::zeros({4, side, side}), {0, 0.5, 1});
    return std::lround(10 * out[0][0][0][0].item<double>());
  };
  CHECK(in_one_call(16) == 3);
  CHECK(in_one_call(1024) == 1);
  CHECK(restorer.batch() == 0);
}

TEST_CASE("efnet: who restores the middle only says so when another moment is asked for",
          "[restore]") {
  const test::TempDir folder;
  const torch::Tensor image = torch::rand({3, 8, 8}), voxel = torch::zeros({6, 8, 8});
  Restorer old({save_restorer(folder / "old.pt", "  return image\n")});
  CHECK(torch::allclose(old.restore(image, voxel, {0.5})[0], image));
  const std::string text = message_of<DataError>([&] { old.restore(image, voxel, {0.5, 0.25}); });
  for (const char* part : {"old.pt", "version 1", "middle", "0.25", "efnet.path"}) {
    INFO(part);
    CHECK(text.find(part) != std::string::npos);
  }
  CHECK(text.find('\n') == std::string::npos);
  std::string metadata =
      replaced(replaced(kStubMetadata, "\"efnet\"", "\"image\""), "scer", "none");
  Restorer plain({save_restorer(folder / "i.pt", "  return image\n", metadata, "image")});
  CHECK(message_of<DataError>([&] { plain.restore(image, {}, {0}); }).find("kind image") !=
        std::string::npos);
}

TEST_CASE("efnet: frames of 8 px, with and without events, are restored at any moment",
          "[restore]") {
  const test::TempDir folder;
  const std::string metadata =
      replaced(kAnyTimeMetadata, "\"padding_multiple\": 4", "\"padding_multiple\": 16");
  const auto path =
      save_any_time_restorer(folder / "r.pt",
                             "  assert image.size(2) % 16 == 0\n"
                             "  assert bool((counts[:, :, 8:, :] == 0).all())\n"
                             "  assert bool((image[:, :, 8:] == image[:, :, 7:8]).all())\n"
                             "  return image + 0.1 * counts[:, 0:1]\n",
                             metadata);
  Restorer restorer({path});
  for (const int64_t width : {8, 9, 17}) {
    const torch::Tensor image = torch::rand({3, 8, width}) * 0.8;
    const torch::Tensor none = torch::zeros({4, 8, width});
    CHECK(torch::allclose(restorer.restore(image, none, {0, 1})[1], image));
    CHECK(torch::allclose(restorer.restore(image, none + 1, {0, 1})[1], image + 0.1));
  }
}

TEST_CASE("efnet: NaN at one of several moments is reported", "[restore]") {
  const test::TempDir folder;
  Restorer restorer({save_any_time_restorer(
      folder / "nan.pt", "  return image + 0 / (time.view(-1, 1, 1, 1) - 0.25).abs()\n")});
  const torch::Tensor image = torch::rand({3, 8, 8}), none = torch::zeros({4, 8, 8});
  CHECK(restorer.restore(image, none, {0, 1}).isfinite().all().item<bool>());
  CHECK_THROWS_AS(restorer.restore(image, none, {0, 0.25}), NumericError);
}

TEST_CASE("efnet: weights stored as float16 work, and hash, as float32", "[restore]") {
  const test::TempDir folder;
  const auto save = [&](const std::string& dtype, torch::ScalarType type) {
    torch::jit::Module module("half");
    module.register_parameter("gain", torch::tensor({0.7}).to(torch::kHalf).to(type), false);
    module.define("def forward(self, image, counts, time):\n  return image * self.gain\n");
    std::string metadata = replaced(kAnyTimeMetadata, "\"float32\"", "\"" + dtype + "\"");
    const size_t hash = metadata.find("e3b0c442");
    metadata.replace(hash, 64, weights_sha256(module));
    const auto path = folder / (dtype + ".pt");
    module.save(path.string(), {{"jade_efnet.json", metadata}});
    return path;
  };
  const torch::Tensor image = torch::rand({3, 8, 8}), none = torch::zeros({4, 8, 8});
  Restorer half({save("float16", torch::kHalf)}), full({save("float32", torch::kFloat32)});
  CHECK(half.metadata().stored_as_half);
  CHECK(half.metadata().weights_sha256 == full.metadata().weights_sha256);
  CHECK(torch::equal(half.restore(image, none, {0}), full.restore(image, none, {0})));
  CHECK(torch::allclose(half.restore(image, none), image * torch::tensor({0.7}).to(torch::kHalf)));
}

/// A network that rejects more than `pixels`, like a device with little memory.
std::filesystem::path save_small_memory(const std::filesystem::path& path, int pixels) {
  return save_restorer(path, "  assert image.size(2) * image.size(3) <= " + std::to_string(pixels) +
                                 ", 'CUDA out of memory. Tried to allocate'\n"
                                 "  return 0.5 * image + 0.5 * events[:, 2:3] + 0.1 * mask\n");
}

TEST_CASE("efnet: a frame too large for the memory is restored in tiles, without seams",
          "[restore]") {
  const test::TempDir folder;
  const torch::Tensor image = torch::rand({3, 200, 330});
  const torch::Tensor voxel = torch::randn({6, 200, 330}) * (torch::rand({1, 200, 330}) > 0.8);
  Restorer whole({save_small_memory(folder / "large.pt", 1 << 20)});
  Restorer tiled({save_small_memory(folder / "small.pt", 200 * 200)});
  const torch::Tensor expected = whole.restore(image, voxel);
  CHECK(torch::equal(tiled.restore(image, voxel), expected));
  CHECK(torch::equal(tiled.restore(image, voxel), expected));
  Restorer hopeless({save_small_memory(folder / "none.pt", 16)});
  CHECK(message_of<DeviceError>([&] {
          hopeless.restore(image, voxel);
        }).find("not even in tiles") != std::string::npos);
}

TEST_CASE("efnet: the reason for a refusal is TorchScript's last line", "[restore]") {
  const test::TempDir folder;
  // A convolution for four channels, like a network trained on RGB and another channel.
  Restorer channels(
      {save_restorer(folder / "c.pt", "  return torch.conv2d(image, torch.ones([3, 4, 1, 1]))\n")});
  const std::string text = message_of<DataError>([&] {
    channels.restore(torch::rand({3, 8, 8}), torch::zeros({6, 8, 8}));
  });
  CHECK(text.find("expected input[1, 3, 8, 8] to have 4 channels") != std::string::npos);
  CHECK(text.find('\n') == std::string::npos);
}

}  // namespace
}  // namespace jade::restore
