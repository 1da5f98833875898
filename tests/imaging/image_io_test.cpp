// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/image_io.h"

#include "support/catch.h"

#include <cstdio>
#include <fstream>
#include <functional>
#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <torch/types.h>
#include <unistd.h>

#include "jade/core/error.h"
#include "support/naming.h"

using namespace jade::imaging;
namespace fs = std::filesystem;

namespace {

struct Folder {
  fs::path path;
  Folder() {
    std::string name = (fs::temp_directory_path() / "jade_image_io_XXXXXX").string();
    path = mkdtemp(name.data());
  }
  ~Folder() { fs::remove_all(path); }
};

/// An image whose values are multiples of 1/top, different in every channel, row and column.
torch::Tensor pattern(int64_t height, int64_t width, int64_t top) {
  return (torch::arange(3 * height * width).mul(7919).remainder(top + 1).to(torch::kFloat32) /
          double(top))
      .view({3, height, width});
}

double largest_difference(const torch::Tensor& a, const torch::Tensor& b) {
  return a.sub(b).abs().max().item<double>();
}

std::string message_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const jade::DataError& error) {
    return error.what();
  }
  return "";
}

/// A TIFF of one pixel in colour.
std::string float64_tiff() {
  const auto number = [](int64_t value, int count) {
    std::string out;
    for (int i = 0; i < count; ++i) out += char(value >> 8 * i & 0xFF);
    return out;
  };
  constexpr int kShort = 3, kLong = 4, kEntries = 10;
  constexpr int64_t kBehind = 8 + 2 + 12 * kEntries + 4;  // the directory
  std::string out = "II*" + std::string(1, '\0') + number(8, 4) + number(kEntries, 2);
  const auto entry = [&](int tag, int type, int64_t count, int64_t value) {
    out += number(tag, 2) + number(type, 2) + number(count, 4) + number(value, 4);
  };
  entry(256, kLong, 1, 1), entry(257, kLong, 1, 1), entry(258, kShort, 3, kBehind);
  entry(259, kShort, 1, 1), entry(262, kShort, 1, 2), entry(273, kLong, 1, kBehind + 12);
  entry(277, kShort, 1, 3), entry(278, kLong, 1, 1), entry(279, kLong, 1, 24);
  entry(339, kShort, 3, kBehind + 6);
  out += number(0, 4);
  for (const int value : {64, 64, 64, 3, 3, 3}) out += number(value, 2);
  return out + std::string(24, '\0');
}

/// Text that an action prints on stderr and std::cerr.
std::string printed_by(const std::function<void()>& action) {
  const std::unique_ptr<FILE, int (*)(FILE*)> file(std::tmpfile(), &std::fclose);
  std::fflush(stderr);
  const int kept = dup(STDERR_FILENO);
  dup2(fileno(file.get()), STDERR_FILENO);
  action();
  std::fflush(stderr);
  dup2(kept, STDERR_FILENO);
  close(kept);
  std::string out(4096, '\0');
  std::rewind(file.get());
  out.resize(std::fread(out.data(), 1, out.size(), file.get()));
  return out;
}

}  // namespace

TEST_CASE("image: 8-bit and 16-bit colour files are restored bit for bit", "[imaging]") {
  const Folder folder;
  for (const char* name : {"a.png", "b.tiff", "c.bmp", "deep/er/d.ppm"}) {
    const auto image = pattern(5, 7, 255);
    write_image(folder.path / name, image);
    CHECK(largest_difference(read_image(folder.path / name), image) < 1e-7);
  }
  const auto image = pattern(9, 11, 65535);
  write_image(folder.path / "deep.png", image, {16});
  CHECK(largest_difference(read_image(folder.path / "deep.png"), image) < 1e-7);
  CHECK(read_image(folder.path / "deep.png").sizes() == torch::IntArrayRef({3, 9, 11}));
}

