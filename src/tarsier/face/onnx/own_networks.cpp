// SPDX-License-Identifier: MIT
#include "tarsier/face/onnx/own_networks.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/image.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/face/onnx/box_decoder.h"
#include "tarsier/face/onnx/module.h"
#include "tarsier/media/sha256.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <mutex>
#include <stdexcept>
#include <utility>
#include <vector>

namespace tarsier::face::onnx {
namespace {

constexpr int kMinOutputs = 8;
constexpr int kMaxOutputs = 4096;
constexpr int kMinInputSide = 16;
constexpr int kMaxInputSide = 2048;

struct LoadedNetwork {
  NetworkFile file;    // without its bytes
  InputFormat format;  // with the final size
  int channels = 3;
  std::vector<std::string> outputs;
  std::unique_ptr<Runner> runner;
};

LoadedNetwork open_network(const std::string& path) {
  LoadedNetwork out;
  out.file = read_network_file(path);
  out.format = read_input_format(path);
  if (out.file.inputs.size() != 1 || out.file.inputs[0].shape.size() != 4)
    throw ModelError(path,
                     fmt::format("takes {} inputs in place of one image", out.file.inputs.size()));
  const std::vector<std::int64_t>& shape = out.file.inputs[0].shape;
  if ((shape[0] != -1 && shape[0] != 1) || (shape[1] != 1 && shape[1] != 3))
    throw ModelError(path, fmt::format("takes {} images of {} channels in place of one of 1 or 3",
                                       shape[0], shape[1]));
  out.channels = static_cast<int>(shape[1]);
  if (out.format.width == 0) {
    if (shape[2] == -1 || shape[3] == -1)
      throw ModelError(path,
                       "leaves the size of its image open: write 'size: W' into " + path + ".txt");
    if (shape[2] < kMinInputSide || shape[3] < kMinInputSide || shape[2] > kMaxInputSide ||
        shape[3] > kMaxInputSide)
      throw ModelError(path, fmt::format("takes images of {} x {} px", shape[3], shape[2]));
    out.format.width = static_cast<int>(shape[3]);
    out.format.height = static_cast<int>(shape[2]);
  }
  if (out.format.mean.size() > 1 && static_cast<int>(out.format.mean.size()) != out.channels)
    throw ModelError(path + ".txt", "more means than the network has channels");
  for (const TensorInfo& output : out.file.outputs) out.outputs.push_back(output.name);
  if (out.outputs.empty()) throw ModelError(path, "has no output");
  Request request;
  request.bytes = out.file.bytes.data();
  request.size = out.file.bytes.size();
  request.input = {1, out.channels, out.format.height, out.format.width};
  request.outputs = out.outputs;
  out.runner = open_runner(request, path);
  out.file.bytes = {};
  log_info("{}", description_of(out.file, out.format));
  return out;
}

// N x C x H x W from a grey image of the network's input size.
cv::Mat blob_of(const cv::Mat& gray, const LoadedNetwork& network) {
  const std::array<int, 4> shape{1, network.channels, gray.rows, gray.cols};
  cv::Mat blob(4, shape.data(), CV_32F);
  for (int c = 0; c < network.channels; ++c) {
    const std::vector<double>& means = network.format.mean;
    const auto mean = static_cast<float>(means[means.size() > 1 ? static_cast<std::size_t>(c) : 0]);
    const auto scale = static_cast<float>(network.format.scale);
    for (int y = 0; y < gray.rows; ++y) {
      const auto* row = gray.ptr<unsigned char>(y);
      auto* out = blob.ptr<float>(0, c, y);
      for (int x = 0; x < gray.cols; ++x) out[x] = (static_cast<float>(row[x]) - mean) * scale;
    }
  }
  return blob;
}

class OnnxNetwork {
 public:
  explicit OnnxNetwork(LoadedNetwork loaded) : loaded_(std::move(loaded)) {}
  [[nodiscard]] const LoadedNetwork& loaded() const { return loaded_; }
  [[nodiscard]] std::vector<cv::Mat> run(const cv::Mat& gray) const {
    const cv::Mat blob = blob_of(gray, loaded_);
    std::vector<cv::Mat> outputs;
    const std::lock_guard lock(mutex_);  // OpenCV's networks are not thread-safe
    const std::string error = loaded_.runner->run(blob, outputs);
    if (!error.empty()) throw ModelError(loaded_.file.path, "OpenCV does not run it: " + error);
    return outputs;
  }

