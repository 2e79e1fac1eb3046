// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/normalize.h"

#include "tarsier/core/image.h"
#include "tarsier/core/name_table.h"
#include "tarsier/core/require.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <utility>

namespace tarsier::face::recognition {
namespace {

constexpr NameTable<Light, 5> kLights{"light normalisation",
                                      {{
                                          {Light::kNone, "none"},
                                          {Light::kEqualize, "equalize"},
                                          {Light::kLog, "log"},
                                          {Light::kTanTriggs, "tan-triggs"},
                                          {Light::kSelfQuotient, "self-quotient"},
                                      }}};

// (mean over the pixels of |x|^alpha)^(1/alpha), with |x| limited to `limit`.
double generalised_mean(const cv::Mat& image, double alpha, double limit) {
  double sum = 0;
  for (int y = 0; y < image.rows; ++y) {
    const auto* row = image.ptr<float>(y);
    for (int x = 0; x < image.cols; ++x)
      sum += std::pow(std::min<double>(std::abs(row[x]), limit), alpha);
  }
  return std::pow(sum / static_cast<double>(image.total()), 1 / alpha);
}

struct Grid {
  int count = 0;
  double first =
      // Centre of the first cell, px. The grid is centred, so that mirroring maps it to itself.
      0;
};

Grid grid_of(int pixels, int cell) {
  Grid grid;
  grid.count = std::max(1, static_cast<int>(std::lround(static_cast<double>(pixels) / cell)));
  grid.first = (pixels - 1 - static_cast<double>(grid.count - 1) * cell) / 2;
  return grid;
}

// Weight of each of `grid.count` cells at each pixel, pixels x count.
std::vector<float> pooling(int pixels, int cell, const Grid& grid) {
  std::vector<float> weights(static_cast<std::size_t>(pixels) *
                             static_cast<std::size_t>(grid.count));
  const double sigma = 0.5 * cell;
  std::size_t at = 0;
  for (int x = 0; x < pixels; ++x) {
    for (int c = 0; c < grid.count; ++c, ++at) {
      const double t = (x - grid.first - static_cast<double>(c) * cell) / sigma;
      weights[at] = std::abs(t) > 3 ? 0.0F : static_cast<float>(std::exp(-t * t / 2));
    }
  }
  return weights;
}

// rows x columns x directions, directions fastest.
std::vector<float> histograms(const cv::Mat& image, const HogChannel& channel, const Grid& across,
                              const Grid& down) {
  cv::Mat dx;
  cv::Mat dy;
  cv::Mat magnitude;
  cv::Mat angle;
  cv::Sobel(image, dx, CV_32F, 1, 0, 1, 1, 0, cv::BORDER_REPLICATE);
  cv::Sobel(image, dy, CV_32F, 0, 1, 1, 1, 0, cv::BORDER_REPLICATE);
  cv::cartToPolar(dx, dy, magnitude, angle);

  const int n = channel.directions;
  const double turn = channel.full_circle ? 2 * CV_PI : CV_PI;
  const auto scale = static_cast<float>(n / turn);
  const auto wx = pooling(image.cols, channel.cell, across);
  const auto wy = pooling(image.rows, channel.cell, down);
  const auto strip_length = static_cast<std::size_t>(across.count * n);
  std::vector<float> strip(strip_length);
  std::vector<float> out(strip_length * static_cast<std::size_t>(down.count), 0.0F);
  for (int y = 0; y < image.rows; ++y) {
    std::fill(strip.begin(), strip.end(), 0.0F);
    const float* size = magnitude.ptr<float>(y);
    const float* direction = angle.ptr<float>(y);
    for (int x = 0; x < image.cols; ++x) {
      if (!(size[x] > 0)) continue;
      const float position = direction[x] * scale;
      const float whole = std::floor(position);
      const float part = position - whole;
      const int low = static_cast<int>(whole) % n;
      const int high = (low + 1) % n;
      const float* weight = wx.data() + x * across.count;
      for (int c = 0; c < across.count; ++c) {
        if (weight[c] == 0.0F) continue;
        const float mass = weight[c] * size[x];
        strip[static_cast<std::size_t>(c * n + low)] += mass * (1 - part);
        strip[static_cast<std::size_t>(c * n + high)] += mass * part;
      }
    }
    for (int r = 0; r < down.count; ++r) {
      const float weight = wy[static_cast<std::size_t>(y * down.count + r)];
      if (weight == 0.0F) continue;
      float* target = out.data() + static_cast<std::size_t>(r) * strip_length;
      for (std::size_t i = 0; i < strip_length; ++i) target[i] += weight * strip[i];
    }
  }
  return out;
}

double length(const float* values, std::size_t count) {
  double sum = 0;
  for (std::size_t i = 0; i < count; ++i) sum += static_cast<double>(values[i]) * values[i];
  return std::sqrt(sum);
}

void scale_cells(std::vector<float>& values, int directions) {
  const auto n = static_cast<std::size_t>(directions);
  const std::size_t cells = values.size() / n;
  std::vector<double> lengths(cells);
  double mean = 0;
  for (std::size_t i = 0; i < cells; ++i) {
    lengths[i] = length(values.data() + i * n, n);
    mean += lengths[i] / static_cast<double>(cells);
  }
  if (!(mean > 0)) return;
  for (std::size_t i = 0; i < cells; ++i) {
    const auto factor = static_cast<float>(1 / (lengths[i] + 0.05 * mean));
    for (std::size_t d = 0; d < n; ++d) values[i * n + d] *= factor;
  }
}

// The independent half of mirrored histograms: each number is averaged with its mirrored
// counterpart.
std::vector<float> mirror_averaged(const std::vector<float>& values, int rows, int columns, int n,
                                   bool full_circle) {
  std::vector<float> out;
  const auto at = [&](int r, int c, int d) {
    return values[static_cast<std::size_t>((r * columns + c) * n + d)];
  };
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < (columns + 1) / 2; ++c) {
      for (int d = 0; d < n; ++d) {
        const int turned = full_circle ? (n / 2 - d + n) % n : (n - d) % n;
        out.push_back((at(r, c, d) + at(r, columns - 1 - c, turned)) / 2);
      }
    }
  }
  return out;
}

