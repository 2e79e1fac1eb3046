// SPDX-License-Identifier: MIT
#include "ui/face/annotate_state.h"

#include "tarsier/core/at.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/name_table.h"
#include "tarsier/core/require.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier {
namespace {

constexpr NameTable<AnnotateStage, 5> kStages{"stage",
                                              {{{AnnotateStage::kPick, "pick"},
                                                {AnnotateStage::kPoints, "points"},
                                                {AnnotateStage::kConnections, "connections"},
                                                {AnnotateStage::kSymmetry, "symmetry"},
                                                {AnnotateStage::kImages, "images"}}}};

using Eigen::Matrix2Xd;
using Eigen::Vector2d;
using nlohmann::json;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kMaxPx = 1e7;
constexpr int kMaxPoints = 10000;  // as in files

void resize(AnnotatedImage& image, int count) {
  const Eigen::Index before = image.points.cols();
  image.points.conservativeResize(2, count);
  for (Eigen::Index i = before; i < count; ++i) image.points.col(i).setConstant(kNaN);
  image.is_hidden.resize(at(count), 0);
}

void require_place(const Vector2d& place) {
  TARSIER_REQUIRE(place.allFinite() && place.cwiseAbs().maxCoeff() <= kMaxPx, "({}, {})", place.x(),
                  place.y());
}

json json_of(const AnnotatedImage& image) {
  json value;
  value["path"] = image.path;
  value["done"] = image.done;
  value["touched"] = image.touched;
  json& points = value["points"] = json::array();
  for (Eigen::Index i = 0; i < image.points.cols(); ++i) {
    points.push_back(image.points.col(i).hasNaN() ? json()
                                                  : json{image.points(0, i), image.points(1, i)});
  }
  json& hidden = value["hidden"] = json::array();
  for (std::size_t i = 0; i < image.is_hidden.size(); ++i)
    if (image.is_hidden[i] != 0) hidden.push_back(i);
  return value;
}

// Typed access to parts of a record. They throw InputError(path).
const json& part(const json& object, const char* name, json::value_t type,
                 const std::string& path) {
  const auto found = object.find(name);
  if (found == object.end() || found->type() != type)
    throw InputError(path, fmt::format("a line's '{}' is missing or of another type", name));
  return *found;
}

int index_of(const json& value, int low, int high, const std::string& path) {
  if (!value.is_number_integer() || value < low || value >= high)
    throw InputError(path, "an index of a line is out of range");
  return value.get<int>();
}

void take_points(AnnotatedImage& image, const json& value, int count, const std::string& path) {
  const json& points = part(value, "points", json::value_t::array, path);
  if (points.size() > at(count)) throw InputError(path, "a line has too many points");
  image.points = Matrix2Xd::Constant(2, count, kNaN);
  image.is_hidden.assign(at(count), 0);
  Eigen::Index i = 0;
  for (const json& point : points) {
    if (!point.is_null()) {
      if (!point.is_array() || point.size() != 2 || !point[0].is_number() ||
          !point[1].is_number() || !(std::abs(point[0].get<double>()) <= kMaxPx) ||
          !(std::abs(point[1].get<double>()) <= kMaxPx))
        throw InputError(path, "a point of a line is neither [x, y] nor null, or out of range");
      image.points.col(i) << point[0].get<double>(), point[1].get<double>();
    }
    ++i;
  }
  for (const json& hidden : part(value, "hidden", json::value_t::array, path))
    image.is_hidden[at(index_of(hidden, 0, count, path))] = 1;
}

std::string path_in(const std::string& set_path, const face::shape::LandmarkSample& sample) {
  return std::filesystem::path(face::shape::image_path(set_path, sample))
      .lexically_normal()
      .string();
}

}  // namespace

std::string_view name_of(AnnotateStage stage) { return kStages.name(stage); }

bool AnnotatedImage::is_shown(int point) const {
  return point >= 0 && point < points.cols() && is_hidden[at(point)] == 0 &&
         !points.col(point).hasNaN();
}

bool AnnotatedImage::has_points() const {
  for (Eigen::Index i = 0; i < points.cols(); ++i)
    if (is_hidden[static_cast<std::size_t>(i)] != 0 || !points.col(i).hasNaN()) return true;
  return false;
}

const AnnotatedImage& AnnotateState::image(int index) const {
  TARSIER_REQUIRE(index >= 0 && index < images(), "image {} of {}", index, images());
  return *images_[at(index)];
}