TEST_CASE("image: files hold red where we say red", "[imaging]") {
  const Folder folder;
  auto image = torch::zeros({3, 2, 2});
  image[0] = 1;
  write_image(folder.path / "red.png", image);
  const cv::Mat bgr = cv::imread((folder.path / "red.png").string());
  CHECK(int(bgr.at<cv::Vec3b>(0, 0)[2]) == 255);
  CHECK(int(bgr.at<cv::Vec3b>(0, 0)[0]) == 0);
}

TEST_CASE("image: gray files become three equal channels and alpha is dropped", "[imaging]") {
  const Folder folder;
  const auto one = pattern(4, 6, 255).narrow(0, 0, 1).contiguous();
  write_image(folder.path / "gray.png", one);
  CHECK(largest_difference(read_image(folder.path / "gray.png"), one.expand({3, -1, -1})) < 1e-7);
  cv::Mat gray16(3, 5, CV_16U, cv::Scalar(13107));
  cv::imwrite((folder.path / "gray16.png").string(), gray16);
  CHECK(largest_difference(read_image(folder.path / "gray16.png"), torch::full({3, 3, 5}, 0.2)) <
        1e-7);
  cv::Mat alpha(2, 2, CV_8UC4, cv::Scalar(255, 0, 51, 7));
  cv::imwrite((folder.path / "alpha.png").string(), alpha);
  const auto read = read_image(folder.path / "alpha.png");
  CHECK(read[0][0][0].item<double>() == Approx(0.2));
  CHECK(read[2][1][1].item<double>() == Approx(1.0));
}

TEST_CASE("image: alpha is read from files that are not opaque, in 8 and 16 bits", "[imaging]") {
  const Folder folder;
  cv::Mat image(2, 2, CV_8UC4, cv::Scalar(1, 2, 3, 255));
  const auto path = folder.path / "alpha.png";
  cv::imwrite(path.string(), image);
  CHECK_FALSE(read_alpha(path).defined());
  image.at<cv::Vec4b>(0, 1)[3] = 0;
  image.at<cv::Vec4b>(1, 0)[3] = 127;
  image.at<cv::Vec4b>(1, 1)[3] = 128;
  const auto expected = torch::tensor({255, 0, 127, 128}).view({1, 2, 2}) / 255.0F;
  for (const char* name : {"alpha.png", "alpha.tiff", "alpha.webp"}) {
    CAPTURE(name);
    cv::imwrite((folder.path / name).string(), image, {cv::IMWRITE_WEBP_QUALITY, 101});
    CHECK(largest_difference(read_alpha(folder.path / name), expected) < 1e-6);
  }
  cv::Mat wide;
  image.convertTo(wide, CV_16U, 257);
  cv::imwrite(path.string(), wide);
  CHECK(largest_difference(read_alpha(path), expected) < 1e-6);
  cv::imwrite(path.string(), cv::Mat(2, 2, CV_8UC3, cv::Scalar(0, 0, 0)));
  CHECK_FALSE(read_alpha(path).defined());
}

TEST_CASE("image: a mask counts where it is not black and not transparent", "[imaging]") {
  const Folder folder;
  const auto read = [&](const char* name, const cv::Mat& image) {
    cv::imwrite((folder.path / name).string(), image);
    return read_mask(folder.path / name).flatten();
  };
  const auto bits = [](std::vector<int64_t> list) { return torch::tensor(list).to(torch::kBool); };
  const cv::Mat gray = (cv::Mat_<uint8_t>(1, 3) << 0, 1, 255);
  CHECK(read("a.png", gray).equal(bits({0, 1, 1})));
  cv::Mat colored(1, 3, CV_8UC4, cv::Scalar(0, 0, 0, 255));
  colored.at<cv::Vec4b>(0, 1)[0] = 9;
  colored.at<cv::Vec4b>(0, 2) = {255, 255, 255, 0};
  CHECK(read("b.png", colored).equal(bits({0, 1, 0})));
  // JPEG blurs edges and makes black non-zero.
  CHECK(read("c.jpg", cv::Mat(16, 16, CV_8U, cv::Scalar(9))).any().item<bool>() == false);
  CHECK(read("d.jpg", cv::Mat(16, 16, CV_8U, cv::Scalar(250))).all().item<bool>());
}