 private:
  LoadedNetwork loaded_;
  mutable std::mutex mutex_;
};

class OnnxEmbedder final : public recognition::FaceEmbedder {
 public:
  explicit OnnxEmbedder(LoadedNetwork loaded) : network_(std::move(loaded)) {
    const InputFormat& format = network_.loaded().format;
    const auto outputs = network_.run(cv::Mat::zeros(format.height, format.width, CV_8UC1));
    const std::size_t total = outputs.size() == 1 ? outputs[0].total() : 0;
    if (total < kMinOutputs || total > kMaxOutputs)
      throw ModelError(
          network_.loaded().file.path,
          fmt::format("gives {} outputs of {} numbers in place of one of {} to {}", outputs.size(),
                      outputs.empty() ? 0 : outputs[0].total(), kMinOutputs, kMaxOutputs));
    outputs_ = static_cast<int>(total);
  }

  [[nodiscard]] std::vector<float> embed(const cv::Mat& crop) const override {
    const InputFormat& format = network_.loaded().format;
    const auto outputs = network_.run(aligned_chip(crop, {format.width, format.height}));
    std::vector<float> numbers(outputs[0].ptr<float>(),
                               outputs[0].ptr<float>() + outputs[0].total());
    double square = 0;
    for (const float number : numbers) square += static_cast<double>(number) * number;
    if (!std::isfinite(square))
      throw ModelError(network_.loaded().file.path, "gives numbers that are not finite");
    const double length = std::sqrt(square);
    for (float& number : numbers)
      number = length > 1e-12 ? static_cast<float>(number / length) : 0.0F;
    return numbers;
  }
  [[nodiscard]] int outputs() const override { return outputs_; }

 private:
  OnnxNetwork network_;
  int outputs_ = 0;
};

class OnnxBoxDetector final : public BoxDetector {
 public:
  explicit OnnxBoxDetector(LoadedNetwork loaded) : network_(std::move(loaded)) {
    const NetworkFile& file = network_.loaded().file;
    if (strides_of(network_.loaded().outputs).empty())
      throw ModelError(file.path,
                       "has no outputs cls_S, obj_S, bbox_S and kps_S, S the px of a cell: not of "
                       "the YuNet family");
    const InputFormat& format = network_.loaded().format;
    (void)find(cv::Mat::zeros(format.height, format.width, CV_8UC1));
  }

  [[nodiscard]] std::vector<ScoredFace> find(const cv::Mat& gray) const override {
    require_gray(gray);
    constexpr double kMinScore = 0.3;
    constexpr double kMaxEnlarged = 2;
    const InputFormat& format = network_.loaded().format;
    const cv::Size size(format.width, format.height);
    const double scale = std::min({static_cast<double>(size.width) / gray.cols,
                                   static_cast<double>(size.height) / gray.rows, kMaxEnlarged});
    const cv::Size inside(std::clamp(cvRound(gray.cols * scale), 1, size.width),
                          std::clamp(cvRound(gray.rows * scale), 1, size.height));
    cv::Mat image = cv::Mat::zeros(size, CV_8UC1);
    cv::Mat part = image(cv::Rect({0, 0}, inside));
    cv::resize(gray, part, inside, 0, 0, scale < 1 ? cv::INTER_AREA : cv::INTER_LINEAR);
    std::vector<DecodedFace> found;
    try {
      found = decode_boxes(network_.loaded().outputs, network_.run(image), size, kMinScore);
    } catch (const std::invalid_argument& error) {
      throw ModelError(network_.loaded().file.path, error.what());
    }
    std::vector<ScoredFace> out;
    for (DecodedFace& face : found) {
      for (cv::Point2d& point : face.points) {
        point.x /= static_cast<double>(inside.width) / gray.cols;
        point.y /= static_cast<double>(inside.height) / gray.rows;
      }
      const cv::Rect2d square = square_of_points(face.points);
      const cv::Rect2d whole(0, 0, gray.cols, gray.rows);
      if (square.width >= 8 && square.width <= 4.0 * std::max(gray.cols, gray.rows) &&
          (square & whole).area() > 0.25 * square.area())
        out.push_back({square, face.score});
    }
    return out;
  }

