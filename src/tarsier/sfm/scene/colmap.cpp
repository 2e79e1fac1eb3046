// SPDX-License-Identifier: MIT
#include "tarsier/sfm/scene/colmap.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/words.h"
#include "tarsier/geometry/colmap_camera.h"
#include "tarsier/sfm/scene/buffered_file.h"
#include "tarsier/sfm/scene/colmap_binary.h"
#include "tarsier/sfm/scene/colmap_limits.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <limits>
#include <map>
#include <set>
#include <string_view>
#include <system_error>
#include <utility>

namespace tarsier::sfm {
namespace {

namespace fs = std::filesystem;
using geometry::kColmapOffset;

constexpr std::size_t kMaxLineBytes = 100'000'000;  // more than a million features or observations
constexpr std::int64_t kMaxId = std::numeric_limits<std::uint32_t>::max();
constexpr std::int64_t kMaxPointId = std::numeric_limits<std::int64_t>::max();
constexpr int kMaxIndex = std::numeric_limits<int>::max();
// A comment for COLMAP: clockwise quarter turns that bring the named image upright.
constexpr std::string_view kOrientationComment = "# TURNED ";

class TextFile : public BufferedFile {
 public:
  using BufferedFile::BufferedFile;
  template <typename... Args>
  void add(fmt::format_string<Args...> format, Args&&... args) {
    fmt::format_to(std::back_inserter(buffer()), format, std::forward<Args>(args)...);
    flush_if_full();
  }
};

bool is_index(int index, std::size_t size) {
  return index >= 0 && static_cast<std::size_t>(index) < size;
}

void check_image(const Image& image, const Model& model) {
  TARSIER_REQUIRE(is_index(image.camera, model.cameras.size()), "camera {} of '{}'", image.camera,
                  image.name);
  model.cameras[static_cast<std::size_t>(image.camera)].check();
  const bool is_whole = image.points.size() == image.features.size();
  TARSIER_REQUIRE(is_whole, "'{}' has {} features, but {} entries for their points", image.name,
                  image.features.size(), image.points.size());
  for (std::size_t f = 0; f < image.features.size(); ++f) {
    TARSIER_REQUIRE(std::isfinite(image.features[f].x) && std::isfinite(image.features[f].y),
                    "feature {} of '{}' is not finite", f, image.name);
    TARSIER_REQUIRE(image.points[f] == -1 || is_index(image.points[f], model.points.size()),
                    "point {} of feature {} of '{}' does not exist", image.points[f], f,
                    image.name);
  }
  TARSIER_REQUIRE(geometry::is_rotation(image.pose.rotation),
                  "the rotation of '{}' is not a rotation matrix", image.name);
  TARSIER_REQUIRE(image.pose.translation.allFinite(), "the translation of '{}' is not finite",
                  image.name);
}

void add_images(TextFile& file, const Model& model, const std::vector<int>& camera_ids) {
  file.add(
      "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n"
      "# POINTS2D[] as (X, Y, POINT3D_ID)\n");
  for (const Image& image : model.images)
    if (image.registered && image.turns != 0)
      file.add("{}{} {}\n", kOrientationComment, image.turns, image.name);
  int id = 0;
  for (const Image& image : model.images) {
    if (!image.registered) continue;
    const Eigen::Vector4d q = geometry::quaternion_of(image.pose.rotation);
    const Eigen::Vector3d& t = image.pose.translation;
    file.add("{} {:.17g} {:.17g} {:.17g} {:.17g} {:.17g} {:.17g} {:.17g} {} {}\n", ++id, q[0], q[1],
             q[2], q[3], t[0], t[1], t[2], camera_ids[static_cast<std::size_t>(image.camera)],
             image.name);
    for (std::size_t f = 0; f < image.features.size(); ++f) {
      file.add("{}{:.9g} {:.9g} {}", f == 0 ? "" : " ", image.features[f].x + kColmapOffset,
               image.features[f].y + kColmapOffset,
               image.points[f] < 0 ? -1 : std::int64_t{image.points[f]} + 1);
    }
    file.add("\n");
  }
}

void add_points(TextFile& file, const Model& model) {
  std::vector<int> image_ids(model.images.size(), 0);
  int last_id = 0;
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    if (model.images[i].registered) image_ids[i] = ++last_id;
  }
  file.add("# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n");
  for (std::size_t p = 0; p < model.points.size(); ++p) {
    const Point& point = model.points[p];
    const Eigen::Vector3d& x = point.position;
    file.add("{} {:.17g} {:.17g} {:.17g} {} {} {} {:.17g}", p + 1, x[0], x[1], x[2], point.color[2],
             point.color[1], point.color[0], point.error);
    for (const auto& [i, f] : point.track)
      file.add(" {} {}", image_ids[static_cast<std::size_t>(i)], f);
    file.add("\n");
  }
}

// Reads line by line, so that a large file is never completely in memory.
class LineReader {
 public:
  explicit LineReader(const std::string& path) : path_(path) {
    std::error_code error;
    const fs::file_status status = fs::status(path, error);
    if (!fs::exists(status)) throw InputError(path, "no such file");
    if (!fs::is_regular_file(status)) throw InputError(path, "is not a regular file");
    stream_.open(path, std::ios::binary);
    if (!stream_) throw InputError(path, "cannot read");
  }