TEST_CASE("image: values are clamped and rounded, NaN becomes black", "[imaging]") {
  const Folder folder;
  const auto image =
      torch::tensor({-1.0, 2.0, 0.4999 / 255, 0.5001 / 255, std::nan(""), 1.0}).view({1, 1, 6});
  write_image(folder.path / "a.png", image);
  const auto expected = torch::tensor({0.0, 1.0, 0.0, 1.0 / 255, 0.0, 1.0});
  CHECK(largest_difference(read_image(folder.path / "a.png")[0][0], expected) < 1e-6);
}

TEST_CASE("image: float arrays are kept as they are", "[imaging]") {
  const Folder folder;
  const auto image = torch::rand({3, 3, 4});
  write_image(folder.path / "a.npy", image);
  CHECK(torch::equal(read_image(folder.path / "a.npy"), image));
}

TEST_CASE("image: jpeg is close, and png bytes decode", "[imaging]") {
  const Folder folder;
  const auto image = torch::full({3, 16, 16}, 0.5);
  write_image(folder.path / "a.jpg", image);
  CHECK(largest_difference(read_image(folder.path / "a.jpg"), image) < 0.02);
  const auto bytes = encode_png(image);
  CHECK(std::string(bytes.begin() + 1, bytes.begin() + 4) == "PNG");
}

TEST_CASE("image: a JPEG without its end is refused, one with more behind it is read",
          "[imaging]") {
  const Folder folder;
  const auto image = pattern(40, 40, 255);
  const auto encoded = encode_jpeg(image, 90);
  const std::string whole(encoded.begin(), encoded.end());
  const auto write = [&](const std::string& bytes) {
    const fs::path path = folder.path / "a.jpg";
    std::ofstream(path, std::ios::binary) << bytes;
    return path;
  };
  const auto plain = read_image(write(whole));
  CHECK(torch::equal(read_image(write(whole + std::string(20000, '\0'))), plain));
  // A thumbnail in the header has an end of its own.
  const std::string thumbnail = std::string("\xFF\xE1\x00\x08", 4) + "\xFF\xD8..\xFF\xD9";
  CHECK(torch::equal(read_image(write(whole.substr(0, 2) + thumbnail + whole.substr(2))), plain));
  const std::string cut = whole.substr(0, whole.size() * 2 / 3);
  for (const std::string& bytes : {cut, cut.substr(0, 2) + thumbnail + cut.substr(2)}) {
    const auto message = message_of([&] { read_image(write(bytes)); });
    CHECK(message.find("a.jpg: expected an image") != std::string::npos);
  }
}

TEST_CASE("image: a JPEG with damage inside is read and named", "[imaging]") {
  const Folder folder;
  const auto encoded = encode_jpeg(pattern(64, 64, 255), 90);
  const std::string whole(encoded.begin(), encoded.end());
  const auto write = [&](const std::string& bytes) {
    const fs::path path = folder.path / "a.jpg";
    std::ofstream(path, std::ios::binary) << bytes;
    return path;
  };
  std::string damaged = whole, fault;
  for (size_t i = 0; i < 8; ++i) damaged[whole.size() / 2 + i] ^= 0x5A;
  const fs::path path = write(damaged);
  CHECK(printed_by([&] { CHECK(read_image(path, &fault).size(1) == 64); }).empty());
  CHECK_THAT(fault, jade::test::naming("a.jpg: expected", "damage", "Corrupt JPEG data", "again"));
  CHECK_THROWS_AS(read_image(path), jade::DataError);
  CHECK_THROWS_AS(read_mask(path), jade::DataError);
  // Some cameras fill up the data with zeros.
  const std::string padded = whole.substr(0, whole.size() - 2) + std::string(40, '\0') + "\xFF\xD9";
  for (const std::string& sound : {whole, whole + "more", padded}) {
    read_image(write(sound), &fault);
    CHECK(fault.empty());
  }
}

