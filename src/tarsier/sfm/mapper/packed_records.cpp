// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/packed_records.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <stdexcept>

namespace tarsier::sfm {

void put(PackedWriter& writer, const Features& features) {
  writer.put(features.points);
  writer.put(features.sizes);
  writer.put(features.colors);
  writer.put(features.owners);
  writer.put(static_cast<std::int32_t>(features.points.size() + features.owners.size()));
  writer.put(static_cast<std::int32_t>(features.descriptors.cols));
  std::vector<std::uint8_t> bytes;
  for (int r = 0; r < features.descriptors.rows; ++r) {
    const std::uint8_t* row = features.descriptors.ptr(r);
    bytes.insert(bytes.end(), row, row + features.descriptors.cols);
  }
  writer.put(bytes);
}

Features get_features(PackedReader& reader) {
  Features features;
  features.points = reader.get_all<cv::Point2f>();
  features.sizes = reader.get_all<float>();
  features.colors = reader.get_all<cv::Vec3b>();
  features.owners = reader.get_all<std::int32_t>();
  const auto rows = reader.get<std::int32_t>();
  const auto columns = reader.get<std::int32_t>();
  const std::vector<std::uint8_t> bytes = reader.get_all<std::uint8_t>();
  const std::size_t count = features.points.size();
  if (features.sizes.size() != count || features.colors.size() != count ||
      rows != static_cast<std::int32_t>(count + features.owners.size()) || columns < 0 ||
      columns > 4096 ||
      bytes.size() != (count + features.owners.size()) * static_cast<std::size_t>(columns)) {
    throw Damaged();
  }
  for (const std::int32_t owner : features.owners)
    if (owner < 0 || static_cast<std::size_t>(owner) >= count) throw Damaged();
  for (const cv::Point2f& p : features.points)
    if (!std::isfinite(p.x) || !std::isfinite(p.y)) throw Damaged();
  for (const float size : features.sizes)
    if (!std::isfinite(size)) throw Damaged();
  if (count > 0)
    features.descriptors =
        cv::Mat(rows, columns, CV_8UC1, const_cast<std::uint8_t*>(bytes.data())).clone();
  return features;
}

void put(PackedWriter& writer, const TwoView& view) {
  writer.put(std::span<const Match>(view.inliers));
  writer.put(static_cast<std::int32_t>(view.homography_inliers));
  writer.put(geometry::packed(view.second_from_first));
  writer.put(static_cast<std::int32_t>(view.in_front));
  writer.put(view.median_angle);
}

TwoView get_two_view(PackedReader& reader) {
  TwoView view;
  view.inliers = reader.get_all<Match>();
  view.homography_inliers = reader.get<std::int32_t>();
  const auto pose = reader.get<std::array<double, 12>>();
  view.second_from_first = geometry::unpacked(pose);
  view.in_front = reader.get<std::int32_t>();
  view.median_angle = reader.get<double>();
  const auto is_finite = [](double number) { return std::isfinite(number); };
  if (!std::all_of(pose.begin(), pose.end(), is_finite) || !is_finite(view.median_angle) ||
      view.homography_inliers < 0 || view.in_front < 0) {
    throw Damaged();
  }
  return view;
}

// Written number by number, since the padding of structs is undefined.
void put(PackedWriter& writer, const geometry::Camera& c) {
  writer.put(std::array<std::int32_t, 3>{c.width, c.height, static_cast<std::int32_t>(c.lens)});
  writer.put(std::array<double, 5>{c.fx, c.fy, c.cx, c.cy, c.rms});
  writer.put(c.distortion);
}

geometry::Camera get_camera(PackedReader& reader) {
  geometry::Camera c;
  const auto whole = reader.get<std::array<std::int32_t, 3>>();
  if (whole[2] < 0 || whole[2] > static_cast<std::int32_t>(geometry::Lens::kFisheye))
    throw Damaged();
  c.width = whole[0];
  c.height = whole[1];
  c.lens = static_cast<geometry::Lens>(whole[2]);
  const auto numbers = reader.get<std::array<double, 5>>();
  c.fx = numbers[0];
  c.fy = numbers[1];
  c.cx = numbers[2];
  c.cy = numbers[3];
  c.rms = numbers[4];
  c.distortion = reader.get<std::array<double, 8>>();
  try {
    c.check();
  } catch (const std::invalid_argument&) {
    throw Damaged();
  }
  return c;
}

}  // namespace tarsier::sfm