int channel_length(const HogChannel& channel, const DescriptorOptions& options) {
  const int across = grid_of(options.size.width, channel.cell).count;
  const int down = grid_of(options.size.height, channel.cell).count;
  return (options.symmetric ? (across + 1) / 2 : across) * down * channel.directions;
}

}  // namespace

std::string_view name_of(Light light) { return kLights.name(light); }

Light parse_light(std::string_view name) { return kLights.parse(name); }

void TanTriggsOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(inner > 0 && inner < outer && outer <= 50, "inner {}, outer {}", inner, outer);
}

cv::Mat tan_triggs(const cv::Mat& gray, const TanTriggsOptions& options) {
  require_gray(gray);
  options.check();
  std::array<float, 256> powers{};
  for (int i = 0; i < 256; ++i)
    powers[static_cast<std::size_t>(i)] =
        static_cast<float>(std::pow(static_cast<double>(i) + 1, options.gamma));
  cv::Mat image(gray.size(), CV_32FC1);
  for (int y = 0; y < gray.rows; ++y) {
    const auto* from = gray.ptr<unsigned char>(y);
    auto* to = image.ptr<float>(y);
    for (int x = 0; x < gray.cols; ++x) to[x] = powers[from[x]];
  }
  cv::Mat fine;
  cv::Mat coarse;
  cv::GaussianBlur(image, fine, {}, options.inner);
  cv::GaussianBlur(image, coarse, {}, options.outer);
  fine -= coarse;
  // For a flat image only rounding errors remain.
  double low = 0;
  double high = 0;
  cv::minMaxLoc(fine, &low, &high);
  if (high - low < 1e-5) return cv::Mat::zeros(gray.size(), CV_32FC1);
  fine /= std::max(1e-9, generalised_mean(fine, options.alpha, 1e30));
  fine /= std::max(1e-9, generalised_mean(fine, options.alpha, options.limit));
  for (int y = 0; y < fine.rows; ++y) {
    auto* row = fine.ptr<float>(y);
    for (int x = 0; x < fine.cols; ++x)
      row[x] = static_cast<float>(options.limit * std::tanh(row[x] / options.limit));
  }
  return fine;
}

cv::Mat self_quotient(const cv::Mat& gray, double sigma_px) {
  require_gray(gray);
  TARSIER_REQUIRE(sigma_px > 0 && sigma_px <= 100, "sigma {} px", sigma_px);
  cv::Mat image;
  gray.convertTo(image, CV_32F, 1, 1);
  cv::Mat light;
  cv::GaussianBlur(image, light, {}, sigma_px);
  return image / light;
}

