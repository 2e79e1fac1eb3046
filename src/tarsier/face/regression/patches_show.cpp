// SPDX-License-Identifier: MIT
#include "tarsier/core/image.h"
#include "tarsier/core/require.h"
#include "tarsier/face/regression/patch_image.h"
#include "tarsier/face/regression/patches.h"
#include "tarsier/image/draw/shapes.h"
#include "tarsier/image/draw/text.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier::face::regression {
namespace {

const cv::Scalar kBackground(48, 40, 36);
const cv::Scalar kLine(110, 90, 70);
const cv::Scalar kAccent(60, 200, 255);
constexpr int kShortestCell = 48;  // px

// Maps values -max_abs..max_abs to black..white.
cv::Mat as_gray(const cv::Mat& values, double max_abs) {
  cv::Mat gray;
  values.convertTo(gray, CV_8UC1, max_abs > 0 ? 127.0 / max_abs : 0, 128);
  return gray;
}

double largest(const cv::Mat& values) { return cv::norm(values, cv::NORM_INF); }

cv::Mat enlarged(const cv::Mat& image, int zoom) {
  cv::Mat out;
  cv::resize(image, out, image.size() * zoom, 0, 0, cv::INTER_NEAREST);
  return out;
}

// Grey values of the side x side window of the patches' frame around a point of the image.
cv::Mat window_at(const detail::Reduced& image, const shape::Similarity2d& image_from_frame,
                  const Eigen::Vector2d& point, int side) {
  const double a = image_from_frame.a / image.step;
  const double b = image_from_frame.b / image.step;
  const double half = side / 2;
  const double x = (point.x() - image.origin.x) / image.step;
  const double y = (point.y() - image.origin.y) / image.step;
  const cv::Matx23d map(a, -b, x - a * half + b * half, b, a, y - b * half - a * half);
  cv::Mat window;
  cv::warpAffine(image.gray, window, map, cv::Size(side, side),
                 cv::INTER_LINEAR | cv::WARP_INVERSE_MAP, cv::BORDER_REPLICATE);
  return window;
}

}  // namespace

cv::Mat draw_patches(const PatchModels& model, const shape::ShapeModel& shape, int point,
                     int zoom) {
  model.check();
  const int n = model.points();
  TARSIER_REQUIRE(shape.points() == n, "{} patches, a shape of {} points", n, shape.points());
  TARSIER_REQUIRE(point >= -1 && point < n, "point is {}, not -1..{}", point, n - 1);
  TARSIER_REQUIRE(zoom >= 1 && zoom <= 16, "zoom is {}, not 1..16", zoom);
  const double margin = model.side() / 2 + 3;
  const Eigen::Vector2d low = model.reference.rowwise().minCoeff().array() - margin;
  const Eigen::Vector2d high = model.reference.rowwise().maxCoeff().array() + margin;
  const cv::Size size(static_cast<int>(std::ceil((high.x() - low.x()) * zoom)) + 1,
                      static_cast<int>(std::ceil((high.y() - low.y()) * zoom)) + 1);
  const auto position_of = [&](Eigen::Index i) {
    return cv::Point2d((model.reference(0, i) - low.x()) * zoom,
                       (model.reference(1, i) - low.y()) * zoom);
  };
  const int side = model.side() * zoom;
  const auto box_of = [&](int i) {
    const cv::Point2d at = position_of(i);
    return cv::Rect(static_cast<int>(std::lround(at.x - side / 2.0)),
                    static_cast<int>(std::lround(at.y - side / 2.0)), side, side);
  };

  // Overlapping patches are averaged.
  cv::Mat sum(size, CV_32FC1, cv::Scalar(0));
  cv::Mat count(size, CV_32FC1, cv::Scalar(0));
  for (int i = 0; i < n; ++i) {
    const cv::Mat& patch = model.patches[static_cast<std::size_t>(i)];
    const double max_abs = largest(patch);
    const cv::Rect box = box_of(i);
    if (max_abs > 0) sum(box) += enlarged(patch, zoom) / max_abs;
    count(box) += 1;
  }
  cv::Mat mean;
  cv::divide(sum, cv::max(count, 1.0), mean);
  cv::Mat canvas(size, CV_8UC3, kBackground);
  cv::Mat gray;
  cv::cvtColor(as_gray(mean, 0.7), gray, cv::COLOR_GRAY2BGR);
  gray.copyTo(canvas, count > 0);
  for (const auto& [first, second] : shape.connections) {
    if (std::min(first, second) < 0 || std::max(first, second) >= n) continue;
    cv::line(canvas, cv::Point(position_of(first)), cv::Point(position_of(second)), kLine, 1,
             cv::LINE_AA);
  }
  for (int i = 0; i < n; ++i) image::draw::point(canvas, position_of(i), kAccent, 0.4 * zoom + 0.6);
  if (point >= 0) {
    const cv::Rect box = box_of(point);
    const cv::Mat& patch = model.patches[static_cast<std::size_t>(point)];
    cv::cvtColor(as_gray(enlarged(patch, zoom), largest(patch)), gray, cv::COLOR_GRAY2BGR);
    gray.copyTo(canvas(box));
    cv::rectangle(canvas, box, kAccent, std::max(1, zoom / 3));
  }
  return canvas;
}

