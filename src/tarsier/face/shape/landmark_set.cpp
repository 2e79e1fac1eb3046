// SPDX-License-Identifier: MIT
#include "tarsier/face/shape/landmark_set.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/face/shape/markup_check.h"
#include "tarsier/media/archive.h"

#include <cmath>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <system_error>

namespace tarsier::face::shape {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr const char* kLandmarkSetType = "landmark-set";
constexpr int kLandmarkSetVersion = 1;
constexpr std::size_t kMaxPathBytes = 4096;
constexpr ArchiveLimits kLimits{256'000'000, 16, 50'000'000};

bool is_number(const json& value) {
  return value.is_number() && std::abs(value.get<double>()) <= kMaxCoordinate;
}

std::string path_from_json(const json& sample, const std::string& path) {
  std::string image = text_member(sample, "image", path, kMaxPathBytes);
  if (image.empty()) throw ModelError(path, "a sample without an image's path");
  if (image.find('\0') != std::string::npos)
    throw ModelError(path, "an image's path has a zero byte");
  return image;
}

LandmarkSample sample_from_json(const json& value, const std::string& path) {
  if (!value.is_object()) throw ModelError(path, "a sample is not a JSON object");
  LandmarkSample sample;
  sample.image = path_from_json(value, path);
  const auto fail = [&](const std::string& reason) {
    throw ModelError(path, fmt::format("sample of {}: {}", json(sample.image).dump(), reason));
  };
  if (value.contains("person")) sample.person = text_member(value, "person", path, 1024);
  if (const auto box = value.find("box"); box != value.end()) {
    if (!box->is_array() || box->size() != 4) fail("'box' is not x, y, width, height");
    for (const json& number : *box)
      if (!is_number(number)) fail("a number of 'box' is none or out of range");
    const cv::Rect2d rect((*box)[0].get<double>(), (*box)[1].get<double>(), (*box)[2].get<double>(),
                          (*box)[3].get<double>());
    if (!(rect.width > 0 && rect.height > 0)) fail("'box' has no area");
    sample.box = rect;
  }
  const json& points = member(value, "points", path);
  if (!points.is_array()) fail("'points': expected a list");
  if (points.size() > static_cast<std::size_t>(kMaxPoints))
    fail(fmt::format("{} points, more than {}", points.size(), kMaxPoints));
  sample.points.resize(2, static_cast<Eigen::Index>(points.size()));
  Eigen::Index at = 0;
  for (const json& point : points) {
    if (point.is_null()) {
      sample.points.col(at++).setConstant(std::numeric_limits<double>::quiet_NaN());
      continue;
    }
    if (!point.is_array() || point.size() != 2 || !is_number(point[0]) || !is_number(point[1]))
      fail(fmt::format("point {} is neither [x, y] nor null, or out of range", at));
    sample.points.col(at++) << point[0].get<double>(), point[1].get<double>();
  }
  return sample;
}

LandmarkSet set_from_json(const json& payload, const std::string& path) {
  LandmarkSet set;
  const json& samples = member(payload, "samples", path);
  if (!samples.is_array()) throw ModelError(path, "'samples': expected a list");
  for (const json& value : samples) {
    set.samples.push_back(sample_from_json(value, path));
    const Eigen::Index count = set.samples.back().points.cols();
    if (count != set.points()) {
      throw ModelError(path, fmt::format("sample {} has {} points, the first {}",
                                         set.samples.size() - 1, count, set.points()));
    }
  }
  // An empty set may already have its symmetry, whose length is used.
  int points = set.points();
  if (set.samples.empty()) {
    const auto mirror = payload.find("mirror");
    const bool has_mirror = mirror != payload.end() && mirror->is_array() && !mirror->empty();
    points = has_mirror ? static_cast<int>(std::min<std::size_t>(mirror->size(), kMaxPoints))
                        : kMaxPoints;
  }
  set.mirror = mirror_from_json(payload, path, points);
  set.connections = connections_from_json(payload, path, points);
  return set;
}

// The path relative to `folder` if the file is in it or below; otherwise absolute.
std::string path_from(const fs::path& folder, const fs::path& base, const std::string& image) {
  std::error_code error;
  const fs::path absolute =
      fs::absolute(fs::path(image).is_absolute() ? fs::path(image) : base / image, error)
          .lexically_normal();
  if (error) return image;
  const fs::path relative = absolute.lexically_relative(folder);
  if (relative.empty() || relative == "." || *relative.begin() == "..") return absolute.string();
  return relative.string();
}

json to_json(const LandmarkSample& sample) {
  json value;
  value["image"] = sample.image;
  if (!sample.person.empty()) value["person"] = sample.person;
  if (sample.box)
    value["box"] = {sample.box->x, sample.box->y, sample.box->width, sample.box->height};
  json& points = value["points"] = json::array();
  for (int i = 0; i < static_cast<int>(sample.points.cols()); ++i) {
    points.push_back(sample.is_missing(i) ? json()
                                          : json{sample.points(0, i), sample.points(1, i)});
  }
  return value;
}

}  // namespace