int AnnotateState::find(const std::string& path) const {
  for (int i = 0; i < images(); ++i)
    if (images_[at(i)]->path == path) return i;
  return -1;
}

int AnnotateState::done() const {
  return static_cast<int>(
      std::count_if(images_.begin(), images_.end(), [](const auto& p) { return p->done; }));
}

AnnotatedImage& AnnotateState::change(int index) {
  auto copy = std::make_shared<AnnotatedImage>(image(index));
  AnnotatedImage& result = *copy;
  images_[at(index)] = std::move(copy);
  return result;
}

int AnnotateState::add_image(const std::string& path) {
  if (const int index = find(path); index >= 0) return index;
  AnnotatedImage image;
  image.path = path;
  resize(image, points_);
  images_.push_back(std::make_shared<const AnnotatedImage>(std::move(image)));
  return images() - 1;
}

int AnnotateState::add_point(int image, Vector2d place) {
  require_place(place);
  TARSIER_REQUIRE(points_ < kMaxPoints, "{} points are the most", points_);
  ++points_;
  for (int k = 0; k < images(); ++k) resize(change(k), points_);
  mirror_.push_back(-1);
  AnnotatedImage& here = change(image);
  here.points.col(points_ - 1) = place;
  here.done = true;
  return points_ - 1;
}

void AnnotateState::remove_point(int point) {
  TARSIER_REQUIRE(point >= 0 && point < points_, "point {} of {}", point, points_);
  for (int k = 0; k < images(); ++k) {
    AnnotatedImage& here = change(k);
    Matrix2Xd remaining(2, points_ - 1);
    remaining << here.points.leftCols(point), here.points.rightCols(points_ - 1 - point);
    here.points = remaining;
    here.is_hidden.erase(here.is_hidden.begin() + point);
    if (points_ == 1) here.done = false;
  }
  mirror_.erase(mirror_.begin() + point);
  for (int& other : mirror_) {
    if (other == point) {
      other = -1;
    } else if (other > point) {
      --other;
    }
  }
  std::erase_if(connections_,
                [&](const auto& line) { return line[0] == point || line[1] == point; });
  for (auto& line : connections_)
    for (int& end : line) end -= end > point ? 1 : 0;
  --points_;
}

void AnnotateState::move_point(int image, int point, Vector2d place) {
  require_place(place);
  TARSIER_REQUIRE(point >= 0 && point < points_, "point {} of {}", point, points_);
  AnnotatedImage& here = change(image);
  here.points.col(point) = place;
  here.is_hidden[at(point)] = 0;
  here.touched = true;
}

void AnnotateState::hide_point(int image, int point, bool hidden) {
  TARSIER_REQUIRE(point >= 0 && point < points_, "point {} of {}", point, points_);
  AnnotatedImage& here = change(image);
  here.is_hidden[at(point)] = hidden ? 1 : 0;
  here.touched = true;
}

void AnnotateState::set_points(int image, const Matrix2Xd& points, bool touched) {
  TARSIER_REQUIRE(points.cols() == points_, "{} points of {}", points.cols(), points_);
  TARSIER_REQUIRE(points.allFinite() && (points_ == 0 || points.cwiseAbs().maxCoeff() <= kMaxPx),
                  "points must be finite");
  AnnotatedImage& here = change(image);
  here.points = points;
  here.touched = touched;
}

void AnnotateState::clear_points(int image) {
  AnnotatedImage& here = change(image);
  here.points.setConstant(kNaN);
  std::fill(here.is_hidden.begin(), here.is_hidden.end(), 0);
  here.done = false;
  here.touched = false;
}

void AnnotateState::set_done(int image, bool done) {
  AnnotatedImage& here = change(image);
  here.done = done && points_ > 0;
  if (!here.done) return;
  for (Eigen::Index i = 0; i < here.points.cols(); ++i)
    if (here.points.col(i).hasNaN()) here.is_hidden[static_cast<std::size_t>(i)] = 1;
}

void AnnotateState::toggle_connection(int a, int b) {
  TARSIER_REQUIRE(a >= 0 && a < points_ && b >= 0 && b < points_ && a != b, "points {} and {}", a,
                  b);
  const std::array<int, 2> line{std::min(a, b), std::max(a, b)};
  const auto same = [&](const std::array<int, 2>& other) {
    return std::minmax(other[0], other[1]) == std::minmax(line[0], line[1]);
  };
  if (std::erase_if(connections_, same) == 0) connections_.push_back(line);
}

