// SPDX-License-Identifier: MIT
#include "tarsier/face/appearance/edit.h"

#include "tarsier/core/name_table.h"
#include "tarsier/core/require.h"
#include "tarsier/image/draw/shapes.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

namespace tarsier::face::appearance {

using Eigen::Matrix2Xd;

namespace {

constexpr NameTable<FaceEdit, 2> kEdits{
    "edit", {{{FaceEdit::kOpenMouth, "mouth"}, {FaceEdit::kRaiseBrows, "brows"}}}};

constexpr int kPoints = 68;
constexpr double kMouthShare = 0.22;  // movement of the lower lip, share of the face's height
constexpr double kBrowShare = 0.09;
constexpr double kInside = 0.45;   // brightness inside an open mouth
constexpr double kFeather = 0.03;  // blending width at the edge, share of the face's width

// Movement of each point along the face's downward axis, in face heights.
double share_of(int point, FaceEdit edit) {
  const auto is_in = [&](int first, int last) { return point >= first && point <= last; };
  if (edit == FaceEdit::kRaiseBrows) return is_in(17, 26) ? -kBrowShare : 0;
  if (is_in(55, 59) || is_in(65, 67)) return kMouthShare;  // lower lip
  if (is_in(6, 10)) return kMouthShare;                    // chin
  if (is_in(4, 5) || is_in(11, 12)) return 0.5 * kMouthShare;
  if (point == 48 || point == 54 || point == 60 || point == 64) return 0.25 * kMouthShare;
  return 0;
}

double mouth_area(const Matrix2Xd& points) {
  std::vector<cv::Point2f> inner;
  for (int i = 60; i <= 67; ++i)
    inner.emplace_back(static_cast<float>(points(0, i)), static_cast<float>(points(1, i)));
  return cv::contourArea(inner);
}

bool is_between_the_lips(const shape::Triangle& triangle) {
  return std::all_of(triangle.begin(), triangle.end(),
                     [](int corner) { return corner >= 60 && corner <= 67; });
}

cv::Point2f point_of(const Matrix2Xd& points, int i) {
  return {static_cast<float>(points(0, i)), static_cast<float>(points(1, i))};
}

// Draws one triangle of `source` into `target` and `mask`.
void move_triangle(const cv::Mat& source, const cv::Point2f (&from)[3], const cv::Point2f (&to)[3],
                   cv::Mat& target, cv::Mat& mask) {
  const std::vector<cv::Point2f> corners(to, to + 3);
  const cv::Rect box = (cv::boundingRect(corners) + cv::Size(2, 2) - cv::Point(1, 1)) &
                       cv::Rect({0, 0}, target.size());
  if (box.empty() || cv::contourArea(corners) < 1e-3) return;
  cv::Point2f local[3];
  cv::Point outline[3];
  for (int k = 0; k < 3; ++k) {
    local[k] = to[k] - cv::Point2f(static_cast<float>(box.x), static_cast<float>(box.y));
    outline[k] = {cvRound(local[k].x * 16), cvRound(local[k].y * 16)};
  }
  cv::Mat piece;
  cv::warpAffine(source, piece, cv::getAffineTransform(from, local), box.size(), cv::INTER_LINEAR,
                 cv::BORDER_REPLICATE);
  cv::Mat inside(box.size(), CV_8UC1, cv::Scalar(0));
  cv::fillConvexPoly(inside, outline, 3, cv::Scalar(255), cv::LINE_8, 4);
  piece.copyTo(target(box), inside);
  mask(box).setTo(255, inside);
}

}  // namespace

std::string_view name_of(FaceEdit edit) { return kEdits.name(edit); }

FaceEdit parse_edit(std::string_view name) { return kEdits.parse(name); }

Matrix2Xd edited_points(const AppearanceModel& model, const Matrix2Xd& points, FaceEdit edit,
                        double amount) {
  TARSIER_REQUIRE(points.cols() == kPoints && model.points() == kPoints, "{} points, 68 are needed",
                  points.cols());
  TARSIER_REQUIRE(amount >= 0 && amount <= 2, "an amount of {}", amount);
  const shape::ShapeFit before = shape::fit_shape(model.shape, points);
  Matrix2Xd moved = shape::shape_of(model.shape, before.b);
  const double height = moved.row(1).maxCoeff() - moved.row(1).minCoeff();
  for (int i = 0; i < kPoints; ++i) moved(1, i) += amount * height * share_of(i, edit);
  // Add what the modes predict for the other points, within limits.
  const shape::ShapeFit after = shape::fit_shape(model.shape, before.image_from_model(moved));
  const Matrix2Xd change = after.image_from_model(shape::shape_of(model.shape, after.b)) -
                           before.image_from_model(shape::shape_of(model.shape, before.b));
  return points + change;
}

void draw_edited(const Synthesis& synthesis, const AppearanceModel& model, cv::Mat& image,
                 const Matrix2Xd& from, const Matrix2Xd& to) {
  image::draw::require_canvas(image);
  TARSIER_REQUIRE(from.cols() == model.points() && to.cols() == model.points(),
                  "{} and {} points, the model has {}", from.cols(), to.cols(), model.points());
  const TextureFit fit = synthesis.fit_texture(image, from);
  cv::Mat made = image.clone();
  synthesis.draw(fit.c, fit.offset, fit.gain, to, made);
  // The inside of a mouth that was closed in the image is darker.
  const double opened = 1 - std::min(1.0, mouth_area(from) / std::max(1.0, mouth_area(to)));
  made.convertTo(made, -1, 1 - (1 - kInside) * opened);
  cv::Mat changed = image.clone();
  cv::Mat mask(image.size(), CV_8UC1, cv::Scalar(0));
  for (const shape::Triangle& triangle : model.mesh) {
    if (*std::max_element(triangle.begin(), triangle.end()) >= from.cols()) continue;
    const bool is_hidden = is_between_the_lips(triangle);
    cv::Point2f a[3];
    cv::Point2f b[3];
    for (std::size_t k = 0; k < 3; ++k) {
      a[k] = point_of(is_hidden ? to : from, triangle[k]);
      b[k] = point_of(to, triangle[k]);
    }
    move_triangle(is_hidden ? made : image, a, b, changed, mask);
  }
  // Blend at the edge.
  const double width = to.row(0).maxCoeff() - to.row(0).minCoeff();
  const double feather = std::max(1.0, kFeather * width);
  cv::Mat weight;
  const int reach = cvRound(feather);
  cv::erode(mask, weight,
            cv::getStructuringElement(cv::MORPH_ELLIPSE, {2 * reach + 1, 2 * reach + 1}), {-1, -1},
            1, cv::BORDER_CONSTANT, cv::Scalar(0));
  cv::GaussianBlur(weight, weight, {}, feather / 2);
  for (int y = 0; y < image.rows; ++y) {
    auto* to_row = image.ptr<cv::Vec3b>(y);
    const auto* from_row = changed.ptr<cv::Vec3b>(y);
    const auto* share = weight.ptr<std::uint8_t>(y);
    for (int x = 0; x < image.cols; ++x) {
      if (share[x] == 0) continue;
      for (int k = 0; k < 3; ++k)
        to_row[x][k] = static_cast<std::uint8_t>(
            (share[x] * from_row[x][k] + (255 - share[x]) * to_row[x][k] + 127) / 255);
    }
  }
}

}  // namespace tarsier::face::appearance