TEST_CASE("image: damaged files are refused without lines of their decoders", "[imaging]") {
  const Folder folder;
  const auto image = torch::rand({3, 40, 60});
  for (const char* name : {"a.png", "a.bmp", "a.ppm", "a.tiff", "a.jpg"}) {
    CAPTURE(name);
    const fs::path path = folder.path / name;
    write_image(path, image);
    fs::resize_file(path, fs::file_size(path) / 2);
    CHECK(printed_by([&] { CHECK_THROWS_AS(read_image(path), jade::DataError); }).empty());
  }
  const fs::path path = folder.path / "a.png";
  auto bytes = encode_png(image);
  bytes[bytes.size() / 2] ^= 1;  // the checksum differs
  std::ofstream(path, std::ios::binary) << std::string(bytes.begin(), bytes.end());
  CHECK(printed_by([&] { CHECK_THROWS_AS(read_image(path), jade::DataError); }).empty());
  // Bytes behind the end do not matter.
  bytes = encode_png(image);
  std::ofstream(path, std::ios::binary) << std::string(bytes.begin(), bytes.end()) << "more";
  CHECK(read_image(path).size(2) == 60);
}

TEST_CASE("image: a TIFF of other values is read or named by its kind", "[imaging]") {
  const Folder folder;
  const std::string name = (folder.path / "a.tiff").string();
  const auto message = [&](const cv::Mat& image) {
    std::string out;
    cv::imwrite(name, image, {cv::IMWRITE_TIFF_COMPRESSION, 1});
    CHECK(printed_by([&] { out = message_of([&] { read_image(name); }); }).empty());
    return out;
  };
  CHECK(message(cv::Mat(2, 4, CV_64F, cv::Scalar(0.25))).empty());
  CHECK(largest_difference(read_image(name), torch::full({3, 2, 4}, 0.25)) < 1e-7);
  CHECK_THAT(message(cv::Mat(2, 4, CV_32S, cv::Scalar(1))), jade::test::naming("found int32"));
  CHECK_THAT(message(cv::Mat(2, 4, CV_16S, cv::Scalar(1))), jade::test::naming("found int16"));
  // OpenCV neither writes nor reads float64 in colour.
  std::ofstream(name, std::ios::binary) << float64_tiff();
  std::string said;
  CHECK(printed_by([&] { said = message_of([&] { read_image(name); }); }).empty());
  CHECK_THAT(said, jade::test::naming("a.tiff", "float32", "found float64", "convert"));
}

TEST_CASE("image: files that cannot be read are refused with their path", "[imaging]") {
  const Folder folder;
  const auto path = [&](const char* name) { return folder.path / name; };
  write_image(path("good.png"), pattern(20, 20, 255));
  std::ifstream good(path("good.png"), std::ios::binary);
  std::string bytes((std::istreambuf_iterator<char>(good)), {});
  std::ofstream(path("cut.png"), std::ios::binary) << bytes.substr(0, 30);
  std::ofstream(path("empty.png"));
  std::ofstream(path("text.png")) << "not an image";
  for (const char* name : {"missing.png", "cut.png", "empty.png", "text.png"}) {
    const auto message = message_of([&] { read_image(path(name)); });
    CHECK(message.find(path(name).string()) != std::string::npos);
  }
  CHECK_THROWS_AS(read_image(folder.path), jade::DataError);
  CHECK(message_of([&] {
          write_image(path("a.xyz"), torch::zeros({3, 2, 2}));
        }).find("a.xyz") != std::string::npos);
  CHECK_FALSE(message_of([&] {
                write_image(path("a.jpg"), torch::zeros({3, 2, 2}), {16});
              }).empty());
  CHECK_THROWS_AS(write_image(path("a.png"), torch::zeros({2, 2, 2})), jade::ContractError);
}