void AnnotateState::toggle_mirror(int a, int b) {
  TARSIER_REQUIRE(a >= 0 && a < points_ && b >= 0 && b < points_, "points {} and {}", a, b);
  const bool is_pair = mirror_[at(a)] == b;
  for (const int end : {a, b}) {
    const int other = mirror_[at(end)];
    if (other >= 0) mirror_[at(other)] = -1;
    mirror_[at(end)] = -1;
  }
  if (is_pair) return;
  mirror_[at(a)] = b;
  mirror_[at(b)] = a;
}

void AnnotateState::set_mirror(std::vector<int> mirror) {
  TARSIER_REQUIRE(mirror.size() == at(points_), "a mirror of {} points for {}", mirror.size(),
                  points_);
  for (int i = 0; i < points_; ++i) {
    const int other = mirror[at(i)];
    TARSIER_REQUIRE(other >= -1 && other < points_ && (other < 0 || mirror[at(other)] == i),
                    "the mirror of point {} is {}", i, other);
  }
  mirror_ = std::move(mirror);
}

void AnnotateState::set_connections(std::vector<std::array<int, 2>> connections) {
  for (const auto& line : connections)
    TARSIER_REQUIRE(line[0] >= 0 && line[0] < points_ && line[1] >= 0 && line[1] < points_,
                    "connection {} - {} of {} points", line[0], line[1], points_);
  connections_ = std::move(connections);
}

face::shape::LandmarkSet AnnotateState::finished() const {
  face::shape::LandmarkSet set;
  for (const auto& image : images_) {
    if (!image->done) continue;
    face::shape::LandmarkSample sample;
    sample.image = image->path;
    sample.points = image->points;
    for (int i = 0; i < points_; ++i)
      if (image->is_hidden[at(i)] != 0) sample.points.col(i).setConstant(kNaN);
    sample.box = image->box;
    sample.person = image->person;
    set.samples.push_back(std::move(sample));
  }
  if (set.samples.empty()) return set;
  if (std::find(mirror_.begin(), mirror_.end(), -1) == mirror_.end()) set.mirror = mirror_;
  set.connections = connections_;
  return set;
}

void AnnotateState::load(const face::shape::LandmarkSet& set, const std::string& set_path) {
  set.check();
  if (set.samples.empty()) return;
  if (points_ != 0 && points_ != set.points())
    throw InputError(set_path, fmt::format("has {} points, expected {}", set.points(), points_));
  points_ = set.points();
  for (int k = 0; k < images(); ++k) resize(change(k), points_);
  for (const face::shape::LandmarkSample& sample : set.samples) {
    AnnotatedImage& here = change(add_image(path_in(set_path, sample)));
    here.points = sample.points;
    here.box = sample.box;
    here.person = sample.person;
    here.done = true;
    for (int i = 0; i < points_; ++i) here.is_hidden[at(i)] = sample.is_missing(i) ? 1 : 0;
  }
  mirror_ = set.mirror.empty() ? std::vector<int>(at(points_), -1) : set.mirror;
  connections_ = set.connections;
}

json AnnotateState::difference(const AnnotateState& before, const std::string& why) const {
  json record;
  record["why"] = why;
  record["points"] = points_;
  record["stage"] = name_of(stage_);
  if (mirror_ != before.mirror_) record["mirror"] = mirror_;
  if (connections_ != before.connections_) record["connections"] = connections_;
  json& changed = record["images"] = json::array();
  for (int k = 0; k < images(); ++k) {
    const bool is_new = k >= before.images();
    if (!is_new && before.images_[at(k)] == images_[at(k)]) continue;
    // An image that only got more points needs no entry: "points" is enough.
    if (!images_[at(k)]->has_points() && !is_new && !before.images_[at(k)]->has_points()) continue;
    changed.push_back(json_of(*images_[at(k)]));
  }
  return record;
}

json AnnotateState::unfinished() const {
  json record;
  record["why"] = "what the set does not hold";
  record["points"] = points_;
  record["stage"] = name_of(stage_);
  const bool is_half = std::find(mirror_.begin(), mirror_.end(), -1) != mirror_.end() &&
                       std::any_of(mirror_.begin(), mirror_.end(), [](int m) { return m >= 0; });
  if (is_half) record["mirror"] = mirror_;
  json& rest = record["images"] = json::array();
  for (const auto& image : images_) {
    bool has_places = false;  // for hidden points
    for (int i = 0; i < points_; ++i)
      has_places = has_places || (image->is_hidden[at(i)] != 0 && !image->points.col(i).hasNaN());
    if (image->done ? has_places : image->touched) rest.push_back(json_of(*image));
  }
  return record;
}