  // Reads any next line; false at the end. A `skipped` line counts for the length limit, but is not
  // kept.
  bool next(std::string_view& line, bool skipped = false) {
    line_.clear();
    std::size_t length = 0;
    bool is_line = false;
    while (true) {
      if (position_ == available_) {
        stream_.read(buffer_.data(), static_cast<std::streamsize>(buffer_.size()));
        available_ = static_cast<std::size_t>(stream_.gcount());
        position_ = 0;
        if (stream_.bad()) throw InputError(path_, "cannot read");
        if (available_ == 0) break;
      }
      is_line = true;
      const std::string_view rest(buffer_.data() + position_, available_ - position_);
      const std::size_t end = rest.find('\n');
      const std::string_view piece = rest.substr(0, end);
      length += piece.size();
      // The first byte of a comment suffices.
      if (line_.empty() || !(skipped || line_.front() == '#')) line_.append(piece);
      if (length > kMaxLineBytes) {
        ++number_;
        fail(fmt::format("longer than the limit of {} bytes", kMaxLineBytes));
      }
      position_ += end == std::string_view::npos ? rest.size() : end + 1;
      if (end != std::string_view::npos) break;
    }
    if (!is_line) return false;
    ++number_;
    line = line_;
    while (!line.empty() && line.back() == '\r') line.remove_suffix(1);
    return true;
  }

  // Reads the next line that is neither blank nor a comment. `on_comment` receives comments, long
  // ones truncated.
  template <typename OnComment>
  bool next_content(std::string_view& line, const OnComment& on_comment) {
    while (next(line)) {
      const std::string_view content = trimmed(line);
      if (!content.empty() && content.front() != '#') return true;
      on_comment(line);
    }
    return false;
  }
  bool next_content(std::string_view& line) {
    return next_content(line, [](std::string_view /*comment*/) {});
  }

  [[nodiscard]] std::int64_t number() const { return number_; }
  [[nodiscard]] const std::string& path() const { return path_; }
  [[noreturn]] void fail(const std::string& reason) const { fail(number_, reason); }
  [[noreturn]] void fail(std::int64_t line, const std::string& reason) const {
    throw InputError(path_, fmt::format("line {}: {}", line, reason));
  }

  // Parse the next words of `rest` as the expected type.
  [[nodiscard]] double number(std::string_view& rest, std::string_view what) const {
    const std::string_view word = next_word(rest);
    const auto value = to_number(word);
    if (!value) refuse(word, what, "a finite number");
    return *value;
  }
  [[nodiscard]] std::int64_t integer(std::string_view& rest, std::string_view what,
                                     std::int64_t low, std::int64_t high) const {
    const std::string_view word = next_word(rest);
    const auto value = to_integer(word, low, high);
    if (!value) refuse(word, what, fmt::format("an integer in {}..{}", low, high));
    return *value;
  }

