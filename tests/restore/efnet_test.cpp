// SPDX-License-Identifier: Apache-2.0
#include "jade/restore/efnet.h"

#include "support/catch.h"

#include "jade/core/atomic_file.h"
#include "jade/core/digest.h"
#include "jade/core/error.h"
#include "support/stub_restorer.h"
#include "support/temp_dir.h"

namespace jade::restore {
namespace {

using test::kStubMetadata;
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
  CHECK(shipped.filename() == "efnet_small.pt");
  CHECK(checked_file_sha256({}) == file_sha256(shipped));
  CHECK(Restorer(EfnetOptions()).metadata().kind == "efnet");
  EfnetOptions own;
  own.path = "own.pt";
  CHECK(restorer_path(own) == "own.pt");
  CHECK_THROWS_WITH(checked_file_sha256(own), Catch::Contains("efnet.path: expected") &&
                                                  Catch::Contains("found no file own.pt"));
  EfnetOptions other;
  other.sha256 = "0000";
  CHECK_THROWS_WITH(checked_file_sha256(other), Catch::Contains("expected SHA-256 0000"));
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
  // Asserts inside the network; returns the image plus what the padding of the others must not be.
  const auto path =
      save_restorer(folder / "r.pt",
                    "  assert image.size(2) == 12\n"
                    "  assert image.size(3) == 12\n"
                    "  assert bool((image[:, :, 9:, :] == image[:, :, 8:9, :]).all())\n"
                    "  assert bool((events[:, :, 9:, :] == 0).all())\n"
                    "  assert bool((mask[:, :, :, 10:] == 0).all())\n"
                    "  assert bool((mask[:, :, :9, :10] == 1).all())\n"
                    "  return image + events[:, 5:6]\n");
  Restorer restorer({path, ""});
  const torch::Tensor image = torch::rand({3, 9, 10}) - 1.5;
  const torch::Tensor out = restorer.restore(image, 7 * bins()[0]);
  CHECK(out.sizes() == image.sizes());
  CHECK(torch::allclose(out, (image + 1).clamp(0, 1)));
  CHECK(restorer.restore(image.unsqueeze(0), bins()).dim() == 4);
  CHECK(restorer.metadata().name == "probe");
  CHECK(checked_file_sha256({path, ""}) == file_sha256(path));
}

TEST_CASE("efnet: plain bins go in where the metadata says so, and image restorers get no events",
          "[restore]") {
  const test::TempDir folder;
  const auto path = save_restorer(folder / "bins.pt", "  return image * 0 + events[:, 0:1]\n",
                                  replaced(kStubMetadata, "scer", "bins"));
  const torch::Tensor image = torch::rand({3, 8, 8});
  const torch::Tensor six = bins()[0].narrow(1, 0, 8).narrow(2, 0, 8);
  CHECK(torch::allclose(Restorer({path, ""}).restore(image, six), torch::full({3, 8, 8}, 1 / 6.f)));
  std::string metadata = replaced(kStubMetadata, "\"efnet\"", "\"image\"");
  metadata = replaced(metadata, "scer", "none");
  const auto plain =
      save_restorer(folder / "image.pt", "  return image * 0.5\n", metadata, "image");
  CHECK(torch::allclose(Restorer({plain, ""}).restore(image, {}), image / 2));
}

TEST_CASE("efnet: files that are none are refused with what to do", "[restore]") {
  const test::TempDir folder;
  const auto load = [](const std::filesystem::path& path, const std::string& sha = "") {
    return message_of<DataError>([&] { Restorer({path, sha}); });
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
  CHECK(bad(replaced(kStubMetadata, "\"format_version\": 1", "\"format_version\": 2"))
            .find("version 2") != std::string::npos);
  CHECK(bad(replaced(kStubMetadata, "scer", "none")).find("does not fit") != std::string::npos);
  CHECK(bad(replaced(kStubMetadata, "\"padding_multiple\": 4", "\"padding_multiple\": 0"))
            .find("no sense") != std::string::npos);
  const auto good = save_restorer(folder / "good.pt", body);
  CHECK(load(good, std::string(64, '0')).find("SHA-256") != std::string::npos);
  CHECK(load(good, file_sha256(good)) == "no such error");
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
  Restorer nan({save_restorer(folder / "nan.pt", "  return image / 0 - image / 0\n"), ""});
  CHECK_THROWS_AS(nan.restore(image, voxel), NumericError);
  Restorer shape({save_restorer(folder / "shape.pt", "  return image[:, :1]\n"), ""});
  CHECK_THROWS_AS(shape.restore(image, voxel), DataError);
  Restorer refuses({save_restorer(folder / "no.pt", "  assert False\n  return image\n"), ""});
  CHECK_THROWS_AS(refuses.restore(image, voxel), DataError);
  CHECK_THROWS_AS(refuses.restore(image, torch::zeros({5, 8, 8})), ContractError);
}

/// A network that refuses more than `pixels`, as a device with little memory does.
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
  Restorer whole({save_small_memory(folder / "large.pt", 1 << 20), ""});
  Restorer tiled({save_small_memory(folder / "small.pt", 200 * 200), ""});
  const torch::Tensor expected = whole.restore(image, voxel);
  CHECK(torch::equal(tiled.restore(image, voxel), expected));
  CHECK(torch::equal(tiled.restore(image, voxel), expected));
  Restorer hopeless({save_small_memory(folder / "none.pt", 16), ""});
  CHECK(message_of<DeviceError>([&] {
          hopeless.restore(image, voxel);
        }).find("not even in tiles") != std::string::npos);
}

TEST_CASE("efnet: the reason for a refusal is TorchScript's last line", "[restore]") {
  const test::TempDir folder;
  // A convolution for four channels, as of a network trained on RGB and something else.
  Restorer channels(
      {save_restorer(folder / "c.pt", "  return torch.conv2d(image, torch.ones([3, 4, 1, 1]))\n"),
       ""});
  const std::string text = message_of<DataError>([&] {
    channels.restore(torch::rand({3, 8, 8}), torch::zeros({6, 8, 8}));
  });
  CHECK(text.find("expected input[1, 3, 8, 8] to have 4 channels") != std::string::npos);
  CHECK(text.find('\n') == std::string::npos);
}

}  // namespace
}  // namespace jade::restore