void AnnotateState::apply(const json& record, const std::string& path) {
  apply(record, path, nullptr);
}

void AnnotateState::replay(const std::vector<json>& records, const std::string& path) {
  AnnotateState next = *this;
  std::set<int> cut;
  for (const json& record : records) next.apply(record, path, &cut);
  if (!cut.empty())
    throw InputError(path, fmt::format("does not belong to the set: {} has more points than {}",
                                       next.image(*cut.begin()).path, next.points_));
  *this = std::move(next);
}

void AnnotateState::apply(const json& record, const std::string& path, std::set<int>* cut) {
  if (!record.is_object()) throw InputError(path, "a line is not a JSON object");
  AnnotateState next = *this;
  if (!record.contains("points")) throw InputError(path, "a line's 'points' is missing");
  const int count = index_of(record.at("points"), 0, kMaxPoints + 1, path);
  const json& stage = part(record, "stage", json::value_t::string, path);
  // Older journals call the images "pictures".
  const char* const images_key = record.contains("pictures") ? "pictures" : "images";
  const auto known =
      kStages.find(stage == "pictures" ? "images" : stage.get_ref<const std::string&>());
  if (!known) throw InputError(path, "a line has an unknown 'stage'");
  next.stage_ = *known;
  const bool is_other_count = count != points_;
  next.points_ = count;
  next.mirror_.resize(at(count), -1);
  for (const json& value : part(record, images_key, json::value_t::array, path)) {
    if (!value.is_object()) throw InputError(path, "a line's image is not a JSON object");
    const std::string& name =
        part(value, "path", json::value_t::string, path).get_ref<const std::string&>();
    if (name.empty() || name.find('\0') != std::string::npos || name.size() > 4096)
      throw InputError(path, "a line's image has no usable path");
    const int index = next.add_image(name);
    if (cut != nullptr) cut->erase(index);
    AnnotatedImage& here = next.change(index);
    take_points(here, value, count, path);
    here.touched = part(value, "touched", json::value_t::boolean, path).get<bool>();
    here.done = part(value, "done", json::value_t::boolean, path).get<bool>() && count > 0;
  }
  for (int k = 0; k < next.images(); ++k) {
    if (next.image(k).points.cols() == count) continue;
    // If the number of points changes, each image with points is in the record, or only got more
    // points.
    const bool is_longer = next.image(k).has_points() && next.image(k).points.cols() > count;
    if (is_longer && cut != nullptr) {
      cut->insert(k);
    } else if (is_longer) {
      throw InputError(path, fmt::format("does not belong to the set: {} has more points than {}",
                                         next.image(k).path, count));
    }
    resize(next.change(k), count);
  }
  if (cut != nullptr && !cut->empty()) {
    const auto is_beyond = [&](int point) { return point >= count; };
    std::replace_if(next.mirror_.begin(), next.mirror_.end(), is_beyond, -1);
    std::erase_if(next.connections_, [&](const std::array<int, 2>& line) {
      return is_beyond(line[0]) || is_beyond(line[1]);
    });
  }
  try {
    if (record.contains("mirror")) {
      std::vector<int> mirror;
      for (const json& value : part(record, "mirror", json::value_t::array, path))
        mirror.push_back(index_of(value, -1, count, path));
      next.set_mirror(std::move(mirror));
    } else if (is_other_count) {
      next.set_mirror(next.mirror_);  // throws for an index out of range
    }
    if (record.contains("connections")) {
      std::vector<std::array<int, 2>> connections;
      for (const json& value : part(record, "connections", json::value_t::array, path)) {
        if (!value.is_array() || value.size() != 2) throw InputError(path, "a line's connection");
        connections.push_back(
            {index_of(value[0], 0, count, path), index_of(value[1], 0, count, path)});
      }
      next.set_connections(std::move(connections));
    } else if (is_other_count) {
      next.set_connections(next.connections_);
    }
  } catch (const std::invalid_argument&) {
    throw InputError(path, "a line's symmetry or connections do not fit its points");
  }
  *this = std::move(next);
}

}  // namespace tarsier