 private:
  [[noreturn]] void refuse(std::string_view word, std::string_view what,
                           std::string_view expected) const {
    if (word.empty()) fail(fmt::format("{} is missing", what));
    fail(fmt::format("{} '{}' is not {}", what, printable(word.substr(0, 60)), expected));
  }

  std::string path_;
  std::ifstream stream_;
  std::string buffer_ = std::string(1 << 16, '\0');
  std::size_t position_ = 0;
  std::size_t available_ = 0;
  std::string line_;
  std::int64_t number_ = 0;
};

// Ids are kept in trees: a file with chosen ids could make hash tables slow.
using IndexOf = std::map<std::int64_t, int>;

class ModelReader {
 public:
  explicit ModelReader(bool poses_only) : poses_only_(poses_only) {}

  Model read(const std::string& folder) {
    read_cameras((fs::path(folder) / "cameras.txt").string());
    LineReader images((fs::path(folder) / "images.txt").string());
    read_images(images);
    if (poses_only_) return std::move(model_);
    read_points((fs::path(folder) / "points3D.txt").string());
    // Ids still present belong to no track.
    for (std::size_t i = 0; i < model_.images.size(); ++i) {
      for (std::size_t f = 0; f < point_ids_[i].size(); ++f) {
        if (point_ids_[i][f] >= 0) {
          images.fail(lines_[i], fmt::format("feature {} belongs to point {}, but the track of the "
                                             "point in points3D.txt does not contain the feature",
                                             f, point_ids_[i][f]));
        }
      }
    }
    return std::move(model_);
  }

 private:
  void read_cameras(const std::string& path) {
    LineReader reader(path);
    std::string_view line;
    while (reader.next_content(line)) {
      if (model_.cameras.size() == kMaxColmapItems)
        reader.fail(fmt::format("more than the limit of {} cameras", kMaxColmapItems));
      geometry::ColmapCamera read = geometry::parse_colmap_camera(line, path, reader.number());
      if (!cameras_.emplace(read.id, static_cast<int>(model_.cameras.size())).second)
        reader.fail(fmt::format("camera {} occurs twice", read.id));
      model_.cameras.push_back(read.camera);
    }
  }

  void read_images(LineReader& reader) {
    std::set<std::string> names;
    std::map<std::string, int, std::less<>> turns;
    const auto on_comment = [&](std::string_view comment) {
      // In the format of write_images(); other comments are ignored.
      if (!comment.starts_with(kOrientationComment) || turns.size() == kMaxColmapItems) return;
      std::string_view rest = comment.substr(kOrientationComment.size());
      const auto quarters = to_integer(next_word(rest), 1, 3);
      if (quarters && !rest.empty()) turns.emplace(rest.substr(1), static_cast<int>(*quarters));
    };
    std::string_view line;
    while (reader.next_content(line, on_comment)) {
      if (model_.images.size() == kMaxColmapItems)
        reader.fail(fmt::format("more than the limit of {} images", kMaxColmapItems));
      Image image = read_image(reader, line);
      if (!names.insert(image.name).second)
        reader.fail(fmt::format("'{}' occurs twice", printable(image.name)));
      if (const auto turned = turns.find(image.name); turned != turns.end())
        image.turns = turned->second;
      lines_.push_back(reader.number() + 1);
      point_ids_.emplace_back();
      // The line of features may be blank, or missing at the end of a file.
      if (reader.next(line, poses_only_) && !poses_only_)
        read_features(reader, line, image, point_ids_.back());
      model_.images.push_back(std::move(image));
    }
  }

  Image read_image(const LineReader& reader, std::string_view rest) {
    Image image;
    image.registered = true;
    const std::int64_t id = reader.integer(rest, "the image's id", 0, kMaxId);
    if (!images_.emplace(id, static_cast<int>(model_.images.size())).second)
      reader.fail(fmt::format("image {} occurs twice", id));
    Eigen::Vector4d q;
    for (int k = 0; k < 4; ++k) q[k] = reader.number(rest, "the rotation");
    const double length = q.norm();
    if (!(length > 0.9 && length < 1.1))
      reader.fail(fmt::format("the rotation's quaternion has length {}, not 1", length));
    image.pose.rotation = geometry::rotation_of(q);
    for (int k = 0; k < 3; ++k) image.pose.translation[k] = reader.number(rest, "the translation");
    const std::int64_t camera = reader.integer(rest, "the camera's id", 0, kMaxId);
    const auto found = cameras_.find(camera);
    if (found == cameras_.end()) reader.fail(fmt::format("camera {} is unknown", camera));
    image.camera = found->second;
    if (!rest.empty()) rest.remove_prefix(1);  // one blank; the name itself may begin with a blank
    if (const std::string error = image_name_error(rest); !error.empty()) reader.fail(error);
    image.name = rest;
    return image;
  }