TEST_CASE("image: what lies in place of an image is named", "[imaging]") {
  const Folder folder;
  for (const auto& [content, word] :
       {std::pair{"version https://git-lfs.github.com/spec/v1\noid sha256:aa\n", "git lfs pull"},
        std::pair{"<!DOCTYPE html>\n", "HTML"}, std::pair{"", "empty"}}) {
    std::ofstream(folder.path / "a.png") << content;
    const std::string message = message_of([&] { read_image(folder.path / "a.png"); });
    CHECK_THAT(message, Catch::Contains("a.png") && Catch::Contains(word));
  }
}

TEST_CASE("image: float files with another white level or NaN are refused", "[imaging]") {
  const Folder folder;
  const fs::path path = folder.path / "a.tiff";
  cv::Mat image(2, 4, CV_32FC3, cv::Scalar(0.5, 0.5, 0.5));
  const auto message = [&] {
    // By default OpenCV writes LogLuv, which is lossy and has no NaN.
    cv::imwrite(path.string(), image, {cv::IMWRITE_TIFF_COMPRESSION, 1});
    return message_of([&] { read_image(path); });
  };
  image.at<cv::Vec3f>(0, 0) = {40, 40, 40};  // a highlight
  CHECK(message().empty());
  image = image * 255;
  CHECK(message().find("a.tiff: expected float values from 0 to 1, found up to 10200") !=
        std::string::npos);
  image = cv::Scalar(0.5, 0.5, 0.5);
  image.at<cv::Vec3f>(1, 2)[1] = std::nanf("");
  CHECK(message().find("NaN") != std::string::npos);
}

TEST_CASE("image: listings are sorted and hold images only", "[imaging]") {
  const Folder folder;
  for (const char* name : {"b.png", "a.PNG", "c.jpg"}) std::ofstream(folder.path / name) << "x";
  std::ofstream(folder.path / "notes.txt") << "x";
  std::ofstream(folder.path / "._b.png") << "x";
  const auto found = list_images(folder.path);
  REQUIRE(found.size() == 3);
  CHECK(found[0].filename() == "a.PNG");
  CHECK(found[2].filename() == "c.jpg");
  CHECK_THROWS_AS(list_images(folder.path / "missing"), jade::DataError);
}

TEST_CASE("image: listings go by the values of names that are fractions", "[imaging]") {
  const Folder folder;
  for (const char* name : {"0.4.png", "0.17.png", "0.055.png"})
    std::ofstream(folder.path / name) << "x";
  CHECK(list_images(folder.path)[0].stem() == "0.055");
  std::ofstream(folder.path / "0.170.png") << "x";  // no fractions: two would be equal
  CHECK(list_images(folder.path)[0].stem() == "0.4");
}

TEST_CASE("image: numbers that count behind a point are no fractions", "[imaging]") {
  CHECK(counts_fractions({"3.001.png", "3.002.png", "3.003.png"}));
  CHECK(counts_fractions({"1.9.png", "1.10.png", "2.1.png"}));
  CHECK_FALSE(counts_fractions({"1.5.png", "2.5.png"}));
  CHECK_FALSE(counts_fractions({"1.000000.png", "1.100000.png"}));
  CHECK_FALSE(counts_fractions({"1.1.png", "a.png"}));
  CHECK_FALSE(counts_fractions({}));
}

TEST_CASE("image: listings go by the numbers in names", "[imaging]") {
  const Folder folder;
  for (const char* name : {"f10.png", "f2.png", "f1.png", "f02.png", "e3.png", "f2b.png"})
    std::ofstream(folder.path / name) << "x";
  std::string order;
  for (const auto& file : list_images(folder.path)) order += file.stem().string() + " ";
  CHECK(order == "e3 f1 f02 f2 f2b f10 ");
  CHECK(comes_before("9", "18446744073709551617"));
  CHECK_FALSE(comes_before("a", "a"));
  CHECK(comes_before("a", "a0"));
  // With equal zero-padding the order is that of text.
  CHECK(comes_before("0009_1", "0010_0"));
}