bool LandmarkSample::is_missing(int point) const {
  TARSIER_REQUIRE(point >= 0 && point < points.cols(), "point {} of {}", point, points.cols());
  return std::isnan(points(0, point)) || std::isnan(points(1, point));
}

bool LandmarkSample::is_complete() const { return !points.hasNaN(); }

int LandmarkSet::points() const {
  return samples.empty() ? 0 : static_cast<int>(samples.front().points.cols());
}

void LandmarkSet::check() const {
  for (std::size_t k = 0; k < samples.size(); ++k) {
    const LandmarkSample& sample = samples[k];
    TARSIER_REQUIRE(sample.points.cols() == points(), "sample {} ({}) has {} points, the first {}",
                    k, sample.image, sample.points.cols(), points());
    TARSIER_REQUIRE(!sample.points.array().isInf().any(), "sample {} ({}) has an infinite point", k,
                    sample.image);
    TARSIER_REQUIRE(
        !sample.box || (std::isfinite(sample.box->x) && std::isfinite(sample.box->y) &&
                        std::isfinite(sample.box->width) && std::isfinite(sample.box->height) &&
                        sample.box->width > 0 && sample.box->height > 0),
        "sample {} ({}) has a box without area", k, sample.image);
  }
  const bool is_open = samples.empty();
  const int count =
      !is_open ? points() : (mirror.empty() ? kMaxPoints : static_cast<int>(mirror.size()));
  TARSIER_REQUIRE(count <= kMaxPoints, "{} points, more than {}", count, kMaxPoints);
  check_mirror(mirror, count);
  check_connections(connections, count);
}

LandmarkSample mirrored(const LandmarkSample& sample, const std::vector<int>& mirror,
                        int image_width) {
  const Eigen::Index n = sample.points.cols();
  TARSIER_REQUIRE(mirror.size() == static_cast<std::size_t>(n), "a mirror of {} points for {}",
                  mirror.size(), n);
  TARSIER_REQUIRE(image_width >= 1, "image_width {}", image_width);
  LandmarkSample result = sample;
  for (Eigen::Index i = 0; i < n; ++i) {
    const int from = mirror[static_cast<std::size_t>(i)];
    TARSIER_REQUIRE(from >= 0 && from < n, "the mirror of point {} is {}", i, from);
    result.points(0, i) = image_width - 1 - sample.points(0, from);
    result.points(1, i) = sample.points(1, from);
  }
  // As cv::Rect: the box covers the pixels x .. x + width - 1.
  if (result.box) result.box->x = image_width - sample.box->x - sample.box->width;
  return result;
}

LandmarkSet complete_samples(const LandmarkSet& set) {
  LandmarkSet result;
  result.mirror = set.mirror;
  result.connections = set.connections;
  for (const LandmarkSample& sample : set.samples)
    if (sample.is_complete()) result.samples.push_back(sample);
  return result;
}

std::string image_path(const std::string& set_path, const LandmarkSample& sample) {
  const fs::path image(sample.image);
  if (image.is_absolute()) return sample.image;
  return (fs::path(set_path).parent_path() / image).string();
}

LandmarkSet read_landmark_set(const std::string& path) {
  try {
    return set_from_json(read_archive(path, kLandmarkSetType, kLandmarkSetVersion, kLimits).payload,
                         path);
  } catch (const ModelError& error) {
    // A set is user data, not a model: another exit status with the same text.
    const std::string prefix = path + ": ";
    std::string reason = error.what();
    if (reason.starts_with(prefix)) reason.erase(0, prefix.size());
    throw InputError(path, reason);
  }
}

void write_landmark_set(const std::string& path, const LandmarkSet& set, const std::string& base) {
  set.check();
  std::error_code error;
  const fs::path folder = fs::absolute(path, error).lexically_normal().parent_path();
  Archive archive;
  archive.type = kLandmarkSetType;
  archive.version = kLandmarkSetVersion;
  archive.provenance = json::object();
  archive.payload["mirror"] = set.mirror;
  archive.payload["connections"] = set.connections;
  json& samples = archive.payload["samples"] = json::array();
  for (LandmarkSample sample : set.samples) {
    sample.image = path_from(folder, base, sample.image);
    samples.push_back(to_json(sample));
  }
  write_archive(path, archive);
}

}  // namespace tarsier::face::shape