 private:
  OnnxNetwork network_;
};

// > 0; of the file and its input format. Embeddings with different fingerprints cannot be compared.
std::int64_t fingerprint_of(const LoadedNetwork& network) {
  Sha256 sum;
  sum.add(network.file.sha256);
  sum.add(
      fmt::format("{} {} {:a}", network.format.width, network.format.height, network.format.scale));
  for (const double mean : network.format.mean) sum.add(fmt::format(" {:a}", mean));
  std::uint64_t value = 0;
  for (const char digit : sum.hex().substr(0, 15))
    value = 16 * value + static_cast<std::uint64_t>(digit <= '9' ? digit - '0' : digit - 'a' + 10);
  return static_cast<std::int64_t>(std::max<std::uint64_t>(1, value));
}

}  // namespace

cv::Mat aligned_chip(const cv::Mat& crop, cv::Size size) {
  require_gray(crop);
  TARSIER_REQUIRE(size.width >= kMinInputSide && size.height >= kMinInputSide,
                  "a chip of {} x {} px", size.width, size.height);
  constexpr double kEyeX = 0.27;  // positions of the eyes in the crop
  constexpr double kEyeY = 0.34;
  constexpr double kAspect = 1.25;  // height / width of the crop
  const double side = size.width / kAlignedSide;
  const double scale = kAlignedEyeDistance * side / ((1 - 2 * kEyeX) * crop.cols);
  // Also for crops with another aspect.
  const double scale_y = scale * kAspect * crop.cols / crop.rows;
  cv::Mat source;  // never the crop's own pixels: the caller still uses them
  if (scale < 0.6)
    cv::GaussianBlur(crop, source, {}, 0.4 / scale, 0.4 / scale_y);
  else
    source = crop;
  // Pixel centres are at integers, also in the alignment.
  const double center_x = 0.5 * crop.cols - 0.5;
  const double eye_line = kEyeY * crop.rows - 0.5;
  const cv::Mat map = (cv::Mat_<double>(2, 3) << scale, 0, kAlignedEyesX * side - scale * center_x,
                       0, scale_y, kAlignedEyesY * size.height / kAlignedSide - scale_y * eye_line);
  cv::Mat chip;
  cv::warpAffine(source, chip, map, size, cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  return chip;
}

std::shared_ptr<const recognition::DeepNetwork> load_embedding(const std::string& path) {
  LoadedNetwork loaded = open_network(path);
  auto out = std::make_shared<recognition::DeepNetwork>();
  out->name = std::filesystem::path(path).filename().string();
  out->sha256 = loaded.file.sha256;
  out->fingerprint = fingerprint_of(loaded);
  out->embedder = std::make_shared<const OnnxEmbedder>(std::move(loaded));
  return out;
}

std::shared_ptr<const BoxDetector> load_box_detector(const std::string& path) {
  return std::make_shared<const OnnxBoxDetector>(open_network(path));
}

std::string description_of(const NetworkFile& file, const InputFormat& format) {
  return fmt::format("{}: SHA-256 {}, licence {}", file.path, file.sha256,
                     format.licence.empty() ? kUnknownLicence : std::string_view(format.licence));
}

}  // namespace tarsier::face::onnx