  void read_features(const LineReader& reader, std::string_view rest, Image& image,
                     std::vector<std::int64_t>& point_ids) {
    while (!(rest = trimmed(rest)).empty()) {
      if (++features_ > kMaxColmapFeatures)
        reader.fail(fmt::format("more than the limit of {} features", kMaxColmapFeatures));
      const double x = reader.number(rest, "a feature's x") - kColmapOffset;
      const double y = reader.number(rest, "a feature's y") - kColmapOffset;
      if (std::abs(x) > kMaxColmapPixel || std::abs(y) > kMaxColmapPixel)
        reader.fail(fmt::format("the feature ({}, {}) is far outside the image", x, y));
      image.features.emplace_back(static_cast<float>(x), static_cast<float>(y));
      point_ids.push_back(reader.integer(rest, "a feature's point", -1, kMaxPointId));
    }
    image.points.assign(image.features.size(), -1);
  }

  void read_points(const std::string& path) {
    LineReader reader(path);
    std::set<std::int64_t> ids;
    std::string_view line;
    while (reader.next_content(line)) {
      if (model_.points.size() == static_cast<std::size_t>(kMaxIndex))
        reader.fail("too many points");
      const std::int64_t id = reader.integer(line, "the point's id", 0, kMaxPointId);
      if (!ids.insert(id).second) reader.fail(fmt::format("point {} occurs twice", id));
      Point point;
      for (int k = 0; k < 3; ++k) point.position[k] = reader.number(line, "the position");
      for (int k = 2; k >= 0; --k)
        point.color[k] = static_cast<std::uint8_t>(reader.integer(line, "the colour", 0, 255));
      // COLMAP writes -1 for an error that it did not compute.
      point.error = std::max(reader.number(line, "the error"), 0.0);
      read_track(reader, line, id, point);
      if (point.track.size() < 2) continue;
      for (const auto& [i, f] : point.track) {
        model_.images[static_cast<std::size_t>(i)].points[static_cast<std::size_t>(f)] =
            static_cast<int>(model_.points.size());
      }
      model_.points.push_back(std::move(point));
    }
  }

  void read_track(const LineReader& reader, std::string_view rest, std::int64_t id, Point& point) {
    std::size_t count = 0;
    while (!(rest = trimmed(rest)).empty()) {
      const std::int64_t image = reader.integer(rest, "an image of the track", 0, kMaxId);
      const std::int64_t feature = reader.integer(rest, "a feature of the track", 0, kMaxIndex);
      const auto found = images_.find(image);
      if (found == images_.end()) reader.fail(fmt::format("image {} is unknown", image));
      std::vector<std::int64_t>& ids = point_ids_[static_cast<std::size_t>(found->second)];
      const auto f = static_cast<std::size_t>(feature);
      if (f >= ids.size() || ids[f] != id) {
        reader.fail(
            fmt::format("feature {} of image {} does not belong to point {} in images.txt, or "
                        "occurs twice in the track",
                        feature, image, id));
      }
      ids[f] = -1;  // mark as used
      ++count;
      point.track.push_back({found->second, static_cast<int>(feature)});
    }
    if (count < 2)
      reader.fail(fmt::format("the track of point {} has fewer than two observations", id));
    point.track = first_per_image(point.track);
  }

  // The first observation of each image, in their order.
  static std::vector<Observation> first_per_image(const std::vector<Observation>& track) {
    std::set<int> images;
    std::vector<Observation> result;
    for (const Observation& observation : track) {
      if (images.insert(observation.image).second) result.push_back(observation);
    }
    return result;
  }