cv::Mat draw_patch(const PatchModels& model, int point, int side) {
  TARSIER_REQUIRE(point >= 0 && point < model.points(), "point is {}, not 0..{}", point,
                  model.points() - 1);
  TARSIER_REQUIRE(side >= model.side() && side <= 2000, "side is {} px", side);
  const cv::Mat& patch = model.patches[static_cast<std::size_t>(point)];
  cv::Mat weights;
  cv::resize(as_gray(patch, largest(patch)), weights, {side, side}, 0, 0, cv::INTER_NEAREST);
  cv::Mat left;
  cv::cvtColor(weights, left, cv::COLOR_GRAY2BGR);

  cv::Mat dx;
  cv::Mat dy;
  cv::Mat strength;
  cv::Mat angle;
  cv::Sobel(patch, dx, CV_32F, 1, 0);
  cv::Sobel(patch, dy, CV_32F, 0, 1);
  cv::cartToPolar(dx, dy, strength, angle, true);
  const double max_abs = largest(strength);
  cv::Mat channels[3];
  angle.convertTo(channels[0], CV_8UC1, 0.5);
  channels[1] = cv::Mat(patch.size(), CV_8UC1, cv::Scalar(200));
  strength.convertTo(channels[2], CV_8UC1, max_abs > 0 ? 255 / max_abs : 0);
  cv::Mat hue;
  cv::merge(channels, 3, hue);
  cv::cvtColor(hue, hue, cv::COLOR_HSV2BGR);
  cv::Mat right;
  cv::resize(hue, right, {side, side}, 0, 0, cv::INTER_NEAREST);
  const int gap = side / 10;
  cv::Mat canvas(side, 2 * side + gap, CV_8UC3, kBackground);
  left.copyTo(canvas(cv::Rect(0, 0, side, side)));
  right.copyTo(canvas(cv::Rect(side + gap, 0, side, side)));
  return canvas;
}

std::vector<PointResponse> point_responses(const PatchModels& model, const cv::Mat& gray,
                                           const Eigen::Matrix2Xd& points, int search) {
  model.check();
  require_gray(gray);
  const int n = model.points();
  TARSIER_REQUIRE(points.cols() == n && points.allFinite() && points.cwiseAbs().maxCoeff() < 1e6,
                  "{} points for {} patches, or not finite", points.cols(), n);
  TARSIER_REQUIRE(search >= 3 && search <= 101 && search % 2 == 1,
                  "search is {}, not odd and in 3..101", search);
  const shape::Similarity2d image_from_frame = shape::fit_similarity(model.reference, points);
  const double reach = (search + model.side()) * image_from_frame.scale();
  const auto whole = [](double value) {
    return static_cast<int>(std::round(std::clamp(value, -1e6, 2e6)));
  };
  const cv::Point first(whole(points.row(0).minCoeff() - reach),
                        whole(points.row(1).minCoeff() - reach));
  const cv::Point last(whole(points.row(0).maxCoeff() + reach),
                       whole(points.row(1).maxCoeff() + reach));
  detail::Reduced image;
  detail::reduce(gray, cv::Rect(first, last), image_from_frame.scale(), image);
  const int reach_px = model.side() / 2;
  std::vector<PointResponse> responses;
  for (int i = 0; i < n; ++i) {
    const cv::Mat window = window_at(image, image_from_frame, points.col(i), search + 2 * reach_px);
    PointResponse response;
    response.window = window(cv::Rect(reach_px, reach_px, search, search));
    response.response = patch_response(model.patches[static_cast<std::size_t>(i)], window);
    cv::minMaxLoc(response.response, nullptr, &response.best, nullptr, &response.peak);
    responses.push_back(std::move(response));
  }
  return responses;
}

