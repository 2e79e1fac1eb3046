// SPDX-License-Identifier: MIT
#include "tarsier/cartoon/skin.h"

#include "tarsier/cartoon/kernels.h"
#include "tarsier/cartoon/rows.h"
#include "tarsier/core/image.h"
#include "tarsier/core/require.h"
#include "tarsier/core/statistics.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <cstring>

namespace tarsier::cartoon {
namespace {

cv::Scalar differences(const std::array<int, 3>& d) {
  return {double(d[0]), double(d[1]), double(d[2])};
}

// The inner part of `mask_with_border`, without the border of one pixel.
cv::Mat inside(const cv::Mat& mask_with_border) {
  return mask_with_border(cv::Rect(1, 1, mask_with_border.cols - 2, mask_with_border.rows - 2));
}

cv::Rect clipped(const cv::Rect& rect, const cv::Size& size) {
  return rect & cv::Rect(0, 0, size.width, size.height);
}

}  // namespace

std::array<cv::Point, 6> skin_seeds(cv::Size size) {
  const int w = size.width;
  const int h = size.height;
  return {{{w / 2, h / 2 - h / 6},
           {w / 2 - w / 11, h / 2 - h / 6},
           {w / 2 + w / 11, h / 2 - h / 6},
           {w / 2, h / 2 + h / 16},
           {w / 2 - w / 9, h / 2 + h / 16},
           {w / 2 + w / 9, h / 2 + h / 16}}};
}

cv::Mat find_skin(const cv::Mat& painting, const cv::Mat& response, const SkinOptions& options,
                  SkinBuffers& buffers) {
  require_bgr(painting);
  require_gray(response);
  cv::cvtColor(painting, buffers.ycrcb, cv::COLOR_BGR2YCrCb);
  // floodFill takes a mask with a border of one pixel; edges in it stop the fill.
  buffers.flood_mask.create(painting.rows + 2, painting.cols + 2, CV_8UC1);
  buffers.flood_mask.setTo(0);
  cv::Mat mask = inside(buffers.flood_mask);
  cv::resize(response, mask, painting.size(), 0, 0, cv::INTER_LINEAR);
  cv::threshold(mask, mask, options.edge_threshold, 255, cv::THRESH_BINARY);
  cv::dilate(mask, mask, cv::Mat());  // closes gaps of one pixel
  cv::erode(mask, mask, cv::Mat());
  mask.copyTo(buffers.edges);
  constexpr int kFlags = 4 | cv::FLOODFILL_FIXED_RANGE | cv::FLOODFILL_MASK_ONLY;
  for (const cv::Point& seed : skin_seeds(painting.size())) {
    cv::floodFill(buffers.ycrcb, buffers.flood_mask, seed, cv::Scalar(), nullptr,
                  differences(options.lower), differences(options.upper), kFlags);
  }
  mask -= buffers.edges;  // filled pixels are 1, edges 255
  return mask;
}

SkinColor learn_skin_color(const cv::Mat& ycrcb, const cv::Rect& face) {
  require_bgr(ycrcb);
  // Below the eyes, above the mouth, within the cheeks.
  const cv::Rect center_region = clipped({face.x + face.width / 5, face.y + face.height * 45 / 100,
                                          face.width * 3 / 5, std::max(1, face.height / 4)},
                                         ycrcb.size());
  TARSIER_REQUIRE(!center_region.empty(), "face {}x{} at {},{} is outside the image", face.width,
                  face.height, face.x, face.y);
  std::vector<std::uint8_t> cr;
  std::vector<std::uint8_t> cb;
  for (int y = center_region.y; y < center_region.br().y; ++y) {
    const auto* row = ycrcb.ptr<cv::Vec3b>(y);
    for (int x = center_region.x; x < center_region.br().x; ++x) {
      cr.push_back(row[x][1]);
      cb.push_back(row[x][2]);
    }
  }
  const double cr_median = upper_median(cr);
  const double cb_median = upper_median(cb);
  // Covariance of the nearer half, which excludes glasses, the nose's shadow and a beard.
  constexpr double kMaxDeviation = 12;  // grey levels
  constexpr double kMinVariance =
      3 * 3;  // added to each variance: noise and paint make flat patches
  double sum[5] = {0, 0, 0, 0, 0};
  double count = 0;
  for (size_t i = 0; i < cr.size(); ++i) {
    const double u = cr[i] - cr_median;
    const double v = cb[i] - cb_median;
    if (std::abs(u) > kMaxDeviation || std::abs(v) > kMaxDeviation) continue;
    count += 1;
    sum[0] += u;
    sum[1] += v;
    sum[2] += u * u;
    sum[3] += u * v;
    sum[4] += v * v;
  }
  count = std::max(count, 1.0);
  const double u = sum[0] / count;
  const double v = sum[1] / count;
  const cv::Matx22d covariance(sum[2] / count - u * u + kMinVariance, sum[3] / count - u * v,
                               sum[3] / count - u * v, sum[4] / count - v * v + kMinVariance);
  return {{cr_median + u, cb_median + v}, covariance.inv()};
}

cv::Mat find_skin_of_faces(const cv::Mat& painting, const std::vector<cv::Rect>& faces,
                           const std::vector<SkinColor>& colors, const SkinOptions& options,
                           SkinBuffers& buffers) {
  require_bgr(painting);
  TARSIER_REQUIRE(faces.size() == colors.size(), "{} faces, {} colours", faces.size(),
                  colors.size());
  cv::cvtColor(painting, buffers.ycrcb, cv::COLOR_BGR2YCrCb);
  buffers.flood_mask.create(painting.rows + 2, painting.cols + 2, CV_8UC1);
  buffers.flood_mask.setTo(0);
  cv::Mat mask = inside(buffers.flood_mask);
  const double limit = options.learned_distance * options.learned_distance;
  for (size_t i = 0; i < faces.size(); ++i) {
    const cv::Rect& face = faces[i];
    // The head with ears and neck: an ellipse around the detector's box, which is tight.
    const double center_x = face.x + face.width / 2.0;
    const double center_y = face.y + face.height * 0.55;
    const double radius_x = face.width * 0.75;
    const double radius_y = face.height * 1.0;
    const cv::Rect area =
        clipped({static_cast<int>(center_x - radius_x), static_cast<int>(center_y - radius_y),
                 static_cast<int>(2 * radius_x) + 1, static_cast<int>(2 * radius_y) + 1},
                painting.size());
    const SkinColor& color = colors[i];
    for (int y = area.y; y < area.br().y; ++y) {
      const auto* row = buffers.ycrcb.ptr<cv::Vec3b>(y);
      auto* out = mask.ptr(y);
      const double v = (y - center_y) / radius_y;
      for (int x = area.x; x < area.br().x; ++x) {
        const double u = (x - center_x) / radius_x;
        if (u * u + v * v > 1) continue;
        const cv::Vec2d d(row[x][1] - color.mean[0], row[x][2] - color.mean[1]);
        if (d.dot(color.inverse_covariance * d) <= limit) out[x] = 1;
      }
    }
  }
  cv::medianBlur(mask, buffers.edges, 5);  // keeps the holes of eyes and mouth, removes specks
  return buffers.edges;
}

void color_skin(cv::Mat& painting, const cv::Mat& skin, const SkinOptions& options) {
  require_bgr(painting);
  require_gray(skin);
  if (options.style == SkinStyle::kGlow) {
    cv::add(painting, options.color, painting, skin);
    return;
  }
  // Tint: the chroma of the colour, the luma of the skin.
  const cv::Scalar& c = options.color;
  const double luma = 0.114 * c[0] + 0.587 * c[1] + 0.299 * c[2];
  for (int y = 0; y < painting.rows; ++y) {
    auto* row = painting.ptr<cv::Vec3b>(y);
    const auto* is_skin = skin.ptr(y);
    for (int x = 0; x < painting.cols; ++x) {
      if (is_skin[x] == 0) continue;
      const double old_luma = 0.114 * row[x][0] + 0.587 * row[x][1] + 0.299 * row[x][2];
      for (int k = 0; k < 3; ++k)
        row[x][k] = cv::saturate_cast<std::uint8_t>(old_luma + c[k] - luma);
    }
  }
}

cv::Rect smoothed_area(const cv::Mat& skin) {
  require_gray(skin);
  const cv::Rect box = cv::boundingRect(skin);
  if (box.empty()) return {};
  // Closing reaches 1 px beyond the skin, the blur another 2 px, enlarging 1 px. A border of zeros
  // must remain, because each of these steps reads beyond its region.
  constexpr int kMargin = 8;
  return clipped(
      {box.x - kMargin, box.y - kMargin, box.width + 2 * kMargin, box.height + 2 * kMargin},
      skin.size());
}

void smooth_skin(const cv::Mat& frame, const cv::Mat& enlarged, const cv::Mat& skin,
                 SkinBuffers& buffers, cv::Mat& result) {
  require_bgr(frame);
  require_bgr(enlarged);
  TARSIER_REQUIRE(frame.size() == enlarged.size(), "painting is {}x{}, frame {}x{}", enlarged.cols,
                  enlarged.rows, frame.cols, frame.rows);
  const bool twice = frame.cols == 2 * skin.cols && frame.rows == 2 * skin.rows;
  const cv::Rect area = twice ? smoothed_area(skin) : cv::Rect({}, skin.size());
  const cv::Rect large =
      twice ? cv::Rect(area.tl() * 2, area.size() * 2) : cv::Rect({}, frame.size());
  if (!area.empty()) {
    skin(area).convertTo(buffers.weight, CV_8U, 255);
    cv::dilate(buffers.weight, buffers.weight,
               cv::Mat());  // covers the thin lines that limited the fill
    cv::erode(buffers.weight, buffers.weight, cv::Mat());
    Plane& soft = buffers.soft_weight;
    soft.resize(area.width, area.height);
    for_row_bands(area.height, [&](int first, int last) {
      // Also reads the rows around the band.
      cv::Mat blurred = soft.view().rowRange(first, last);
      cv::blur(buffers.weight.rowRange(first, last), blurred, cv::Size(5, 5));
      for (int y = first; y < last; ++y) soft.extend_row_by_copies(y, 1);
    });
    soft.extend_height_by_copies(1);
    if (!twice) {
      cv::resize(soft.view(), buffers.large_weight, large.size(), 0, 0, cv::INTER_LINEAR);
    }
  }
  buffers.weight_rows.resize(
      std::max(buffers.weight_rows.size(), static_cast<size_t>(number_of_bands(frame.rows))));
  result.create(frame.size(), CV_8UC3);
  const Kernels& kernel = kernels();
  const auto copy = [&](int y, int first, int last) {
    const auto count = static_cast<size_t>(3 * (last - first));
    if (count > 0) std::memcpy(result.ptr(y) + 3 * first, frame.ptr(y) + 3 * first, count);
  };
  for_row_bands(frame.rows, [&](int band, int first, int last) {
    AlignedBytes& weight_row = buffers.weight_rows[static_cast<size_t>(band)];
    weight_row.resize(static_cast<size_t>(2 * (area.width + kRowSlack)));
    for (int y = first; y < last; ++y) {
      if (y < large.y || y >= large.br().y) {
        copy(y, 0, frame.cols);
        continue;
      }
      copy(y, 0, large.x);
      const std::uint8_t* weights = weight_row.data();
      if (twice) {
        const int near = (y - large.y) / 2;
        const int far = y % 2 == 0 ? near - 1 : near + 1;
        kernel.enlarge_plane_row(buffers.soft_weight.row(near), buffers.soft_weight.row(far),
                                 weight_row.data(), area.width);
      } else {
        weights = buffers.large_weight.ptr(y);
      }
      kernel.blend_row(frame.ptr(y) + 3 * large.x, enlarged.ptr(y) + 3 * large.x, weights,
                       result.ptr(y) + 3 * large.x, large.width);
      copy(y, large.br().x, frame.cols);
    }
  });
}

}  // namespace tarsier::cartoon