  bool poses_only_ = false;
  std::size_t features_ = 0;
  Model model_;
  IndexOf cameras_;
  IndexOf images_;
  std::vector<std::int64_t> lines_;                   // line number of each image's features
  std::vector<std::vector<std::int64_t>> point_ids_;  // per feature; -1: none, or used
};

}  // namespace

void check_model(const Model& model) {
  std::size_t seen = 0;
  std::set<std::string_view> names;
  for (const Image& image : model.images) {
    if (!image.registered) continue;
    check_image(image, model);
    TARSIER_REQUIRE(names.insert(image.name).second, "'{}' occurs twice", image.name);
    seen += image.points.size() -
            static_cast<std::size_t>(std::count(image.points.begin(), image.points.end(), -1));
  }
  std::size_t tracked = 0;
  for (std::size_t p = 0; p < model.points.size(); ++p) {
    const Point& point = model.points[p];
    TARSIER_REQUIRE(point.position.allFinite() && std::isfinite(point.error),
                    "point {} is not finite", p);
    TARSIER_REQUIRE(point.track.size() >= 2, "point {} has {} observations: two or more are needed",
                    p, point.track.size());
    for (const auto& [i, f] : point.track) {
      TARSIER_REQUIRE(is_index(i, model.images.size()),
                      "image {} in the track of point {} does not exist", i, p);
      const Image& image = model.images[static_cast<std::size_t>(i)];
      TARSIER_REQUIRE(image.registered, "'{}' in the track of point {} is not registered",
                      image.name, p);
      TARSIER_REQUIRE(is_index(f, image.features.size()),
                      "feature {} in the track of point {} does not exist", f, p);
      TARSIER_REQUIRE(image.points[static_cast<std::size_t>(f)] == static_cast<int>(p),
                      "feature {} of '{}' is in the track of point {}, but refers to another point",
                      f, image.name, p);
    }
    tracked += point.track.size();
  }
  TARSIER_REQUIRE(tracked == seen,
                  "{} features refer to points, but the tracks have {} observations", seen,
                  tracked);
}

void write_colmap(const std::string& folder, const Model& model) {
  check_model(model);
  std::vector<int> camera_ids(model.cameras.size(), 0);
  for (const Image& image : model.images) {
    if (!image.registered) continue;
    camera_ids[static_cast<std::size_t>(image.camera)] = 1;
    if (const std::string error = image_name_error(image.name); !error.empty())
      throw OutputError((fs::path(folder) / "images.txt").string(),
                        "an image cannot be written: " + error);
  }
  make_folder(folder);
  TextFile cameras((fs::path(folder) / "cameras.txt").string());
  cameras.add("# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n");
  int last_id = 0;
  for (std::size_t c = 0; c < camera_ids.size(); ++c) {
    if (camera_ids[c] == 0) continue;
    camera_ids[c] = ++last_id;
    cameras.add("{}\n", geometry::colmap_camera_line({last_id, model.cameras[c]}));
  }
  TextFile images((fs::path(folder) / "images.txt").string());
  add_images(images, model, camera_ids);
  TextFile points((fs::path(folder) / "points3D.txt").string());
  add_points(points, model);
  BufferedFile::commit_all({&cameras, &images, &points});
}

Model read_colmap(const std::string& folder) {
  return is_colmap_binary(folder) ? read_colmap_binary(folder) : ModelReader(false).read(folder);
}

Model read_colmap_poses(const std::string& folder) {
  if (!is_colmap_binary(folder)) return ModelReader(true).read(folder);
  Model model = read_colmap_binary(folder);
  model.points.clear();
  for (Image& image : model.images) {
    image.features.clear();
    image.points.clear();
  }
  return model;
}

std::string image_name_error(std::string_view name) {
  if (name.empty()) return "has no name";
  if (std::any_of(name.begin(), name.end(),
                  [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7F; })) {
    return fmt::format("the name '{}' has control characters", printable(name));
  }
  const fs::path path(name);
  if (path.is_absolute() || std::find(path.begin(), path.end(), "..") != path.end())
    return fmt::format("the name '{}' refers to a file outside the folder", printable(name));
  return {};
}

}  // namespace tarsier::sfm