cv::Mat normalize_light(const cv::Mat& gray, Light light) {
  require_gray(gray);
  cv::Mat image;
  switch (light) {
    case Light::kNone:
      gray.convertTo(image, CV_32F);
      return image;
    case Light::kEqualize: {
      cv::Mat equalized;
      cv::equalizeHist(gray, equalized);
      equalized.convertTo(image, CV_32F);
      return image;
    }
    case Light::kLog:
      gray.convertTo(image, CV_32F, 1, 4);
      cv::log(image, image);
      return image;
    case Light::kTanTriggs:
      return tan_triggs(gray);
    case Light::kSelfQuotient:
      return self_quotient(gray);
  }
  return image;
}

cv::Mat light_image(const cv::Mat& normalized) {
  TARSIER_REQUIRE(!normalized.empty() && normalized.type() == CV_32FC1, "type {}",
                  normalized.type());
  std::vector<float> values;
  values.reserve(normalized.total());
  for (int y = 0; y < normalized.rows; ++y)
    values.insert(values.end(), normalized.ptr<float>(y),
                  normalized.ptr<float>(y) + normalized.cols);
  const auto at = [&values](double share) {
    const auto n = static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
    std::nth_element(values.begin(), values.begin() + n, values.end());
    return static_cast<double>(values[static_cast<std::size_t>(n)]);
  };
  const double low = at(0.02);
  const double high = at(0.98);
  cv::Mat image;
  const double scale = high > low ? 255 / (high - low) : 0;
  normalized.convertTo(image, CV_8U, scale, high > low ? -low * scale : 128);
  return image;
}

void DescriptorOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(!channels.empty() && channels.size() <= 8, "{} channels", channels.size());
  for (const auto& channel : channels) {
    TARSIER_REQUIRE(channel.cell >= 4 && channel.cell <= 64, "cell {}", channel.cell);
    TARSIER_REQUIRE(channel.directions >= 4 && channel.directions <= 32 &&
                        (!channel.full_circle || channel.directions % 2 == 0),
                    "{} directions", channel.directions);
  }
}

int descriptor_length(const DescriptorOptions& options) {
  options.check();
  int sum = 0;
  for (const auto& channel : options.channels) sum += channel_length(channel, options);
  return sum;
}

std::vector<float> describe(const cv::Mat& gray, const DescriptorOptions& options) {
  require_gray(gray);
  options.check();
  cv::Mat face = gray;
  if (gray.size() != options.size)
    cv::resize(gray, face, options.size, 0, 0,
               gray.cols > options.size.width ? cv::INTER_AREA : cv::INTER_LINEAR);
  std::vector<std::pair<Light, cv::Mat>> normalized;  // shared between channels with the same light
  std::vector<float> out;
  for (const auto& channel : options.channels) {
    auto found = std::find_if(normalized.begin(), normalized.end(),
                              [&](const auto& entry) { return entry.first == channel.light; });
    if (found == normalized.end()) {
      normalized.emplace_back(channel.light, normalize_light(face, channel.light));
      found = normalized.end() - 1;
    }
    const Grid across = grid_of(options.size.width, channel.cell);
    const Grid down = grid_of(options.size.height, channel.cell);
    auto values = histograms(found->second, channel, across, down);
    scale_cells(values, channel.directions);
    if (options.symmetric)
      values = mirror_averaged(values, down.count, across.count, channel.directions,
                               channel.full_circle);
    const double norm = length(values.data(), values.size()) *
                        std::sqrt(static_cast<double>(options.channels.size()));
    if (norm > 0)
      for (float& value : values) value = static_cast<float>(value / norm);
    out.insert(out.end(), values.begin(), values.end());
  }
  return out;
}

cv::Mat transformed_face(const cv::Mat& gray, double dx, double dy, double degrees, double scale) {
  require_gray(gray);
  const cv::Point2f middle(static_cast<float>(gray.cols - 1) / 2,
                           static_cast<float>(gray.rows - 1) / 2);
  cv::Mat map = cv::getRotationMatrix2D(middle, -degrees, scale);
  map.at<double>(0, 2) += dx;
  map.at<double>(1, 2) += dy;
  cv::Mat out;
  cv::warpAffine(gray, out, map, gray.size(), cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  return out;
}

}  // namespace tarsier::face::recognition
