// SPDX-License-Identifier: MIT
#include "tarsier/face/detect/training_views.h"

#include "tarsier/face/detect/face_networks.h"
#include "tarsier/media/image_file.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <string>

namespace tarsier::face::training {
namespace {

constexpr double kStretch = 0.04;

// Motion blur.
void blur_along(cv::Mat& view, double length, double angle) {
  constexpr int kSide = 9;
  cv::Mat kernel = cv::Mat::zeros(kSide, kSide, CV_32F);
  const double half = 0.5 * length;
  for (double t = -half; t <= half; t += 0.25) {
    kernel.at<float>(cvRound(kSide / 2 + t * std::sin(angle)),
                     cvRound(kSide / 2 + t * std::cos(angle))) += 1;
  }
  kernel /= cv::sum(kernel)[0];
  cv::filter2D(view, view, -1, kernel);
}

void compress(cv::Mat& view, int quality) {
  const std::vector<std::uint8_t> bytes = encode_image(".jpg", view, "a view", quality);
  cv::extractChannel(decode_image(bytes, "a view"), view, 0);
}

}  // namespace

cv::Point2d ViewTransform::operator()(const cv::Point2d& p) const {
  const cv::Matx23d& m = view_from_image;
  return {m(0, 0) * p.x + m(0, 1) * p.y + m(0, 2), m(1, 0) * p.x + m(1, 1) * p.y + m(1, 2)};
}

ViewTransform view_transform(const cv::Point2d& center, const cv::Point2d& to, double scale,
                             const ViewOrientation& orientation) {
  const double c = scale * std::cos(orientation.angle);
  const double s = scale * std::sin(orientation.angle);
  const double wide = orientation.mirrored ? -orientation.stretch : orientation.stretch;
  const double high = 1 / orientation.stretch;
  const cv::Matx22d m(wide * c, -high * s, wide * s, high * c);
  ViewTransform result;
  result.scale = scale;
  result.view_from_image = {m(0, 0), m(0, 1), to.x - (m(0, 0) * center.x + m(0, 1) * center.y),
                            m(1, 0), m(1, 1), to.y - (m(1, 0) * center.x + m(1, 1) * center.y)};
  return result;
}

ViewTransform random_view(const Image& image, int side, double smallest_scale, bool wide,
                          Rng& rng) {
  const double min_scale = std::min(
      1.0, std::max(smallest_scale,
                    static_cast<double>(side) / std::min(image.size().width, image.size().height)));
  const double scale = log_uniform(rng, min_scale, std::max(1.0, min_scale));
  const double x = rng.uniform(0, image.size().width);
  const double y = rng.uniform(0, image.size().height);
  return view_transform({x, y}, {side / 2.0, side / 2.0}, scale, random_orientation(wide, rng));
}

ViewOrientation random_orientation(bool wide, Rng& rng) {
  ViewOrientation orientation;
  const bool any = wide && rng.uniform() < 0.25;
  const double degrees = any ? rng.uniform(-48, 48) : std::clamp(rng.normal(0, 13.0), -36.0, 36.0);
  orientation.angle = degrees * CV_PI / 180;
  orientation.mirrored = rng.uniform() < 0.5;
  orientation.stretch = std::exp(std::clamp(rng.normal(0, kStretch), -2 * kStretch, 2 * kStretch));
  return orientation;
}

cv::Mat render_view(const Image& image, const ViewTransform& transform, int side,
                    const cv::Mat* background) {
  const int level = half_for(transform.scale, image.halves.size());
  const double unit = std::ldexp(1.0, level);
  // Convert from pixel corners to pixel centres, in both images.
  cv::Matx23d m = transform.view_from_image;
  cv::Matx23d warp(m(0, 0) * unit, m(0, 1) * unit, 0, m(1, 0) * unit, m(1, 1) * unit, 0);
  warp(0, 2) = m(0, 2) + 0.5 * (warp(0, 0) + warp(0, 1)) - 0.5;
  warp(1, 2) = m(1, 2) + 0.5 * (warp(1, 0) + warp(1, 1)) - 0.5;
  cv::Mat view;
  if (background != nullptr) view = background->clone();
  cv::warpAffine(image.halves[static_cast<std::size_t>(level)], view, warp, cv::Size(side, side),
                 cv::INTER_LINEAR,
                 background != nullptr ? cv::BORDER_TRANSPARENT : cv::BORDER_REPLICATE);
  return view;
}

void degrade(cv::Mat& view, Rng& rng) {
  const double gamma = std::exp(rng.normal(0, 0.3));
  const double contrast = std::exp(rng.normal(0, 0.3));
  const double offset = rng.normal(0, 20);
  const double slope_x = rng.uniform() < 0.3 ? rng.normal(0, 1.2) : 0;
  const double slope_y = rng.uniform() < 0.3 ? rng.normal(0, 0.8) : 0;
  const double noise = rng.uniform() < 0.5 ? rng.uniform(0, 9) : 0;
  const double lens = rng.uniform();
  if (lens < 0.22) {
    const double sigma = rng.uniform(0.4, 1.1);
    cv::GaussianBlur(view, view, cv::Size(0, 0), sigma);
  } else if (lens < 0.46) {  // a small face, enlarged; sometimes from a compressed image
    const int side = cvRound(view.cols * rng.uniform(0.4, 0.9));
    cv::Mat small;
    cv::resize(view, small, cv::Size(side, side), 0, 0, cv::INTER_AREA);
    if (rng.uniform() < 0.35) compress(small, rng.integer(30, 90));
    cv::resize(small, view, view.size(), 0, 0,
               rng.uniform() < 0.5 ? cv::INTER_LINEAR : cv::INTER_CUBIC);
  } else if (lens < 0.52) {
    const double length = rng.uniform(1, 4);
    blur_along(view, length, rng.uniform(0, CV_PI));
  }
  float curve[256];
  for (int i = 0; i < 256; ++i) {
    curve[i] =
        static_cast<float>((255 * std::pow(i / 255.0, gamma) - 128) * contrast + 128 + offset);
  }
  for (int y = 0; y < view.rows; ++y) {
    std::uint8_t* row = view.ptr(y);
    for (int x = 0; x < view.cols; ++x) {
      const double light = slope_x * (x - view.cols / 2) + slope_y * (y - view.rows / 2);
      const double grain = noise > 0 ? rng.normal(0, noise) : 0;
      row[x] = cv::saturate_cast<std::uint8_t>(curve[row[x]] + light + grain);
    }
  }
  if (rng.uniform() < 0.2) compress(view, rng.integer(25, 85));
}

void occlude_part(cv::Mat& view, const cv::Rect2d& box, Rng& rng) {
  const double share = rng.uniform(0.15, 0.4);
  const int edge = rng.integer(0, 3);
  const double value = rng.uniform(0, 255);
  cv::Rect2d area(box.x - 0.3 * box.width, box.y - 0.3 * box.height, 1.6 * box.width,
                  1.6 * box.height);
  const double length = (0.3 + share) * box.width;
  if (edge == 0) area.width = length;
  if (edge == 1) area = {area.x + area.width - length, area.y, length, area.height};
  if (edge >= 2) area = {area.x, area.y + area.height - length, area.width, length};
  const cv::Rect whole =
      cv::Rect(cvRound(area.x), cvRound(area.y), cvRound(area.width), cvRound(area.height)) &
      cv::Rect(0, 0, view.cols, view.rows);
  if (whole.empty()) return;
  view(whole).setTo(cv::Scalar(value));
}

double log_uniform(Rng& rng, double low, double high) {
  return low * std::exp(rng.uniform() * std::log(high / low));
}

// --- drawings ---

namespace {

constexpr int kDrawingWidth = 480;
constexpr int kDrawingHeight = 360;

cv::Scalar grey(Rng& rng) { return cv::Scalar(rng.integer(0, 255)); }

cv::Point somewhere(Rng& rng) {
  const int x = rng.integer(0, kDrawingWidth - 1);
  return {x, rng.integer(0, kDrawingHeight - 1)};
}

void draw_chessboard(cv::Mat& sheet, Rng& rng) {
  const int cell = rng.integer(8, 40);
  const int dark = rng.integer(0, 90);
  const int light = rng.integer(150, 255);
  for (int y = 0; y < sheet.rows; ++y) {
    for (int x = 0; x < sheet.cols; ++x) {
      sheet.at<std::uint8_t>(y, x) =
          static_cast<std::uint8_t>((x / cell + y / cell) % 2 == 0 ? dark : light);
    }
  }
}

void draw_gratings(cv::Mat& sheet, Rng& rng) {
  cv::Mat sum = cv::Mat::zeros(sheet.size(), CV_32F);
  const int waves = rng.integer(1, 3);
  for (int k = 0; k < waves; ++k) {
    const double period = log_uniform(rng, 5, 60);
    const double angle = rng.uniform(0, CV_PI);
    const double fx = 2 * CV_PI / period * std::cos(angle);
    const double fy = 2 * CV_PI / period * std::sin(angle);
    for (int y = 0; y < sheet.rows; ++y) {
      for (int x = 0; x < sheet.cols; ++x) {
        sum.at<float>(y, x) += static_cast<float>(std::sin(fx * x + fy * y));
      }
    }
  }
  sum.convertTo(sheet, CV_8U, 110.0 / waves, 128);
}

void draw_dots(cv::Mat& sheet, Rng& rng) {
  sheet.setTo(grey(rng));
  const int step = rng.integer(10, 50);
  const double share = rng.uniform(0.15, 0.45);
  const double jitter = rng.uniform() < 0.5 ? 0 : 0.3 * step;
  const cv::Scalar value = grey(rng);
  const bool rings = rng.uniform() < 0.3;
  for (int y = step / 2; y < sheet.rows; y += step) {
    for (int x = step / 2; x < sheet.cols; x += step) {
      const int dx = cvRound(rng.uniform(-jitter, jitter));
      const int dy = cvRound(rng.uniform(-jitter, jitter));
      cv::circle(sheet, {x + dx, y + dy}, std::max(1, cvRound(share * step)), value,
                 rings ? std::max(1, step / 10) : cv::FILLED, cv::LINE_AA);
    }
  }
}

void draw_writing(cv::Mat& sheet, Rng& rng) {
  const bool dark = rng.uniform() < 0.7;
  sheet.setTo(cv::Scalar(dark ? rng.integer(150, 255) : rng.integer(0, 90)));
  const double size = log_uniform(rng, 0.3, 2.2);
  const int font = rng.integer(0, 7);
  const int thick = rng.integer(1, size > 0.8 ? 4 : 2);
  for (int y = 10; y < sheet.rows + 20; y += cvRound(34 * size)) {
    std::string line;
    for (int k = 0; k < 60; ++k) {
      line += rng.uniform() < 0.17 ? ' ' : static_cast<char>(rng.integer(33, 126));
    }
    const int left = -rng.integer(0, 40);
    const cv::Scalar ink(dark ? rng.integer(0, 70) : rng.integer(170, 255));
    cv::putText(sheet, line, {left, y}, font, size, ink, thick, cv::LINE_AA);
  }
}

void draw_facade(cv::Mat& sheet, Rng& rng) {
  sheet.setTo(grey(rng));
  const int wide = rng.integer(14, 60);
  const int high = rng.integer(14, 70);
  const double share_x = rng.uniform(0.3, 0.8);
  const double share_y = rng.uniform(0.3, 0.8);
  const cv::Scalar value = grey(rng);
  for (int y = 0; y < sheet.rows; y += high) {
    for (int x = 0; x < sheet.cols; x += wide) {
      const cv::Rect window(x, y, std::max(2, cvRound(share_x * wide)),
                            std::max(2, cvRound(share_y * high)));
      cv::rectangle(sheet, window, rng.uniform() < 0.8 ? value : grey(rng), cv::FILLED);
      if (rng.uniform() < 0.3) cv::rectangle(sheet, window, grey(rng), 2);
    }
  }
}

void draw_shapes(cv::Mat& sheet, Rng& rng) {
  sheet.setTo(grey(rng));
  const int count = rng.integer(20, 140);
  for (int k = 0; k < count; ++k) {
    const cv::Point at = somewhere(rng);
    const double size = log_uniform(rng, 4, 90);
    const cv::Scalar value = grey(rng);
    const int kind = rng.integer(0, 3);
    const int thick = rng.uniform() < 0.6 ? static_cast<int>(cv::FILLED) : rng.integer(1, 5);
    if (kind == 0) {
      const double squash = rng.uniform(0.2, 1);
      cv::ellipse(sheet, at, cv::Size(cvRound(size), cvRound(squash * size)), rng.uniform(0, 180),
                  0, 360, value, thick, cv::LINE_AA);
    } else if (kind == 1) {
      const double squash = rng.uniform(0.2, 1);
      cv::rectangle(sheet, cv::Rect(at.x, at.y, cvRound(size) + 1, cvRound(squash * size) + 1),
                    value, thick);
    } else if (kind == 2) {
      std::vector<cv::Point> corners;
      const int sides = rng.integer(3, 6);
      for (int c = 0; c < sides; ++c) {
        const double x = rng.uniform(-size, size);
        corners.emplace_back(at.x + cvRound(x), at.y + cvRound(rng.uniform(-size, size)));
      }
      cv::fillPoly(sheet, std::vector<std::vector<cv::Point>>{corners}, value, cv::LINE_AA);
    } else {
      const cv::Point end = somewhere(rng);
      cv::line(sheet, at, end, value, rng.integer(1, 8), cv::LINE_AA);
    }
  }
}

// Shows the sheet in perspective.
void tilt(cv::Mat& sheet, Rng& rng) {
  cv::Point2f from[4] = {
      {0, 0}, {kDrawingWidth, 0}, {kDrawingWidth, kDrawingHeight}, {0, kDrawingHeight}};
  cv::Point2f to[4];
  for (int k = 0; k < 4; ++k) {
    const double x = rng.uniform(-70, 70);
    to[k] = {from[k].x + static_cast<float>(x),
             from[k].y + static_cast<float>(rng.uniform(-60, 60))};
  }
  const cv::Mat h = cv::getPerspectiveTransform(from, to);
  cv::Mat seen;
  cv::warpPerspective(sheet, seen, h, sheet.size(), cv::INTER_LINEAR, cv::BORDER_CONSTANT,
                      grey(rng));
  sheet = seen;
}

}  // namespace

cv::Mat draw_without_faces(Rng& rng) {
  using Draw = void (*)(cv::Mat&, Rng&);
  constexpr Draw kKinds[] = {draw_chessboard, draw_gratings, draw_dots,
                             draw_writing,    draw_facade,   draw_shapes};
  cv::Mat sheet(kDrawingHeight, kDrawingWidth, CV_8UC1, cv::Scalar(128));
  kKinds[rng.integer(0, 5)](sheet, rng);
  tilt(sheet, rng);
  // Some are partly occluded by other objects.
  if (rng.uniform() < 0.3) {
    cv::Mat before(sheet.size(), CV_8UC1);
    kKinds[rng.integer(0, 5)](before, rng);
    const cv::Point corner = somewhere(rng);
    const cv::Rect part =
        cv::Rect(corner.x / 2, corner.y / 2, kDrawingWidth / 2, kDrawingHeight / 2) &
        cv::Rect(0, 0, kDrawingWidth, kDrawingHeight);
    before(part).copyTo(sheet(part));
  }
  if (rng.uniform() < 0.5) cv::GaussianBlur(sheet, sheet, {0, 0}, rng.uniform(0.5, 2));
  return sheet;
}

}  // namespace tarsier::face::training