cv::Mat draw_response(const PointResponse& response, int side) {
  const int search = response.response.cols;
  TARSIER_REQUIRE(search > 0 && response.window.size() == response.response.size(),
                  "a response of {} px", search);
  TARSIER_REQUIRE(side >= search && side <= 2000, "side is {} px for {}", side, search);
  const int zoom = side / search;
  const int across = search * zoom;
  cv::Mat canvas(across, 2 * across, CV_8UC3);
  const cv::Rect left(0, 0, across, across);
  const cv::Rect right(across, 0, across, across);
  cv::Mat shown;
  cv::cvtColor(enlarged(response.window, zoom), shown, cv::COLOR_GRAY2BGR);
  shown.copyTo(canvas(left));
  double min_response = 0;
  double best = 0;
  cv::minMaxLoc(response.response, &min_response, &best);
  cv::Mat levels;
  response.response.convertTo(
      levels, CV_8UC1, best > min_response ? 255 / (best - min_response) : 0,
      best > min_response ? -255 * min_response / (best - min_response) : 0);
  cv::applyColorMap(enlarged(levels, zoom), shown, cv::COLORMAP_VIRIDIS);
  shown.copyTo(canvas(right));
  // The point is the centre of both images; the disk marks the peak.
  const auto centre = [&](const cv::Rect& box, double x, double y) {
    return cv::Point2d(box.x + (x + 0.5) * zoom - 0.5, box.y + (y + 0.5) * zoom - 0.5);
  };
  const double half = search / 2;
  const double size = std::max(4.0, across / 25.0);
  image::draw::cross(canvas, centre(left, half, half), kAccent, size);
  image::draw::cross(canvas, centre(right, half, half), cv::Scalar(255, 255, 255), size);
  image::draw::point(canvas, centre(right, response.peak.x, response.peak.y),
                     cv::Scalar(60, 60, 255), size / 2);
  return canvas;
}

cv::Mat draw_responses(const PatchModels& model, const cv::Mat& gray,
                       const Eigen::Matrix2Xd& points, int search) {
  const std::vector<PointResponse> responses = point_responses(model, gray, points, search);
  const int n = model.points();
  // A cell: the image under the window on the left, the response on the right.
  const int side = search * std::max(1, (kShortestCell + search - 1) / search);
  const int gap = 4;
  const int label = 14;
  const int columns =
      std::max(1, static_cast<int>(
                      std::lround(std::sqrt(n * (4.0 / 3) * (side + label) / (2.0 * side + gap)))));
  const int rows = (n + columns - 1) / columns;
  cv::Mat sheet(rows * (side + label + gap) + gap, columns * (2 * side + 2 * gap) + gap, CV_8UC3,
                kBackground);
  for (int i = 0; i < n; ++i) {
    const PointResponse& response = responses[static_cast<std::size_t>(i)];
    const cv::Point corner(gap + (i % columns) * (2 * side + 2 * gap),
                           gap + (i / columns) * (side + label + gap));
    image::draw::TextStyle style;
    style.height_px = 8;
    style.backing = image::draw::Backing::kNone;
    image::draw::put_text(sheet, fmt::format("{}  {:.2f}", i, response.best), corner, style);
    draw_response(response, side)
        .copyTo(sheet(cv::Rect(corner.x, corner.y + label, 2 * side, side)));
  }
  return sheet;
}

}  // namespace tarsier::face::regression
